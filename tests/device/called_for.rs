//! Only what a scene calls for: over all clouds of `../shared/data`, `auto` runs no effect whose
//! removal changes no pixel, and skips none that the picture needs.
//!
//! Visibility, filling, smoothing and anti-aliasing are also decided by the device, which lists the
//! tiles that they work on: with an empty list they do not run.
//!
//! Effects that change how a picture looks, such as Phong lighting, are never missing: `auto`
//! leaves them to the user. So is averaging luminance where no two stations have to be made equal,
//! and what smooths or splats surfaces that need neither.
//!
//! Pictures in which no point lies are passed over: that too only the device finds out.

use crate::files::names;
use crate::gpu::{WAYS, with};
use crate::shared::shared;
use pointillist::cloud::attribute::DisplayAttribute;
use pointillist::cloud::{self, ColumnSet, ReadOptions};
use pointillist::graph::{Gpu, Graph};
use pointillist::passes::tile_stats::{Asked, Counts};
use pointillist::passes::{Effect, EffectDecisions, encode};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::Resident;
use pointillist::view::{Camera, Preset, View};

const SIZE: [u32; 2] = [160, 120];
/// Larger clouds are drawn from one place.
const MANY: u64 = 1_000_000;
/// Share of pixels that a skipped effect may change by more than its error.
const FEW: f64 = 1e-3;

/// Effects that the picture needs or does not, with the error of skipping one `[codes of 255]`:
/// stations are taken for even up to 0.05 stops.
const NEEDED: [(Effect, u8); 4] =
    [(Effect::Exposure, 4), (Effect::Scattered, 0), (Effect::Visibility, 0), (Effect::Fill, 0)];

/// Effects that run for nothing where only the pixels tell: visibility looks for hidden points and
/// finds none; the nodes in view have scattered points, but all of them lie behind others or aside.
const ONLY_PIXELS_TELL: [&str; 7] = [
    "tiny_spherical.e57, near: visibility",
    "tiny_spherical.e57, near: shape",
    "las1.4_pf6.las, whole: visibility",
    "armadillo.obj, near: scattered",
    "armadillo.obj, near: splat",
    "stanford_dragon_437k.ply, near: scattered",
    "stanford_dragon_437k.ply, near: splat",
];

struct Drawn {
    /// Red, green and blue of each pixel.
    rgb: Vec<u8>,
    /// True if no point lies in it.
    is_empty: bool,
    decisions: EffectDecisions,
    counts: Counts,
}

impl Drawn {
    /// Tests whether an effect had anything to do.
    fn runs(&self, effect: Effect) -> bool {
        let has_work = match effect {
            Effect::Visibility => !self.counts.looked_at.is_empty(),
            Effect::Fill => self.counts.holes > 0,
            Effect::Smooth => self.counts.smoothed != Some(0),
            Effect::Antialias => self.counts.silhouettes != Some(0),
            _ => true,
        };
        self.decisions.runs(effect) && has_work
    }

    /// Returns the share of pixels that differ by more than this.
    fn changed(&self, other: &Drawn, codes: u8) -> f64 {
        let differs =
            |(a, b): &(&[u8], &[u8])| (0..3).any(|channel| a[channel].abs_diff(b[channel]) > codes);
        let pixels = self.rgb.chunks(3).zip(other.rgb.chunks(3));
        pixels.filter(differs).count() as f64 / (self.rgb.len() / 3) as f64
    }
}

/// Draws with one more setting; `None` if it cannot be drawn.
fn draw(gpu: &mut Gpu, view: &View, resident: &Resident, setting: &str) -> Option<Drawn> {
    let mut settings = RenderSettings::default();
    settings.effects.set_any(setting).unwrap();
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config).ok()?;
    let asked = Asked::of(&mut g, &outcome.gbuffer);
    let picture = encode::download(&mut g, &outcome.picture).unwrap();
    let depth = g.download(&outcome.gbuffer.depth);
    let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");
    let counts = asked.counts(&frame, view.size, &config.effects);
    Some(Drawn {
        rgb: picture.read(&frame).concat(),
        is_empty: frame.read::<f32>(&depth).iter().all(|depth| !depth.is_finite()),
        decisions: config.decisions,
        counts,
    })
}

#[test]
fn auto_runs_what_changes_a_picture_and_skips_what_does_not() {
    let Some(data) = shared("data") else { return };
    let (mut pictures, mut wrong) = (0, Vec::new());
    for folder in names(&data) {
        let folder = data.join(folder);
        for name in if folder.is_dir() { names(&folder) } else { Vec::new() } {
            let path = folder.join(&name);
            let read = ReadOptions::new(ColumnSet::ALL, false);
            let Ok(cloud) = cloud::read(&[path], &read, &Silent) else { continue };
            let whole = Camera::framing(Preset::Fit, &cloud.core_points(), SIZE);
            let near = Camera { eye: whole.target.lerp(whole.eye, 0.25), ..whole };
            let cameras = if cloud.len() > MANY { vec![whole] } else { vec![whole, near] };
            with(WAYS[0], |gpu| {
                let (shown, _) = DisplayAttribute::automatic(&cloud);
                let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
                for (camera, place) in cameras.into_iter().zip(["whole", "near"]) {
                    let view = View::new(camera, SIZE).unwrap();
                    let own = draw(gpu, &view, &resident, "edl=auto").unwrap();
                    if own.is_empty {
                        println!("nothing to see: {name}, {place}");
                        continue;
                    }
                    pictures += 1;
                    for (effect, reason) in &own.decisions.0 {
                        let at = format!("{name}, {place}: {}", effect.name());
                        let needed = NEEDED.iter().find(|(needed, _)| needed == effect);
                        if own.runs(*effect) {
                            let off = format!("{}=off", effect.name());
                            let without = draw(gpu, &view, &resident, &off).unwrap();
                            if own.changed(&without, 0) == 0.0
                                && !ONLY_PIXELS_TELL.contains(&at.as_str())
                            {
                                wrong
                                    .push(format!("{at} runs for nothing, because {}", reason.why));
                            }
                        } else if let (false, Some((_, codes))) = (reason.runs, needed) {
                            let on = format!("{}=on", effect.name());
                            let Some(with) = draw(gpu, &view, &resident, &on) else { continue };
                            let share = own.changed(&with, *codes);
                            if share > FEW {
                                wrong.push(format!("{at} is missing in {share} of the pixels"));
                            }
                        }
                    }
                }
            });
        }
    }
    println!("{pictures} pictures");
    assert!(pictures >= 50, "{pictures}");
    assert!(wrong.is_empty(), "{} of {pictures} pictures:\n{}", wrong.len(), wrong.join("\n"));
}
