//! Morton order: interleaved bits of three integers, x lowest, so that points near in space are near in memory.

/// Spreads the low 10 bits to every third bit.
fn spread(v: u32) -> u32 {
    let v = v & 0x3FF;
    let v = (v | v << 16) & 0x0300_00FF;
    let v = (v | v << 8) & 0x0300_F00F;
    let v = (v | v << 4) & 0x030C_30C3;
    (v | v << 2) & 0x0924_9249
}

/// The 30-bit code of three 10-bit numbers.
pub fn code(q: [u32; 3]) -> u32 {
    spread(q[0]) | spread(q[1]) << 1 | spread(q[2]) << 2
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn code_interleaves_bit_by_bit(x in 0u32..1024, y in 0u32..1024, z in 0u32..1024) {
            let naive: u32 = (0..10).map(|b| (x >> b & 1) << (3 * b) | (y >> b & 1) << (3 * b + 1) | (z >> b & 1) << (3 * b + 2)).sum();
            prop_assert_eq!(super::code([x, y, z]), naive);
        }
    }
}
