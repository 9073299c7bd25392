//! Fifteen jobs of a surveyor, as typed, with programs of others as witnesses where these can tell.
//! What the jobs rest on is tested in detail by the modules beside this one.

use crate::files::names;
use crate::png_file::{Png, read_png};
use crate::program::{failed, pointillist, succeeded, text};
use crate::shared::shared;
use crate::skip::skip;
use crate::witness::{self, ffprobe, gdal, gdalinfo, laspy};
use pointillist::cloud::attribute::Attribute;
use pointillist::cloud::{self, ReadOptions};
use pointillist::progress::Silent;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder, and a scan of `../shared`.
struct Desk {
    folder: tempfile::TempDir,
    scan: PathBuf,
}

/// Two strips of an airborne scan in Lambert-93, classified.
const STRIPS: &str = "data/aerial/ign_2strips.laz";

impl Desk {
    fn with(scan: &str) -> Option<Desk> {
        Some(Desk { folder: tempfile::tempdir().unwrap(), scan: shared(scan)? })
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a line, in which SCAN stands for the scan and @ for the folder.
    fn run(&self, line: &str) -> Output {
        let place = format!("{}/", self.folder.path().display());
        let words = line.split_whitespace().map(|word| match word {
            "SCAN" => self.scan.display().to_string(),
            word => word.replace('@', &place),
        });
        pointillist().args(words).output().expect("start the program")
    }

    /// Runs a line that succeeds. Returns what it says.
    #[track_caller]
    fn types(&self, line: &str) -> String {
        let output = self.run(line);
        succeeded(&output) + &text(&output.stdout)
    }

    /// Draws a picture with these options.
    #[track_caller]
    fn draws(&self, options: &str) -> Png {
        self.types(&format!("render SCAN -o @drawn.png --size 320x240 {options}"));
        read_png(&self.at("drawn.png"))
    }
}

/// Returns the pixels that are not the background.
fn drawn(png: &Png, background: [u8; 3]) -> Vec<[u8; 3]> {
    png.pixels.iter().copied().filter(|pixel| *pixel != background).collect()
}

#[test]
fn job_01_points_of_a_sparse_scan_are_seen() {
    let Some(desk) = Desk::with("data/ground/pine_plot.laz") else { return };
    let pixels = |options: &str| {
        desk.types(&format!(
            "render SCAN -o @drawn.png --size 1600x1000 --background ff00ff {options}"
        ));
        drawn(&read_png(&desk.at("drawn.png")), [255, 0, 255]).len()
    };
    let single = pixels("--style points --effect visibility=off");
    let [auto, thick] = ["--point-size auto", "--style splats --point-size 5"].map(pixels);
    assert!(auto > single && thick > 2 * single, "{single} {auto} {thick}");
    // As many cells of 20 cm have points as laspy finds; splats cover more of them.
    let cells = "import laspy, numpy as n, sys; p = laspy.read(sys.argv[1]);
print(len({(int(n.floor(x / .2)), int(n.floor(y / .2))) for x, y in zip(p.x, p.y)}))";
    let Some(found) = laspy(cells, &[&desk.scan]) else { return };
    let found: usize = found.parse().unwrap();
    let map = |options: &str| {
        desk.types(&format!(
            "render SCAN -o @map.png --no-cache --view top --resolution 0.2 --background ff00ff {options}"
        ));
        drawn(&read_png(&desk.at("map.png")), [255, 0, 255]).len()
    };
    let points = map("--style points --effect visibility=off --effect edl=off");
    assert!(points.abs_diff(found) * 1000 <= found, "{points} {found}");
    assert!(map("--style splats") > found);
}

#[test]
fn job_02_an_object_stands_upright() {
    let Some(desk) = Desk::with("data/e57/bunnyFloat.e57") else { return };
    let said = desk.types("render SCAN -o @auto.png --size 200x200");
    assert!(said.contains("y is taken as up"), "{said}");
    desk.types("render SCAN -o @y.png --size 200x200 --up y");
    assert!(fs::read(desk.at("auto.png")).unwrap() == fs::read(desk.at("y.png")).unwrap());
    // A survey without a coordinate system does not lie down.
    let Some(survey) = Desk::with("data/ground/MLS_Clip.laz") else { return };
    let said = survey.types("render SCAN -o @plot.png --size 200x200");
    assert!(!said.contains("taken as up"), "{said}");
    // From the front it is as high, for its breadth, as laspy finds it along y.
    desk.types("export SCAN -o @bunny.las");
    let breadths = "import laspy, sys; p = laspy.read(sys.argv[1]);
print(*((max(a) - min(a)) for a in (p.x, p.y)))";
    let Some(found) = laspy(breadths, &[&desk.at("bunny.las")]) else { return };
    let found: Vec<f64> = found.split(' ').map(|word| word.parse().unwrap()).collect();
    desk.types("render SCAN -o @front.png --size 400x400 --view front --background ff00ff");
    let png = read_png(&desk.at("front.png"));
    let covered = (0..).zip(&png.pixels).filter(|(_, pixel)| **pixel != [255, 0, 255]);
    let (xs, ys): (Vec<u32>, Vec<u32>) = covered.map(|(i, _)| (i % 400, i / 400)).unzip();
    let extent = |at: &[u32]| (at.iter().max().unwrap() - at.iter().min().unwrap()) as f64;
    let [drawn, found] = [extent(&ys) / extent(&xs), found[1] / found[0]];
    assert!((drawn / found - 1.0).abs() < 0.05, "{drawn} {found}");
}

#[test]
fn job_03_a_dark_scan_is_bright_enough() {
    let file = "data/e57/pumpARowColumnIndexNoInvalidPoints.e57";
    let Some(desk) = Desk::with(file) else { return };
    let mean = |options: &str| {
        let options = format!("{options} --background 000000 --style points --effect edl=off");
        let pixels = drawn(&desk.draws(&options), [0; 3]);
        let sum: f64 = pixels.iter().flatten().map(|&channel| channel as f64).sum();
        (sum / 3.0 / pixels.len() as f64, witness::mean(&desk.at("drawn.png")))
    };
    let ((before, seen_before), (after, seen_after)) = (mean("--range 0,255"), mean(""));
    assert!(after > 1.5 * before && after > 50.0, "{before} {after}");
    // GDAL counts the black background, too.
    let Some((seen_before, seen_after)) = seen_before.zip(seen_after) else { return };
    assert!(seen_after > 1.5 * seen_before, "{seen_before} {seen_after}");
}

#[test]
fn job_04_a_picture_has_what_a_report_needs() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    // A first view lies beside annotations, so that the same one is given to all.
    let camera = r#"{"eye": [770525, 6277525, 200], "target": [770525, 6277525, 30], "up": [0, 1, 0],
        "projection": "orthographic", "ortho_height": 60}"#;
    fs::write(desk.at("above.json"), camera).unwrap();
    let plain = desk.draws("--camera @above.json --color elevation");
    for option in ["--legend", "--scale-bar", "--north-arrow", "--axes", "--title Plot"] {
        let with = desk.draws(&format!("--camera @above.json --color elevation {option}"));
        let pixels = plain.pixels.iter().zip(&with.pixels).filter(|(a, b)| a != b).count();
        assert!((100..20_000).contains(&pixels), "{option}: {pixels}");
    }
    // Words and numbers are legible to a program that reads print.
    desk.types(
        "render SCAN -o @report.png --size 1280x800 --color elevation --title Gutenberg \
            --legend --scale-bar --north-arrow --axes",
    );
    let Some(words) = witness::words(&desk.at("report.png")) else { return };
    for word in ["Gutenberg", "elevation", "[m]", "25", "30", "35", "40", "10", "middle,"] {
        assert!(words.iter().any(|own| own == word), "{word} of {words:?}");
    }
}

