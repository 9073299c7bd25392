//! Pictures at first sight: the right way up, framed, bright enough, and with what a report needs.

use crate::png_file::{Png, read_png};
use crate::program::{render, succeeded, text};
use crate::shared::shared;
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
    let size = if line.contains("--size") { "" } else { "--size 160x120" };
    let line = format!("-o {} {size} --no-cache {line}", png.display());
    let said = succeeded(&render(cloud, &line));
    (read_png(&png), said)
}

fn difference(a: &Png, b: &Png) -> usize {
    a.pixels.iter().zip(&b.pixels).filter(|(a, b)| a != b).count()
}

/// Returns the number of pixels that differ from the picture's corner, and the extent of these.
fn covered(png: &Png) -> (usize, [u32; 2]) {
    let [width, _] = png.size;
    let is_drawn = |pixel: &[u8; 3]| *pixel != png.pixels[0];
    let drawn = png.pixels.iter().enumerate().filter(|(_, pixel)| is_drawn(pixel));
    let places: Vec<[u32; 2]> = drawn.map(|(i, _)| [i as u32 % width, i as u32 / width]).collect();
    let extent = [0, 1].map(|axis| {
        let own = places.iter().map(|place| place[axis]);
        own.clone().max().unwrap_or(0) - own.min().unwrap_or(0)
    });
    (places.len(), extent)
}

#[test]
fn a_single_point_is_a_round_point_in_the_middle() {
    let folder = tempfile::tempdir().unwrap();
    for count in [1, 5] {
        let cloud = ply(folder.path(), "one.ply", &vec![([3.0, 4.0, 5.0], [200; 3]); count]);
        let (png, _) = draw(&cloud, "");
        let (pixels, [width, height]) = covered(&png);
        assert!(width == height && width > 20, "{width} x {height}");
        let disc = std::f64::consts::PI / 4.0 * (width as f64).powi(2);
        assert!((pixels as f64 / disc - 1.0).abs() < 0.1, "{pixels} of {disc}");
    }
}

/// Tops of trees are sparse, and no strays.
#[test]
fn trees_are_whole_in_the_picture() {
    let Some(file) = shared("data/ground/pine_plot.laz") else { return };
    let folder = tempfile::tempdir().unwrap();
    let drawn = folder.path().join("pine.png");
    succeeded(&render(&file, &format!("-o {} --size 320x240 --no-cache", drawn.display())));
    let png = read_png(&drawn);
    let rows = [&png.pixels[..320], &png.pixels[320 * 239..]].concat();
    assert!(rows.iter().all(|pixel| *pixel == png.pixels[0]));
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

/// Mean of the pixels that are not background, of 255.
fn mean(png: &Png) -> f64 {
    let drawn: Vec<f64> = png
        .pixels
        .iter()
        .filter(|pixel| **pixel != [0, 0, 0])
        .map(|pixel| pixel.iter().map(|&channel| channel as f64).sum::<f64>() / 3.0)
        .collect();
    drawn.iter().sum::<f64>() / drawn.len() as f64
}

#[test]
fn dark_colours_are_brightened_and_the_scale_is_what_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = ply(folder.path(), "dark.ply", &cone([40, 30, 20]));
    let drawn = |line: &str| draw(&cloud, &format!("--style points --background 000000 {line}")).0;
    let (auto, full) = (drawn(""), drawn("--range 0,255"));
    assert!(mean(&auto) > 3.0 * mean(&full), "{} {}", mean(&auto), mean(&full));
    // One colour alone is in the middle, not white.
    let largest = auto.pixels.iter().flatten().max().unwrap();
    assert!((120..=130).contains(largest), "{largest}");
    // An index is as bright.
    assert!((mean(&drawn("--lod 0.5")) / mean(&auto) - 1.0).abs() < 0.2);
    assert!(mean(&drawn("--range 0,255 --gamma 2")) > 1.5 * mean(&full));
    assert!(mean(&drawn("--range 0,255 --brightness 0.3")) > 1.5 * mean(&full));
    assert!(mean(&drawn("--contrast 0.1 --brightness -0.4")) < mean(&auto));
    let bright = ply(folder.path(), "bright.ply", &cone([200, 30, 20]));
    let same = ["", "--range 0,255"].map(|line| draw(&bright, line).0);
    assert_eq!(difference(&same[0], &same[1]), 0);
}

/// Samples of an index have means of colours, which are less bright than the brightest points.
#[test]
fn dark_colours_of_an_index_are_as_bright_as_those_of_its_file() {
    let Some(file) = shared("data/e57/pumpARowColumnIndexNoInvalidPoints.e57") else { return };
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("pump.e57");
    std::fs::copy(file, &cloud).unwrap();
    let line = "--style points --background 000000 --view top";
    let [file, index] = ["", "--lod 0"].map(|lod| mean(&draw(&cloud, &format!("{line} {lod}")).0));
    assert!((index / file - 1.0).abs() < 0.01, "{index} {file}");
}

