//! Mutations of inputs, for runs without a driver that is guided by coverage.

/// A sequence of random numbers: xorshift64 (Marsaglia 2003), which is enough here.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Returns a number below `end`, or 0.
    pub fn below(&mut self, end: usize) -> usize {
        ((self.next() >> 16) % end.max(1) as u64) as usize
    }
}

/// Numbers at which readers err.
const NUMBERS: [u64; 12] = [
    0,
    1,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    u64::MAX,
    // 1e308 and NaN as f64.
    0x7FE1_CCF3_85EB_C8A0,
    0x7FF8_0000_0000_0000,
];

/// Returns an input made of one seed by one to eight changes, or a part of another seed.
pub fn mutated(
    random: &mut Random,
    seeds: &[Vec<u8>],
    words: &[&str],
    most_bytes: usize,
) -> Vec<u8> {
    let mut input = seeds[random.below(seeds.len())].clone();
    for _ in 0..1 + random.below(8) {
        change(random, &mut input, seeds, words);
    }
    input.truncate(most_bytes);
    input
}

fn change(random: &mut Random, input: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[&str]) {
    // Headers are small and decide more than points do.
    let within = if random.below(2) == 0 { input.len() } else { input.len().min(512) };
    let at = random.below(within);
    let end = (at + 1 + random.below(16)).min(input.len());
    match random.below(10) {
        0 if at < input.len() => input[at] = random.next() as u8,
        1 if at < input.len() => input[at] ^= 1 << random.below(8),
        2 | 3 => {
            let bytes = NUMBERS[random.below(NUMBERS.len())].to_le_bytes();
            let width = [1, 2, 4, 8][random.below(4)];
            let own = if width == 8 { &bytes[..] } else { &bytes[..width] };
            for (place, byte) in input[at..].iter_mut().zip(own) {
                *place = *byte;
            }
        }
        4 if at < end => drop(input.drain(at..end)),
        5 => {
            let own = input[at..end].to_vec();
            input.splice(at..at, own);
        }
        6 => {
            let other = &seeds[random.below(seeds.len())];
            let from = random.below(other.len());
            let to = (from + random.below(64)).min(other.len());
            input.splice(at..at, other[from..to].iter().copied());
        }
        7 | 8 if !words.is_empty() => {
            let word = words[random.below(words.len())].as_bytes();
            let replaced =
                if random.below(2) == 0 { at } else { (at + word.len()).min(input.len()) };
            input.splice(at..replaced, word.iter().copied());
        }
        _ => {
            // Digits of numbers in texts.
            if let Some(digit) = input[at..].iter_mut().find(|byte| byte.is_ascii_digit()) {
                *digit = b"0123456789-.e"[random.below(13)];
            }
        }
    }
}