/// Checks that GDAL finds this corner, size and resolution, in Lambert-93.
#[track_caller]
fn check_map(path: &Path, [west, north]: [f64; 2], size: [u64; 2], resolution: f64) {
    let Some(info) = gdalinfo(path) else { return };
    assert_eq!(info["size"], serde_json::json!(size));
    let place = [west, resolution, 0.0, north, 0.0, -resolution];
    assert_eq!(info["geoTransform"], serde_json::json!(place));
    let system = info["coordinateSystem"]["wkt"].as_str().unwrap();
    assert!(system.contains("ID[\"EPSG\",2154]"), "{system}");
}

#[test]
fn job_05_a_picture_is_a_map() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    desk.types("render SCAN --no-cache --view top --resolution 0.25 --extent 770500,6277500,770550,6277550 -o @map.tif");
    check_map(&desk.at("map.tif"), [770_500.0, 6_277_550.0], [200, 200], 0.25);
    desk.types("render SCAN --no-cache --view top --resolution 0.5 -o @map.png");
    let world = fs::read_to_string(desk.at("map.pgw")).unwrap();
    let lines: Vec<f64> = world.lines().map(|line| line.parse().unwrap()).collect();
    assert_eq!(lines[..4], [0.5, 0.0, 0.0, -0.5]);
    assert_eq!(names(desk.folder.path()), ["map.pgw", "map.png", "map.tif"]);
}

