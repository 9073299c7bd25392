//! E57: one part per scan.
//!
//! Spherical coordinates are converted and the pose is applied, both in f64; then the points go
//! onto a lattice. The `e57` crate checks pages and unpacks bits. Its raw values become points
//! here, since points marked invalid must be dropped and counted, and limits of colour and
//! intensity are often absent or wrong. Panics of the crate are caught, and files on which it would
//! loop are refused.

use super::catch_panic::catch_panic;
use super::crs;
use super::floats::{ColorUnit, Floats, Point, Role};
use super::from_floats::ReadPart;
use super::input::{Input, Meter};
use super::rgb_range::By;
use super::scalar::{Scalar, Scalars};
use super::{Header, ReadOptions, xml};
use crate::error::Result;
use crate::progress::Progress;
use e57::{E57Reader, PointCloud, RecordDataType, RecordName, RecordValue};
use glam::{DQuat, DVec3};
use std::fs::File;
use std::io::BufReader;

pub fn read(
    input: &Input,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    let open = || {
        // Errors of what cannot be found are the reader's.
        let file = File::open(&input.path).ok();
        let text = file.and_then(|file| E57Reader::raw_xml(BufReader::new(file)).ok());
        text.map_or(Ok(()), |text| xml::check(&text))?;
        E57Reader::from_file(&input.path).map_err(|error| line(&error))
    };
    let mut reader = catch_panic(open)
        .flatten()
        .map_err(|what| input.wrong(format!("cannot be read as E57: {what}")))?;
    let scans = reader.pointclouds();
    if scans.is_empty() {
        notes.push(format!("{}: holds no scan", input.name()));
    }
    let file_facts = file_facts(&reader);
    let mut parts = Vec::new();
    for (index, scan) in scans.iter().enumerate() {
        let name =
            scan.name.clone().unwrap_or_else(|| format!("{} scan {}", input.name(), index + 1));
        let found = points(input, &mut reader, scan, &name, options, progress)?;
        let read = found.floats.len() as u64 + found.floats.not_finite + found.invalid;
        if read < scan.records {
            let what = format!(
                "scan \"{name}\" declares {} points, only {read} could be read: {}",
                scan.records, found.why
            );
            if options.strict || read == 0 {
                return Err(input.wrong(what));
            }
            notes.push(format!("{}: {what}", input.name()));
        }
        if found.invalid > 0 {
            notes.push(format!(
                "{}: {} of {} points of scan \"{name}\" are marked invalid and were skipped",
                input.name(),
                found.invalid,
                scan.records
            ));
        }
        let header = Header {
            format: "E57".into(),
            points: Some(scan.records),
            bounds: bounds(scan),
            facts: file_facts.iter().cloned().chain(scan_facts(scan)).collect(),
            scalars: found.scalars,
            system: reader.coordinate_metadata().and_then(crs::wkt::parse),
            ..Header::default()
        };
        let unit = ColorUnit::Limits(found.color_limits);
        let limits = found.intensity_limits;
        let own = found.floats.into_parts(input, header, unit, limits, progress, notes)?;
        if options.strict && own[0].part.rgb_scale.by == By::Values {
            return Err(input.wrong(format!(
                "scan \"{name}\" declares colour limits that its points do not have"
            )));
        }
        parts.extend(own.into_iter().map(|part| part.named(&name)));
    }
    Ok(parts)
}

struct Found {
    floats: Floats,
    /// Points marked as having no position.
    invalid: u64,
    intensity_limits: Option<[f64; 2]>,
    color_limits: [[f64; 2]; 3],
    /// Names of scalars that can be read.
    scalars: Vec<String>,
    why: String,
}

/// Points between two progress reports.
const STRETCH: u64 = 1 << 14;

