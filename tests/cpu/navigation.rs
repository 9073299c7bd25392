//! Navigation: input applies to the point under the cursor, which stays there.

use glam::{DVec2, DVec3};
use pointillist::app::navigation::{
    Button, Direction, Input, Mode, Modifiers, Navigation, NavigationStyle, Subject,
};
use pointillist::select::clip::Clips;
use pointillist::view::{Camera, Preset, Projection, View};
use proptest::prelude::*;

const SIZE: [u32; 2] = [800, 600];
/// A projected coordinate system's: far from the origin.
const ORIGIN: DVec3 = DVec3::new(500_000.0, 5_000_000.0, 100.0);

fn navigation(style: NavigationStyle, from: Preset) -> Navigation {
    let corners = (0..8)
        .map(|i| {
            ORIGIN
                + DVec3::new(
                    (i & 1) as f64 * 40.0,
                    (i >> 1 & 1) as f64 * 30.0,
                    (i >> 2) as f64 * 10.0,
                )
        })
        .collect();
    let mut navigation = Navigation::new(style, SIZE);
    navigation.set_subject(Subject::of(corners, DVec3::Z));
    navigation.handle(Input::Look { from });
    navigation
}

#[test]
fn a_box_between_samples_is_framed_itself_and_one_beside_them_is_not() {
    let mut navigation = navigation(NavigationStyle::default(), Preset::Top);
    let whole = navigation.camera;
    let look = Input::Look { from: Preset::Top };
    for (clip, is_framed) in [
        ("box:500010,5000010,102,500012,5000012,104", true),
        ("box:500050,5000050,102,500052,5000052,104", false),
        ("outside:499999,4999999,99,500052,5000052,114", false),
    ] {
        navigation.clips = Clips(vec![clip.parse().unwrap()]);
        navigation.handle(look);
        assert_eq!(navigation.camera != whole, is_framed, "{clip}");
    }
    navigation.clips = Clips(vec!["box:500010,5000010,102,500012,5000012,104".parse().unwrap()]);
    navigation.handle(look);
    // All corners are in the picture, and reach over half of it.
    let corners = navigation.clips.corners((ORIGIN, ORIGIN + DVec3::splat(50.0)));
    assert_eq!(corners.len(), 8);
    let places = corners.iter().map(|&p| seen(&navigation.camera, p).0);
    let [x, y] = [0, 1].map(|axis| places.clone().map(move |at| at[axis]));
    assert!(y.clone().all(|y| (0.0..=600.0).contains(&y)) && x.clone().all(|x| x > 0.0));
    assert!(y.clone().fold(0.0, f64::max) - y.fold(600.0, f64::min) > 300.0);
}

/// Returns where a point is on the screen [px], and its depth.
fn seen(camera: &Camera, point: DVec3) -> (DVec2, f64) {
    let view = View::new(*camera, SIZE).unwrap();
    let d = point - camera.eye;
    let depth = d.dot(view.basis.forward);
    let scale = match camera.projection {
        Projection::Perspective => view.focal_px() / depth,
        Projection::Orthographic => view.focal_px(),
    };
    let middle = DVec2::new(SIZE[0] as f64, SIZE[1] as f64) / 2.0;
    (middle + DVec2::new(d.dot(view.basis.right), -d.dot(view.basis.up)) * scale, depth)
}

fn press(button: Button, at: DVec2, under: Option<DVec3>) -> Input {
    Input::Press { button, modifiers: Modifiers::default(), at, under }
}

fn drag(navigation: &mut Navigation, button: Button, point: DVec3, to: DVec2) {
    let (at, _) = seen(&navigation.camera, point);
    navigation.handle(press(button, at, Some(point)));
    for step in 1..=10 {
        navigation.handle(Input::Move { to: at.lerp(to, step as f64 / 10.0) });
    }
    navigation.handle(Input::Release { button });
}

#[test]
fn wheel_zooms_towards_the_point_and_never_through() {
    for from in [Preset::Fit, Preset::Top] {
        let mut navigation = navigation(NavigationStyle::default(), from);
        let point = ORIGIN + DVec3::new(11.0, 7.0, 4.0);
        let (at, _) = seen(&navigation.camera, point);
        for notch in 0..300 {
            let before = seen(&navigation.camera, point).1;
            navigation.handle(Input::Wheel { notches: 1.0, at, under: Some(point) });
            let (now, depth) = seen(&navigation.camera, point);
            assert!(
                depth > 0.0 && depth <= before * (1.0 + 1e-9),
                "{from:?} notch {notch}: {before} to {depth}"
            );
            // A metre at the origin's distance is known to a nanometre.
            let slack = 1e-8 * View::new(navigation.camera, SIZE).unwrap().focal_px()
                / depth.min(1.0)
                + 1e-6;
            assert!(
                now.distance(at) < slack.max(1e-3),
                "{from:?} notch {notch}: {now} is not {at}"
            );
        }
        for _ in 0..600 {
            navigation.handle(Input::Wheel { notches: -1.0, at, under: None });
        }
        View::new(navigation.camera, SIZE).expect("as far as it goes there is a view");
    }
}

