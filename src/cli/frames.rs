//! `pointillist render --path` and `--turntable`: a camera path, or a circle, in; numbered
//! pictures, and layers with `--exr`, or a film out.
//!
//! Every file is complete or absent. Existing ones are drawn again unless `--resume` keeps them.

use super::files::{check_extension, refuse_to_overwrite};
use super::limits::{Chosen, Target};
use super::render::Arguments;
use super::{streams, tune};
use crate::atomic_file::AtomicFile;
use crate::error::{Error, Result};
use crate::output::export::Downloads;
use crate::output::film::{self, Film};
use crate::passes::encode::Channels;
use crate::progress::{Progress, Whole};
use crate::render::settings::FrameConfig;
use crate::render::source::Source;
use crate::tune::split;
use crate::view::camera_path::CameraPath;
use crate::view::{Camera, View};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Digits of a frame's number at least, so that names sort like numbers.
const DIGITS: usize = 4;

/// Frames that tell the settings for a time or an error, evenly along the path.
const TRIED_FRAMES: u64 = 3;

/// Most frames: nine hours at 30 a second.
const MOST_FRAMES: u64 = 1_000_000;

/// Returns the path of a frame; frames are counted from 1.
fn numbered(output: &Path, extension: &str, number: u64, total: u64) -> PathBuf {
    let digits = total.to_string().len().max(DIGITS);
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!("{stem}-{number:0digits$}.{extension}"))
}

/// Parses `--fps`.
pub fn per_second(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (0.1..=1000.0).contains(number));
    number.ok_or(format!("{text:?} is not a number of frames per second, 0.1 to 1000"))
}

/// The cameras of frames.
enum Cameras {
    Path(CameraPath),
    /// A number of frames around the cloud, or the target of a given camera.
    Turntable(u64),
}

impl Cameras {
    fn of(arguments: &Arguments) -> Result<Cameras> {
        Ok(match &arguments.path {
            Some(path) => {
                let mut path = CameraPath::read(path)?;
                path.frames_per_second = arguments.fps.unwrap_or(path.frames_per_second);
                Cameras::Path(path)
            }
            None => Cameras::Turntable(arguments.turntable.unwrap_or(1)),
        })
    }

    fn frames(&self) -> u64 {
        match self {
            Cameras::Path(path) => path.frames(),
            Cameras::Turntable(frames) => *frames,
        }
    }

    fn per_second(&self, asked: Option<f64>) -> f64 {
        match self {
            Cameras::Path(path) => path.frames_per_second,
            Cameras::Turntable(_) => {
                asked.unwrap_or_else(|| CameraPath::default().frames_per_second)
            }
        }
    }

