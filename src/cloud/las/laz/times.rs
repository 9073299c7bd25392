//! GPS times of compressed points.
//!
//! Four sequences of times are kept, each with its last step. A symbol says how many steps follow
//! in the present sequence, or that another one goes on, whose symbol is then the next. An encoder
//! changes the sequence at most once for a point. The decoders of the `laz` crate follow any number
//! of changes by recursion, until the stack overflows; here a second one is damage.

use super::super::header::array_at;
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;
use std::io::{Error, ErrorKind, Read, Result};

/// Numbers of steps that have a symbol each: 0 to 500, then -1 to -10.
const MOST_STEPS: i32 = 500;
const LEAST_STEPS: i32 = -10;

/// Symbols for a number of steps.
const STEPS: i32 = 1 + MOST_STEPS - LEAST_STEPS;

/// A sequence takes the last difference as its step after this many differences that are no usual
/// number of steps.
const UNUSUAL: u32 = 4;

#[derive(Clone, Copy, Default)]
struct Sequence {
    time: i64,
    step: i32,
    /// Differences that were no usual number of steps.
    unusual: u32,
}

/// Meaning of a symbol.
enum Meaning {
    /// The same time again.
    Equal,
    /// A difference, where there is no step yet.
    Difference,
    /// About this many steps.
    Steps(i32),
    /// All 64 bits, in the place of the oldest sequence.
    Whole,
    /// Change to the sequence this many places on.
    Other(usize),
}

/// The times of one stream, as bits of `f64`.
pub struct Times {
    sequences: [Sequence; 4],
    present: usize,
    newest: usize,
    /// Presence of symbols for an equal time, which layered points lack.
    has_equal: bool,
    without_step: ArithmeticModel,
    with_step: ArithmeticModel,
    numbers: IntegerDecompressor,
}

impl Times {
    /// Returns a decoder for layered points, after a first time.
    pub fn layered(first: i64) -> Self {
        Self::new(first, false)
    }

    /// Returns a decoder for times of the second version, between other fields of a point.
    pub fn sequential() -> Self {
        Self::new(0, true)
    }

    fn new(first: i64, has_equal: bool) -> Self {
        let mut sequences = [Sequence::default(); 4];
        sequences[0].time = first;
        let model =
            |symbols: i32| ArithmeticModelBuilder::new(symbols as u32 + has_equal as u32).build();
        Self {
            sequences,
            present: 0,
            newest: 0,
            has_equal,
            without_step: model(5),
            with_step: model(STEPS + 4),
            numbers: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
        }
    }

    /// Decodes the next time.
    pub fn next<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<i64> {
        let mut meaning = self.meaning(decoder)?;
        if let Meaning::Other(places) = meaning {
            self.present = (self.present + places) % 4;
            meaning = self.meaning(decoder)?;
        }
        let Sequence { time, step, .. } = self.sequences[self.present];
        match meaning {
            Meaning::Equal => {}
            Meaning::Difference => {
                let step = self.numbers.decompress(decoder, 0, 0)?;
                let time = time.wrapping_add(step.into());
                self.sequences[self.present] = Sequence { time, step, unusual: 0 };
            }
            Meaning::Steps(steps) => {
                let context = match steps {
                    0 => 7,
                    1 => 1,
                    2..10 => 2,
                    10..MOST_STEPS => 3,
                    MOST_STEPS => 4,
                    LEAST_STEPS => 6,
                    _ => 5,
                };
                let expected = steps.wrapping_mul(step);
                let difference = self.numbers.decompress(decoder, expected, context)?;
                let sequence = &mut self.sequences[self.present];
                sequence.time = time.wrapping_add(difference.into());
                match steps {
                    0 | MOST_STEPS | LEAST_STEPS => sequence.unusual += 1,
                    1 => sequence.unusual = 0,
                    _ => {}
                }
                if sequence.unusual == UNUSUAL {
                    (sequence.step, sequence.unusual) = (difference, 0);
                }
            }
            Meaning::Whole => {
                let high = self.numbers.decompress(decoder, (time >> 32) as i32, 8)?;
                let time = (high as i64) << 32 | decoder.read_int()? as i64;
                self.newest = (self.newest + 1) % 4;
                self.present = self.newest;
                self.sequences[self.present] = Sequence { time, step: 0, unusual: 0 };
            }
            Meaning::Other(_) => {
                return Err(Error::new(
                    ErrorKind::InvalidData,
                    "its GPS times are damaged: one is in two sequences of times",
                ));
            }
        }
        Ok(self.sequences[self.present].time)
    }

