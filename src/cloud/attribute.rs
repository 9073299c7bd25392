//! What a point shows: one attribute as a 32-bit word a point, and the range that a ramp stretches over; and what else it brings to the device.

use super::{Cloud, ColumnSet, Part, Station, octahedral};
use std::str::FromStr;

/// `--color`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Attribute {
    Rgb,
    Intensity,
    Elevation,
    Class,
    Source,
    Return,
    Normal,
    /// Colours whose luminance is the mean of their neighbourhoods (`index::attributes::luminance`)
    Corrected,
    White,
}

/// Ramps are stretched between these shares of the points, so that a few outliers do not flatten the rest.
pub const STRETCH: [f64; 2] = [0.02, 0.98];

/// Elevations are words of 16 bits over the cloud's height: 65,536 levels are more than a ramp of 256 colours shows.
const ELEVATION_LEVELS: f64 = 65_535.0;

impl Attribute {
    /// Says whether values are names of kinds, which have no mean.
    pub fn is_label(self) -> bool {
        matches!(self, Attribute::Class | Attribute::Source | Attribute::Return)
    }

    /// As `--color` says it.
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// The columns that showing it needs.
    pub fn wanted(self) -> ColumnSet {
        let mut wanted = ColumnSet::default();
        match self {
            Attribute::Rgb | Attribute::Corrected => wanted.rgb = true,
            Attribute::Intensity => wanted.intensity = true,
            Attribute::Class => wanted.class = true,
            Attribute::Source => wanted.source = true,
            Attribute::Return => wanted.returns = true,
            Attribute::Normal => wanted.normal = true,
            Attribute::Elevation | Attribute::White => {}
        }
        wanted
    }

    /// Whether it depends on the light that a station was taken in: colours and intensities do.
    pub fn has_luminance(self) -> bool {
        matches!(self, Attribute::Rgb | Attribute::Intensity | Attribute::Corrected)
    }

    /// Whether some part of the cloud has it.
    pub fn is_in(self, cloud: &Cloud) -> bool {
        cloud.parts.iter().any(|part| match self {
            Attribute::Rgb | Attribute::Corrected => part.columns.rgb.is_some(),
            Attribute::Intensity => part.columns.intensity.is_some(),
            Attribute::Class => part.columns.class.is_some(),
            Attribute::Source => part.columns.source.is_some(),
            Attribute::Return => part.columns.returns.is_some(),
            Attribute::Normal => part.columns.normal.is_some(),
            Attribute::Elevation | Attribute::White => true,
        })
    }
}

/// An attribute of a given cloud, ready to be asked point by point.
#[derive(Clone, Copy, Debug)]
pub struct DisplayAttribute {
    pub attribute: Attribute,
    /// World heights of the whole cloud but its strays, for elevation.
    heights: [f64; 2],
    /// The words at the ends of a ramp.
    pub stretch: [u32; 2],
    /// The highest byte of a colour numbers its station ([`station_code`]).
    pub coded: bool,
    pub further: ExtraAttributes,
}

/// What points bring beside what they show, a word a point each, in this order; only where something asks for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExtraAttributes {
    /// Class (8 bits, lowest), return number (4 bits), from bit 16 on the number of the station.
    pub kind: bool,
    /// Normal ([`octahedral`]), in 24 bits.
    pub normal: bool,
    /// What a brush needs to know, two words (`index::attributes::strokes`).
    pub strokes: bool,
    /// How much of a light reaches it, where that was saved (`index::format::shadow_file`).
    pub light: bool,
}

