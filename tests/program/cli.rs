//! Commands as a user types them: help, exit codes, every option of `render`, reproducible bits,
//! odd paths, Ctrl-C.

use crate::commands::run;
use crate::exr_file::read_exr;
use crate::files::{names, scan};
use crate::made::shuffled;
use crate::png_file::read_png;
use crate::program::{SIGNALS, failed, pointillist, render, succeeded, text};
use pointillist::synth::SceneKind;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// A folder with a small scan in it.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Place {
        Place { folder: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn line(&self, line: &str) -> String {
        line.replace("@", &format!("{}/", self.folder.path().display()))
    }

    fn scan(&self, name: &str, scene: SceneKind, points: u64) -> PathBuf {
        let path = self.at(name);
        scan(&path, scene, points);
        path
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.at(name);
        fs::write(&path, text).unwrap();
        path
    }

    /// Runs `render` on a cloud, with a line in which `@` is this folder.
    fn render(&self, cloud: &Path, line: &str) -> std::process::Output {
        render(cloud, &self.line(line))
    }
}

const CAMERA: &str = r#"{"eye": [3, -4, 3], "target": [0, 0, 0], "up": [0, 0, 1], "fov_y": 40}"#;

#[test]
fn every_command_explains_itself_with_examples() {
    for command in ["view", "render", "export", "raster", "info", "synth", "tune", "study", "bench"]
    {
        let output = run([command, "--help"]);
        succeeded(&output);
        let help = text(&output.stdout);
        assert!(
            help.contains("Examples:") && help.contains(&format!("pointillist {command}")),
            "{command}: {help}"
        );
    }
    assert!(text(&run(["--help"]).stdout).contains("render"));
}

#[test]
fn help_of_render_fits_two_screens_and_names_where_the_rest_is() {
    let help = |topic: &[&str]| {
        let words = ["render", "--help"].iter().chain(topic);
        let output = pointillist().args(words).output().unwrap();
        succeeded(&output);
        text(&output.stdout)
    };
    let short = help(&[]);
    assert!(short.lines().count() <= 100, "{} lines: {short}", short.lines().count());
    assert!(short.contains("--help all") && short.contains("--help effects"), "{short}");
    let all = help(&["all"]);
    let rare = ["--abuffer-memory", "--columns", "--resume", "depth.Z, index.V"];
    for words in rare {
        assert!(all.contains(words) && !short.contains(words), "{words}: {all}");
    }
    let option = |line: &&str| line.trim_start().starts_with("--");
    let missing: Vec<&str> = short.lines().filter(option).collect();
    assert!(missing.len() > 20);
    for line in missing {
        let name = line.split_whitespace().next().unwrap();
        assert!(all.contains(name), "{name}: {all}");
    }
    assert!(help(&["effects"]).contains("    strength="));
}

#[test]
fn exit_codes_are_0_success_1_failure_2_usage() {
    let place = Place::new();
    let cloud = place.scan("torus.las", SceneKind::Torus, 1000);
    succeeded(&place.render(&cloud, "-o @out.png --size 32x32"));
    // More pixels a side than any image has.
    succeeded(&place.render(&cloud, "-o @out.png --size 32768x1"));
    for wrong in [
        "",
        "-o @a.png --size 0x5",
        "-o @a.png --size big",
        "-o @a.png --size 100000000x1",
        "-o @a.png --color pink",
        "-o @a.png --background 12345",
        "-o @a.png --nonsense",
    ] {
        failed(&place.render(&cloud, wrong), 2);
    }
    failed(&run(["explode"]), 2);
    failed(&run::<&str>([]), 2);
    for (wrong, names) in [
        ("--effect edl=sometimes", "sometimes"),
        ("--effect glow=on", "glow"),
        ("--effect edl=on,strength=-1", "strength"),
        ("--effect shadows=samples=1.5", "samples=1.5 is not a whole number"),
        ("--effect luminance=neighbourhood=2", "there is no neighbourhood=2; there are: 0, 1, 3"),
        (
            "--effect visibility=kernel=9",
            "there is no setting \"kernel\"; there are: threshold, holes",
        ),
        ("--layer 0", "is not a length above 0"),
        ("--opacity -0.1", "an opacity from 0 to 1"),
    ] {
        let said = failed(&place.render(&cloud, &format!("-o @a.png {wrong}")), 2);
        assert!(said.contains(names), "{wrong}: {said}");
    }
    for (wrong, names) in [
        ("-o @a.png --size 32768x1 --effect ao=on,radius=2", "ao"),
        ("-o @a.png --camera @none.json", "none.json"),
        ("-o @a.png --opacity file:none.las=0.5", "no file \"none.las\"; there are: torus.las"),
        ("-o @nowhere/a.png", "nowhere"),
    ] {
        let said = failed(&place.render(&cloud, wrong), 1);
        assert!(said.contains(names), "{wrong}: {said}");
    }
    let huge = place.render(&cloud, "-o @a.png --size 4294967295x4294967295");
    assert!(matches!(huge.status.code(), Some(1 | 2)), "{}", text(&huge.stderr));
    assert_eq!(names(place.folder.path()), ["out.png", "torus.las"]);
}

