//! Columns of points, or of samples that stand for several, on a tree's lattice in Morton order;
//! and their packing into the planes of a node.

use super::morton;
use super::schema::{NodeRecord, PLANES, Plane, SINGLE_STATION, TWO_PER_BYTE};
use crate::cloud::{ColumnSet, Lattice};
use crate::config::BITS_PER_PLANE;
use bytemuck::Zeroable;
use glam::DVec3;
use std::cmp::Ordering;

/// A position on the tree's lattice, which starts at the tree's corner, so that coordinates need no
/// sign; 32 bits hold any file's extent.
pub type Cell = [u32; 3];

/// Columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    pub q: Vec<Cell>,
    pub rgb: Option<Vec<[u8; 3]>>,
    pub intensity: Option<Vec<u16>>,
    pub class: Option<Vec<u8>>,
    pub returns: Option<Vec<u8>>,
    /// Station numbers.
    pub source: Option<Vec<u16>>,
    pub normal: Option<Vec<[i8; 3]>>,
    pub gps_time: Option<Vec<f64>>,
    /// Points that each sample stands for; one if this is `None`.
    pub weight: Option<Vec<u32>>,
    pub derived: DerivedColumns,
}

/// Columns derived from neighbours in any leaf: nodes reserve room for them, which is filled once
/// all points are in their leaves (`derive`).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DerivedColumns {
    /// See [`Plane::Facing`], [`Plane::Brush`] and [`Plane::Corrected`].
    pub facing: Option<Vec<u32>>,
    pub brush: Option<Vec<u32>>,
    pub corrected: Option<Vec<[u8; 3]>>,
}

/// Planes to derive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DerivedPlanes {
    pub normals: bool,
    pub strokes: bool,
    pub luminance: bool,
}

impl DerivedPlanes {
    pub const NONE: DerivedPlanes =
        DerivedPlanes { normals: false, strokes: false, luminance: false };
    pub const ALL: DerivedPlanes = DerivedPlanes { normals: true, strokes: true, luminance: true };

    /// Returns whether normals are derived; strokes need them.
    pub fn has_normals(self) -> bool {
        self.normals || self.strokes
    }

    pub fn planes(self) -> Vec<Plane> {
        let all = [
            (Plane::Facing, self.has_normals()),
            (Plane::Brush, self.strokes),
            (Plane::Corrected, self.luminance),
        ];
        all.into_iter().filter(|(_, there)| *there).map(|(plane, _)| plane).collect()
    }
}

impl DerivedColumns {
    /// Returns columns of zeros.
    pub fn zeroed(derive: DerivedPlanes, points: usize) -> DerivedColumns {
        DerivedColumns {
            facing: derive.has_normals().then(|| vec![0; points]),
            brush: derive.strokes.then(|| vec![0; points]),
            corrected: derive.luminance.then(|| vec![[0; 3]; points]),
        }
    }

    /// Returns the bytes of one of these planes.
    pub fn bytes(&self, plane: Plane) -> &[u8] {
        fn bytes<T: bytemuck::NoUninit>(column: &Option<Vec<T>>) -> &[u8] {
            column.as_deref().map_or(&[], bytemuck::cast_slice)
        }
        match plane {
            Plane::Facing => bytes(&self.facing),
            Plane::Brush => bytes(&self.brush),
            Plane::Corrected => bytes(&self.corrected),
            _ => &[],
        }
    }
}

impl Samples {
    /// Joins `parts` in Morton order; they have the same columns, except weights. Parts of one tree
    /// follow each other in that order; those of several trees may be anywhere.
    pub fn together(parts: &[Samples]) -> Samples {
        let filled = || parts.iter().filter(|part| !part.is_empty());
        let follows = |(before, after): (&Samples, &Samples)| {
            morton::order(before.q[before.len() - 1], after.q[0]) != Ordering::Greater
        };
        let all = Samples::concatenated(parts);
        if filled().zip(filled().skip(1)).all(follows) { all } else { all.sorted() }
    }

    /// Converts the positions to another lattice, rounded to its steps.
    pub fn moved(mut self, from: &Lattice, to: &Lattice) -> Samples {
        for q in &mut self.q {
            let steps = (from.world(q.map(i64::from)) - to.offset) / to.step;
            *q = steps
                .round()
                .clamp(DVec3::ZERO, DVec3::splat(u32::MAX as f64))
                .to_array()
                .map(|v| v as u32);
        }
        self.sorted()
    }

    /// Adds missing columns with the values that a renderer would show: white, and 0 for all else.
    pub fn completed(self, has: ColumnSet) -> Samples {
        fn column<T: Clone>(
            own: Option<Vec<T>>,
            wanted: bool,
            lacking: T,
            points: usize,
        ) -> Option<Vec<T>> {
            own.or_else(|| wanted.then(|| vec![lacking; points]))
        }
        let points = self.len();
        Samples {
            rgb: column(self.rgb, has.rgb, [255; 3], points),
            intensity: column(self.intensity, has.intensity, 0, points),
            class: column(self.class, has.class, 0, points),
            returns: column(self.returns, has.returns, 0, points),
            source: column(self.source, has.source, 0, points),
            normal: column(self.normal, has.normal, [0; 3], points),
            gps_time: column(self.gps_time, has.gps_time, 0.0, points),
            ..self
        }
    }

