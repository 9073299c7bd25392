//! Tables in every style of writers, read back.

use super::{ALL, Column, Values, compare, says};
use pointillist::cloud;
use pointillist::progress::Silent;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};
use std::cell::Cell;

pub(super) type Written = (Style, Vec<Column>, Vec<Values>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    Utf8,
    Marked,
    Little,
    Big,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Heading {
    None,
    Names,
    Quoted,
    Remark(&'static str),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Quotes {
    None,
    Texts,
    All,
}

/// The choices of a writer.
#[derive(Clone, Debug)]
pub(super) struct Style {
    pub(super) delimiter: &'static str,
    pub(super) decimal: char,
    pub(super) heading: Heading,
    pub(super) unit: &'static str,
    /// Which of the common names of a column.
    pub(super) dialect: usize,
    pub(super) encoding: Encoding,
    pub(super) quotes: Quotes,
    /// Text for a missing value.
    pub(super) gap: &'static str,
    pub(super) line_end: &'static str,
    pub(super) ends: bool,
    pub(super) form: Form,
    pub(super) counted: bool,
    pub(super) remarks: bool,
    pub(super) trailing: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
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

    pub(super) fn write(&self, columns: &[Column], rows: &[Values]) -> Vec<u8> {
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

pub(super) fn style() -> impl Strategy<Value = Style> {
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
pub(super) fn columns(named: bool) -> BoxedStrategy<Vec<Column>> {
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

pub(super) fn table() -> impl Strategy<Value = Written> {
    style().boxed().prop_flat_map(|style| {
        let named = style.heading != Heading::None;
        // A table of one point with colours 0 and 1 could be anything.
        (Just(style), columns(named), prop::collection::vec(values(named), 4..24).boxed())
    })
}

/// Runs cases as `proptest!` does, with another report of failures.
pub(super) fn run<S: Strategy>(
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
