//! Pictures of an index: identical to those of the file if everything is drawn, and otherwise as
//! `--point-budget`, `--lod` and `--gpu-memory` say.

use crate::commands::run;
use crate::exr_file::read_exr;
use crate::files::scan;
use crate::png_file::read_png;
use crate::program::{failed, pointillist, render, succeeded, text};
use pointillist::cloud::colormap::{linear_to_srgb, srgb_to_linear};
use pointillist::index::format::{Index, Plane};
use pointillist::synth::SceneKind;
use serde_json::Value;
use std::path::PathBuf;

/// A scan, and its index.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new(points: u64) -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        scan(&place.at("street.las"), SceneKind::Street, points);
        succeeded(
            &pointillist()
                .arg("index")
                .arg(place.at("street.las"))
                .arg("-o")
                .arg(place.at("street.pnti"))
                .output()
                .unwrap(),
        );
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn render(&self, name: &str, line: &str) -> std::process::Output {
        render(&self.at(name), &line.replace('@', &format!("{}/", self.folder.path().display())))
    }

    fn explained(&self, name: &str, line: &str) -> Value {
        let output = self.render(name, &format!("{line} --explain=json"));
        succeeded(&output);
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

#[test]
fn an_index_drawn_to_its_leaves_is_the_picture_of_the_file() {
    let place = Place::new(300_000);
    let options = "--style points --effect edl=off --size 480x270 --camera @cam.json";
    std::fs::write(
        place.at("cam.json"),
        r#"{"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}"#,
    )
    .unwrap();
    for color in ["rgb", "intensity", "elevation", "class", "return"] {
        succeeded(&place.render("street.las", &format!("{options} --color {color} -o @file.png")));
        succeeded(&place.render(
            "street.pnti",
            &format!("{options} --color {color} --lod 0 --point-budget 1000000 -o @index.png"),
        ));
        let [file, index] = ["file.png", "index.png"].map(|name| read_png(&place.at(name)));
        assert!(
            file.pixels.iter().filter(|pixel| **pixel != file.pixels[0]).count() > 20_000,
            "{color}"
        );
        // Nodes have other origins, so f32 arithmetic may round a point into the neighbouring
        // pixel.
        let differ = file
            .pixels
            .iter()
            .zip(&index.pixels)
            .filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 2))
            .count();
        assert!(differ < file.pixels.len() / 1000, "{color}: {differ} pixels differ");
    }
}

/// Returns the cloud with each point's light multiplied by the gain of its station: LAS 1.2, point
/// format 3, as `synth` writes it.
fn evened(las: &[u8], gains: &[f64]) -> Vec<u8> {
    let (head, records) = las.split_at(227);
    let mut records = records.to_vec();
    for record in records.chunks_exact_mut(34) {
        // Stations are numbered from 1.
        let gain = gains[u16::from_le_bytes([record[18], record[19]]) as usize - 1];
        for channel in record[28..].as_chunks_mut::<2>().0 {
            let linear = gain * srgb_to_linear(u16::from_le_bytes(*channel) as f64 / 65_535.0);
            *channel = ((linear_to_srgb(linear.min(1.0)) * 65_535.0).round() as u16).to_le_bytes();
        }
    }
    [head, &records].concat()
}

