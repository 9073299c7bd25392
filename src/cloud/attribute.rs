//! Displayed attributes: one 32-bit word per point, the range of its colour ramp, and further words
//! that effects need.

use super::color_scale::{ColorScale, Ramp};
use super::scalar::{Scalar, Scalars};
use super::up::Up;
use super::{Cloud, ColumnSet, Columns, Header, Lattice, Part, Station, octahedral};
use crate::similar::did_you_mean;
use rayon::prelude::*;
use std::ops::Range;
use std::str::FromStr;

/// An attribute to display, as in `--color`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    Rgb,
    Intensity,
    Elevation,
    Class,
    Source,
    Return,
    /// GPS time of files, or of an index that keeps it
    Time,
    Normal,
    /// Colours whose luminance is averaged over neighbours
    Corrected,
    White,
    /// A number of files, or of an index that keeps it
    Scalar(Scalar),
}

/// Shares of the points between which ramps are stretched, so that few outliers do not flatten the
/// rest.
pub const STRETCH: [f64; 2] = [0.02, 0.98];

/// Elevations are 16-bit words over the cloud's height: 65,536 levels are more than a ramp of 256
/// colours shows.
const ELEVATION_LEVELS: f64 = 65_535.0;

impl Attribute {
    /// Those with a name of their own; extra attributes of files have others.
    pub const NAMED: [Attribute; 13] = [
        Attribute::Rgb,
        Attribute::Intensity,
        Attribute::Elevation,
        Attribute::Class,
        Attribute::Source,
        Attribute::Return,
        Attribute::Time,
        Attribute::Normal,
        Attribute::Corrected,
        Attribute::White,
        Attribute::Scalar(Scalar::NearInfrared),
        Attribute::Scalar(Scalar::ScanAngle),
        Attribute::Scalar(Scalar::HeightAboveGround),
    ];

    /// Tests whether values are labels, which have no mean.
    pub fn is_label(self) -> bool {
        matches!(self, Attribute::Class | Attribute::Source | Attribute::Return)
    }

    /// Tests whether values are numbers on a ramp.
    pub fn is_number(self) -> bool {
        matches!(self, Attribute::Intensity) || self.is_spread()
    }

    /// Tests whether words are places between the least and the greatest number.
    pub fn is_spread(self) -> bool {
        matches!(self, Attribute::Elevation | Attribute::Time | Attribute::Scalar(_))
    }

    /// Returns the ramp of numbers if none is asked for.
    pub fn ramp(self) -> Ramp {
        match self {
            Attribute::Elevation => Ramp::Terrain,
            Attribute::Time | Attribute::Scalar(_) => Ramp::Viridis,
            _ => Ramp::Grey,
        }
    }

    /// Returns the name as in `--color`.
    pub fn name(self) -> String {
        match self {
            Attribute::Scalar(scalar) => scalar.to_string(),
            named => format!("{named:?}").to_lowercase(),
        }
    }

    /// Returns the columns needed to display it.
    pub fn wanted(self) -> ColumnSet {
        let mut wanted = ColumnSet::default();
        match self {
            Attribute::Rgb | Attribute::Corrected => wanted.rgb = true,
            Attribute::Intensity => wanted.intensity = true,
            Attribute::Time => wanted.gps_time = true,
            Attribute::Class => wanted.class = true,
            Attribute::Source => wanted.source = true,
            Attribute::Return => wanted.returns = true,
            Attribute::Normal => wanted.normal = true,
            Attribute::Scalar(scalar) => {
                wanted.scalars = Scalars::from_iter([scalar]);
                // Ground is a class.
                wanted.class = scalar == Scalar::HeightAboveGround;
            }
            Attribute::Elevation | Attribute::White => {}
        }
        wanted
    }

    /// Tests whether it depends on the lighting at a station; colours and intensities do.
    pub fn has_luminance(self) -> bool {
        matches!(self, Attribute::Rgb | Attribute::Intensity | Attribute::Corrected)
    }

    /// Tests whether it can be read from a file.
    pub fn is_readable(self, header: &Header) -> bool {
        match self {
            Attribute::Scalar(Scalar::HeightAboveGround) => true,
            Attribute::Scalar(scalar) => header.scalars.contains(&scalar.to_string()),
            other => other.wanted().and(header.columns) == header.columns,
        }
    }

