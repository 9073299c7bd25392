//! Profiles and films, as a user types them.

use crate::files::names;
use crate::png_file::read_png;
use crate::program::{SIGNALS, pointillist, render, succeeded, text};
use crate::skip::skip;
use crate::witness::ffprobe;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Places on a lattice of millimetres, written as a text table. Returns them.
fn table(path: &Path) -> Vec<[f64; 3]> {
    let mut state = 1u64;
    let mut next = |below: u64| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    let places: Vec<[u64; 3]> =
        (0..3000).map(|_| [next(10_000), next(10_000), next(3000)]).collect();
    let line = |[x, y, z]: &[u64; 3]| {
        let metres = |mm: &u64| format!("{}.{:03}", mm / 1000, mm % 1000);
        format!("{} {} {}\n", metres(x), metres(y), metres(z))
    };
    std::fs::write(path, places.iter().map(line).collect::<String>()).unwrap();
    places.iter().map(|place| place.map(|mm| mm as f64 / 1000.0)).collect()
}

#[test]
fn a_profile_lists_the_points_of_its_slab() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.xyz");
    let places = table(&path);
    let [csv, svg] = ["p.csv", "p.svg"].map(|name| folder.path().join(name));
    let output = pointillist()
        .arg("profile")
        .arg(&path)
        .args(["--from", "1,2", "--to", "7,10", "--width", "1", "-o"])
        .arg(&csv)
        .arg("-o")
        .arg(&svg)
        .output()
        .unwrap();
    succeeded(&output);
    // Along the line, ten metres, and to its left.
    let (along, left) = ([0.6, 0.8], [-0.8, 0.6]);
    let on = |axis: [f64; 2], [x, y, _]: &[f64; 3]| axis[0] * (x - 1.0) + axis[1] * (y - 2.0);
    let mut expected: Vec<[f64; 3]> = places
        .iter()
        .filter(|place| (0.0..=10.0).contains(&on(along, place)) && on(left, place).abs() <= 0.5)
        .map(|place| [on(along, place), place[2], on(left, place)])
        .collect();
    let rows = std::fs::read_to_string(&csv).unwrap();
    let mut lines = rows.lines();
    let head = lines.next().unwrap();
    assert!(head.starts_with("distance,height,left,x,y,z,") && head.ends_with(",unit"), "{head}");
    let row = |line: &str| {
        let mut fields = line.split(',').map(|field| field.parse::<f64>().unwrap());
        [(); 3].map(|()| fields.next().unwrap())
    };
    let mut got: Vec<[f64; 3]> =
        lines.map(|line| row(&line.splitn(4, ',').take(3).collect::<Vec<_>>().join(","))).collect();
    // By height, which is exact, then by distance.
    let order = |a: &[f64; 3], b: &[f64; 3]| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0]));
    got.sort_by(order);
    expected.sort_by(order);
    assert!(
        expected.len() > 100 && got.len() == expected.len(),
        "{} {}",
        got.len(),
        expected.len()
    );
    for (got, expected) in got.iter().zip(&expected) {
        assert!(
            got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9),
            "{got:?} {expected:?}"
        );
    }
    let picture = std::fs::read_to_string(svg).unwrap();
    assert!(picture.contains(&format!("{} points, 10.000 m long", expected.len())), "{picture}");
}

/// `--color` colours the picture alone.
#[test]
fn the_table_of_a_profile_has_the_colours_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let [path, csv] = ["points.csv", "p.csv"].map(|name| folder.path().join(name));
    let rows = (0..100).map(|i| format!("{},0,{},{i},7,200,{}\n", i, i % 9, 1000 + i));
    let head = "x,y,z,red,green,blue,intensity\n".to_string();
    std::fs::write(&path, std::iter::once(head).chain(rows).collect::<String>()).unwrap();
    for color in ["rgb", "elevation", "intensity"] {
        let mut command = pointillist();
        command.arg("profile").arg(&path).args(["--from", "0,0", "--to", "99,0", "--width", "1"]);
        succeeded(&command.args(["--color", color, "-o"]).arg(&csv).output().unwrap());
        let table = std::fs::read_to_string(&csv).unwrap();
        let mut lines = table.lines();
        assert_eq!(
            lines.next().unwrap(),
            "distance,height,left,x,y,z,class,return,source,red,green,blue,unit,\"intensity\""
        );
        for (i, line) in lines.enumerate() {
            let (z, grey) = (i % 9, 1000 + i);
            let wanted = format!("{i},{z},0,{i},0,{z},,,,{i},7,200,,{grey}");
            assert_eq!(line, wanted, "{color}");
        }
        assert_eq!(table.lines().count(), 101);
    }
}

