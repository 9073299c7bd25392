//! Pictures at first sight: the right way up, framed, bright enough, and with what a report needs.

use crate::png_file::{Png, read_png};
use crate::program::{render, succeeded};
use std::path::{Path, PathBuf};

/// Writes points as an ASCII PLY file, grey where no colour is given.
fn ply(folder: &Path, name: &str, points: &[([f64; 3], [u8; 3])]) -> PathBuf {
    let path = folder.join(name);
    let lines = points.iter().map(|([x, y, z], [r, g, b])| format!("{x} {y} {z} {r} {g} {b}\n"));
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    );
    std::fs::write(&path, std::iter::once(head).chain(lines).collect::<String>()).unwrap();
    path
}

/// A cone on a plate, with its height along y.
fn cone(color: [u8; 3]) -> Vec<([f64; 3], [u8; 3])> {
    let plate =
        (0..10_000).map(|i| [(i % 100) as f64 / 50.0 - 1.0, 0.0, (i / 100) as f64 / 50.0 - 1.0]);
    let body = (0..20_000).map(|i| {
        let (turn, up) = (i as f64 * 2.4, i as f64 / 20_000.0);
        [0.8 * (1.0 - up) * turn.cos(), 2.0 * up, 0.8 * (1.0 - up) * turn.sin()]
    });
    plate.chain(body).map(|place| (place, color)).collect()
}

fn draw(cloud: &Path, line: &str) -> (Png, String) {
    let png = cloud.with_extension("png");
    let line = format!("-o {} --size 160x120 --no-cache {line}", png.display());
    let said = succeeded(&render(cloud, &line));
    (read_png(&png), said)
}

fn difference(a: &Png, b: &Png) -> usize {
    a.pixels.iter().zip(&b.pixels).filter(|(a, b)| a != b).count()
}

#[test]
fn a_mesh_that_stands_on_y_is_drawn_upright_from_a_file_and_from_an_index() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = ply(folder.path(), "cone.ply", &cone([200, 180, 160]));
    let (auto, said) = draw(&cloud, "--color elevation");
    assert!(said.contains("y is taken as up"), "{said}");
    let (y, said) = draw(&cloud, "--color elevation --up y");
    assert!(said.is_empty() && difference(&auto, &y) == 0, "{said}");
    let (z, said) = draw(&cloud, "--color elevation --up z");
    assert!(said.is_empty() && difference(&auto, &z) > 1000, "{said}");
    let (indexed, said) = draw(&cloud, "--color elevation --lod 0.5");
    assert!(said.contains("y is taken as up"), "{said}");
    // The ends of the ramp are known to the size of the samples' cells.
    let far = auto
        .pixels
        .iter()
        .zip(&indexed.pixels)
        .filter(|(a, b)| (0..3).any(|channel| a[channel].abs_diff(b[channel]) > 24));
    assert!(far.count() < 400);
}

#[test]
fn a_view_frames_what_clip_boxes_leave() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = ply(folder.path(), "cone.ply", &cone([255, 255, 255]));
    let drawn = |line: &str| {
        let background = draw(&cloud, line).0;
        background.pixels.iter().filter(|pixel| **pixel != [0, 0, 0]).count()
    };
    let whole = drawn("--background 000000 --view top --up y");
    let part = drawn(
        "--background 000000 --view top --up y --clip box:-0.3,-1,-0.3,0.3,0.5,0.3 --clip off:0,0,0,9,9,9",
    );
    let indexed = drawn(
        "--background 000000 --view top --up y --clip box:-0.3,-1,-0.3,0.3,0.5,0.3 --lod 0.5",
    );
    assert!(part > whole / 2 && indexed > whole / 2, "{whole} {part} {indexed}");
}
