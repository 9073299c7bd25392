//! Simulated scans: hits lie on the surfaces, points on the hits, counts and bytes are exact.
//! Checked without a GPU against closed forms, or a ray cast back along the normal.

use clap::Parser;
use glam::DVec3;
use pointillist::cli::synth::{Arguments, camera, run, truth};
use pointillist::error::{Error, Result};
use pointillist::progress::{Progress, Silent};
use pointillist::synth::{self, Chunk, SceneKind, World};
use pointillist::view::View;
use proptest::prelude::*;
use std::path::Path;

const SCENES: [SceneKind; 7] = [
    SceneKind::Plane,
    SceneKind::Sphere,
    SceneKind::Torus,
    SceneKind::NestedTori,
    SceneKind::Step,
    SceneKind::Street,
    SceneKind::Terrain,
];

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    arguments: Arguments,
}

fn arguments(line: &str) -> Arguments {
    Line::parse_from(std::iter::once("synth").chain(line.split_whitespace())).arguments
}

fn synth_file(path: &Path, line: &str, threads: usize) -> Vec<u8> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| run(&arguments(&format!("{line} -o {}", path.display())), &Silent)).unwrap();
    std::fs::read(path).unwrap()
}

/// Returns all points of a scan, with this noise.
fn scan(world: &World, points: u64, noise: f64) -> Vec<Chunk> {
    let mut chunks = Vec::new();
    let mut keep = |chunk: &Chunk| -> Result<()> {
        chunks.push(chunk.clone());
        Ok(())
    };
    synth::scan(world, points, 7, noise, &mut keep, &Silent).unwrap();
    chunks
}

/// Returns chunk, index, and position relative to the offset.
fn positions(chunks: &[Chunk]) -> impl Iterator<Item = (&Chunk, usize, DVec3)> {
    chunks.iter().flat_map(|c| {
        (0..c.len()).map(move |i| {
            (c, i, DVec3::new(c.x[i] as f64, c.y[i] as f64, c.z[i] as f64) * c.lattice.step)
        })
    })
}

fn torus_distance(p: DVec3, minor: f64) -> f64 {
    (p.x.hypot(p.y) - 1.0).hypot(p.z) - minor
}

/// Returns the distance to the nearest surface of a closed-form scene.
fn distance(scene: SceneKind, p: DVec3) -> f64 {
    match scene {
        SceneKind::Plane => p.z.abs(),
        SceneKind::Sphere => (p.length() - 1.0).abs(),
        SceneKind::Torus => torus_distance(p, 0.4).abs(),
        SceneKind::NestedTori => [0.14, 0.27, 0.40]
            .map(|r| torus_distance(p, r).abs())
            .into_iter()
            .fold(f64::INFINITY, f64::min),
        SceneKind::Step => p.z.abs().min((p.z - 0.1).abs()),
        _ => unreachable!(),
    }
}