#[test]
fn job_06_ground_becomes_a_raster() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    let extent = "--extent 770500,6277500,770550,6277550";
    desk.types(&format!(
        "raster SCAN -o @ground.tif --resolution 1 --only ground --pick mean {extent}"
    ));
    // The same as a picture's option.
    desk.types("raster SCAN -o @first.tif --resolution 1 --only return=last --no-data -1");
    desk.types(
        "render SCAN -o @second.tif --raster height --resolution 1 --only return=last --no-data -1",
    );
    assert!(fs::read(desk.at("first.tif")).unwrap() == fs::read(desk.at("second.tif")).unwrap());
    // What is transparent is not there.
    desk.types("raster SCAN -o @first.tif --resolution 1 --not class=6");
    desk.types("render SCAN -o @second.tif --raster height --resolution 1 --opacity class:6=0");
    assert!(fs::read(desk.at("first.tif")).unwrap() == fs::read(desk.at("second.tif")).unwrap());
    let (map, table) = (desk.at("ground.tif"), desk.at("ground.xyz"));
    check_map(&map, [770_500.0, 6_277_550.0], [50, 50], 1.0);
    if gdal("gdal_translate", "-q -of XYZ", &[&map, &table]).is_none() {
        return;
    }
    let script = "
import sys, laspy, numpy as np
a = laspy.read(sys.argv[1])
g = np.asarray(a.classification) == 2
x, y, z = (np.asarray(v)[g] for v in (a.x, a.y, a.z))
inside = (x < 770550) & (y < 6277550)
key = np.floor(x[inside]) * 1e8 + np.floor(y[inside])
cells, where = np.unique(key, return_inverse=True)
mean = np.bincount(where, z[inside]) / np.bincount(where)
t = np.loadtxt(sys.argv[2])
t = t[t[:, 2] != -9999]
order = np.argsort(np.floor(t[:, 0]) * 1e8 + np.floor(t[:, 1]))
assert np.array_equal(np.floor(t[order, 0]) * 1e8 + np.floor(t[order, 1]), cells)
assert np.abs(t[order, 2] - mean).max() < 1e-4, np.abs(t[order, 2] - mean).max()
print(len(cells))
";
    let Some(cells) = laspy(script, &[&desk.scan, &table]) else { return };
    assert!(cells.parse::<u32>().unwrap() > 500, "{cells}");
}

/// Returns how many points of the scan match a condition of Python with laspy.
fn counted(desk: &Desk, condition: &str) -> Option<u64> {
    let script = format!(
        "
import sys, laspy, numpy as np
a = laspy.read(sys.argv[1])
x, y, z, c = (np.asarray(v) for v in (a.x, a.y, a.z, a.classification))
print(np.count_nonzero({condition}))
"
    );
    laspy(&script, &[&desk.scan]).map(|count| count.parse().unwrap())
}

