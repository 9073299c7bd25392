//! Text tables: they are read as written in any style, or refused with the line; and nothing is
//! lost or guessed without a note.
//!
//! Tables are generated with every choice of writers (delimiter, decimal mark, names, units,
//! encoding, quotes, gaps, line ends, number formats) and read back, every column. Damaged ones are
//! compared with a simple reference. Files of `../shared` have known values.

use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::table::{Columns, Delimiter, TextOptions};
use pointillist::cloud::{self, Cloud, ColumnSet, Extra, ReadOptions};
use pointillist::error::Result;
use pointillist::progress::Silent;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};
use std::cell::Cell;
use std::process::Command;

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

// ---- styles of tables

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Utf8,
    Marked,
    Little,
    Big,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Heading {
    None,
    Names,
    Quoted,
    Remark(&'static str),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Quotes {
    None,
    Texts,
    All,
}

/// The choices of a writer.
#[derive(Clone, Debug)]
struct Style {
    delimiter: &'static str,
    decimal: char,
    heading: Heading,
    unit: &'static str,
    /// Which of the common names of a column.
    dialect: usize,
    encoding: Encoding,
    quotes: Quotes,
    /// Text for a missing value.
    gap: &'static str,
    line_end: &'static str,
    ends: bool,
    form: Form,
    counted: bool,
    remarks: bool,
    trailing: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    Fixed,
    Shortest,
    Exponent,
    Fortran,
    Plus,
    /// Integer coordinates.
    Whole,
}

const DIALECTS: usize = 4;

fn name(column: Column, dialect: usize) -> &'static str {
    let of = |names: [&'static str; DIALECTS]| names[dialect];
    match column {
        Column::Axis(0) => of(["x", "X", "Easting", "east"]),
        Column::Axis(1) => of(["y", "Y", "Northing", "lat"]),
        Column::Axis(_) => of(["z", "Z", "Height", "alt"]),
        Column::Channel(0) => of(["r", "Red", "R", "red"]),
        Column::Channel(1) => of(["g", "Green", "G", "green"]),
        Column::Channel(_) => of(["b", "Blue", "B", "blue"]),
        Column::Intensity => of(["intensity", "Intensity", "Reflectance", "scalar_Intensity"]),
        Column::Class => of(["class", "Classification", "classification", "scalar_Classification"]),
        Column::Number => {
            of(["return_number", "ReturnNumber", "TargetIndex", "scalar_Return_Number"])
        }
        Column::Returns => {
            of(["number_of_returns", "NumberOfReturns", "TargetCount", "scalar_Number_Of_Returns"])
        }
        Column::Source => {
            of(["point_source_id", "PointSourceId", "source_id", "scalar_Point_Source_ID"])
        }
        Column::Time => of(["gps_time", "GpsTime", "Timestamp", "scalar_GPS_Time"]),
        Column::Normal(0) => of(["nx", "NormalX", "Nx", "normal_x"]),
        Column::Normal(1) => of(["ny", "NormalY", "Ny", "normal_y"]),
        Column::Normal(_) => of(["nz", "NormalZ", "Nz", "normal_z"]),
        Column::Unknown => of(["illuminance", "Deviation", "PulseWidth", "scalar_C2C"]),
        Column::Text => of(["name", "Label", "PointName", "remark"]),
    }
}

impl Style {
    fn number(&self, value: f64, decimals: usize) -> String {
        let text = match self.form {
            Form::Fixed => format!("{value:.decimals$}"),
            Form::Whole if value.fract() == 0.0 => format!("{value:.0}"),
            Form::Shortest | Form::Whole => value.to_string(),
            Form::Exponent => exponent(value, "e"),
            Form::Fortran => exponent(value, "D"),
            Form::Plus if value >= 0.0 => format!("+{value:.decimals$}"),
            Form::Plus => format!("{value:.decimals$}"),
        };
        text.replace('.', &self.decimal.to_string())
    }

    fn field(&self, column: Column, row: &Values, i: usize) -> String {
        let gap = || self.gap.to_string();
        let whole = |value: Option<u32>| value.map_or_else(gap, |value| value.to_string());
        let text = match column {
            Column::Axis(axis) => self.number(row.position[axis], 3),
            Column::Channel(channel) => whole(row.rgb.map(|rgb| rgb[channel].into())),
            Column::Intensity => whole(row.intensity.map(u32::from)),
            Column::Class => whole(row.class.map(u32::from)),
            Column::Number => whole(row.number.map(u32::from)),
            Column::Returns => whole(row.returns.map(u32::from)),
            Column::Source => whole(row.source.map(u32::from)),
            Column::Time => row.time.map_or_else(gap, |time| self.number(time, 6)),
            Column::Normal(axis) => {
                row.normal.map_or_else(gap, |normal| self.number(normal[axis], 6))
            }
            Column::Unknown => (7 * i + 3).to_string(),
            Column::Text => ["tree", "dead", "P1", "0x1F", "c\u{f4}te"][i % 5].into(),
        };
        let quoted =
            self.quotes == Quotes::All || self.quotes == Quotes::Texts && column == Column::Text;
        if quoted { format!("\"{text}\"") } else { text }
    }

    fn write(&self, columns: &[Column], rows: &[Values]) -> Vec<u8> {
        let mut lines = Vec::new();
        let names = |quote: &str, delimiter: &str| {
            let unit =
                |column: &Column| if matches!(column, Column::Axis(_)) { self.unit } else { "" };
            let named = columns.iter().map(|column| {
                format!("{quote}{}{}{quote}", name(*column, self.dialect), unit(column))
            });
            named.collect::<Vec<_>>().join(delimiter)
        };
        match self.heading {
            Heading::None => {}
            Heading::Names => lines.push(names("", self.delimiter)),
            Heading::Quoted => lines.push(names("\"", self.delimiter)),
            Heading::Remark(mark) => lines.push(format!("{mark}{}", names("", self.delimiter))),
        }
        if self.counted {
            lines.push(rows.len().to_string());
        }
        for (i, row) in rows.iter().enumerate() {
            if self.remarks && i % 3 == 1 {
                lines.push("# made by hand, 1 2 3".into());
                lines.push(String::new());
            }
            let fields: Vec<String> =
                columns.iter().map(|column| self.field(*column, row, i)).collect();
            lines.push(
                fields.join(self.delimiter) + if self.trailing { self.delimiter } else { "" },
            );
        }
        let text = lines.join(self.line_end) + if self.ends { self.line_end } else { "" };
        match self.encoding {
            Encoding::Utf8 => text.into_bytes(),
            Encoding::Marked => ["\u{feff}", &text].concat().into_bytes(),
            Encoding::Little => {
                ["\u{feff}", &text].concat().encode_utf16().flat_map(u16::to_le_bytes).collect()
            }
            Encoding::Big => {
                ["\u{feff}", &text].concat().encode_utf16().flat_map(u16::to_be_bytes).collect()
            }
        }
    }
}

/// Formats as `1.25e+03`.
fn exponent(value: f64, mark: &str) -> String {
    let text = format!("{value:e}");
    let (digits, power) = text.split_once('e').unwrap();
    let power: i32 = power.parse().unwrap();
    format!("{digits}{mark}{}{:02}", if power < 0 { '-' } else { '+' }, power.abs())
}

fn style() -> impl Strategy<Value = Style> {
    let heading = prop_oneof![
        Just(Heading::None),
        Just(Heading::Names),
        Just(Heading::Quoted),
        Just(Heading::Remark("#")),
        Just(Heading::Remark("# ")),
        Just(Heading::Remark("//"))
    ];
    let marks = prop_oneof![
        4 => prop::sample::select(&[",", ";", "\t", " ", ", ", "  "][..]).prop_map(|delimiter| (delimiter, '.')),
        2 => prop::sample::select(&[";", "\t", " ", "; "][..]).prop_map(|delimiter| (delimiter, ',')),
        1 => Just((",", ',')),
    ];
    let encoding = prop_oneof![4 => Just(Encoding::Utf8), 1 => Just(Encoding::Marked), 1 => Just(Encoding::Little), 1 => Just(Encoding::Big)];
    let quotes =
        prop_oneof![3 => Just(Quotes::None), 1 => Just(Quotes::Texts), 1 => Just(Quotes::All)];
    let form = prop_oneof![4 => Just(Form::Fixed), 2 => Just(Form::Shortest), 1 => Just(Form::Exponent), 1 => Just(Form::Fortran), 1 => Just(Form::Plus), 1 => Just(Form::Whole)];
    let (units, gaps, ends) = (
        &["", "", " [m]", "(m)", "[m]", "_m"][..],
        &["", "", "NaN", "n/a", "-", "null"][..],
        &["\n", "\r\n", "\r"][..],
    );
    (
        (marks, heading, prop::sample::select(units), 0..DIALECTS, encoding),
        (quotes, prop::sample::select(gaps), prop::sample::select(ends), any::<bool>(), form),
        (prop::bool::weighted(0.2), prop::bool::weighted(0.2), prop::bool::weighted(0.1)),
    )
        .prop_map(
            |(
                (marks, heading, unit, dialect, encoding),
                (quotes, gap, line_end, ends, form),
                (counted, remarks, trailing),
            )| {
                let (delimiter, decimal) = marks;
                let is_blank = delimiter.trim().is_empty() && delimiter != "\t";
                Style {
                    delimiter,
                    decimal,
                    heading,
                    unit,
                    dialect,
                    encoding,
                    // If commas are everything, quotes tell which are delimiters; behind a blank
                    // they are not quotes.
                    quotes: match quotes {
                        _ if (delimiter, decimal) == (",", ',') => Quotes::All,
                        _ if delimiter.len() > 1 && !is_blank => Quotes::None,
                        quotes => quotes,
                    },
                    gap: if gap.is_empty() && is_blank { "NaN" } else { gap },
                    line_end,
                    ends,
                    form,
                    counted,
                    remarks,
                    trailing,
                }
            },
        )
}

/// Returns columns in some order; unnamed ones in an order that needs no names.
fn columns(named: bool) -> BoxedStrategy<Vec<Column>> {
    let triple = |of: fn(usize) -> Column| (0..3).map(of).collect::<Vec<_>>();
    let position = triple(Column::Axis);
    if !named {
        let groups = [
            vec![],
            vec![Column::Intensity],
            triple(Column::Channel),
            [vec![Column::Intensity], triple(Column::Channel)].concat(),
            [triple(Column::Channel), triple(Column::Normal)].concat(),
        ];
        return (prop::sample::select(groups.to_vec()), 0..6usize)
            .prop_map(move |(group, text)| {
                let mut columns = [position.clone(), group].concat();
                // Words before or behind.
                match text {
                    0 => columns.insert(0, Column::Text),
                    1 => columns.push(Column::Text),
                    _ => {}
                }
                columns
            })
            .boxed();
    }
    let groups = vec![
        triple(Column::Channel),
        triple(Column::Normal),
        vec![Column::Intensity],
        vec![Column::Class],
        vec![Column::Number],
        vec![Column::Number, Column::Returns],
        vec![Column::Source],
        vec![Column::Time],
        vec![Column::Unknown],
        vec![Column::Text],
    ];
    prop::sample::subsequence(groups, 0..=6)
        .prop_map(move |groups| {
            let mut columns = position.clone();
            groups.concat().into_iter().for_each(|column| {
                if !columns.contains(&column) {
                    columns.push(column);
                }
            });
            columns
        })
        .prop_shuffle()
        .boxed()
}

fn values(gaps: bool) -> impl Strategy<Value = Values> {
    let axis = || prop_oneof![-20_000i64..20_000, 500_000_000..500_900_000i64];
    let normals = prop::sample::select(
        &[[1.0, 0.0, 0.0], [0.0, -0.6, 0.8], [-0.28, 0.96, 0.0], [0.0, 0.0, -1.0]][..],
    );
    let bytes = any::<([u8; 3], u16, u8, u16)>();
    (
        prop::array::uniform3(axis()),
        bytes,
        (0..16u8, 0..16u8),
        0..4_000_000_000i64,
        normals,
        any::<[u16; 2]>(),
    )
        .prop_map(
            move |(
                position,
                (rgb, intensity, class, source),
                (number, returns),
                time,
                normal,
                masks,
            )| {
                let missing = if gaps { masks[0] & masks[1] } else { 0 };
                let is_there = |bit: u16| missing >> bit & 1 == 0;
                Values {
                    position: position.map(|v| v as f64 / 1000.0),
                    rgb: is_there(0).then_some(rgb),
                    intensity: is_there(1).then_some(intensity),
                    class: is_there(2).then_some(class),
                    number: is_there(3).then_some(number),
                    returns: is_there(4).then_some(returns),
                    source: is_there(5).then_some(source),
                    time: is_there(6).then_some(time as f64 / 1e3),
                    normal: is_there(7).then_some(normal),
                }
            },
        )
}

/// Returns a row without gaps.
fn full() -> Values {
    Values {
        position: [0.0; 3],
        rgb: Some([200, 100, 50]),
        intensity: Some(9),
        class: Some(6),
        number: Some(1),
        returns: Some(2),
        source: Some(7),
        time: Some(1.5),
        normal: Some([0.0, -0.6, 0.8]),
    }
}

fn table() -> impl Strategy<Value = Written> {
    style().boxed().prop_flat_map(|style| {
        let named = style.heading != Heading::None;
        // A table of one point with colours 0 and 1 could be anything.
        (Just(style), columns(named), prop::collection::vec(values(named), 4..24).boxed())
    })
}

/// Runs cases as `proptest!` does, with another report of failures.
fn run<S: Strategy>(
    count: u32,
    strategy: &S,
    test: impl Fn(S::Value) -> std::result::Result<(), TestCaseError>,
) {
    let config = Config {
        cases: count,
        failure_persistence: None,
        max_shrink_iters: 500,
        ..Config::default()
    };
    let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    match TestRunner::new_with_rng(config, random).run(strategy, test) {
        Err(TestError::Fail(why, _)) => panic!("{why}"),
        outcome => outcome.unwrap_or_else(|error| panic!("{error}")),
    }
}

#[test]
fn tables_are_read_as_written_or_refused_with_the_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.txt");
    let refusals = Cell::new(0);
    let test = |(style, columns, mut rows): Written| {
        // An entirely missing column is one of words; integer intensities up to 1 are fractions.
        rows[0] = Values { position: rows[0].position, ..full() };
        if style.form == Form::Whole {
            rows.iter_mut().for_each(|row| row.position = row.position.map(f64::round));
        }
        let bytes = style.write(&columns, &rows);
        std::fs::write(&path, &bytes).unwrap();
        let text = || String::from_utf8_lossy(&bytes).into_owned();
        match cloud::read(std::slice::from_ref(&path), &ALL, &Silent) {
            Ok(cloud) => {
                compare(&cloud, &rows, &columns).map_err(|what| {
                    TestCaseError::fail(format!(
                        "{what}\n{:?}\n{:?}\n{}",
                        style,
                        cloud.notes,
                        text()
                    ))
                })?;
                prop_assert!(says(&cloud, "fields between"), "{:?}", cloud.notes);
                let gaps =
                    rows.iter().any(|row| row.class.is_none()) && columns.contains(&Column::Class);
                prop_assert!(
                    !gaps || says(&cloud, "without a value"),
                    "{:?}\n{}",
                    cloud.notes,
                    text()
                );
                prop_assert!(!says(&cloud, "skipped"), "{:?}\n{}", cloud.notes, text());
            }
            Err(error) => {
                refusals.set(refusals.get() + 1);
                prop_assert!(error.to_string().contains("line "), "{error}");
                prop_assert!(style.form == Form::Whole, "{error}\n{style:?}\n{}", text());
                prop_assert!(
                    error.to_string().contains("two meanings"),
                    "{error}\n{style:?}\n{}",
                    text()
                );
            }
        }
        Ok(())
    };
    run(10_000, &table(), test);
    println!("{} of 10000 refused", refusals.get());
    assert!((1..200).contains(&refusals.get()), "{} of 10000 refused", refusals.get());
}

