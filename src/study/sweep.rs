//! Timing of settings in turn, round by round (A B A B), so that disturbances affect all of them
//! alike.

use crate::error::Result;

/// Returns the times of every setting over `repeat` rounds, or other measurements. One uncounted
/// round before warms up caches, kernels and the allocator.
pub fn interleaved<S, T: Clone>(
    settings: &[S],
    repeat: usize,
    mut time: impl FnMut(&S) -> Result<T>,
) -> Result<Vec<Vec<T>>> {
    let mut times = vec![Vec::with_capacity(repeat); settings.len()];
    for round in 0..=repeat {
        for (setting, times) in settings.iter().zip(&mut times) {
            let ms = time(setting)?;
            if round > 0 {
                times.push(ms);
            }
        }
    }
    Ok(times)
}

#[cfg(test)]
mod tests {
    #[test]
    fn settings_take_turns_and_the_first_round_does_not_count() {
        let mut seen = Vec::new();
        let times = super::interleaved(&["a", "b"], 2, |setting| {
            seen.push(*setting);
            Ok(seen.len() as f64)
        });
        assert_eq!(times.unwrap(), [[3.0, 5.0], [4.0, 6.0]]);
        assert_eq!(seen, ["a", "b", "a", "b", "a", "b"]);
    }
}