#[test]
fn an_attribute_that_is_not_there_is_named() {
    let place = Place::new();
    let cloud = place.write("plain.xyz", "0 0 0\n1 0 0\n0 1 1\n");
    let said = text(&place.render(&cloud, "-o @a.png --color rgb").stderr);
    assert!(said.contains("--color rgb") && !place.at("a.png").exists(), "{said}");
}

#[test]
fn a_picture_from_a_file_and_nothing_else() {
    let place = Place::new();
    let cloud = place.scan("street.laz", SceneKind::Street, 30_000);
    let output = place.render(&cloud, "-o @out.png");
    assert_eq!(succeeded(&output), "", "quiet when there is nothing to say");
    assert!(output.stdout.is_empty());
    let picture = read_png(&place.at("out.png"));
    assert_eq!(picture.size, [1920, 1080]);
    let background = picture.pixels[0];
    assert_eq!(background, pointillist::config::BACKGROUND);
    assert!(picture.pixels.iter().filter(|&&pixel| pixel != background).count() > 10_000);
}

/// Layers that PRODUCT.md lists.
const CHANNELS: [&str; 12] = [
    "A",
    "B",
    "G",
    "R",
    "coverage.V",
    "depth.Z",
    "index.V",
    "lit.V",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "raw.Z",
];

