//! What each effect costs in a picture, or would cost if it ran: for `--explain=prices` and the
//! window.
//!
//! The picture is drawn again with each effect the other way. Passes that one of both has alone are
//! the effect's: their time is its cost, or what skipping it has saved. Where a software device
//! cannot time passes, since it has rasterised, the difference of the whole pictures counts.

use crate::error::{Error, Result};
use crate::passes::{Effect, encode};
use crate::progress::Progress;
use crate::render::settings::FrameConfig;
use crate::renderer::{CloudId, Renderer};
use crate::view::View;
use std::collections::HashSet;
use std::time::Instant;

/// The price of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Price {
    pub effect: Effect,
    pub runs: bool,
    /// Device time of its passes `[ms]`; `None` if it cannot be switched here.
    pub ms: Option<f64>,
}

/// A picture's times.
struct Timed {
    /// Device time of each pass `[ms]`.
    passes: Vec<(String, f64)>,
    /// Time until the picture was done `[ms]`.
    ms: f64,
}

impl Timed {
    /// Returns the time that this picture takes more than another one, by what it does besides.
    fn above(&self, other: &Timed, is_cpu: bool) -> f64 {
        // If it cannot, all passes end together, and take next to nothing.
        let has_times = |timed: &Timed| {
            !is_cpu || timed.passes.iter().map(|(_, ms)| ms).sum::<f64>() >= 0.1 * timed.ms
        };
        match has_times(self) && has_times(other) {
            true => alone(&self.passes, &other.passes),
            false => (self.ms - other.ms).max(0.0),
        }
    }
}

/// Returns the prices of all effects of a picture with this configuration, which is that of the
/// renderer's settings.
pub fn of(
    renderer: &mut Renderer,
    cloud: CloudId,
    view: &View,
    config: &FrameConfig,
    progress: &dyn Progress,
) -> Result<Vec<Price>> {
    let asked = renderer.settings().clone();
    let own = timed(renderer, cloud, view, config, progress)?;
    let is_cpu = renderer.gpu.device.is_cpu;
    let mut price = |effect: Effect, runs: bool| {
        let mut other = asked.clone();
        let switch = if runs { "off" } else { "on" };
        other.effects.set_any(&format!("{}={switch}", effect.name())).map_err(Error::Request)?;
        renderer.set_settings(other);
        let config = renderer.config(cloud, view)?;
        // Some effects run or not against their switch.
        if config.decisions.runs(effect) == runs {
            return Ok(None);
        }
        match timed(renderer, cloud, view, &config, progress) {
            Err(Error::Request(_)) => Ok(None),
            Ok(other) if runs => Ok(Some(own.above(&other, is_cpu))),
            Ok(other) => Ok(Some(other.above(&own, is_cpu))),
            Err(error) => Err(error),
        }
    };
    let all = config.decisions.0.iter().map(|(effect, reason)| {
        let (effect, runs) = (*effect, reason.runs);
        Ok(Price { effect, runs, ms: price(effect, runs)? })
    });
    let prices = all.collect();
    renderer.set_settings(asked);
    prices
}

/// Draws a picture. Returns its times.
fn timed(
    renderer: &mut Renderer,
    cloud: CloudId,
    view: &View,
    config: &FrameConfig,
    progress: &dyn Progress,
) -> Result<Timed> {
    // Passes that nothing reads do not run.
    let mut draw = || {
        let began = Instant::now();
        let done = renderer.draw(cloud, view, config, progress, |g, outcome| {
            encode::download(g, &outcome.picture)
        })?;
        let ms = began.elapsed().as_secs_f64() * 1e3;
        Ok(Timed { passes: done.frame.passes.clone(), ms })
    };
    // The first picture also compiles kernels and takes memory into use.
    let _: Timed = draw()?;
    draw()
}

/// Returns the time of passes that another picture does not have `[ms]`.
fn alone(passes: &[(String, f64)], other: &[(String, f64)]) -> f64 {
    let others: HashSet<&str> = other.iter().map(|(name, _)| &name[..]).collect();
    let own = passes.iter().filter(|(name, _)| !others.contains(&name[..]));
    own.fold(0.0, |sum, (_, ms)| sum + ms)
}

/// Formats prices as lines.
pub fn table(prices: &[Price]) -> String {
    let line = |price: &Price| format!("  {:<14} {}\n", price.effect.name(), price.words());
    format!("prices:\n{}", prices.iter().map(line).collect::<String>())
}

/// Returns prices by the names of effects, for `--explain=json,prices`.
pub fn json(prices: &[Price]) -> serde_json::Value {
    let one = |Price { effect, runs, ms }: &Price| {
        (effect.name().to_string(), serde_json::json!({ "runs": runs, "ms": ms }))
    };
    prices.iter().map(one).collect::<serde_json::Map<_, _>>().into()
}

impl Price {
    /// Formats what it costs or saves.
    pub fn words(&self) -> String {
        match (self.runs, self.ms) {
            (true, Some(ms)) => format!("costs {ms:.2} ms"),
            (false, Some(ms)) => format!("skipped: saves {ms:.2} ms, which it would cost"),
            (true, None) => "runs, and cannot be left out".into(),
            (false, None) => "cannot run here".into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_of_one_picture_alone_are_the_effects() {
        let passes = |all: &[(&str, f64)]| {
            all.iter().map(|(name, ms)| (name.to_string(), *ms)).collect::<Vec<_>>()
        };
        let (with, without) = (
            passes(&[("resolve", 1.0), ("shape", 2.0), ("shape_level", 3.0), ("shape_level", 4.0)]),
            passes(&[("resolve", 1.5)]),
        );
        assert_eq!((alone(&with, &without), alone(&without, &with)), (9.0, 0.0));
        let [with, without] =
            [(with, 20.0), (without, 16.0)].map(|(passes, ms)| Timed { passes, ms });
        assert_eq!((with.above(&without, false), without.above(&with, false)), (9.0, 0.0));
        // The passes of the second one take less than a tenth of its time.
        assert_eq!((with.above(&without, true), without.above(&with, true)), (4.0, 0.0));
    }
}
