//! Small files with known contents: LAS of any version, format and variable-length records.

use laz::{LasZipCompressor, LazItemRecordBuilder, LazVlrBuilder};
use std::path::{Path, PathBuf};

/// Values of a record that tests set.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub q: [i32; 3],
    pub rgb: [u16; 3],
    pub time: f64,
}

/// A variable-length record: user, number, contents.
pub type Vlr = (&'static str, u16, Vec<u8>);

#[derive(Clone, Debug)]
pub struct Las {
    pub minor: u8,
    pub format: u8,
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    pub vlrs: Vec<Vlr>,
    /// Records behind the points.
    pub evlrs: Vec<Vlr>,
    /// Bytes that follow the fields of the format in each record.
    pub extra: u16,
    pub points: Vec<Point>,
}

impl Default for Las {
    fn default() -> Las {
        Las {
            minor: 2,
            format: 3,
            scale: [0.001; 3],
            offset: [0.0; 3],
            vlrs: Vec::new(),
            evlrs: Vec::new(),
            extra: 0,
            points: sheet(|_| [0; 3]),
        }
    }
}

/// Returns a wavy sheet of 5000 points, 20 x 20 m in steps of millimetres, coloured by the points'
/// numbers.
pub fn sheet(rgb: impl Fn(usize) -> [u16; 3]) -> Vec<Point> {
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 31) as f64 * 20.0
    };
    let point = |i| {
        let (x, y) = (next(), next());
        let z = 2.0 * (x * 0.7).sin() + (y * 0.5).cos();
        Point { q: [x, y, z].map(|v| (v * 1000.0) as i32), rgb: rgb(i), time: i as f64 * 0.5 }
    };
    (0..5000).map(point).collect()
}

const WIDTHS: [u16; 9] = [20, 28, 26, 34, 57, 63, 30, 36, 38];

impl Las {
    fn width(&self) -> u16 {
        WIDTHS[self.format as usize] + self.extra
    }

    fn record(&self, point: &Point) -> Vec<u8> {
        let modern = self.format >= 6;
        let mut record: Vec<u8> = point.q.iter().flat_map(|q| q.to_le_bytes()).collect();
        record.extend([0, 0]);
        record.extend(if modern {
            vec![0x11, 0, 2, 0, 0, 0, 0, 0]
        } else {
            vec![0b001_001, 2, 0, 0, 0, 0]
        });
        if !matches!(self.format, 0 | 2) {
            record.extend(point.time.to_le_bytes());
        }
        if matches!(self.format, 2 | 3 | 5 | 7 | 8) {
            record.extend(point.rgb.iter().flat_map(|v| v.to_le_bytes()));
        }
        record.resize(self.width() as usize, 0);
        record
    }

    fn head(&self, vlrs: &[Vlr], compressed: bool) -> Vec<u8> {
        let length = [227, 227, 227, 235, 375, 375][self.minor as usize];
        let mut head = vec![0u8; length];
        head[..4].copy_from_slice(b"LASF");
        (head[24], head[25], head[104]) = (1, self.minor, self.format | (compressed as u8) << 7);
        let between: usize = vlrs.iter().map(|(_, _, contents)| 54 + contents.len()).sum();
        let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
        put(94, &(length as u16).to_le_bytes());
        put(96, &((length + between) as u32).to_le_bytes());
        put(100, &(vlrs.len() as u32).to_le_bytes());
        put(105, &self.width().to_le_bytes());
        let count = self.points.len();
        let legacy = if self.format < 6 { count as u32 } else { 0 };
        put(107, &legacy.to_le_bytes());
        put(111, &legacy.to_le_bytes());
        for axis in 0..3 {
            put(131 + 8 * axis, &self.scale[axis].to_le_bytes());
            put(155 + 8 * axis, &self.offset[axis].to_le_bytes());
            let place = |q: i32| self.offset[axis] + self.scale[axis] * q as f64;
            let places = || self.points.iter().map(|point| place(point.q[axis]));
            put(179 + 16 * axis, &places().fold(f64::NEG_INFINITY, f64::max).to_le_bytes());
            put(187 + 16 * axis, &places().fold(f64::INFINITY, f64::min).to_le_bytes());
        }
        if self.minor >= 4 {
            let body = count * self.width() as usize;
            put(235, &((length + between + body) as u64).to_le_bytes());
            put(243, &(self.evlrs.len() as u32).to_le_bytes());
            put(247, &(count as u64).to_le_bytes());
            put(255, &(count as u64).to_le_bytes());
        }
        for (user, number, contents) in vlrs {
            head.extend([0; 2]);
            head.extend(user.bytes().chain(std::iter::repeat(0)).take(16));
            head.extend(number.to_le_bytes());
            head.extend((contents.len() as u16).to_le_bytes());
            head.extend([0; 32]);
            head.extend(contents);
        }
        head
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut file = self.head(&self.vlrs, false);
        self.points.iter().for_each(|point| file.extend(self.record(point)));
        for (user, number, contents) in &self.evlrs {
            file.extend([0; 2]);
            file.extend(user.bytes().chain(std::iter::repeat(0)).take(16));
            file.extend(number.to_le_bytes());
            file.extend((contents.len() as u64).to_le_bytes());
            file.extend([0; 32]);
            file.extend(contents);
        }
        file
    }

    /// Returns the compressed file, in chunks of 1000 points and without records behind the points.
    pub fn laz(&self) -> Vec<u8> {
        let items =
            LazItemRecordBuilder::default_for_point_format_id(self.format, self.extra).unwrap();
        let laszip = LazVlrBuilder::new(items).with_fixed_chunk_size(1000).build();
        let mut contents = Vec::new();
        laszip.write_to(&mut contents).unwrap();
        let mut vlrs = self.vlrs.clone();
        vlrs.push(("laszip encoded", 22204, contents));
        let mut sink = std::io::Cursor::new(Vec::new());
        std::io::Write::write_all(
            &mut sink,
            &Las { evlrs: Vec::new(), ..self.clone() }.head(&vlrs, true),
        )
        .unwrap();
        let mut compressor = LasZipCompressor::new(sink, laszip).unwrap();
        self.points.iter().for_each(|point| compressor.compress_one(&self.record(point)).unwrap());
        compressor.done().unwrap();
        compressor.into_inner().into_inner()
    }

    pub fn write(&self, folder: &Path, name: &str) -> PathBuf {
        let path = folder.join(name);
        let bytes = if name.ends_with(".laz") { self.laz() } else { self.bytes() };
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

/// Returns the same LAS file with its records in another order.
pub fn shuffled(las: &[u8]) -> Vec<u8> {
    let number = |at: usize| u32::from_le_bytes(las[at..at + 4].try_into().unwrap()) as usize;
    let (start, bytes) = (number(96), u16::from_le_bytes([las[105], las[106]]) as usize);
    let mut records: Vec<&[u8]> = las[start..start + bytes * number(107)].chunks(bytes).collect();
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    for i in (1..records.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        records.swap(i, (state % (i as u64 + 1)) as usize);
    }
    [&las[..start], &records.concat()].concat()
}
