//! The plan of the default frame and of frames without effects, as text: passes, barriers, memory.
//!
//! An intended change is accepted with `POINTILLIST_UPDATE=1 cargo nextest run --release plan::`.
//! Read the difference before committing it.

use crate::skip::skip;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::error::{Error, Result};
use pointillist::gpu::DeviceOptions;
use pointillist::graph::{Gpu, Graph, Handle};
use pointillist::passes::EFFECTS;
use pointillist::progress::{Progress, Silent};
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::Resident;
use pointillist::synth;
use pointillist::view::{Camera, Preset, View};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Draws a thousand points of a plane on 64 x 64 pixels.
fn on_a_plane<T>(
    effects: &[&str],
    draw: impl FnOnce(&mut Gpu, &View, &Resident, &FrameConfig) -> T,
) -> T {
    let mut gpu = Gpu::open(&DeviceOptions { validate: true, ..DeviceOptions::default() })
        .expect("a Vulkan device; tools/test installs one that needs no GPU");
    let world = synth::build(synth::SceneKind::Plane, 1, 0.0);
    let cloud = synth::collect("plane", &world, 1000, 1, 0.0, &Silent).unwrap();
    let view =
        View::new(Camera::framing(Preset::Fit, &cloud.core_points(), [64, 64]), [64, 64]).unwrap();
    let mut shown = DisplayAttribute::new(Attribute::Rgb, &cloud);
    shown.further.strokes = effects.iter().any(|effect| effect.starts_with("strokes=on"));
    let mut settings = RenderSettings::default();
    effects.iter().for_each(|effect| settings.effects.set_any(effect).unwrap());
    let resident = Resident::fill(&mut gpu, cloud, shown, &Silent).unwrap();

    draw(&mut gpu, &view, &resident, &FrameConfig::new(&settings, &view, &resident))
}

/// Returns the plan, and whether the device is a software device.
fn plan_with(effects: &[&str]) -> (String, bool) {
    on_a_plane(effects, |gpu, view, resident, config| {
        let is_software = gpu.device.is_cpu;
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, resident, config).unwrap();
        (g.plan(&[outcome.picture.resource()]).to_string(), is_software)
    })
}

/// Compares a plan with the kept one. Sizes in memory, and barriers where memory is shared, are
/// those of a software device; others align images in their own ways.
fn compare(name: &str, (found, is_software): (String, bool)) {
    let passes = |plan: &str| -> String {
        let is_pass = |line: &&str| {
            is_software
                || !["memory", "total", "-- barrier"]
                    .iter()
                    .any(|word| line.trim().starts_with(word))
        };
        plan.lines().filter(is_pass).map(|line| format!("{line}\n")).collect()
    };
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/device/plan").join(format!("{name}.txt"));
    if std::env::var_os("POINTILLIST_UPDATE").is_some() {
        std::fs::write(&path, &found).unwrap();
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        passes(&found),
        passes(&expected),
        "the plan `{name}` has changed; if on purpose, run with POINTILLIST_UPDATE=1"
    );
}

/// The projection depends on the device. The text is that of a device with 64-bit atomics, such as
/// lavapipe.
#[test]
fn the_default_frame() {
    compare("default", plan_with(&[]));
}

#[test]
fn shadows_alone() {
    let off =
        EFFECTS.iter().filter(|effect| **effect != "shadows").map(|effect| format!("{effect}=off"));
    let effects: Vec<String> = off.chain(["shadows=on,samples=2,size=64".to_string()]).collect();
    compare("shadows", plan_with(&effects.iter().map(String::as_str).collect::<Vec<_>>()));
}

#[test]
fn luminance_alone() {
    let off = EFFECTS
        .iter()
        .filter(|effect| **effect != "luminance")
        .map(|effect| format!("{effect}=off"));
    let effects: Vec<String> = off.chain(["luminance=on".to_string()]).collect();
    compare("luminance", plan_with(&effects.iter().map(String::as_str).collect::<Vec<_>>()));
}

#[test]
fn strokes_alone() {
    let off =
        EFFECTS.iter().filter(|effect| **effect != "strokes").map(|effect| format!("{effect}=off"));
    let effects: Vec<String> = off.chain(["strokes=on".to_string()]).collect();
    compare("strokes", plan_with(&effects.iter().map(String::as_str).collect::<Vec<_>>()));
}

#[test]
fn nothing_that_is_off_leaves_a_trace() {
    let off: Vec<String> = EFFECTS.iter().map(|effect| format!("{effect}=off")).collect();
    compare("points", plan_with(&off.iter().map(String::as_str).collect::<Vec<_>>()));
}

/// A progress that cancels after this many checks.
struct Patience(AtomicU32);

impl Progress for Patience {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        self.0
            .fetch_update(Relaxed, Relaxed, |left| left.checked_sub(1))
            .map(drop)
            .map_err(|_| Error::Interrupted)
    }
}

#[test]
fn a_frame_that_was_stopped_is_drawn_whole_the_next_time() {
    on_a_plane(&[], |gpu, view, resident, config| {
        if !gpu.device.is_cpu {
            return skip("only software devices are cancelled between passes");
        }
        let picture = |gpu: &mut Gpu, progress: Option<&dyn Progress>| {
            let mut g = Graph::new(gpu);
            if let Some(progress) = progress {
                g = g.with_progress(progress);
            }
            let outcome = frame::record(&mut g, view, resident, config)?;
            let picture = g.download(&outcome.picture);
            let frame = g.submit_and_wait(&[])?;
            let pixels = frame.read::<u8>(&picture).to_vec();
            Ok::<_, Error>(pixels)
        };
        let whole = picture(gpu, None).unwrap();
        for times in 0..5 {
            let stopped = picture(gpu, Some(&Patience(AtomicU32::new(times))));
            assert!(matches!(stopped, Err(Error::Interrupted)), "after {times}");
        }
        assert!(picture(gpu, Some(&Silent)).unwrap() == whole);
    });
}
