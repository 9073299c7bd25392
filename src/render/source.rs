//! Sources of points: files read whole, or an index read on demand, through one interface.

use super::gpu_cloud::{GpuCloud, PreparedCloud};
use super::index_samples::{core_of, core_samples, samples_left, shown, strays};
use crate::cloud::attribute::{Attribute, DisplayAttribute, ExtraAttributes, tones};
use crate::cloud::crs::Reference;
use crate::cloud::digits::number;
use crate::cloud::filter::{Filter, grouped};
use crate::cloud::histograms::Histograms;
use crate::cloud::input::Input;
use crate::cloud::rgb_range::RgbRange;
use crate::cloud::robust_bounds::chosen_samples;
use crate::cloud::scalar::{self, Scalar};
use crate::cloud::strays::Treatment;
use crate::cloud::stream::FileSummary;
use crate::cloud::up::Up;
use crate::cloud::{self, Cloud, Columns, Part, ReadOptions, Station};
use crate::config;
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::index::attributes::luminance;
use crate::index::attributes::strokes::StrokeCache;
use crate::index::cache::{self, Cached};
use crate::index::fault_injection::Fault;
use crate::index::format::{Index, Plane};
use crate::index::{Arrangement, build};
use crate::network::is_address;
use crate::progress::Progress;
use crate::resident::{CloudUpload, Residency, Resident};
use crate::select::clip::{Clips, Left};
use crate::view::light::Light;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Options of opening files.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    pub read: ReadOptions,
    /// Filter of the points.
    pub filter: Filter,
    /// Reason to index files first, regardless of their number of points.
    pub index: Option<&'static str>,
    /// True if local octrees are indexed like other files, instead of being drawn in place.
    pub indexes_octrees: bool,
    /// True if all points are painted as strokes.
    pub strokes: bool,
    /// Where indexes are cached; the default location if `None`.
    pub place: Option<cache::CacheLocation>,
    /// Saved shadows of the index, and the light they must match.
    pub shadows: Option<(PathBuf, Light)>,
    /// Simulated read fault, for tests.
    pub fault: Option<Fault>,
}

impl OpenOptions {
    /// Returns a reason if files must be indexed before drawing.
    pub fn needs_index(&self, files: &[PathBuf]) -> Result<Option<String>> {
        if let Some(why) = self.index {
            return Ok(Some(why.into()));
        }
        if self.in_place(files).is_some_and(is_address) {
            return Ok(Some("it is on a server".into()));
        }
        let points = cloud::stream::summary(files)?.points;
        let (most, drawn) = match self.strokes {
            true => (config::WHOLE_STROKES, "painted as strokes"),
            false => (config::WHOLE_POINTS, "drawn"),
        };
        let many = points > most;
        Ok(many.then(|| {
            format!("{points} points are more than are {drawn} without an index ({most})")
        }))
    }