/// Merged samples of all stations show what they would with one exposure.
#[test]
fn from_afar_stations_of_an_index_have_one_exposure_and_no_sample_shows_another() {
    let place = Place::new(2_000_000);
    let gains =
        Index::open(&place.at("street.pnti")).unwrap().directory.contents.balance.unwrap().gains;
    std::fs::write(
        place.at("even.las"),
        evened(&std::fs::read(place.at("street.las")).unwrap(), &gains),
    )
    .unwrap();
    succeeded(
        &pointillist()
            .arg("index")
            .arg(place.at("even.las"))
            .arg("-o")
            .arg(place.at("even.pnti"))
            .output()
            .unwrap(),
    );
    for view in ["--lod 4", "--lod 4 --view top"] {
        let options = format!("--style points --effect edl=off --size 480x270 {view}");
        let picture = |name: &str, runs: bool| {
            let explained = place.explained(name, &format!("{options} -o @a.png"));
            assert_eq!(explained["effects"]["exposure"]["runs"], runs, "{name}");
            read_png(&place.at("a.png")).pixels
        };
        let (even, own) = (picture("even.pnti", false), picture("street.pnti", true));
        let light =
            |pixel: [u8; 3]| srgb_to_linear(pixel.into_iter().max().unwrap().max(1) as f64 / 255.0);
        let pairs: Vec<_> =
            even.iter().zip(&own).filter(|(a, b)| **a != even[0] || **b != even[0]).collect();
        let squares =
            pairs.iter().flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c] as f64 - b[c] as f64).powi(2)));
        let psnr = 10.0 * (255.0 * 255.0 * 3.0 * pairs.len() as f64 / squares.sum::<f64>()).log10();
        let specks =
            pairs.iter().filter(|(a, b)| (light(**a) / light(**b)).log2().abs() > 0.25).count()
                as f64
                / pairs.len() as f64;
        println!(
            "{view}: {} pixels, {psnr:.1} dB, {:.2} % are off by more than a quarter of a stop",
            pairs.len(),
            100.0 * specks
        );
        // With plain means of several stations: 34.8 and 36.1 dB, 11.7 and 10.3 %.
        assert!(pairs.len() > 5_000 && psnr > 50.0 && specks < 0.001, "{view}: {psnr} {specks}");
    }
}

#[test]
fn what_is_shown_by_default_and_from_where_is_as_for_the_file() {
    // Of 200,000 points a tree top is on the edge of what is framed, so that samples decide.
    let place = Place::new(300_000);
    let [file, index] =
        ["street.las", "street.pnti"].map(|name| place.explained(name, "-o @a.png --size 320x200"));
    assert_eq!(file["color"], index["color"]);
    assert_eq!(file["effects"]["exposure"]["runs"], true);
    assert_eq!(file["effects"]["exposure"], index["effects"]["exposure"]);
    let eye = |explained: &Value| {
        [0, 1, 2].map(|axis| explained["camera"]["eye"][axis].as_f64().unwrap())
    };
    let (a, b) = (eye(&file), eye(&index));
    assert!((0..3).all(|axis| (a[axis] - b[axis]).abs() < 3.0), "{a:?} {b:?}");
    let absent = place.render("street.pnti", "-o @a.png --color normal");
    assert!(failed(&absent, 1).contains("--color normal"));
}

#[test]
fn budget_and_lod_and_pool_decide_the_cut_and_explain_says_it() {
    let place = Place::new(400_000);
    let cut = |line: &str| {
        place.explained("street.pnti", &format!("-o @a.png --size 320x180 {line}"))["index"].clone()
    };
    let usual = cut("");
    assert!(
        usual["points"].as_u64().unwrap() <= 400_000 && usual["budget"] == 16 * 65_536,
        "{usual}"
    );
    let coarse = cut("--lod 20");
    assert!(
        coarse["points"].as_u64() < usual["points"].as_u64()
            && coarse["largest_error_px"].as_f64().unwrap() <= 20.0,
        "{coarse}"
    );
    assert!(coarse["bytes_read"].as_u64() < usual["bytes_read"].as_u64());
    let bounded = cut("--lod 0 --point-budget 100000");
    assert!(
        bounded["points"].as_u64().unwrap() <= 100_000
            && bounded["largest_error_px"].as_f64().unwrap() > 0.0,
        "{bounded}"
    );
    let all = cut("--lod 0 --point-budget 1000000");
    assert_eq!(
        (&all["largest_error_px"], all["notes"].as_array().unwrap().len()),
        (&Value::from(0.0), 0),
        "{all}"
    );
    let said = succeeded(&place.render(
        "street.pnti",
        "-o @a.png --lod 0 --point-budget 1000000 --gpu-memory 2MiB --explain",
    ));
    assert!(
        said.contains("--gpu-memory")
            && said.contains("cut: ")
            && said.contains("read: ")
            && said.contains("left out"),
        "{said}"
    );
    for wrong in ["--lod -1", "--lod nan", "--point-budget many", "--gpu-memory much"] {
        failed(&place.render("street.pnti", &format!("-o @a.png {wrong}")), 2);
    }
}

