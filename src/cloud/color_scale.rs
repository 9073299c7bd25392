//! How numbers and channels of colours become colours: ramps, their ends, and tone.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Colour ramps of numbers, as in `--ramp`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Ramp {
    /// Dark grey to white
    #[strum(to_string = "grey", serialize = "greys", serialize = "gray", serialize = "grays")]
    Grey,
    /// Blue, green, sand and white
    Terrain,
    /// Dark blue, green and yellow
    Viridis,
    /// Alike for all kinds of colour vision
    Cividis,
    /// The rainbow, with the most colours to tell apart
    Turbo,
}

/// Grey of the lowest number: black would be darker than the background.
const DARKEST: f64 = 0.2;

impl Ramp {
    /// Returns the colour at a place in 0..=1, sRGB.
    pub(crate) fn color(self, t: f64) -> [f64; 3] {
        // The colours at every 15th of 255 steps; between them the error is at most 11 / 255.
        const VIRIDIS: [u32; 18] = [
            0x440154, 0x481769, 0x472a7a, 0x433d84, 0x3d4e8a, 0x355e8d, 0x2e6d8e, 0x297b8e,
            0x23898e, 0x1f978b, 0x21a585, 0x2eb37c, 0x46c06f, 0x65cb5e, 0x89d548, 0xb0dd2f,
            0xd8e219, 0xfde725,
        ];
        const CIVIDIS: [u32; 18] = [
            0x00224e, 0x002d68, 0x163770, 0x2e416d, 0x3f4c6c, 0x4e566c, 0x5c616e, 0x696b71,
            0x767676, 0x838179, 0x928c78, 0xa09875, 0xafa471, 0xbfb06b, 0xcfbd62, 0xdfca57,
            0xf0d846, 0xfee838,
        ];
        const TURBO: [u32; 18] = [
            0x30123b, 0x3f3e9c, 0x4666dd, 0x458cfd, 0x2fb2f4, 0x1ad4d0, 0x22ebaa, 0x52fa7a,
            0x8bff4b, 0xb7f735, 0xdbe236, 0xf5c53a, 0xfea130, 0xf9751d, 0xe84b0c, 0xce2d04,
            0xa91601, 0x7a0403,
        ];
        let stops = |stops: &[u32]| {
            let stops: Vec<[f64; 3]> = stops
                .iter()
                .map(|&rgb| [16, 8, 0].map(|shift| (rgb >> shift & 255) as f64 / 255.0))
                .collect();
            between(&stops, t)
        };
        match self {
            Ramp::Grey => [DARKEST + (1.0 - DARKEST) * t; 3],
            Ramp::Terrain => between(&TERRAIN, t),
            Ramp::Viridis => stops(&VIRIDIS),
            Ramp::Cividis => stops(&CIVIDIS),
            Ramp::Turbo => stops(&TURBO),
        }
    }
}

/// How numbers and channels of colours become colours. Labels keep theirs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ColorScale {
    /// Ramp of numbers; if `None`, grey for intensities, terrain for elevations, viridis for times.
    pub ramp: Option<Ramp>,
    /// Values at its ends: heights `[m]`, intensities, or 8-bit channels; if `None`, percentiles.
    pub range: Option<[f64; 2]>,
    /// Added to places in 0..=1.
    pub brightness: f64,
    /// Slope about the middle.
    pub contrast: f64,
    /// Places are raised to the power of its inverse: above 1 is brighter in the middle.
    pub gamma: f64,
}

impl Default for ColorScale {
    fn default() -> ColorScale {
        ColorScale { ramp: None, range: None, brightness: 0.0, contrast: 1.0, gamma: 1.0 }
    }
}

/// Reads the ends of a ramp, such as `20,30`.
pub fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[lo, hi]) if lo < hi && (hi - lo).is_finite() => Ok([lo, hi]),
        _ => Err(format!("{text:?} is not a range; give a smaller and a larger number: 20,30")),
    }
}