/// Returns the rays of a coarse picture from the scene's own camera.
fn camera_rays(world: &World) -> Vec<(DVec3, DVec3)> {
    let view = View::new(camera(world.camera()), [96, 54]).unwrap();
    let ray = |i: u32| view.ray((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5);
    (0..96 * 54).map(ray).map(|(origin, direction)| (origin - world.offset, direction)).collect()
}

#[test]
fn hits_lie_on_the_surface() {
    for scene in SCENES {
        let world = synth::build(scene, 1, 0.1);
        let (mut hits, mut back) = (0, 0);
        for (origin, direction) in camera_rays(&world) {
            let Some(hit) = world.trace(origin, direction) else { continue };
            hits += 1;
            assert!(
                (hit.normal.length() - 1.0).abs() < 1e-12 && hit.normal.dot(direction) <= 0.0,
                "{scene:?}: {hit:?}"
            );
            assert!(
                hit.albedo.min_element() >= 0.0
                    && hit.albedo.max_element() < 1.1
                    && hit.lit.is_finite(),
                "{scene:?}: {hit:?}"
            );
            // From a millimetre above, straight down, the surface must be hit. A leaf may be in
            // between.
            let again = world
                .trace(hit.point + hit.normal * 1e-3, -hit.normal)
                .expect("the surface just hit");
            back += ((again.t - 1e-3).abs() < 1e-9) as u32;
            if !matches!(scene, SceneKind::Street | SceneKind::Terrain) {
                assert!(distance(scene, hit.point) < 1e-9, "{scene:?}: {hit:?}");
            }
        }
        assert!(hits > 500, "{scene:?}: the scene's camera sees only {hits} hits");
        assert!(
            back as f64 > 0.998 * hits as f64,
            "{scene:?}: {back} of {hits} hits are found again along their normal"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(512) })]

    #[test]
    fn torus_agrees_with_a_march(seed in prop::array::uniform6(-1.0..1.0f64), far in 0.0..6.0f64) {
        let world = synth::build(SceneKind::Torus, 1, 0.1);
        let direction = DVec3::new(seed[0], seed[1], seed[2]);
        prop_assume!(direction.length() > 1e-3);
        let direction = direction.normalize();
        let origin = DVec3::new(seed[3], seed[4], seed[5]) * 1.5 - direction * far;
        let mut marched = None;
        let outside = torus_distance(origin, 0.4).signum();
        let mut t = 0.0;
        while t < 12.0 && marched.is_none() {
            t += 1e-3;
            if torus_distance(origin + direction * t, 0.4).signum() != outside {
                marched = Some(t);
            }
        }
        // Marching may step over a sliver; what it finds must be found, and not later.
        let hit = world.trace(origin, direction);
        if let Some(marched) = marched {
            prop_assert!(hit.is_some_and(|h| h.t <= marched + 1e-9));
        }
        if let Some(hit) = hit {
            prop_assert!(torus_distance(hit.point, 0.4).abs() < 1e-9);
        }
    }
}

#[test]
fn points_lie_on_the_traced_surface() {
    // Rounding moves a point by half the lattice's diagonal at most.
    let rounding = |world: &World| world.step * 0.75f64.sqrt() + 1e-9;
    for scene in [
        SceneKind::Plane,
        SceneKind::Sphere,
        SceneKind::Torus,
        SceneKind::NestedTori,
        SceneKind::Step,
    ] {
        let world = synth::build(scene, 1, 0.1);
        for (_, _, p) in positions(&scan(&world, 20_000, 0.0)) {
            assert!(distance(scene, p) <= rounding(&world), "{scene:?}: {p}");
        }
    }
    let world = synth::build(SceneKind::Street, 1, 0.1);
    let (mut agree, mut total) = (0, 0);
    for (chunk, i, p) in positions(&scan(&world, 20_000, 0.0)) {
        let station = world.stations()[chunk.source[i] as usize - 1].position;
        // Cast back from the station: at an edge the rounded point's ray may slip by.
        let hit = world.trace(station, p - station);
        total += 1;
        agree += hit.is_some_and(|h| (h.point - p).dot(h.normal).abs() <= rounding(&world)) as u32;
    }
    assert!(agree as f64 > 0.97 * total as f64, "street: {agree} of {total}");
    let world = synth::build(SceneKind::Terrain, 1, 0.1);
    let (mut agree, mut total) = (0, 0);
    for (chunk, i, p) in positions(&scan(&world, 20_000, 0.0)).filter(|(c, i, _)| c.class[*i] == 2)
    {
        assert!(chunk.returns[i].0 == chunk.returns[i].1, "nothing lies behind the ground");
        let hit = world.trace(p + DVec3::Z * 0.02, DVec3::NEG_Z);
        total += 1;
        agree += hit.is_some_and(|h| (h.point - p).dot(h.normal).abs() <= rounding(&world) + 1e-6)
            as u32;
    }
    assert!(total > 10_000 && agree as f64 > 0.995 * total as f64, "terrain: {agree} of {total}");
}

#[test]
fn exactly_as_many_points_as_asked() {
    for scene in SCENES {
        let world = synth::build(scene, 1, 0.1);
        for points in [1, 10_007, 70_001] {
            let total: usize =
                scan(&world, points, scene.default_noise()).iter().map(Chunk::len).sum();
            assert_eq!(total as u64, points, "{scene:?}");
        }
    }
    let world = synth::build(SceneKind::NestedTori, 1, 0.1);
    let chunks = scan(&world, 30_000, 0.0);
    for class in 1..=3 {
        assert_eq!(chunks.iter().flat_map(|c| &c.class).filter(|&&c| c == class).count(), 10_000);
    }
}

