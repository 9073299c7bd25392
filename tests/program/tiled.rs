//! Pictures drawn in pieces: equal, bit by bit, to those drawn whole, and of any size.

use crate::files::scan;
use crate::png_file::read_png;
use crate::program::{failed, pointillist, render, succeeded};
use pointillist::synth::SceneKind;
use std::path::PathBuf;

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new(points: u64) -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        scan(&place.at("street.las"), SceneKind::Street, points);
        let camera = r#"{"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}"#;
        std::fs::write(place.at("cam.json"), camera).unwrap();
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn render(&self, file: &str, name: &str, line: &str) -> std::process::Output {
        let (output, camera) = (self.at(name), self.at("cam.json"));
        render(
            &self.at(file),
            &format!("-o {} --camera {} {line}", output.display(), camera.display()),
        )
    }
}

#[test]
fn no_seam_shows_whatever_is_drawn() {
    let place = Place::new(150_000);
    let size = "--size 333x251";
    for look in [
        "",
        "--style points",
        "--style splats",
        "--style strokes --effect strokes=largest=0.03",
        "--style strokes --effect strokes=largest=0.03,blend=blur,brush=ribbons",
        "--light direction:0.3,1,-0.8 --effect shadows=on,samples=2,radius=2 --effect luminance=on",
        "--effect fill=method=mask --effect smooth=iterations=2",
        "--effect ao=on --effect fill=method=splat --effect antialias=on",
        "--opacity class:6=0.5 --effect transparency=layers=2",
        "--clip box:499990,4999990,0,500030,5000060,300",
    ] {
        succeeded(&place.render("street.las", "whole.png", &format!("{size} {look}")));
        succeeded(&place.render("street.las", "pieces.png", &format!("{size} {look} --piece 64")));
        let [whole, pieces] = ["whole.png", "pieces.png"].map(|name| read_png(&place.at(name)));
        let differ = whole.pixels.iter().zip(&pieces.pixels).filter(|(a, b)| a != b).count();
        let drawn = whole.pixels.iter().filter(|pixel| **pixel != whole.pixels[0]).count();
        assert!(drawn > 5000, "{look}: {drawn} pixels are drawn");
        assert_eq!(differ, 0, "{look}");
    }
}

/// Nodes are chosen for each piece.
#[test]
fn samples_of_an_index_meet_without_a_seam_that_could_be_seen() {
    let place = Place::new(100_000);
    succeeded(
        &pointillist()
            .arg("index")
            .arg(place.at("street.las"))
            .arg("-o")
            .arg(place.at("street.pnti"))
            .output()
            .unwrap(),
    );
    succeeded(&place.render("street.pnti", "whole.png", "--size 256x160 --lod 2"));
    succeeded(&place.render("street.pnti", "pieces.png", "--size 256x160 --lod 2 --piece 64"));
    let [whole, pieces] = ["whole.png", "pieces.png"].map(|name| read_png(&place.at(name)));
    let off = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap() > 2;
    let differ = whole.pixels.iter().zip(&pieces.pixels).filter(|pair| off(*pair)).count();
    assert!(differ * 500 < whole.pixels.len(), "{differ} pixels differ");
}

#[test]
fn parts_have_the_rows_and_the_frames_of_the_whole() {
    let place = Place::new(100_000);
    let size = "--size 200x2600";
    succeeded(&place.render("street.las", "whole.png", &format!("{size} --legend --title Street")));
    for parts in [2, 3] {
        let mut pixels = Vec::new();
        for number in 1..=parts {
            let line = format!("{size} --legend --title Street --part {number}/{parts}");
            let said = succeeded(&place.render("street.las", "part.png", &line));
            assert!(said.contains(&format!("part {number}/{parts} is rows")), "{said}");
            pixels.extend(read_png(&place.at("part.png")).pixels);
        }
        assert!(pixels == read_png(&place.at("whole.png")).pixels, "{parts} parts");
    }
    let turn = |name: &str, line: &str| {
        let output = place.at(name);
        render(
            &place.at("street.las"),
            &format!("-o {} --size 64x48 --turntable 7 {line}", output.display()),
        )
    };
    succeeded(&turn("turn.png", ""));
    for number in [3, 1, 2] {
        succeeded(&turn("part.png", &format!("--part {number}/3")));
    }
    for frame in 1..=7 {
        let [whole, part] = ["turn", "part"]
            .map(|name| std::fs::read(place.at(&format!("{name}-000{frame}.png"))).unwrap());
        assert!(whole == part, "frame {frame}");
    }
    let said = failed(&place.render("street.las", "no.png", "--size 64x48 --part 1/2"), 1);
    assert!(said.contains("has none of the 48 rows"), "{said}");
    let said = failed(&turn("turn.mp4", "--part 1/2"), 1);
    assert!(said.contains("--part is for numbered frames"), "{said}");
    let said = failed(&place.render("street.las", "no.png", "--part 4/3"), 2);
    assert!(said.contains("is not a part such as 3/16"), "{said}");
}

#[test]
fn a_picture_is_larger_than_any_image_and_what_needs_all_of_it_is_refused() {
    let place = Place::new(20_000);
    // Wider than any device's images.
    succeeded(&place.render("street.las", "wide.png", "--size 40000x24"));
    let wide = read_png(&place.at("wide.png"));
    assert_eq!(wide.size, [40_000, 24]);
    assert!(wide.pixels.iter().any(|pixel| *pixel != wide.pixels[0]));
    for (line, word) in [
        (format!("--size 40000x24 --exr {}", place.at("wide.exr").display()), "--exr"),
        ("--size 256x160 --piece 64 --effect ao=on,radius=2".to_string(), "ao"),
    ] {
        let said = failed(&place.render("street.las", "refused.png", &line), 1);
        assert!(said.contains(word), "{said}");
        assert!(!place.at("refused.png").exists());
    }
}