/// One parameter for all effects that separate surfaces; a note says if depths are coarser than it
/// (guide: numerics, case 4).
#[test]
fn layer_distance_applies_to_masks_layers_and_shadows() {
    let place = Place::new();
    let cloud = place.scan("tori.las", SceneKind::NestedTori, 60_000);
    let explained = |line: &str| {
        let line = format!(
            "-o @out.png --size 96x64 --opacity 0.5 --effect fill=method=mask --effect shadows=on,size=256 --light direction:0.3,0.8,-0.8 --explain {line}"
        );
        succeeded(&place.render(&cloud, &line))
    };
    let all = explained("--layer 0.125");
    for said in [
        "0.125 m between layers, as asked for",
        "fill: on, because masks find holes and hidden pixels; surfaces are at least 0.125 m apart",
        "16 layers, 0.125 m apart at least",
        "shadow begins 0.125000 m behind a surface",
    ] {
        assert!(all.contains(said), "{said} is not in {all}");
    }
    assert!(!all.contains("note:"), "{all}");
    // Never so near that surfaces shade themselves.
    let thin = explained("--layer 0.0000001");
    let gap: f64 =
        thin.split("shadow begins ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(
        gap > 0.01 && thin.contains("note: the layer distance 0.0000001 m is too small for the depth resolution in view,"),
        "{thin}"
    );
    place.write("far.json", r#"{"eye": [0, -1000000, 0], "target": [0, 0, 0], "fov_y": 0.0002}"#);
    let far = succeeded(&place.render(&cloud, "-o @out.png --size 96x64 --camera @far.json"));
    assert!(
        far.contains("note: the depth resolution in view is 0.0625 m, and pixels are"),
        "{far}"
    );
}

#[test]
fn every_option_of_render_does_what_it_says() {
    let place = Place::new();
    let cloud = place.scan("torus.las", SceneKind::Torus, 60_000);
    place.write("cam.json", CAMERA);
    let plain = "--size 96x64 --style points --camera @cam.json";
    let output = place.render(&cloud, &format!("{plain} -o @plain.png --exr @plain.exr"));
    assert_eq!(succeeded(&output), "");
    let bytes = |name: &str| fs::read(place.at(name)).unwrap();

    let layers = read_exr(&place.at("plain.exr"));
    assert_eq!(layers.size, [96, 64]);
    assert_eq!(layers.layers.keys().collect::<Vec<_>>(), CHANNELS);
    let (depth, raw) = (layers.floats("depth.Z"), layers.floats("raw.Z"));
    for pixel in 0..depth.len() {
        let nothing = layers.layers["index.V"][pixel] == u32::MAX;
        assert_eq!(nothing, depth[pixel] == f32::INFINITY);
        assert_eq!(nothing, layers.layers["coverage.V"][pixel] == 0);
        assert!(
            nothing || (depth[pixel] > 3.0 && depth[pixel] < 8.0 && depth[pixel] == raw[pixel]),
            "{}",
            depth[pixel]
        );
    }

    for different in [
        "--background ffffff",
        "--color elevation",
        "--color white",
        "--effect edl=off",
        "--effect edl=on,strength=1.5,radius=3",
        "--effect shape=on",
    ] {
        succeeded(&place.render(&cloud, &format!("{plain} -o @other.png {different}")));
        assert!(bytes("plain.png") != bytes("other.png"), "{different} changes nothing");
    }
    for same in [
        "--effect visibility=off",
        "--effect edl=auto",
        "--device 0",
        "--background #181b20",
        "--color rgb",
        "--strict",
    ] {
        succeeded(&place.render(&cloud, &format!("{plain} -o @other.png {same}")));
        assert!(bytes("plain.png") == bytes("other.png"), "{same} changes the picture");
    }
    for view in ["top", "front", "iso", "fit"] {
        succeeded(&place.render(&cloud, &format!("--size 96x64 --view {view} -o @{view}.png")));
    }
    assert!(bytes("top.png") != bytes("front.png") && bytes("iso.png") != bytes("top.png"));
    for color in ["intensity", "elevation", "class", "source", "return", "white"] {
        succeeded(&place.render(&cloud, &format!("{plain} -o @other.png --color {color}")));
    }
    failed(&place.render(&cloud, "--view top --camera @cam.json -o @other.png"), 2);

    let said = succeeded(&place.render(&cloud, &format!("{plain} -o @other.png --explain")));
    assert!(
        ["device:", "60000 points", "edl: on, because", "plan:", "composite"]
            .iter()
            .all(|part| said.contains(part)),
        "{said}"
    );
    let said = succeeded(&place.render(&cloud, "--size 96x64 -o @other.png --explain"));
    assert!(
        ["tiles: 96 of 8 x 8 pixels", "with pixels to fill"].iter().all(|part| said.contains(part)),
        "{said}"
    );
    let output = place.render(&cloud, &format!("{plain} -o @other.png --explain=json"));
    assert_eq!(succeeded(&output), "");
    let explained: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&explained["cloud"]["points"], &explained["size"]),
        (&60_000.into(), &serde_json::json!([96, 64]))
    );
    assert_eq!(explained["effects"]["edl"]["runs"], true);
    let output =
        place.render(&cloud, &format!("{plain} -o @other.png --effect edl=off --explain=json"));
    let explained: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(
        !explained["passes"].to_string().contains("edl"),
        "what is off leaves no trace: {explained}"
    );
    let explained: serde_json::Value = serde_json::from_slice(
        &place.render(&cloud, "--size 96x64 -o @other.png --explain=json").stdout,
    )
    .unwrap();
    let map = |name: &str| {
        explained["tiles"][name]
            .as_array()
            .unwrap()
            .iter()
            .map(|row| row.as_str().unwrap().to_string())
            .collect::<String>()
    };
    let (looked, holes) = (map("looked_at_map"), map("holes_map"));
    assert_eq!(
        (looked.len(), holes.matches('#').count() as u64),
        (96, explained["tiles"]["holes"].as_u64().unwrap())
    );
    // The coarsest level that looked at each tile.
    for by_level in explained["tiles"]["looked_at"].as_array().unwrap() {
        let level = by_level[0].as_u64().unwrap().ilog2();
        let coarsest =
            looked.chars().filter(|tile| tile.to_digit(10) == Some(level)).count() as u64;
        assert!(coarsest <= by_level[1].as_u64().unwrap(), "{looked}");
    }
    assert!(
        looked.chars().all(|tile| tile == '.' || tile.is_digit(8))
            && looked.contains(|tile| tile != '.'),
        "{looked}"
    );
    let said = succeeded(&place.render(&cloud, &format!("{plain} -o @other.png --timings")));
    assert!(
        ["read", "draw", "composite", "total"].iter().all(|part| said.contains(part)),
        "{said}"
    );
}

