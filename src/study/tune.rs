//! Study `tune`: whether a front keeps its promises on scenes that it was not measured on.
//!
//! A front is measured as `pointillist tune` does. Then other scenes are drawn for times of 0.3 to
//! 3 times that of the default, and for several errors. `missed` is the share of pictures that took
//! longer than asked for, in parts of the default drawn beside them: by the first choice, and by
//! the settled one, which pictures of the view have corrected (`tune::front`). `ratio` is the error
//! of the settled choice divided by that of the best tuning at that time, of an exhaustive sweep
//! over a grid of tunings together with the front; errors below 0.01 px count as that. `broken` is
//! the share of views where the error asked for is exceeded.

use super::report::{Section, Table};
use super::scan::Scan;
use super::tuner::{self, Effort, Subject, Tuner};
use super::{Plan, Row, lod, mark_fronts, metrics, rows};
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;
use crate::render::settings::RenderSettings;
use crate::select::lod::LodOptions;
use crate::synth::SceneKind;
use crate::tune::{KNOBS, Limit, Load, Tuning};
use crate::view::{Camera, View};
use glam::DMat3;

pub const SUMMARY: &str =
    "times and errors that were asked for, on scenes that a front was not measured on";

/// Times, in parts of the default's.
const TIMES: [(&str, f64); 7] = [
    ("0.3", 0.3),
    ("0.45", 0.45),
    ("0.6", 0.6),
    ("0.8", 0.8),
    ("1", 1.0),
    ("1.7", 1.7),
    ("3", 3.0),
];
/// Errors `[px]`.
const ERRORS: [(&str, f64); 5] =
    [("0.1 px", 0.1), ("0.2 px", 0.2), ("0.4 px", 0.4), ("0.8 px", 0.8), ("1.5 px", 1.5)];

/// Values of the grid, by knob: the others have their defaults.
const GRID: [(&str, &[usize]); 5] = [
    ("lod", &[0, 2, 4]),
    ("visibility", &[0, 2, 5, 6, 7]),
    ("fill", &[0, 3]),
    ("scattered", &[0, 1]),
    ("shape", &[0, 3, 7]),
];

/// Added to the seed of the measured scenes.
const OTHER_SEED: u64 = 100;
/// Angle between a scene's own view and that of this study `[degrees]`.
const ASIDE: f64 = 50.0;

/// Scenes, and how far their cameras are, relative to the scene's own.
const SCENES: [(&str, SceneKind, f64); 4] = [
    ("street", SceneKind::Street, 1.5),
    ("street", SceneKind::Street, 6.0),
    ("terrain", SceneKind::Terrain, 2.0),
    ("nested tori", SceneKind::NestedTori, 1.0),
];
const VIEWS: [&str; 4] = ["beside", "farther", "beside", "own"];

/// Smaller errors count as this in quotients `[px]`.
const LEAST_PX: f64 = 0.01;

