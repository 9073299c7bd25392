//! Fields of a single LAS record, for writers.

use super::header::{record_bytes, u16_at};

/// Returns a point format without waveforms.
pub fn without_waveform(format: u8) -> u8 {
    match format {
        4 => 1,
        5 => 3,
        9 => 6,
        10 => 8,
        other => other,
    }
}

#[derive(Clone, Copy)]
pub struct Record<'r> {
    pub bytes: &'r [u8],
    pub format: u8,
}

impl Record<'_> {
    fn is_modern(&self) -> bool {
        self.format >= 6
    }

    /// Appends the record without its waveform, at other coordinates.
    pub fn write(&self, steps: [i32; 3], out: &mut Vec<u8>) {
        let bare = record_bytes(without_waveform(self.format)) as usize;
        steps.iter().for_each(|v| out.extend(v.to_le_bytes()));
        out.extend_from_slice(&self.bytes[12..bare]);
        out.extend_from_slice(self.extra_bytes());
    }

    pub fn extra_bytes(&self) -> &[u8] {
        &self.bytes[record_bytes(self.format) as usize..]
    }

    pub fn user_data(&self) -> u8 {
        self.bytes[17]
    }

    pub fn color(&self) -> Option<[u16; 3]> {
        let at = match self.format {
            2 => 20,
            3 | 5 => 28,
            7 | 8 | 10 => 30,
            _ => return None,
        };
        Some([0, 2, 4].map(|channel| u16_at(self.bytes, at + channel)))
    }

    /// Returns synthetic, key point, withheld and overlap; the scanner channel; the direction; the
    /// edge of a flight line: as in formats 6 to 10.
    pub fn flags(&self) -> u8 {
        match self.is_modern() {
            true => self.bytes[15],
            false => self.bytes[15] >> 5 | self.bytes[14] & 0xc0,
        }
    }
}

/// Tests whether records of a format describe waveforms.
pub fn has_waveform(format: u8) -> bool {
    without_waveform(format) != format
}