// ---- damage

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

type Written = (Style, Vec<Column>, Vec<Values>);

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

// ---- single features

fn points(cloud: &Cloud) -> Vec<[f64; 3]> {
    world(cloud).iter().map(DVec3::to_array).collect()
}

#[test]
fn two_meanings_are_an_error_that_shows_both() {
    let error = refused("a.csv", "500000,5,5000000,25,100,75\n500001,5,5000001,25,101,75\n");
    for part in [
        "line 1",
        "500000,5,5000000,25,100,75",
        "500000 5 5000000",
        "500000.5 5000000.25 100.75",
        "--delimiter",
    ] {
        assert!(error.contains(part), "{error}");
    }
    // One of them contradicts the line.
    let cloud = read("b.csv", "x,y,z\n500000,5,5000000,25,100,75\n");
    assert_eq!(points(&cloud), [[500000.5, 5000000.25, 100.75]]);
    assert!(says(&cloud, "decimal commas"), "{:?}", cloud.notes);
    let cloud = read("c.csv", "x,y,z,r,g,b\n1,5,5,25,100,75\n");
    assert_eq!(points(&cloud), [[1.0, 5.0, 5.0]]);
    // No fraction is below 0, and no integer is written as 05.
    assert_eq!(points(&read("d.csv", "1,-5,5,25,100,75\n")), [[1.0, -5.0, 5.0]]);
    assert_eq!(points(&read("e.csv", "1,05,5,25,100,75\n")), [[1.05, 5.25, 100.75]]);
    // One name fewer than fields, as in tables with numbered rows.
    let error = refused("f.txt", "x y z\n1 0.5 0.6 0.7\n2 1.5 1.6 1.7\n");
    assert!(
        error.contains("line 1 names 3 columns, but rows have 4 fields")
            && error.contains("--columns"),
        "{error}"
    );
    let error = refused("g.csv", "x,y,intensity\n1,2,3\n");
    assert!(error.contains("names x and y, but not all"), "{error}");
}