/// All of a cloud stays in view, whatever side it shows.
#[test]
fn no_frame_of_a_turntable_cuts_the_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("terrain.las");
    let line = "synth terrain --points 40000 -o";
    succeeded(&pointillist().args(line.split(' ')).arg(&scan).output().unwrap());
    for (size, options) in [([96, 64], ""), ([64, 96], "--view front"), ([96, 64], "--view top")] {
        let frames = folder.path().join("turn.png");
        let [width, height] = size;
        let line = format!("--turntable 6 --size {width}x{height} {options}");
        let mut command = pointillist();
        command.arg("render").arg(&scan).arg("-o").arg(&frames).args(line.split_whitespace());
        succeeded(&command.output().unwrap());
        for number in 1..=6 {
            let frame = read_png(&folder.path().join(format!("turn-000{number}.png")));
            let background = frame.pixels[0];
            let drawn = |x: u32, y: u32| frame.pixels[(y * width + x) as usize] != background;
            let edge = (0..width)
                .flat_map(|x| [(x, 0), (x, height - 1)])
                .chain((0..height).flat_map(|y| [(0, y), (width - 1, y)]));
            assert_eq!(edge.filter(|&(x, y)| drawn(x, y)).count(), 0, "{options} {number}");
            assert!((0..width * height).any(|i| drawn(i % width, i / width)));
        }
    }
}

#[test]
fn a_turntable_becomes_a_film() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.xyz");
    table(&path);
    let film = folder.path().join("turn.apng");
    let line = format!("-o {} --turntable 4 --size 65x49", film.display());
    succeeded(&render(&path, &line));
    let bytes = std::fs::read(&film).unwrap();
    let at = bytes.windows(4).position(|tag| tag == b"acTL").expect("an animated PNG") + 4;
    assert_eq!(u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()), 4);

    let film = folder.path().join("turn.mp4");
    let line = format!("-o {} --turntable 5 --fps 10 --size 65x49", film.display());
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        let refused = render(&path, &line);
        assert!(!refused.status.success() && !film.exists());
        assert!(text(&refused.stderr).contains("ffmpeg"), "{}", text(&refused.stderr));
        return skip("there is no ffmpeg");
    }
    for name in ["turn.mp4", "turn.webm"] {
        let film = folder.path().join(name);
        let line = format!("-o {} --turntable 5 --fps 10 --size 65x49", film.display());
        succeeded(&render(&path, &line));
        let Some(seen) = ffprobe(&film) else { return };
        assert_eq!(seen, "66,50,10/1,5", "{name}");
    }
}

/// Signals while frames are drawn, and while the encoder works.
#[cfg(unix)]
#[test]
fn an_interrupted_film_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.xyz");
    table(&path);
    let has_encoder = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !has_encoder {
        skip("there is no ffmpeg: only animated PNG is tested");
    }
    let encoded = ["film.mp4", "film.webm"].into_iter().filter(|_| has_encoder);
    for name in encoded.chain(["film.apng"]) {
        let film = folder.path().join(name);
        for (wait_ms, (signal, _)) in [400, 1500, 3000].into_iter().zip(SIGNALS) {
            let line = format!("-o {} --turntable 100000 --size 640x480", film.display());
            let child = pointillist()
                .arg("render")
                .arg(&path)
                .args(line.split_whitespace())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            std::thread::sleep(Duration::from_millis(wait_ms));
            // SAFETY: a system call; the child has not been waited for, so its id is its own.
            unsafe { libc::kill(child.id() as i32, signal) };
            let since = Instant::now();
            let output = child.wait_with_output().unwrap();
            assert!(since.elapsed() < Duration::from_secs(5), "{name}: {:?}", since.elapsed());
            let said = text(&output.stderr);
            // Before the handler is there the signal itself ends the process.
            if output.status.code().is_some() {
                assert_eq!(output.status.code(), Some(130), "{said}");
                assert!(said.contains("nothing was left half written"), "{said}");
            }
            assert_eq!(names(folder.path()), ["points.xyz"], "{name} after {wait_ms} ms");
        }
    }
}
