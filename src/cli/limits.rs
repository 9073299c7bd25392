//! `--time` and `--error`: the tuning that a picture is drawn with, what is expected of it, and
//! what it takes.

use super::options::PictureOptions;
use super::tune;
use crate::error::{Error, Result};
use crate::index::format::Index;
use crate::passes::encode;
use crate::progress::Progress;
use crate::renderer::{CloudId, Renderer};
use crate::select::lod::{self, LodOptions};
use crate::tune::error::{Errors, Pixels};
use crate::tune::governor::divided;
use crate::tune::{Choice, Limit, Load, Tuning, split};
use crate::view::View;
use std::collections::HashSet;
use std::path::PathBuf;

/// Upper limit of a picture's time or error.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Accuracy against time")]
pub struct LimitOptions {
    /// Draw the most accurate picture in this time of the device
    ///
    /// By the front of `pointillist tune`; in the window, while it moves
    #[arg(long, value_name = "MILLISECONDS", value_parser = Limit::time, conflicts_with_all = ["error", "lod", "point_budget"])]
    pub time: Option<Limit>,
    /// Draw the fastest picture with this error against the finest
    ///
    /// The mean over its pixels
    #[arg(long, value_name = "0.5px|0.2%", conflicts_with_all = ["lod", "point_budget"])]
    pub error: Option<Limit>,
}

impl LimitOptions {
    pub fn limit(&self) -> Option<Limit> {
        self.time.or(self.error)
    }
}

/// The tuning of a picture.
pub struct Chosen {
    pub limit: Limit,
    pub choice: Choice,
    /// Where the front is from.
    origin: String,
    /// Limits of its cut.
    pub cut: LodOptions,
}

/// Time of a picture, and its errors against the finest one, if they were measured.
pub struct Got {
    pub ms: f64,
    pub errors: Option<Errors>,
}

/// A cloud on the device, with what it is drawn with.
pub struct Target<'t> {
    pub renderer: &'t mut Renderer,
    pub cloud: CloudId,
    pub view: &'t View,
    pub picture: &'t PictureOptions,
    pub progress: &'t dyn Progress,
}

/// Most pixels of a picture that tells what one in pieces takes.
const MOST_TRIED: f64 = 2e6;

impl Target<'_> {
    fn again(&mut self) -> Target<'_> {
        let Target { renderer, cloud, view, picture, progress } = self;
        Target { renderer, cloud: *cloud, view, picture, progress: *progress }
    }

    /// Gives the renderer the settings of a tuning. Returns the limits of its cut.
    fn set(&mut self, tuning: &Tuning) -> Result<LodOptions> {
        let (settings, cut) =
            tuning.applied(&self.picture.settings()?, self.picture.detail.lod(), self.view.size);
        self.renderer.set_settings(settings);
        Ok(cut)
    }

    /// Draws the picture with a tuning. Returns it, its load, and its times of points and pixels.
    fn draw(&mut self, tuning: &Tuning) -> Result<(Pixels, Load, [f64; 2])> {
        let cut = self.set(tuning)?;
        let Target { renderer, cloud, view, progress, .. } = self;
        renderer.load(*cloud, view, &cut.of(view.size), *progress)?;
        let config = renderer.config(*cloud, view)?;
        let done = renderer.draw(*cloud, view, &config, *progress, |g, outcome| {
            let depth = g.download(&outcome.gbuffer.depth);
            Ok((encode::download(g, &outcome.picture)?, depth, outcome.statistics.points_drawn))
        })?;
        let (picture, depth, points) = done.asked;
        let (size, depth) = (view.size, done.frame.read(&depth).to_vec());
        let pixels = Pixels { size, depth, rgb: picture.read(&done.frame).concat() };
        let load = Load { points, pixels: size[0] as u64 * size[1] as u64 };
        Ok((pixels, load, split(&done.frame.passes)))
    }

    /// Returns the errors of a tuning's picture, which is drawn again, as is the finest one.
    fn errors(&mut self, tuning: &Tuning) -> Result<Errors> {
        let (reference, ..) = self.draw(&Tuning::finest())?;
        let (own, ..) = self.draw(tuning)?;
        Ok(own.errors(&reference))
    }
}

impl Chosen {
    /// Chooses a tuning for the picture, and gives the renderer its settings. For a time, pictures
    /// are drawn until the choice settles.
    pub fn settle(
        limit: Limit,
        target: &mut Target,
        files: &[PathBuf],
        index: &Index,
    ) -> Result<Chosen> {
        Chosen::settle_all(limit, target, &[*target.view], files, index)
    }

