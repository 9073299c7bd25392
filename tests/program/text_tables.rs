//! Text tables: they are read as written in any style, or refused with the line; and nothing is
//! lost or guessed without a note.
//!
//! Tables are generated with every choice of writers (delimiter, decimal mark, names, units,
//! encoding, quotes, gaps, line ends, number formats) and read back, every column. Damaged ones are
//! compared with a simple reference. Files of `../shared` have known values.

mod damage;
mod features;
mod known;
mod styles;

use glam::DVec3;
use pointillist::cloud::{self, Cloud, ColumnSet, ReadOptions};
use pointillist::error::Result;
use pointillist::progress::Silent;

const ALL: ReadOptions = ReadOptions::new(ColumnSet::ALL, false);

fn read_as(name: &str, bytes: &[u8], options: &ReadOptions) -> Result<Cloud> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    cloud::read(&[path], options, &Silent)
}

fn read(name: &str, text: &str) -> Cloud {
    read_as(name, text.as_bytes(), &ALL).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(name: &str, text: &str) -> String {
    match read_as(name, text.as_bytes(), &ALL) {
        Ok(cloud) => panic!("read {text:?} as {:?}: {:?}", world(&cloud), cloud.notes),
        Err(error) => error.to_string(),
    }
}

fn world(cloud: &Cloud) -> Vec<DVec3> {
    let points = |part: &cloud::Part| {
        let columns = &part.columns;
        let place = |i: usize| {
            part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from))
        };
        (0..columns.len()).map(place).collect::<Vec<_>>()
    };
    cloud.parts.iter().flat_map(points).collect()
}

fn says(cloud: &Cloud, words: &str) -> bool {
    cloud.notes.iter().any(|note| note.contains(words))
}

// ---- points as written and as read

/// Values of a row; `None` if missing.
#[derive(Clone, Debug, Default, PartialEq)]
struct Values {
    position: [f64; 3],
    rgb: Option<[u8; 3]>,
    intensity: Option<u16>,
    class: Option<u8>,
    number: Option<u8>,
    returns: Option<u8>,
    source: Option<u16>,
    time: Option<f64>,
    normal: Option<[f64; 3]>,
}

/// The columns of rows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    Axis(usize),
    Channel(usize),
    Intensity,
    Class,
    Number,
    Returns,
    Source,
    Time,
    Normal(usize),
    Unknown,
    Text,
}

/// Compares a cloud with rows in every column they have.
fn compare(cloud: &Cloud, rows: &[Values], columns: &[Column]) -> std::result::Result<(), String> {
    let [part] = cloud.parts.as_slice() else { return Err(format!("{} parts", cloud.parts.len())) };
    if part.columns.len() != rows.len() {
        return Err(format!("{} points, not {}", part.columns.len(), rows.len()));
    }
    let read = &part.columns;
    let has = |column: Column| columns.contains(&column);
    let there = read.available();
    let black = rows.iter().all(|row| row.rgb.is_none_or(|rgb| rgb == [0; 3]));
    let flat = rows.iter().all(|row| row.normal.is_none());
    let expected = ColumnSet {
        rgb: has(Column::Channel(0)) && !black,
        intensity: has(Column::Intensity),
        class: has(Column::Class),
        returns: has(Column::Number),
        source: has(Column::Source),
        normal: has(Column::Normal(0)) && !flat,
        gps_time: has(Column::Time),
        ..ColumnSet::default()
    };
    if there != expected {
        return Err(format!("columns {there:?}, not {expected:?}"));
    }
    let least = rows.iter().filter_map(|row| row.intensity).min();
    for (i, (row, place)) in rows.iter().zip(world(cloud)).enumerate() {
        let off = (place - DVec3::from_array(row.position)).abs();
        if !off.cmple(part.lattice.step * 0.500001 + 1e-12 * place.abs()).all() {
            return Err(format!("point {i} at {place}, not {:?}", row.position));
        }
        let differs = |what: &str, read: String, written: String| {
            Err(format!("point {i}: {what} {read}, not {written}"))
        };
        if let Some(rgb) = &read.rgb
            && rgb[i] != row.rgb.unwrap_or_default()
        {
            return differs("colour", format!("{:?}", rgb[i]), format!("{:?}", row.rgb));
        }
        if let Some(intensity) = &read.intensity {
            let [lo, hi] = part.intensity_range;
            let value = lo + (hi - lo) * intensity[i] as f64 / 65535.0;
            let written = row.intensity.or(least).unwrap_or(0) as f64;
            if (value - written).abs() > (hi - lo) / 65535.0 * 0.51 {
                return differs("intensity", value.to_string(), written.to_string());
            }
        }
        if let Some(class) = &read.class
            && class[i] != row.class.unwrap_or(0)
        {
            return differs("class", class[i].to_string(), format!("{:?}", row.class));
        }
        if let Some(returns) = &read.returns {
            let number = row.number.unwrap_or(0);
            let count = if has(Column::Returns) { row.returns.unwrap_or(0) } else { number };
            if returns[i] != number | count << 4 {
                return differs(
                    "returns",
                    format!("{:#x}", returns[i]),
                    format!("{number} of {count}"),
                );
            }
        }
        if let Some(source) = &read.source
            && source[i] != row.source.unwrap_or(0)
        {
            return differs("source", source[i].to_string(), format!("{:?}", row.source));
        }
        if let Some(time) = &read.gps_time
            && time[i].to_bits() != row.time.unwrap_or(f64::NAN).to_bits()
        {
            return differs("time", time[i].to_string(), format!("{:?}", row.time));
        }
        if let Some(normal) = &read.normal
            && normal[i]
                != row.normal.map_or([0; 3], |normal| normal.map(|v| (v * 127.0).round() as i8))
        {
            return differs("normal", format!("{:?}", normal[i]), format!("{:?}", row.normal));
        }
    }
    Ok(())
}
