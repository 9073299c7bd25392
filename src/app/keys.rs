//! Key bindings: one table, for the window and for its help.

use super::actions::Action;
use super::navigation::{Direction, Input, Mode, Modifiers, NavigationStyle};
use crate::view::{Preset, Projection};
use winit::keyboard::KeyCode;

/// The effect of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Binding {
    Fly(Direction),
    Do(Action),
    Close,
    /// Answers the question whether to close with yes.
    Confirm,
}

/// Keys that are held besides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Held {
    /// Not control.
    None,
    Control,
    ControlShift,
}

pub struct Key {
    pub codes: &'static [KeyCode],
    pub held: Held,
    pub binding: Binding,
    pub name: &'static str,
    pub about: &'static str,
}

const fn key(
    codes: &'static [KeyCode],
    name: &'static str,
    binding: Binding,
    about: &'static str,
) -> Key {
    Key { codes, held: Held::None, binding, name, about }
}

const fn with(held: Held, key: Key) -> Key {
    Key { held, ..key }
}

const fn look(from: Preset) -> Binding {
    Binding::Do(Action::Navigate(Input::Look { from }))
}

const fn project(onto: Projection) -> Binding {
    Binding::Do(Action::Navigate(Input::Project { onto }))
}

const KEYS: &[Key] = &[
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
        Binding::Do(Action::Navigate(Input::OtherProjection)),
        "switch between perspective and orthographic",
    ),
    key(&[KeyCode::KeyP], "P", project(Projection::Perspective), "perspective"),
    key(&[KeyCode::KeyO], "O", project(Projection::Orthographic), "orthographic"),
    key(&[KeyCode::KeyW, KeyCode::ArrowUp], "W", Binding::Fly(Direction::Forward), "fly ahead"),
    key(&[KeyCode::KeyS, KeyCode::ArrowDown], "S", Binding::Fly(Direction::Back), "back"),
    key(&[KeyCode::KeyA, KeyCode::ArrowLeft], "A", Binding::Fly(Direction::Left), "left"),
    key(&[KeyCode::KeyD, KeyCode::ArrowRight], "D", Binding::Fly(Direction::Right), "right"),
    key(
        &[KeyCode::KeyE, KeyCode::KeyR, KeyCode::PageUp],
        "E",
        Binding::Fly(Direction::Up),
        "up; R too",
    ),
    key(
        &[KeyCode::KeyQ, KeyCode::KeyF, KeyCode::PageDown],
        "Q",
        Binding::Fly(Direction::Down),
        "down; F too",
    ),
    key(
        &[KeyCode::KeyM],
        "M",
        Binding::Do(Action::Navigate(Input::NextMode)),
        "next mouse mode: orbit, look around in flight, grab the ground",
    ),
    key(&[KeyCode::KeyX], "X", Binding::Do(Action::Profile), "profile along the picked points"),
    key(
        &[KeyCode::KeyC],
        "C",
        Binding::Do(Action::Export("csv")),
        "save the picked points as CSV, and the profile as SVG and CSV",
    ),
    key(
        &[KeyCode::KeyG],
        "G",
        Binding::Do(Action::Export("geojson")),
        "save the picked points as GeoJSON",
    ),
    key(
        &[KeyCode::Delete, KeyCode::Backspace],
        "Del",
        Binding::Do(Action::Forget),
        "forget the picked points",
    ),
    key(
        &[KeyCode::KeyB],
        "B",
        Binding::Do(Action::AddBox),
        "add a clip box, around the picked points or the middle of the picture",
    ),
    key(&[KeyCode::KeyK], "K", Binding::Do(Action::AddKey), "add this view to the camera path"),
    key(
        &[KeyCode::Space],
        "Space",
        Binding::Do(Action::Play),
        "fly along the camera path, or stop",
    ),
    key(
        &[KeyCode::KeyT],
        "T",
        Binding::Do(Action::Errors),
        "show or hide the errors of the last moving picture, once one at rest is there",
    ),
    key(&[KeyCode::F6], "F6", Binding::Do(Action::LoadScene), "load the scene saved last"),
    key(
        &[KeyCode::F7],
        "F7",
        Binding::Do(Action::SavePath),
        "save the camera path, for render --path",
    ),
    key(&[KeyCode::F8], "F8", Binding::Do(Action::SaveScene), "save the scene, for render --scene"),
    key(&[KeyCode::F9], "F9", Binding::Do(Action::SavePicture), "save the picture"),
    key(
        &[KeyCode::KeyL],
        "L",
        Binding::Do(Action::SaveLayers),
        "save layers: depth, point ids, normals and more, as EXR",
    ),
    with(
        Held::Control,
        key(&[KeyCode::KeyZ], "Ctrl Z", Binding::Do(Action::Undo), "undo a change of the scene"),
    ),
    with(
        Held::ControlShift,
        key(&[KeyCode::KeyZ], "Ctrl Shift Z", Binding::Do(Action::Redo), "redo it"),
    ),
    with(Held::Control, key(&[KeyCode::KeyY], "Ctrl Y", Binding::Do(Action::Redo), "redo")),
    with(Held::Control, key(&[KeyCode::KeyO], "Ctrl O", Binding::Do(Action::Open), "open files")),
    key(&[KeyCode::F11], "F11", Binding::Do(Action::FullScreen), "full screen"),
    key(&[KeyCode::KeyH, KeyCode::F1], "H", Binding::Do(Action::Help), "these keys"),
    key(&[KeyCode::KeyN], "N", Binding::Do(Action::Panel), "hide or show the panel"),
    key(
        &[KeyCode::Escape],
        "Esc",
        Binding::Close,
        "close a list, a message, the profile, these keys, or the window",
    ),
    key(
        &[KeyCode::Enter, KeyCode::NumpadEnter],
        "Enter",
        Binding::Confirm,
        "close the window though something is not saved",
    ),
];

