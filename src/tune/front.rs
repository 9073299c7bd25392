//! The front of tunings that no other beats, and the choice among them.
//!
//! A tuning has measured costs: milliseconds a million points drawn, of passes that walk over
//! points, and milliseconds a million pixels, of all others. The time of a picture is predicted as
//!
//! ```text
//!     ms = point_ms * points / 10^6 + pixel_ms * pixels / 10^6
//! ```
//!
//! A cut says its points before it is drawn. Clouds and views differ in what both cost, so the
//! first picture drawn corrects them by two factors, the same for all tunings.

use super::error::Errors;
use super::knobs::Tuning;
use crate::error::Result;
use serde::{Deserialize, Serialize};

/// What a picture has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    pub points: u64,
    pub pixels: u64,
}

/// A tuning with what it was measured to cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tuned {
    /// Values of knobs that are not the defaults.
    pub values: Vec<String>,
    /// Mean errors of the measured views.
    pub mean: Errors,
    /// Largest errors of a view.
    pub most: Errors,
    /// Mean errors against the default's picture, which a window settles on.
    pub moving: Errors,
    /// Lower quartile, median and upper quartile of the time of one picture of each view, divided
    /// by their number `[ms]`.
    pub ms: [f64; 3],
    /// Time of passes over points, each million points `[ms]`.
    pub point_ms: f64,
    /// Time of all other passes, each million pixels `[ms]`.
    pub pixel_ms: f64,
    /// Largest quotient of a view's time and its predicted one.
    pub spread: f64,
}

/// The tunings of a device that no other beats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Front {
    pub device: String,
    pub driver: String,
    pub is_cpu: bool,
    /// What was drawn.
    pub scenes: Vec<String>,
    pub size: [u32; 2],
    /// Rounds that times are medians of.
    pub rounds: usize,
    /// The tunings, the fastest first; with the default and the finest one.
    pub tuned: Vec<Tuned>,
}

/// Upper limit of a picture's time or error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// Time of the device `[ms]`.
    Time(f64),
    /// Mean displacement `[px]`.
    Pixels(f64),
    /// Mean error in parts of the depth.
    Depth(f64),
}

/// Factors on the costs of points and pixels, which a drawn picture tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    points: f64,
    pixels: f64,
    /// True if a picture of this cloud and view has been measured.
    is_measured: bool,
}

impl Default for Correction {
    fn default() -> Correction {
        Correction { points: 1.0, pixels: 1.0, is_measured: false }
    }
}

/// Beginnings of the names of passes that walk over points.
const OVER_POINTS: [&str; 4] = ["project", "luminance_sum", "shadow_", "stroke_"];

/// Returns the times of passes that walk over points, and of all others `[ms]`.
pub fn split(passes: &[(String, f64)]) -> [f64; 2] {
    passes.iter().fold([0.0; 2], |[points, pixels], (name, ms)| {
        match OVER_POINTS.iter().any(|begin| name.starts_with(begin)) {
            true => [points + ms, pixels],
            false => [points, pixels + ms],
        }
    })
}

/// Room left for the noise of times where a picture of the view has been measured.
const NOISE: f64 = 1.05;

/// Most tunings that are tried, twice each, to settle a choice.
const TRIES: usize = 6;

/// Least share of the predicted time that each part must have to be corrected by its own factor.
const LEAST_SHARE: f64 = 0.02;

/// The tuning for a picture, and what is expected of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    pub tuning: Tuning,
    /// Place on the front.
    pub place: usize,
    /// Expected time `[ms]`.
    pub ms: f64,
    /// Expected errors.
    pub expected: Errors,
    /// Largest errors of a measured view.
    pub most: Errors,
    /// True if it is expected to keep the limit; if none is, it is the nearest to it.
    pub keeps: bool,
}

impl std::str::FromStr for Limit {
    type Err = String;

