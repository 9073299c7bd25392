//! What a key does: one table, from which the window acts and the help is written.

use super::deeds::Deed;
use super::navigation::{Habit, Input, Mode, Way};
use crate::view::{Preset, Projection};
use winit::keyboard::KeyCode;

/// What the window does at a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Act {
    Fly(Way),
    Do(Deed),
    Close,
}

pub struct Key {
    pub codes: &'static [KeyCode],
    pub act: Act,
    pub name: &'static str,
    pub about: &'static str,
}

const fn key(codes: &'static [KeyCode], name: &'static str, act: Act, about: &'static str) -> Key {
    Key { codes, act, name, about }
}

const fn look(from: Preset) -> Act {
    Act::Do(Deed::Navigate(Input::Look { from, covered_px: 0.0 }))
}

const fn project(onto: Projection) -> Act {
    Act::Do(Deed::Navigate(Input::Project { onto }))
}

pub const KEYS: &[Key] = &[
    key(
        &[KeyCode::Digit0, KeyCode::Numpad0, KeyCode::Home],
        "0",
        look(Preset::Fit),
        "the whole cloud",
    ),
    key(&[KeyCode::Digit1, KeyCode::Numpad1], "1", look(Preset::Front), "from the south"),
    key(&[KeyCode::Digit3, KeyCode::Numpad3], "3", look(Preset::Side), "from the east"),
    key(&[KeyCode::Digit7, KeyCode::Numpad7], "7", look(Preset::Top), "from above"),
    key(
        &[KeyCode::Digit5, KeyCode::Numpad5],
        "5",
        Act::Do(Deed::Navigate(Input::OtherProjection)),
        "with perspective, or without",
    ),
    key(&[KeyCode::KeyP], "P", project(Projection::Perspective), "with perspective"),
    key(&[KeyCode::KeyO], "O", project(Projection::Orthographic), "without"),
    key(&[KeyCode::KeyW, KeyCode::ArrowUp], "W", Act::Fly(Way::Forward), "fly ahead"),
    key(&[KeyCode::KeyS, KeyCode::ArrowDown], "S", Act::Fly(Way::Back), "back"),
    key(&[KeyCode::KeyA, KeyCode::ArrowLeft], "A", Act::Fly(Way::Left), "left"),
    key(&[KeyCode::KeyD, KeyCode::ArrowRight], "D", Act::Fly(Way::Right), "right"),
    key(&[KeyCode::KeyE, KeyCode::KeyR, KeyCode::PageUp], "E", Act::Fly(Way::Up), "up; R too"),
    key(
        &[KeyCode::KeyQ, KeyCode::KeyF, KeyCode::PageDown],
        "Q",
        Act::Fly(Way::Down),
        "down; F too",
    ),
    key(
        &[KeyCode::KeyM],
        "M",
        Act::Do(Deed::Navigate(Input::NextMode)),
        "the mouse orbits, looks around in flight, or grabs the ground",
    ),
    key(&[KeyCode::KeyX], "X", Act::Do(Deed::Profile), "a profile along what was picked"),
    key(
        &[KeyCode::KeyC],
        "C",
        Act::Do(Deed::Export("csv")),
        "save what was picked, as a table, and the profile",
    ),
    key(
        &[KeyCode::KeyG],
        "G",
        Act::Do(Deed::Export("geojson")),
        "save what was picked, as GeoJSON",
    ),
    key(
        &[KeyCode::Delete, KeyCode::Backspace],
        "Del",
        Act::Do(Deed::Forget),
        "forget what was picked",
    ),
    key(
        &[KeyCode::KeyB],
        "B",
        Act::Do(Deed::AddBox),
        "one more clip box, around what was picked or the middle of the picture",
    ),
    key(&[KeyCode::KeyK], "K", Act::Do(Deed::AddKey), "one more view of the camera path"),
    key(&[KeyCode::Space], "Space", Act::Do(Deed::Play), "fly along the camera path, or stop"),
    key(&[KeyCode::F6], "F6", Act::Do(Deed::LoadScene), "load the scene that was saved last"),
    key(&[KeyCode::F7], "F7", Act::Do(Deed::SavePath), "save the camera path, for render --path"),
    key(&[KeyCode::F8], "F8", Act::Do(Deed::SaveScene), "save the scene, for render --scene"),
    key(&[KeyCode::F9], "F9", Act::Do(Deed::SavePicture), "save the picture"),
    key(
        &[KeyCode::KeyL],
        "L",
        Act::Do(Deed::SaveLayers),
        "save its layers: depth, point ids, normals and more, as EXR",
    ),
    key(&[KeyCode::F11], "F11", Act::Do(Deed::FullScreen), "full screen"),
    key(&[KeyCode::KeyH, KeyCode::F1], "H", Act::Do(Deed::Help), "these keys"),
    key(&[KeyCode::KeyN], "N", Act::Do(Deed::Panel), "without the panel, or with it"),
    key(&[KeyCode::Escape], "Esc", Act::Close, "put away what went wrong, or a profile, or close"),
];

/// What the mouse does, for the hands of each program and what a drag does.
pub fn mouse(habit: Habit, mode: Mode) -> Vec<(&'static str, &'static str)> {
    let turns = match mode {
        Mode::Orbit => "turn about the point under the cursor",
        Mode::Fly => "look around",
        Mode::Earth => "grab the ground",
    };
    let moves = "move the point under the cursor along";
    let drags = match (habit, mode) {
        (Habit::Blender, _) => vec![
            ("middle drag", turns),
            ("shift middle drag", moves),
            ("ctrl middle drag", "nearer and farther"),
        ],
        (_, Mode::Earth) => vec![
            ("left drag", turns),
            ("right drag", "turn about the point under the cursor"),
            ("middle drag", moves),
        ],
        _ => vec![("left drag", turns), ("right, middle drag", moves)],
    };
    let wheel = if mode == Mode::Fly {
        "fly faster or slower"
    } else {
        "towards the point under the cursor, or away"
    };
    let others = [
        ("wheel", wheel),
        ("click", "pick the point"),
        ("shift click", "pick one more"),
        ("double click", "make the point the middle"),
    ];
    drags.into_iter().chain(others).collect()
}

pub fn find(code: KeyCode) -> Option<Act> {
    KEYS.iter().find(|key| key.codes.contains(&code)).map(|key| key.act)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_does_two_things() {
        let codes: Vec<_> = KEYS.iter().flat_map(|key| key.codes).collect();
        let distinct: std::collections::HashSet<_> = codes.iter().collect();
        assert_eq!(codes.len(), distinct.len());
    }
}