#[test]
fn job_07_buildings_become_a_file() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    desk.types("export SCAN -o @roofs.laz --only building");
    let script = "
import sys, laspy, numpy as np
a, b = laspy.read(sys.argv[1]), laspy.read(sys.argv[2])
assert np.array_equal(a.points[np.asarray(a.classification) == 6].array, b.points.array)
print(len(b.points))
";
    let Some(points) = laspy(script, &[&desk.scan, &desk.at("roofs.laz")]) else { return };
    assert_eq!(points, "29447");
}

#[test]
fn job_08_a_scan_is_thinned() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    desk.types("export SCAN -o @thin.laz --thin 1");
    let script = "
import sys, laspy, numpy as np
cells = [np.floor(np.stack([np.asarray(v) for v in (a.x, a.y, a.z)], 1)).astype(np.int64)
         for a in map(laspy.read, sys.argv[1:])]
one = [np.unique(c, axis=0) for c in cells]
assert np.array_equal(*one) and len(one[1]) == len(cells[1])
print(len(cells[1]))
";
    let Some(points) = laspy(script, &[&desk.scan, &desk.at("thin.laz")]) else { return };
    assert!((1000..50_000).contains(&points.parse::<u32>().unwrap()), "{points}");
}

#[test]
fn job_09_only_ground_is_drawn() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    let said = desk.types("render SCAN -o @ground.png --size 160x120 --only ground");
    assert!(said.contains("leaves 21,172 of 84,524 points"), "{said}");
    let Some(count) = counted(&desk, "c == 2") else { return };
    assert_eq!(count, 21_172);
}

#[test]
fn job_10_points_in_a_box_are_counted() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    let said = desk.types(
        "info SCAN --count --json --only vegetation --clip box:770510,6277510,-inf,770520,6277530,30",
    );
    let report: serde_json::Value =
        serde_json::from_str(said.get(said.find('{').unwrap()..).unwrap()).unwrap();
    let condition = "(c >= 3) & (c <= 5) & (x >= 770510) & (x <= 770520) & (y >= 6277510) & (y <= 6277530) & (z <= 30)";
    let Some(count) = counted(&desk, condition) else { return };
    assert!(count > 50 && report["points"] == count, "{count} {report}");
}

#[test]
fn points_that_are_drawn_narrower_than_asked_for_are_said() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    let line = "render SCAN -o @drawn.png --size 640x480 --point-size 10m";
    let said = desk.types(&format!("{line} --effect splat=on,largest=64 --explain"));
    let words = "points are drawn at most 64 px wide, where they would be up to ";
    assert_eq!(said.matches(words).count(), 2, "{said}");
    assert!(said.contains("--effect splat=on,largest="), "{said}");
    let narrow = read_png(&desk.at("drawn.png"));
    let said = desk.types(line);
    assert!(!said.contains("at most"), "{said}");
    assert_ne!(narrow.pixels, read_png(&desk.at("drawn.png")).pixels);
    let said = desk.types(&line.replace("10m", "10km"));
    assert!(said.contains("at most 256 px wide") && said.contains("largest=1024"), "{said}");
    let most = line.replace("10m", "10km --effect splat=on,largest=1024");
    let said = desk.types(&most);
    assert!(said.contains("a smaller --point-size") && !said.contains("largest="), "{said}");
    // Centimetres are a unit.
    let same = ["0.5m", "50cm"].map(|size| desk.draws(&format!("--point-size {size}")).pixels);
    assert_eq!(same[0], same[1]);
}

