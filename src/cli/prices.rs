//! `--explain=prices`: what each effect costs in this picture, or would cost if it ran.
//!
//! The picture is drawn again with each effect the other way. Passes that one of both has alone are
//! the effect's: their time is its cost, or what skipping it has saved.

use crate::error::{Error, Result};
use crate::passes::{Effect, encode};
use crate::progress::Progress;
use crate::render::settings::FrameConfig;
use crate::renderer::{CloudId, Renderer};
use crate::view::View;
use std::collections::HashSet;

/// The price of an effect.
pub struct Price {
    pub effect: Effect,
    pub runs: bool,
    /// Device time of its passes `[ms]`; `None` if it cannot be switched here.
    pub ms: Option<f64>,
}

/// Returns the prices of all effects of a picture, which has been drawn with these passes.
pub fn of(
    renderer: &mut Renderer,
    cloud: CloudId,
    view: &View,
    config: &FrameConfig,
    passes: &[(String, f64)],
    progress: &dyn Progress,
) -> Result<Vec<Price>> {
    let asked = renderer.settings().clone();
    let mut prices = Vec::new();
    for (effect, reason) in &config.decisions.0 {
        let mut other = asked.clone();
        let switch = if reason.runs { "off" } else { "on" };
        other.effects.set_any(&format!("{}={switch}", effect.name())).map_err(Error::Request)?;
        renderer.set_settings(other);
        let ms = match drawn(renderer, cloud, view, (*effect, !reason.runs), progress) {
            Ok(None) | Err(Error::Request(_)) => None,
            Ok(Some(other)) if reason.runs => Some(alone(passes, &other)),
            Ok(Some(other)) => Some(alone(&other, passes)),
            Err(error) => return Err(error),
        };
        prices.push(Price { effect: *effect, runs: reason.runs, ms });
    }
    renderer.set_settings(asked);
    Ok(prices)
}

/// Draws the picture. Returns its passes; `None` if the effect runs or not, against its switch.
fn drawn(
    renderer: &mut Renderer,
    cloud: CloudId,
    view: &View,
    (effect, runs): (Effect, bool),
    progress: &dyn Progress,
) -> Result<Option<Vec<(String, f64)>>> {
    let config = renderer.config(cloud, view)?;
    if config.decisions.runs(effect) != runs {
        return Ok(None);
    }
    // Passes that nothing reads do not run.
    let mut draw = || {
        renderer.draw(cloud, view, &config, progress, |g, outcome| {
            encode::download(g, &outcome.picture)
        })
    };
    // The first picture also compiles kernels and takes memory into use.
    draw()?;
    Ok(Some(draw()?.frame.passes.clone()))
}

/// Returns the time of passes that another picture does not have `[ms]`.
fn alone(passes: &[(String, f64)], other: &[(String, f64)]) -> f64 {
    let others: HashSet<&str> = other.iter().map(|(name, _)| &name[..]).collect();
    let own = passes.iter().filter(|(name, _)| !others.contains(&name[..]));
    own.fold(0.0, |sum, (_, ms)| sum + ms)
}

/// Formats prices as lines.
pub fn table(prices: &[Price]) -> String {
    let line = |Price { effect, runs, ms }: &Price| {
        let said = match (runs, ms) {
            (true, Some(ms)) => format!("costs {ms:.2} ms"),
            (false, Some(ms)) => format!("skipped: saves {ms:.2} ms, which it would cost"),
            (true, None) => "runs, and cannot be left out".into(),
            (false, None) => "cannot run here".into(),
        };
        format!("  {:<14} {said}\n", effect.name())
    };
    format!("prices:\n{}", prices.iter().map(line).collect::<String>())
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
    }
}
