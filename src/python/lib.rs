//! The Python package: pictures of arrays and files as arrays.
//!
//! Options are those of the command line, with their names, and pictures are those of
//! `pointillist render`, byte for byte. The interpreter is released while files are read and frames
//! are drawn; an interrupt ends both. Documentation of Python's functions is for Python; types are
//! in `pointillist.pyi`.

use clap::Parser;
use numpy::{Element, PyArray, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pointillist::cli::options::PictureOptions;
use pointillist::cloud::points::{Points, Positions};
use pointillist::cloud::{self, Cloud};
use pointillist::error::{Error, Result};
use pointillist::graph::{Buffer, CompletedSubmission, Graph};
use pointillist::names::Named;
use pointillist::output::tiled;
use pointillist::passes::{Switch, encode};
use pointillist::progress::Progress;
use pointillist::render::frame::Outcome;
use pointillist::render::source::Source;
use pointillist::renderer::{self, CloudId, RendererOptions};
use pointillist::view::{Camera, Covered, Preset, View};
use pointillist::{config, gpu};
use pyo3::exceptions::{PyException, PyKeyboardInterrupt, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::collections::BTreeMap;
use std::ffi::CString;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

pyo3::create_exception!(
    pointillist,
    PointillistError,
    PyException,
    "A file cannot be read, a device lacks something, or a picture cannot be drawn."
);

/// Pictures of point clouds as arrays.
///
/// Options are those of `pointillist render`, by the names of the command line with `_` for `-`:
/// `style="points"`, `effects=["edl=on,strength=2", "ao=on"]`, `background="ffffff"`,
/// `light="direction:1,-2,-3"`, `color="elevation"`, `opacity=["class:6=0.3"]`,
/// `clip=["box:0,0,0,9,9,3"]`, `scene="scene.json"`, and so on. A sequence repeats an option,
/// `True` is one without a value, `None` takes one away. Notes of reading and drawing are warnings.
///
/// Methods may be called from several threads; other threads run while one draws, and an interrupt
/// ends reading and drawing. Wrong arguments are `ValueError`; files and devices raise `Error`.
#[pymodule(name = "pointillist")]
mod python {
    #[pymodule_export]
    use super::{Renderer, render};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        pointillist::cloud::catch_panic::hide_caught_panics();
        module.add("Error", module.py().get_type::<super::PointillistError>())
    }
}

fn refused<T>(what: impl Into<String>) -> PyResult<T> {
    Err(PyValueError::new_err(what.into()))
}

/// Options of the command line, by name.
type Words = BTreeMap<String, Vec<String>>;

/// Adds keyword arguments to options: a sequence repeats one, `True` is one without a value, `None`
/// and `False` take it away.
fn add(words: &mut Words, options: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
    for (name, value) in options.into_iter().flatten() {
        let name: String = name.extract()?;
        let name = if name == "effects" { "effect".into() } else { name.replace('_', "-") };
        let text = |value: &Bound<'_, PyAny>| PyResult::Ok(value.str()?.to_string());
        let values = match value.extract::<bool>() {
            Ok(true) => Some(Vec::new()),
            Ok(false) => None,
            Err(_) if value.is_none() => None,
            Err(_) if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() => {
                Some(value.try_iter()?.map(|one| text(&one?)).collect::<PyResult<_>>()?)
            }
            Err(_) => Some(vec![text(&value)?]),
        };
        match values {
            Some(values) => words.insert(name, values),
            None => words.remove(&name),
        };
    }
    Ok(())
}

#[derive(Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Arguments {
    #[command(flatten)]
    picture: PictureOptions,
}

/// Parses options as the program does.
fn parse(words: &Words) -> PyResult<PictureOptions> {
    let option = |(name, values): (&String, &Vec<String>)| match &values[..] {
        [] => vec![format!("--{name}")],
        values => values.iter().map(|value| format!("--{name}={value}")).collect(),
    };
    let picture = Arguments::try_parse_from(words.iter().flat_map(option))
        .map(|arguments| arguments.picture)
        .or_else(|error| {
            // What follows is about the command line.
            let text = error.to_string();
            let said = text.split("\n\n").next().unwrap_or_default().trim_start_matches("error: ");
            refused(said.split_whitespace().collect::<Vec<_>>().join(" "))
        })?;
    picture.with_scene().map_err(raised)
}