    /// Tests whether some part of the cloud has it.
    pub fn is_in(self, cloud: &Cloud) -> bool {
        cloud.parts.iter().any(|part| self.is_of(&part.columns))
    }

    /// Returns the column of times or of a scalar.
    pub fn numbers_of(self, columns: &Columns) -> Option<&Vec<f64>> {
        match self {
            Attribute::Time => columns.gps_time.as_ref(),
            Attribute::Scalar(scalar) => columns.scalar(scalar),
            _ => None,
        }
    }

    /// Tests whether points with these columns have it.
    pub fn is_of(self, columns: &Columns) -> bool {
        self.is_among(columns.available())
    }

    /// Tests whether points with these columns have it.
    pub fn is_among(self, columns: ColumnSet) -> bool {
        match self {
            Attribute::Rgb | Attribute::Corrected => columns.rgb,
            Attribute::Intensity => columns.intensity,
            Attribute::Time => columns.gps_time,
            Attribute::Class => columns.class,
            Attribute::Source => columns.source,
            Attribute::Return => columns.returns,
            Attribute::Normal => columns.normal,
            Attribute::Scalar(scalar) => columns.scalars.has(scalar),
            Attribute::Elevation | Attribute::White => true,
        }
    }

    /// Returns the names of all that points with these columns can show.
    pub fn names_of(header: &Header, columns: ColumnSet) -> Vec<String> {
        let own = Attribute::NAMED.into_iter().filter(|own| own.is_among(columns));
        let height = Attribute::Scalar(Scalar::HeightAboveGround);
        let scalars = header.scalars.iter().cloned();
        own.map(Attribute::name).chain([height.name()]).chain(scalars).collect()
    }
}

/// An attribute of a given cloud, ready to be evaluated per point.
#[derive(Clone, Copy, Debug)]
pub struct DisplayAttribute {
    pub attribute: Attribute,
    /// Least and greatest number of the whole cloud: of elevations without strays `[m]`.
    ends: [f64; 2],
    /// The axis along which elevations count.
    pub up: Up,
    /// The words at both ends of the ramp; of colours, the values of channels.
    pub stretch: [u32; 2],
    /// Places of dark colours between these are raised to this power: their median lies in the
    /// middle.
    power: f64,
    pub scale: ColorScale,
    /// True if the highest byte of a colour or an intensity is its station ([`station_code`]).
    pub coded: bool,
    pub further: ExtraAttributes,
}

/// Words of a point in addition to the displayed one, in this order, only if needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExtraAttributes {
    /// Class (8 bits, lowest), return number (4 bits), station number (from bit 16).
    pub kind: bool,
    /// Normal ([`octahedral`]), 24 bits.
    pub normal: bool,
    /// Stroke data, two words (`index::attributes::strokes`).
    pub strokes: bool,
    /// Saved visibility of a light (`index::format::shadow_file`).
    pub light: bool,
}

impl ExtraAttributes {
    /// Returns the columns needed.
    pub fn wanted(self) -> ColumnSet {
        // Strokes are as large as areas of one colour.
        ColumnSet {
            rgb: self.strokes,
            class: self.kind,
            returns: self.kind,
            source: self.kind,
            normal: self.normal,
            ..ColumnSet::default()
        }
    }
}

/// Packs a point's kind into a word.
pub fn kind(class: u8, returns: u8, station: u16) -> u32 {
    class as u32 | (returns as u32 & 15) << 8 | (station as u32) << 16
}

/// Returns the name of an ASPRS standard class (LAS 1.4 R15, table 17); `None` if reserved.
pub fn class_name(class: u8) -> Option<&'static str> {
    let names = [
        "never classified",
        "unclassified",
        "ground",
        "low vegetation",
        "medium vegetation",
        "high vegetation",
        "building",
        "low point",
        "model key point",
        "water",
        "rail",
        "road surface",
        "overlap",
        "wire guard",
        "wire conductor",
        "transmission tower",
        "wire connector",
        "bridge deck",
        "high noise",
        "overhead structure",
        "ignored ground",
        "snow",
        "temporal exclusion",
    ];
    names.get(class as usize).copied()
}

/// Returns the station number of points that a filter leaves out, among this many stations: one
/// past the last.
pub fn station_left_out(stations: usize) -> u32 {
    stations.max(1) as u32
}

/// Lowest bit of the station number in a kind word.
pub const STATION_SHIFT: u32 = 16;

