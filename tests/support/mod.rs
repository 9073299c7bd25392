//! What tests of the program share: the binary itself, files that it reads and writes.
#![allow(dead_code, reason = "every test file is a crate of its own and uses a part of this")]

pub mod made;

use pointillist::progress::Silent;
use pointillist::synth::{self, LasFile, SceneKind};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// The program, without what the environment of the tests would tell it.
pub fn pointillist() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pointillist"));
    command.env_remove("LP_NUM_THREADS").env("RUST_BACKTRACE", "0").stdin(Stdio::null());
    command
}

pub fn run<I: AsRef<OsStr>>(arguments: impl IntoIterator<Item = I>) -> Output {
    pointillist().args(arguments).output().expect("start the program")
}

/// Runs `render` with the words of `line`, and the given paths before them.
pub fn render(cloud: &Path, line: &str) -> Output {
    pointillist()
        .arg("render")
        .arg(cloud)
        .args(line.split_whitespace())
        .output()
        .expect("start the program")
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The run succeeded and did not panic; what it said on standard error.
#[track_caller]
pub fn succeeded(output: &Output) -> String {
    let said = text(&output.stderr);
    assert!(output.status.success(), "{}: {said}", output.status);
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// The run ended with this code; what it said on standard error.
#[track_caller]
pub fn failed(output: &Output, code: i32) -> String {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    if code == 1 {
        assert!(
            said.starts_with("pointillist: ") && said.trim_end().lines().count() == 1,
            "not one line: {said}"
        );
    }
    said
}

/// Returns a file or folder of `../shared`; skips the test if it is missing.
pub fn shared(relative: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(relative);
    if !path.exists() {
        skip(&format!("{} is missing", path.display()));
        return None;
    }
    Some(path)
}

/// Records that this test, or a part of it, is skipped. `tools/test` lists these lines at the end,
/// since test runners hide the output of passing tests.
pub fn skip(why: &str) {
    let thread = std::thread::current();
    let line = format!("skipped: {}: {why}\n", thread.name().unwrap_or("a test"));
    print!("{line}");
    let list = Path::new(env!("CARGO_TARGET_TMPDIR")).join("skipped");
    let file = std::fs::OpenOptions::new().create(true).append(true).open(list);
    file.and_then(|mut file| file.write_all(line.as_bytes())).expect("list a skipped test");
}

/// A scan of an analytic scene.
pub fn scan(path: &Path, scene: SceneKind, points: u64) {
    let world = synth::build(scene, 1, 0.1);
    let mut file = LasFile::create(path, world.lattice(), points).unwrap();
    synth::scan(&world, points, 1, scene.default_noise(), &mut |chunk| file.write(chunk), &Silent)
        .unwrap();
    file.finish().unwrap();
}

/// The same LAS records in another order.
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

pub struct Png {
    pub size: [u32; 2],
    pub pixels: Vec<[u8; 3]>,
}

pub fn read_png(path: &Path) -> Png {
    let file =
        std::fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    Png { size: [info.width, info.height], pixels: bytes.as_chunks::<3>().0.to_vec() }
}

pub struct Exr {
    pub size: [usize; 2],
    /// Bit patterns of the samples.
    pub layers: BTreeMap<String, Vec<u32>>,
}

impl Exr {
    pub fn floats(&self, name: &str) -> Vec<f32> {
        self.layers[name].iter().map(|&bits| f32::from_bits(bits)).collect()
    }
}

pub fn read_exr(path: &Path) -> Exr {
    use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
    let layer = read_first_flat_layer_from_file(path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .layer_data;
    let bits = |samples| match samples {
        FlatSamples::F32(values) => values.into_iter().map(f32::to_bits).collect(),
        FlatSamples::U32(values) => values,
        FlatSamples::F16(_) => panic!("16-bit samples"),
    };
    let layers = layer
        .channel_data
        .list
        .into_iter()
        .map(|channel| (channel.name.to_string(), bits(channel.sample_data)))
        .collect();
    Exr { size: [layer.size.0, layer.size.1], layers }
}

/// What a run cost.
pub struct Cost {
    pub output: Output,
    /// That processors worked for it: on a busy machine it waits for them, too.
    pub time: Duration,
    /// The most memory that was resident, bytes; none where the system does not say.
    pub peak: Option<u64>,
}

/// Runs a command and watches it. The kernel's own high-water mark is read again and again until the process is gone: what is missed is only
/// what grew within the last millisecond.
pub fn watch(mut command: Command, limit: Duration) -> Cost {
    // Files take any amount; a pipe that nobody reads stops whoever writes.
    let [mut out, mut err] = [(); 2].map(|()| tempfile::tempfile().expect("a temporary file"));
    command.stdout(out.try_clone().unwrap()).stderr(err.try_clone().unwrap());
    let began = Instant::now();
    let mut child = command.spawn().expect("start the program");
    let [memory, worked] = ["status", "stat"].map(|file| format!("/proc/{}/{file}", child.id()));
    let (mut peak, mut time) = (None, Duration::ZERO);
    let status = loop {
        if let Some(done) = child.try_wait().expect("wait for the program") {
            break done;
        }
        peak = peak.max(high_water(&memory));
        time = time.max(processor_time(&worked).unwrap_or_default());
        if began.elapsed() > limit {
            child.kill().expect("end the program");
            panic!("{command:?} still ran after {limit:?}");
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    let contents = |file: &mut std::fs::File| {
        let mut bytes = Vec::new();
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).expect("its output");
        bytes
    };
    Cost {
        output: Output { status, stdout: contents(&mut out), stderr: contents(&mut err) },
        time,
        peak,
    }
}

/// Of user and system, which the kernel counts in hundredths of a second.
fn processor_time(stat: &str) -> Option<Duration> {
    let stat = std::fs::read_to_string(stat).ok()?;
    // The name in parentheses may hold anything.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: u64 =
        [11, 12].iter().map(|&at| fields.get(at)?.parse::<u64>().ok()).sum::<Option<u64>>()?;
    Some(Duration::from_millis(10 * ticks))
}

fn high_water(status: &str) -> Option<u64> {
    let status = std::fs::read_to_string(status).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Names in a folder, hidden ones too.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// What `info --json` says of these files.
pub fn info(files: &[&Path], more: &str) -> serde_json::Value {
    let output = pointillist()
        .arg("info")
        .arg("--json")
        .args(files)
        .args(more.split_whitespace())
        .output()
        .expect("start the program");
    succeeded(&output);
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// An index of these files, beside the first.
pub fn indexed(files: &[&Path], more: &str) -> PathBuf {
    let index = files[0].with_extension("pnti");
    let output = pointillist()
        .arg("index")
        .args(files)
        .arg("-o")
        .arg(&index)
        .args(more.split_whitespace())
        .output();
    succeeded(&output.expect("start the program"));
    index
}