fn with(columns: Option<&str>, delimiter: Option<&str>) -> ReadOptions {
    let text = TextOptions {
        columns: columns.map(|text| text.parse::<Columns>().unwrap()),
        delimiter: delimiter.map(|text| text.parse::<Delimiter>().unwrap()),
        scalar: None,
    };
    ReadOptions { text, ..ALL }
}

#[test]
fn columns_that_are_no_part_of_a_point_are_attributes_of_their_own() {
    let text = "x,y,z,Planarity (0.1),name,depth\n1,2,3,0.25,a,\n2,3,4,-0.5,b,7\n3,4,5,0.75,c,9\n";
    let options = ReadOptions { extras: true, ..ALL };
    let cloud = read_as("a.csv", text.as_bytes(), &options).unwrap();
    let extra = |name: &str, min: f64, max: f64, missing: u64| Extra {
        name: name.into(),
        min: Some(min),
        max: Some(max),
        missing,
    };
    assert_eq!(
        cloud.parts[0].header.extras,
        [extra("Planarity (0.1)", -0.5, 0.75, 0), extra("depth", 7.0, 9.0, 1)]
    );
    assert!(says(&cloud, "text that is not kept: \"name\""), "{:?}", cloud.notes);
    // One of them is intensity if requested, also by a name as other programs write it.
    for name in ["Planarity (0.1)", "scalar_planarity", "column 4"] {
        let scalar = ReadOptions {
            text: TextOptions { scalar: Some(name), ..TextOptions::NONE },
            ..options
        };
        let read = read_as(
            "a.csv",
            text.replace(
                "Planarity (0.1)",
                if name == "column 4" { "" } else { "Planarity (0.1)" },
            )
            .as_bytes(),
            &scalar,
        );
        let part = &read.unwrap_or_else(|error| panic!("{error}")).parts[0];
        assert_eq!(
            (part.intensity_range, part.columns.intensity.as_deref()),
            ([-0.5, 0.75], Some(&[39321, 0, 65535][..])),
            "{name}"
        );
        assert_eq!(part.header.extras.len(), 1);
    }
    for (name, why) in [
        ("none", "it has x, y, z, Planarity (0.1), name, depth"),
        ("name", "it is text"),
        ("x", "it is a coordinate"),
    ] {
        let scalar = ReadOptions {
            text: TextOptions { scalar: Some(name), ..TextOptions::NONE },
            ..options
        };
        let error = read_as("a.csv", text.as_bytes(), &scalar).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}

#[test]
fn strictly_nothing_is_guessed_and_nothing_is_lost() {
    let strictly = |text: &str, columns: Option<&str>| {
        let options = ReadOptions { strict: true, ..with(columns, None) };
        read_as("a.txt", text.as_bytes(), &options)
            .map(|cloud| cloud.len())
            .map_err(|error| error.to_string())
    };
    for (text, why) in [
        ("1 2 3 40\n2 3 4 50\n", "could be x y z intensity"),
        ("x,y,z,name\n1,2,3,a\n2,3,4,b\n", "not kept: \"name\""),
        ("a,b,c,intensity\n1,2,3,4\n2,3,4,5\n", "names no x, y and z in line 1"),
    ] {
        let error = strictly(text, None).unwrap_err();
        assert!(error.contains(why) && error.contains("--columns"), "{error}");
        assert_eq!(strictly(text, Some("x,y,z,-")), Ok(2));
    }
    assert_eq!(strictly("1 2 3\n2 3 4\n", None), Ok(2));
    assert_eq!(strictly("x,y,z,planarity\n1,2,3,0.5\n2,3,4,0.5\n", None), Ok(2));
}

#[test]
fn decimals_stay_the_decimals_they_are() {
    let cloud = read(
        "a.xyz",
        "500000.001 5000000.25 97.5\n500019.999 5000019.998 103\n500007.5 5000001 98\n",
    );
    let part = &cloud.parts[0];
    assert_eq!(
        (part.lattice.step, part.lattice.offset),
        (DVec3::splat(0.001), DVec3::new(500000.001, 5000000.25, 97.5))
    );
    assert_eq!(part.columns.x, [0, 19998, 7499]);
    // Steps are powers of two if that loses nothing, and if there are more digits than steps.
    assert_eq!(read("b.xyz", "0.5 0.25 0\n1 2 3\n").parts[0].lattice.step, DVec3::splat(0.25));
    let many = read("c.xyz", "0.123456789012345 0 0\n1000 1 1\n");
    assert_eq!(many.parts[0].lattice.step.x.log2().fract(), 0.0);
}

#[test]
fn what_is_asked_for_is_not_found_out() {
    let ambiguous = b"500000,5,5000000,25,100,75\n";
    let read = |bytes: &[u8], options: ReadOptions| {
        read_as("a.txt", bytes, &options).unwrap_or_else(|error| panic!("{error}"))
    };
    assert_eq!(points(&read(ambiguous, with(None, Some(",")))), [[500000.0, 5.0, 5000000.0]]);
    assert_eq!(
        points(&read(ambiguous, with(Some("x,y,z"), None))),
        [[500000.5, 5000000.25, 100.75]]
    );
    assert_eq!(
        points(&read(ambiguous, with(Some("x,y,z,r,g,b"), None))),
        [[500000.0, 5.0, 5000000.0]]
    );
    let cloud = read(b"z y x\n3 2 1 9 200 100 50\n", with(Some("x,y,z,-,red,green,blue"), None));
    assert_eq!(points(&cloud), [[3.0, 2.0, 1.0]]);
    assert_eq!(cloud.parts[0].columns.rgb, Some(vec![[200, 100, 50]]));
    assert!(
        cloud.parts[0].columns.intensity.is_none()
            && says(&cloud, "columns as asked for: x y z - red green blue"),
        "{:?}",
        cloud.notes
    );
    let cloud = read(b"id;x;y;z\n1;1,5;2,5;3,5\n", with(Some("-,y,x,z"), Some(";")));
    assert_eq!(points(&cloud), [[2.5, 1.5, 3.5]]);
    let error =
        read_as("a.txt", b"1 2 3\n", &with(Some("x,y,z,intensity"), None)).unwrap_err().to_string();
    assert!(error.contains("4 columns that were asked for") && error.contains("1 2 3"), "{error}");
    for wrong in ["x,y", "x,y,z,w", "x,y,z,x", ""] {
        assert!(wrong.parse::<Columns>().is_err(), "{wrong}");
    }
    assert!("|".parse::<Delimiter>().is_err());
}

#[test]
fn names_are_known_whatever_stands_around_them() {
    let cloud = read("a.txt", "Point ID X [m] Y [m] Z [m] Gps Time\n7 1 2 3 1000.5\n");
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0]]);
    assert_eq!(cloud.parts[0].columns.gps_time, Some(vec![1000.5]));
    assert!(
        cloud.parts[0]
            .header
            .facts
            .contains(&("names".into(), "Point ID, X [m], Y [m], Z [m], Gps Time".into()))
    );
    // Latin-1, a directive of Excel, a line of units, row numbers without a name.
    let latin = b"sep=;\nRechtswert;Hochwert;H\xF6he\nm;m;m\n1,5;2,5;3,5\n";
    let cloud = read_as("b.csv", latin, &ALL).unwrap();
    assert_eq!(points(&cloud), [[1.5, 2.5, 3.5]]);
    assert!(says(&cloud, "2 lines before them passed over"), "{:?}", cloud.notes);
    assert_eq!(
        points(&read("c.csv", ",x,y,z\n0,1,2,3\n1,4,5,6\n")),
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    );
    // Comments may be anything.
    let cloud = read("d.txt", "# x y z of an old church\n1 2 3 10 20 30\n");
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0]]);
    assert!(
        says(
            &cloud,
            "columns are taken as x y z red green blue; line 1 names 7 columns, but rows have 6"
        ),
        "{:?}",
        cloud.notes
    );
    let cloud = read("e.csv", "# x y z r g b\n1,2,3,10,20,30\n");
    assert!(says(&cloud, "by their names in line 1"), "{:?}", cloud.notes);
    let cloud = read("f.csv", "a,b,c,intensity\n1,2,3,7\n4,5,6,9\n");
    assert_eq!(
        (points(&cloud)[1], cloud.parts[0].columns.intensity.clone()),
        ([4.0, 5.0, 6.0], Some(vec![7, 9]))
    );
    assert!(says(&cloud, "no x, y and z among the names in line 1"), "{:?}", cloud.notes);
    // Text of several words, separated by blanks.
    assert_eq!(read("g.txt", "1 2 3 a tree\n4 5 6 grass\n7 8 9 a big tree\n").len(), 3);
}

