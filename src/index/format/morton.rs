//! Morton order: interleaved bits of three integers, x lowest, so that points near in space are
//! near in memory.

/// Spreads the low 10 bits to every third bit.
fn spread(v: u32) -> u32 {
    let v = v & 0x3FF;
    let v = (v | v << 16) & 0x0300_00FF;
    let v = (v | v << 8) & 0x0300_F00F;
    let v = (v | v << 4) & 0x030C_30C3;
    (v | v << 2) & 0x0924_9249
}

/// Returns the 30-bit code of three 10-bit numbers.
pub fn code(q: [u32; 3]) -> u32 {
    spread(q[0]) | spread(q[1]) << 1 | spread(q[2]) << 2
}

/// Spreads the low 21 bits to every third bit.
fn spread_21(v: u32) -> u64 {
    let v = v as u64 & 0x1F_FFFF;
    let v = (v | v << 32) & 0x001F_0000_0000_FFFF;
    let v = (v | v << 16) & 0x001F_0000_FF00_00FF;
    let v = (v | v << 8) & 0x100F_00F0_0F00_F00F;
    let v = (v | v << 4) & 0x10C3_0C30_C30C_30C3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// Returns the 63-bit code of the low 21 bits of three numbers.
pub fn code_63(q: [u32; 3]) -> u64 {
    spread_21(q[0]) | spread_21(q[1]) << 1 | spread_21(q[2]) << 2
}

/// Returns the 96-bit code of three numbers.
pub fn code_96(q: [u32; 3]) -> u128 {
    (code_63(q.map(|v| v >> 21)) as u128) << 63 | code_63(q) as u128
}

/// Returns one of the three numbers of a code of `bits` bits each.
pub fn axis(code: u32, axis: usize, bits: u32) -> u32 {
    (0..bits).map(|b| (code >> (3 * b + axis as u32) & 1) << b).sum()
}

/// Returns one bit of the code of three numbers.
pub fn has(q: [u32; 3], bit: u32) -> bool {
    q[bit as usize % 3] >> (bit / 3) & 1 == 1
}

/// Returns the highest bit in which two codes differ, counted from 1; 0 if they are equal. Computes
/// no codes, and has no branches, which would be unpredictable.
pub fn highest_difference(a: [u32; 3], b: [u32; 3]) -> u8 {
    let of = |axis: usize| {
        let different = a[axis] ^ b[axis];
        (3 * (different | 1).ilog2() + axis as u32 + 1) * (different != 0) as u32
    };
    of(0).max(of(1)).max(of(2)) as u8
}

/// Compares two codes.
pub fn order(a: [u32; 3], b: [u32; 3]) -> std::cmp::Ordering {
    let axis = highest_difference(a, b).wrapping_sub(1) as usize % 3;
    a[axis].cmp(&b[axis])
}

/// Returns the bits that each axis loses when the lowest `dropped` bits of a code are dropped; x
/// loses the first.
pub fn axis_bits(dropped: u32) -> [u32; 3] {
    [dropped.div_ceil(3), (dropped + 1) / 3, dropped / 3]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    fn naive(q: [u32; 3], bits: u32) -> u128 {
        (0..bits)
            .map(|b| {
                (0..3)
                    .map(|axis| ((q[axis] as u128) >> b & 1) << (3 * b + axis as u32))
                    .sum::<u128>()
            })
            .sum()
    }

    proptest! {
        #[test]
        fn codes_interleave_bit_by_bit(q in prop::array::uniform3(any::<u32>())) {
            prop_assert_eq!(super::code(q.map(|v| v & 1023)) as u128, naive(q, 10));
            prop_assert_eq!(super::code_63(q) as u128, naive(q, 21));
            prop_assert_eq!(super::code_96(q), naive(q, 32));
            prop_assert!((0..96).all(|bit| super::has(q, bit) == (naive(q, 32) >> bit & 1 == 1)));
        }

        #[test]
        fn differences_are_those_of_the_codes(a in prop::array::uniform3(any::<u32>()), flip in 0u32..97, low in any::<u128>()) {
            let other = naive(a, 32) ^ if flip == 0 { 0 } else { 1 << (flip - 1) | low & ((1 << (flip - 1)) - 1) };
            let b = [0, 1, 2].map(|axis| (0..32).map(|k| ((other >> (3 * k + axis)) as u32 & 1) << k).sum());
            prop_assert_eq!(super::highest_difference(a, b) as u32, flip);
            prop_assert_eq!(super::order(a, b), naive(a, 32).cmp(&naive(b, 32)));
        }

        #[test]
        fn dropped_bits_are_those_of_the_axes(q in prop::array::uniform3(any::<u32>()), dropped in 0u32..96) {
            let bits = super::axis_bits(dropped);
            prop_assert_eq!(bits.iter().sum::<u32>(), dropped);
            let kept = [0, 1, 2].map(|axis| ((q[axis] as u64) >> bits[axis] << bits[axis]) as u32);
            prop_assert_eq!(super::code_96(kept), super::code_96(q) >> dropped << dropped);
        }
    }
}