/// Largest side of a picture `[px]`: a sweep draws a thousand of them.
const MOST_SIDE: u32 = 512;

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let plan = &Plan { size: plan.size.map(|side| side.min(MOST_SIDE)), ..plan.clone() };
    let rounds = plan.repeat.min(3);
    let effort = Effort {
        // Small studies stay short.
        singles: plan.repeat.min(Effort::FULL.singles),
        most: (6 * plan.repeat).min(Effort::FULL.most),
        rounds: plan.repeat.min(5),
        points: plan.points,
        size: plan.size,
        ..Effort::FULL
    };
    let settings = RenderSettings::default();
    let cut = LodOptions::default();
    let front = {
        let subjects = tuner::scenes(gpu, &effort, plan.seed, progress)?;
        let mut tuner = Tuner::new(gpu, subjects, settings.clone(), cut, progress)?;
        tuner.search(&effort, progress)?.at_rest()
    };
    let subjects = held_out(gpu, plan, progress)?;
    let mut tuner = Tuner::new(gpu, subjects, settings, cut, progress)?;
    let mut sweep = grid();
    sweep.extend(front.tuned.iter().filter_map(|tuned| tuned.tuning()));
    sweep.sort_by_key(Tuning::words);
    sweep.dedup();
    tuner.measure(&sweep, rounds, progress)?;
    let found = tuner.found.clone();
    let measured = |view: usize, tuning: &Tuning| {
        let found = found.iter().find(|found| found.tuning == *tuning).expect("in the sweep");
        &found.views[view]
    };
    // In parts of the default's time, since the device may be slower later.
    let part = |view: usize, tuning: &Tuning| {
        let of = |tuning: &Tuning| {
            let parts = &measured(view, tuning).parts;
            let sums = parts.iter().map(|parts| parts.iter().sum()).collect::<Vec<_>>();
            metrics::quartiles(&sums)[1]
        };
        of(tuning) / of(&Tuning::usual())
    };
    let mut all: Vec<Row> = Vec::new();
    let mut choices = Table {
        title: "What was chosen".into(),
        head: [
            "scene",
            "view",
            "asked",
            "chosen",
            "expected ms",
            "ms",
            "expected px",
            "px",
            "best px",
        ]
        .map(String::from)
        .to_vec(),
        rows: Vec::new(),
    };
    let mut pooled = TIMES.map(|(name, time)| Pooled { name, time, ..Pooled::default() });
    for view in 0..SCENES.len() {
        let load = |tuning: &Tuning| -> Load { measured(view, tuning).load };
        for Pooled { time, kept, ms, .. } in &mut pooled {
            let best = sweep
                .iter()
                .filter(|tuning| part(view, tuning) <= *time)
                .map(|tuning| measured(view, tuning).errors.px)
                .reduce(f64::min);
            // Nothing is as fast.
            let Some(best) = best else { continue };
            let usual: Vec<f64> =
                (0..3).map(|_| tuner.time_usual(view, progress)).collect::<Result<_>>()?;
            let most = *time * metrics::quartiles(&usual)[1];
            let limit = Limit::Time(most);
            let draw = |tuner: &mut Tuner, tuning: &Tuning| {
                let drawn = tuner.draw(view, tuning, false, progress)?;
                Ok((drawn.load, drawn.ms))
            };
            // The default is drawn beside each picture, since the device may be slower by then.
            let in_parts = |tuner: &mut Tuner, tuning: &Tuning| {
                let pair = |_| {
                    let usual = tuner.time_usual(view, progress)?;
                    Ok(draw(tuner, tuning)?.1.iter().sum::<f64>() / usual)
                };
                Ok(metrics::quartiles(&(0..3).map(pair).collect::<Result<Vec<f64>>>()?)[1])
            };
            let first = front.choose(limit, load, &Default::default()).expect("a front");
            let first_part = in_parts(&mut tuner, &first.tuning)?;
            let settled =
                front.settle(limit, load, |tuning| draw(&mut tuner, tuning))?.expect("a front");
            let got_part = in_parts(&mut tuner, &settled.tuning)?;
            let got = got_part * most / *time;
            let px = measured(view, &settled.tuning).errors.px;
            let ratio = (px.max(LEAST_PX) / best.max(LEAST_PX)).max(1.0);
            let missed = |part: f64| f64::from(u8::from(part > *time));
            [missed(first_part), missed(got_part), ratio]
                .into_iter()
                .zip(kept.iter_mut())
                .for_each(|(value, all)| all.push(value));
            ms.push(got);
            choices.rows.push(vec![
                SCENES[view].0.into(),
                VIEWS[view].into(),
                format!("{time} of the default, {most:.1} ms"),
                settled.tuning.to_string(),
                format!("{:.1}", settled.ms),
                format!("{got:.1}"),
                format!("{:.3}", settled.expected.px),
                format!("{px:.3}"),
                format!("{best:.3}"),
            ]);
        }
    }
    for Pooled { name, kept: [first, settled, ratio], ms, .. } in &pooled {
        let [median, most] = metrics::quantiles(ratio, [0.5, 1.0]);
        let share = |missed: &[f64]| metrics::mean(missed.iter().copied());
        all.extend(rows(
            ["all scenes", "held out"],
            ["time", name],
            ["missed_first", "missed", "ratio_median", "ratio_most"],
            &[share(first), share(settled), median, most],
            ms,
        ));
    }
    for (name, px) in ERRORS {
        let (mut broken, mut times, mut got) = (Vec::new(), Vec::new(), Vec::new());
        for view in 0..SCENES.len() {
            let load = |tuning: &Tuning| measured(view, tuning).load;
            let limit = Limit::Pixels(px);
            let choice = front.choose(limit, load, &Default::default()).expect("a front");
            let own = measured(view, &choice.tuning).errors.px;
            broken.push(f64::from(u8::from(own > px)));
            got.push(own);
            let ms = part(view, &choice.tuning) * tuner.time_usual(view, progress)?;
            times.push(ms);
            choices.rows.push(vec![
                SCENES[view].0.into(),
                VIEWS[view].into(),
                limit.to_string(),
                choice.tuning.to_string(),
                format!("{:.1}", choice.ms),
                format!("{ms:.1}"),
                format!("{:.3}", choice.most.px),
                format!("{own:.3}"),
                String::new(),
            ]);
        }
        all.extend(rows(
            ["all scenes", "held out"],
            ["error", name],
            ["broken", "error_most"],
            &[metrics::mean(broken.iter().copied()), got.iter().copied().fold(0.0, f64::max)],
            &times,
        ));
    }
    mark_fronts(&mut all);
    let method = format!(
        "A front of {} tunings was measured on {} (seed {}), and used on {} (seed {}), {} x {} pixels. A sweep of {} tunings, each the median of {rounds} rounds, tells the best. \
         Times are in parts of the default's, which is drawn with them. Errors are against the finest picture of the same view (kind <em>self</em>).",
        front.tuned.len(),
        front.scenes.join(", "),
        plan.seed,
        SCENES.map(|(name, ..)| name).join(", "),
        plan.seed + OTHER_SEED,
        plan.size[0],
        plan.size[1],
        sweep.len(),
    );
    let charts = vec![tuner::chart(&front)];
    let title = "Tuning: times and errors that were asked for".into();
    Ok(Section { name: "tune", title, method, rows: all, charts, tables: vec![choices] })
}

