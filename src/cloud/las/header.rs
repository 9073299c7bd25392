//! The LAS header and its variable-length records, parsed without a library.
//!
//! Libraries allocate by these fields before they check them (las-rs #149), and refuse good points
//! for a bad projection record. Every field that controls reading is therefore checked here, and
//! every other one is only reported.

use crate::cloud::crs::{Crs, geotiff, wkt};
use crate::cloud::digits::number;
use crate::cloud::input::Input;
use crate::cloud::{ColumnSet, Header, Lattice};
use crate::error::Result;
use glam::DVec3;

/// Fields that control the reading of points.
pub struct Layout {
    pub minor: u8,
    pub format: u8,
    pub compressed: bool,
    pub record_bytes: usize,
    pub points_at: u64,
    /// Number of points in the header.
    pub points: u64,
    pub lattice: Lattice,
    /// XOR masks of coordinates: all bits along axes with a negative scale.
    pub flips: [i32; 3],
    /// Statements of the header that the file contradicts.
    pub lies: Vec<String>,
    /// Beginning of extended records or waveforms, if stated: bytes from there on are not points.
    pub tail_at: Option<u64>,
    /// Contents of the laszip record.
    pub laszip: Option<Vec<u8>>,
    /// Declared extra bytes that the records have room for, in order.
    pub extra_bytes: Vec<ExtraBytes>,
    pub copc: bool,
    pub header: Header,
    /// What a file with some of the points takes over.
    pub kept: Kept,
    /// Columns that the fields of records fill, if their format has these.
    pub holds: ColumnSet,
}

/// A variable-length record.
#[derive(Clone, Debug, PartialEq)]
pub struct Vlr {
    pub user: String,
    pub record: u16,
    pub description: String,
    pub data: Vec<u8>,
}

/// Fields and records of a header that say what points mean, in the file's own bytes.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    pub file_source: u16,
    pub global_encoding: u16,
    pub system: String,
    /// Variable-length records, without those about compression.
    pub records: Vec<Vlr>,
    /// True if there are records behind the points that are not kept.
    pub has_more: bool,
}

/// Smallest record of each point format `[bytes]`.
const RECORD_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Returns the bytes of a point format, without extra bytes.
pub fn record_bytes(format: u8) -> u16 {
    RECORD_BYTES[format as usize]
}

impl Layout {
    /// Returns the extra bytes of a record.
    pub fn extra_width(&self) -> usize {
        self.record_bytes - RECORD_BYTES[self.format as usize] as usize
    }

    /// Tests whether records have extra bytes that are not numbers with a name.
    pub fn has_unnamed_bytes(&self) -> bool {
        let numbers = self.extra_bytes.iter().filter(|extra| extra.is_number());
        numbers.map(|extra| extra.bytes).sum::<usize>() < self.extra_width()
    }
}

const VLR_HEADER_BYTES: u64 = 54;

