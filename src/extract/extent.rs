//! The extent on the map of the points that are left, without strays.
//!
//! Points far outside of all others, such as one at the origin, would make a map of almost nothing.
//! They are found as in clouds that are in memory ([`Bins`]), but on the map: a bird above the
//! points does not widen it. Only where there may be some are the points read again.

use super::Selection;
use super::input::{Batch, Input};
use crate::cloud::digits::Digits;
use crate::cloud::strays::{Bins, RobustBounds, scatter_steps};
use crate::error::Result;
use crate::progress::Progress;
use glam::{DVec2, DVec3};

/// Approximate number of positions that are sampled.
const SAMPLES: u64 = 50_000;

/// Where points are on the map.
#[derive(Clone, Debug)]
pub struct Extent {
    pub points: u64,
    /// Points outside of the corners.
    pub strays: u64,
    /// World corners of the box around all points but strays.
    pub corners: [DVec2; 2],
    pub notes: Vec<String>,
}

/// Returns the extent of the points that are left; `None` if there are none.
pub fn extent(
    input: &Input,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Option<Extent>> {
    input.check(&selection.filter)?;
    let largest = u32::MAX / (input.points() / SAMPLES + 1) as u32;
    let look = |batch: &Batch| {
        let (mut own, mut samples) = (Around::default(), Vec::new());
        for (i, place) in places(input, batch) {
            own.add(place);
            let columns = batch.columns;
            if scatter_steps([columns.x[i], columns.y[i], columns.z[i]], [0; 3]) <= largest {
                samples.push((place, 1));
            }
        }
        Ok((own, samples))
    };
    let (mut all, mut samples) = (Around::default(), Vec::new());
    let mut take = |(own, some): (Around, Vec<(DVec3, u64)>)| {
        all.join(&own);
        samples.extend(some);
        Ok(())
    };
    let notes = input.each(selection, progress, &look, &mut take)?;
    if all.points == 0 {
        return Ok(None);
    }
    let Some(bins) = Bins::of(all.corners, samples) else {
        return Ok(Some(all.extent(input, 0, notes)));
    };
    let none = || vec![Around::default(); bins.number()];
    let sort = |batch: &Batch| {
        let mut own = none();
        places(input, batch).for_each(|(_, place)| own[bins.bin(place)].add(place));
        Ok(own)
    };
    let mut sorted = none();
    let mut take = |own: Vec<Around>| {
        sorted.iter_mut().zip(&own).for_each(|(all, own)| all.join(own));
        Ok(())
    };
    input.each(selection, progress, &sort, &mut take)?;
    let counts: Vec<u64> = sorted.iter().map(|own| own.points).collect();
    let Some(gap) = bins.first_of_strays(&counts) else {
        return Ok(Some(all.extent(input, 0, notes)));
    };
    let mut core = Around::default();
    sorted[..gap].iter().for_each(|own| core.join(own));
    Ok(Some(core.extent(input, all.points - core.points, notes)))
}

/// Returns the numbers of a batch's points that are left, and their places on the map.
fn places<'b>(input: &Input, batch: &'b Batch) -> impl Iterator<Item = (usize, DVec3)> + use<'b> {
    let lattice = input.parts()[batch.part].lattice;
    let place = move |i: usize| lattice.world(batch.steps(i)) * DVec3::new(1.0, 1.0, 0.0);
    batch.left.iter().map(move |&i| (i as usize, place(i as usize)))
}

/// Points, and the box around them.
#[derive(Clone, Debug)]
struct Around {
    points: u64,
    corners: RobustBounds,
}

impl Default for Around {
    fn default() -> Around {
        let corners = RobustBounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
        Around { points: 0, corners }
    }
}

impl Around {
    fn add(&mut self, place: DVec3) {
        self.join(&Around { points: 1, corners: RobustBounds { low: place, high: place } });
    }

    fn join(&mut self, Around { points, corners }: &Around) {
        self.points += points;
        self.corners.low = self.corners.low.min(corners.low);
        self.corners.high = self.corners.high.max(corners.high);
    }

    fn extent(&self, input: &Input, strays: u64, notes: Vec<String>) -> Extent {
        let digits = Digits::of(input.parts().iter().map(|part| part.lattice));
        let corners = [self.corners.low, self.corners.high];
        let corners = corners.map(|corner| digits.round(corner).truncate());
        Extent { points: self.points + strays, strays, corners, notes }
    }
}
