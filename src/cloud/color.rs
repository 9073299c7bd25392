//! 16-bit colour fields -> 8 bits a channel; and what these mean: the sRGB transfer function.
//!
//! In: 16-bit values, block by block, in any order. Out: 8-bit values, and whether the file held 8 or 16 bits.
//! Many writers put 8-bit values into 16-bit fields, and no prefix of a file tells (RELIABILITY: PotreeConverter #214), so the decision is
//! taken over the whole file. Until a value above 255 turns up the low byte is stored, which loses nothing; from then on values are rounded,
//! and what was stored is rounded as well. So no 16-bit copy of the colours is ever held.

/// Exactly `round(v / 257)` for all 65,536 values (HARD_CASES 24).
pub fn to_8_bits(v: u16) -> u8 {
    ((v as u32 * 255 + 32895) >> 16) as u8
}

/// What the colours of a block, or of a whole file, have in common: the bits that occurred in any channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Depth {
    occurred: u16,
}

impl Depth {
    /// A value above 255 occurred.
    pub fn is_wide(self) -> bool {
        self.occurred > 255
    }

    /// Every value was 0.
    pub fn is_black(self) -> bool {
        self.occurred == 0
    }

    pub fn bits(self) -> u8 {
        if self.is_wide() { 16 } else { 8 }
    }

    pub fn join(self, other: Depth) -> Depth {
        Depth { occurred: self.occurred | other.occurred }
    }

    /// Stores `values` at `at`, and brings `stored[..at]`, which holds earlier values of this depth, to the same bits.
    pub fn store(&mut self, stored: &mut [[u8; 3]], at: usize, values: impl Iterator<Item = [u16; 3]> + Clone) {
        let block = Depth { occurred: values.clone().fold(0, |bits, [r, g, b]| bits | r | g | b) };
        if block.is_wide() && !self.is_wide() {
            narrow(&mut stored[..at]);
        }
        *self = self.join(block);
        if self.is_wide() {
            stored[at..].iter_mut().zip(values).for_each(|(slot, value)| *slot = value.map(to_8_bits));
        } else {
            stored[at..].iter_mut().zip(values).for_each(|(slot, value)| *slot = value.map(|v| v as u8));
        }
    }
}

/// Rounds colours that were stored as low bytes, once a wide value has shown them to be 16-bit.
pub fn narrow(stored: &mut [[u8; 3]]) {
    for color in stored {
        *color = color.map(|v| to_8_bits(v as u16));
    }
}

/// The note that [`Depth::bits`] = 8 deserves where the fields have 16 bits.
pub const NOTE_8_IN_16: &str = "colours are 8-bit values in 16-bit fields, and taken as such";

/// The sRGB transfer function (IEC 61966-2-1), encoded to linear, both in 0..=1.
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Its inverse.
pub fn linear_to_srgb(linear: f64) -> f64 {
    if linear <= 0.0031308 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
