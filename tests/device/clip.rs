//! Clip boxes: exactly the points that an f64 comparison of coordinates keeps are drawn, cast
//! shadows and are loaded.

use crate::cameras::{orthographic, perspective};
use crate::exr_file::read_exr;
use crate::files::scan;
use crate::gpu::{self, WAYS, Way, part};
use crate::points::{Random, bumpy};
use crate::program::{failed, pointillist, render, succeeded};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::{Cloud, Lattice};
use pointillist::config::{NO_POINT, POINTS_PER_PAGE, POSITION_PLANES};
use pointillist::graph::{Gpu, Graph};
use pointillist::passes::count_visible;
use pointillist::passes::project::{self, Precision, Statistics};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::Resident;
use pointillist::select::clip::{Clip, Clips};
use pointillist::select::opacity::Opacities;
use pointillist::synth::SceneKind;
use pointillist::view::View;
use pointillist::view::light::Light;
use std::collections::BTreeSet;

const SIDE: u32 = 600;
/// Steps of a millimetre per pixel.
const PIXEL: i32 = 40;
const LATTICE: Lattice =
    Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.25, 5_000_000.125, -3.0) };

fn clips(words: &[String]) -> Clips {
    Clips(words.iter().map(|word| word.parse::<Clip>().unwrap()).collect())
}

fn world(q: [i32; 3]) -> DVec3 {
    LATTICE.world(q.map(i64::from))
}

/// Returns a point at a random place in every pixel of a picture from above.
fn carpet(random: &mut Random) -> Cloud {
    let points: Vec<[i32; 3]> = (0..(SIDE * SIDE) as i32)
        .map(|i| {
            let [x, y] = [i % SIDE as i32, i / SIDE as i32]
                .map(|cell| cell * PIXEL + 3 + (random.bits() % 34) as i32);
            [x, y, (random.bits() % 500) as i32]
        })
        .collect();
    gpu::cloud(vec![part(LATTICE, &points, None)])
}

/// Returns boxes with faces on points, one rounding beside them, and anywhere.
fn boxes(cloud: &Cloud, random: &mut Random) -> Vec<String> {
    let columns = &cloud.parts[0].columns;
    let mut corner = |nudge: i64| {
        let i = (random.bits() % columns.len() as u64) as usize;
        let p = world([columns.x[i], columns.y[i], columns.z[i]]);
        p.to_array()
            .map(|v| f64::from_bits((v.to_bits() as i64 + nudge) as u64).to_string())
            .join(",")
    };
    ["box", "box", "outside", "outside", "box", "outside", "off"]
        .iter()
        .zip([0, 1, -1, 0, -1, 1, 0])
        .map(|(kind, nudge)| format!("{kind}:{},{}", corner(nudge), corner(-nudge)))
        .collect()
}

fn drawn(
    gpu: &mut Gpu,
    resident: &Resident,
    view: &View,
    settings: &RenderSettings,
) -> (Vec<u32>, Vec<[f32; 4]>, Statistics) {
    let look = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &look).unwrap();
    let (index, picture) = (g.download(&outcome.gbuffer.index), g.download(&outcome.picture));
    let frame = g.submit_and_wait(&[]).unwrap();

    (frame.read(&index).to_vec(), frame.read(&picture).to_vec(), outcome.statistics)
}