/// Returns a station's code in the highest byte of colours, from 1 on; 0 beyond 255 stations or if
/// not coded.
pub fn station_code(station: usize) -> u8 {
    u8::try_from(station + 1).unwrap_or(0)
}

/// Lowest bit of the station code in a colour word.
pub const CODE_SHIFT: u32 = 24;

/// Returns the least and the greatest number of a column.
fn extremes<'c>(columns: impl Iterator<Item = Option<&'c Vec<f64>>>) -> Option<[f64; 2]> {
    let numbers = columns.flatten().flatten().copied();
    let finite = numbers.filter(|number| number.is_finite()).map(|number| [number; 2]);
    finite.reduce(|[lo, hi], [a, b]| [lo.min(a), hi.max(b)])
}

impl DisplayAttribute {
    pub fn new(attribute: Attribute, cloud: &Cloud) -> DisplayAttribute {
        let columns = || cloud.parts.iter().map(|part| &part.columns);
        let ends = match attribute {
            Attribute::Elevation => cloud.heights(),
            _ => extremes(columns().map(|columns| attribute.numbers_of(columns))),
        };
        let ends = ends.unwrap_or_default();
        let coded =
            matches!(attribute, Attribute::Rgb | Attribute::Intensity) && cloud.stations.len() > 1;
        let shown = DisplayAttribute {
            attribute,
            ends,
            up: cloud.up,
            stretch: [0, 255],
            power: 1.0,
            scale: ColorScale::default(),
            coded,
            further: ExtraAttributes::default(),
        };
        DisplayAttribute { stretch: shown.stretched(cloud), ..shown }
    }