#[test]
fn validation_layers_are_silent() {
    let place = Place::new();
    let cloud = place.scan("step.las", SceneKind::Step, 20_000);
    let output = place.render(&cloud, "--size 331x257 -o @a.png --exr @a.exr --validate");
    assert_eq!(succeeded(&output), "");
    assert!(output.stdout.is_empty());
}

#[test]
fn an_unknown_device_lists_those_there_are() {
    let place = Place::new();
    let cloud = place.scan("step.las", SceneKind::Step, 100);
    for device in ["abacus", "77"] {
        let said = failed(&place.render(&cloud, &format!("-o @a.png --device {device}")), 1);
        assert!(said.contains(device) && said.contains("there are: 0: "), "{said}");
    }
}

#[test]
fn the_same_input_gives_the_same_bits_on_any_number_of_threads() {
    let place = Place::new();
    let cloud = place.scan("street.las", SceneKind::Street, 200_000);
    let line = place.line("--size 641x359 -o @a.png --exr @a.exr");
    let mut first = None;
    // Threads of the software driver, and of our own.
    for (driver, own) in [
        (None, None),
        (None, None),
        (Some("0"), None),
        (Some("1"), Some("1")),
        (Some("2"), Some("3")),
    ] {
        let mut command = pointillist();
        command.arg("render").arg(&cloud).args(line.split_whitespace());
        command.envs(driver.map(|threads| ("LP_NUM_THREADS", threads)));
        command.envs(own.map(|threads| ("RAYON_NUM_THREADS", threads)));
        succeeded(&command.output().unwrap());
        let files = ["a.png", "a.exr"].map(|name| fs::read(place.at(name)).unwrap());
        assert!(
            *first.get_or_insert_with(|| files.clone()) == files,
            "LP_NUM_THREADS {driver:?}, RAYON_NUM_THREADS {own:?}"
        );
    }
}

/// Draws a cloud in two orders with these options, and checks that the pictures are the same.
fn assert_order_does_not_show(options: &str) {
    let place = Place::new();
    let cloud = place.scan("street.las", SceneKind::Street, 200_000);
    place.write("cam.json", r#"{"eye": [500002, 4999972, 102], "target": [499998, 5000010, 105]}"#);
    fs::write(place.at("shuffled.las"), shuffled(&fs::read(&cloud).unwrap())).unwrap();
    succeeded(&place.render(&cloud, &format!("--size 640x360 -o @a.png --exr @a.exr {options}")));
    succeeded(&place.render(
        &place.at("shuffled.las"),
        &format!("--size 640x360 -o @b.png --exr @b.exr {options}"),
    ));
    assert!(read_png(&place.at("a.png")).pixels == read_png(&place.at("b.png")).pixels);
    let [a, b] = ["a.exr", "b.exr"].map(|name| read_exr(&place.at(name)).layers);
    assert!(
        ["R", "G", "B", "A", "depth.Z", "raw.Z", "coverage.V"]
            .iter()
            .all(|layer| a[*layer] == b[*layer])
    );
}

#[test]
fn hard_00_m3_shuffled_input_gives_the_same_picture() {
    assert_order_does_not_show("--camera @cam.json");
}

#[test]
fn hard_00_m3_shuffled_input_is_framed_the_same_way() {
    assert_order_does_not_show("--view fit");
}

#[test]
fn nothing_is_written_over_an_input() {
    let place = Place::new();
    let cloud = place.scan("torus.las", SceneKind::Torus, 100);
    let before = fs::read(&cloud).unwrap();
    for line in ["-o @torus.las", "--exr @torus.las", "-o @./torus.las"] {
        assert!(failed(&place.render(&cloud, line), 1).contains("is an input"));
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&cloud, place.at("link.png")).unwrap();
        fs::hard_link(&cloud, place.at("twin.png")).unwrap();
        failed(&place.render(&cloud, "-o @link.png"), 1);
    }
    assert!(failed(&place.render(&cloud, "-o @same.png --exr @same.png"), 1).contains("same.png"));
    assert_eq!(fs::read(&cloud).unwrap(), before);
}

