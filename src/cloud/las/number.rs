//! Numbers in LAS records that have no column: near infrared, scan angles and extra bytes.

use super::header::{ExtraBytes, Layout, array_at, record_bytes};
use crate::cloud::scalar::{Scalar, Scalars};

/// Where a number is in a record, and how it is read.
#[derive(Clone, Copy)]
pub struct Number {
    at: usize,
    /// Type as in declarations of extra bytes: eight integers of growing width, two floats.
    kind: u8,
    scale: f64,
    offset: f64,
    /// The value that stands for none.
    no_data: Option<f64>,
}

/// Types of extra bytes.
const I8: u8 = 2;
const U16: u8 = 3;
const I16: u8 = 4;

/// Scan angles of formats from 6 on `[degrees]`.
pub const ANGLE_STEP: f64 = 0.006;

/// Returns the names of the numbers of a file, as [`Scalar`] is written.
pub fn names(layout: &Layout) -> Vec<String> {
    let own = [Scalar::NearInfrared, Scalar::ScanAngle].into_iter();
    let own = own.filter(|&scalar| Number::of(layout, scalar).is_some());
    let extra = layout.extra_bytes.iter().filter(|extra| extra.is_number());
    let extra = extra.map(|extra| Scalar::extra_name(&extra.name));
    own.map(|scalar| scalar.to_string()).chain(extra).collect()
}

/// Returns the numbers of records that are in a set.
pub fn wanted(layout: &Layout, wanted: Scalars) -> Vec<(Scalar, Number)> {
    let all = names(layout).into_iter().filter_map(|name| name.parse().ok());
    let asked = all.filter_map(|own: Scalar| match own {
        Scalar::Extra(name) => wanted.extra(name),
        own => Some(own).filter(|own| wanted.has(*own)),
    });
    let mut found: Vec<_> = asked.filter_map(|own| Some((own, Number::of(layout, own)?))).collect();
    // Sorts and removes duplicates, as sets of scalars do.
    found.sort_by_key(|(scalar, _)| *scalar);
    found.dedup_by_key(|(scalar, _)| *scalar);
    found
}

impl Number {
    /// Finds a number; `None` if records do not have it.
    pub fn of(layout: &Layout, scalar: Scalar) -> Option<Number> {
        let plain = |at, kind, scale| Number { at, kind, scale, offset: 0.0, no_data: None };
        match scalar {
            Scalar::NearInfrared => matches!(layout.format, 8 | 10).then(|| plain(36, U16, 1.0)),
            Scalar::ScanAngle if layout.format < 6 => Some(plain(16, I8, 1.0)),
            Scalar::ScanAngle => Some(plain(18, I16, ANGLE_STEP)),
            Scalar::HeightAboveGround => None,
            Scalar::Extra(_) => {
                let mut at = record_bytes(layout.format) as usize;
                let extra = layout.extra_bytes.iter().find(|extra| {
                    let is_it = scalar.is_extra(&extra.name);
                    at += if is_it { 0 } else { extra.bytes };
                    is_it
                })?;
                let ExtraBytes { kind, scale, offset, .. } = *extra;
                let stored = Number { at: 0, kind, scale: 1.0, offset: 0.0, no_data: None };
                let no_data = extra.no_data.map(|bytes| stored.declared(bytes));
                (1..=10).contains(&kind).then_some(Number { at, kind, scale, offset, no_data })
            }
        }
    }

    /// Returns the number of a record; NaN if it has none.
    #[inline]
    pub fn value(&self, row: &[u8]) -> f64 {
        let stored = stored(self.kind, &row[self.at..]);
        match self.no_data {
            Some(none) if none == stored => f64::NAN,
            _ => stored * self.scale + self.offset,
        }
    }

    /// Returns a value of a declaration, where numbers are stored in the widest type of their kind.
    fn declared(&self, bytes: [u8; 8]) -> f64 {
        match self.kind {
            1 | 3 | 5 | 7 => u64::from_le_bytes(bytes) as f64,
            2 | 4 | 6 | 8 => i64::from_le_bytes(bytes) as f64,
            _ => f64::from_le_bytes(bytes),
        }
    }
}

/// Returns the first number of bytes, of a type as in declarations of extra bytes.
#[inline]
pub fn stored(kind: u8, bytes: &[u8]) -> f64 {
    match kind {
        1 => bytes[0].into(),
        I8 => i8::from_le_bytes(array_at(bytes, 0)).into(),
        U16 => u16::from_le_bytes(array_at(bytes, 0)).into(),
        I16 => i16::from_le_bytes(array_at(bytes, 0)).into(),
        5 => u32::from_le_bytes(array_at(bytes, 0)).into(),
        6 => i32::from_le_bytes(array_at(bytes, 0)).into(),
        7 => u64::from_le_bytes(array_at(bytes, 0)) as f64,
        8 => i64::from_le_bytes(array_at(bytes, 0)) as f64,
        9 => f32::from_le_bytes(array_at(bytes, 0)).into(),
        _ => f64::from_le_bytes(array_at(bytes, 0)),
    }
}