pub fn read(input: &Input, notes: &mut Vec<String>) -> Result<Layout> {
    let head = input.take(0, 375)?;
    if head.len() < 227 {
        return Err(input.wrong(format!(
            "has {} bytes, but a LAS header has at least 227; it is truncated or not LAS",
            head.len()
        )));
    }
    let (major, minor) = (head[24], head[25]);
    if major != 1 || minor > 5 {
        return Err(input.wrong(format!("is LAS {major}.{minor}; supported are 1.0 to 1.5")));
    }
    let header_bytes = u16_at(&head, 94) as u64;
    let points_at = u32_at(&head, 96) as u64;
    let format = head[104] & 0x3f;
    let compressed = head[104] & 0xc0 != 0;
    let record_bytes = u16_at(&head, 105);
    let Some(&least) = RECORD_BYTES.get(format as usize) else {
        return Err(input.wrong(format!("has point format {format}; supported are 0 to 10")));
    };
    if record_bytes < least {
        return Err(input.wrong(format!("declares {record_bytes} bytes per point, but point format {format} needs {least}; the header is damaged")));
    }
    if points_at < 227 || points_at > input.length {
        return Err(input.wrong(format!(
            "declares that points begin at byte {points_at} of {}; the header is damaged or the file is truncated",
            input.length
        )));
    }
    let least_header = [227, 227, 227, 235, 375, 375][minor as usize];
    let has_wide_count = minor >= 4 && header_bytes >= 375 && head.len() >= 375;
    let legacy = u32_at(&head, 107) as u64;
    let points = match has_wide_count.then(|| u64_at(&head, 247)) {
        Some(count) if count != 0 => count,
        _ => legacy,
    };
    let (lattice, flips) = lattice(input, &head, notes)?;
    let tail_at = [
        (minor >= 3 && head.len() >= 235).then(|| u64_at(&head, 227)),
        has_wide_count.then(|| u64_at(&head, 235)),
    ]
    .into_iter()
    .flatten()
    .filter(|&at| at > points_at && at <= input.length)
    .min();

    let mut layout = Layout {
        minor,
        format,
        compressed,
        record_bytes: record_bytes as usize,
        points_at,
        points,
        lattice,
        flips,
        lies: Vec::new(),
        tail_at,
        laszip: None,
        extra_bytes: Vec::new(),
        copc: false,
        header: Header::default(),
        kept: Kept {
            file_source: u16_at(&head, 4),
            global_encoding: u16_at(&head, 6),
            system: text(&head[26..58]),
            ..Kept::default()
        },
        holds: ColumnSet::ALL,
    };
    let (mut facts, mut projection) = (Vec::new(), Projection::default());
    for (what, range) in [("system", 26..58), ("software", 58..90)] {
        push_fact(&mut facts, what, &head[range]);
    }
    if u16_at(&head, 92) != 0 {
        facts.push((
            "created".into(),
            format!("day {} of {}", u16_at(&head, 90), u16_at(&head, 92)),
        ));
    }
    let first_vlr = if header_bytes >= least_header && header_bytes <= points_at {
        header_bytes
    } else {
        least_header
    };
    let declared =
        vlrs(input, first_vlr, u32_at(&head, 100), &mut layout, &mut facts, &mut projection)?;
    let room = layout.record_bytes - least as usize;
    if declared < room {
        let spare = room - declared;
        layout.lies.push(format!("has {spare} more bytes per point than point format {format} and its extra bytes need; they are ignored"));
    }
    // Points with return number 0 are in no count, so counts by return never exceed the total.
    let narrow: u64 = (0..5).map(|k| u32_at(&head, 111 + 4 * k) as u64).sum();
    let wide = (0..if has_wide_count { 15 } else { 0 })
        .fold(0u64, |sum, k| sum.saturating_add(u64_at(&head, 255 + 8 * k)));
    if narrow.max(wide) > points {
        layout.lies.push(format!(
            "declares {points} points (number of point records), but {} by return",
            narrow.max(wide)
        ));
    }
    if has_wide_count && legacy != 0 && legacy != points {
        layout.lies.push(format!(
            "declares {points} points (number of point records), but {legacy} in the legacy field"
        ));
    }
    if has_wide_count {
        let (first, count) = (u64_at(&head, 235), u32_at(&head, 243));
        evlrs(input, first, count, &mut layout.kept, &mut facts, &mut projection)?;
    }

    let kind = if layout.copc {
        "COPC"
    } else if compressed {
        "LAZ"
    } else {
        "LAS"
    };
    let bound = |i: usize| f64_at(&head, 179 + 8 * i);
    layout.header = Header {
        format: format!("{kind} 1.{minor} format {format}"),
        points: Some(points),
        bounds: Some([[bound(1), bound(3), bound(5)], [bound(0), bound(2), bound(4)]]),
        facts,
        system: projection.system(),
        ..Header::default()
    };
    Ok(layout)
}