/// Returns the options of a picture. A camera is a mapping as in a camera file, the name of a
/// preset, or a camera file.
fn picture(
    words: &Words,
    camera: Option<&Bound<'_, PyAny>>,
    size: Option<[u32; 2]>,
) -> PyResult<PictureOptions> {
    let (mut words, mut given) = (words.clone(), None);
    if let Some(camera) = camera {
        let py = camera.py();
        if camera.hasattr("keys")? {
            // Arrays become lists.
            let options = PyDict::new(py);
            let list = py.import("operator")?.call_method1("methodcaller", ("tolist",))?;
            options.set_item("default", list)?;
            let json = py.import("json")?.call_method("dumps", (camera,), Some(&options))?;
            given = Some(serde_json::from_str(&json.extract::<String>()?).or_else(|error| {
                refused(format!(
                    "camera: {error}; a camera has at least {{\"eye\": [x, y, z], \"target\": [x, y, z]}}"
                ))
            })?);
        } else {
            let text = camera.str()?.to_string();
            let is_preset = Preset::named(&text).is_ok();
            words.insert(if is_preset { "view" } else { "camera" }.into(), vec![text]);
        }
    }
    if let Some([width, height]) = size {
        words.insert("size".into(), vec![format!("{width}x{height}")]);
    }
    let picture = parse(&words)?;
    Ok(PictureOptions { saved_camera: given.or(picture.saved_camera), ..picture })
}

fn raised(error: Error) -> PyErr {
    match error {
        Error::Interrupted => PyKeyboardInterrupt::new_err(()),
        error => PointillistError::new_err(error.to_string()),
    }
}

/// Asks the interpreter now and then whether it was interrupted; collects notes.
struct Watch {
    asked: Mutex<Instant>,
    interrupt: Mutex<Option<PyErr>>,
    notes: Mutex<Vec<String>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Progress for Watch {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        let Ok(mut asked) = self.asked.try_lock() else { return Ok(()) };
        if asked.elapsed() < Duration::from_millis(50) {
            return Ok(());
        }
        *asked = Instant::now();
        Python::attach(|py| py.check_signals()).map_err(|error| {
            *locked(&self.interrupt) = Some(error);
            Error::Interrupted
        })
    }

    fn note(&self, line: &str) {
        locked(&self.notes).push(line.into());
    }
}

/// Runs work without the interpreter. Its notes become warnings.
fn released<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&dyn Progress) -> Result<T> + Send,
) -> PyResult<T> {
    let watch = Watch {
        asked: Mutex::new(Instant::now()),
        interrupt: Mutex::default(),
        notes: Mutex::default(),
    };
    let done = py.detach(|| work(&watch));
    if let Some(error) = locked(&watch.interrupt).take() {
        return Err(error);
    }
    for note in locked(&watch.notes).drain(..) {
        let note = CString::new(note.replace('\0', " ")).expect("no zeros");
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &note, 1)?;
    }
    done.map_err(raised)
}

/// What a cloud is made of.
enum Origin {
    Points(Cloud),
    Files { paths: Vec<PathBuf>, strict: bool },
}

struct Entry {
    id: u64,
    visible: bool,
    origin: Origin,
}

/// Clouds on the device.
struct Uploaded {
    /// Clouds and options that it was made of.
    key: String,
    cloud: CloudId,
    /// What a camera frames.
    framed: Vec<glam::DVec3>,
    /// The axis that points up.
    up: glam::DVec3,
}

struct State {
    words: Words,
    clouds: Vec<Entry>,
    next: u64,
    uploaded: Option<Uploaded>,
    renderer: renderer::Renderer,
}

/// A layer of a picture.
#[derive(Clone, Copy, PartialEq)]
enum Layer {
    Rgba,
    Linear,
    Depth,
    Id,
    Normal,
    Position,
}

const LAYERS: [(&str, Layer); 6] = [
    ("rgba", Layer::Rgba),
    ("linear", Layer::Linear),
    ("depth", Layer::Depth),
    ("id", Layer::Id),
    ("normal", Layer::Normal),
    ("position", Layer::Position),
];