fn points(
    input: &Input,
    reader: &mut E57Reader<BufReader<File>>,
    scan: &PointCloud,
    name: &str,
    options: &ReadOptions,
    progress: &dyn Progress,
) -> Result<Found> {
    let shape = Shape::new(scan, options.wanted.scalars);
    let bits: u64 = scan.prototype.iter().map(|record| bits(&record.data_type)).sum();
    if scan.records > 0 && (shape.cartesian.is_none() && shape.spherical.is_none()) {
        return Err(input
            .wrong(format!("scan \"{name}\" has neither x, y, z nor range, azimuth, elevation")));
    }
    // The decoder never ends on records of zero bits.
    if scan.records > 0 && bits == 0 {
        return Err(input.wrong(format!(
            "scan \"{name}\" declares {} points of zero bytes each; the file is damaged",
            scan.records
        )));
    }
    let mut floats =
        Floats::with_roles(&shape.roles(), options.wanted, false, false).spilling(input);
    floats.reserve(scan.records.min(input.length.saturating_mul(8) / bits.max(1)) as usize);
    let intensity_limits = shape.intensity.map(|_| shape.intensity_limits);
    let mut found = Found {
        floats,
        invalid: 0,
        intensity_limits,
        color_limits: shape.color_limits,
        scalars: shape.names.clone(),
        why: String::new(),
    };
    if scan.records == 0 {
        return Ok(found);
    }
    let meter = Meter::new(progress, input, scan.records);
    let mut interrupted = Ok(());
    let outcome = catch_panic(|| {
        let raw = reader.pointcloud_raw(scan).map_err(|error| line(&error))?;
        for (index, values) in raw.enumerate() {
            let mut point = found.floats.point();
            match shape.fill(&mut point, scan, &values.map_err(|error| line(&error))?) {
                Some(()) => found.floats.push(&point),
                None => found.invalid += 1,
            }
            if index as u64 % STRETCH == STRETCH - 1 {
                interrupted = meter.advance(STRETCH);
                if interrupted.is_err() {
                    break;
                }
            }
        }
        Ok(())
    })
    .flatten();
    interrupted?;
    found.why = outcome.err().unwrap_or_default();
    Ok(found)
}

/// The fields of a scan's records, and their conversion.
struct Shape {
    cartesian: Option<[usize; 3]>,
    cartesian_state: Option<usize>,
    spherical: Option<[usize; 3]>,
    spherical_state: Option<usize>,
    color: Option<[usize; 3]>,
    color_state: Option<usize>,
    color_limits: [[f64; 2]; 3],
    intensity: Option<usize>,
    intensity_state: Option<usize>,
    intensity_limits: [f64; 2],
    /// Fields that are taken as they are, with what is added to their values.
    plain: Vec<(usize, Role, f64)>,
    time_state: Option<usize>,
    /// Names of scalars that can be read.
    names: Vec<String>,
    rotation: DQuat,
    translation: DVec3,
}

impl Shape {
    fn new(scan: &PointCloud, wanted: Scalars) -> Self {
        let find = |name: RecordName| scan.prototype.iter().position(|record| record.name == name);
        let triple = |a, b, c| Some([find(a)?, find(b)?, find(c)?]);
        let color = triple(RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue);
        let intensity = find(RecordName::Intensity);
        let stated = scan.color_limits.as_ref();
        let limits =
            |channel: usize, stated: Option<(&Option<RecordValue>, &Option<RecordValue>)>| {
                limits(color.map(|indices| &scan.prototype[indices[channel]].data_type), stated)
            };
        let color_limits = [
            limits(0, stated.map(|limits| (&limits.red_min, &limits.red_max))),
            limits(1, stated.map(|limits| (&limits.green_min, &limits.green_max))),
            limits(2, stated.map(|limits| (&limits.blue_min, &limits.blue_max))),
        ];
        let stated = scan
            .intensity_limits
            .as_ref()
            .map(|limits| (&limits.intensity_min, &limits.intensity_max));
        let intensity_limits =
            self::limits(intensity.map(|index| &scan.prototype[index].data_type), stated);
        let (rotation, translation) = pose(scan);
        let (mut plain, mut names, mut read) = (Vec::new(), Vec::new(), 0);
        for (index, record) in scan.prototype.iter().enumerate() {
            let (role, added) = match role(scan, &record.name) {
                (Role::Scalar(scalar, _), added) => {
                    names.push(scalar.to_string());
                    let asked = match scalar {
                        Scalar::Extra(name) => wanted.named(name),
                        own => wanted.has(own).then_some(own),
                    };
                    let Some(asked) = asked else { continue };
                    read += 1;
                    (Role::Scalar(asked, read - 1), added)
                }
                (Role::Other, _) => continue,
                named => named,
            };
            plain.push((index, role, added));
        }
        Self {
            cartesian: triple(
                RecordName::CartesianX,
                RecordName::CartesianY,
                RecordName::CartesianZ,
            ),
            cartesian_state: find(RecordName::CartesianInvalidState),
            spherical: triple(
                RecordName::SphericalRange,
                RecordName::SphericalAzimuth,
                RecordName::SphericalElevation,
            ),
            spherical_state: find(RecordName::SphericalInvalidState),
            color,
            color_state: find(RecordName::IsColorInvalid),
            color_limits,
            intensity,
            intensity_state: find(RecordName::IsIntensityInvalid),
            intensity_limits,
            plain,
            time_state: find(RecordName::IsTimeStampInvalid),
            names,
            rotation,
            translation,
        }
    }