    /// Chooses one tuning for all of some views, so that nothing flickers between the frames of a
    /// film: the fastest of their own.
    pub fn settle_all(
        limit: Limit,
        target: &mut Target,
        views: &[View],
        files: &[PathBuf],
        index: &Index,
    ) -> Result<Chosen> {
        let picture = target.picture;
        let subject = tune::subject(&target.renderer.gpu, picture, files)?;
        let found = subject.find(&tune::place(picture)?)?;
        let (front, clips) = (found.front.at_rest(), picture.clips());
        let mut fastest: Option<Choice> = None;
        for view in views {
            let load = |tuning: &Tuning| {
                let (_, cut) = tuning.applied(&Default::default(), picture.detail.lod(), view.size);
                let cut = lod::choose(index, &[*view], &clips, &cut.of(view.size), &HashSet::new());
                Load { points: cut.points, pixels: view.size[0] as u64 * view.size[1] as u64 }
            };
            let mut target = Target { view, ..target.again() };
            let draw = |tuning: &Tuning| target.draw(tuning).map(|(_, load, ms)| (load, ms));
            let choice = front.settle(limit, load, draw)?;
            fastest = [fastest, choice].into_iter().flatten().min_by_key(|choice| choice.place);
        }
        let choice = fastest.ok_or_else(|| {
            Error::Request(format!(
                "{limit}: {} has no settings; run `pointillist tune`",
                found.origin
            ))
        })?;
        let cut = target.set(&choice.tuning)?;
        Ok(Chosen { limit, choice, origin: found.origin, cut })
    }

    /// Returns what the picture took; with its errors, it and the finest one are drawn once more.
    pub fn got(&self, target: &mut Target, passes: &[(String, f64)], errors: bool) -> Result<Got> {
        let ms = split(passes).iter().sum();
        let errors = errors.then(|| target.errors(&self.choice.tuning)).transpose()?;
        Ok(Got { ms, errors })
    }

    /// Chooses a tuning for a picture that is drawn in pieces, by a smaller picture of the same
    /// view with its share of the time.
    pub fn settle_pieces(
        limit: Limit,
        target: &mut Target,
        files: &[PathBuf],
        index: &Index,
    ) -> Result<Chosen> {
        let whole = target.view;
        let pixels = |size: [u32; 2]| size[0] as f64 * size[1] as f64;
        let divisor = (pixels(whole.size) / MOST_TRIED).sqrt().ceil().max(1.0) as u32;
        let small = View::new(whole.camera, divided(whole.size, divisor))?;
        let share = pixels(small.size) / pixels(whole.size);
        let part = match limit {
            Limit::Time(ms) => Limit::Time(ms * share),
            other => other,
        };
        let mut chosen = Chosen::settle_all(part, target, &[small], files, index)?;
        (chosen.limit, chosen.choice.ms) = (limit, chosen.choice.ms / share);
        chosen.cut = target.set(&chosen.choice.tuning)?;
        Ok(chosen)
    }

    /// Returns one line: what was chosen and expected, and what it took if that is known.
    pub fn line(&self, took_ms: Option<f64>) -> String {
        let Choice { tuning, ms, expected, keeps, .. } = &self.choice;
        let took = took_ms.map_or(String::new(), |took| format!(", took {took:.1} ms"));
        let text = format!(
            "{}: {tuning}, by {}; expected {ms:.1} ms and {:.3} px{took}",
            self.limit, self.origin, expected.px
        );
        match keeps {
            true => text,
            false => format!("{text}; nothing measured keeps the limit, this is the nearest"),
        }
    }

    /// Returns a table with columns of what was expected and what was got.
    pub fn columns(&self, got: &Got) -> String {
        let Choice { ms, expected, .. } = &self.choice;
        let row = |name: &str, expected: f64, got: Option<f64>, unit: &str| {
            let got = got.map_or("-".into(), |got| format!("{got:.3}"));
            format!("{name:<16} {expected:>9.3} {got:>9} {unit}\n")
        };
        format!("{:<16} {:>9} {:>9}\n", self.limit.to_string(), "expected", "got")
            + &row("device time", *ms, Some(got.ms), "ms")
            + &row("error", expected.px, got.errors.map(|errors| errors.px), "px")
            + &row(
                "error of depth",
                100.0 * expected.depth,
                got.errors.map(|errors| 100.0 * errors.depth),
                "%",
            )
    }

    /// Returns the same for `--explain=json`.
    pub fn json(&self, got: &Got) -> serde_json::Value {
        let Choice { tuning, ms, expected, most, keeps, .. } = &self.choice;
        serde_json::json!({
            "limit": self.limit.to_string(),
            "values": tuning.words(),
            "front": self.origin,
            "keeps": keeps,
            "expected": { "ms": ms, "mean": expected, "most": most },
            "got": { "ms": got.ms, "mean": got.errors },
        })
    }
}