#[test]
fn job_11_a_profile_has_the_points_of_its_slab() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    let said = desk.types(
        "profile SCAN --from 770505,6277510 --to 770545,6277540 --width 1 -o @p.svg -o @p.csv",
    );
    let table = fs::read_to_string(desk.at("p.csv")).unwrap();
    assert!(table.lines().next().unwrap().ends_with("unit,\"intensity\",\"time\""), "{table}");
    let rows = table.lines().count() as u64 - 1;
    assert!(said.contains(&format!("{rows} points, 50.000 m long")), "{said}");
    let svg = fs::read_to_string(desk.at("p.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("distance [m]") && svg.contains("1 : 1"));
    assert!(!svg.contains("elevation [m]"));
    for (color, words) in
        [("elevation", &["elevation [m]"][..]), ("class", &["ground", "building"])]
    {
        desk.types(&format!("profile SCAN --from 770505,6277510 --to 770545,6277540 --width 1 --color {color} --legend -o @legend.svg"));
        let svg = fs::read_to_string(desk.at("legend.svg")).unwrap();
        assert!(words.iter().all(|word| svg.contains(&format!(">{word}</text>"))), "{color}");
        // The legend has room within the largest size.
        let width = svg.split_once("width=\"").unwrap().1.split_once('"').unwrap().0;
        assert!(width.parse::<f64>().unwrap() <= 1600.5, "{width}");
    }
    // In a small picture the legend is left out, and words are shortened.
    let line = "profile SCAN --from 770505,6277510 --to 770545,6277540 --width 1 --color elevation --legend -o @small.svg";
    let said = desk.types(&format!("{line} --size 300x200"));
    assert!(said.contains("--size 300x200 has no room for the legend"), "{said}");
    let svg = fs::read_to_string(desk.at("small.svg")).unwrap();
    let title = format!(">{rows} points, 50.000 m</text>");
    assert!(svg.contains(&title) && svg.contains(">distance [m]</text>"), "{svg}");
    assert!(!svg.contains("elevation [m]"), "{svg}");
    let side = |name: &str| -> f64 {
        let (_, rest) = svg.split_once(&format!("{name}=\"")).unwrap();
        rest.split_once('"').unwrap().0.parse().unwrap()
    };
    assert!(side("width") <= 300.0 && side("height") <= 200.0);
    // 40 and 30 m of the way, over its 50 m.
    let condition = "(np.abs((x - 770505) * -0.6 + (y - 6277510) * 0.8) <= 0.5) & (np.abs((x - 770505) * 0.8 + (y - 6277510) * 0.6 - 25) <= 25)";
    let Some(count) = counted(&desk, condition) else { return };
    // On the edge, the last digit decides.
    assert!(rows > 1000 && count.abs_diff(rows) <= 2, "{count} {rows}");
}

fn has_encoder() -> bool {
    let has_it = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !has_it {
        skip("there is no ffmpeg");
    }
    has_it
}

#[test]
fn job_12_a_turntable_becomes_a_film() {
    let Some(desk) = Desk::with("data/e57/bunnyInt19.e57") else { return };
    if !has_encoder() {
        return;
    }
    for name in ["turn.mp4", "turn.webm"] {
        desk.types(&format!("render SCAN -o @{name} --turntable 6 --fps 12 --size 160x120"));
        let Some(seen) = ffprobe(&desk.at(name)) else { return };
        assert_eq!(seen, "160,120,12/1,6", "{name}");
    }
}

#[test]
fn job_13_a_camera_path_becomes_a_film() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    if !has_encoder() {
        return;
    }
    let key = |time: f64, x: f64| {
        format!(
            r#"{{"time": {time}, "camera": {{"eye": [{x}, 6277440, 70], "target": [770525, 6277525, 25], "up": [0, 0, 1], "fov_y": 40}}}}"#
        )
    };
    let path = format!(
        r#"{{"frames_per_second": 5, "keys": [{}, {}]}}"#,
        key(0.0, 770_500.0),
        key(1.0, 770_560.0)
    );
    fs::write(desk.at("tour.json"), path).unwrap();
    desk.types("render SCAN -o @tour.webm --path @tour.json --size 160x120");
    let Some(seen) = ffprobe(&desk.at("tour.webm")) else { return };
    assert_eq!(seen, "160,120,5/1,6");
}