#[test]
fn small_and_degenerate_clouds_are_drawn() {
    let place = Place::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let cases = [
        ("none.las", String::new(), 0),
        ("empty.ply", header.replace('3', "0"), 0),
        ("one.xyz", "500000.5 5000000.25 3\n".to_string(), 1),
        ("equal.xyz", "1 2 3\n".repeat(1000), 1),
        ("nan.xyz", "0 0 0\nnan 1 1\n1 inf 1\n1 1 1\n".to_string(), 2),
        ("nan.ply", format!("{header}0 0 0\nnan nan nan\n1 1 1\n"), 2),
        ("all_nan.xyz", "nan nan nan\n".to_string(), 0),
        ("line.xyz", "0 0 0\n1 0 0\n2 0 0\n".to_string(), 3),
        ("wide.xyz", "0 0 0\n1e9 0 0\n0 1e9 1e-3\n".to_string(), 2),
    ];
    for (name, contents, at_least) in cases {
        let cloud = if contents.is_empty() {
            place.scan(name, SceneKind::Plane, 0)
        } else {
            place.write(name, &contents)
        };
        let said = succeeded(&place.render(&cloud, "--size 64x48 -o @a.png --exr @a.exr"));
        let layers = read_exr(&place.at("a.exr"));
        let covered = layers.layers["coverage.V"].iter().filter(|&&coverage| coverage == 1).count();
        assert!(covered >= at_least, "{name}: {covered} pixels drawn; {said}");
        assert!(
            ["R", "G", "B"]
                .iter()
                .all(|layer| layers.floats(layer).iter().all(|value| value.is_finite())),
            "{name}"
        );
        if name.contains("nan") {
            let lost = ["1 points with NaN", "2 points with NaN"];
            assert!(lost.iter().any(|count| said.contains(count)), "{name}: {said}");
        }
        for style in ["points", "strokes"] {
            succeeded(&place.render(&cloud, &format!("--size 64x48 -o @a.png --style {style}")));
        }
    }
}