#[test]
fn the_same_index_gives_the_same_bits() {
    let place = Place::new(200_000);
    let layers = |pool: &str| {
        succeeded(&place.render(
            "street.pnti",
            &format!("--exr @a.exr --size 320x200 --lod 2 --gpu-memory {pool}"),
        ));
        read_exr(&place.at("a.exr")).layers
    };
    let first = layers("1GiB");
    assert!(first == layers("1GiB") && first == layers("24MiB"));
}

#[test]
fn damage_is_said_and_drawn_around_and_strict_refuses_it() {
    let place = Place::new(200_000);
    let index = Index::open(&place.at("street.pnti")).unwrap();
    let leaf = index.nodes().iter().position(|node| node.is_leaf()).unwrap();
    let at = index.nodes()[leaf].range(Plane::Coarse).0 as usize;
    let mut bytes = std::fs::read(index.path()).unwrap();
    bytes[at + 100] ^= 1;
    std::fs::write(place.at("damaged.pnti"), bytes).unwrap();
    let said = succeeded(
        &place.render("damaged.pnti", "-o @a.png --lod 0 --point-budget 1000000 --size 320x200"),
    );
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.contains("note: ")
            && said.contains("damaged.pnti")
            && said.contains(&format!("node {leaf}'s")),
        "{said}"
    );
    std::fs::remove_file(place.at("a.png")).unwrap();
    failed(
        &place.render(
            "damaged.pnti",
            "-o @a.png --lod 0 --point-budget 1000000 --size 320x200 --strict",
        ),
        1,
    );
    assert!(!place.at("a.png").exists());
}

#[test]
fn an_index_is_drawn_alone_and_is_known_by_what_it_begins_with() {
    let place = Place::new(70_000);
    let both = run([place.at("street.pnti"), place.at("street.las")].iter().fold(
        vec!["render".into(), "-o".into(), place.at("a.png").into_os_string()],
        |mut line: Vec<std::ffi::OsString>, path| {
            line.push(path.into());
            line
        },
    ));
    assert!(failed(&both, 1).contains("must be the only input"));
    std::fs::rename(place.at("street.pnti"), place.at("street.las")).unwrap();
    let output = place.render("street.las", "-o @a.png --size 64x64 --explain");
    assert!(text(&output.stderr).contains("cut: "), "{}", text(&output.stderr));
}

#[test]
fn a_flight_through_more_than_the_pool_holds_waits_for_nothing_and_leaves_no_hole_that_could_be_filled()
 {
    let place = Place::new(600_000);
    let fly = |more: &str| {
        let line = format!(
            "--size 240x135 --frames 60 --lod 0 --point-budget 400000 --gpu-memory 8MiB --validate {more}"
        );
        pointillist()
            .args(["bench", "flight", "--index"])
            .arg(place.at("street.pnti"))
            .args(line.split_whitespace())
            .output()
            .unwrap()
    };
    let output = fly("--json");
    succeeded(&output);
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |name: &str| rows[0][name].as_f64().unwrap_or_else(|| panic!("{name}: {rows}"));
    assert_eq!((number("frames"), number("needless_holes")), (60.0, 0.0));
    assert!(
        number("misses") > 0.0 && number("evictions") > 0.0 && number("bytes_read") > 0.0,
        "{rows}"
    );
    assert!(rows[0]["errors"].as_array().unwrap().is_empty(), "{rows}");
    let output = fly("");
    succeeded(&output);
    assert!(
        ["update", "99.9 %", "misses", "hole"]
            .iter()
            .all(|word| text(&output.stdout).contains(word))
    );
    assert!(failed(&run(["bench", "flight"]), 1).contains("--index"));
}