    fn roles(&self) -> Vec<Role> {
        let colors = self.color.iter().flat_map(|_| (0..3).map(Role::Color));
        let plain = self.plain.iter().map(|(_, role, _)| *role);
        colors.chain(self.intensity.map(|_| Role::Intensity)).chain(plain).collect()
    }

    /// Fills a point in the file's coordinate system; `None` if it is marked invalid.
    fn fill(&self, point: &mut Point, scan: &PointCloud, values: &[RecordValue]) -> Option<()> {
        let value = |index: usize| {
            values[index].to_f64(&scan.prototype[index].data_type).unwrap_or(f64::NAN)
        };
        let valid = |state: Option<usize>| state.is_none_or(|index| value(index) == 0.0);
        let local = if let Some(indices) = self.cartesian.filter(|_| valid(self.cartesian_state)) {
            DVec3::from_array(indices.map(value))
        } else {
            let [range, azimuth, elevation] =
                self.spherical.filter(|_| valid(self.spherical_state))?.map(value);
            range
                * DVec3::new(
                    elevation.cos() * azimuth.cos(),
                    elevation.cos() * azimuth.sin(),
                    elevation.sin(),
                )
        };
        point.position = (self.rotation * local + self.translation).to_array();
        if let Some(indices) = self.color {
            let is_valid = valid(self.color_state);
            for (channel, index) in indices.into_iter().enumerate() {
                point.color[channel] =
                    if is_valid { value(index) } else { self.color_limits[channel][0] } as f32;
            }
        }
        if let Some(index) = self.intensity {
            point.intensity =
                if valid(self.intensity_state) { value(index) as f32 } else { f32::NAN };
        }
        for &(index, role, added) in &self.plain {
            let is_valid = role != Role::Time || valid(self.time_state);
            point.set(role, if is_valid { value(index) + added } else { f64::NAN });
        }
        let normal = DVec3::from_array(point.normal.map(f64::from));
        point.normal = (self.rotation * normal).as_vec3().to_array();
        Some(())
    }
}

/// Returns the role of a field that is taken as it is, and what is added to its values: returns
/// count from 0 in E57, and times from the start of the scan.
fn role(scan: &PointCloud, name: &RecordName) -> (Role, f64) {
    let scalar = |name: &str| (Role::Scalar(Scalar::named(name), 0), 0.0);
    match name {
        RecordName::ReturnIndex => (Role::Return, 1.0),
        RecordName::ReturnCount => (Role::Returns, 0.0),
        RecordName::TimeStamp => {
            let start = scan.acquisition_start.as_ref().map_or(0.0, |start| start.gps_time);
            (Role::Time, if start.is_finite() { start } else { 0.0 })
        }
        RecordName::RowIndex => scalar("rowIndex"),
        RecordName::ColumnIndex => scalar("columnIndex"),
        RecordName::Unknown { name, .. } => match name.as_str() {
            "normalX" => (Role::Normal(0), 0.0),
            "normalY" => (Role::Normal(1), 0.0),
            "normalZ" => (Role::Normal(2), 0.0),
            name => scalar(name),
        },
        _ => (Role::Other, 0.0),
    }
}

