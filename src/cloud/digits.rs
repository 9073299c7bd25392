//! Significant decimals of coordinates: as many as distinguish the steps of their lattice.
//!
//! Rounded positions print short: `848992.08`, although `offset + step * q` as f64 is
//! 848992.0800000001.

use super::Lattice;
use glam::DVec3;

/// Decimals of each axis; all digits if no lattice is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Digits(Option<[usize; 3]>);

/// Most decimals: an f64 has no more for lengths in metres.
const MOST: usize = 15;

impl Digits {
    /// Returns the decimals that the finest of these lattices needs.
    pub fn of(lattices: impl IntoIterator<Item = Lattice>) -> Digits {
        let own = |lattice: Lattice| {
            [0, 1, 2].map(|axis| decimals(lattice.step[axis], lattice.offset[axis]))
        };
        Digits(
            lattices.into_iter().map(own).reduce(|a, b| [0, 1, 2].map(|axis| a[axis].max(b[axis]))),
        )
    }

    /// Returns the decimals of each axis.
    pub fn decimals(&self) -> [usize; 3] {
        self.0.unwrap_or([MOST; 3])
    }

    pub fn round(&self, place: DVec3) -> DVec3 {
        let Some(decimals) = self.0 else { return place };
        DVec3::from_array([0, 1, 2].map(|axis| round(place[axis], decimals[axis])))
    }
}

/// Rounds to this many decimals; never returns -0.
pub fn round(v: f64, decimals: usize) -> f64 {
    format!("{v:.decimals$}").parse::<f64>().map_or(v, |rounded| rounded + 0.0)
}

/// Returns the exact decimals of step and offset if they are decimals; else one more than the step.
fn decimals(step: f64, offset: f64) -> usize {
    let step = step.abs();
    if !step.is_normal() {
        return MOST;
    }
    let fine = (1.0 - step.log10()).ceil().clamp(0.0, MOST as f64) as usize;
    let is_exact = |v: f64, decimals: usize| (round(v, decimals) - v).abs() <= 1e-6 * step;
    (0..=(fine + 2).max(6))
        .find(|&decimals| is_exact(step, decimals) && is_exact(offset, decimals))
        .unwrap_or(fine)
}

/// Formats a number in full, or with an exponent if that would take many zeros.
pub fn number(v: f64) -> String {
    let is_plain = v == 0.0 || !v.is_finite() || (1e-9..1e16).contains(&v.abs());
    if is_plain { v.to_string() } else { format!("{v:e}") }
}

/// Returns the shortest decimal of a number that a file stores as `f32`.
pub fn of_f32(v: f64) -> f64 {
    (v as f32).to_string().parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_those_of_step_and_offset() {
        let cases = [
            (0.01, 0.0, 2),
            (0.001, 500_000.0, 3),
            (0.001, 0.0005, 4),
            (0.25, 0.0, 2),
            (1.0, 0.0, 0),
            (1.16e-6, 1694038.4, 8),
            (2f64.powi(-25), 0.0, 9),
            (1000.0, 0.5, 1),
            (1e9, 0.0, 0),
            (1e-8, -94.0, 8),
        ];
        for (step, offset, expected) in cases {
            assert_eq!(decimals(step, offset), expected, "{step} {offset}");
        }
    }

    #[test]
    fn every_step_keeps_its_own_decimal() {
        for lattice in [0.01, 0.001, 1e-7, 2f64.powi(-20)]
            .map(|step| Lattice { step: DVec3::splat(step), offset: DVec3::splat(848_000.25) })
        {
            let digits = Digits::of([lattice]);
            for q in [-99_999i64, 0, 1, 7, 99_208] {
                let place = lattice.world([q; 3]);
                let off = (digits.round(place) - place).abs().max_element();
                assert!(off <= 0.06 * lattice.step.x, "{} {off}", lattice.step.x);
            }
        }
        let place =
            Lattice { step: DVec3::splat(0.01), offset: DVec3::ZERO }.world([84_899_208; 3]);
        assert_eq!(
            Digits::of([Lattice { step: DVec3::splat(0.01), offset: DVec3::ZERO }])
                .round(place)
                .x
                .to_string(),
            "848992.08"
        );
        assert_eq!(Digits::default().round(place), place);
    }
}