    /// Sorts in Morton order; the sort is stable.
    fn sorted(self) -> Samples {
        fn column<T: Copy>(column: Option<Vec<T>>, order: &[u32]) -> Option<Vec<T>> {
            column.map(|column| order.iter().map(|&i| column[i as usize]).collect())
        }
        let mut order: Vec<u32> = (0..self.len() as u32).collect();
        order.sort_by(|&a, &b| morton::order(self.q[a as usize], self.q[b as usize]));
        Samples {
            q: order.iter().map(|&i| self.q[i as usize]).collect(),
            rgb: column(self.rgb, &order),
            intensity: column(self.intensity, &order),
            class: column(self.class, &order),
            returns: column(self.returns, &order),
            source: column(self.source, &order),
            normal: column(self.normal, &order),
            gps_time: column(self.gps_time, &order),
            weight: column(self.weight, &order),
            derived: DerivedColumns {
                facing: column(self.derived.facing, &order),
                brush: column(self.derived.brush, &order),
                corrected: column(self.derived.corrected, &order),
            },
        }
    }

    /// Concatenates `parts`.
    fn concatenated(parts: &[Samples]) -> Samples {
        fn column<T: Clone>(
            parts: &[Samples],
            of: impl Fn(&Samples) -> &Option<Vec<T>>,
        ) -> Option<Vec<T>> {
            let there: Option<Vec<&[T]>> = parts.iter().map(|part| of(part).as_deref()).collect();
            there.map(|columns| columns.concat())
        }
        Samples {
            q: parts.iter().map(|part| part.q.as_slice()).collect::<Vec<_>>().concat(),
            rgb: column(parts, |part| &part.rgb),
            intensity: column(parts, |part| &part.intensity),
            class: column(parts, |part| &part.class),
            returns: column(parts, |part| &part.returns),
            source: column(parts, |part| &part.source),
            normal: column(parts, |part| &part.normal),
            gps_time: column(parts, |part| &part.gps_time),
            weight: Some(
                parts.iter().flat_map(|part| (0..part.len()).map(|i| part.weight(i))).collect(),
            ),
            derived: DerivedColumns {
                facing: column(parts, |part| &part.derived.facing),
                brush: column(parts, |part| &part.derived.brush),
                corrected: column(parts, |part| &part.derived.corrected),
            },
        }
    }

    pub fn len(&self) -> usize {
        self.q.len()
    }

    pub fn is_empty(&self) -> bool {
        self.q.is_empty()
    }

    pub fn weight(&self, i: usize) -> u32 {
        self.weight.as_ref().map_or(1, |weight| weight[i])
    }

    /// Returns the number of points that the samples stand for.
    pub fn points(&self) -> u64 {
        self.weight
            .as_ref()
            .map_or(self.len() as u64, |weight| weight.iter().map(|&w| w as u64).sum())
    }

    /// Appends the planes of a node to `planes` and returns its record, with `at` counted from the
    /// start of `planes`. Positions are rounded to the centres of 2^`coarser` steps; `corner` is
    /// the tree's corner in steps of the file's lattice.
    pub fn pack(&self, corner: [i64; 3], coarser: u32, planes: &mut Vec<u8>) -> NodeRecord {
        let mut record = NodeRecord {
            at: planes.len() as u64,
            points: self.points(),
            count: self.len() as u32,
            ..NodeRecord::zeroed()
        };
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        for q in &self.q {
            for axis in 0..3 {
                low[axis] = low[axis].min(q[axis] >> coarser);
                high[axis] = high[axis].max(q[axis] >> coarser);
            }
        }
        record.extent = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        // Rounded positions are relative to the tree's corner, whole ones to the file's lattice
        // (`schema::Contents::lattices`).
        record.origin =
            [0, 1, 2].map(|axis| low[axis] as i64 + if coarser == 0 { corner[axis] } else { 0 });
        record.coarser = coarser as u8;
        record.bits =
            record.extent.iter().max().map_or(1, |&side| 32 - side.leading_zeros()).max(1) as u8;
        let position_planes = record.position_planes();
        let pad = BITS_PER_PLANE * position_planes - record.bits as u32;
        let mut planes = Planes { record: &mut record, bytes: planes };
        for k in 0..position_planes {
            let shift = BITS_PER_PLANE * (position_planes - 1 - k);
            let axis = |q: &Cell, axis: usize| {
                ((q[axis] >> coarser) - low[axis]) << pad >> shift & ((1 << BITS_PER_PLANE) - 1)
            };
            let words: Vec<u32> = self
                .q
                .iter()
                .map(|q| {
                    axis(q, 0) | axis(q, 1) << BITS_PER_PLANE | axis(q, 2) << (2 * BITS_PER_PLANE)
                })
                .collect();
            planes.keep(PLANES[k as usize].0, &Some(words));
        }
        let narrow: Option<Vec<u8>> = self
            .source
            .as_ref()
            .and_then(|source| source.iter().map(|&station| u8::try_from(station).ok()).collect());
        planes.keep(Plane::Rgb, &self.rgb);
        planes.keep(Plane::Intensity, &self.intensity);
        planes.keep(Plane::Class, &self.class);
        planes.keep(Plane::Returns, &self.returns);
        planes.keep(Plane::Source, if narrow.is_some() { &None } else { &self.source });
        planes.keep(Plane::Normal, &self.normal);
        planes.keep(Plane::GpsTime, &self.gps_time);
        planes.keep(Plane::Weight, &self.weight);
        planes.keep(Plane::Facing, &self.derived.facing);
        planes.keep(Plane::Brush, &self.derived.brush);
        planes.keep(Plane::Corrected, &self.derived.corrected);
        match narrow.as_deref() {
            Some([station, rest @ ..]) if rest.iter().all(|other| other == station) => {
                planes.single_station(*station)
            }
            Some(stations) if stations.iter().all(|&station| station < 16) => {
                planes.record.station = TWO_PER_BYTE;
                let both = |pair: &[u8]| pair[0] | pair.get(1).map_or(0, |second| second << 4);
                planes
                    .keep(Plane::Station, &Some(stations.chunks(2).map(both).collect::<Vec<u8>>()));
            }
            _ => planes.keep(Plane::Station, &narrow),
        }
        record
    }

