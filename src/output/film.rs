//! Films: frames to MP4 or WebM by the program `ffmpeg`, or to animated PNG without it. A film is
//! complete or absent.

use super::image_io::encoding;
use crate::atomic_file::AtomicFile;
use crate::error::{Error, Result};
use crate::progress::Progress;
use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::Duration;

/// Ends of names of films.
pub const ENDINGS: [&str; 3] = ["mp4", "webm", "apng"];

/// Options of `ffmpeg` for an end of a name: quality that is hard to tell from the frames, and
/// pixels that every player knows.
fn options(ending: &str) -> &'static [&'static str] {
    match ending {
        "webm" => &["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-row-mt", "1", "-f", "webm"],
        _ => &["-c:v", "libx264", "-crf", "18", "-movflags", "+faststart", "-f", "mp4"],
    }
}

/// Returns the end of a film's name, in small letters; `None` if it is no film.
pub fn ending(path: &Path) -> Option<&'static str> {
    let own = path.extension()?;
    ENDINGS.into_iter().find(|ending| own.eq_ignore_ascii_case(ending))
}

/// Returns the size of a film's frames: films have even sides, since their colours are of 2 x 2
/// pixels.
pub fn even(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.next_multiple_of(2))
}

/// A film being written. Dropped before [`Film::finish`], it leaves no file.
pub struct Film {
    path: PathBuf,
    // Dropped before the file, which it writes.
    writer: Writer,
    whole: AtomicFile,
}

enum Writer {
    Encoder(Encoder),
    Apng(Box<png::Writer<BufWriter<File>>>),
}

impl Film {
    /// Begins a film of RGB frames, all of this even size.
    pub fn create(path: &Path, size: [u32; 2], frames: u64, per_second: f64) -> Result<Film> {
        let whole = AtomicFile::create(path)?;
        let writer = match ending(path) {
            Some("apng") => Writer::Apng(Box::new(apng(path, &whole, size, frames, per_second)?)),
            ending => {
                let ending = ending.unwrap_or_default();
                Writer::Encoder(Encoder::start(path, whole.partial(), ending, size, per_second)?)
            }
        };
        Ok(Film { path: path.to_owned(), writer, whole })
    }

    /// Adds a frame: rows from the top left.
    pub fn write(&mut self, pixels: &[u8]) -> Result<()> {
        match &mut self.writer {
            Writer::Encoder(encoder) => encoder.write(&self.path, pixels),
            Writer::Apng(png) => {
                png.write_image_data(pixels).map_err(|error| encoding(&self.path, error))
            }
        }
    }

    /// Waits for the end of the film.
    pub fn finish(self, progress: &dyn Progress) -> Result<()> {
        let Film { path, writer, whole } = self;
        match writer {
            Writer::Encoder(encoder) => encoder.finish(&path, progress)?,
            Writer::Apng(png) => png.finish().map_err(|error| encoding(&path, error))?,
        }
        whole.finish()
    }
}

fn apng(
    path: &Path,
    whole: &AtomicFile,
    [width, height]: [u32; 2],
    frames: u64,
    per_second: f64,
) -> Result<png::Writer<BufWriter<File>>> {
    let file = File::create(whole.partial()).map_err(|error| Error::io("write", path, error))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Fast);
    encoder
        .set_animated(frames as u32, 0)
        // Rounded to milliseconds.
        .and_then(|()| encoder.set_frame_delay((1e3 / per_second).round() as u16, 1000))
        .and_then(|()| encoder.write_header())
        .map_err(|error| encoding(path, error))
}

/// The program `ffmpeg`, which reads frames from its standard input.
struct Encoder {
    child: Child,
    /// What it says.
    said: Option<JoinHandle<String>>,
}

impl Encoder {
    fn start(
        path: &Path,
        partial: &Path,
        ending: &str,
        [width, height]: [u32; 2],
        per_second: f64,
    ) -> Result<Encoder> {
        let mut command = Command::new("ffmpeg");
        command
            .args(["-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &per_second.to_string(), "-i", "-"])
            // The colours of high-definition television, named in the file.
            .args(["-vf", "scale=out_color_matrix=bt709:out_range=tv", "-pix_fmt", "yuv420p"])
            .args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"])
            .args(options(ending))
            // A name that begins with a dash is no option.
            .arg(std::path::absolute(partial).map_err(|error| Error::io("write", path, error))?)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        // Ctrl-C ends the film by this process.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|error| match error.kind() {
            ErrorKind::NotFound => Error::Request(format!(
                "cannot write {}: .{ending} needs the program ffmpeg, which is not on PATH; install it (Debian, Ubuntu: apt install ffmpeg), or name -o {} for an animated PNG, or -o {} for numbered frames",
                path.display(),
                path.with_extension("apng").display(),
                path.with_extension("png").display(),
            )),
            _ => Error::io("start ffmpeg for", path, error),
        })?;
        let stderr = child.stderr.take();
        let mut encoder = Encoder { child, said: None };
        let listen = move || {
            stderr.map_or_else(String::new, |stderr| {
                std::io::read_to_string(stderr).unwrap_or_default()
            })
        };
        let listening = std::thread::Builder::new().name("ffmpeg".into()).spawn(listen);
        encoder.said =
            Some(listening.map_err(|error| Error::io("start a thread for", path, error))?);
        Ok(encoder)
    }

    fn write(&mut self, path: &Path, pixels: &[u8]) -> Result<()> {
        let stdin = self.child.stdin.as_mut().expect("open until the end");
        match stdin.write_all(pixels) {
            Ok(()) => Ok(()),
            // It has ended, and says why.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Err(self.failed(path)),
            Err(error) => Err(Error::io("write", path, error)),
        }
    }

    fn finish(mut self, path: &Path, progress: &dyn Progress) -> Result<()> {
        drop(self.child.stdin.take());
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) if status.success() => return Ok(()),
                Ok(Some(_)) => return Err(self.failed(path)),
                Ok(None) => {}
                Err(error) => return Err(Error::io("write", path, error)),
            }
            progress.tick("ending the film", 0, 0)?;
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns the error of a program that has ended.
    fn failed(&mut self, path: &Path) -> Error {
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        let said = said.lines().next().unwrap_or("it says nothing").to_string();
        Error::Request(format!(
            "cannot write {}: ffmpeg failed ({said}); name -o {} for an animated PNG, or -o {} for numbered frames",
            path.display(),
            path.with_extension("apng").display(),
            path.with_extension("png").display(),
        ))
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Errors if it has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
