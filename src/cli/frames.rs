//! `pointillist render --path`: a camera path in; numbered pictures, and layers with `--exr`, out.
//!
//! Every file is complete or absent. Existing ones are drawn again unless `--resume` keeps them.

use super::files::refuse_to_overwrite;
use super::render::Arguments;
use crate::atomic_file::AtomicFile;
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::output::export::Downloads;
use crate::progress::{Progress, Whole};
use crate::render::frame;
use crate::render::settings::FrameConfig;
use crate::render::source::Source;
use crate::view::View;
use crate::view::camera_path::CameraPath;
use std::path::{Path, PathBuf};

/// Digits of a frame's number at least, so that names sort like numbers.
const DIGITS: usize = 4;

/// Returns the path of a frame; frames are counted from 1.
fn numbered(output: &Path, extension: &str, number: u64, total: u64) -> PathBuf {
    let digits = total.to_string().len().max(DIGITS);
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!("{stem}-{number:0digits$}.{extension}"))
}

pub fn run(arguments: &Arguments, path: &Path, progress: &dyn Progress) -> Result<()> {
    let path = CameraPath::read(path)?;
    let total = path.frames();
    let [png, exr] =
        [(&arguments.output, "png"), (&arguments.exr, "exr")].map(|(output, extension)| {
            move |number: u64| {
                output.as_deref().map(|output| numbered(output, extension, number + 1, total))
            }
        });
    let mut missing = Vec::new();
    for number in 0..total {
        let files: Vec<PathBuf> = png(number).into_iter().chain(exr(number)).collect();
        files.iter().try_for_each(|file| refuse_to_overwrite(file, &arguments.files))?;
        if !(arguments.resume && files.iter().all(|file| file.exists())) {
            missing.push(number);
        }
    }
    let kept = total - missing.len() as u64;
    if kept > 0 {
        eprintln!("pointillist: note: kept {kept} of {total} frames, which exist already");
    }
    let [first, ..] = missing[..] else { return Ok(()) };
    // Fails early if the folder is not writable.
    png(first).iter().chain(&exr(first)).try_for_each(|file| AtomicFile::create(file).map(drop))?;
    let options = arguments.picture.with_scene()?;
    let (size, settings) = (options.size.0, options.settings()?);
    let source = Source::open(&arguments.files, &options.opening(arguments.strict), progress)?;
    source.notes(options.further()).iter().for_each(|note| eprintln!("pointillist: note: {note}"));
    let (shown, _) = options.shown(&source)?;
    let mut gpu = Gpu::open(&arguments.device.to_options())?;
    let mut cloud = source.upload(&mut gpu, shown, options.detail.pool_bytes(), progress)?;
    cloud.set_filters(options.opacities(), options.clips());
    let mut said = Vec::new();
    for number in missing {
        let frames = Whole { progress, doing: "drawing frames", done: number, total };
        let view = View::new(path.frame(number), size)
            .map_err(|error| Error::Request(format!("frame {}: {error}", number + 1)))?;
        // Every note once, for the first frame that it concerns.
        let mut say = |note: String| {
            if !said.contains(&note) {
                eprintln!("pointillist: note: frame {}: {note}", number + 1);
                said.push(note);
            }
        };
        for note in cloud
            .wait_until_resident(&mut gpu, &view, &options.detail.lod().of(size), &frames)?
            .into_iter()
            .flat_map(|taken| taken.notes)
        {
            if arguments.strict {
                return Err(Error::Request(note));
            }
            say(note);
        }
        let config = FrameConfig::new(&settings, &view, cloud.resident());
        config.warnings(cloud.resident()).into_iter().for_each(&mut say);
        let [picture, layers] = [&arguments.output, &arguments.exr].map(Option::is_some);
        let done =
            frame::draw(&mut gpu, &view, cloud.resident(), &config, &frames, |g, outcome| {
                Downloads::ask(g, outcome, picture, layers)
            })?;
        done.notes.into_iter().for_each(&mut say);
        done.asked.write(&done.frame, size, png(number).as_deref(), exr(number).as_deref())?;
    }
    progress.tick("drawing frames", total, total)?;
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