    /// Returns elevations, times or scalars over these, each with its number of points.
    pub fn of_numbers(attribute: Attribute, numbers: Vec<(f64, u64)>) -> DisplayAttribute {
        let fold = |pick: fn(f64, f64) -> f64, from: f64| {
            numbers.iter().map(|&(number, _)| number).fold(from, pick)
        };
        let ends = [fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY)];
        let shown = DisplayAttribute::indexed(attribute, ends, [0, 255]);
        let mut counts = vec![0u64; 1 << 16];
        numbers
            .iter()
            .for_each(|&(number, points)| counts[shown.place(number) as usize & 0xFFFF] += points);
        DisplayAttribute { stretch: percentiles(&counts), ..shown }
    }

    /// Returns an attribute of an index, whose least and greatest number and stretch are known.
    pub fn indexed(attribute: Attribute, ends: [f64; 2], stretch: [u32; 2]) -> DisplayAttribute {
        DisplayAttribute {
            attribute,
            ends,
            up: Up::Z,
            stretch,
            power: 1.0,
            scale: ColorScale::default(),
            coded: false,
            further: ExtraAttributes::default(),
        }
    }

    /// Chooses an attribute: colours if any, else intensity that varies, else elevation. Returns it
    /// with the reason.
    pub fn automatic(cloud: &Cloud) -> (DisplayAttribute, &'static str) {
        if Attribute::Rgb.is_in(cloud) {
            return (DisplayAttribute::new(Attribute::Rgb, cloud), "the points have colours");
        }
        let intensity = DisplayAttribute::new(Attribute::Intensity, cloud);
        let everywhere = cloud
            .parts
            .iter()
            .all(|part| part.columns.intensity.is_some() || part.columns.is_empty());
        let varies = intensity.stretch[1] > intensity.stretch[0] && !mostly_one_intensity(cloud);
        if everywhere && varies {
            return (intensity, "no colours, but an intensity that varies");
        }
        (
            DisplayAttribute::new(Attribute::Elevation, cloud),
            "no colours, and no intensity that varies",
        )
    }

    /// Returns the number of words per point.
    pub fn words(&self) -> u32 {
        1 + self.further.kind as u32
            + self.further.normal as u32
            + 2 * self.further.strokes as u32
            + self.further.light as u32
    }

    /// Returns the index of the kind word.
    pub fn kind(&self) -> Option<u32> {
        self.further.kind.then_some(1)
    }

    /// Returns the index of the normal word.
    pub fn normal(&self) -> Option<u32> {
        self.further.normal.then_some(1 + self.further.kind as u32)
    }

    /// Returns the index of the first of the two stroke words.
    pub fn strokes(&self) -> Option<u32> {
        self.further.strokes.then_some(self.words() - self.further.light as u32 - 2)
    }

    /// Returns the index of the light word.
    pub fn light(&self) -> Option<u32> {
        self.further.light.then_some(self.words() - 1)
    }

    /// Returns the columns needed for its words.
    pub fn wanted(&self) -> ColumnSet {
        self.attribute
            .wanted()
            .and(self.further.wanted())
            .and(ColumnSet { source: self.coded, ..ColumnSet::default() })
    }

    /// Writes all words of a range of points but those of strokes, from the word `at` of each row
    /// on. `stations` are those of their part, `first` is the cloud's number of the first of them.
    pub fn write_words<const N: usize>(
        &self,
        (columns, lattice): (&Columns, &Lattice),
        (stations, first): (&[Station], usize),
        points: Range<usize>,
        rows: &mut [[u32; N]],
        at: usize,
    ) {
        match (self.attribute, &columns.rgb) {
            // Colours in the cloud have been corrected in place.
            (Attribute::Rgb | Attribute::Corrected, Some(rgb)) => {
                put(rows, at, rgb[points.clone()].iter().map(|&color| bytes(color)));
            }
            _ => put(rows, at, points.clone().map(|i| self.word_of(columns, lattice, i))),
        }
        if self.coded || self.further.kind {
            let numbers = station_numbers(columns, (stations, first), points.clone());
            if self.coded {
                let codes =
                    numbers.iter().map(|&number| (station_code(number) as u32) << CODE_SHIFT);
                rows.iter_mut().zip(codes).for_each(|(row, code)| row[at] |= code);
            }
            if let Some(place) = self.kind() {
                let byte = |column: &Option<Vec<u8>>, i: usize| {
                    column.as_ref().map_or(0, |column| column[i])
                };
                let kinds = points.clone().zip(&numbers).map(|(i, &station)| {
                    let station = station.min(u16::MAX as usize) as u16;
                    kind(byte(&columns.class, i), byte(&columns.returns, i), station)
                });
                put(rows, at + place as usize, kinds);
            }
        }
        if let Some(place) = self.normal() {
            let normal = |i| {
                let normal = columns.normal.as_ref();
                normal.map_or(octahedral::UNKNOWN, |normal| octahedral::of_bytes(normal[i]))
            };
            put(rows, at + place as usize, points.map(normal));
        }
    }

    /// Tests whether the words of points have a place for stations, but not for all of a part's,
    /// given their numbers.
    pub fn omits_stations(&self, stations: &Range<usize>) -> bool {
        let room = match self.kind() {
            Some(_) => 1 << u16::BITS,
            None if self.coded => u8::MAX as usize,
            None => return false,
        };
        stations.len() > 1 && stations.end > room
    }

    /// Returns the station of a point, given its words, if they tell.
    pub fn station(&self, words: &[u32]) -> Option<u32> {
        match self.kind() {
            Some(place) => Some(words[place as usize] >> STATION_SHIFT),
            None if self.coded => (words[0] >> CODE_SHIFT).checked_sub(1),
            None => None,
        }
    }

    /// Computes the displayed word of a point: `rgb` 8 bits a channel, red lowest; `normal` 8 bits
    /// an axis, 127 = 0; scalars unchanged. 0 if the part lacks the attribute.
    pub fn word(&self, part: &Part, i: usize) -> u32 {
        self.word_of(&part.columns, &part.lattice, i)
    }

    /// Computes the same of points that are in no part.
    pub fn word_of(&self, columns: &Columns, lattice: &Lattice, i: usize) -> u32 {
        match self.attribute {
            Attribute::Rgb | Attribute::Corrected => {
                columns.rgb.as_ref().map_or(0xFFFFFF, |rgb| bytes(rgb[i]))
            }
            Attribute::Intensity => columns.intensity.as_ref().map_or(0, |v| v[i] as u32),
            Attribute::Time | Attribute::Scalar(_) => {
                self.attribute.numbers_of(columns).map_or(0, |v| self.place(v[i]))
            }
            Attribute::Class => columns.class.as_ref().map_or(0, |v| v[i] as u32),
            Attribute::Source => columns.source.as_ref().map_or(0, |v| v[i] as u32),
            Attribute::Return => columns.returns.as_ref().map_or(0, |v| (v[i] & 15) as u32),
            Attribute::Normal => columns
                .normal
                .as_ref()
                .map_or(0x7F7F7F, |v| bytes(v[i].map(|c| (c as i16 + 127) as u8))),
            Attribute::Elevation => {
                let axis = self.up.index();
                let steps = columns.along(axis)[i] as f64;
                self.place(lattice.offset[axis] + lattice.step[axis] * steps)
            }
            Attribute::White => 0,
        }
    }

    /// Returns the number of a displayed word: of numbers that are spread, the middle of those with
    /// this word. `None` of colours and normals.
    pub fn number(&self, word: u32) -> Option<f64> {
        let [lo, hi] = self.ends;
        match self.attribute {
            Attribute::Intensity => Some((word & ((1 << CODE_SHIFT) - 1)) as f64),
            label if label.is_label() => Some(word as f64),
            spread if spread.is_spread() => {
                let place = (word as f64 + 0.5).min(ELEVATION_LEVELS) / ELEVATION_LEVELS;
                Some(lo + (hi - lo) * place)
            }
            _ => None,
        }
    }

    /// Returns the values at the ends of the ramp, if any: heights `[m]`, times `[s]`, 16-bit
    /// intensities or scalars.
    pub fn ends(&self) -> Option<[f64; 2]> {
        let [bottom, top] = self.ends;
        match self.attribute {
            attribute if attribute.is_spread() => Some(self.scale.range.unwrap_or(
                self.stretch.map(|word| bottom + (top - bottom) * word as f64 / ELEVATION_LEVELS),
            )),
            Attribute::Intensity => Some(self.scale.range.unwrap_or(self.stretch.map(f64::from))),
            _ => None,
        }
    }

    /// Returns the ramp of numbers.
    pub fn ramp(&self) -> Ramp {
        self.scale.ramp.unwrap_or(self.attribute.ramp())
    }

    /// Returns the colour at a place on the ramp of numbers, 0..=1, sRGB.
    pub fn ramp_at(&self, place: f64) -> [f64; 3] {
        self.ramp().color(self.scale.toned(place))
    }

    /// Tests whether it is a number on a ramp that is not grey.
    pub fn is_ramped(&self) -> bool {
        self.attribute.is_number() && self.ramp() != Ramp::Grey
    }

    /// Returns the words at the ends of the ramp, which need not be whole or occur.
    pub fn ramp_words(&self) -> [f64; 2] {
        let [bottom, top] = self.ends;
        match (self.scale.range, self.attribute) {
            (Some(range), attribute) if attribute.is_spread() && top > bottom => {
                range.map(|height| (height - bottom) / (top - bottom) * ELEVATION_LEVELS)
            }
            (Some(range), Attribute::Intensity | Attribute::Rgb | Attribute::Corrected) => range,
            _ => match self.stretch.map(f64::from) {
                // Equal numbers have the colour in the middle.
                [lo, hi] if lo == hi => [lo - 0.5, hi + 0.5],
                apart => apart,
            },
        }
    }

    /// Stretches colours of which nearly all are in the lower half of the channels' range, as far
    /// as their median lies in the middle at most, and raises those in the middle, if it lies
    /// lower. Black stays black. `tones` are those of all points ([`tones`]).
    pub fn brighten(&mut self, tones: &[u64]) {
        let [[_, most], [median, _]] = [STRETCH, [0.5; 2]].map(|shares| at_shares(tones, shares));
        if self.attribute == Attribute::Rgb && (1..128).contains(&most) {
            let top = most.max(2 * median);
            self.stretch = [0, top];
            let middle = median as f64 / top as f64;
            self.power = if middle > 0.0 && middle < 0.5 { 0.5f64.ln() / middle.ln() } else { 1.0 };
        }
    }

    /// Returns the place in 0..=1 that is shown for one between the ends of the ramp.
    pub fn toned(&self, place: f64) -> f64 {
        let is_automatic = self.scale.range.is_none();
        self.scale.toned(if is_automatic { place.powf(self.power) } else { place })
    }

    /// Returns the word of a number: its place between the least and the greatest.
    pub fn place(&self, number: f64) -> u32 {
        let [lo, hi] = self.ends;
        if hi > lo {
            ((number - lo) / (hi - lo) * ELEVATION_LEVELS).clamp(0.0, ELEVATION_LEVELS) as u32
        } else {
            0
        }
    }

    /// Computes the words at the 2nd and 98th percentile by counting every point.
    fn stretched(&self, cloud: &Cloud) -> [u32; 2] {
        if !self.attribute.is_number() {
            return [0, 255];
        }
        let add = |mut a: Vec<u64>, b: Vec<u64>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let of_part = |part: &Part| {
            let chunk = part.columns.len().div_ceil(rayon::current_num_threads()).max(1);
            (0..part.columns.len().div_ceil(chunk))
                .into_par_iter()
                .map(|k| {
                    let mut counts = vec![0u64; 1 << 16];
                    (k * chunk..part.columns.len().min((k + 1) * chunk))
                        .for_each(|i| counts[self.word(part, i) as usize & 0xFFFF] += 1);
                    counts
                })
                .reduce_with(add)
        };
        let counts = cloud.parts.iter().filter_map(of_part).reduce(add);
        counts.map_or([0, 0], |counts| percentiles(&counts))
    }
}

