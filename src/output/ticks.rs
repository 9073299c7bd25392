//! Round numbers for scales and axes.

/// Returns the largest of 1, 2 and 5 times a power of ten up to a number.
pub fn round_below(number: f64) -> f64 {
    let power = 10f64.powf(number.log10().floor());
    [5.0, 2.0, 1.0]
        .into_iter()
        .map(|digit| digit * power)
        .find(|&round| round <= number)
        .unwrap_or(power)
}

/// Returns the smallest of them from a number on.
pub fn round_above(number: f64) -> f64 {
    let power = 10f64.powf(number.log10().floor());
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|digit| digit * power)
        .find(|&round| round >= number)
        .unwrap_or(10.0 * power)
}

/// Returns the multiples of a step within a range.
pub fn multiples(step: f64, [lo, hi]: [f64; 2]) -> Vec<f64> {
    let first = (lo / step).ceil();
    (0..64).map(|k| (first + k as f64) * step).take_while(|&tick| tick <= hi).collect()
}

/// Formats a number with the decimals of a step.
pub fn number(number: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{number:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_labels_as_precise_as_they() {
        assert_eq!([0.3, 1.0, 4.9, 5.0, 99.0].map(round_below), [0.2, 1.0, 2.0, 5.0, 50.0]);
        assert_eq!([0.3, 1.0, 4.9, 5.0, 99.0].map(round_above), [0.5, 1.0, 5.0, 5.0, 100.0]);
        assert_eq!(multiples(5.0, [-7.0, 10.0]), [-5.0, 0.0, 5.0, 10.0]);
        assert_eq!([number(0.5, 0.5), number(20.0, 5.0)], ["0.5", "20"]);
    }
}
