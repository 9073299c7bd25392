//! What is done to points that were read: all that a picture of them and `info` need, but for the
//! device.

use glam::DVec3;
use pointillist::cloud::attribute::ExtraAttributes;
use pointillist::cloud::filter::Filter;
use pointillist::cloud::scalar::Scalars;
use pointillist::cloud::{self, Cloud, ColumnSet, Columns, Part, ReadOptions, spacing, stream};
use pointillist::index::build::pack;
use pointillist::index::{Arrangement, Row, partition};
use pointillist::progress::Silent;
use pointillist::render::source::{OpenOptions, Source};
use pointillist::select::clip::Clips;
use pointillist::view::{Camera, Preset, View};
use std::ops::Range;
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [320, 180];

/// Longest input whose scalars are read: their names are kept for ever.
const NAMED: usize = 1 << 12;

/// Reads a file as `render`, `info` and `index` do, and checks what they find.
pub fn at_file(path: &Path, bytes: &[u8]) {
    // All ways of reading are taken, by the input itself.
    let pick = choice(bytes);
    let strict = pick.is_multiple_of(4);
    let scalars = if bytes.len() < NAMED { Scalars::ALL } else { Scalars::NONE };
    let wanted = ColumnSet { scalars, ..ColumnSet::ALL };
    let options = ReadOptions { extras: true, ..ReadOptions::new(wanted, strict) };
    let paths = [path.to_owned()];
    let read = cloud::read(&paths, &options, &Silent);
    let streamed = streamed(&paths, &options);
    match read {
        Ok(cloud) => {
            if let Some(points) = streamed {
                assert_eq!(cloud.len(), points, "points in batches and at once");
            }
            at_cloud(cloud, pick / 4);
        }
        Err(error) => one_line(&error.to_string()),
    }
}

/// Returns a number that an input decides.
pub fn choice(bytes: &[u8]) -> usize {
    bytes.iter().fold(0, |sum, byte| sum + usize::from(*byte))
}

/// Returns the number of points in batches; `None` if reading them ends in an error.
fn streamed(paths: &[PathBuf], options: &ReadOptions) -> Option<u64> {
    let sources = stream::open(paths, options, &Silent, &mut Vec::new()).ok()?;
    let mut points = 0;
    for source in &sources {
        let count = |batch: &stream::Batch| {
            lengths(batch.columns);
            Ok(batch.columns.len() as u64)
        };
        let mut take = |own: u64| {
            points += own;
            Ok(())
        };
        source.stream_in_order(&Silent, &count, &mut take).ok()?;
    }
    Some(points)
}

fn at_cloud(cloud: Cloud, pick: usize) {
    cloud.notes.iter().for_each(|note| one_line(note));
    for part in &cloud.parts {
        at_part(part);
    }
    if let Some(apart) = spacing::spacing(&cloud) {
        assert!(apart.is_finite() && apart > 0.0, "spacing {apart}");
    }
    at_source(&Source::Files(cloud), pick);
}

fn lengths(columns: &Columns) {
    let points = columns.len();
    let own = [
        columns.y.len(),
        columns.z.len(),
        columns.rgb.as_ref().map_or(points, Vec::len),
        columns.intensity.as_ref().map_or(points, Vec::len),
        columns.class.as_ref().map_or(points, Vec::len),
        columns.returns.as_ref().map_or(points, Vec::len),
        columns.source.as_ref().map_or(points, Vec::len),
        columns.normal.as_ref().map_or(points, Vec::len),
        columns.gps_time.as_ref().map_or(points, Vec::len),
    ];
    assert_eq!(own, [points; 9], "columns of different lengths");
    assert!(columns.scalars.iter().all(|own| own.numbers.len() == points));
}

fn at_part(part: &Part) {
    let columns = &part.columns;
    lengths(columns);
    let step = part.lattice.step;
    assert!(step.is_finite() && step.cmpgt(DVec3::ZERO).all(), "step {step}");
    assert!(part.lattice.offset.is_finite(), "offset {}", part.lattice.offset);
    let finite = |[low, high]: [f64; 2]| low.is_finite() && high.is_finite() && low <= high;
    assert!(finite(part.intensity_range), "intensities {:?}", part.intensity_range);
    if let Some((low, high)) = part.bounds() {
        assert!((high - low).is_finite(), "box {low} to {high}");
    }
    let words = |_: &Columns, points: Range<usize>, rows: &mut [Row<4>]| {
        rows.iter_mut().zip(points).for_each(|(row, i)| row[3] = i as u32);
    };
    let partition = partition(columns.clone(), &words, Arrangement::Morton, &Silent)
        .expect("nothing interrupts");
    let mut seen = vec![false; columns.len()];
    partition.rows.iter().for_each(|row| seen[row[3] as usize] = true);
    assert!(seen.iter().all(|seen| *seen), "a point is in no node");
    assert_eq!(partition.nodes.iter().map(|node| node.points.len()).sum::<usize>(), columns.len());
    for node in &partition.nodes {
        let rows = &partition.rows[node.points.clone()];
        let frame = pack::frame(rows);
        let mut pages = vec![vec![0u32; rows.len()]; frame.planes as usize];
        let mut pages: Vec<&mut [u32]> = pages.iter_mut().map(Vec::as_mut_slice).collect();
        pack::pack(rows, &frame, Arrangement::Morton, &mut pages);
    }
}

/// Asks a source all that a picture needs; `pick` chooses the attribute to show.
pub fn at_source(source: &Source, pick: usize) {
    source.notes(ExtraAttributes::default()).iter().for_each(|note| one_line(note));
    // Histograms take most of the time: one is enough.
    let attributes = source.attributes();
    let asked = attributes.get(pick % (attributes.len() + 1)).copied();
    match source.shown(asked) {
        Ok((_, why)) => one_line(&why),
        Err(error) => one_line(&error.to_string()),
    }
    let _ = (source.counts(), source.files(), source.stations().len());
    let reference = format!("{:?}", source.reference());
    assert!(!reference.is_empty());
    let points = source.framed_points(&Clips::default());
    for preset in [Preset::Top, Preset::Front, Preset::Side, Preset::Iso, Preset::Fit] {
        let camera = Camera::framing(preset, &points, SIZE);
        let view = View::new(camera, SIZE).unwrap_or_else(|error| panic!("{preset:?}: {error}"));
        let focal = view.focal_px();
        assert!(focal.is_finite() && camera.eye.is_finite(), "{preset:?}: {camera:?}");
    }
}

/// Returns how files are opened.
pub fn opening() -> OpenOptions {
    OpenOptions {
        read: ReadOptions::new(ColumnSet::ALL, false),
        filter: Filter::default(),
        index: None,
        indexes_octrees: false,
        strokes: false,
        place: None,
        shadows: None,
        fault: None,
    }
}

/// Checks what is printed: a terminal must not be controlled by a file.
pub fn one_line(text: &str) {
    assert!(!text.is_empty(), "there are no words");
    assert!(text.len() < 1 << 14, "{} bytes are said", text.len());
}