/// Largest coordinate `[steps]`: beyond, neighbouring steps are the same f64.
const MOST_STEPS: f64 = (1u64 << 53) as f64;

/// Returns an error unless every i32 has a distinct position.
pub fn check_lattice(input: &Input, step: DVec3, offset: DVec3) -> Result<()> {
    if !step.is_finite() || step.abs().min_element() == 0.0 {
        return Err(input.wrong(format!(
            "has the scale {}; coordinates need three finite scales other than 0",
            step.to_array().map(number).join(" ")
        )));
    }
    for axis in 0..3 {
        let (name, own) = (["X", "Y", "Z"][axis], offset[axis]);
        let steps = own.abs() / step[axis].abs() + 2f64.powi(31);
        if !(steps <= MOST_STEPS && (own.abs() + step[axis].abs() * 2f64.powi(31)).is_finite()) {
            return Err(input.wrong(format!(
                "has the {name} offset {own:e}, more than 2^53 steps of its scale {:e} from 0: coordinates there cannot be distinguished",
                step[axis]
            )));
        }
    }
    let wrong = Lattice { step: step.abs(), offset }.wrong();
    wrong.map_or(Ok(()), |what| Err(input.wrong(what)))
}

/// Returns the file's scale and offset, if every i32 has a distinct position. A negative scale is
/// replaced by a positive one with the same positions: `!q` steps up instead of `q` down.
fn lattice(input: &Input, head: &[u8], notes: &mut Vec<String>) -> Result<(Lattice, [i32; 3])> {
    let triple =
        |at: usize| DVec3::new(f64_at(head, at), f64_at(head, at + 8), f64_at(head, at + 16));
    let (step, offset) = (triple(131), triple(155));
    check_lattice(input, step, offset)?;
    let negative: Vec<&str> =
        (0..3).filter(|&axis| step[axis] < 0.0).map(|axis| ["x", "y", "z"][axis]).collect();
    if !negative.is_empty() {
        notes.push(format!(
            "{}: the scale of {} is negative; it is used as given",
            input.name(),
            negative.join(" and ")
        ));
    }
    let is_negative = [0, 1, 2].map(|axis| step[axis] < 0.0);
    let upwards =
        |axis: usize| if is_negative[axis] { offset[axis] - step[axis] } else { offset[axis] };
    let lattice =
        Lattice { step: step.abs(), offset: DVec3::new(upwards(0), upwards(1), upwards(2)) };
    Ok((lattice, is_negative.map(|is_negative| -(is_negative as i32))))
}

/// Walks the records between header and points. Returns the number of declared extra bytes. A
/// record that does not fit ends the walk, since points do not depend on it.
fn vlrs(
    input: &Input,
    first: u64,
    count: u32,
    layout: &mut Layout,
    facts: &mut Vec<(String, String)>,
    projection: &mut Projection,
) -> Result<usize> {
    let (mut at, mut extra_bytes) = (first, 0);
    for index in 0..count {
        let head = if at + VLR_HEADER_BYTES <= layout.points_at {
            input.take(at, VLR_HEADER_BYTES)?
        } else {
            Vec::new()
        };
        let fits = head.len() as u64 == VLR_HEADER_BYTES
            && at + VLR_HEADER_BYTES + u16_at(&head, 20) as u64 <= layout.points_at;
        if !fits {
            layout.lies.push(format!(
                "declares {count} variable-length records, but only {index} fit before the points"
            ));
            return Ok(extra_bytes);
        }
        let (user, record, length) =
            (text(&head[2..18]), u16_at(&head, 18), u16_at(&head, 20) as u64);
        let contents = || input.take(at + VLR_HEADER_BYTES, length);
        if user != "laszip encoded" && user != "copc" {
            let (data, description) = (contents()?, text(&head[22..54]));
            layout.kept.records.push(Vlr { user: user.clone(), record, description, data });
        }
        match (user.as_str(), record) {
            ("laszip encoded", 22204) => layout.laszip = Some(contents()?),
            ("copc", 1) => layout.copc = true,
            ("LASF_Projection", _) => projection.take(record, contents()?, facts),
            ("LASF_Spec", 4) => {
                let declared: Vec<ExtraBytes> =
                    contents()?.chunks_exact(DECLARATION_BYTES).map(ExtraBytes::of).collect();
                extra_bytes += declared.iter().map(|attribute| attribute.bytes).sum::<usize>();
                let room = layout.record_bytes - RECORD_BYTES[layout.format as usize] as usize;
                let ends = declared.iter().scan(0, |end, attribute| {
                    *end += attribute.bytes;
                    Some(*end)
                });
                let fit = ends.take_while(|&end| end <= room).count();
                facts.extend(
                    declared[..fit]
                        .iter()
                        .map(|attribute| ("extra attribute".into(), attribute.title())),
                );
                if fit < declared.len() {
                    let names: Vec<&str> =
                        declared[fit..].iter().map(|attribute| attribute.name.as_str()).collect();
                    layout.lies.push(format!(
                        "declares the extra bytes {}, but its records have room for {room} of {} bytes; those that do not fit are ignored",
                        names.join(", "),
                        declared.iter().map(|attribute| attribute.bytes).sum::<usize>()
                    ));
                }
                layout.extra_bytes.extend(declared.into_iter().take(fit));
            }
            _ => {}
        }
        at += VLR_HEADER_BYTES + length;
    }
    Ok(extra_bytes)
}