    /// Returns the file or folder if it is one octree whose nodes have all that is asked for, so
    /// that they are drawn without an index. Only points tell of stations: they are asked for to be
    /// shown or filtered, or else, with other columns, for exposures, which then stay as they are.
    fn in_place<'f>(&self, files: &'f [PathBuf]) -> Option<&'f Path> {
        let [path] = files else { return None };
        if self.indexes_octrees && !is_address(path) {
            return None;
        }
        let wanted = self.reading().wanted;
        let stations = self.filter.wanted().source
            || wanted.source && !(wanted.rgb || wanted.intensity || wanted.class);
        let others = wanted.scalars.iter().any(|own| own != Scalar::HeightAboveGround);
        let has_all = !stations && !others && self.shadows.is_none();
        (has_all && Index::is_octree(path)).then_some(path)
    }

    /// Adds saved shadows and simulated faults to an index.
    fn equipped(&self, mut index: Index, progress: &dyn Progress) -> Result<Source> {
        if let Some((path, light)) = &self.shadows {
            let shadows = index.open_shadows(path)?;
            if !light.is_written(&shadows.contents.light) {
                return Err(Error::Request(format!(
                    "{} has shadows of --light {}, but the picture's light is {light}; use that light, or cast new ones with `pointillist shadows`",
                    path.display(),
                    shadows.contents.light
                )));
            }
            index.shadows = Some(shadows);
        }
        index.hidden = if self.read.strays == Treatment::Hide { core_of(&index) } else { None };
        index.fault = self.fault;
        let headers = index.directory.contents.parts.iter().map(|part| &part.header);
        let (up, note) = self.read.up.of(headers, || core_samples(&index));
        index.up = up;
        index.directory.contents.notes.extend(note);
        if self.reading().wanted.scalars.has(Scalar::HeightAboveGround) {
            let note = index.find_ground(progress)?;
            index.directory.contents.notes.extend(note);
        }
        if !self.filter.is_empty() {
            let compiled = index.compile(&self.filter)?;
            let (points, counts) =
                (index.directory.contents.points, &index.directory.contents.counts);
            if let Some(Histograms { classes, returns }) = counts
                && self.filter.leaves_none_of(classes, returns)
            {
                let listed = |kinds: &[(u8, u64)]| {
                    let numbers: Vec<_> = kinds.iter().map(|(kind, _)| kind.to_string()).collect();
                    numbers.join(", ")
                };
                return Err(Error::Request(format!(
                    "{} leaves none of {} points; classes present: {}; returns present: {}",
                    self.filter.words(),
                    grouped(points),
                    listed(classes),
                    listed(returns)
                )));
            }
            index.filter = Some(compiled);
        }
        Ok(Source::Index(Arc::new(index)))
    }

    /// Returns how files are read, with the columns that the filter looks at.
    fn reading(&self) -> ReadOptions {
        ReadOptions { wanted: self.read.wanted.and(self.filter.wanted()), ..self.read }
    }

    fn place(&self) -> Result<cache::CacheLocation> {
        self.place.clone().map_or_else(cache::CacheLocation::user_folder, Ok)
    }
}

/// Errors if a colour range is requested for an index, whose colours are fixed.
pub fn refuse_rgb_range(index: &Path, asked: Option<RgbRange>) -> Result<()> {
    match asked {
        Some(_) => Err(Error::Request(format!(
            "--rgb-range has no effect: {} is an index, whose colours were read when it was made; give --rgb-range to `pointillist index`",
            index.display()
        ))),
        None => Ok(()),
    }
}

/// Opens what is on servers, with reports of progress; from then on it is known.
fn connect(paths: &[PathBuf], progress: &dyn Progress) -> Result<()> {
    let mut remote = paths.iter().filter(|path| is_address(path));
    remote.try_for_each(|path| Input::open_slowly(path, progress).map(drop))
}

/// A sample of the points of files.
pub struct Preview {
    pub source: Source,
    /// Number of points of the files, by their headers.
    pub points: u64,
}

pub enum Source {
    Files(Cloud),
    Index(Arc<Index>),
}

/// Returns the least and the greatest coordinates of points; None if there are none.
pub fn bounds_of(points: &[DVec3]) -> Option<[DVec3; 2]> {
    let each = points.iter().map(|&point| [point; 2]);
    each.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)])
}