/// Returns the range of a channel: the scan's limits if they are a range, else its type's, else 0
/// to 1.
fn limits(
    data_type: Option<&RecordDataType>,
    stated: Option<(&Option<RecordValue>, &Option<RecordValue>)>,
) -> [f64; 2] {
    let Some(data_type) = data_type else { return [0.0, 1.0] };
    let number = |value: &RecordValue| match value {
        RecordValue::Integer(value) => Some(*value as f64),
        other => other.to_f64(data_type).ok(),
    };
    let stated = stated.and_then(|(lo, hi)| Some([number(lo.as_ref()?)?, number(hi.as_ref()?)?]));
    let typed = match *data_type {
        RecordDataType::Single { min, max } => min.zip(max).map(|(lo, hi)| [lo as f64, hi as f64]),
        RecordDataType::Double { min, max } => min.zip(max).map(|(lo, hi)| [lo, hi]),
        RecordDataType::ScaledInteger { min, max, scale, offset } => {
            Some([min as f64 * scale + offset, max as f64 * scale + offset])
        }
        RecordDataType::Integer { min, max } => Some([min as f64, max as f64]),
    };
    let range = |[lo, hi]: &[f64; 2]| lo < hi && (hi - lo).is_finite();
    stated.filter(range).or(typed.filter(range)).unwrap_or([0.0, 1.0])
}

/// Returns the scan's pose; an invalid rotation (length 0, NaN) counts as the identity.
fn pose(scan: &PointCloud) -> (DQuat, DVec3) {
    let Some(pose) = &scan.transform else { return (DQuat::IDENTITY, DVec3::ZERO) };
    let (q, t) = (&pose.rotation, &pose.translation);
    let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    let length = rotation.length();
    let rotation =
        if length.is_finite() && length > 0.0 { rotation / length } else { DQuat::IDENTITY };
    (rotation, DVec3::new(t.x, t.y, t.z))
}

/// Returns the stated bounds if the pose is the identity, since they are in the scan's own
/// coordinates.
fn bounds(scan: &PointCloud) -> Option<[[f64; 3]; 2]> {
    let stated =
        scan.cartesian_bounds.as_ref().filter(|_| pose(scan) == (DQuat::IDENTITY, DVec3::ZERO))?;
    Some([
        [stated.x_min?, stated.y_min?, stated.z_min?],
        [stated.x_max?, stated.y_max?, stated.z_max?],
    ])
}

fn bits(data_type: &RecordDataType) -> u64 {
    match *data_type {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            64 - u64::from(
                ((max as i128 - min as i128).clamp(0, u64::MAX as i128) as u64).leading_zeros(),
            )
        }
    }
}

fn file_facts(reader: &E57Reader<BufReader<File>>) -> Vec<(String, String)> {
    let facts = [
        ("software", reader.library_version()),
        ("coordinate system", reader.coordinate_metadata()),
    ];
    facts.into_iter().filter_map(|(what, value)| fact(what, value)).collect()
}

fn scan_facts(scan: &PointCloud) -> Vec<(String, String)> {
    let facts = [
        ("sensor", &scan.sensor_vendor),
        ("sensor model", &scan.sensor_model),
        ("description", &scan.description),
    ];
    facts.into_iter().filter_map(|(what, value)| fact(what, value.as_deref())).collect()
}

fn fact(what: &str, value: Option<&str>) -> Option<(String, String)> {
    let value = value?.split_whitespace().collect::<Vec<_>>().join(" ");
    (!value.is_empty()).then(|| (what.to_string(), value))
}

/// Returns a library's message as one line, and of a wrong checksum what it means.
fn line(error: &e57::Error) -> String {
    let text = error.to_string().lines().collect::<Vec<_>>().join(" ");
    match text.split_once("invalid checksum") {
        Some((_, rest)) => {
            let page = rest.rsplit_once("page ").map_or("?", |(_, page)| page);
            format!("it is damaged: the checksum of page {page} is wrong; copy or export it again")
        }
        None => text,
    }
}
