//! Points of a profile's slab as a table: their places in the profile and in their file, and the
//! file's own colours and numbers.

use super::Selection;
use super::fields::{Colors, has_words, intensity, record};
use super::input::{Batch, Input};
use crate::atomic_file::write_atomically;
use crate::cloud::attribute::Attribute;
use crate::cloud::digits::Digits;
use crate::cloud::scalar::Scalars;
use crate::cloud::{ColumnSet, ReadOptions};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::select::slab::Slab;
use glam::{DVec2, DVec3};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The columns of a table.
pub struct Table<'t> {
    input: &'t Input,
    slab: Slab,
    colors: Colors,
    /// Intensity and time if some part has them, and what the points show.
    numbers: Vec<Attribute>,
    /// Digits of each part's coordinates.
    digits: Vec<Digits>,
    /// Symbol of the unit of distances; empty if no file states one.
    unit: String,
}

impl<'t> Table<'t> {
    /// Returns the table of points that show an attribute.
    pub fn new(input: &'t Input, slab: Slab, shown: Option<Attribute>) -> Table<'t> {
        let parts = input.parts();
        let has = parts.iter().fold(ColumnSet::default(), |has, part| has.and(part.available));
        let numbers = [
            has.intensity.then_some(Attribute::Intensity),
            has.gps_time.then_some(Attribute::Time),
            shown.filter(|shown| matches!(shown, Attribute::Scalar(_))),
        ];
        let reference = input.reference();
        Table {
            input,
            slab,
            colors: Colors::of(input),
            numbers: numbers.into_iter().flatten().collect(),
            digits: parts.iter().map(|part| Digits::of([part.own])).collect(),
            unit: match reference.says_unit() {
                true => reference.unit().symbol().into(),
                false => String::new(),
            },
        }
    }

    /// Returns the line of names.
    pub fn head(&self) -> String {
        let quoted = |own: &Attribute| format!(",\"{}\"", own.name().replace('"', "\"\""));
        let numbers: String = self.numbers.iter().map(quoted).collect();
        format!("distance,height,left,x,y,z,class,return,source,red,green,blue,unit{numbers}\n")
    }

    /// Returns the lines of a batch's points that are left; a field is empty where a part lacks it.
    pub fn lines(&self, batch: &Batch) -> String {
        batch.left.iter().filter_map(|&i| self.line(batch, i as usize)).collect()
    }

    fn line(&self, batch: &Batch, i: usize) -> Option<String> {
        let (part, columns) = (&self.input.parts()[batch.part], batch.columns);
        let steps = batch.steps(i);
        let DVec2 { x: along, y: left } = self.slab.place(part.lattice.world(steps))?;
        let DVec3 { x, y, z } = self.digits[batch.part].round(part.own.world(steps));
        let class = word(columns.class.as_ref().map(|column| column[i]));
        let number = word(columns.returns.as_ref().map(|column| column[i] & 15));
        let source = word(columns.source.as_ref().map(|_| batch.source(i)));
        let own = columns.rgb.as_ref().map(|_| {
            let record = record(self.input, batch, i);
            self.colors.color(batch, record, has_words(self.input, batch.part), i)
        });
        let [r, g, b] = [0, 1, 2].map(|channel| word(own.map(|own| own[channel])));
        let value = |attribute: &Attribute| match attribute {
            Attribute::Intensity => {
                columns.intensity.as_ref().map(|own| intensity(own[i], part.intensity_range))
            }
            other => other.numbers_of(columns).map(|own| own[i]),
        };
        let known = |own: &Attribute| format!(",{}", word(value(own).filter(|v| !v.is_nan())));
        let numbers: String = self.numbers.iter().map(known).collect();
        let unit = &self.unit;
        Some(format!(
            "{along},{z},{left},{x},{y},{z},{class},{number},{source},{r},{g},{b},{unit}{numbers}\n"
        ))
    }
}

fn word(value: Option<impl ToString>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

/// Writes the table of a selection's slab, complete or absent; returns the number of points.
pub fn write(
    files: &[PathBuf],
    read: &ReadOptions,
    selection: &Selection,
    shown: Option<Attribute>,
    output: &Path,
    progress: &dyn Progress,
) -> Result<u64> {
    let slab = selection.slab.ok_or_else(|| Error::Request("a profile needs a slab".into()))?;
    let shows = shown.map(Attribute::wanted).unwrap_or_default();
    let all = ColumnSet { scalars: Scalars::ALL, ..ColumnSet::ALL };
    let wanted = all.and(shows).and(selection.wanted());
    let options = ReadOptions { wanted, records: true, ..*read };
    let input = Input::open(files, &options, progress)?;
    let table = Table::new(&input, slab, shown);
    let mut points = 0;
    write_atomically(output, |partial| {
        let wrote = |error| Error::io("write", output, error);
        let mut file = BufWriter::new(File::create(partial).map_err(wrote)?);
        file.write_all(table.head().as_bytes()).map_err(wrote)?;
        let mut take = |(count, lines): (u64, String)| {
            points += count;
            file.write_all(lines.as_bytes()).map_err(wrote)
        };
        let map = |batch: &Batch| Ok((batch.left.len() as u64, table.lines(batch)));
        input.each(selection, progress, &map, &mut take)?;
        file.flush().map_err(wrote)
    })?;
    Ok(points)
}
