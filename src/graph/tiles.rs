//! Where passes over the screen have anything to do: tiles that were listed on the device; and images that stay from one time to the next, so that what lies beyond need not be written again.

use super::{Buffer, Groups, Image, ImageDesc, ResourceId};

/// Tiles of 8 x 8 pixels, in words (glsl/lib/tile.glsl): workgroups that take eight each, three words, and the number of tiles; then the tiles, 16 bits across and 16 down.
pub struct TileList {
    /// The words before the tiles; those of the list itself, or of a copy that the device may have emptied.
    pub groups: Buffer,
    pub list: Buffer,
}

/// An area while passes are recorded.
#[derive(Clone, Copy)]
pub(super) struct TileMask {
    groups: ResourceId,
    pub list: ResourceId,
}

impl TileMask {
    pub fn new(tiles: &TileList) -> TileMask {
        TileMask { groups: tiles.groups.id, list: tiles.list.id }
    }

    /// Where the workgroups of such a pass stand.
    pub fn groups(&self) -> Groups {
        Groups::Indirect(self.groups, 0)
    }
}

/// Images of passes that are recorded several times: each has the same one every time, which holds what the time before left wherever nobody writes.
#[derive(Default)]
pub struct ReusedImages {
    made: Vec<(String, Image)>,
    /// Of these, those that were handed out this time.
    taken: Vec<bool>,
}

impl ReusedImages {
    pub(super) fn begin(&mut self) {
        self.taken.fill(false);
    }

    /// The first of this name and kind that nobody has had this time.
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