#[test]
fn lines_that_are_no_rows_are_counted_and_the_first_is_shown() {
    let text =
        "x y z i\r\n1 2 3 4\r\n# remark\r\n\r\n1 2 3\r\n5 6 7 8 9\r\n1 two 3 4\r\n4 5 6 -\r\n";
    let cloud = read("a.txt", text);
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert!(
        says(&cloud, "3 lines are not points and were skipped; line 5: \"1 2 3\": 3 fields, not 4"),
        "{:?}",
        cloud.notes
    );
    assert!(
        says(&cloud, "1 line without a value for \"i\", the first is line 8"),
        "{:?}",
        cloud.notes
    );
    let error = read_as("a.txt", text.as_bytes(), &ReadOptions::new(ColumnSet::ALL, true))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("line 5 is not a row of the table: \"1 2 3\": 3 fields, not 4"),
        "{error}"
    );
    // Missing values of a line that is not a row are not counted.
    let cloud = read("gaps.csv", "x,y,z,i,class\n1,2,3,,5\n4,5,6,\n-1.7e38,0,0,,1\n7,8,9,1,2\n");
    assert!(
        says(&cloud, "1 line without a value for \"i\", the first is line 2"),
        "{:?}",
        cloud.notes
    );
    // Also in a later block.
    let mut long: String = (0..700_000).map(|i| format!("{i}.25 {} -7\n", i % 1000)).collect();
    long += "one two three\n1 2 3\n";
    let cloud = read("long.xyz", &long);
    assert!(says(&cloud, "line 700001: \"one two three\""), "{:?}", cloud.notes);
    // A damaged first row is not a heading.
    let cloud = read("b.xyz", "1.2.3 4 5\n6 7 8\n");
    assert!(
        says(&cloud, "1 line is not a point and was skipped; line 1: \"1.2.3 4 5\""),
        "{:?}",
        cloud.notes
    );
    assert!(says(&read("c.xyz", "a church\n6 7 8\n"), "1 line before them passed over"));
}