/// What a time that was asked for led to, in all views.
#[derive(Default)]
struct Pooled {
    name: &'static str,
    /// Time, in parts of the default's.
    time: f64,
    /// First choices that missed it, settled ones that did, both 0 or 1, and quotients of errors.
    kept: [Vec<f64>; 3],
    /// Times of the settled choices `[ms]`.
    ms: Vec<f64>,
}

fn grid() -> Vec<Tuning> {
    GRID.iter().fold(vec![Tuning::usual()], |grid, (name, values)| {
        let knob = KNOBS.iter().position(|knob| knob.name == *name).expect("a knob");
        let with = |tuning: Tuning| values.iter().map(move |value| tuning.with(knob, *value));
        grid.into_iter().flat_map(with).collect()
    })
}

/// Returns scenes of another seed in other views, one view a subject.
fn held_out(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Subject>> {
    let one = |(name, kind, times): (&str, SceneKind, f64)| {
        let seed = plan.seed + OTHER_SEED;
        let scan = Scan::new(kind, |world| world.step, plan.points, seed, progress)?;
        let [.., (_, own)] = lod::cameras(&scan.world);
        let turned = if times == 1.0 { 0.0 } else { ASIDE };
        let back = DMat3::from_rotation_z(turned.to_radians()) * (own.eye - own.target);
        let camera = Camera { eye: own.target + back * times, ..own };
        Ok(Subject {
            name: name.into(),
            cloud: tuner::of_scan(gpu, &scan, progress)?,
            views: vec![View::new(camera, plan.size)?],
        })
    };
    SCENES.into_iter().map(one).collect()
}