/// Values of a layer, row by row from the top left.
enum Values {
    Bytes(Vec<u8>),
    Floats(Vec<f32>),
    Ids(Vec<u32>),
    Doubles(Vec<f64>),
}

impl Values {
    /// Returns them as an array of height and width, and of channels if there are several.
    fn array<'py>(self, py: Python<'py>, [width, height]: [u32; 2]) -> PyResult<Bound<'py, PyAny>> {
        fn shaped<'py, T: Element>(
            py: Python<'py>,
            values: Vec<T>,
            [width, height]: [usize; 2],
        ) -> PyResult<Bound<'py, PyAny>> {
            let channels = values.len() / (width * height);
            let array = PyArray::from_vec(py, values);
            Ok(match channels {
                1 => array.reshape([height, width])?.into_any(),
                _ => array.reshape([height, width, channels])?.into_any(),
            })
        }
        let size = [width as usize, height as usize];
        match self {
            Values::Bytes(values) => shaped(py, values, size),
            Values::Floats(values) => shaped(py, values, size),
            Values::Ids(values) => shaped(py, values, size),
            Values::Doubles(values) => shaped(py, values, size),
        }
    }
}

/// What is downloaded of a frame.
struct Downloads {
    encoded: encode::Encoded,
    linear: Buffer,
    depth: Buffer,
    index: Buffer,
    normal: Buffer,
}

impl Downloads {
    fn ask(g: &mut Graph, outcome: &Outcome) -> Result<Downloads> {
        Ok(Downloads {
            encoded: encode::download(g, &outcome.picture)?,
            linear: g.download(&outcome.picture),
            depth: g.download(&outcome.gbuffer.depth),
            index: g.download(&outcome.gbuffer.index),
            normal: g.download(&outcome.normal),
        })
    }

    fn read(
        &self,
        layer: Layer,
        frame: &CompletedSubmission,
        positions: &dyn Fn(u32) -> Option<glam::DVec3>,
    ) -> Values {
        let vectors = |buffer| frame.read::<[f32; 4]>(buffer);
        match layer {
            Layer::Rgba => {
                let pieces = self.encoded.read(frame);
                let pixels = pieces.into_iter().flat_map(|piece| piece.chunks_exact(3));
                Values::Bytes(pixels.flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 255]).collect())
            }
            Layer::Linear => Values::Floats(vectors(&self.linear).as_flattened().to_vec()),
            Layer::Normal => {
                let normals = vectors(&self.normal).iter();
                Values::Floats(normals.flat_map(|&[x, y, z, _]| [x, y, z]).collect())
            }
            Layer::Depth => {
                // A depth that is not known is none, as in EXR files.
                let depths = frame.read::<f32>(&self.depth).iter().copied();
                Values::Floats(
                    depths.map(|z| if z.is_finite() { z } else { f32::INFINITY }).collect(),
                )
            }
            Layer::Id => Values::Ids(frame.read(&self.index).to_vec()),
            Layer::Position => {
                let position =
                    |&id: &u32| positions(id).map_or([f64::NAN; 3], |position| position.to_array());
                let ids: &[u32] = frame.read(&self.index);
                Values::Doubles(ids.iter().flat_map(position).collect())
            }
        }
    }
}

impl State {
    fn open(device: Option<String>, validate: bool) -> Result<State> {
        let options = gpu::DeviceOptions { device, validate, ..gpu::DeviceOptions::default() };
        let renderer = renderer::Renderer::open_device(&options, RendererOptions::default())?;
        Ok(State { words: Words::new(), clouds: Vec::new(), next: 1, uploaded: None, renderer })
    }

    fn add(&mut self, origin: Origin) -> u64 {
        self.clouds.push(Entry { id: self.next, visible: true, origin });
        self.next += 1;
        self.next - 1
    }

    /// Reads all visible clouds as one.
    fn source(&self, picture: &PictureOptions, progress: &dyn Progress) -> Result<Source> {
        let mut shown = Vec::new();
        for Entry { origin, .. } in self.clouds.iter().filter(|entry| entry.visible) {
            shown.push(match origin {
                Origin::Points(cloud) => Source::Files(cloud.clone()),
                Origin::Files { paths, strict } => {
                    Source::open(paths, &picture.opening(*strict), progress)?
                }
            });
        }
        if shown.len() == 1 {
            return Ok(shown.remove(0));
        }
        let mut all = Cloud::default();
        for source in shown {
            let Source::Files(cloud) = source else {
                return Err(Error::Request(
                    "a cloud that is drawn from an index is drawn alone; hide or remove the others, or index all files together".into(),
                ));
            };
            all.notes.extend(cloud.notes);
            for part in cloud.parts {
                all.stations.extend(cloud::stations(&part, all.parts.len()));
                all.parts.push(part);
            }
        }
        Ok(Source::Files(all))
    }