#[test]
fn coordinates_that_stand_for_none_are_left_out() {
    let cloud = read(
        "a.xyz",
        "1 2 3\n-1.70141E+38 -1.70141E+38 -1.70141E+38\n4 5 -3.4028234663852886e+38\n1e38 1 1\n7 8 9\n1e30 0 0\n",
    );
    assert_eq!(cloud.len(), 3);
    assert!(
        says(
            &cloud,
            "3 lines without data (coordinates such as -1.70141E+38) were skipped, the first is line 2"
        ),
        "{:?}",
        cloud.notes
    );
}

#[test]
fn counts_are_held_against_what_is_there() {
    let blocks = "2\n1 2 3 -500 10 20 30\n4 5 6 700 40 50 60\n1\n7 8 9 0 70 80 90\n";
    let cloud = read("a.pts", blocks);
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    let part = &cloud.parts[0];
    assert_eq!((part.header.format.as_str(), part.header.points), ("PTS", Some(3)));
    assert_eq!(part.columns.rgb.as_ref().unwrap()[2], [70, 80, 90]);
    // Integers are kept, counted from the least.
    assert_eq!(
        (part.intensity_range, part.columns.intensity.clone()),
        ([-500.0, 65035.0], Some(vec![0, 1200, 500]))
    );
    // The readings of the table and its colours; nothing about counts.
    assert_eq!(cloud.notes.len(), 2, "{:?}", cloud.notes);
    let cloud = read("a.txt", &blocks.replace("1\n7", "5\n7"));
    assert!(says(&cloud, "count lines declare 7 points, 3 could be read"), "{:?}", cloud.notes);
}