/// Coordinate system statements of the records.
#[derive(Default)]
struct Projection {
    wkt: Option<Vec<u8>>,
    geotiff: geotiff::Records,
}

impl Projection {
    fn take(&mut self, record: u16, contents: Vec<u8>, facts: &mut Vec<(String, String)>) {
        match record {
            2112 => {
                push_fact(facts, "coordinate system", &contents);
                self.wkt = Some(contents);
            }
            34735 => self.geotiff.keys = contents,
            34736 => self.geotiff.numbers = contents,
            34737 => {
                push_fact(facts, "coordinate system", &contents);
                self.geotiff.texts = contents;
            }
            _ => {}
        }
    }

    /// Returns the system. WKT is preferred to keys, which say less.
    fn system(&self) -> Option<Crs> {
        let text = self.wkt.as_ref().and_then(|text| wkt::parse(&String::from_utf8_lossy(text)));
        text.or_else(|| self.geotiff.system())
    }
}

/// Bytes of a declaration of extra bytes.
pub const DECLARATION_BYTES: usize = 192;

/// A declaration of an extra-bytes attribute.
#[derive(Clone, Debug)]
pub struct ExtraBytes {
    pub name: String,
    pub bytes: usize,
    /// Type of the values, as in the declaration.
    pub kind: u8,
    /// Factor on values, and offset that is added.
    pub scale: f64,
    pub offset: f64,
    /// Bytes of the value that stands for none.
    pub no_data: Option<[u8; 8]>,
}

impl ExtraBytes {
    /// Tests whether it is one number, with a name.
    pub fn is_number(&self) -> bool {
        (1..=10).contains(&self.kind) && !self.name.is_empty()
    }

    /// Returns the name, and why it is not shown if it is not one number.
    fn title(&self) -> String {
        let what = match self.kind {
            0 => format!("{} bytes of no type", self.bytes),
            11..=20 => "two numbers a point".into(),
            21.. => "three numbers a point".into(),
            _ => return self.name.clone(),
        };
        format!("{}: {what}, which --color does not show", self.name)
    }

    /// Returns bytes of the name, or numbers, as declared without a scale.
    pub fn plain(name: &str, kind: u8, bytes: usize) -> ExtraBytes {
        ExtraBytes { name: name.into(), bytes, kind, scale: 1.0, offset: 0.0, no_data: None }
    }