    /// Uploads the visible clouds, unless they are there.
    fn upload(
        &mut self,
        picture: &PictureOptions,
        progress: &dyn Progress,
    ) -> Result<&mut Uploaded> {
        let visible: Vec<u64> =
            self.clouds.iter().filter(|entry| entry.visible).map(|entry| entry.id).collect();
        let exposes = picture.settings()?.effects.exposure.switch != Switch::Off;
        let (read, further) = (picture.read_options(false), picture.further());
        let (detail, clips) = (&picture.detail, picture.clips());
        let light = detail.shadows.as_ref().map(|_| picture.light.to_string());
        let key = format!(
            "{visible:?} {read:?} {further:?} {exposes} {:?} {:?} {detail:?} {light:?} {clips:?}",
            picture.color, picture.opacity
        );
        if self.uploaded.as_ref().is_none_or(|uploaded| uploaded.key != key) {
            if let Some(Uploaded { cloud, .. }) = self.uploaded.take() {
                self.renderer.remove(cloud)?;
            }
            let mut source = self.source(picture, progress)?;
            source.find(picture.color, progress)?;
            source.notes(further).iter().for_each(|note| progress.note(note));
            let (framed, up) = (source.framed_points(&clips), source.up().axis());
            let (shown, _) = picture.shown(&source)?;
            self.renderer.set_memory_budget(picture.detail.pool_bytes());
            let cloud = self.renderer.add_source(source, shown, progress)?;
            self.uploaded = Some(Uploaded { key, cloud, framed, up });
        }
        Ok(self.uploaded.as_mut().expect("just uploaded"))
    }

    fn camera(&mut self, picture: &PictureOptions, progress: &dyn Progress) -> Result<Camera> {
        let uploaded = self.upload(picture, progress)?;
        let camera = picture.camera()?;
        let Uploaded { framed, up, .. } = uploaded;
        let none = Covered::default();
        let framing = || Camera::framing_beside(picture.view, framed, picture.size.0, none, *up);
        Ok(camera.unwrap_or_else(framing))
    }

    /// Draws a picture. Returns the wanted layers.
    fn draw(
        &mut self,
        picture: &PictureOptions,
        wanted: &[Layer],
        progress: &dyn Progress,
    ) -> Result<Vec<Values>> {
        let view = View::new(self.camera(picture, progress)?, picture.size.0)?;
        self.upload(picture, progress)?;
        let State { renderer, uploaded, .. } = self;
        let Uploaded { cloud, .. } = *uploaded.as_ref().expect("uploaded above");
        picture.apply(renderer)?;
        if tiled::needs_pieces(renderer.cloud(cloud)?.0, view.size, None) {
            let [width, height] = view.size;
            return Err(Error::Request(format!(
                "{width}x{height} pixels are drawn in pieces; `pointillist render` does that"
            )));
        }
        let detail = picture.detail.lod().of(view.size);
        let taken = renderer.load(cloud, &view, &detail, progress)?;
        let config = renderer.config(cloud, &view)?;
        let done = renderer.draw(cloud, &view, &config, progress, Downloads::ask)?;
        let (gpu, cloud) = renderer.cloud(cloud)?;
        let resident = cloud.resident();
        let notes = taken.into_iter().flat_map(|taken| taken.notes);
        let notes = notes.chain(config.warnings(resident)).chain(done.notes);
        notes.for_each(|note| progress.note(&note));
        // Positions in the order of ids; nodes begin at multiples of a page.
        let (mut positions, mut starts) = (Vec::new(), Vec::new());
        if wanted.contains(&Layer::Position) {
            positions = resident.positions(gpu)?;
            let mut start = 0;
            for node in &resident.nodes {
                starts.push(start);
                start += node.count as usize;
            }
        }
        let position = |id: u32| {
            let start = starts.get((id / config::POINTS_PER_PAGE) as usize)?;
            positions.get(start + (id % config::POINTS_PER_PAGE) as usize).copied()
        };
        let values = wanted.iter().map(|layer| done.asked.read(*layer, &done.frame, &position));
        Ok(values.collect())
    }
}