const PTX: &str = "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 300 1\n1 0 0 0.5\n0 0 0 0.5\n0 2 0 0.25\n0 0 3 1\n";

#[test]
fn ptx_scans_stand_where_their_matrices_say() {
    let second = PTX
        .replace("100 200 300", "0 0 7")
        .replace("1 0 0 0.5\n0 0 0", "1 0 0 0.5 255 0 9\n0 0 0")
        .lines()
        .collect::<Vec<_>>()
        .join("\r\n");
    let second = second
        .replace("0 0 0 0.5", "0 0 0 0.5 0 0 0")
        .replace("0 2 0 0.25", "0 2 0 0.25 1 2 3")
        .replace("0 0 3 1", "0 0 3 1 4 5 6");
    for name in ["a.ptx", "a.txt", "a.xyz", "a.csv", "a.asc", "a.pts"] {
        let cloud = read(name, &format!("{PTX}{second}\r\n"));
        assert_eq!(cloud.parts.len(), 2, "{:?}", cloud.notes);
        // A quarter turn about z: x is y, and y is -x.
        let places = [
            [100.0, 201.0, 300.0],
            [98.0, 200.0, 300.0],
            [100.0, 200.0, 303.0],
            [0.0, 1.0, 7.0],
            [-2.0, 0.0, 7.0],
            [0.0, 0.0, 10.0],
        ];
        assert_eq!(points(&cloud), places);
        assert_eq!(cloud.parts[0].header.format, "PTX");
        assert_eq!(
            cloud.stations.iter().map(|station| (station.part, station.points)).collect::<Vec<_>>(),
            [(0, 3), (1, 3)]
        );
        assert_eq!(cloud.parts[1].columns.rgb, Some(vec![[255, 0, 9], [1, 2, 3], [4, 5, 6]]));
        assert_eq!(cloud.parts[0].columns.intensity, Some(vec![32768, 16384, 65535]));
        assert!(says(&cloud, "scan 1: 1 of 4 directions hit nothing"), "{:?}", cloud.notes);
    }
    let cut = &PTX[..PTX.len() - 8];
    let cloud = read("cut.ptx", cut);
    assert_eq!(cloud.len(), 2);
    assert!(says(&cloud, "says 4 lines, and has 3"), "{:?}", cloud.notes);
    // With a line missing or too many, the next scan is found where it begins.
    let missing = PTX.replace("0 2 0 0.25\n", "") + PTX;
    let cloud = read("missing.ptx", &missing);
    assert_eq!((cloud.parts.len(), cloud.len()), (2, 5), "{:?}", cloud.notes);
    assert!(says(&cloud, "scan 1: says 4 lines, and has 3"), "{:?}", cloud.notes);
    let many = PTX.replace("0 2 0 0.25\n", "0 2 0 0.25\n0 2 0 0.5\n") + PTX;
    let cloud = read("many.ptx", &many);
    assert_eq!((cloud.parts.len(), cloud.len()), (2, 7), "{:?}", cloud.notes);
    let strict = ReadOptions::new(ColumnSet::ALL, true);
    assert!(
        [missing, many].iter().all(|text| read_as("odd.ptx", text.as_bytes(), &strict).is_err())
    );
    for end in ["\n", "\r\n", "\r"] {
        let cloud = read("rest.ptx", &format!("{PTX}1 2 3 4\n5 6 7 8\n").replace('\n', end));
        let what = "line 15 should begin scan 2, but reads \"1 2 3 4\"; the rest was skipped";
        assert!(says(&cloud, what), "{:?}", cloud.notes);
    }
}