impl Source {
    /// Opens files or one index. Of files too large to draw whole, octrees are drawn in place;
    /// others are indexed first, or their cached index is used.
    pub fn open(
        paths: &[PathBuf],
        opening: &OpenOptions,
        progress: &dyn Progress,
    ) -> Result<Source> {
        connect(paths, progress)?;
        match paths.iter().find(|path| Index::is_one(path)) {
            Some(path) if paths.len() == 1 => {
                refuse_rgb_range(path, opening.read.rgb_range)?;
                return opening.equipped(Index::open(path)?, progress);
            }
            Some(path) => {
                return Err(Error::Request(format!(
                    "{} is an index and must be the only input; `pointillist index` makes one of several files",
                    path.display()
                )));
            }
            None => {}
        }
        let Some(why) = opening.needs_index(paths)? else {
            if let Some((path, _)) = &opening.shadows {
                return Err(Error::Request(format!(
                    "{} has shadows of an index, but the input is not one; `pointillist index` makes one",
                    path.display()
                )));
            }
            let mut cloud = cloud::read(paths, &opening.reading(), progress)?;
            cloud.filter(&opening.filter)?;
            return Ok(Source::Files(cloud));
        };
        if let Some(path) = opening.in_place(paths) {
            match Index::open_octree(path, opening.read.rgb_range, opening.read.strict) {
                Ok(index) => {
                    progress.note(&format!("drawn in place, because {why}"));
                    return opening.equipped(index, progress);
                }
                // Of a server all points would have to be fetched.
                Err(error) if opening.read.strict || is_address(path) => return Err(error),
                Err(error) => progress.note(&format!("{error}; its points are indexed instead")),
            }
        }
        let (place, build) = (opening.place()?, build::Options::reading(&opening.reading()));
        let Cached { index, made } = cache::find_or_build(paths, &place, &build, progress)?;
        match made {
            Some(made) => progress.note(&format!(
                "indexed in {:.1} s, because {why}; kept: {}",
                made.seconds,
                kept(&place)
            )),
            None => progress.note(&format!("drawn from {}, because {why}", index.path().display())),
        }
        opening.equipped(index, progress)
    }

    /// Returns a sample while files are indexed or slowly read; `None` if reading is fast.
    pub fn preview(
        paths: &[PathBuf],
        opening: &OpenOptions,
        progress: &dyn Progress,
    ) -> Result<Option<Preview>> {
        connect(paths, progress)?;
        if paths.iter().any(|path| Index::is_one(path)) {
            return Ok(None);
        }
        let FileSummary { points, compressed } = cloud::stream::summary(paths)?;
        let (soon, some) = match opening.needs_index(paths)? {
            Some(_) if opening.in_place(paths).is_some() => (true, points),
            Some(_) => (
                cache::is_there(
                    paths,
                    &opening.place()?,
                    &build::Options::reading(&opening.reading()),
                )?,
                points,
            ),
            None => (
                points + compressed * (config::DECOMPRESSION - 1) < config::SLOW_POINTS,
                points / config::PREVIEW_SHARE,
            ),
        };
        if soon {
            return Ok(None);
        }
        let some = some.min(config::PREVIEW_POINTS);
        let sample = cloud::sample(paths, &opening.reading(), some, progress)?;
        // A sample may have none of the points that are left.
        let left = sample.and_then(|mut cloud| cloud.filter(&opening.filter).ok().map(|()| cloud));
        Ok(left.map(|cloud| Preview { source: Source::Files(cloud), points }))
    }

    /// Returns notes on the files, and on requested attributes that the index lacks.
    pub fn notes(&self, wanted: ExtraAttributes) -> Vec<String> {
        match self {
            Source::Files(cloud) => {
                cloud.notes.iter().cloned().chain(cloud.strays().note()).collect()
            }
            Source::Index(index) => {
                let lacks = wanted.strokes && !index.has(Plane::Brush);
                let found = || {
                    format!(
                        "strokes are derived node by node, so that nodes may show: {} for all",
                        self.index_again(indexed_files(index), "--strokes")
                    )
                };
                let strays = strays(index).note().map(|said| match index.hidden {
                    Some(_) => format!("{said}; hidden by --strays hide"),
                    None => said,
                });
                index
                    .directory
                    .contents
                    .notes
                    .iter()
                    .cloned()
                    .chain(lacks.then(found))
                    .chain(strays)
                    .collect()
            }
        }
    }

    pub fn points(&self) -> u64 {
        match self {
            Source::Files(cloud) => cloud.len(),
            Source::Index(index) => index.directory.contents.points,
        }
    }