#[test]
fn the_points_drawn_are_those_that_an_f64_comparison_keeps() {
    let random = &mut Random(0xC11B);
    let cloud = carpet(random);
    let middle = world([SIDE as i32 * PIXEL / 2, SIDE as i32 * PIXEL / 2, 250]);
    // Pixel borders lie on the lattice, points do not.
    let camera = orthographic(middle + DVec3::Z * 10.0, middle, SIDE as f64 * PIXEL as f64 * 0.001);
    let view = View::new(pointillist::view::Camera { up: DVec3::Y, ..camera }, [SIDE; 2]).unwrap();
    let mut sides = BTreeSet::new();
    for round in 0..12 {
        let words = boxes(&cloud, random);
        let clips = clips(&words[..[1, 2, 4, 7][round % 4]]);
        for way in WAYS {
            gpu::with(way, |gpu| {
                let mut resident = Resident::fill(
                    gpu,
                    cloud.clone(),
                    DisplayAttribute::new(Attribute::White, &cloud),
                    &Silent,
                )
                .unwrap();
                assert!(resident.nodes.len() > 4);
                resident.clips = clips.clone();
                let (index, _, statistics) = drawn(gpu, &resident, &view, &gpu::bare());
                let seen: BTreeSet<u32> = index.into_iter().filter(|&id| id != NO_POINT).collect();
                let ids = resident
                    .nodes
                    .iter()
                    .flat_map(|node| (0..node.count).map(|i| node.number * POINTS_PER_PAGE + i));
                let kept: BTreeSet<u32> = ids
                    .zip(resident.positions(gpu).unwrap())
                    .filter(|(_, p)| clips.keep(*p))
                    .map(|(id, _)| id)
                    .collect();
                assert_eq!(seen, kept, "{way:?} {words:?}");
                let mut g = Graph::new(gpu);
                let points = project::draw(&mut g, &view, &resident, Precision::Auto).unwrap();
                let counted = count_visible::record(&mut g, &view, &points);
                let frame = g.submit_and_wait(&[]).unwrap();
                assert_eq!(counted.points(&frame), kept.len() as u64, "{way:?} {words:?}");
                sides.insert((
                    statistics.nodes_clipped > 0,
                    statistics.points_compared > 0,
                    kept.is_empty(),
                ));
            });
        }
    }
    assert!(sides.contains(&(true, true, false)), "{sides:?}");
}

/// Points are five pixels apart, and go on beyond the picture: what lies outside of the box is
/// gone, so that the surface ends at its faces.
#[test]
fn a_surface_ends_where_a_box_cuts_it() {
    let cloud = carpet(&mut Random(0xC117));
    let middle = world([SIDE as i32 * PIXEL / 2, SIDE as i32 * PIXEL / 2, 250]);
    let height = SIDE as f64 * PIXEL as f64 * 0.001 / 10.0;
    let camera = orthographic(middle + DVec3::Z * 10.0, middle, height);
    let side = SIDE / 2;
    let view = View::new(pointillist::view::Camera { up: DVec3::Y, ..camera }, [side; 2]).unwrap();
    let half = DVec3::new(height / 4.0, height / 4.0, 10.0);
    let [min, max] = [middle - half, middle + half].map(|p| format!("{},{},{}", p.x, p.y, p.z));
    gpu::with(Way::Compute64, |gpu| {
        let shown = DisplayAttribute::new(Attribute::White, &cloud);
        let mut resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
        let settings = RenderSettings::default();
        let whole = FrameConfig::new(&settings, &view, &resident);
        assert_eq!(whole.sampling.crossed, [true; 4]);
        resident.clips = clips(&[format!("box:{min},{max}")]);
        let cut = FrameConfig::new(&settings, &view, &resident);
        assert_eq!(cut.sampling.crossed, [false; 4]);
        let share = cut.sampling.spacing_m / whole.sampling.spacing_m;
        assert!((0.9..1.1).contains(&share), "{share}");
        let (_, picture, _) = drawn(gpu, &resident, &view, &settings);
        let is_drawn = |x: u32, y: u32| picture[(y * side + x) as usize][..3] != cut.background;
        let [mut inside, mut outside] = [0; 2];
        for (x, y) in (0..side * side).map(|i| (i % side, i / side)) {
            let from = x.min(y).min(side - 1 - x).min(side - 1 - y);
            // Contours may lie two spacings beside the faces.
            outside += u32::from(from + 10 < side / 4 && is_drawn(x, y));
            inside += u32::from(from > side / 4 && !is_drawn(x, y));
        }
        assert_eq!(outside, 0, "pixels are drawn outside of the box");
        assert!(inside < side * side / 400, "{inside} holes");
    });
}