    /// Returns the declaration. Bytes that are no number are at most 255.
    pub fn declared(&self) -> [u8; DECLARATION_BYTES] {
        let mut declared = [0; DECLARATION_BYTES];
        let name = &self.name;
        let end =
            (0..=32.min(name.len())).rev().find(|&end| name.is_char_boundary(end)).unwrap_or(0);
        declared[2] = self.kind;
        declared[4..4 + end].copy_from_slice(&name.as_bytes()[..end]);
        if self.kind == 0 {
            declared[3] = self.bytes as u8;
            return declared;
        }
        let own = [
            (1, 40, self.no_data),
            (8, 112, Some(self.scale.to_le_bytes()).filter(|_| self.scale != 1.0)),
            (16, 136, Some(self.offset.to_le_bytes()).filter(|_| self.offset != 0.0)),
        ];
        for (bit, at, bytes) in own {
            if let Some(bytes) = bytes {
                declared[3] |= bit;
                declared[at..at + 8].copy_from_slice(&bytes);
            }
        }
        declared
    }

    /// Parses a declaration of 192 bytes. Types from 1: eight integers of growing width, two
    /// floats, then the same as pairs and triples.
    fn of(declared: &[u8]) -> ExtraBytes {
        const WIDTHS: [usize; 10] = [1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
        let bytes = match declared[2] as usize {
            0 => declared[3] as usize,
            kind => WIDTHS[(kind - 1) % 10] * ((kind - 1) / 10 + 1).min(3),
        };
        let has = |bit: u8| declared[3] & bit != 0 && declared[2] != 0;
        ExtraBytes {
            name: text(&declared[4..36]),
            bytes,
            kind: declared[2],
            scale: if has(8) { f64_at(declared, 112) } else { 1.0 },
            offset: if has(16) { f64_at(declared, 136) } else { 0.0 },
            no_data: has(1).then(|| array_at(declared, 40)),
        }
    }
}

const EVLR_HEADER_BYTES: u64 = 60;

/// Longest record that is read: longer ones are not about projections.
const PROJECTION_BYTES: u64 = 1 << 20;

/// Walks the records behind the points, only for the coordinate system.
fn evlrs(
    input: &Input,
    first: u64,
    count: u32,
    kept: &mut Kept,
    facts: &mut Vec<(String, String)>,
    projection: &mut Projection,
) -> Result<()> {
    let mut at = first;
    for _ in 0..count.min(MOST_EVLRS) {
        let head = input.take(at, EVLR_HEADER_BYTES)?;
        if head.len() < EVLR_HEADER_BYTES as usize {
            return Ok(());
        }
        let (user, record, length) = (text(&head[2..18]), u16_at(&head, 18), u64_at(&head, 20));
        if user == "LASF_Projection" && length <= PROJECTION_BYTES {
            let contents = input.take(at + EVLR_HEADER_BYTES, length)?;
            let (data, description) = (contents.clone(), text(&head[28..60]));
            // Longer ones do not fit between header and points.
            if u16::try_from(length).is_ok() {
                kept.records.push(Vlr { user, record, description, data });
            }
            projection.take(record, contents, facts);
        } else {
            kept.has_more |= user != "copc";
        }
        let Some(next) = at.checked_add(EVLR_HEADER_BYTES).and_then(|at| at.checked_add(length))
        else {
            return Ok(());
        };
        at = next;
    }
    Ok(())
}

/// Most extended records; a larger count is not believed.
const MOST_EVLRS: u32 = 4096;

fn push_fact(facts: &mut Vec<(String, String)>, what: &str, bytes: &[u8]) {
    let value = text(bytes);
    if !value.is_empty() {
        facts.push((what.into(), value));
    }
}

/// Returns a fixed-width field up to its first zero byte, as printable text.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end])
        .trim()
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

pub fn array_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut value = [0; N];
    value.copy_from_slice(&bytes[at..at + N]);
    value
}

pub fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(array_at(bytes, at))
}

pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array_at(bytes, at))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array_at(bytes, at))
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(array_at(bytes, at))
}
