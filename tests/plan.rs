//! The plan of the default frame, and of the frame without each effect, as text: passes, barriers, memory.
//!
//! A plan that changed on purpose: `POINTILLIST_UPDATE=1 cargo test --release --test plan`, and read the difference before committing it.

use pointillist::cloud::attribute::{Attribute, Shown};
use pointillist::graph::{Gpu, Graph, Handle};
use pointillist::look::{self, Wishes};
use pointillist::passes::EFFECTS;
use pointillist::progress::Silent;
use pointillist::resident::Resident;
use pointillist::view::{Camera, Preset, View};
use pointillist::{frame, gpu::Wish, synth};
use std::path::Path;

fn plan_with(effects: &[&str]) -> String {
    let mut gpu =
        Gpu::open(&Wish { validate: true, ..Wish::default() }).expect("a Vulkan device; tools/test installs one that needs no GPU");
    let world = synth::build(synth::Scene::Plane, 1, 0.0);
    let cloud = synth::collect("plane", &world, 1000, 1, 0.0, &Silent).unwrap();
    let view = View::new(Camera::framing(Preset::Fit, &cloud.core_points(), [64, 64]), [64, 64]).unwrap();
    let shown = Shown::new(Attribute::White, &cloud);
    let mut wishes = Wishes::default();
    effects.iter().for_each(|effect| wishes.effects.set(effect).unwrap());
    let resident = Resident::fill(&mut gpu, cloud, shown, &Silent).unwrap();
    let look = look::decide(&wishes, &view, &resident);
    let mut g = Graph::new(&mut gpu);
    let outcome = frame::record(&mut g, &view, &resident, &look).unwrap();
    let text = g.plan(&[outcome.picture.resource()]).to_string();
    drop(g);
    resident.free(&mut gpu);
    text
}

fn compare(name: &str, found: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/plan").join(format!("{name}.txt"));
    if std::env::var_os("POINTILLIST_UPDATE").is_some() {
        std::fs::write(&path, found).unwrap();
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(found, expected, "the plan `{name}` has changed; if on purpose, run with POINTILLIST_UPDATE=1");
}

/// Which projection runs depends on the device: the text is of one with 64-bit atomics, as lavapipe is.
#[test]
fn the_default_frame() {
    compare("default", &plan_with(&[]));
}

#[test]
fn shadows_alone() {
    let off = EFFECTS.iter().filter(|effect| **effect != "shadows").map(|effect| format!("{effect}=off"));
    let effects: Vec<String> = off.chain(["shadows=on,samples=2,size=64".to_string()]).collect();
    compare("shadows", &plan_with(&effects.iter().map(String::as_str).collect::<Vec<_>>()));
}

#[test]
fn nothing_that_is_off_leaves_a_trace() {
    let off: Vec<String> = EFFECTS.iter().map(|effect| format!("{effect}=off")).collect();
    compare("points", &plan_with(&off.iter().map(String::as_str).collect::<Vec<_>>()));
}
