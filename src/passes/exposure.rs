//! One exposure for all stations: one factor on the light of each, so that places seen by two
//! stations look the same (`index::attributes::exposure`).
//!
//! Colours carry the number of their station and are looked up in its row of a table; this effect
//! sets that table. It comes before all other effects on colours and keeps every detail.
//! `luminance` handles what no factor corrects, such as moving shadows and the time of day.

use super::{Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting};
use crate::cloud::attribute::{Attribute, station_code};
use crate::graph::Graph;
use crate::index::format::Balance;
use crate::resident::Resident;
use crate::view::View;

pub const SUMMARY: &str =
    "one exposure for all stations: one factor on the light of each, from their overlaps";

#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Settings {}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        Vec::new()
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(0)
}

/// Difference between the brightest and the darkest station from which it is visible `[stops]`.
const SEEN: f64 = 0.05;

pub fn called_for(context: &FrameContext, _asked: &Effects, _before: &EffectDecisions) -> Reason {
    let stations = context.stations;
    let (runs, why) = match context.balance {
        _ if !matches!(context.shown, Attribute::Rgb | Attribute::Intensity) => {
            (false, "points show neither colours nor intensities".to_string())
        }
        _ if stations < 2 => (false, "there is only one station".to_string()),
        None => (
            false,
            "the difference of stations is unknown: none overlap, or an index does not have it"
                .to_string(),
        ),
        Some(balance) if stops(balance) < SEEN => (
            false,
            format!("{stations} stations have the same exposure, to {:.2} stops", stops(balance)),
        ),
        Some(balance) => {
            let uneven = super::significant(100.0 * balance.uneven);
            (
                true,
                format!(
                    "{stations} stations, {:.2} stops from the darkest to the brightest where they overlap; {uneven} % of their overlaps still differ",
                    stops(balance)
                ),
            )
        }
    };
    Reason { runs, why }
}

/// Returns whether all stations have one exposure: their own, or by this effect.
pub fn is_one(context: &FrameContext, decisions: &EffectDecisions) -> bool {
    decisions.runs(Effect::Exposure) || context.balance.is_some_and(|balance| stops(balance) < SEEN)
}

fn stops(balance: &Balance) -> f64 {
    let (least, most) = balance
        .gains
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(least, most), &gain| (least.min(gain), most.max(gain)));
    (most / least).log2()
}

/// Returns a factor for every row of the table: 1 for words without a station, then one for each
/// station, which is 1 if the effect does not run.
pub fn gains(resident: &Resident, decisions: &EffectDecisions) -> Vec<f64> {
    let balance = resident.balance.as_ref().filter(|_| decisions.runs(Effect::Exposure));
    let numbered = if resident.shown.coded { resident.stations.len() } else { 0 };
    let stations = (0..numbered).take_while(|&station| station_code(station) > 0);
    [1.0]
        .into_iter()
        .chain(stations.map(|station| balance.map_or(1.0, |balance| balance.gains[station])))
        .collect()
}

/// Returns the G-buffer unchanged: colours were looked up in the table before.
pub fn record(
    _g: &mut Graph,
    _scene: &FrameContext,
    _settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    gbuffer
}