#[test]
fn heights_have_the_ramp_and_the_range_that_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = ply(folder.path(), "cone.ply", &cone([9, 9, 9]));
    let line = "--color elevation --style points --effect edl=off --background 000000";
    let drawn = |more: &str| draw(&cloud, &format!("{line} {more}")).0;
    let ramp = |ramp| drawn(&format!("--ramp {ramp}"));
    assert!(difference(&ramp("viridis"), &drawn("")) > 1000);
    assert!(ramp("grey").pixels.iter().all(|[r, g, b]| r == g && g == b));
    // All of the cone is above the range, so it has the ramp's last colour.
    let above = drawn("--ramp viridis --range -9,-8");
    let last = |pixel: &[u8; 3]| pixel.iter().zip([253, 231, 37]).all(|(a, b)| a.abs_diff(b) < 3);
    assert!(above.pixels.iter().filter(|pixel| last(pixel)).count() > 1000);
    let scene = folder.path().join("scene.json");
    std::fs::write(
        &scene,
        r#"{"camera": {"eye": [3, 4, 5], "target": [0, 1, 0], "up": [0, 1, 0]}, "scale": {"ramp": "viridis", "range": [-9, -8]}, "color": "elevation"}"#,
    )
    .unwrap();
    let (saved, _) = draw(&cloud, &format!("--scene {}", scene.display()));
    assert!(saved.pixels.iter().any(|[r, g, b]| r > b && g > b));
    for (wrong, said) in
        [("--gamma 0", "gamma"), ("--range 3,2", "3,2"), ("--contrast -1", "contrast")]
    {
        let output = render(&cloud, &format!("-o {}.png {wrong}", cloud.display()));
        assert!(!output.status.success() && text(&output.stderr).contains(said), "{wrong}");
    }
}

#[test]
fn annotations_are_drawn_the_same_whole_and_in_pieces_and_not_into_layers() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = ply(folder.path(), "cone.ply", &cone([200, 180, 160]));
    let camera = folder.path().join("camera.json");
    std::fs::write(&camera, r#"{"eye": [3, -5, 3], "target": [0, 1, 0]}"#).unwrap();
    let plain = &format!("--up z --color elevation --camera {}", camera.display())[..];
    let all = &format!("{plain} --title A_cone --legend --scale-bar --north-arrow --axes")[..];
    let sized = |line: &str| draw(&cloud, &format!("{line} --size 320x240")).0;
    let (whole, bare) = (sized(all), sized(plain));
    let pieces = sized(&format!("{all} --piece 64"));
    assert_eq!(difference(&whole, &pieces), 0);
    let part = difference(&whole, &bare) as f64 / (320.0 * 240.0);
    assert!((0.05..0.5).contains(&part), "{part}");
    // A map has coordinates along its edges.
    let [map, bare] =
        ["--axes", ""].map(|axes| sized(&format!("--up z --view top --color elevation {axes}")));
    assert!(map.pixels[0] != bare.pixels[0]);
    let layers = [all, plain].map(|line| {
        let exr = folder.path().join("layers.exr");
        succeeded(&render(&cloud, &format!("--exr {} --size 64x64 {line}", exr.display())));
        std::fs::read(exr).unwrap()
    });
    assert!(layers[0] == layers[1]);
    let output = render(&cloud, &format!("-o {}.png --up y --north-arrow", cloud.display()));
    assert!(text(&output.stderr).contains("--north-arrow"));
}

/// Writes two strips of a plane that overlap in the middle: the second sees half of the light.
/// Times grow along x.
fn strips(path: &Path) {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(6).unwrap();
    let axis = las::Transform { scale: 0.001, offset: 0.0 };
    builder.transforms = las::Vector { x: axis, y: axis, z: axis };
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for i in 0..80_000u32 {
        let (strip, place) = (i % 2, i / 2);
        let x = (place % 200) as f64 / 200.0 * 6.0 + 4.0 * strip as f64;
        let y = (place / 200) as f64 / 200.0 * 4.0;
        let light = 20_000 + (place * 7919 % 2000) as u16;
        writer
            .write_point(las::Point {
                x,
                y,
                intensity: if strip == 0 { light } else { light / 2 },
                point_source_id: 1 + strip as u16,
                gps_time: Some(1000.0 + x),
                return_number: 1,
                number_of_returns: 1,
                ..las::Point::default()
            })
            .unwrap();
    }
    writer.close().unwrap();
}

/// Mean of the drawn pixels in the left and in the right third of a picture.
fn sides(png: &Png) -> [f64; 2] {
    let width = png.size[0] as usize;
    [0..width / 3, 2 * width / 3..width].map(|columns| {
        let pixels = png.pixels.iter().enumerate();
        let within = pixels.filter(|(i, _)| columns.contains(&(i % width)));
        mean(&Png { size: png.size, pixels: within.map(|(_, pixel)| *pixel).collect() })
    })
}

#[test]
fn strips_of_different_intensity_are_evened_and_times_grow_along_the_flight() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("strips.las");
    strips(&cloud);
    let line = "--style points --effect edl=off --view top --background 000000";
    let drawn = |more: &str| draw(&cloud, &format!("{line} {more}"));
    // Averages of points of both strips would hide the step.
    let apart = "--color intensity --range 0,30000 --effect luminance=off";
    let [left, right] = sides(&drawn(&format!("{apart} --effect exposure=off")).0);
    assert!(left > 1.4 * right, "{left} {right}");
    let [left, right] = sides(&drawn(&format!("{apart} --effect exposure=on")).0);
    assert!((left / right - 1.0).abs() < 0.03, "{left} {right}");
    // By default too, and of an index as of the file.
    let [left, right] = sides(&drawn(apart).0);
    assert!((left / right - 1.0).abs() < 0.03, "{left} {right}");
    let camera = folder.path().join("cam.json");
    let view = r#"{"eye": [5, 2, 12], "target": [5, 2, 0], "up": [0, 1, 0], "fov_y": 45}"#;
    std::fs::write(&camera, view).unwrap();
    let line = line.replace("--view top", &format!("--camera {}", camera.display()));
    let [file, index] = ["", "--lod 0"].map(|lod| draw(&cloud, &format!("{line} {apart} {lod}")).0);
    // Points at the same depth of a pixel may be seen in another order.
    assert!(difference(&file, &index) < 20, "{}", difference(&file, &index));
    for keeps in ["", "--lod 0"] {
        let [left, right] = sides(&drawn(&format!("--color time --ramp grey {keeps}")).0);
        assert!(right > 1.5 * left, "{left} {right}");
    }
}