#[test]
fn what_other_text_files_are_is_said() {
    assert!(
        refused("a.asc", "ncols 4\nnrows 2\nxllcorner 0\n1 2 3 4\n5 6 7 8\n")
            .contains("grid of heights")
    );
    let utf16: Vec<u8> = "1 2 3\n4 5 6\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let error = read_as("a.txt", &utf16, &ALL).unwrap_err().to_string();
    assert!(error.contains("UTF-16 without a byte order mark"), "{error}");
    assert!(refused("a.xyz", "nothing here\n").contains("\"nothing here\""));
    // The x of an integer in front is not a coordinate of two that follow a blank: this is not a
    // table with commas.
    assert!(
        refused("b.txt", "1 2 3,4,5,6\n7 8 9,1,2,3\n")
            .contains("no rows of at least three numbers")
    );
}

#[test]
fn decimal_commas_of_ply() {
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let cloud = read("a.ply", &format!("{header}1,5 2,25 -3,125\n4 5 6\n"));
    assert_eq!(points(&cloud), [[1.5, 2.25, -3.125], [4.0, 5.0, 6.0]]);
    assert!(says(&cloud, "decimal commas"), "{:?}", cloud.notes);
    assert_eq!(
        points(&read("b.ply", &format!("{header}1,2,3\n4,5,6\n"))),
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    );
    assert_eq!(read("c.obj", "v 1,5 2,5 3,5\n").len(), 0);
}

// ---- files of known contents