    /// Unpacks what [`Samples::pack`] wrote, from those planes whose bytes are given.
    pub fn unpack<'b>(
        record: &NodeRecord,
        corner: [i64; 3],
        bytes: &dyn Fn(Plane) -> Option<&'b [u8]>,
    ) -> Samples {
        fn column<T: bytemuck::AnyBitPattern>(bytes: Option<&[u8]>) -> Option<Vec<T>> {
            bytes.map(|bytes| {
                bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
            })
        }
        let position_planes = record.position_planes();
        let pad = BITS_PER_PLANE * position_planes - record.bits as u32;
        let words: Vec<Vec<u32>> = PLANES[..position_planes as usize]
            .iter()
            .map(|(plane, _)| column(bytes(*plane)).expect("positions are there"))
            .collect();
        let coarser = record.coarser as u32;
        let low = [0, 1, 2]
            .map(|axis| (record.origin[axis] - if coarser == 0 { corner[axis] } else { 0 }) as u32);
        let middle = (1u32 << coarser) >> 1;
        let cell = |i: usize| {
            let cells = words.iter().fold([0u32; 3], |cells, words| {
                [0, 1, 2].map(|axis| {
                    cells[axis] << BITS_PER_PLANE
                        | words[i] >> (BITS_PER_PLANE * axis as u32) & ((1 << BITS_PER_PLANE) - 1)
                })
            });
            [0, 1, 2].map(|axis| (((cells[axis] >> pad) + low[axis]) << coarser) + middle)
        };
        Samples {
            q: (0..record.count as usize).map(cell).collect(),
            rgb: column(bytes(Plane::Rgb)),
            intensity: column(bytes(Plane::Intensity)),
            class: column(bytes(Plane::Class)),
            returns: column(bytes(Plane::Returns)),
            source: column(bytes(Plane::Source)).or_else(|| {
                let stations = record.stations(bytes(Plane::Station)?);
                Some(stations.into_iter().map(u16::from).collect())
            }),
            normal: column(bytes(Plane::Normal)),
            gps_time: column(bytes(Plane::GpsTime)),
            weight: column(bytes(Plane::Weight)),
            derived: DerivedColumns {
                facing: column(bytes(Plane::Facing)),
                brush: column(bytes(Plane::Brush)),
                corrected: column(bytes(Plane::Corrected)),
            },
        }
    }
}

/// Returns a function that finds a plane in the bytes of all planes of a node, for
/// [`Samples::unpack`].
pub fn within<'b>(record: &NodeRecord, planes: &'b [u8]) -> impl Fn(Plane) -> Option<&'b [u8]> {
    move |plane| {
        let (at, length) = record.range(plane);
        let start = (at - record.at) as usize;
        record.has(plane).then(|| &planes[start..start + length as usize])
    }
}

/// The planes of a node being packed.
struct Planes<'a> {
    record: &'a mut NodeRecord,
    bytes: &'a mut Vec<u8>,
}

impl Planes<'_> {
    /// Records a single station, without a plane.
    fn single_station(&mut self, station: u8) {
        self.record.station = station;
        self.record.planes |= 1 << Plane::Station as u16 | SINGLE_STATION;
    }

    /// Appends a column, if present, and records its plane.
    fn keep<T: bytemuck::NoUninit>(&mut self, plane: Plane, column: &Option<Vec<T>>) {
        let Some(column) = column else { return };
        let bytes: &[u8] = bytemuck::cast_slice(column);
        self.record.crc[plane as usize] = crc32c::crc32c(bytes);
        self.record.planes |= 1 << plane as u16;
        self.bytes.extend_from_slice(bytes);
    }
}