    /// Returns the files of its points, in the order of their parts.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = match self {
            Source::Files(cloud) => cloud.parts.iter().map(|part| part.path.clone()).collect(),
            Source::Index(index) => indexed_files(index).into_iter().cloned().collect(),
        };
        // Scans of one file are adjacent.
        files.dedup();
        files
    }

    pub fn stations(&self) -> &[Station] {
        match self {
            Source::Files(cloud) => &cloud.stations,
            Source::Index(index) => &index.directory.contents.stations,
        }
    }

    /// Returns the coordinate system.
    pub fn reference(&self) -> Reference {
        match self {
            Source::Files(cloud) => {
                Reference::of(cloud.parts.iter().map(|part| (&part.header, part.lattice)))
            }
            Source::Index(index) => index.reference(),
        }
    }

    /// Returns the histograms of classes and return numbers, if known.
    pub fn counts(&self) -> Option<Histograms> {
        match self {
            Source::Files(cloud) => {
                Some(Histograms::of(cloud.parts.iter().map(|part| &part.columns)))
            }
            Source::Index(index) => index.directory.contents.counts.clone(),
        }
    }

    /// Returns what its points can show: also what was not read of files, and numbers that only
    /// these have names for.
    pub fn attributes(&self) -> Vec<Attribute> {
        let names: Vec<String> = match self {
            Source::Files(cloud) => {
                cloud.parts.iter().flat_map(|part| part.header.scalars.iter().cloned()).collect()
            }
            Source::Index(index) => index.directory.contents.scalar.iter().cloned().collect(),
        };
        let is_there = |attribute: &Attribute| match self {
            Source::Files(cloud) => {
                cloud.parts.iter().any(|part| attribute.is_readable(&part.header))
            }
            Source::Index(index) => index.shows(*attribute),
        };
        let mut all: Vec<Attribute> = Attribute::NAMED.into_iter().filter(is_there).collect();
        for attribute in names.iter().filter_map(|name| name.parse::<Attribute>().ok()) {
            if !all.contains(&attribute) {
                all.push(attribute);
            }
        }
        all
    }

    /// Returns the number of nodes of an index.
    pub fn nodes(&self) -> Option<usize> {
        match self {
            Source::Files(_) => None,
            Source::Index(index) => Some(index.nodes().len()),
        }
    }

    /// Returns the axis that points up.
    pub fn up(&self) -> Up {
        match self {
            Source::Files(cloud) => cloud.up,
            Source::Index(index) => index.up,
        }
    }

    /// Returns the points that a camera should frame.
    pub fn core_points(&self) -> Vec<DVec3> {
        match self {
            Source::Files(cloud) => cloud.core_points(),
            Source::Index(index) => core_samples(index),
        }
    }

    /// Returns the points that a camera should frame of those that clip boxes leave; of all, if
    /// they leave none.
    pub fn framed_points(&self, clips: &Clips) -> Vec<DVec3> {
        let kept = match self {
            _ if clips.active() == 0 => Vec::new(),
            Source::Files(cloud) => cloud.chosen_points(|p| clips.keep(p)),
            Source::Index(index) => chosen_samples(samples_left(index, clips)),
        };
        if kept.is_empty() { self.core_points() } else { kept }
    }

    /// Returns the attribute to display, and the reason.
    pub fn shown(&self, asked: Option<Attribute>) -> Result<(DisplayAttribute, String)> {
        let Some(attribute) = asked else {
            let (mut shown, why) = self.automatic();
            self.brighten(&mut shown);
            return Ok((shown, why.to_string()));
        };
        if self.points() > 0 && !self.has(attribute) {
            let (name, how) = (attribute.name(), self.how_to_find(attribute));
            return Err(Error::Request(format!(
                "--color {name}: the points do not have it; {how}"
            )));
        }
        let mut shown = match self {
            Source::Files(cloud) => DisplayAttribute::new(attribute, cloud),
            Source::Index(index) => shown(index, attribute),
        };
        self.brighten(&mut shown);
        Ok((shown, format!("requested with --color {}", attribute.name())))
    }

    /// Stretches dark colours: by all points, or by the roots' samples of an index that is
    /// filtered, old, or an octree.
    fn brighten(&self, shown: &mut DisplayAttribute) {
        match self {
            _ if shown.attribute != Attribute::Rgb => {}
            Source::Files(cloud) => {
                let colors = cloud.parts.iter().filter_map(|part| part.columns.rgb.as_deref());
                shown.brighten(&tones(colors));
            }
            Source::Index(index)
                if index.filter.is_none() && !index.directory.contents.tones.is_empty() =>
            {
                shown.brighten(&index.directory.contents.tones);
            }
            Source::Index(index) => {
                let roots = &index.nodes()[..index.directory.roots as usize];
                let mut colors = Vec::new();
                for (node, root) in roots.iter().enumerate().filter(|(_, r)| r.has(Plane::Rgb)) {
                    let mut bytes = vec![0; root.unpacked_bytes(Plane::Rgb) as usize];
                    // An unreadable root is reported when drawn.
                    if index.read(node, Plane::Rgb, &mut bytes).is_ok() {
                        colors.extend_from_slice(bytes.as_chunks().0);
                    }
                }
                shown.brighten(&tones([&colors[..]].into_iter()));
            }
        }
    }

    /// Computes corrected colours of a cloud in memory if displayed; they replace its own.
    pub fn find(&mut self, asked: Option<Attribute>, progress: &dyn Progress) -> Result<()> {
        match self {
            Source::Files(cloud) if asked == Some(Attribute::Corrected) => {
                luminance::correct(cloud, luminance::NEIGHBOURS, progress)
            }
            _ => Ok(()),
        }
    }

    /// Returns advice on how to get a missing attribute.
    pub fn how_to_find(&self, attribute: Attribute) -> String {
        let (files, option) = match (self, attribute) {
            (Source::Files(cloud), Attribute::Normal) => {
                (cloud.parts.iter().map(|part| &part.path).collect(), "--normals")
            }
            (Source::Index(index), Attribute::Normal) => (indexed_files(index), "--normals"),
            (Source::Index(index), Attribute::Corrected) if index.has(Plane::Rgb) => {
                (indexed_files(index), "--luminance")
            }
            (Source::Files(cloud), Attribute::Scalar(_)) if !cloud.parts.is_empty() => {
                // Other columns were not read.
                let own = cloud.parts[0].header.scalars.iter().cloned();
                let names: Vec<_> = own.chain(["height-above-ground".into()]).collect();
                return format!(
                    "they have {}; `pointillist info` lists all",
                    scalar::listed(&names)
                );
            }
            (Source::Index(index), Attribute::Time | Attribute::Scalar(_)) => {
                let option = format!("--keep {}", attribute.name());
                return self.index_again(indexed_files(index), &option);
            }
            _ => return "`pointillist info` lists their attributes".into(),
        };
        self.index_again(files, option)
    }

    fn index_again(&self, files: Vec<&PathBuf>, option: &str) -> String {
        let mut files: Vec<String> =
            files.into_iter().map(|path| path.display().to_string()).collect();
        files.dedup();
        let more = if files.len() > 3 { " ..." } else { "" };
        files.truncate(3);
        let output = match self {
            Source::Index(index) if !self.files().iter().any(|file| file == index.path()) => {
                index.path().display().to_string()
            }
            _ => "OUT.pnti".into(),
        };
        format!("`pointillist index {}{more} -o {output} {option}` finds them", files.join(" "))
    }

    /// Errors if clip boxes leave nothing: of files no point, of an index no node.
    pub fn check_clips(&self, clips: &Clips) -> Result<()> {
        let (is_left, bounds) = match self {
            Source::Files(cloud) => {
                let is_left = |part: &Part| {
                    let Columns { x, y, z, .. } = &part.columns;
                    let place = |i| part.lattice.world([x[i], y[i], z[i]].map(i64::from));
                    (0..x.len()).any(|i| clips.keep(place(i)))
                };
                (cloud.parts.iter().any(is_left), cloud.bounds())
            }
            Source::Index(index) => {
                let is_left = |node| clips.left(index.bounds(node)) != Left::Nothing;
                let bounds = index.directory.contents.bounds.map(|[low, high]| (low, high));
                (index.nodes().iter().any(is_left), bounds)
            }
        };
        let Some((low, high)) = bounds.filter(|_| !is_left) else { return Ok(()) };
        let [low, high] = [low, high]
            .map(|corner| self.reference().digits.round(corner).to_array().map(number).join(" "));
        let points = grouped(self.points());
        Err(Error::Request(format!(
            "--clip leaves none of {points} points; they lie in {low} to {high}{}",
            self.reference().said()
        )))
    }

    /// Tests whether points need their kind on the device for a filter.
    pub fn is_filtered(&self) -> bool {
        matches!(self, Source::Index(index) if index.filter.is_some())
    }

    /// Tests whether all points have saved visibility of a light.
    pub fn has_light(&self) -> bool {
        matches!(self, Source::Index(index) if index.shadows.is_some())
    }

    /// Tests whether some points have normals.
    pub fn has_normals(&self) -> bool {
        self.has(Attribute::Normal)
    }

    fn has(&self, attribute: Attribute) -> bool {
        match self {
            Source::Files(cloud) => attribute.is_in(cloud),
            Source::Index(index) => index.shows(attribute),
        }
    }

    /// Chooses the attribute as [`DisplayAttribute::automatic`].
    fn automatic(&self) -> (DisplayAttribute, &'static str) {
        let index = match self {
            Source::Files(cloud) => return DisplayAttribute::automatic(cloud),
            Source::Index(index) => index,
        };
        if self.has(Attribute::Rgb) {
            return (shown(index, Attribute::Rgb), "the points have colours");
        }
        let intensity = shown(index, Attribute::Intensity);
        if index.nodes().iter().all(|node| node.has(Plane::Intensity))
            && intensity.stretch[1] > intensity.stretch[0]
        {
            return (intensity, "no colours, but an intensity that varies");
        }
        (shown(index, Attribute::Elevation), "no colours, and no intensity that varies")
    }

    /// Uploads files entirely; of an index nothing yet.
    pub fn upload(
        self,
        gpu: &mut Gpu,
        shown: DisplayAttribute,
        pool_bytes: u64,
        progress: &dyn Progress,
    ) -> Result<GpuCloud> {
        Ok(match self {
            Source::Files(cloud) => {
                GpuCloud::Whole(Box::new(Resident::fill(gpu, cloud, shown, progress)?))
            }
            Source::Index(index) => {
                GpuCloud::Parts(Box::new(Residency::open(gpu, index, shown, pool_bytes)?))
            }
        })
    }

    /// Prepares all that needs no device, on another thread. `found` caches strokes.
    pub fn prepare(
        self,
        shown: DisplayAttribute,
        found: &Arc<StrokeCache>,
        progress: &dyn Progress,
    ) -> Result<PreparedCloud> {
        Ok(match self {
            Source::Files(cloud) => {
                let mut upload = CloudUpload::new(cloud, shown, Some(found.clone()));
                while upload.build_nodes(Arrangement::Morton, progress)? {}
                PreparedCloud::Files(Box::new(upload))
            }
            Source::Index(index) => PreparedCloud::Index(index, Box::new(shown)),
        })
    }
}

fn indexed_files(index: &Index) -> Vec<&PathBuf> {
    index.directory.contents.parts.iter().map(|part| &part.path).collect()
}

fn kept(place: &cache::CacheLocation) -> String {
    match place {
        cache::CacheLocation::Folder(folder) => format!("in {}", folder.display()),
        cache::CacheLocation::Temporary => "not at all".into(),
    }
}