    /// Parses an error: `0.5px` or `0.2%`.
    fn from_str(text: &str) -> std::result::Result<Limit, String> {
        let positive = |number: &str| {
            number.trim().parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite())
        };
        let limit = match (text.strip_suffix("px"), text.strip_suffix('%')) {
            (Some(pixels), _) => positive(pixels).map(Limit::Pixels),
            (_, Some(percent)) => positive(percent).map(|percent| Limit::Depth(percent / 100.0)),
            _ => None,
        };
        limit.ok_or(format!(
            "{text:?} is not an error; give pixels such as 0.5px, or a part of the depth such as 0.2%"
        ))
    }
}

impl Limit {
    /// Parses a time: `50ms`, `0.05s`, or milliseconds without a unit.
    pub fn time(text: &str) -> std::result::Result<Limit, String> {
        let (number, scale) = match (text.strip_suffix("ms"), text.strip_suffix('s')) {
            (Some(number), _) => (number, 1.0),
            (_, Some(number)) => (number, 1e3),
            _ => (text, 1.0),
        };
        let ms = number.trim().parse::<f64>().ok().map(|number| number * scale);
        ms.filter(|ms| *ms > 0.0 && ms.is_finite())
            .map(Limit::Time)
            .ok_or(format!("{text:?} is not a time; give milliseconds such as 50ms"))
    }
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Limit::Time(ms) => write!(f, "--time {ms}ms"),
            Limit::Pixels(px) => write!(f, "--error {px}px"),
            Limit::Depth(part) => write!(f, "--error {}%", (part * 1e8).round() / 1e6),
        }
    }
}

impl Tuned {
    /// Returns the tuning; `None` if it is of another version.
    pub fn tuning(&self) -> Option<Tuning> {
        Tuning::of(&self.values)
    }

    /// Returns the times of points and pixels of a picture `[ms]`.
    fn parts(&self, load: &Load) -> [f64; 2] {
        [self.point_ms * load.points as f64 / 1e6, self.pixel_ms * load.pixels as f64 / 1e6]
    }

    /// Returns the predicted time of a picture `[ms]`.
    pub fn predicted(&self, load: &Load, correction: &Correction) -> f64 {
        let [points, pixels] = self.parts(load);
        points * correction.points + pixels * correction.pixels
    }

    fn error(&self, limit: &Limit) -> [f64; 2] {
        match limit {
            Limit::Depth(_) => [self.mean.depth, self.most.depth],
            _ => [self.mean.px, self.most.px],
        }
    }
}

impl Correction {
    /// Returns the correction by a picture that took these times for points and pixels `[ms]`.
    pub fn measured(tuned: &Tuned, load: &Load, ms: [f64; 2]) -> Correction {
        let predicted = tuned.parts(load);
        let whole: f64 = predicted.iter().sum();
        let both = ms.iter().sum::<f64>() / whole;
        let apart = predicted.iter().all(|part| *part > LEAST_SHARE * whole);
        let factor = |k: usize| if apart { ms[k] / predicted[k] } else { both };
        Correction { points: factor(0), pixels: factor(1), is_measured: true }
    }
}

impl Front {
    /// Returns the tuning to draw a picture with: for a time the most accurate that fits, for an
    /// error the cheapest that holds it in all measured views. `load` is that of a tuning's
    /// picture.
    pub fn choose(
        &self,
        limit: Limit,
        load: impl Fn(&Tuning) -> Load,
        correction: &Correction,
    ) -> Option<Choice> {
        let choices = self.tuned.iter().enumerate().filter_map(|(place, tuned)| {
            let tuning = tuned.tuning()?;
            let ms = tuned.predicted(&load(&tuning), correction);
            let room = if correction.is_measured { NOISE } else { tuned.spread };
            let keeps = match limit {
                Limit::Time(most) => ms * room <= most,
                Limit::Pixels(most) | Limit::Depth(most) => tuned.error(&limit)[1] <= most,
            };
            Some(Choice { tuning, place, ms, expected: tuned.mean, most: tuned.most, keeps })
        });
        let choices: Vec<Choice> = choices.collect();
        let error = |choice: &Choice| self.tuned[choice.place].error(&limit);
        let by_time = |a: &&Choice, b: &&Choice| a.ms.total_cmp(&b.ms);
        let by_error = |a: &&Choice, b: &&Choice| {
            let [[a_mean, _], [b_mean, _]] = [error(a), error(b)];
            a_mean.total_cmp(&b_mean).then(a.ms.total_cmp(&b.ms))
        };
        let kept = || choices.iter().filter(|choice| choice.keeps);
        let found = match limit {
            Limit::Time(_) => kept().min_by(by_error).or_else(|| choices.iter().min_by(by_time)),
            _ => kept().min_by(by_time).or_else(|| choices.iter().min_by(by_error)),
        };
        found.cloned()
    }