/// A file, its points, their bounds, and the required notes.
type Case = (&'static str, u64, [[f64; 3]; 2], &'static [&'static str]);

const CASES: &[Case] = &[
    (
        "riegl.csv",
        3000,
        [[0.015, 0.004, -2.992], [19.992, 20.0, 2.998]],
        &[
            "intensity \"Reflectance (dB)\"",
            "further attributes, one of which --scalar reads as intensity: \"Point ID\"",
        ],
    ),
    (
        "cc_full.txt",
        3000,
        [[0.015, 0.004, -2.992], [19.992, 20.0, 2.998]],
        &["red \"Rf\"", "nz \"Nz\"", "\"Illuminance (PCV)\""],
    ),
    (
        "units_head.csv",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["x \"X [m]\"", "blue \"B\""],
    ),
    (
        "comma_semi.csv",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["between semicolons, decimal commas"],
    ),
    (
        "comma_space.xyz",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["between spaces, decimal commas"],
    ),
    ("deccomma.ply", 4000, [[0.001, 0.001, 97.0], [19.999, 19.998, 103.0]], &["decimal commas"]),
    (
        "blank_mid.csv",
        3000,
        [[0.003, 0.008, -2.997], [19.996, 19.999, 2.998]],
        &["2000 lines without a value for \"intensity\""],
    ),
    (
        "bom_nohead.xyz",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["taken as x y z"],
    ),
    (
        "hexwords.csv",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["text that is not kept: \"label\""],
    ),
    (
        "name_first.csv",
        3000,
        [[0.003, 0.008, -2.997], [19.996, 19.999, 2.998]],
        &["text that is not kept: \"name\""],
    ),
    (
        "latlon_named.csv",
        3000,
        [[500000.007, 5000000.016, -2.992], [500019.993, 5000020.0, 2.999]],
        &["x \"lon\"", "y \"lat\""],
    ),
    (
        "two_as.txt",
        3600,
        [[500000.0021, 5000000.0053, 97.0024], [500049.9888, 5000019.9936, 103.0]],
        &["200 of 2000 directions hit nothing", "read as PTX"],
    ),
    (
        "nodata.xyz",
        40,
        [[-4.43177, -4.81295, 0.126597], [4.12488, 4.40649, 2.97934]],
        &["1 line without data", "line 41"],
    ),
];

#[test]
fn files_of_other_programs_have_their_values() {
    for (name, points, bounds, words) in CASES {
        let Some(path) = shared(&format!("cases/{name}")) else { return };
        let cloud = cloud::read(&[path], &ALL, &Silent).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(cloud.len(), *points, "{name}");
        let (lo, hi) = cloud.bounds().unwrap();
        for (read, known) in [lo, hi].into_iter().zip(bounds) {
            assert!(
                (read - DVec3::from_array(*known)).abs().max_element() < 2e-6,
                "{name}: {read} {known:?}"
            );
        }
        words.iter().for_each(|words| {
            assert!(says(&cloud, words), "{name}: no word of {words:?}: {:?}", cloud.notes)
        });
        // Decimals are kept.
        assert!(!says(&cloud, "are rounded"), "{name}: {:?}", cloud.notes);
        let columns = &cloud.parts[0].columns;
        match *name {
            "riegl.csv" => assert_eq!(cloud.parts[0].intensity_range, [-19.5, -0.5]),
            "cc_full.txt" => {
                assert!(columns.rgb.as_ref().unwrap().iter().all(|rgb| *rgb == [204, 102, 51]));
                assert!(
                    columns.normal.as_ref().unwrap().iter().all(|normal| *normal == [0, 76, 102])
                );
            }
            "units_head.csv" => assert_eq!(columns.rgb.as_ref().unwrap()[0], [103, 85, 17]),
            "blank_mid.csv" => {
                assert!(columns.rgb.as_ref().unwrap().iter().all(|rgb| *rgb == [200, 100, 50]));
                assert_eq!(columns.intensity.as_ref().unwrap()[0], 2499);
            }
            "two_as.txt" => assert_eq!(cloud.stations.len(), 2),
            _ => {}
        }
    }
}

fn program(words: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_pointillist")).args(words).output().unwrap()
}

/// Reads tables with `info`, `index` and `render`.
#[test]
fn the_program_reads_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    for (name, points, _, words) in CASES {
        let Some(path) = shared(&format!("cases/{name}")) else { return };
        let path = path.to_str().unwrap();
        let info = program(&["info", "--json", path]);
        let report: serde_json::Value =
            serde_json::from_slice(&info.stdout).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(report["points"], *points, "{name}");
        let index = at("index.pnti");
        let made = program(&["index", path, "-o", &index]);
        let drawn = program(&["render", path, "-o", &at("picture.png"), "--size", "64x48"]);
        for (what, output) in [("index", made), ("render", drawn)] {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.success(), "{what} {name}: {said}");
            words.iter().for_each(|words| {
                assert!(said.contains(words), "{what} {name}: no word of {words:?}: {said}")
            });
        }
        let info = program(&["info", "--json", &index]);
        let indexed: serde_json::Value =
            serde_json::from_slice(&info.stdout).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(indexed["points"], *points, "{name}");
    }
}

#[test]
fn columns_and_delimiters_are_options_of_what_reads_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::write(at("a.csv"), "1,5,2,5,3,5\n4,5,5,5,6,5\n").unwrap();
    let refused = program(&["info", &at("a.csv")]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("two meanings"));
    let lists: [&[&str]; 3] = [
        &["info", "--json", &at("a.csv"), "--columns", "x,y,z"],
        &["index", &at("a.csv"), "-o", &at("a.pnti"), "--columns", "x,y,z"],
        &["render", &at("a.csv"), "-o", &at("a.png"), "--size", "64x48", "--columns", "x,y,z"],
    ];
    for words in lists {
        let output = program(words);
        assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let info = program(&["info", "--json", &at("a.pnti")]);
    let indexed: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(indexed["bounds"]["max"], serde_json::json!([4.5, 5.5, 6.5]));
    assert!(program(&["info", &at("a.csv"), "--delimiter", ","]).status.success());
    assert_eq!(program(&["info", &at("a.csv"), "--columns", "x,y"]).status.code(), Some(2));
    assert_eq!(program(&["info", &at("a.csv"), "--delimiter", "|"]).status.code(), Some(2));
}