/// No point is visible, in every style.
#[test]
fn a_camera_that_looks_away_and_points_without_opacity_show_the_background() {
    let place = Place::new();
    let cloud = place.scan("scan.las", SceneKind::Torus, 2000);
    place.write("away.json", r#"{"eye": [0, 0, 100], "target": [0, 0, 200]}"#);
    for style in ["auto", "surface", "points", "splats", "strokes"] {
        for unseen in ["--camera @away.json", "--opacity class:1=0"] {
            succeeded(
                &place.render(&cloud, &format!("--size 64x48 -o @a.png --style {style} {unseen}")),
            );
            let picture = read_png(&place.at("a.png"));
            assert!(
                picture.pixels.iter().all(|&pixel| pixel == pointillist::config::BACKGROUND),
                "{style} {unseen}"
            );
        }
    }
}

#[test]
fn outputs_need_the_extension_of_their_format() {
    let place = Place::new();
    let cloud = place.scan("scan.las", SceneKind::Torus, 100);
    for line in ["-o @a.jpg", "-o @a.png --exr @b.png"] {
        let said = failed(&place.render(&cloud, line), 1);
        assert!(said.contains("must end in ."), "{said}");
    }
    let synth = |line: &str| {
        pointillist()
            .arg("synth")
            .arg("plane")
            .args(["--points", "10", "-o"])
            .arg(place.at(line))
            .output()
            .unwrap()
    };
    failed(&synth("a.ply"), 1);
    failed(&synth("a.exr"), 1);
    succeeded(&synth("a.laz"));
}

/// Images of some effects are larger than the picture.
#[test]
fn pictures_are_as_large_as_images_of_the_device_and_larger_in_the_default_style() {
    let place = Place::new();
    let cloud = place.scan("scan.las", SceneKind::Torus, 1000);
    for width in [16_340, 16_384] {
        succeeded(&place.render(&cloud, &format!("-o @wide.png --size {width}x1")));
        assert_eq!(read_png(&place.at("wide.png")).size, [width, 1]);
    }
}

#[cfg(unix)]
/// Devices differ in their largest image: the picture is drawn, or one line names the limit.
#[test]
fn a_picture_larger_than_an_image_of_the_device_is_refused_in_one_line() {
    let place = Place::new();
    let cloud = place.scan("scan.las", SceneKind::Torus, 1000);
    let output = place.render(&cloud, "-o @wide.png --size 32768x16");
    if output.status.success() {
        assert_eq!(read_png(&place.at("wide.png")).size, [32_768, 16]);
        return;
    }
    let said = failed(&output, 1);
    assert!(
        said.contains("32768 x 16") && said.contains("a side") && said.contains("--size"),
        "{said}"
    );
    assert!(!place.at("wide.png").exists());
}

#[test]
fn odd_paths_are_handled_or_refused_in_one_line() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    let cloud = place.scan("plain.las", SceneKind::Torus, 100);
    let long = [b'l'; 251].to_vec();
    for name in [
        &b"with spaces and 'quotes'"[..],
        "Öl 测试点云".as_bytes(),
        b"not \xFF\xFE UTF-8",
        b"two\nlines",
        b"-dash",
        &long,
    ] {
        let named = |ending: &str| {
            place.folder.path().join(OsStr::from_bytes(&[name, ending.as_bytes()].concat()))
        };
        let (input, output) = (named(".las"), named(".png"));
        fs::copy(&cloud, &input).unwrap();
        let drawn = pointillist()
            .arg("render")
            .arg(&input)
            .args(["--size", "32x32", "-o"])
            .arg(&output)
            .output()
            .unwrap();
        succeeded(&drawn);
        assert_eq!(read_png(&output).size, [32, 32]);
        succeeded(&pointillist().arg("info").arg(&input).output().unwrap());
        let missing = pointillist().arg("info").arg(named(".none")).output().unwrap();
        // A line break in a name does not break the line.
        failed(&missing, 1);
    }
    let path = |name: &str| place.at(name).display().to_string();
    let fifo = std::process::Command::new("mkfifo").arg(place.at("fifo")).status();
    for odd in ["missing.las", "fifo", ""]
        .iter()
        .filter(|name| **name != "fifo" || fifo.as_ref().is_ok_and(|status| status.success()))
    {
        for command in [
            vec!["info".to_string(), path(odd)],
            vec!["render".to_string(), path(odd), "-o".to_string(), path("a.png")],
        ] {
            failed(&run(&command), 1);
        }
        if *odd != "missing.las" {
            failed(&run(["render", &path("plain.las"), "-o", &path(odd)]), 1);
        }
    }
    assert!(
        names(place.folder.path()).iter().all(|name| !name.contains("partial") && name != "a.png")
    );
}

#[test]
fn info_counts_what_it_reads() {
    let place = Place::new();
    let cloud = place.scan("street.laz", SceneKind::Street, 5000);
    let output = pointillist().args(["info", "--json"]).arg(&cloud).output().unwrap();
    assert_eq!(succeeded(&output), "");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["points"], 5000);
    assert_eq!(report["parts"][0]["header"]["points"], 5000);
    assert!(report["stations"].as_array().unwrap().len() > 1);
    let output = pointillist().arg("info").arg(&cloud).output().unwrap();
    assert!(text(&output.stdout).contains("5000"));
    let classes = text(&output.stdout)
        .lines()
        .find(|line| line.trim().starts_with("classes"))
        .unwrap()
        .to_string();

    // An index knows classes, too.
    let index = place.at("street.pnti");
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let output = pointillist().args(["info", "--json"]).arg(&index).output().unwrap();
    let indexed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(indexed["classes"], report["parts"][0]["attributes"]["class"]);
    assert_eq!(indexed["returns"], serde_json::json!([{ "return": 1, "points": 5000 }]));
    let output = pointillist().arg("info").arg(&index).output().unwrap();
    assert!(text(&output.stdout).lines().any(|line| line == classes), "{}", text(&output.stdout));
}

