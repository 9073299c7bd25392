//! XYZ, CSV and TXT -> one part.
//!
//! In: lines of numbers between spaces, tabs, commas or semicolons. Out: positions and whatever the columns are taken for.
//! A line of names decides what a column is; without one the number of columns and the first lines' values do, and a note says what was decided.
//! `#` and `//` begin comments; a single number on the first line is a count (PTS). Lines that do not parse are counted.

use super::floats::{ColorUnit, Floats, Point, Role, there};
use super::input::{Input, Meter};
use super::{Header, Part, ReadOptions, text};
use crate::error::Result;
use crate::progress::Progress;

/// Lines that decide what columns are, where no names do.
const SAMPLE_LINES: usize = 256;

pub fn read(input: &Input, options: &ReadOptions, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Vec<Part>> {
    let start = input.take(0, 64 << 10)?;
    let Plan { roles, named, count } =
        plan(&start).ok_or_else(|| input.wrong("has no line of at least three numbers near its beginning: not a text point cloud"))?;
    let there = there(&roles);
    if !named {
        notes.push(format!("{}: columns taken as {}", input.name(), words(&roles)));
    }
    let meter = Meter::new(progress, input, input.length);
    let mut floats = Floats::new(there, options.wanted, false, false);
    let mut bad = 0;
    let parse = |block: &[u8]| {
        let mut floats = Floats::new(there, options.wanted, false, false);
        let mut bad = 0u64;
        for line in text::lines(block).filter(|line| !is_comment(line)) {
            match point(line, &roles) {
                Some(point) => floats.push(&point),
                None => bad += 1,
            }
        }
        (floats, bad)
    };
    text::parse(input, 0..input.length, &meter, parse, |(block, its_bad), bytes| {
        if floats.len() == 0 {
            floats.reserve((block.len() as u64 * input.length / bytes.max(1) as u64) as usize);
        }
        floats.append(block);
        bad += its_bad;
    })?;
    // The lines of names and of the count are no points, and are known.
    let header_lines = text::lines(&start).filter(|line| !is_comment(line)).take_while(|line| !is_data(line)).count() as u64;
    bad -= header_lines.min(bad);
    if bad > 0 {
        let what = format!("{bad} lines are not points, and were left out");
        if options.strict {
            return Err(input.wrong(what));
        }
        notes.push(format!("{}: {what}", input.name()));
    }
    if let Some(count) = count
        && count != floats.len() as u64 + floats.not_finite
    {
        notes.push(format!("{}: the first line says {count} points, {} could be read", input.name(), floats.len()));
    }
    let header = Header { format: "XYZ".into(), points: count, facts: vec![("columns".into(), words(&roles))], ..Header::default() };
    Ok(vec![floats.into_part(input, header, ColorUnit::Guess, None, notes)])
}

struct Plan {
    roles: Vec<Role>,
    named: bool,
    /// The count on the first line, as PTS files have it.
    count: Option<u64>,
}

fn plan(start: &[u8]) -> Option<Plan> {
    // The last line of the sample may be cut.
    let whole = if start.len() < 64 << 10 { start } else { &start[..start.iter().rposition(|&byte| byte == b'\n').unwrap_or(0)] };
    let mut names = None;
    let mut count = None;
    for line in text::lines(whole) {
        let bare = line.strip_prefix(b"#").or(line.strip_prefix(b"//")).unwrap_or(line);
        if is_data(line) {
            break;
        }
        names = roles_by_name(bare).or(names);
        if count.is_none() && text::fields(line).count() == 1 {
            count = std::str::from_utf8(line).ok().and_then(|text| text.parse().ok());
        }
    }
    let sample: Vec<Vec<f64>> = text::lines(whole)
        .filter(|line| is_data(line))
        .take(SAMPLE_LINES)
        .map(|line| text::fields(line).map_while(text::number).collect())
        .collect();
    let columns = sample.iter().map(Vec::len).min()?;
    let named = names.is_some();
    Some(Plan { roles: names.unwrap_or_else(|| roles_by_values(columns, &sample)), named, count })
}

fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//")
}

fn is_data(line: &[u8]) -> bool {
    !is_comment(line) && text::fields(line).take(3).filter(|field| text::number(field).is_some()).count() == 3
}

fn roles_by_name(line: &[u8]) -> Option<Vec<Role>> {
    let roles: Vec<Role> = text::fields(line)
        .map(|field| {
            let name = String::from_utf8_lossy(field).trim_matches(['"', '\'', '/', '#']).to_lowercase();
            match name.as_str() {
                "x" | "easting" | "east" => Role::Position(0),
                "y" | "northing" | "north" => Role::Position(1),
                "z" | "height" | "elevation" | "altitude" => Role::Position(2),
                "r" | "red" => Role::Color(0),
                "g" | "green" => Role::Color(1),
                "b" | "blue" => Role::Color(2),
                "nx" | "normal_x" | "normalx" => Role::Normal(0),
                "ny" | "normal_y" | "normaly" => Role::Normal(1),
                "nz" | "normal_z" | "normalz" => Role::Normal(2),
                "i" | "intensity" | "scalar_intensity" | "reflectance" => Role::Intensity,
                "class" | "classification" | "label" => Role::Class,
                _ => Role::Other,
            }
        })
        .collect();
    (0..3).all(|i| roles.contains(&Role::Position(i))).then_some(roles)
}

/// x y z, then by what is left: one is intensity, three are colours or normals, four are intensity and colours, six are both.
fn roles_by_values(columns: usize, sample: &[Vec<f64>]) -> Vec<Role> {
    let triple = |at: usize| {
        let values = || sample.iter().flat_map(|row| &row[at..at + 3]);
        let directions = values().all(|v| v.abs() <= 1.0) && values().any(|&v| v < 0.0);
        if directions { Role::Normal as fn(usize) -> Role } else { Role::Color }
    };
    let mut roles: Vec<Role> = (0..3).map(Role::Position).collect();
    match columns {
        4 | 5 => roles.push(Role::Intensity),
        6 => roles.extend((0..3).map(triple(3))),
        7 | 8 => {
            roles.push(Role::Intensity);
            roles.extend((0..3).map(triple(4)));
        }
        9.. => {
            roles.extend((0..3).map(triple(3)));
            let second = triple(6);
            if second(0) != roles[3] {
                roles.extend((0..3).map(second));
            }
        }
        _ => {}
    }
    roles.resize(columns.max(3), Role::Other);
    roles
}

fn point(line: &[u8], roles: &[Role]) -> Option<Point> {
    let mut point = Point::default();
    let mut positions = 0;
    for (field, role) in text::fields(line).zip(roles) {
        if *role == Role::Other {
            continue;
        }
        point.set(*role, text::number(field)?);
        positions += matches!(role, Role::Position(_)) as usize;
    }
    (positions == 3).then_some(point)
}

fn words(roles: &[Role]) -> String {
    let word = |role: &Role| match role {
        Role::Position(axis) => ["x", "y", "z"][*axis],
        Role::Color(channel) => ["red", "green", "blue"][*channel],
        Role::Normal(axis) => ["nx", "ny", "nz"][*axis],
        Role::Intensity => "intensity",
        Role::Class => "class",
        Role::Other => "-",
    };
    roles.iter().map(word).collect::<Vec<_>>().join(" ")
}