#[test]
fn job_14_points_show_any_number_that_they_have() {
    for (scan, color, dimension) in [
        (STRIPS, "scan-angle", "a.scan_angle_rank"),
        ("data/aerial/ign_rgb16_nir_697k.laz", "nir", "a.nir"),
        ("data/aerial/ign_rgb16_nir_697k.laz", "scan-angle", "a.scan_angle * 0.006"),
        ("data/aerial/ign_rgb16_nir_697k.laz", "extra:Deviation", "a.Deviation"),
        ("data/formats/las1.4_pf3_extrabytes.las", "extra:Time", "a['Time']"),
        ("data/formats/las1.4_pf3_extrabytes.las", "extra:Intensity", "a['Intensity']"),
    ] {
        let Some(desk) = Desk::with(scan) else { continue };
        let listed = desk.types("info SCAN");
        assert!(listed.contains(&format!(", {color}")), "{color}: {listed}");
        let attribute = color.parse::<Attribute>().unwrap();
        let wanted = attribute.wanted();
        let read = ReadOptions::new(wanted, false);
        let read = cloud::read(std::slice::from_ref(&desk.scan), &read, &Silent).unwrap();
        let numbers = attribute.numbers_of(&read.parts[0].columns).unwrap();
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        fs::write(desk.at("numbers"), bytes).unwrap();
        let script = format!(
            "
import sys, laspy, numpy as np
a = laspy.read(sys.argv[1])
theirs, ours = np.asarray({dimension}).astype(np.float64), np.fromfile(sys.argv[2])
assert np.abs(theirs - ours).max() <= 1e-9 * np.abs(theirs).max(), (theirs, ours)
print(len(ours))
"
        );
        let Some(points) = laspy(&script, &[&desk.scan, &desk.at("numbers")]) else { return };
        assert_eq!(points, read.len().to_string());
    }
    let Some(desk) = Desk::with(STRIPS) else { return };
    // Heights of classes above their ground, by colours: red is ground, and trees are green.
    let plain = "--style points --effect edl=off --view top --background 000000";
    let height = |only: &str| {
        let options =
            format!("{plain} --color height-above-ground --ramp grey --range 0,20 {only}");
        let pixels = drawn(&desk.draws(&options), [0; 3]);
        pixels.iter().map(|pixel| pixel[0] as f64).sum::<f64>() / pixels.len() as f64
    };
    let [ground, roofs] = ["--only ground", "--only building"].map(height);
    assert!(roofs > 1.5 * ground, "{ground} {roofs}");
    let colors = drawn(&desk.draws(&format!("{plain} --color time")), [0; 3]);
    let spread = |channel: usize| {
        let values = colors.iter().map(|color| color[channel]);
        values.clone().max().unwrap() - values.min().unwrap()
    };
    assert!(spread(0) > 100);
    // An index keeps one of them.
    let differ = |a: &Png, b: &Png| {
        let far = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > 24);
        a.pixels.iter().zip(&b.pixels).filter(far).count()
    };
    desk.types("index SCAN -o @strips.pnti --keep scan-angle");
    assert!(desk.types("info @strips.pnti").contains("white, scan-angle"));
    let view =
        r#"{"eye": [770525, 6277525, 120], "target": [770525, 6277525, 25], "up": [0, 1, 0]}"#;
    fs::write(desk.at("cam.json"), view).unwrap();
    let line = format!("{plain} --color scan-angle").replace("--view top", "--camera @cam.json");
    let of_file = desk.draws(&line);
    desk.types(&format!("render @strips.pnti --lod 0 -o @drawn.png --size 320x240 {line}"));
    let of_index = read_png(&desk.at("drawn.png"));
    assert!(differ(&of_file, &of_index) < 50, "{}", differ(&of_file, &of_index));
    // What stands above the ground, of files and of an index, with its height.
    let high = "--where height-above-ground=2..";
    let count = |input: &str| {
        let said = desk.types(&format!("info {input} --count {high}"));
        let (points, _) = said.split_once(" of ").expect("a count");
        points.lines().last().unwrap().replace(',', "")
    };
    let points = count("SCAN");
    assert_eq!(count("@strips.pnti"), points);
    let pictures = ["SCAN", "@strips.pnti --lod 0"].map(|input| {
        let line = line.replace("scan-angle", "height-above-ground --range 0,20");
        desk.types(&format!("render {input} -o @drawn.png --size 320x240 {line}"));
        read_png(&desk.at("drawn.png"))
    });
    assert!(differ(&pictures[0], &pictures[1]) < 50, "{}", differ(&pictures[0], &pictures[1]));
    desk.types(&format!("export SCAN -o @high.laz {high} --add height-above-ground"));
    let script = "import sys, laspy