/// Returns the number of points of each value of their brightest channel.
pub fn tones<'c>(colors: impl Iterator<Item = &'c [[u8; 3]]>) -> Vec<u64> {
    let count = |mut counts: Vec<u64>, [r, g, b]: &[u8; 3]| {
        counts[*r.max(g).max(b) as usize] += 1;
        counts
    };
    let sum = |a: Vec<u64>, b: Vec<u64>| a.into_iter().zip(b).map(|(a, b)| a + b).collect();
    let none = || vec![0; 256];
    let of = |colors: &[[u8; 3]]| {
        colors.par_iter().with_min_len(1 << 16).fold(none, count).reduce(none, sum)
    };
    colors.map(of).fold(none(), sum)
}

fn bytes([a, b, c]: [u8; 3]) -> u32 {
    a as u32 | (b as u32) << 8 | (c as u32) << 16
}

/// Returns the cloud's numbers of the stations of a range of points. `stations` are those of their
/// part, `first` is the cloud's number of the first of them.
pub fn station_numbers(
    columns: &Columns,
    (stations, first): (&[Station], usize),
    points: Range<usize>,
) -> Vec<usize> {
    let number = |source: Option<u16>| {
        let found = stations.binary_search_by_key(&source, |station| station.source);
        first + found.unwrap_or(0)
    };
    match &columns.source {
        Some(source) => source[points]
            .chunk_by(|a, b| a == b)
            .flat_map(|run| std::iter::repeat_n(number(Some(run[0])), run.len()))
            .collect(),
        None => vec![number(None); points.len()],
    }
}

