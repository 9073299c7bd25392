//! Tile lists that restrict passes, and images that are reused so that pixels outside a list keep
//! their contents.

use super::{Buffer, Groups, Image, ImageDesc, ResourceId};

/// A list of tiles of 8 x 8 pixels, as words (glsl/lib/tile.glsl): three workgroup counts at eight
/// tiles each, the number of tiles, then the tiles, 16 bits across and 16 down.
pub struct TileList {
    /// Buffer with the workgroup counts: the list itself, or a copy that the device may have
    /// zeroed.
    pub groups: Buffer,
    pub list: Buffer,
}

/// A tile list while passes are recorded.
#[derive(Clone, Copy)]
pub(super) struct TileMask {
    groups: ResourceId,
    pub list: ResourceId,
}

impl TileMask {
    pub fn new(tiles: &TileList) -> TileMask {
        TileMask { groups: tiles.groups.id, list: tiles.list.id }
    }

    /// Returns the place of the workgroup counts.
    pub fn groups(&self) -> Groups {
        Groups::Indirect(self.groups, 0)
    }
}

/// Images of passes that are recorded repeatedly: each gets the same one every time, with the
/// previous contents wherever nothing writes.
#[derive(Default)]
pub struct ReusedImages {
    made: Vec<(String, Image)>,
    /// True for each image that has been handed out this time.
    taken: Vec<bool>,
}

impl ReusedImages {
    pub(super) fn begin(&mut self) {
        self.taken.fill(false);
    }

    /// Returns the first image of this name and kind that has not been handed out this time.
    pub(super) fn take(&mut self, name: &str, desc: ImageDesc) -> Option<Image> {
        let place = (0..self.made.len())
            .find(|&i| !self.taken[i] && self.made[i].0 == name && self.made[i].1.desc == desc)?;
        self.taken[place] = true;
        Some(self.made[place].1.alias())
    }

    pub(super) fn add(&mut self, name: &str, image: &Image) {
        self.made.push((name.to_string(), image.alias()));
        self.taken.push(true);
    }
}