    fn meaning<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<Meaning> {
        let has_equal = self.has_equal as i32;
        if self.sequences[self.present].step == 0 {
            let symbol = decoder.decode_symbol(&mut self.without_step)? as i32 - has_equal;
            return Ok(match symbol {
                -1 => Meaning::Equal,
                0 => Meaning::Difference,
                1 => Meaning::Whole,
                _ => Meaning::Other(symbol as usize - 1),
            });
        }
        let symbol = decoder.decode_symbol(&mut self.with_step)? as i32;
        let after = symbol - STEPS - has_equal;
        Ok(match symbol {
            0..=MOST_STEPS => Meaning::Steps(symbol),
            ..STEPS => Meaning::Steps(MOST_STEPS - symbol),
            _ if after < 0 => Meaning::Equal,
            _ if after == 0 => Meaning::Whole,
            _ => Meaning::Other(after as usize),
        })
    }
}

impl<R: Read> FieldDecompressor<R> for Times {
    fn size_of_field(&self) -> usize {
        8
    }

    fn decompress_first(&mut self, source: &mut R, first: &mut [u8]) -> Result<()> {
        source.read_exact(first)?;
        self.sequences[0].time = i64::from_le_bytes(array_at(first, 0));
        Ok(())
    }

    fn decompress_with(
        &mut self,
        decoder: &mut ArithmeticDecoder<R>,
        field: &mut [u8],
    ) -> Result<()> {
        field.copy_from_slice(&self.next(decoder)?.to_le_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use laz::encoders::ArithmeticEncoder;
    use laz::las::gps::v2::{GpsTimeCompressor, GpsTimeDecompressor};
    use laz::record::FieldCompressor;
    use std::io::Cursor;

    /// Returns times of a few clocks, each with its own steps, and some others.
    fn times(seed: u64) -> Vec<i64> {
        let mut state = seed;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % below
        };
        let mut clocks = [0u64; 6].map(|_| random(1 << 31) << 32);
        let step = 1 + random(100_000);
        let next = |i: usize| {
            let clock = &mut clocks[random([1, 3, 20][i / 500 % 3]).min(5) as usize];
            let steps = [1, 0, 1, 2, 7, 100, 600, 1u64.wrapping_neg(), 20u64.wrapping_neg()];
            let steps = steps[random([3, 9, 40][i / 200 % 3]).min(8) as usize];
            *clock = clock.wrapping_add(step.wrapping_mul(steps)).wrapping_add(random(2));
            *clock as i64
        };
        (0..3000).map(next).collect()
    }

    #[test]
    fn times_are_those_of_the_laz_crate() {
        for seed in 0..100 {
            let times = times(seed);
            let mut encoder = ArithmeticEncoder::new(Vec::new());
            let mut compressor = GpsTimeCompressor::default();
            let first = times[0].to_le_bytes();
            compressor.compress_first(encoder.get_mut(), &first).unwrap();
            for time in &times[1..] {
                compressor.compress_with(&mut encoder, &time.to_le_bytes()).unwrap();
            }
            encoder.done().unwrap();
            let bytes = encoder.into_inner();
            let decoded = |decoder: &mut dyn FieldDecompressor<Cursor<Vec<u8>>>| {
                let mut source = ArithmeticDecoder::new(Cursor::new(bytes.clone()));
                let mut time = [0; 8];
                decoder.decompress_first(source.get_mut(), &mut time).unwrap();
                source.read_init_bytes().unwrap();
                let next = |_| {
                    decoder.decompress_with(&mut source, &mut time).unwrap();
                    i64::from_le_bytes(time)
                };
                (1..times.len()).map(next).collect::<Vec<_>>()
            };
            assert_eq!(decoded(&mut Times::sequential()), times[1..]);
            assert_eq!(decoded(&mut GpsTimeDecompressor::default()), times[1..]);
        }
    }

    #[test]
    fn a_time_in_two_sequences_is_damage() {
        for has_equal in [false, true] {
            // Changes of the sequence without end.
            let mut encoder = ArithmeticEncoder::new(Vec::new());
            let mut model =
                ArithmeticModelBuilder::new(5 + has_equal as u32).with_compression(true).build();
            for _ in 0..1_000_000 {
                encoder.encode_symbol(&mut model, 2 + has_equal as u32).unwrap();
            }
            encoder.done().unwrap();
            let mut decoder = ArithmeticDecoder::new(Cursor::new(encoder.into_inner()));
            decoder.read_init_bytes().unwrap();
            let why = Times::new(0, has_equal).next(&mut decoder).unwrap_err();
            assert_eq!(why.kind(), ErrorKind::InvalidData);
        }
    }
}