/// Writes one word of each row.
pub fn put<const N: usize>(rows: &mut [[u32; N]], at: usize, words: impl Iterator<Item = u32>) {
    rows.iter_mut().zip(words).for_each(|(row, word)| row[at] = word);
}

/// Tests whether most points have the same intensity, as files of meshes do whose intensity is a
/// default: the others would be specks.
fn mostly_one_intensity(cloud: &Cloud) -> bool {
    let mut counts = vec![0u64; 1 << 16];
    let intensities = cloud.parts.iter().filter_map(|part| part.columns.intensity.as_ref());
    intensities.flatten().for_each(|&intensity| counts[intensity as usize] += 1);
    counts.iter().max().is_some_and(|most| 2 * most > cloud.len())
}

/// Returns the words at the ends of [`STRETCH`], by how often each occurs.
pub fn percentiles(counts: &[u64]) -> [u32; 2] {
    at_shares(counts, STRETCH)
}

/// Returns the values below which these shares of all are.
fn at_shares(counts: &[u64], shares: [f64; 2]) -> [u32; 2] {
    let total: u64 = counts.iter().sum();
    shares.map(|share| {
        let wanted = (share * total as f64) as u64;
        let mut sum = 0;
        let reached = counts.iter().position(|&count| {
            sum += count;
            sum > wanted
        });
        reached.unwrap_or(0) as u32
    })
}

impl FromStr for Attribute {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // Filters call it so.
        let text = if text.eq_ignore_ascii_case("gps-time") { "time" } else { text };
        let named = Attribute::NAMED.into_iter().find(|own| own.name().eq_ignore_ascii_case(text));
        let scalar = || text.parse().ok().map(Attribute::Scalar);
        named.or_else(scalar).ok_or_else(|| {
            let names = Attribute::NAMED.map(Attribute::name);
            let meant = did_you_mean(text, &names);
            let names = names.join(", ");
            format!("there is no attribute {text:?}{meant}; there are {names}, and extra:NAME, which `pointillist info` lists")
        })
    }
}

impl serde::Serialize for Attribute {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.name())
    }
}
