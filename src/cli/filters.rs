//! Options that say which points are left, for `view`, `render`, `export` and `info`.

use crate::cloud::filter::{Condition, Filter};
use crate::select::clip::{Clip, Clips};

#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Points")]
pub struct FilterOptions {
    /// Leave only points of these values; a comma is "or", 10..20 a range. Repeatable: a point must
    /// match all
    ///
    /// Values of class, return (a number, first, last, single), returns, source, file, scan,
    /// intensity, x, y, z, gps-time, and of any scalar; names of classes need no "class="
    #[arg(
        long,
        visible_alias = "where",
        value_name = "ground|class=2,6|intensity=100..2000|return=last|..."
    )]
    pub only: Vec<Condition>,
    /// Leave out points of these values. Repeatable
    #[arg(long, value_name = "noise|z=..0|...")]
    pub not: Vec<Condition>,
}

/// Clip boxes.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Points")]
pub struct ClipOptions {
    /// Leave what lies in a box, or outside of one, by two opposite corners in the world.
    /// Repeatable
    ///
    /// In one of several boxes, and outside of every `outside` box; faces belong to a box; inf is a
    /// number; files in degrees are drawn in metres on a plane, and so are boxes: `info` has both
    /// bounds
    #[arg(long, value_name = "box|outside|off:X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    pub clip: Vec<Clip>,
}

impl FilterOptions {
    pub fn filter(&self) -> Filter {
        Filter { only: self.only.clone(), not: self.not.clone() }
    }
}

impl From<Filter> for FilterOptions {
    fn from(Filter { only, not }: Filter) -> FilterOptions {
        FilterOptions { only, not }
    }
}

impl ClipOptions {
    pub fn clips(&self) -> Clips {
        Clips(self.clip.clone())
    }
}
