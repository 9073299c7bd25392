//! One exposure for all stations: a factor on the light of each, so that where two have seen the same it looks the same (`index::attributes::exposure`).
//!
//! Colours number their station, and are looked up in a row of a table that is its own: what this takes is the table. It comes before all else that is done to colours, keeps every detail, and leaves to
//! `luminance` what no factor mends: shadows, the time of day.

use super::{Decided, Effect, Effects, FrameContext, GBuffer, Reason, Setting};
use crate::cloud::attribute::{Attribute, station_code};
use crate::graph::Graph;
use crate::index::format::Balance;
use crate::resident::Resident;
use crate::view::View;

pub const SUMMARY: &str =
    "one exposure for all stations: a factor on the light of each, from where they overlap";

#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Settings {}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        Vec::new()
    }

    /// What holds no point stays as it is.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// As [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(0)
}

/// Stops between the brightest station and the darkest that are seen.
const SEEN: f64 = 0.05;

pub fn called_for(context: &FrameContext, _asked: &Effects, _before: &Decided) -> Reason {
    let stations = context.stations;
    let (runs, why) = match context.balance {
        _ if context.shown != Attribute::Rgb => (false, "points do not show their colours".to_string()),
        _ if stations < 2 => (false, "there is one station, and with it one exposure".to_string()),
        None => (false, "nobody knows by how much stations differ: none overlap, or their index is of an earlier version".to_string()),
        Some(balance) if stops(balance) < SEEN => {
            (false, format!("{stations} stations have the same exposure, to {:.2} stops", stops(balance)))
        }
        Some(balance) => {
            let uneven = super::significant(100.0 * balance.uneven);
            (
                true,
                format!(
                    "{stations} stations, {:.2} stops from the darkest to the brightest where they overlap; {uneven} % of what they share differs all the same",
                    stops(balance)
                ),
            )
        }
    };
    Reason { runs, why }
}

/// Whether stations are shown with one exposure: their own, or that which this has given them.
pub fn is_one(context: &FrameContext, decided: &Decided) -> bool {
    decided.runs(Effect::Exposure) || context.balance.is_some_and(|balance| stops(balance) < SEEN)
}

fn stops(balance: &Balance) -> f64 {
    let (least, most) = balance
        .gains
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(least, most), &gain| (least.min(gain), most.max(gain)));
    (most / least).log2()
}

/// A factor for every row of a table: none for words that number no station, then those of the stations, which are 1 where this does not run.
pub fn gains(resident: &Resident, decided: &Decided) -> Vec<f64> {
    let balance = resident.balance.as_ref().filter(|_| decided.runs(Effect::Exposure));
    let numbered = if resident.shown.coded { resident.stations.len() } else { 0 };
    let stations = (0..numbered).take_while(|&station| station_code(station) > 0);
    [1.0]
        .into_iter()
        .chain(stations.map(|station| balance.map_or(1.0, |balance| balance.gains[station])))
        .collect()
}

/// What there was to do was done when colours were looked up.
pub fn record(
    _g: &mut Graph,
    _scene: &FrameContext,
    _settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    gbuffer
}
