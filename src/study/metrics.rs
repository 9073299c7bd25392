//! Shared metrics: quartiles of times, maximum and RMS of errors, and Pareto fronts.

/// Returns quantiles by linear interpolation between sorted values (Hyndman and Fan 1996, type 7).
pub fn quantiles<const N: usize>(values: &[f64], shares: [f64; N]) -> [f64; N] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    shares.map(|share| {
        let at = share * sorted.len().saturating_sub(1) as f64;
        let (below, above) = (sorted.get(at.floor() as usize), sorted.get(at.ceil() as usize));
        below.zip(above).map_or(f64::NAN, |(below, above)| below + (above - below) * at.fract())
    })
}

/// Returns lower quartile, median and upper quartile.
pub fn quartiles(values: &[f64]) -> [f64; 3] {
    quantiles(values, [0.25, 0.5, 0.75])
}

/// Returns the mean; 0 if empty.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    sum / count.max(1) as f64
}

/// Largest error and RMS; 0 if empty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    pub max: f64,
    pub rms: f64,
    pub count: usize,
}

pub fn errors(values: impl Iterator<Item = f64>) -> Errors {
    let (max, squares, count) = values
        .fold((0f64, 0.0, 0), |(max, squares, count), v| (max.max(v), squares + v * v, count + 1));
    Errors { max, rms: (squares / count.max(1) as f64).sqrt(), count }
}

/// Tests for every (error, time) that no other is at least as good in both and better in one.
pub fn front(settings: &[(f64, f64)]) -> Vec<bool> {
    let beats =
        |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    settings.iter().map(|own| !settings.iter().any(|other| beats(other, own))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_their_neighbours() {
        assert_eq!(quartiles(&[4.0, 1.0, 3.0, 2.0, 5.0]), [2.0, 3.0, 4.0]);
        assert_eq!(quartiles(&[1.0, 2.0]), [1.25, 1.5, 1.75]);
        assert_eq!(quartiles(&[7.0]), [7.0; 3]);
        assert!(quartiles(&[])[1].is_nan());
    }

    #[test]
    fn errors_of_three_and_four() {
        assert_eq!(
            errors([3.0, 4.0, 0.0, 0.0].into_iter()),
            Errors { max: 4.0, rms: 2.5, count: 4 }
        );
        assert_eq!(errors(std::iter::empty()), Errors::default());
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let settings = [(1.0, 5.0), (2.0, 3.0), (2.0, 4.0), (3.0, 3.0), (9.0, 1.0), (1.0, 5.0)];
        assert_eq!(front(&settings), [true, true, false, false, true, true]);
    }
}