#[test]
fn drag_keeps_the_point_under_the_cursor() {
    for (style, button) in
        [(NavigationStyle::Potree, Button::Right), (NavigationStyle::Cloudcompare, Button::Middle)]
    {
        for from in [Preset::Fit, Preset::Front] {
            let mut navigation = navigation(style, from);
            let (point, to) = (ORIGIN + DVec3::new(30.0, 5.0, 2.0), DVec2::new(123.0, 456.0));
            let before = seen(&navigation.camera, point).1;
            drag(&mut navigation, button, point, to);
            let (now, depth) = seen(&navigation.camera, point);
            assert!(now.distance(to) < 1e-6, "{from:?}: {now}");
            assert!(from == Preset::Front || (depth - before).abs() < 1e-6);
        }
    }
}

#[test]
fn orbiting_turns_about_the_point_without_rolling_and_not_over_the_top() {
    let mut navigation = navigation(NavigationStyle::default(), Preset::Fit);
    let point = ORIGIN + DVec3::new(20.0, 15.0, 5.0);
    let before = seen(&navigation.camera, point);
    for to in [[700.0, 300.0], [100.0, 5000.0], [400.0, -9000.0], [-3000.0, 10.0]] {
        drag(&mut navigation, Button::Left, point, DVec2::from(to));
        let after = seen(&navigation.camera, point);
        assert!(
            after.0.distance(before.0) < 1e-5 && (after.1 - before.1).abs() < 1e-6,
            "{after:?}, not {before:?}"
        );
        let basis = navigation.camera.basis().unwrap();
        assert!(basis.right.z.abs() < 1e-9, "rolled: {basis:?}");
        assert!(basis.up.z > -1e-9, "upside down: {basis:?}");
    }
}

#[test]
fn grab_keeps_the_height_and_grazing_views_move() {
    let mut navigation = navigation(NavigationStyle::default(), Preset::Fit);
    navigation.mode = Mode::Earth;
    let (point, height) = (ORIGIN + DVec3::new(12.0, 9.0, 0.0), navigation.camera.eye.z);
    drag(&mut navigation, Button::Left, point, DVec2::new(420.0, 380.0));
    assert!(seen(&navigation.camera, point).0.distance(DVec2::new(420.0, 380.0)) < 1e-5);
    assert!((navigation.camera.eye.z - height).abs() < 1e-6);
    // Towards the horizon nothing runs away.
    drag(&mut navigation, Button::Left, point, DVec2::new(420.0, -2000.0));
    assert!((navigation.camera.eye - ORIGIN).length() < 1e4, "{}", navigation.camera.eye);
}

#[test]
fn flight_crosses_the_diagonal_in_five_seconds_and_the_wheel_changes_speed() {
    let mut navigation = navigation(NavigationStyle::default(), Preset::Fit);
    navigation.mode = Mode::Fly;
    let (start, ahead) = (navigation.camera.eye, navigation.camera.basis().unwrap().forward);
    navigation.handle(Input::Fly { direction: Direction::Forward, pressed: true });
    assert!(navigation.is_flying());
    (0..500).for_each(|_| navigation.advance(0.01));
    let diagonal = DVec3::new(40.0, 30.0, 10.0).length();
    assert!((navigation.camera.eye - start - ahead * diagonal).length() < 1e-6);
    let speed = navigation.speed;
    navigation.handle(Input::Wheel { notches: 1.0, at: DVec2::ZERO, under: None });
    assert!(navigation.speed > speed);
    navigation.handle(Input::Fly { direction: Direction::Forward, pressed: false });
    assert!(!navigation.is_flying());
}

#[test]
fn double_click_centres_and_projections_keep_sizes() {
    let mut navigation = navigation(NavigationStyle::default(), Preset::Fit);
    let point = ORIGIN + DVec3::new(3.0, 28.0, 9.0);
    navigation.handle(Input::Centre { on: point });
    let (at, depth) = seen(&navigation.camera, point);
    assert!(at.distance(DVec2::new(400.0, 300.0)) < 1e-6 && depth > 0.0);
    let target = navigation.camera.target;
    let aside = |navigation: &Navigation| {
        let up = navigation.camera.basis().unwrap().up;
        seen(&navigation.camera, target + up).0.distance(seen(&navigation.camera, target).0)
    };
    let before = aside(&navigation);
    navigation.handle(Input::OtherProjection);
    assert_eq!(navigation.camera.projection, Projection::Orthographic);
    assert!((aside(&navigation) / before - 1.0).abs() < 1e-9);
    navigation.handle(Input::OtherProjection);
    assert!((aside(&navigation) / before - 1.0).abs() < 1e-9);
}