impl ExtraAttributes {
    /// The columns that it is made of.
    pub fn wanted(self) -> ColumnSet {
        // Strokes are as large as what is of one colour.
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

/// A point's kind, in a word.
pub fn kind(class: u8, returns: u8, station: u16) -> u32 {
    class as u32 | (returns as u32 & 15) << 8 | (station as u32) << 16
}

/// What the ASPRS standard classes are (LAS 1.4 R15, table 17); none of those that it leaves open.
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

/// Bits of a word that number the station.
pub const STATION_SHIFT: u32 = 16;

/// What a colour's highest byte says of its station: from 1 on; 0 of those beyond 255, and where nobody asked.
pub fn station_code(station: usize) -> u8 {
    u8::try_from(station + 1).unwrap_or(0)
}

/// Bits of a colour's word below that.
pub const CODE_SHIFT: u32 = 24;

/// What a point of a file brings at most: what it shows, and all that is further but saved light, which indexes have.
pub type Words = [u32; 5];

impl DisplayAttribute {
    pub fn new(attribute: Attribute, cloud: &Cloud) -> DisplayAttribute {
        let heights = match attribute {
            Attribute::Elevation => cloud.heights(),
            _ => None,
        };
        let heights = heights.unwrap_or_default();
        let coded = attribute == Attribute::Rgb && cloud.stations.len() > 1;
        let shown = DisplayAttribute {
            attribute,
            heights,
            stretch: [0, 255],
            coded,
            further: ExtraAttributes::default(),
        };
        DisplayAttribute { stretch: shown.stretched(cloud), ..shown }
    }

    /// Elevation over these heights, each with how many points lie there.
    pub fn of_heights(heights: Vec<(f64, u64)>) -> DisplayAttribute {
        let fold = |pick: fn(f64, f64) -> f64, from: f64| {
            heights.iter().map(|&(height, _)| height).fold(from, pick)
        };
        let ends = [fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY)];
        let shown = DisplayAttribute::indexed(Attribute::Elevation, ends, [0, 255]);
        let mut counts = vec![0u64; 1 << 16];
        heights.iter().for_each(|&(height, points)| {
            counts[shown.elevation(height) as usize & 0xFFFF] += points
        });
        DisplayAttribute { stretch: percentiles(&counts), ..shown }
    }

    /// Of an indexed cloud, whose heights and stretch are known.
    pub fn indexed(attribute: Attribute, heights: [f64; 2], stretch: [u32; 2]) -> DisplayAttribute {
        DisplayAttribute {
            attribute,
            heights,
            stretch,
            coded: false,
            further: ExtraAttributes::default(),
        }
    }

    /// What to show where nothing is asked for: colours where there are any, else intensity that varies, else elevation.
    pub fn automatic(cloud: &Cloud) -> (DisplayAttribute, &'static str) {
        if Attribute::Rgb.is_in(cloud) {
            return (DisplayAttribute::new(Attribute::Rgb, cloud), "the points have colours");
        }
        let intensity = DisplayAttribute::new(Attribute::Intensity, cloud);
        let everywhere = cloud
            .parts
            .iter()
            .all(|part| part.columns.intensity.is_some() || part.columns.is_empty());
        if everywhere && intensity.stretch[1] > intensity.stretch[0] {
            return (intensity, "no colours, but an intensity that varies");
        }
        (
            DisplayAttribute::new(Attribute::Elevation, cloud),
            "no colours, and no intensity that varies",
        )
    }

    /// Words that a point brings: what it shows, then what is further.
    pub fn words(&self) -> u32 {
        1 + self.further.kind as u32
            + self.further.normal as u32
            + 2 * self.further.strokes as u32
            + self.further.light as u32
    }

    /// Which of its words is a point's kind.
    pub fn kind(&self) -> Option<u32> {
        self.further.kind.then_some(1)
    }

    /// Which of its words is a point's normal.
    pub fn normal(&self) -> Option<u32> {
        self.further.normal.then_some(1 + self.further.kind as u32)
    }

    /// Which of its words is the first of the two that a brush needs.
    pub fn strokes(&self) -> Option<u32> {
        self.further.strokes.then_some(self.words() - self.further.light as u32 - 2)
    }

    /// Which of its words says how much of a light reaches it.
    pub fn light(&self) -> Option<u32> {
        self.further.light.then_some(self.words() - 1)
    }

    /// The columns that its words are made of.
    pub fn wanted(&self) -> ColumnSet {
        self.attribute
            .wanted()
            .and(self.further.wanted())
            .and(ColumnSet { source: self.coded, ..ColumnSet::default() })
    }

    /// All words of a point, but for those that a brush needs, of a part whose stations are these, the first of them this number in the cloud.
    pub fn words_of(&self, part: &Part, stations: &[Station], first: usize, i: usize) -> Words {
        let mut words = [self.word(part, i), 0, 0, 0, 0];
        let columns = &part.columns;
        let station = || {
            let source = columns.source.as_ref().map(|column| column[i]);
            first + stations.binary_search_by_key(&source, |station| station.source).unwrap_or(0)
        };
        if self.coded {
            words[0] |= (station_code(station()) as u32) << CODE_SHIFT;
        }
        if let Some(place) = self.kind() {
            let byte = |column: &Option<Vec<u8>>| column.as_ref().map_or(0, |column| column[i]);
            let station = station();
            words[place as usize] = kind(
                byte(&columns.class),
                byte(&columns.returns),
                station.min(u16::MAX as usize) as u16,
            );
        }
        if let Some(place) = self.normal() {
            words[place as usize] = columns
                .normal
                .as_ref()
                .map_or(octahedral::UNKNOWN, |normal| octahedral::of_bytes(normal[i]));
        }
        words
    }

    /// The word of a point: `rgb` 8 bits a channel, red lowest; `normal` 8 bits an axis, 127 = 0; scalars as they are. 0 where the part lacks it.
    pub fn word(&self, part: &Part, i: usize) -> u32 {
        let columns = &part.columns;
        let bytes = |[a, b, c]: [u8; 3]| a as u32 | (b as u32) << 8 | (c as u32) << 16;
        match self.attribute {
            // Of a cloud whose colours have been corrected.
            Attribute::Rgb | Attribute::Corrected => {
                columns.rgb.as_ref().map_or(0xFFFFFF, |rgb| bytes(rgb[i]))
            }
            Attribute::Intensity => columns.intensity.as_ref().map_or(0, |v| v[i] as u32),
            Attribute::Class => columns.class.as_ref().map_or(0, |v| v[i] as u32),
            Attribute::Source => columns.source.as_ref().map_or(0, |v| v[i] as u32),
            Attribute::Return => columns.returns.as_ref().map_or(0, |v| (v[i] & 15) as u32),
            Attribute::Normal => columns
                .normal
                .as_ref()
                .map_or(0x7F7F7F, |v| bytes(v[i].map(|c| (c as i16 + 127) as u8))),
            Attribute::Elevation => {
                self.elevation(part.lattice.offset.z + part.lattice.step.z * columns.z[i] as f64)
            }
            Attribute::White => 0,
        }
    }

    /// The numbers at the ends of a ramp, where points show one: heights in metres, intensities of 16 bits.
    pub fn ends(&self) -> Option<[f64; 2]> {
        let [bottom, top] = self.heights;
        match self.attribute {
            Attribute::Elevation => Some(
                self.stretch.map(|word| bottom + (top - bottom) * word as f64 / ELEVATION_LEVELS),
            ),
            Attribute::Intensity => Some(self.stretch.map(f64::from)),
            _ => None,
        }
    }

    /// The word of a world height.
    pub fn elevation(&self, height: f64) -> u32 {
        let [lo, hi] = self.heights;
        if hi > lo {
            ((height - lo) / (hi - lo) * ELEVATION_LEVELS).clamp(0.0, ELEVATION_LEVELS) as u32
        } else {
            0
        }
    }

    /// The words at the 2nd and 98th percentile of the points, by counting every point.
    fn stretched(&self, cloud: &Cloud) -> [u32; 2] {
        use rayon::prelude::*;
        if !matches!(self.attribute, Attribute::Intensity | Attribute::Elevation) {
            return [0, 255];
        }
        let mut counts = vec![0u64; 1 << 16];
        for part in &cloud.parts {
            let zero = || vec![0u64; 1 << 16];
            let add = |mut a: Vec<u64>, b: Vec<u64>| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            };
            let chunk = part.columns.len().div_ceil(rayon::current_num_threads()).max(1);
            let own = (0..part.columns.len().div_ceil(chunk))
                .into_par_iter()
                .map(|k| {
                    let mut counts = zero();
                    (k * chunk..part.columns.len().min((k + 1) * chunk))
                        .for_each(|i| counts[self.word(part, i) as usize & 0xFFFF] += 1);
                    counts
                })
                .reduce(zero, add);
            counts = add(counts, own);
        }
        percentiles(&counts)
    }
}

/// Returns the words at the ends of [`STRETCH`], by how often each occurs.
pub fn percentiles(counts: &[u64]) -> [u32; 2] {
    let total: u64 = counts.iter().sum();
    STRETCH.map(|share| {
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
        clap::ValueEnum::from_str(text, true)
    }
}
