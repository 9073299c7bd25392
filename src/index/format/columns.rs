//! A node's points as columns: of a leaf, the points of the files on their own lattice.

use super::file::Index;
use super::schema::{NodeRecord, Plane};
use crate::cloud::attribute::Attribute;
use crate::cloud::filter::{Compiled, Filter, Meaning, Origin};
use crate::cloud::ground;
use crate::cloud::scalar::{Scalar, ScalarColumn, Scalars};
use crate::cloud::{ColumnSet, Columns};
use crate::config::BITS_PER_PLANE;
use crate::error::{Error, Result};

impl NodeRecord {
    /// Returns the columns that it has.
    pub fn available(&self) -> ColumnSet {
        ColumnSet {
            rgb: self.has(Plane::Rgb),
            intensity: self.has(Plane::Intensity),
            class: self.has(Plane::Class),
            returns: self.has(Plane::Returns),
            source: Plane::STATIONS.into_iter().any(|plane| self.has(plane)),
            normal: self.has(Plane::Normal),
            gps_time: self.has(Plane::GpsTime),
            scalars: Scalars::NONE,
        }
    }
}

impl Index {
    /// Returns the columns that some node has.
    pub fn available(&self) -> ColumnSet {
        let all = self.nodes().iter().map(NodeRecord::available);
        let all = all.fold(ColumnSet::default(), ColumnSet::and);
        let kept = self.kept_scalar().filter(|_| all.gps_time);
        let above = self.ground.is_some().then_some(Scalar::HeightAboveGround);
        let scalars = kept.into_iter().chain(above).collect();
        ColumnSet { gps_time: all.gps_time && self.has_times(), scalars, ..all }
    }

    /// Tests whether some node can show an attribute.
    pub fn shows(&self, attribute: Attribute) -> bool {
        if let Attribute::Scalar(scalar) = attribute {
            return self.available().scalars.has(scalar);
        }
        let planes = Plane::of(attribute);
        planes.is_empty()
            || self.directory.contents.keeps(attribute)
                && planes.iter().any(|&plane| self.has(plane))
    }

    /// Returns the scalar that it keeps in place of times.
    fn kept_scalar(&self) -> Option<Scalar> {
        self.directory.contents.scalar.as_ref()?.parse().ok()
    }

    fn has_times(&self) -> bool {
        self.directory.contents.keeps(Attribute::Time)
    }

    /// Reads the wanted columns of a node. Coordinates count from [`NodeRecord::origin`] on its
    /// lattice; `source` is the station number.
    pub fn columns(&self, node: usize, wanted: ColumnSet) -> Result<Columns> {
        let record = &self.nodes()[node];
        let count = record.count as usize;
        let mut columns = Columns {
            x: vec![0; count],
            y: vec![0; count],
            z: vec![0; count],
            ..Columns::default()
        };
        let mut words = vec![0u32; count];
        for plane in 0..record.position_planes() {
            let plane = super::schema::PLANES[plane as usize].0;
            self.read(node, plane, bytemuck::cast_slice_mut(&mut words))?;
            let axes = [&mut columns.x, &mut columns.y, &mut columns.z];
            for (axis, steps) in axes.into_iter().enumerate() {
                let shift = BITS_PER_PLANE * axis as u32;
                steps.iter_mut().zip(&words).for_each(|(steps, word)| {
                    *steps = *steps << BITS_PER_PLANE
                        | (word >> shift & ((1 << BITS_PER_PLANE) - 1)) as i32
                });
            }
        }
        let pad = BITS_PER_PLANE * record.position_planes() - record.bits as u32;
        for steps in [&mut columns.x, &mut columns.y, &mut columns.z] {
            steps.iter_mut().for_each(|steps| *steps >>= pad);
        }
        columns.rgb = self.column(node, wanted.rgb, Plane::Rgb)?;
        columns.intensity = self.column(node, wanted.intensity, Plane::Intensity)?;
        columns.class = self.column(node, wanted.class, Plane::Class)?;
        columns.returns = self.column(node, wanted.returns, Plane::Returns)?;
        columns.normal = self.column(node, wanted.normal, Plane::Normal)?;
        columns.gps_time =
            self.column(node, wanted.gps_time && self.has_times(), Plane::GpsTime)?;
        let kept = self.kept_scalar().filter(|&kept| wanted.scalars.has(kept));
        let numbers = self.column(node, kept.is_some(), Plane::GpsTime)?;
        let kept = kept.zip(numbers).map(|(scalar, numbers)| ScalarColumn { scalar, numbers });
        columns.scalars.extend(kept);
        if wanted.scalars.has(Scalar::HeightAboveGround)
            && let Some(ground) = &self.ground
        {
            let (lattice, shift) = (&self.lattice(record), record.origin);
            let batch = ground::Batch { columns: &columns, lattice, shift, corner: [0; 3] };
            let above = ground.column(batch);
            columns.scalars.push(above);
        }
        columns.source = self.column(node, wanted.source, Plane::Source)?;
        if let Some(narrow) = self.column::<u8>(node, wanted.source, Plane::Station)? {
            columns.source = Some(narrow.into_iter().map(u16::from).collect());
        }
        Ok(columns)
    }

    fn column<T: bytemuck::Pod>(
        &self,
        node: usize,
        wanted: bool,
        plane: Plane,
    ) -> Result<Option<Vec<T>>> {
        let record = &self.nodes()[node];
        if !wanted || !record.has(plane) {
            return Ok(None);
        }
        let mut values = vec![T::zeroed(); record.count as usize];
        self.read(node, plane, bytemuck::cast_slice_mut(&mut values))?;
        Ok(Some(values))
    }

    /// Compiles a filter for the columns of all nodes.
    pub fn compile(&self, filter: &Filter) -> Result<Compiled> {
        let contents = &self.directory.contents;
        let mut ranges = contents.parts.iter().map(|part| part.intensity_range);
        let intensity_range = ranges.next().unwrap_or([0.0, 65535.0]);
        if filter.wanted().intensity && ranges.any(|range| range != intensity_range) {
            return Err(Error::Request(format!(
                "{}: the files of {} count intensities in different units; filter the files themselves",
                filter.words(),
                self.path().display()
            )));
        }
        filter.check(self.available(), &|name| match name {
            "gps-time" => format!(
                "`pointillist index FILES -o {} --gps-time` keeps it",
                self.path().display()
            ),
            scalar if scalar.parse::<Scalar>().is_ok() => format!(
                "`pointillist index FILES -o {} --keep {scalar}` keeps it",
                self.path().display()
            ),
            _ => "`pointillist info` lists its planes".into(),
        })?;
        let origin = |station: usize| {
            let Some(station) = contents.stations.get(station) else { return Origin::default() };
            let Some(part) = contents.parts.get(station.part) else { return Origin::default() };
            let file = part.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Origin { file, scan: part.name.clone(), source: station.source }
        };
        let sources = contents.stations.len().max(1);
        Ok(filter.compile(&Meaning { intensity_range, sources, origin: &origin }))
    }

    /// Returns which points of a node a filter leaves.
    pub fn left(&self, node: usize, filter: &Compiled) -> Result<Vec<bool>> {
        let record = &self.nodes()[node];
        let columns = self.columns(node, filter.wanted)?;
        Ok(filter.left(&columns, &self.lattice(record), record.origin))
    }
}
