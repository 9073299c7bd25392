//! Every target of `tests/fuzz`, without a driver that is guided by coverage: its seeds, what
//! crashed before, and mutations of them for a few seconds (guide: reliability).

use crate::fuzz_heap;
use crate::fuzz_mutate::{Random, mutated};
use crate::fuzz_targets::{MOST_HEAP, TARGETS, Target, target};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time for all targets together; `POINTILLIST_FUZZ_SECONDS` is another one `[s]`.
const SECONDS: f64 = 120.0;

/// Longest time of one input, on a busy machine.
const SLOWEST: Duration = Duration::from_secs(20);

/// Inputs that once ended in a panic, a hang, or too much memory.
fn crashed(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/crashed").join(name);
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// Runs one input in one thread. An input that fails is kept.
fn run(target: &Target, folder: &Path, input: &[u8]) {
    fuzz_heap::peak();
    let began = Instant::now();
    let ended = catch_unwind(AssertUnwindSafe(|| (target.run)(folder, input)));
    let (took, peak) = (began.elapsed(), fuzz_heap::peak());
    if ended.is_ok() && took < SLOWEST && peak < MOST_HEAP {
        return;
    }
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("crash-{}", target.name));
    std::fs::write(&kept, input).unwrap();
    panic!(
        "{}: {} bytes took {took:?} and {} MiB, {}; kept as {}",
        target.name,
        input.len(),
        peak >> 20,
        if ended.is_ok() { "and ended" } else { "and panicked" },
        kept.display()
    );
}

/// Runs a target's seeds, and mutations of them for its share of the time.
fn fuzzed(name: &str) {
    let target = target(name).unwrap();
    let seconds = std::env::var("POINTILLIST_FUZZ_SECONDS").ok();
    let seconds = seconds.map_or(SECONDS, |seconds| seconds.parse().unwrap());
    let time = Duration::from_secs_f64(seconds / TARGETS.len() as f64);
    let folder = tempfile::tempdir().unwrap();
    let mut seeds = (target.seeds)(folder.path());
    assert!(!seeds.is_empty());
    seeds.extend(crashed(name));
    assert!(seeds.iter().all(|seed| seed.len() <= target.most_bytes));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().unwrap();
    pool.install(|| {
        seeds.iter().for_each(|seed| run(target, folder.path(), seed));
        let (began, mut random, mut runs) = (Instant::now(), Random::new(39), 0);
        while began.elapsed() < time {
            let input = mutated(&mut random, &seeds, target.words, target.most_bytes);
            run(target, folder.path(), &input);
            runs += 1;
        }
        println!("{name}: {} seeds, {runs} mutations in {:?}", seeds.len(), began.elapsed());
        assert!(runs > 20);
    });
}

macro_rules! targets {
    ($($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                fuzzed(stringify!($name));
            }
        )*

        #[test]
        fn every_target_is_run() {
            let names: Vec<_> = TARGETS.iter().map(|target| target.name).collect();
            assert_eq!(names, [$(stringify!($name)),*]);
        }
    };
}

targets! {
    las laz copc ply e57 obj table ptx pts potree ept index shadows scene camera path filter option
}