#[test]
fn same_seed_same_bytes_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for (scene, ending) in [("torus", "las"), ("street", "las"), ("terrain", "laz")] {
        let line = |seed: u64| format!("{scene} --points 80001 --seed {seed} --noise 0.002");
        let one = synth_file(&path(&format!("one.{ending}")), &line(1), 1);
        let two = synth_file(&path(&format!("two.{ending}")), &line(1), 2);
        let other = synth_file(&path(&format!("other.{ending}")), &line(2), 2);
        assert!(one == two, "{scene}: the bytes depend on the number of threads");
        assert!(one != other, "{scene}: the seed changes nothing");
    }
    let left: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 9 - 3, "only the files asked for are left: {left:?}");
}

#[test]
fn the_file_says_what_was_scanned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("street.las");
    synth_file(&path, "street --points 40000", 2);
    let mut reader = las::Reader::from_path(&path).unwrap();
    assert_eq!(reader.header().number_of_points(), 40_000);
    let bounds = reader.header().bounds();
    assert!(
        (bounds.min.x - 500_000.0).abs() < 100.0 && (bounds.min.y - 5_000_000.0).abs() < 100.0,
        "{bounds:?}"
    );
    let points: Vec<las::Point> =
        reader.read_all().unwrap().points().collect::<las::Result<_>>().unwrap();
    let stations: std::collections::BTreeSet<u16> =
        points.iter().map(|p| p.point_source_id).collect();
    assert_eq!(stations, (1..=5).collect());
    assert!(
        points.iter().all(|p| p.color.is_some() && p.gps_time.is_some() && p.return_number == 1)
    );

    let path = folder.path().join("terrain.laz");
    synth_file(&path, "terrain --points 60000 --offset 300000,4000000,0", 2);
    let mut reader = las::Reader::from_path(&path).unwrap();
    let points: Vec<las::Point> =
        reader.read_all().unwrap().points().collect::<las::Result<_>>().unwrap();
    assert!(points.iter().any(|p| p.number_of_returns >= 3), "woods give several returns");
    assert!(
        points.iter().any(|p| p.scan_angle > 11.0) && points.iter().any(|p| p.scan_angle < -11.0)
    );
    assert!(points.iter().all(|p| p.return_number >= 1 && p.return_number <= p.number_of_returns));
    assert!(
        points.iter().all(|p| (p.x - 300_000.0).abs() < 310.0 && (p.y - 4_000_000.0).abs() < 230.0)
    );
}