a = laspy.read(sys.argv[1])
h = a['height_above_ground']
assert h.min() >= 2 and h.max() < 100 and len(set(a.scan_angle_rank)) > 5
print(len(h))";
    if let Some(found) = laspy(script, &[&desk.at("high.laz")]) {
        assert_eq!(found, points);
    }
    let said = failed(&desk.run("render @strips.pnti -o @no.png --color time"), 1);
    assert!(said.contains("strips.pnti --keep time` finds them"), "{said}");
    let said = failed(&desk.run("info @strips.pnti --count --where gps-time=1..2"), 1);
    assert!(said.contains("--gps-time` keeps it"), "{said}");
    let said = failed(&desk.run("render SCAN -o @no.png --color extra:nothing"), 1);
    assert!(said.contains("do not have it; they have scan-angle, height-above-ground"), "{said}");
}

#[test]
fn job_15_a_mistake_is_answered_by_what_to_do() {
    let Some(desk) = Desk::with(STRIPS) else { return };
    let without_driver = |value: &str| {
        let mut command = pointillist();
        command.arg("render").arg(&desk.scan).arg("-o").arg(desk.at("no.png"));
        command.env("VK_DRIVER_FILES", value).env("VK_ICD_FILENAMES", value);
        failed(&command.output().unwrap(), 1)
    };
    let said = without_driver("/nowhere/icd.json");
    assert!(said.contains("no Vulkan device") && said.contains("lavapipe") | said.contains("CPU"));
    assert!(said.contains("/nowhere/icd.json, which does not exist"), "{said}");
    without_driver(desk.folder.path().to_str().unwrap());
    if let Some(found) = witness::has_vulkan_device("/nowhere/icd.json") {
        assert!(!found, "vulkaninfo finds a device");
    }
    let mut command = pointillist();
    command.arg("view").arg(&desk.scan).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let said = failed(&command.env_remove("WAYLAND_SOCKET").output().unwrap(), 1);
    assert!(said.contains("no display") && !said.contains(".rs"), "{said}");
    let mut command = pointillist();
    command.arg("view").arg(&desk.scan).env_remove("WAYLAND_DISPLAY").env("DISPLAY", ":987");
    let said = failed(&command.env_remove("WAYLAND_SOCKET").output().unwrap(), 1);
    assert!(said.contains("cannot open a window") && !said.contains(".rs"), "{said}");
    for (option, suggested) in [
        ("--pol", Some("--gpu-memory")),
        ("--buget", Some("--point-budget")),
        ("--colour", Some("--color")),
        ("--were", Some("--where")),
        ("--unmaped", None),
        ("--threads", None),
    ] {
        let said = failed(&desk.run(&format!("render SCAN -o @no.png {option} 1")), 2);
        let tip = said.lines().find(|line| line.contains("similar argument"));
        let shown = suggested.map(|name| format!("  tip: a similar argument exists: '{name}'"));
        assert_eq!(tip, shown.as_deref(), "{said}");
    }
    for (options, meant) in [
        ("--only grund", "did you mean \"ground\"?"),
        ("--not class=hihg-vegetation", "did you mean \"high-vegetation\"?"),
        ("--where intensty=3..5", "did you mean \"intensity\"?"),
        ("--where return=lsat", "did you mean \"last\"?"),
        ("--effect edll=on", "did you mean \"edl\"?"),
        ("--effect edl=strenth=2", "did you mean \"strength\"?"),
        ("--raster hieght --view top", "did you mean \"height\"?"),
        ("--exposre on", "tip: `--effect exposure=on` switches an effect on"),
    ] {
        let said = failed(&desk.run(&format!("render SCAN -o @no.png {options}")), 2);
        assert!(said.contains(meant), "{said}");
    }
    let said = failed(&desk.run("view SCAN --raster height"), 2);
    assert!(said.contains("tip: `pointillist raster` is a command"), "{said}");
    let said = failed(&desk.run("view --lose-devic 3"), 2);
    assert!(!said.contains("similar argument"), "{said}");
    let said = failed(&desk.run("render SCAN -o @no.png --color intensty"), 2);
    let meant = "did you mean \"intensity\"?); there are rgb, intensity, elevation";
    assert!(said.contains(meant), "{said}");
    let said = failed(&desk.run("export SCAN -o @no.laz --clip box:0,0,0,1,1,1"), 1);
    assert!(said.contains("lie in 770500 6277500 20.25 to 770550 6277550 43.49"), "{said}");
    let said = desk.types("info SCAN --count --clip box:0,0,0,1,1,1");
    assert!(said.contains("lie in 770500 6277500 20.25 to 770550 6277550 43.49"), "{said}");
    let said = failed(&desk.run("render SCAN -o @no.png --point-size 0.05"), 2);
    assert!(said.contains("0.05m is a length"), "{said}");
    for (line, why) in [
        ("render SCAN -o @no.png --point-size 2000", "more than 1024; 2000m is a length"),
        ("render SCAN -o @no.png --point-size -3m", "units are mm, cm, km, m, ftUS, ft"),
        ("render SCAN -o @no.png --layer 3meter", "units are mm, cm, km, m, ftUS, ft"),
        ("render SCAN -o @no.png --contrast abc", "is not a number, such as 1.5"),
        ("profile SCAN --from 0,0 --to 1,1 -o @no.svg --width -1", "is not a length above 0"),
    ] {
        let said = failed(&desk.run(line), 2);
        assert!(said.contains(why), "{said}");
    }
    let said = failed(&desk.run("export SCAN -o @no.txt"), 1);
    assert!(said.contains("must end in .copc.laz, .laz, .las, .ply or .csv"), "{said}");
    let said = failed(&desk.run("render SCAN -o @no.mp4"), 1);
    assert!(said.contains("is a film, of many frames; give --turntable 120, or --path"), "{said}");
    for (options, code, why) in [
        ("--raster height --resolution 1 --legend", 2, "cannot be used with"),
        ("--raster height --resolution 1 --view front", 1, "--raster is a map"),
    ] {
        let said = failed(&desk.run(&format!("render SCAN -o @no.tif {options}")), code);
        assert!(said.contains(why), "{said}");
    }
    let said = desk.types("render SCAN -o @classes.png --size 32x32 --color class --gamma 2");
    assert!(said.contains("class has labels, whose colours"), "{said}");
    if let Some(feet) = Desk::with("data/aerial/autzen_trim.laz") {
        let said = feet.types("export SCAN -o @thin.laz --thin 20");
        assert!(said.contains("--thin is in the files' unit: 20 ft, which are 6.0960 m"), "{said}");
        let said = feet.types("export SCAN -o @thin.laz --thin 6.096m");
        assert!(!said.contains("files' unit"), "{said}");
    }
    if let Some(other) = shared("data/aerial/bcts_1.laz") {
        let line = format!("render SCAN {} -o @far.png --size 32x32", other.display());
        let said = desk.types(&line);
        assert!(said.contains("EPSG:2154, EPSG:3005"), "{said}");
    }
    let said = desk.run("render SCAN -o @no.png --size 32x32 --clip box:0,0,0,1,1,1");
    let said = failed(&said, 1);
    assert!(said.contains("lie in 770500 6277500 20.25 to 770550 6277550 43.49"), "{said}");
}
