//! How soon the panel answers keys and clicks while ten million points are drawn.

use crate::display::place::Place;
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConnectionExt, ImageFormat};
use x11rb::rust_connection::RustConnection;

const SIZE: [u32; 2] = [1280, 800];
const POINTS: u64 = 10_000_000;
/// Longest time from a key or a click to its answer on the screen.
const TARGET: Duration = Duration::from_millis(100);
/// Behind what is chosen in the panel, and behind all of it.
const CHOSEN: [u8; 3] = [0, 84, 120];
const FILL: [u8; 3] = [27; 3];
/// Rows of the panel, above their text: tabs, and styles.
const TABS: i16 = 76;
const STYLES: i16 = 103;
/// A place within the list of keys.
const KEYS: [i16; 2] = [350, 40];

/// Reads single pixels, much faster than a photograph.
struct Eye {
    display: RustConnection,
    root: u32,
}

impl Eye {
    fn open(place: &Place) -> Eye {
        let (display, screen) = x11rb::connect(Some(&place.display.name)).expect("the display");
        let root = display.setup().roots[screen].root;
        Eye { display, root }
    }

    fn pixel(&self, [x, y]: [i16; 2]) -> [u8; 3] {
        let all = !0;
        let asked = self.display.get_image(ImageFormat::Z_PIXMAP, self.root, x, y, 1, 1, all);
        let data = asked.unwrap().reply().unwrap().data;
        [data[2], data[1], data[0]]
    }

    /// Returns the time until a pixel has a colour.
    #[track_caller]
    fn until(&self, what: &str, at: [i16; 2], holds: &dyn Fn([u8; 3]) -> bool) -> Duration {
        let began = Instant::now();
        while !holds(self.pixel(at)) {
            let waited = began.elapsed();
            assert!(waited < Duration::from_secs(60), "{what}: {:?} at {at:?}", self.pixel(at));
            std::thread::sleep(Duration::from_millis(1));
        }
        began.elapsed()
    }
}

/// One action: a name, what xdotool does, and where that shows.
struct Action<'a> {
    name: &'a str,
    does: &'a str,
    at: [i16; 2],
    shows: &'a dyn Fn([u8; 3]) -> bool,
}

/// Repeats actions in turn, each after the pause, and returns the times to their answers.
fn measured(
    place: &Place,
    eye: &Eye,
    actions: &[Action],
    rounds: usize,
    pause: Duration,
) -> Vec<(String, Vec<f64>)> {
    let mut times: Vec<(String, Vec<f64>)> =
        actions.iter().map(|action| (action.name.to_string(), Vec::new())).collect();
    for _ in 0..rounds {
        for (Action { name, does, at, shows }, (_, times)) in actions.iter().zip(&mut times) {
            std::thread::sleep(pause);
            let began = Instant::now();
            place.display.xdotool(does);
            eye.until(name, *at, shows);
            times.push(began.elapsed().as_secs_f64() * 1e3);
        }
    }
    times
}

/// Clicks on tabs and styles, and keys, at rest and while the picture is drawn anew.
#[test]
fn panel_answers_within_a_tenth_of_a_second_while_ten_million_points_are_drawn() {
    let place = Place::new();
    let cloud = place.street(POINTS);
    let mut viewer = place.view_with_panel(&[&cloud], SIZE, "");
    let eye = Eye::open(&place);
    eye.until("panel", [2, 2], &|pixel| pixel == FILL);
    viewer.until("picture at rest", |viewer| {
        let before = viewer.ticks();
        std::thread::sleep(Duration::from_secs(2));
        viewer.ticks() - before <= 2
    });
    let chosen = |pixel: [u8; 3]| pixel == CHOSEN;
    let is_fill = |pixel: [u8; 3]| pixel == FILL;
    let no_fill = |pixel: [u8; 3]| pixel != FILL;
    let tab = |x: i16| [x, TABS];
    let click = |[x, y]: [i16; 2]| format!("mousemove {} {} click 1", x + 20, y + 4);
    let [look, measure, layers] = [12, 101, 190].map(tab);
    // The style that is chosen, and the next.
    let is_chosen = |x: &i16| eye.pixel([*x, STYLES]) == CHOSEN;
    let first = (0..276).find(is_chosen).expect("a style");
    let end = (first..276).find(|x| !is_chosen(x)).expect("another style");
    let [own, next] = [first + 3, end + 9].map(|x| [x, STYLES]);
    let words = [look, measure, layers, own, next].map(click);
    let panel = [
        Action { name: "tab Layers", does: &words[2], at: layers, shows: &chosen },
        Action { name: "tab Measure", does: &words[1], at: measure, shows: &chosen },
        Action { name: "tab Look", does: &words[0], at: look, shows: &chosen },
        Action { name: "key H, shown", does: "key h", at: KEYS, shows: &is_fill },
        Action { name: "key H, closed", does: "key h", at: KEYS, shows: &no_fill },
        Action { name: "key N, hidden", does: "key n", at: [2, 2], shows: &no_fill },
        Action { name: "key N, shown", does: "key n", at: [2, 2], shows: &is_fill },
    ];
    let scene = [
        Action { name: "next style", does: &words[4], at: next, shows: &chosen },
        Action { name: "style before", does: &words[3], at: own, shows: &chosen },
    ];
    let mut all = Vec::new();
    for (when, actions, pause) in [
        ("at rest", &panel[..], 300),
        ("scene, at rest", &scene[..], 3000),
        ("scene, while drawing", &scene[..], 150),
    ] {
        let pause = Duration::from_millis(pause);
        let rows = measured(&place, &eye, actions, 5, pause);
        all.extend(rows.into_iter().map(|(name, times)| (format!("{name}, {when}"), times)));
    }
    // A view is chosen, and the panel used while it is drawn.
    for action in &panel[..3] {
        place.display.xdotool("key 7");
        let rows = measured(&place, &eye, std::slice::from_ref(action), 1, Duration::ZERO);
        place.display.xdotool("key 0");
        all.extend(rows.into_iter().map(|(name, times)| (format!("{name}, after a key"), times)));
    }
    let mut slow = Vec::new();
    for (name, mut times) in all {
        times.sort_by(f64::total_cmp);
        let (median, worst) = (times[times.len() / 2], times[times.len() - 1]);
        println!("{name:<40} median {median:>6.1} ms, worst {worst:>6.1} ms");
        if median > TARGET.as_secs_f64() * 1e3 {
            slow.push(format!("{name}: {median:.1} ms"));
        }
    }
    assert!(slow.is_empty(), "over {TARGET:?}: {}", slow.join(", "));
    viewer.leave();
    viewer.ended();
}