/// Returns an array that lies in memory row by row, with values of a type.
fn contiguous<'py>(array: &Bound<'py, PyAny>, kind: &str) -> PyResult<Bound<'py, PyAny>> {
    array.py().import("numpy")?.call_method1("ascontiguousarray", (array, kind))
}

/// Returns the name of an array's type.
fn kind(array: &Bound<'_, PyAny>) -> PyResult<String> {
    let array = array.py().import("numpy")?.call_method1("asarray", (array,))?;
    array.getattr("dtype")?.getattr("name")?.extract()
}

/// Calls `use_rows` with the rows of an array of n x 3 values.
fn rows<T: Element + bytemuck::Pod, R>(
    array: &Bound<'_, PyAny>,
    name: &str,
    use_rows: impl FnOnce(&[[T; 3]]) -> PyResult<R>,
) -> PyResult<R> {
    let array = array.cast::<PyArray2<T>>().ok().filter(|array| array.shape()[1] == 3);
    let Some(array) = array else { return refused(format!("{name} must be an array of n x 3")) };
    let values = array.readonly();
    use_rows(bytemuck::cast_slice(values.as_slice()?))
}

/// Returns colours of 8 bits: of 8 as they are, of 16, or of floats from 0 to 1.
fn colors_of(array: &Bound<'_, PyAny>) -> PyResult<Vec<[u8; 3]>> {
    match kind(array)?.as_str() {
        "uint8" => rows(&contiguous(array, "uint8")?, "colors", |rows| Ok(rows.to_vec())),
        "uint16" => rows::<u16, _>(&contiguous(array, "uint16")?, "colors", |rows| {
            let byte = |value: u16| ((value as u32 * 255 + 32_767) / 65_535) as u8;
            Ok(rows.iter().map(|rgb| rgb.map(byte)).collect())
        }),
        "float32" | "float64" => rows::<f64, _>(&contiguous(array, "float64")?, "colors", |rows| {
            if !rows.as_flattened().iter().all(|value| (0.0..=1.0).contains(value)) {
                return refused("colors of floats must be within 0 and 1");
            }
            Ok(rows.iter().map(|rgb| rgb.map(|value| (value * 255.0).round() as u8)).collect())
        }),
        kind => refused(format!("colors are {kind}; give uint8, uint16, or floats from 0 to 1")),
    }
}

/// Returns a cloud of arrays.
fn cloud_of(
    points: &Bound<'_, PyAny>,
    colors: Option<&Bound<'_, PyAny>>,
    intensities: Option<&Bound<'_, PyAny>>,
    classes: Option<&Bound<'_, PyAny>>,
) -> PyResult<Cloud> {
    fn column<T: Element + Copy>(
        array: Option<&Bound<'_, PyAny>>,
        kind: &str,
    ) -> PyResult<Option<Vec<T>>> {
        let Some(array) = array else { return Ok(None) };
        let array = contiguous(array, kind)?;
        let Ok(array) = array.cast::<PyArray1<T>>() else {
            return refused("intensities and classes must be arrays of n values");
        };
        Ok(Some(array.readonly().as_slice()?.to_vec()))
    }
    let colors = colors.map(colors_of).transpose()?;
    let intensities = column::<f32>(intensities, "float32")?;
    let classes = column::<u8>(classes, "uint8")?;
    let py = points.py();
    let made = |positions: Positions| {
        let points = Points {
            positions,
            colors: colors.as_deref(),
            intensities: intensities.as_deref(),
            classes: classes.as_deref(),
        };
        py.detach(|| Cloud::of_points(&points)).or_else(|error| refused(error.to_string()))
    };
    match kind(points)?.as_str() {
        "float32" => {
            rows(&contiguous(points, "float32")?, "points", |rows| made(Positions::F32(rows)))
        }
        _ => rows(&contiguous(points, "float64")?, "points", |rows| made(Positions::F64(rows))),
    }
}