/// Compares clipping with drawing the same nodes with another, hidden class for the clipped points.
#[test]
fn what_is_clipped_shows_nowhere_casts_no_shadow_and_has_no_part_in_luminance_and_strokes() {
    let random = &mut Random(0x5AD0);
    let (points, colors) = bumpy(150_000, 20_000, random);
    let words = [
        "box:500000.25,4999999,-100,500030,5000030,100",
        "outside:500004,5000003,-100,500009,5000008,100",
        "outside:499990,4999990,-6,500030,5000030,-4",
    ];
    let clips = clips(&words.map(String::from));
    let mut cloud = gpu::cloud(vec![part(LATTICE, &points, Some(colors))]);
    cloud.parts[0].columns.class =
        Some(points.iter().map(|&q| if clips.keep(world(q)) { 1 } else { 2 }).collect());
    let camera = perspective(world([0, -25_000, 20_000]), world([0; 3]), 60.0);
    let view = View::new(camera, [200, 160]).unwrap();
    let hidden = Opacities(vec!["class:2=0".parse().unwrap()]);
    let looks = [
        (
            Way::Compute64,
            vec!["edl=on", "shadows=on,samples=3,radius=2", "luminance=on,epsilon=0.1"],
        ),
        (
            Way::Compute32,
            vec!["edl=on", "shadows=on,method=index,peels=8", "luminance=on,epsilon=0.1"],
        ),
        (Way::Compute64, vec!["strokes=on"]),
        (Way::Compute64, vec!["visibility=on", "fill=on", "shape=on"]),
    ];
    for (way, effects) in looks {
        gpu::with(way, |gpu| {
            let mut shown = DisplayAttribute::new(Attribute::Rgb, &cloud);
            (shown.further.kind, shown.further.strokes) = (true, effects[0].starts_with("strokes"));
            let mut resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
            // Boxes are compared at full precision.
            let light = Light::Direction(DVec3::new(0.3, 0.5, -0.8));
            let settings = RenderSettings {
                effects: gpu::effects(&effects),
                light,
                precision: Precision::Planes(POSITION_PLANES),
                ..RenderSettings::default()
            };
            resident.clips = clips.clone();
            let clipped = drawn(gpu, &resident, &view, &settings);
            (resident.clips, resident.opacities) = (Clips::default(), hidden.clone());
            let classed = drawn(gpu, &resident, &view, &settings);
            resident.opacities = Opacities::default();
            let whole = drawn(gpu, &resident, &view, &settings);
            assert!(clipped.0 == classed.0 && clipped.1 == classed.1, "{effects:?}");
            assert!(whole.0 != clipped.0 && clipped.2.points_compared > 0, "{effects:?}");
        });
    }
}

#[test]
fn of_an_index_nothing_is_read_that_boxes_leave_out_and_explain_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    scan(&at("street.las"), SceneKind::Street, 300_000);
    succeeded(
        &pointillist()
            .arg("index")
            .arg(at("street.las"))
            .arg("-o")
            .arg(at("street.pnti"))
            .output()
            .unwrap(),
    );
    let camera = r#"{"eye": [500005, 5000005, 200], "target": [500005, 5000005, 0], "projection": "orthographic", "ortho_height": 150}"#;
    std::fs::write(at("cam.json"), camera).unwrap();
    let drawn = |file: &str, line: &str| {
        let exr = at("a.exr");
        let line = format!(
            "--camera {} --size 400x300 --style points --exr {} --explain=json {line}",
            at("cam.json").display(),
            exr.display()
        );
        let output = render(&at(file), &line);
        succeeded(&output);
        let explained: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let layers = read_exr(&exr);
        assert_eq!(layers.size, [400, 300]);
        (explained, layers.floats("raw.Z"))
    };
    let clip = "--clip box:500000,5000000,90,500010,5000010,200";
    let fine = "--lod 0 --point-budget 1000000";
    let (all, _) = drawn("street.pnti", fine);
    let (some, depth) = drawn("street.pnti", &format!("{fine} {clip}"));
    let number =
        |explained: &serde_json::Value, name: &str| explained["index"][name].as_u64().unwrap();
    assert!(number(&some, "bytes_read") < number(&all, "bytes_read"), "{some}");
    assert!(number(&some, "nodes_clipped") > 0 && number(&all, "nodes_clipped") == 0);
    let (_, of_file) = drawn("street.las", clip);
    let covered = depth.iter().filter(|z| z.is_finite()).count();
    // Nodes have other origins, so f32 arithmetic may round a point into the neighbouring pixel.
    let differ = depth.iter().zip(&of_file).filter(|(a, b)| a.is_finite() != b.is_finite()).count();
    assert!(covered > 200 && differ <= covered / 200, "{differ} of {covered}");
    let line = format!(
        "--size 64x64 -o {} --explain {clip} --clip outside:0,0,0,inf,inf,1",
        at("a.png").display()
    );
    let said = succeeded(&render(&at("street.las"), &line));
    assert!(said.contains("clip: 2 boxes; of "), "{said}");
    failed(&render(&at("street.las"), "-o a.png --clip box:1,2,3"), 2);
}
