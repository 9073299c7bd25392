//! Damaged tables: refused with the line, or read up to it.

use super::styles::{Encoding, Quotes, Style, Written, run, table};
use super::{Column, says, world};
use glam::DVec3;
use pointillist::cloud::{self, ColumnSet, ReadOptions};
use pointillist::progress::Silent;
use proptest::prelude::*;
use std::cell::Cell;

/// The reference's reading of a line: a row, nothing, or something that needs a note.
#[derive(Debug, PartialEq)]
enum Plain {
    Row([f64; 3]),
    Nothing,
    Odd,
}

/// Reads a line as the undamaged table is written, without quotes.
fn plainly(line: &str, style: &Style, columns: &[Column]) -> Plain {
    let is_blank = style.delimiter.trim().is_empty() && style.delimiter != "\t";
    let line = if style.delimiter == "\t" {
        line.trim_matches(' ')
    } else {
        line.trim_matches([' ', '\t'])
    };
    if line.trim().is_empty()
        || line.starts_with(['#', '%'])
        || line.starts_with("//")
        || line.starts_with(';') && style.delimiter.trim() != ";"
    {
        return Plain::Nothing;
    }
    let mut fields: Vec<&str> = match is_blank {
        true => line.split([' ', '\t']).filter(|field| !field.is_empty()).collect(),
        false => line
            .split(style.delimiter.trim_matches(' '))
            .map(|field| field.trim_matches([' ', '\t', '\x0c']))
            .collect(),
    };
    // A delimiter behind every row adds an empty column.
    let width = columns.len() + (style.trailing && !is_blank) as usize;
    if fields.len() == width + 1 && fields.last() == Some(&"") {
        fields.pop();
    }
    if fields.len() != width {
        return Plain::Odd;
    }
    let number = |text: &str| {
        let has_fraction =
            |(_, fraction): (&str, &str)| fraction.starts_with(|c: char| c.is_ascii_digit());
        let text = match style.decimal {
            ',' if text.contains('.')
                || text.split_once(',').is_some_and(|parts| !has_fraction(parts)) =>
            {
                return None;
            }
            ',' => text.replacen(',', ".", 1),
            _ => text.into(),
        };
        let text = if text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) {
            text.replace(['d', 'D'], "e")
        } else {
            text
        };
        text.parse::<f64>().ok()
    };
    let axis = |axis: usize| {
        columns
            .iter()
            .position(|column| *column == Column::Axis(axis))
            .and_then(|place| number(fields[place]))
    };
    match [axis(0), axis(1), axis(2)] {
        [Some(x), Some(y), Some(z)]
            if [x, y, z].iter().all(|v| v.is_finite() && !(1e37..=3.5e38).contains(&v.abs())) =>
        {
            Plain::Row([x, y, z])
        }
        _ => Plain::Odd,
    }
}

/// A byte changed, some removed, or one inserted; where, which, and how many.
type Edit = (usize, prop::sample::Index, u8, usize);

#[test]
fn what_damage_changes_is_said_or_is_what_the_damaged_line_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.txt");
    let [exact, said, refused] = [(); 3].map(|()| Cell::new(0));
    let bytes =
        prop_oneof![prop::sample::select(&b"0123456789.,;-+eD \t\n\r\"#/x\0\xff"[..]), any::<u8>()];
    let edits =
        prop::collection::vec((0..3usize, any::<prop::sample::Index>(), bytes, 1..30usize), 1..4);
    let test = |((style, columns, rows), edits): (Written, Vec<Edit>)| {
        let decimal = if style.delimiter.contains(',') { '.' } else { style.decimal };
        let style = Style { encoding: Encoding::Utf8, quotes: Quotes::None, decimal, ..style };
        let mut text = style.write(&columns, &rows);
        std::fs::write(&path, &text).unwrap();
        let options = ReadOptions::new(ColumnSet::ALL, false);
        let whole = cloud::read(std::slice::from_ref(&path), &options, &Silent);
        for (kind, at, byte, length) in edits {
            let at = at.index(text.len().max(1)).min(text.len());
            match kind {
                0 if at < text.len() => text[at] = byte,
                1 => drop(text.drain(at..(at + length).min(text.len()))),
                _ => text.insert(at, byte),
            }
        }
        std::fs::write(&path, &text).unwrap();
        let cloud = match cloud::read(std::slice::from_ref(&path), &options, &Silent) {
            Ok(cloud) => cloud,
            Err(_) => {
                refused.set(refused.get() + 1);
                return Ok(());
            }
        };
        let lossy = String::from_utf8_lossy(&text).into_owned();
        // If another table was found, its note reports it. The reference does not handle quotes.
        if !whole.is_ok_and(|whole| whole.notes[0] == cloud.notes[0]) || lossy.contains('"') {
            said.set(said.get() + 1);
            return Ok(());
        }
        let lines = lossy.split(['\n', '\r']).enumerate();
        let first = lines
            .clone()
            .find(|(_, line)| matches!(plainly(line, &style, &columns), Plain::Row(_)))
            .map_or(0, |(place, _)| place);
        let plain: Vec<Plain> =
            lines.skip(first).map(|(_, line)| plainly(line, &style, &columns)).collect();
        let rows: Vec<[f64; 3]> = plain
            .iter()
            .filter_map(|plain| if let Plain::Row(row) = plain { Some(*row) } else { None })
            .collect();
        let odd = plain.iter().filter(|plain| **plain == Plain::Odd).count();
        let places = world(&cloud);
        let step = cloud.parts[0].lattice.step;
        let same = places.len() == rows.len()
            && places.iter().zip(&rows).all(|(read, row)| {
                let off = (*read - DVec3::from_array(*row)).abs();
                off.cmple(step * 0.500001 + 1e-12 * read.abs()).all()
            });
        let about = || {
            format!(
                "{} points of {rows:?}, {odd} odd: {:?}\n{style:?}\n{lossy}",
                places.len(),
                cloud.notes
            )
        };
        prop_assert!(same, "{}", about());
        let tells = ["skipped", "passed over", "count lines declare"]
            .iter()
            .any(|words| says(&cloud, words));
        prop_assert!(odd == 0 || tells, "{}", about());
        exact.set(exact.get() + 1);
        Ok(())
    };
    run(1000, &(table(), edits), test);
    println!(
        "of 1000 damaged tables {} are what their lines say, {} are other tables, {} are refused",
        exact.get(),
        said.get(),
        refused.get()
    );
    assert!(exact.get() > 500);
}
