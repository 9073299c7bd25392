//! Points at random.

/// Random numbers, the same every time: xorshift64 (Marsaglia 2003).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Returns a uniform number in lo..hi.
    pub fn within(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Returns `count` coloured points on bumpy surfaces in a cube of `width` steps around the
/// lattice's origin.
pub fn bumpy(count: usize, width: i32, random: &mut Random) -> (Vec<[i32; 3]>, Vec<[u8; 3]>) {
    let half = width as f64 / 2.0;
    let point = |random: &mut Random| {
        let (u, v) = (random.within(-1.0, 1.0), random.within(-1.0, 1.0));
        let layer = (random.bits() % 3) as f64 * 0.4 - 0.4;
        let z = layer + 0.1 * (5.0 * u).sin() * (7.0 * v).cos() + random.within(-0.002, 0.002);
        [u, v, z].map(|c| (c * half) as i32)
    };
    let points: Vec<_> = (0..count).map(|_| point(random)).collect();
    let colors = points
        .iter()
        .map(|_| random.bits().to_le_bytes())
        .map(|b| [b[0] | 1, b[1], b[2]])
        .collect();
    (points, colors)
}