#[test]
fn blender_style_uses_the_middle_button() {
    let mut navigation = navigation(NavigationStyle::Blender, Preset::Fit);
    let (point, before) = (ORIGIN + DVec3::splat(5.0), navigation.camera.eye);
    drag(&mut navigation, Button::Left, point, DVec2::new(10.0, 10.0));
    assert_eq!(navigation.camera.eye, before);
    let (at, _) = seen(&navigation.camera, point);
    let modifiers = Modifiers { shift: true, control: false };
    navigation.handle(Input::Press { button: Button::Middle, modifiers, at, under: Some(point) });
    navigation.handle(Input::Move { to: at + 50.0 });
    assert!(seen(&navigation.camera, point).0.distance(at + 50.0) < 1e-6);
}

proptest! {
    /// After any input the view is valid, and an orthographic camera has the whole subject in
    /// front.
    #[test]
    fn no_input_breaks_the_camera(inputs in prop::collection::vec((0u8..12, -900.0..900.0f64, -900.0..900.0f64, 0.0..40.0f64), 1..200)) {
        let mut navigation = navigation(NavigationStyle::default(), Preset::Fit);
        for (kind, x, y, z) in inputs {
            let (at, under) = (DVec2::new(x, y), (kind % 2 == 0).then(|| ORIGIN + DVec3::new(z, x.abs() / 30.0, y.abs() / 90.0)));
            match kind {
                0 | 1 => navigation.handle(press(Button::Left, at, under)),
                2 | 3 => navigation.handle(press(Button::Right, at, under)),
                4 | 5 => navigation.handle(Input::Move { to: at }),
                6 | 7 => navigation.handle(Input::Wheel { notches: x / 50.0, at, under }),
                8 => navigation.handle(Input::OtherProjection),
                9 => navigation.handle(Input::NextMode),
                10 => navigation.handle(Input::Look { from: Preset::Top }),
                _ => {
                    navigation.handle(Input::Fly { direction: Direction::Forward, pressed: true });
                    navigation.advance(0.1);
                    navigation.release_all();
                }
            }
            prop_assert!(View::new(navigation.camera, SIZE).is_ok(), "{:?}", navigation.camera);
            if navigation.camera.projection == Projection::Orthographic {
                for i in 0..8 {
                    let corner = ORIGIN + DVec3::new((i & 1) as f64 * 40.0, (i >> 1 & 1) as f64 * 30.0, (i >> 2) as f64 * 10.0);
                    prop_assert!(seen(&navigation.camera, corner).1 > 0.0);
                }
            }
        }
    }
}

/// From near by the cursor is over a gap of the wall, through which the street behind is visible.
#[test]
fn wheel_does_not_pass_through_gaps_of_a_surface() {
    let mut navigation = navigation(NavigationStyle::default(), Preset::Fit);
    let (wall, behind) = (ORIGIN + DVec3::new(11.0, 7.0, 4.0), 25.0);
    let (at, far) = seen(&navigation.camera, wall);
    let way = (wall - navigation.camera.eye).normalize();
    for notch in 0..60 {
        let trembling = DVec2::new((notch % 3) as f64, 0.0);
        let under = [Some(wall), Some(wall + way * behind), None][notch.min(notch % 7 % 3)];
        navigation.handle(Input::Wheel { notches: 1.0, at: at + trembling, under });
        assert!(seen(&navigation.camera, wall).1 > 0.0, "notch {notch}: behind the wall");
    }
    assert!(seen(&navigation.camera, wall).1 < 1e-3 * far);
    // A nearer point takes its place, and so does a point under a cursor that has moved.
    navigation = self::navigation(NavigationStyle::default(), Preset::Fit);
    navigation.handle(Input::Wheel { notches: 1.0, at, under: Some(wall) });
    let (near, aside) = (navigation.camera.eye + way, at + DVec2::new(100.0, 0.0));
    let depth = seen(&navigation.camera, near).1;
    navigation.handle(Input::Wheel { notches: 1.0, at, under: Some(near) });
    assert!((seen(&navigation.camera, near).1 / depth - 0.8).abs() < 1e-6);
    let other = navigation.camera.eye + way * 30.0;
    let depth = seen(&navigation.camera, other).1;
    navigation.handle(Input::Wheel { notches: 1.0, at: aside, under: Some(other) });
    assert!((seen(&navigation.camera, other).1 / depth - 0.8).abs() < 1e-6);
}
