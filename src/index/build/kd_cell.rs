//! Cells of the kd-tree that halves a cube at the middle of its longest side.

/// A cell: the number of bits of the Morton code that it decides, and their value.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct KdCell {
    pub depth: u32,
    pub prefix: u128,
}

impl KdCell {
    /// The whole tree.
    pub const ALL: KdCell = KdCell { depth: 0, prefix: 0 };

    /// Returns the cell that is halved into this one and another; `None` for the whole tree.
    pub fn parent(self) -> Option<KdCell> {
        Some(KdCell { depth: self.depth.checked_sub(1)?, prefix: self.prefix >> 1 })
    }

    /// Tests whether the cell is `other` or holds it.
    pub fn has(self, other: &KdCell) -> bool {
        other.depth >= self.depth && other.prefix >> (other.depth - self.depth) == self.prefix
    }

    /// Tests whether all places of the cell come before those of another one.
    pub fn is_before(self, other: KdCell) -> bool {
        let depth = self.depth.min(other.depth);
        self.prefix >> (self.depth - depth) < other.prefix >> (other.depth - depth)
    }

    /// Returns the part of the cell within another one, of which one holds the other.
    pub fn within(self, other: KdCell) -> KdCell {
        if self.depth < other.depth { other } else { self }
    }

    /// Returns the codes of its places, of `bits` bits per axis.
    pub fn codes(self, bits: u32) -> std::ops::Range<u128> {
        let open = 3 * bits - self.depth;
        self.prefix << open..(self.prefix + 1) << open
    }

    /// Returns the least and the greatest coordinates of its places, of `bits` bits per axis.
    pub fn bounds(self, bits: u32) -> [[u32; 3]; 2] {
        let codes = self.codes(bits);
        [codes.start, codes.end - 1].map(|code| {
            [0, 1, 2].map(|axis: u32| {
                (0..bits).fold(0, |q, bit| q | ((code >> (3 * bit + axis)) as u32 & 1) << bit)
            })
        })
    }
}