/// Returns the files of a path, or of a sequence of paths.
fn files_of(files: &Bound<'_, PyAny>) -> PyResult<Vec<PathBuf>> {
    files.extract::<PathBuf>().map(|path| vec![path]).or_else(|_| files.extract())
}

/// Clouds on a device that stays open: one of this name or index, or the first. With `validate`,
/// each message of the Vulkan validation layers is an error. Options hold for all pictures.
#[pyclass(frozen, module = "pointillist")]
struct Renderer(Mutex<State>);

impl Renderer {
    /// Locks the state. While another thread draws, the interpreter is released.
    fn state(&self, py: Python<'_>) -> MutexGuard<'_, State> {
        self.0.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
    }

    fn opened(py: Python<'_>, device: Option<String>, validate: bool) -> PyResult<Renderer> {
        released(py, |_| State::open(device, validate)).map(|state| Renderer(Mutex::new(state)))
    }

    fn entry<T>(
        &self,
        py: Python<'_>,
        cloud: u64,
        change: impl FnOnce(&mut State, usize) -> T,
    ) -> PyResult<T> {
        let mut state = self.state(py);
        match state.clouds.iter().position(|entry| entry.id == cloud) {
            Some(place) => Ok(change(&mut state, place)),
            None => refused(format!("there is no cloud {cloud}")),
        }
    }

    /// Returns the options that were set, with those of a call.
    fn picture(
        &self,
        py: Python<'_>,
        camera: Option<&Bound<'_, PyAny>>,
        size: Option<[u32; 2]>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PictureOptions> {
        let mut words = self.state(py).words.clone();
        add(&mut words, options)?;
        picture(&words, camera, size)
    }
}

#[pymethods]
impl Renderer {
    #[new]
    #[pyo3(signature = (*, device=None, validate=false, **options))]
    fn new(
        py: Python<'_>,
        device: Option<String>,
        validate: bool,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Renderer> {
        let renderer = Renderer::opened(py, device, validate)?;
        renderer.set(py, options)?;
        Ok(renderer)
    }

    /// Name of the device.
    #[getter]
    fn device(&self, py: Python<'_>) -> String {
        self.state(py).renderer.device_name().to_string()
    }

    /// Clouds, in the order in which they were added.
    #[getter]
    fn clouds(&self, py: Python<'_>) -> Vec<u64> {
        self.state(py).clouds.iter().map(|entry| entry.id).collect()
    }

    /// Sets options of all pictures; those of a call replace them for that call.
    #[pyo3(signature = (**options))]
    fn set(&self, py: Python<'_>, options: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
        let mut words = self.state(py).words.clone();
        add(&mut words, options)?;
        parse(&words)?;
        self.state(py).words = words;
        Ok(())
    }

    /// Copies points, as the function `render` takes them. Returns the cloud.
    #[pyo3(signature = (points, colors=None, *, intensities=None, classes=None))]
    fn add_points(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        colors: Option<&Bound<'_, PyAny>>,
        intensities: Option<&Bound<'_, PyAny>>,
        classes: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<u64> {
        let cloud = cloud_of(points, colors, intensities, classes)?;
        Ok(self.state(py).add(Origin::Points(cloud)))
    }

    /// Opens files as one cloud; they are read when it is drawn. Returns the cloud.
    ///
    /// All visible clouds are drawn as one, except that one drawn from an index is drawn alone.
    /// With `strict`, every loss and guess of reading is an error.
    #[pyo3(signature = (files, *, strict=false))]
    fn open(&self, py: Python<'_>, files: &Bound<'_, PyAny>, strict: bool) -> PyResult<u64> {
        let paths = files_of(files)?;
        if paths.is_empty() {
            return refused("there are no files");
        }
        for path in &paths {
            std::fs::File::open(path).map_err(|error| raised(Error::io("open", path, error)))?;
        }
        Ok(self.state(py).add(Origin::Files { paths, strict }))
    }

    /// Removes a cloud.
    fn remove(&self, py: Python<'_>, cloud: u64) -> PyResult<()> {
        self.entry(py, cloud, |state, place| drop(state.clouds.remove(place)))
    }

    /// Shows or hides a cloud.
    #[pyo3(signature = (cloud, visible=true))]
    fn show(&self, py: Python<'_>, cloud: u64, visible: bool) -> PyResult<()> {
        self.entry(py, cloud, |state, place| state.clouds[place].visible = visible)
    }

    /// Returns the camera that a picture would have, as a dictionary.
    #[pyo3(signature = (camera=None, size=None, **options))]
    fn camera<'py>(
        &self,
        py: Python<'py>,
        camera: Option<&Bound<'py, PyAny>>,
        size: Option<[u32; 2]>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let picture = self.picture(py, camera, size, options)?;
        let camera = released(py, |progress| locked(&self.0).camera(&picture, progress))?;
        let json = serde_json::to_string(&camera).expect("cameras are JSON");
        py.import("json")?.call_method1("loads", (json,))
    }

    /// Draws all visible clouds, as the function `render` does.
    #[pyo3(signature = (camera=None, size=None, **options))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: Option<&Bound<'py, PyAny>>,
        size: Option<[u32; 2]>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let layers = self.layers(py, vec!["rgba".into()], camera, size, options)?;
        Ok(layers.get_item("rgba")?.expect("asked for"))
    }

    /// Draws all visible clouds. Returns layers of the picture, as a dictionary.
    ///
    /// - `rgba`: uint8, height x width x 4, as `render`
    /// - `linear`: float32, height x width x 4, linear colours; the last is the coverage
    /// - `depth`: float32, height x width, planar depth in metres, inf where there is nothing
    /// - `id`: uint32, height x width, number of the point among those drawn, 0xFFFFFFFF for none
    /// - `normal`: float32, height x width x 3, of the surface, zero where it has none
    /// - `position`: float64, height x width x 3, where the point is, nan where there is none
    #[pyo3(signature = (names, camera=None, size=None, **options))]
    fn layers<'py>(
        &self,
        py: Python<'py>,
        names: Vec<String>,
        camera: Option<&Bound<'py, PyAny>>,
        size: Option<[u32; 2]>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let picture = self.picture(py, camera, size, options)?;
        let layer = |name: &String| match LAYERS.iter().find(|(known, _)| known == name) {
            Some((_, layer)) => Ok(*layer),
            None => {
                let known: Vec<&str> = LAYERS.iter().map(|(known, _)| *known).collect();
                refused(format!("there is no layer {name:?}; there are: {}", known.join(", ")))
            }
        };
        let wanted = names.iter().map(layer).collect::<PyResult<Vec<_>>>()?;
        let drawn = released(py, |progress| locked(&self.0).draw(&picture, &wanted, progress))?;
        let layers = PyDict::new(py);
        for (name, values) in names.into_iter().zip(drawn) {
            layers.set_item(name, values.array(py, picture.size.0)?)?;
        }
        Ok(layers)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let state = self.state(py);
        format!(
            "<pointillist.Renderer of {} clouds on {}>",
            state.clouds.len(),
            state.renderer.device_name()
        )
    }
}

/// Draws points. Returns height x width x 4: red, green and blue as in a file, and 255.
///
/// `points` are n x 3 in metres: float32, or anything else as float64. `colors` are n x 3, sRGB:
/// uint8, uint16, or floats from 0 to 1. `size` is width and height in pixels. The camera is "fit",
/// "top", "front", "side" or "iso", a mapping with the members of a camera file, or such a file;
/// without one the points are framed. A device is opened for each call; use a `Renderer` for
/// several pictures.
#[pyfunction]
#[pyo3(signature = (points, colors=None, camera=None, size=None, *, intensities=None, classes=None, device=None, **options))]
#[allow(clippy::too_many_arguments, reason = "arguments of Python have names")]
fn render<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    colors: Option<&Bound<'py, PyAny>>,
    camera: Option<&Bound<'py, PyAny>>,
    size: Option<[u32; 2]>,
    intensities: Option<&Bound<'py, PyAny>>,
    classes: Option<&Bound<'py, PyAny>>,
    device: Option<String>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    // Errors come before a device is opened.
    let mut words = Words::new();
    add(&mut words, options)?;
    picture(&words, camera, size)?;
    let cloud = cloud_of(points, colors, intensities, classes)?;
    let renderer = Renderer::opened(py, device, false)?;
    renderer.state(py).add(Origin::Points(cloud));
    renderer.render(py, camera, size, options)
}