#[test]
fn density_falls_with_distance_and_stations_differ_in_exposure() {
    let world = synth::build(SceneKind::Street, 1, 0.1);
    let chunks = scan(&world, 300_000, 0.0);
    let first = world.stations()[0].position;
    let ring = |from: f64, to: f64| {
        let inside = |(c, i, p): &(&Chunk, usize, DVec3)| {
            let away = (*p - first).truncate().length();
            c.source[*i] == 1
                && p.z.abs() < 0.03
                && p.x.abs() < 3.0
                && (from..to).contains(&away)
                && p.y > first.y
        };
        // The road is 6 m wide, so far rings are strips of it.
        positions(&chunks).filter(inside).count() as f64 / (to - from)
    };
    let (near, middle, far) = (ring(5.0, 7.0), ring(12.0, 14.0), ring(24.0, 28.0));
    assert!(near > 4.0 * middle && middle > 3.0 * far, "{near} {middle} {far} points a metre");

    let linear = |v: u16| {
        let v = v as f64 / 65_535.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    for (index, station) in world.stations().iter().enumerate() {
        let mut ratios: Vec<f64> = Vec::new();
        for (chunk, i, p) in
            positions(&chunks).filter(|(c, i, _)| c.source[*i] as usize == index + 1).step_by(97)
        {
            let Some(hit) = world.trace(station.position, p - station.position) else { continue };
            ratios.push(linear(chunk.rgb[i][1]) / hit.lit.y);
        }
        ratios.sort_by(f64::total_cmp);
        let median = ratios[ratios.len() / 2];
        assert!(
            (median / station.gain.y - 1.0).abs() < 1e-3,
            "station {index}: {median} instead of {}",
            station.gain.y
        );
    }
    let gains: Vec<f64> = world.stations().iter().map(|s| s.gain.y).collect();
    assert!(
        gains.iter().enumerate().all(|(i, a)| gains[..i].iter().all(|b| (a - b).abs() > 0.05)),
        "{gains:?}"
    );
}

#[test]
fn noise_has_the_asked_deviation() {
    let world = synth::build(SceneKind::Sphere, 1, 0.1);
    let chunks = scan(&world, 50_000, 0.01);
    let variance =
        positions(&chunks).map(|(_, _, p)| (p.length() - 1.0).powi(2)).sum::<f64>() / 50_000.0;
    // The standard error of a deviation is sigma / sqrt(2 n): 0.3 %.
    assert!((variance.sqrt() / 0.01 - 1.0).abs() < 0.015, "{}", variance.sqrt());
}

#[test]
fn truth_of_the_sphere_is_the_closed_form() {
    let mut world = synth::build(SceneKind::Sphere, 1, 0.1);
    world.offset = DVec3::new(500_000.0, 5_000_000.0, 100.0);
    let view = View::new(camera(world.camera()), [97, 61]).unwrap();
    let truth = truth(&world, &view, &Silent).unwrap();
    let channel = |name: &str| &truth.channels.iter().find(|c| c.0 == name).unwrap().1;
    let mut hits = 0;
    for i in 0..97 * 61 {
        let (origin, d) = view.ray((i % 97) as f64 + 0.5, (i / 97) as f64 + 0.5);
        let o = origin - world.offset;
        let (a, half_b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
        let disc = half_b * half_b - a * c;
        if disc < 0.0 {
            assert!(
                channel("depth.Z")[i] == f32::INFINITY
                    && channel("A")[i] == 0.0
                    && truth.parts[i] == u32::MAX
            );
            continue;
        }
        hits += 1;
        let depth = (-half_b - disc.sqrt()) / a;
        let normal = o + d * depth;
        // UTM costs the origin 1e-9 m; the rest is f32's half ulp, except where the ray grazes.
        assert!(
            (channel("depth.Z")[i] as f64 - depth).abs() < 3e-7 * depth + 1e-9 / disc.sqrt(),
            "pixel {i}"
        );
        assert!(
            (channel("normal.X")[i] as f64 - normal.x).abs() < 1e-6
                && (channel("normal.Z")[i] as f64 - normal.z).abs() < 1e-6
        );
        let luminance =
            0.2126 * channel("R")[i] + 0.7152 * channel("G")[i] + 0.0722 * channel("B")[i];
        assert!((luminance - channel("luminance.V")[i]).abs() < 1e-6);
    }
    assert!(hits > 1000);
}

#[test]
fn truth_file_has_its_layers_and_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("camera.json");
    run(&arguments(&format!("step --camera-out {}", camera.display())), &Silent).unwrap();
    let line = format!("step --truth {} --size 64x36", camera.display());
    let one = synth_file(&folder.path().join("one.exr"), &line, 1);
    let two = synth_file(&folder.path().join("two.exr"), &line, 2);
    assert!(one == two);
    let image =
        exr::prelude::read_all_flat_layers_from_file(folder.path().join("one.exr")).unwrap();
    let names: Vec<String> =
        image.layer_data[0].channel_data.list.iter().map(|c| c.name.to_string()).collect();
    for name in [
        "R",
        "G",
        "B",
        "A",
        "depth.Z",
        "normal.X",
        "normal.Y",
        "normal.Z",
        "albedo.G",
        "luminance.V",
        "index.V",
    ] {
        assert!(names.iter().any(|n| n == name), "{name} is missing in {names:?}");
    }
}

#[test]
fn refusals_and_interruptions_leave_nothing_behind() {
    struct Impatient;
    impl Progress for Impatient {
        fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
            Err(Error::Interrupted)
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("keep.las");
    std::fs::write(&path, "mine").unwrap();
    let line =
        |rest: &str| arguments(&format!("sphere --points 1000 -o {} {rest}", path.display()));
    assert!(matches!(run(&line(""), &Impatient), Err(Error::Interrupted)));
    assert!(matches!(run(&line("--step 1e-12"), &Silent), Err(Error::Request(_))));
    assert!(matches!(run(&line("--noise=-1"), &Silent), Err(Error::Request(_))));
    let said = run(&line("--noise=1e30"), &Silent).unwrap_err().to_string();
    assert!(said.contains("give at most"), "{said}");
    assert!(matches!(run(&arguments("sphere"), &Silent), Err(Error::Request(_))));
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