    /// Chooses for a time, draws, corrects the prediction by what was measured, and chooses again:
    /// until the choice stays, or after a few pictures. An error needs no picture. `draw` returns
    /// the load of a picture and its times of points and pixels `[ms]`.
    pub fn settle(
        &self,
        limit: Limit,
        load: impl Fn(&Tuning) -> Load,
        mut draw: impl FnMut(&Tuning) -> Result<(Load, [f64; 2])>,
    ) -> Result<Option<Choice>> {
        let mut correction = Correction::default();
        let mut tried: Vec<(Choice, f64)> = Vec::new();
        let Limit::Time(most) = limit else {
            return Ok(self.choose(limit, load, &correction));
        };
        loop {
            let Some(choice) = self.choose(limit, &load, &correction) else { return Ok(None) };
            let known = tried.iter().position(|(other, _)| other.tuning == choice.tuning);
            if known.is_some() || tried.len() == TRIES {
                break;
            }
            // The first picture of a setting also takes memory into use, and other programs slow
            // one down at times: the faster of both counts.
            let [first, second] = [draw(&choice.tuning)?, draw(&choice.tuning)?];
            let whole = |(_, ms): &(Load, [f64; 2])| ms.iter().sum::<f64>();
            let (drawn, ms) = if whole(&first) < whole(&second) { first } else { second };
            correction = Correction::measured(&self.tuned[choice.place], &drawn, ms);
            tried.push((choice, ms.iter().sum()));
        }
        let by_error =
            |a: &&(Choice, f64), b: &&(Choice, f64)| a.0.expected.px.total_cmp(&b.0.expected.px);
        let fits = tried.iter().filter(|(_, ms)| ms * NOISE <= most).min_by(by_error);
        let found = fits.or_else(|| tried.iter().min_by(|a, b| a.1.total_cmp(&b.1)));
        Ok(found.map(|(choice, ms)| Choice { ms: *ms, keeps: *ms <= most, ..choice.clone() }))
    }

    /// Returns the front of pictures at rest, which have all their pixels.
    pub fn at_rest(mut self) -> Front {
        self.tuned.retain(|tuned| tuned.tuning().is_some_and(|tuning| tuning.divisor() == 1));
        self
    }