#[test]
fn synth_writes_cloud_camera_and_truth_of_one_scene() {
    let place = Place::new();
    let line = place.line("synth torus --points 300000 -o @t.laz --camera-out @cam.json");
    assert_eq!(succeeded(&run(line.split_whitespace())), "");
    let line = place.line("synth torus --truth @cam.json -o @truth.exr --size 160x120");
    assert_eq!(succeeded(&run(line.split_whitespace())), "");
    succeeded(
        &place.render(&place.at("t.laz"), "--camera @cam.json --size 160x120 --exr @drawn.exr"),
    );
    let (drawn, truth) = (read_exr(&place.at("drawn.exr")), read_exr(&place.at("truth.exr")));
    let (depth, true_depth) = (drawn.floats("depth.Z"), truth.floats("depth.Z"));
    let both: Vec<_> =
        depth.iter().zip(&true_depth).filter(|(a, b)| a.is_finite() && b.is_finite()).collect();
    assert!(both.len() > 2000, "{} pixels", both.len());
    let near = both.iter().filter(|(a, b)| (*a - *b).abs() < 0.02 * *b).count();
    assert!(
        near as f64 > 0.9 * both.len() as f64,
        "{near} of {} depths are those of the scene",
        both.len()
    );
    failed(&run(["synth", "torus"]), 1);
    failed(&run(place.line("synth torus --points 100 -o @none/t.las").split_whitespace()), 1);
    let huge = run(place
        .line("synth torus --truth @cam.json -o @huge.exr --size 4294967295x4294967295")
        .split_whitespace());
    assert!(matches!(huge.status.code(), Some(1 | 2)), "{}", text(&huge.stderr));
}

/// Ctrl-C, SIGTERM and SIGHUP in turn at different moments: exit code 130 or a whole file, and
/// never anything else in the folder.
#[cfg(unix)]
#[test]
fn interrupted_work_leaves_nothing_half_written() {
    let place = Place::new();
    place.scan("street.las", SceneKind::Street, 400_000);
    let synth = place.line("synth street --points 50000000 -o @out.las");
    let laz = place.line("synth street --points 50000000 -o @out.laz");
    let truth = place.line("synth street --truth @cam.json -o @out.exr --size 4000x3000");
    succeeded(&run(place.line("synth street --camera-out @cam.json").split_whitespace()));
    let drawn = place.line("render @street.las -o @out.png --exr @out2.exr --size 1920x1080");
    // Many rows, written long after the points are read.
    let map = place.line("raster @street.las -o @map.tif --resolution 0.002");
    let given = names(place.folder.path());
    let mut signals = SIGNALS.iter().cycle();
    for (line, waits_ms) in [
        (&synth, &[300, 1500][..]),
        (&laz, &[1000]),
        (&map, &[300, 1200]),
        (&truth, &[600]),
        (&drawn, &[40, 250, 500, 900, 1400]),
    ] {
        for &wait_ms in waits_ms {
            let child =
                pointillist().args(line.split_whitespace()).stderr(Stdio::piped()).spawn().unwrap();
            std::thread::sleep(Duration::from_millis(wait_ms));
            let &(signal, name) = signals.next().unwrap();
            // SAFETY: a system call; the child has not been waited for, so its id is its own.
            unsafe { libc::kill(child.id() as i32, signal) };
            let since = Instant::now();
            let output = child.wait_with_output().unwrap();
            assert!(
                since.elapsed() < Duration::from_secs(5),
                "{line}: heeded after {:?}",
                since.elapsed()
            );
            let said = text(&output.stderr);
            println!("{line}, after {wait_ms} ms of {name}: {}: {said}", output.status);
            match output.status.code() {
                Some(0) => {}
                // Before the handler is there the signal itself ends the process.
                None => assert!(said.is_empty(), "{said}"),
                code => {
                    assert_eq!(code, Some(130), "{said}");
                    // Notes may come before.
                    let mut lines = said.lines().rev();
                    let last = lines.next();
                    assert_eq!(
                        last,
                        Some("pointillist: interrupted; nothing was left half written")
                    );
                    assert!(lines.all(|line| line.starts_with("pointillist: note: ")), "{said}");
                }
            }
            for name in names(place.folder.path()).iter().filter(|name| !given.contains(name)) {
                let path = place.at(name);
                match path.extension().and_then(|extension| extension.to_str()) {
                    Some("png") => assert_eq!(read_png(&path).size, [1920, 1080]),
                    Some("exr") => drop(read_exr(&path)),
                    _ => panic!("{line}, after {wait_ms} ms: {name} was left"),
                }
                fs::remove_file(path).unwrap();
            }
        }
    }
}

