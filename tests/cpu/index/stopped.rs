//! Interrupted work leaves nothing, and impossible requests are refused.

use super::*;

/// Counts ticks, and interrupts from one of them on.
struct Stops {
    at: u64,
    ticks: AtomicU64,
}

impl Progress for Stops {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.ticks.fetch_add(1, Relaxed) >= self.at { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Interrupts only once.
struct StopsOnce(Stops);

impl Progress for StopsOnce {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.0.ticks.fetch_add(1, Relaxed) == self.0.at {
            Err(Error::Interrupted)
        } else {
            Ok(())
        }
    }
}

#[test]
fn work_that_is_interrupted_at_any_tick_ends_and_leaves_nothing() {
    let place = Place::new();
    let file =
        place.las("a.las", &shape(Shape::Uniform, 400_000, [0; 3], [9_999; 3], 1), MILLIMETRES);
    let output = place.at("a.pnti");
    for threads in [1, 2, 3] {
        let options = Options { threads, memory: 64 << 20, ..OPTIONS };
        let count = Stops { at: u64::MAX, ticks: AtomicU64::new(0) };
        build::build(std::slice::from_ref(&file), &output, &options, &count).unwrap();
        fs::remove_file(&output).unwrap();
        let ticks = count.ticks.into_inner();
        println!("{threads} threads: {ticks} ticks");
        for at in 0..ticks {
            let stops = Stops { at, ticks: AtomicU64::new(0) };
            let ended = build::build(std::slice::from_ref(&file), &output, &options, &stops);
            assert!(matches!(ended, Err(Error::Interrupted)), "tick {at}: {ended:?}");
            assert_eq!(names(place.folder.path()), ["a.las"]);
            let once = StopsOnce(Stops { at, ticks: AtomicU64::new(0) });
            assert!(
                build::build(std::slice::from_ref(&file), &output, &options, &once).is_err(),
                "tick {at}, once"
            );
            assert_eq!(names(place.folder.path()), ["a.las"]);
        }
    }
}

#[test]
fn odd_outputs_and_requests_are_refused_or_taken() {
    let place = Place::new();
    let file = place.las("a.las", &[point([1; 3], 1)], MILLIMETRES);
    for output in [
        place.folder.path().to_owned(),
        place.at("nowhere/a.pnti"),
        PathBuf::from("/dev/null"),
        PathBuf::from("/"),
    ] {
        assert!(
            build::build(std::slice::from_ref(&file), &output, &OPTIONS, &Silent).is_err(),
            "{}",
            output.display()
        );
    }
    place.build(&[], "none.pnti", &OPTIONS).unwrap();
    for name in ["new\nline.pnti", &"x".repeat(255), &"é".repeat(127), &"🦀".repeat(63)] {
        place
            .build(std::slice::from_ref(&file), name, &OPTIONS)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(Index::open(&place.at(name)).is_ok());
    }
    use std::os::unix::ffi::OsStrExt;
    let odd = place.folder.path().join(std::ffi::OsStr::from_bytes(b"\xff\xfe.las"));
    fs::copy(&file, &odd).unwrap();
    place.build(std::slice::from_ref(&odd), "odd.pnti", &OPTIONS).unwrap();
    assert_eq!(Index::open(&place.at("odd.pnti")).unwrap().directory.contents.points, 1);
    // A pipe without a writer.
    let pipe = std::ffi::CString::new(place.at("pipe").as_os_str().as_bytes()).unwrap();
    // SAFETY: a system call with a string that ends in 0.
    assert_eq!(unsafe { libc::mkfifo(pipe.as_ptr(), 0o600) }, 0);
    assert!(!Index::is_one(&place.at("pipe")) && Index::open(&place.at("pipe")).is_err());
    // No threads and no memory: the least is used.
    place
        .build(
            std::slice::from_ref(&file),
            "least.pnti",
            &Options { threads: 0, memory: 0, ..OPTIONS },
        )
        .unwrap();
}