    /// Returns the place of a tuning.
    pub fn place(&self, tuning: &Tuning) -> Option<usize> {
        self.tuned.iter().position(|tuned| tuned.tuning().as_ref() == Some(tuning))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tuned(tuning: Tuning, ms: [f64; 2], px: f64) -> Tuned {
        let errors = Errors { px, depth: px / 1000.0 };
        Tuned {
            values: tuning.words(),
            mean: errors,
            most: Errors { px: 1.5 * px, depth: px / 500.0 },
            moving: errors,
            ms: [ms[0] + ms[1]; 3],
            point_ms: ms[0],
            pixel_ms: ms[1],
            spread: 1.2,
        }
    }

    fn front() -> Front {
        let usual = Tuning::usual();
        Front {
            device: "device".into(),
            driver: "driver".into(),
            is_cpu: true,
            scenes: vec!["street".into()],
            size: [1000, 1000],
            rounds: 3,
            tuned: vec![
                tuned(usual.with(2, 8), [2.0, 10.0], 1.0),
                tuned(usual.with(7, 6), [4.0, 40.0], 0.4),
                tuned(usual, [4.0, 100.0], 0.1),
                tuned(Tuning::finest(), [10.0, 200.0], 0.0),
            ],
        }
    }

    const LOAD: Load = Load { points: 1_000_000, pixels: 1_000_000 };

    #[test]
    fn a_time_gets_the_most_accurate_that_fits_and_an_error_the_cheapest_that_holds() {
        let (front, known) = (front(), Correction::default());
        let chosen = |limit| {
            let choice = front.choose(limit, |_| LOAD, &known).unwrap();
            (choice.place, choice.keeps)
        };
        // With a fifth of room.
        assert_eq!(chosen(Limit::Time(52.0)), (0, true));
        assert_eq!(chosen(Limit::Time(53.0)), (1, true));
        assert_eq!(chosen(Limit::Time(1e6)), (3, true));
        assert_eq!(chosen(Limit::Time(1.0)), (0, false));
        assert_eq!(chosen(Limit::Pixels(0.61)), (1, true));
        assert_eq!(chosen(Limit::Pixels(0.59)), (2, true));
        assert_eq!(chosen(Limit::Depth(0.0021)), (0, true));
        assert_eq!(chosen(Limit::Depth(1e-9)), (3, true));
    }

    #[test]
    fn times_grow_with_points_and_pixels_and_follow_a_measured_picture() {
        let front = front();
        let usual = &front.tuned[2];
        let load = Load { points: 500_000, pixels: 2_000_000 };
        assert_eq!(usual.predicted(&load, &Correction::default()), 202.0);
        let twice = Correction::measured(usual, &load, [4.0, 100.0]);
        assert!((usual.predicted(&load, &twice) - 104.0).abs() < 1e-9);
        // Half a pixel's price: what did not fit does now.
        let choice = front.choose(Limit::Time(115.0), |_| load, &twice).unwrap();
        assert_eq!((choice.place, choice.ms.round()), (2, 104.0));
        // A part that is nearly nothing says nothing of its own.
        let pixels = Load { points: 1, pixels: 1_000_000 };
        let slow = Correction::measured(usual, &pixels, [5.0, 295.0]);
        assert!((usual.predicted(&LOAD, &slow) - 312.0).abs() < 0.1);
    }

    #[test]
    fn a_choice_settles_on_what_was_measured_to_fit() {
        let front = front();
        let settled = |most: f64, factor: f64| {
            let mut drawn = 0;
            let choice = front
                .settle(
                    Limit::Time(most),
                    |_| LOAD,
                    |tuning| {
                        drawn += 1;
                        let tuned = &front.tuned[front.place(tuning).unwrap()];
                        Ok((LOAD, [tuned.point_ms * factor, tuned.pixel_ms * factor]))
                    },
                )
                .unwrap()
                .unwrap();
            (choice.place, choice.ms, choice.keeps, drawn)
        };
        // As predicted; half of it, so that there is room for more; twice, so that there is not.
        assert_eq!(settled(60.0, 1.0), (1, 44.0, true, 2));
        assert_eq!(settled(60.0, 0.5), (2, 52.0, true, 4));
        assert_eq!(settled(60.0, 2.0), (0, 24.0, true, 4));
        assert_eq!(settled(1.0, 1.0), (0, 12.0, false, 2));
    }

    #[test]
    fn limits_have_units() {
        assert_eq!("0.5px".parse(), Ok(Limit::Pixels(0.5)));
        assert_eq!("0.2%".parse(), Ok(Limit::Depth(0.002)));
        assert_eq!(Limit::time("50ms"), Ok(Limit::Time(50.0)));
        assert_eq!(Limit::time("0.05s"), Ok(Limit::Time(50.0)));
        assert_eq!(Limit::time("16"), Ok(Limit::Time(16.0)));
        for wrong in ["0.5", "px", "-1px", "0%", "nanpx"] {
            assert!(wrong.parse::<Limit>().is_err(), "{wrong}");
        }
        assert!(Limit::time("0").is_err() && Limit::time("50m").is_err());
        assert_eq!(Limit::Depth(0.002).to_string(), "--error 0.2%");
    }

    #[test]
    fn a_front_is_read_back() {
        let text = serde_json::to_string(&front()).unwrap();
        assert_eq!(serde_json::from_str::<Front>(&text).unwrap(), front());
    }
}