#[test]
fn painting_in_parts_is_the_same_with_a_note() {
    let place = Place::new();
    let cloud = place.scan("torus.las", SceneKind::Torus, 60_000);
    let drawn = [("ample.png", "512MiB"), ("scarce.png", "1MiB")].map(|(name, bytes)| {
        let output = place.render(
            &cloud,
            &format!("-o @{name} --style strokes --size 320x240 --abuffer-memory {bytes}"),
        );
        succeeded(&output);
        (fs::read(place.at(name)).unwrap(), text(&output.stderr))
    });
    assert!(drawn[0].0 == drawn[1].0);
    let [ample, scarce] = drawn.map(|(_, said)| said);
    assert!(
        !ample.contains("memory allowed")
            && scarce.contains("because the memory allowed was reached"),
        "{ample}{scarce}"
    );
    failed(&place.render(&cloud, "-o @out.png --style strokes --abuffer-memory 1KiB"), 2);
}

/// Each place would be painted over itself fifty thousand times in every pixel.
#[test]
fn many_points_in_two_places_are_painted_in_seconds() {
    let place = Place::new();
    let line = |i: usize| {
        let at = if i.is_multiple_of(2) { "0 0 0" } else { "1 0.3 0.2" };
        format!("{at} {} {} {}\n", i % 251, i % 256, i % 7)
    };
    let cloud = place.write("two.xyz", &(0..100_000).map(line).collect::<String>());
    for blend in ["abuffer", "opaque"] {
        let began = Instant::now();
        let line = format!("-o @{blend}.png --style strokes --size 200x150");
        succeeded(&place.render(&cloud, &format!("{line} --effect strokes=blend={blend}")));
        println!("{blend}: {:?}", began.elapsed());
        // It takes about a second.
        assert!(began.elapsed() < Duration::from_secs(30), "{blend}: {:?}", began.elapsed());
    }
}

/// Settings without effect get a note and cost nothing; limits that are reached get a note, too.
#[test]
fn settings_that_change_nothing_are_said() {
    let place = Place::new();
    let cloud = place.scan("tori.las", SceneKind::NestedTori, 60_000);
    let said = |line: &str| {
        let output = place.render(&cloud, &format!("-o @out.png --size 96x64 {line}"));
        let said = succeeded(&output);
        (said, fs::read(place.at("out.png")).unwrap(), text(&output.stdout))
    };
    let (quiet, plain, _) = said("");
    assert!(!quiet.contains("note:"), "{quiet}");
    let (lost, picture, explained) = said("--opacity class:99=0.3 --explain=json");
    assert!(
        lost.contains("note: --opacity class:99=0.3: no point is of class 99; there are: 1, 2, 3"),
        "{lost}"
    );
    assert!(
        picture == plain && !explained.contains("\"transparency\": {\"runs\": true"),
        "{explained}"
    );
    let (there, picture, _) = said("--opacity class:3=0.3");
    assert!(!there.contains("note:") && picture != plain, "{there}");
    let (drop, ..) = said("--light direction:0.3,0.8,-0.8 --effect phong=backfaces=drop");
    assert!(
        drop.contains(
            "note: phong=backfaces=drop has no effect: the files have no oriented normals"
        ),
        "{drop}"
    );
    let (unused, same, _) = said(
        "--effect shadows=samples=4,radius=2 --effect smooth=iterations=3 --effect edl=off,radius=3",
    );
    assert!(unused.contains("note: shadows: samples and radius have no effect, since the effect does not run: they cost"), "{unused}");
    assert!(
        unused.contains("note: smooth: iterations has no effect")
            && !unused.contains("edl")
            && same == plain,
        "{unused}"
    );
    let (wide, ..) = said("--effect shadows=on,radius=60,size=64");
    assert!(wide.contains("note: shadows=radius=60 is limited to 45 degrees"), "{wide}");
    let (ambient, ..) =
        said("--light direction:0.3,0.8,-0.8 --effect shadows=on,ambient=0,size=64");
    assert!(ambient.contains("note: shadows=ambient has no effect, since phong runs"), "{ambient}");
    let (cast, ..) = said("--light direction:0.3,0.8,-0.8 --effect shadows=on,size=64");
    assert!(!cast.contains("note:"), "{cast}");
}
