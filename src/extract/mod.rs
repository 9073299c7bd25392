//! Points that filters, clip boxes and opacities leave: counted, described, written to a file, or
//! put into the cells of a map.
//!
//! ```text
//! files or an index -> batches -> points that are left -> thinned -> count, or file
//!                      input      Selection               thin      las, table, ply
//!                                     |
//!                                     +-----------------------------> statistics, raster
//! ```
//!
//! Points come in the order of the files, or in that of an index's leaves; a batch a thread is in
//! memory. All of it runs without a Vulkan device.

pub mod count;
pub mod extent;
mod fields;
pub mod input;
mod las;
mod ply;
pub mod profile;
pub mod raster;
pub mod statistics;
mod table;
mod thin;

use crate::cloud::ColumnSet;
use crate::cloud::filter::{Filter, Present, grouped};
use crate::cloud::scalar::{Scalar, Scalars};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::select::slab::Slab;
use input::{Batch, Input};
use std::path::Path;
use std::sync::Mutex;
pub use thin::Thinning;

/// Which points are left.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    pub filter: Filter,
    pub clips: Clips,
    /// Points of opacity 0 are left out.
    pub opacities: Opacities,
    /// Leaves what lies inside; leaves of an index outside of it are not read.
    pub slab: Option<Slab>,
}

impl Selection {
    /// Returns the columns that tell which points are left.
    pub fn wanted(&self) -> ColumnSet {
        let kind = self.opacities.needs_kinds();
        let of_kinds =
            ColumnSet { class: kind, returns: kind, source: kind, ..ColumnSet::default() };
        self.filter.wanted().and(of_kinds)
    }

    /// Returns the options that leave points out, as on the command line.
    fn words(&self) -> String {
        let mut words = Vec::new();
        if !self.filter.is_empty() {
            words.push(self.filter.words());
        }
        if self.clips.active() > 0 {
            words.push("--clip".into());
        }
        if !self.opacities.0.is_empty() {
            words.push("--opacity".into());
        }
        words.join(" ")
    }

    /// Returns the error that no point is left, with what there is: another pass over the input.
    pub fn leaves_none(&self, input: &Input, progress: &dyn Progress) -> Error {
        let present = Mutex::new(Present::default());
        let look = |batch: &Batch| {
            let part = &input.parts()[batch.part];
            let own = Present::of(batch.columns, &part.lattice, batch.shift, part.intensity_range);
            let mut present = present.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            *present = std::mem::take(&mut *present).and(own);
            Ok(())
        };
        let all = Selection::default();
        match input.each(&all, progress, &look, &mut |()| Ok(())) {
            Err(error) => error,
            Ok(_) => {
                let present = present.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
                let boxed = self.clips.active() > 0;
                let said = present.leaves_none(&self.words(), &self.filter, boxed);
                let unit = if boxed { input.reference().said() } else { String::new() };
                Error::Request(said + &unit)
            }
        }
    }
}

/// The kind of a file of points, by the end of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Las,
    Laz,
    Copc,
    Ply,
    Csv,
}

impl Format {
    /// Returns the format of a name.
    pub fn of(path: &Path) -> Result<Format> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let wrong =
            |why: &str| Err(Error::Request(format!("cannot write {}: {why}", path.display())));
        match name.rsplit_once('.').map_or("", |(_, ending)| ending) {
            "laz" if name.ends_with(".copc.laz") => Ok(Format::Copc),
            "las" => Ok(Format::Las),
            "laz" => Ok(Format::Laz),
            "ply" => Ok(Format::Ply),
            "csv" => Ok(Format::Csv),
            _ => wrong("its name must end in .copc.laz, .laz, .las, .ply or .csv"),
        }
    }
}

/// Points packed as a file has them.
#[derive(Default)]
pub struct Packed {
    bytes: Vec<u8>,
    /// End of each point among the bytes.
    ends: Vec<usize>,
}

/// A file that takes packed points in order.
trait Sink: Sync {
    /// Packs the points of a batch that are left.
    fn pack(&self, batch: &Batch) -> Result<Packed>;
}

/// What writes packed points.
trait Taker: Send {
    fn take(&mut self, points: u64, bytes: Vec<u8>) -> Result<()>;

    /// Completes the file.
    fn finish(self: Box<Self>, progress: &dyn Progress) -> Result<()>;
}

/// Outcome of an export.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Points written, and points of the input.
    pub points: u64,
    pub of: u64,
    pub notes: Vec<String>,
}

/// Writes the points that are left to a file, complete or absent, with all scalars of the files,
/// and heights above ground if these were `added`. Errors if there are none.
pub fn export(
    input: &Input,
    selection: &Selection,
    thinning: &Thinning,
    added: Scalars,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Exported> {
    let format = Format::of(output)?;
    input.check(&selection.filter)?;
    let mut notes = Vec::new();
    let has = input.parts().iter().fold(Scalars::NONE, |has, part| has.and(part.available.scalars));
    let height = Scalar::HeightAboveGround;
    let scalars: Vec<Scalar> =
        has.iter().filter(|own| *own != height || added.has(height)).collect();
    let scalars = scalars.as_slice();
    let (sink, mut taker): (Box<dyn Sink + '_>, Box<dyn Taker>) = match format {
        Format::Las | Format::Laz | Format::Copc => {
            let plan = las::Plan::new(input, format, scalars, &mut notes)?;
            let file = plan.create(output)?;
            (Box::new(plan), file)
        }
        Format::Ply => {
            let plan = ply::Plan::new(input, scalars, &mut notes);
            let file = plan.create(output)?;
            (Box::new(plan), Box::new(file))
        }
        Format::Csv => {
            let plan = table::Plan::new(input, scalars, &mut notes);
            let file = plan.create(output)?;
            (Box::new(plan), Box::new(file))
        }
    };
    let mut thinner = thin::Thinner::new(thinning);
    let (mut points, mut of) = (0, 0);
    for pass in 0..thinning.passes(input.points()) {
        let pack = |batch: &Batch| {
            Ok((sink.pack(batch)?, thinning.cells(batch, input, pass)?, batch.columns.len()))
        };
        let mut take = |(packed, cells, count): (Packed, thin::Cells, usize)| {
            of += if pass == 0 { count as u64 } else { 0 };
            let (count, bytes) = thinner.thin(packed, &cells);
            points += count;
            if count > 0 { taker.take(count, bytes) } else { Ok(()) }
        };
        let said = input.each(selection, progress, &pack, &mut take)?;
        if pass == 0 {
            notes.extend(said);
        }
        thinner.next_pass();
    }
    if points == 0 {
        drop(taker);
        return Err(match of {
            0 => Error::Request("the files have no points".into()),
            _ => selection.leaves_none(input, progress),
        });
    }
    taker.finish(progress)?;
    Ok(Exported { points, of, notes })
}

impl Exported {
    /// Returns a line about the outcome.
    pub fn line(&self, output: &Path) -> String {
        let (points, of) = (grouped(self.points), grouped(self.of));
        format!("{}: {points} of {of} points", output.display())
    }
}