    /// Returns the camera of a frame, counted from 0.
    /// `axis` and `through` are those of a turntable.
    fn camera(&self, number: u64, first: &Camera, axis: DVec3, through: DVec3) -> Camera {
        match self {
            Cameras::Path(path) => path.frame(number),
            Cameras::Turntable(frames) => {
                let angle = std::f64::consts::TAU * number as f64 / *frames as f64;
                first.turned(axis, through, angle)
            }
        }
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let cameras = Cameras::of(arguments)?;
    let total = cameras.frames();
    if total > MOST_FRAMES {
        return Err(Error::Request(format!(
            "the camera path has {total} frames, {} a second, more than {MOST_FRAMES}; check its times, or give --fps",
            cameras.per_second(arguments.fps)
        )));
    }
    let options = arguments.picture.with_scene()?;
    let mut size = options.size.0;
    let film = arguments.output.as_deref().filter(|output| film::ending(output).is_some());
    if let Some(film) = film {
        refuse_to_overwrite(film, &arguments.inputs())?;
        size = film::even(size);
        if size != options.size.0 {
            let [width, height] = size;
            streams::note(format_args!("films have even sides: drawn with {width}x{height}"));
        }
        let asked = [("--resume", arguments.resume), ("--part", arguments.part.is_some())];
        if let Some((option, _)) = asked.into_iter().find(|(_, asked)| *asked) {
            return Err(Error::Request(format!(
                "{option} is for numbered frames, but {} is a film; leave it out, or name -o {}",
                film.display(),
                film.with_extension("png").display()
            )));
        }
    } else if let Some(output) = &arguments.output {
        check_extension(output, &["png", "mp4", "webm", "apng"])?;
    }
    let [png, exr] = [
        (arguments.output.as_deref().filter(|_| film.is_none()), "png"),
        (arguments.exr.as_deref(), "exr"),
    ]
    .map(|(output, extension)| {
        move |number: u64| output.map(|output| numbered(output, extension, number + 1, total))
    });
    let (mut missing, inputs) = (Vec::new(), arguments.inputs());
    let own = arguments.part.map_or(0..total, |part| part.range(total));
    for number in own.clone() {
        let files: Vec<PathBuf> = png(number).into_iter().chain(exr(number)).collect();
        files.iter().try_for_each(|file| refuse_to_overwrite(file, &inputs))?;
        progress.tick("looking for frames", number, total)?;
        if !(arguments.resume && film.is_none() && files.iter().all(|file| file.exists())) {
            missing.push(number);
        }
    }
    let asked = own.end - own.start;
    let kept = asked - missing.len() as u64;
    if kept > 0 {
        streams::note(format_args!("kept {kept} of {asked} frames, which exist already"));
    }
    let [first, ..] = missing[..] else { return Ok(()) };
    // Fails early if the folder is not writable.
    png(first).iter().chain(&exr(first)).try_for_each(|file| AtomicFile::create(file).map(drop))?;
    // Fails early if there is no encoder.
    let create = |path| Film::create(path, size, total, cameras.per_second(arguments.fps));
    let mut film = film.map(create).transpose()?;
    // Wrong numbers are refused before anything is read.
    options.settings()?;
    let limit = arguments.limits.limit();
    let opening = match limit {
        None => options.opening(arguments.strict),
        Some(_) => tune::opening(&options, arguments.strict),
    };
    let source = Source::open(&arguments.files, &opening, progress)?;
    source.notes(options.further()).iter().for_each(streams::note);
    source.check_clips(&options.clips())?;
    let (shown, _) = options.shown(&source)?;
    options.note_meanings(&source, &shown);
    let (named, annotations) = (options.named(&source, shown)?, options.report.annotations());
    let (first, through) = match &cameras {
        Cameras::Path(path) => (path.frame(0), DVec3::ZERO),
        Cameras::Turntable(_) => {
            let (view, through) = options.turning_view(&source, &named)?;
            (view.camera, through)
        }
    };
    let axis = DVec3::AXES[named.up.index()];
    let index = if let Source::Index(index) = &source { Some(index.clone()) } else { None };
    let mut renderer = options.renderer(&arguments.device)?;
    let cloud = renderer.add_source(source, shown, progress)?;
    let view = |number: u64| {
        View::new(cameras.camera(number, &first, axis, through), size)
            .map_err(|error| Error::Request(format!("frame {}: {error}", number + 1)))
    };
    let (mut lod, mut chosen) = (options.detail.lod(), None);
    if let Some((limit, index)) = limit.zip(index) {
        // The same whichever frames are missing, and for every part.
        let places = (0..TRIED_FRAMES).map(|k| k * total / TRIED_FRAMES);
        let views = places.map(view).collect::<Result<Vec<_>>>()?;
        let mut target =
            Target { renderer: &mut renderer, cloud, view: &views[0], picture: &options, progress };
        let own = Chosen::settle_all(limit, &mut target, &views, &arguments.files, &index)?;
        (lod, chosen) = (own.cut, Some(own));
    }
    // Largest time of a frame `[ms]`.
    let mut longest = 0.0f64;
    let mut said = Vec::new();
    for number in missing {
        let frames = Whole { progress, doing: "drawing frames", done: number, total };
        let view = view(number)?;
        // Every note once, for the first frame that it concerns.
        let mut say = |note: String| {
            if !said.contains(&note) {
                streams::note(format_args!("frame {}: {note}", number + 1));
                said.push(note);
            }
        };
        for note in renderer
            .load(cloud, &view, &lod.of(size), &frames)?
            .into_iter()
            .flat_map(|taken| taken.notes)
        {
            if arguments.strict {
                return Err(Error::Request(note));
            }
            say(note);
        }
        let config = renderer.config(cloud, &view)?;
        // Warnings concern what was asked for, not what a front has chosen.
        let asked = FrameConfig { effects: options.settings()?.effects, ..config.clone() };
        let asked = if chosen.is_some() { asked } else { config.clone() };
        asked.warnings(renderer.cloud(cloud)?.1.resident()).into_iter().for_each(&mut say);
        let [picture, layers] = [&arguments.output, &arguments.exr].map(Option::is_some);
        let done = renderer.draw(cloud, &view, &config, &frames, |g, outcome| {
            Downloads::ask(g, outcome, picture, layers)
        })?;
        done.notes.into_iter().for_each(&mut say);
        longest = longest.max(split(&done.frame.passes).iter().sum());
        let (png, exr) = (png(number), exr(number));
        annotations.note(&view, &named).into_iter().for_each(&mut say);
        let over = annotations.overlay(&view, &named);
        if let Some(film) = &mut film {
            let mut pixels = done.asked.pixels(&done.frame);
            over.blend(&mut pixels, Channels::Rgb, size[0] as usize, 0);
            film.write(&pixels)?;
        }
        done.asked.write(&done.frame, size, png.as_deref(), exr.as_deref(), over)?;
    }
    progress.tick("drawing frames", total, total)?;
    if let Some(chosen) = chosen {
        streams::note(format_args!("{} at most", chosen.line(Some(longest))));
    }
    if let Some(film) = film {
        film.finish(progress)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_sort_by_their_numbers() {
        assert_eq!(
            numbered("a/tour.png".as_ref(), "png", 7, 250),
            PathBuf::from("a/tour-0007.png")
        );
        assert_eq!(numbered("tour".as_ref(), "exr", 7, 12_345), PathBuf::from("tour-00007.exr"));
    }
}