/// Reads a brightness, contrast or gamma.
pub fn number(text: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    number.ok_or(format!("{text:?} is not a number, such as 1.5"))
}

impl ColorScale {
    /// Tests whether colours stay as they are.
    pub(crate) fn is_neutral(&self) -> bool {
        *self == ColorScale::default()
    }

    /// Returns the scale if its numbers have a meaning; otherwise says which has none.
    pub(crate) fn checked(self) -> Result<ColorScale, String> {
        let ColorScale { range, brightness, contrast, gamma, .. } = self;
        match () {
            () if !(-1.0..=1.0).contains(&brightness) => {
                Err("brightness must be from -1 to 1".into())
            }
            () if !(0.0..=100.0).contains(&contrast) => {
                Err("contrast must be from 0 to 100".into())
            }
            () if !(0.01..=100.0).contains(&gamma) => Err("gamma must be from 0.01 to 100".into()),
            () if range.is_some_and(|[lo, hi]| !(lo < hi && (hi - lo).is_finite())) => {
                Err("range must be a smaller and a larger number".into())
            }
            () => Ok(self),
        }
    }

    /// Applies gamma, contrast and brightness to a place in 0..=1.
    pub(crate) fn toned(&self, t: f64) -> f64 {
        let ColorScale { brightness, contrast, gamma, .. } = *self;
        if (brightness, contrast, gamma) == (0.0, 1.0, 1.0) {
            return t;
        }
        ((t.powf(1.0 / gamma) - 0.5) * contrast + 0.5 + brightness).clamp(0.0, 1.0)
    }
}

/// Deep blue, green, sand and white. Lightness rises throughout, so that the ramp also reads in
/// grey.
const TERRAIN: [[f64; 3]; 6] = [
    [0.16, 0.22, 0.42],
    [0.13, 0.42, 0.52],
    [0.25, 0.58, 0.44],
    [0.58, 0.70, 0.39],
    [0.90, 0.79, 0.53],
    [0.98, 0.96, 0.92],
];

/// Interpolates evenly spaced colours.
fn between(stops: &[[f64; 3]], t: f64) -> [f64; 3] {
    let at = t * (stops.len() - 1) as f64;
    let k = (at as usize).min(stops.len() - 2);
    std::array::from_fn(|c| stops[k][c] + (stops[k + 1][c] - stops[k][c]) * (at - k as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::colormap::srgb_to_linear;

    #[test]
    fn ramps_grow_lighter_and_none_but_turbo_is_darker_than_the_background() {
        let lightness = |[r, g, b]: [f64; 3]| {
            let [r, g, b] = [r, g, b].map(srgb_to_linear);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for ramp in [Ramp::Grey, Ramp::Terrain, Ramp::Viridis, Ramp::Cividis] {
            let all: Vec<f64> = (0..256).map(|i| lightness(ramp.color(i as f64 / 255.0))).collect();
            assert!(all.is_sorted(), "{ramp:?}");
            assert!(all[255] > 0.6);
        }
        let background = crate::config::BACKGROUND.map(|channel| channel as f64 / 255.0);
        assert!(lightness(Ramp::Grey.color(0.0)) > 2.0 * lightness(background));
    }

    #[test]
    fn a_neutral_scale_changes_nothing_and_others_stay_within_the_ramp() {
        let neutral = ColorScale::default();
        assert!((0..256).all(|i| neutral.toned(i as f64 / 255.0) == i as f64 / 255.0));
        let scale = ColorScale { gamma: 2.0, contrast: 1.5, brightness: 0.1, ..neutral };
        let toned: Vec<f64> = (0..256).map(|i| scale.toned(i as f64 / 255.0)).collect();
        assert!(toned.is_sorted() && toned[0] == 0.0 && toned[255] == 1.0);
        assert!((scale.toned(0.25) - 0.6).abs() < 1e-12);
    }
}