/// Returns what the mouse does, for a navigation style and a mode.
fn mouse(style: NavigationStyle, mode: Mode) -> Vec<(&'static str, &'static str)> {
    let turns = match mode {
        Mode::Orbit => "turn about the point under the cursor",
        Mode::Fly => "look around",
        Mode::Earth => "grab the ground",
    };
    let moves = "move the point under the cursor";
    let drags = match (style, mode) {
        (NavigationStyle::Blender, _) => {
            vec![("middle drag", turns), ("shift middle drag", moves), ("ctrl middle drag", "zoom")]
        }
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
        ("double click", "centre the point"),
    ];
    drags.into_iter().chain(others).collect()
}

/// Keys that the panel itself takes.
const OF_THE_PANEL: [(&str, &str); 3] = [
    ("Ctrl +", "enlarge the panel and its text"),
    ("Ctrl -", "reduce them"),
    ("Ctrl 0", "show them in their usual size"),
];

/// Returns what the mouse and every key do, for the window's help and for that of `view`.
pub fn rows(style: NavigationStyle, mode: Mode) -> Vec<(&'static str, &'static str)> {
    let keys = KEYS.iter().map(|key| (key.name, key.about));
    mouse(style, mode).into_iter().chain(keys).chain(OF_THE_PANEL).collect()
}

/// Returns the binding of a key with others held; None if it has none.
pub fn find(code: KeyCode, modifiers: Modifiers) -> Option<Binding> {
    let held = match (modifiers.control, modifiers.shift) {
        (false, _) => Held::None,
        (true, false) => Held::Control,
        (true, true) => Held::ControlShift,
    };
    let found = KEYS.iter().find(|key| key.codes.contains(&code) && key.held == held);
    found.map(|key| key.binding)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_does_two_things() {
        let codes: Vec<_> =
            KEYS.iter().flat_map(|key| key.codes.iter().map(|code| (code, key.held))).collect();
        let distinct: std::collections::HashSet<_> = codes.iter().collect();
        assert_eq!(codes.len(), distinct.len());
    }
}
