//! Derived planes of an index: identical to those of a cloud in memory, for any leaves, threads and
//! memory; and their merging in inner nodes.

use crate::files::{names, scan};
use crate::gpu;
use crate::program::{failed, render, succeeded};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::strays::relative;
use pointillist::cloud::table::TextOptions;
use pointillist::cloud::{self, Cloud, ColumnSet, ReadOptions, octahedral};
use pointillist::error::{Error, Result};
use pointillist::graph::Graph;
use pointillist::index::attributes::axes;
use pointillist::index::attributes::luminance::{self, NEIGHBOURS};
use pointillist::index::attributes::strokes::{self, strokes};
use pointillist::index::build::{self, DerivedPlanes, Options, Summary};
use pointillist::index::format::{Index, Plane};
use pointillist::passes::Effects;
use pointillist::progress::{Progress, Silent};
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings, Style};
use pointillist::resident::Residency;
use pointillist::select::lod::Detail;
use pointillist::synth::{self, SceneKind};
use pointillist::view::{Camera, Preset, View};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const OPTIONS: Options = Options {
    memory: 1 << 30,
    threads: 2,
    wanted: ColumnSet::ALL,
    strict: false,
    text: TextOptions::NONE,
    rgb_range: None,
    derive: DerivedPlanes::ALL,
};

/// A folder with a scan.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new(scene: SceneKind, points: u64) -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        scan(&place.at("scan.las"), scene, points);
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn cloud(&self) -> Cloud {
        cloud::read(&[self.at("scan.las")], &ReadOptions::new(ColumnSet::ALL, true), &Silent)
            .unwrap()
    }

    fn build(&self, options: &Options) -> (Index, Summary) {
        let summary =
            build::build(&[self.at("scan.las")], &self.at("scan.pnti"), options, &Silent).unwrap();
        (Index::open(&self.at("scan.pnti")).unwrap(), summary)
    }
}

/// Returns the positions of a leaf's points [steps of the file].
fn steps(index: &Index, node: usize) -> Vec<[i32; 3]> {
    let record = &index.nodes()[node];
    let lattice = index.lattice(record);
    let steps = |world: DVec3| {
        ((world - lattice.offset) / lattice.step).round().to_array().map(|v| v as i32)
    };
    index.samples(node).unwrap().into_iter().map(|(world, _)| steps(world)).collect()
}

fn words(index: &Index, node: usize, plane: Plane) -> Vec<u32> {
    let mut words = vec![0u32; index.nodes()[node].count as usize];
    index.read(node, plane, bytemuck::cast_slice_mut(&mut words)).unwrap();
    words
}

fn colors(index: &Index, node: usize, plane: Plane) -> Vec<[u8; 3]> {
    let mut bytes = vec![0; 3 * index.nodes()[node].count as usize];
    index.read(node, plane, &mut bytes).unwrap();
    bytes.as_chunks().0.to_vec()
}

fn leaves(index: &Index) -> impl Iterator<Item = usize> + '_ {
    (0..index.nodes().len()).filter(|&node| index.nodes()[node].is_leaf())
}

#[test]
fn normals_and_radii_of_leaves_are_those_of_the_cloud_in_memory() {
    let place = Place::new(SceneKind::Street, 400_000);
    let cloud = place.cloud();
    let part = &cloud.parts[0];
    let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
    let at = |i: usize| [part.columns.x[i], part.columns.y[i], part.columns.z[i]];
    let corner = part.columns.extent().unwrap().low;
    let expected: HashMap<[i32; 3], [u32; 2]> =
        (0..found.len()).map(|i| (at(i), found[i].words(relative(at(i), corner)))).collect();
    let (index, _) = place.build(&OPTIONS);
    assert!(leaves(&index).count() > 5);
    let mut unknown = 0;
    for leaf in leaves(&index) {
        let (facings, brushes) =
            (words(&index, leaf, Plane::Facing), words(&index, leaf, Plane::Brush));
        for ((at, facing), brush) in steps(&index, leaf).into_iter().zip(facings).zip(brushes) {
            let [own, own_brush] = expected[&at];
            assert_eq!(facing, own, "{at:?}");
            // Its cluster depends on distant points.
            const CLUSTER: u32 = 0x9F;
            assert_eq!(
                brush & !CLUSTER,
                own_brush & !CLUSTER,
                "{at:?}: {} m, not {} m",
                strokes::radius_m(brush),
                strokes::radius_m(own_brush)
            );
            unknown += (octahedral::unpack(facing).is_none()) as usize;
        }
    }
    println!("{unknown} of {} normals are not known", found.len());
    assert!(!index.directory.contents.oriented);
    let (axes, own) = (index.directory.contents.axes, axes::of(&cloud.parts));
    assert!(
        !axes.are_the_files() && (0..3).all(|k| axes.0[k].distance(own.0[k]) < 1e-6),
        "{axes:?}, not {own:?}"
    );
}

#[test]
fn corrected_colours_of_leaves_are_those_of_the_cloud_in_memory() {
    let place = Place::new(SceneKind::Street, 300_000);
    let mut cloud = place.cloud();
    luminance::correct(&mut cloud, NEIGHBOURS, &Silent).unwrap();
    let columns = &cloud.parts[0].columns;
    let mut expected: HashMap<[i32; 3], Vec<[u8; 3]>> = HashMap::new();
    for (i, color) in columns.rgb.as_ref().unwrap().iter().enumerate() {
        expected.entry([columns.x[i], columns.y[i], columns.z[i]]).or_default().push(*color);
    }
    let (index, _) = place.build(&Options {
        derive: DerivedPlanes { luminance: true, ..DerivedPlanes::NONE },
        ..OPTIONS
    });
    let mut changed = 0;
    for leaf in leaves(&index) {
        let (own, corrected) =
            (colors(&index, leaf, Plane::Rgb), colors(&index, leaf, Plane::Corrected));
        changed += own.iter().zip(&corrected).filter(|(a, b)| a != b).count();
        for (at, color) in steps(&index, leaf).into_iter().zip(corrected) {
            let there = expected.get_mut(&at).unwrap();
            let k = there
                .iter()
                .position(|other| *other == color)
                .unwrap_or_else(|| panic!("{at:?}: {color:?} is none of {there:?}"));
            there.swap_remove(k);
        }
    }
    assert!(changed > 100_000, "{changed}");
}

/// Returns all planes of all nodes, in order.
fn contents(index: &Index) -> Vec<Vec<u8>> {
    let planes = [Plane::Coarse, Plane::Facing, Plane::Brush, Plane::Corrected];
    let all = (0..index.nodes().len()).flat_map(|node| planes.map(|plane| (node, plane)));
    let bytes = |(node, plane): (usize, Plane)| {
        let mut bytes = vec![0; index.nodes()[node].unpacked_bytes(plane) as usize];
        index.read(node, plane, &mut bytes).unwrap();
        bytes
    };
    all.map(bytes).collect()
}

#[test]
fn neither_threads_nor_memory_show() {
    let place = Place::new(SceneKind::Street, 300_000);
    let first = contents(&place.build(&OPTIONS).0);
    for options in
        [Options { threads: 1, ..OPTIONS }, Options { threads: 3, memory: 64 << 20, ..OPTIONS }]
    {
        assert!(contents(&place.build(&options).0) == first);
    }
}

/// Returns the normal of a torus of radii 1 and 0.4 around the centre of the box.
fn torus_normal(p: DVec3) -> DVec3 {
    (p - DVec3::new(p.x, p.y, 0.0).normalize()).normalize()
}

#[test]
fn samples_of_inner_nodes_have_the_mean_normal_and_cover_what_they_stand_for() {
    let place = Place::new(SceneKind::Torus, 500_000);
    let (index, _) = place.build(&OPTIONS);
    let [low, high] = index.directory.contents.bounds.unwrap();
    let middle = (low + high) / 2.0;
    let area: f64 = leaves(&index)
        .flat_map(|leaf| words(&index, leaf, Plane::Brush))
        .map(|brush| (strokes::radius_m(brush) as f64).powi(2))
        .sum();
    for (node, record) in index.nodes().iter().enumerate().filter(|(_, record)| !record.is_leaf()) {
        let mut angles = Vec::new();
        for ((world, _), facing) in
            index.samples(node).unwrap().into_iter().zip(words(&index, node, Plane::Facing))
        {
            let normal = octahedral::unpack(facing).expect("on a torus all are known");
            angles.push(
                normal.cross(torus_normal(world - middle)).length().min(1.0).asin().to_degrees(),
            );
        }
        angles.sort_by(f64::total_cmp);
        let [median, p99] =
            [0.5, 0.99].map(|share| angles[(share * (angles.len() - 1) as f64) as usize]);
        println!(
            "node {node}, {} samples: median {median:.3} degrees, 99 % {p99:.3}",
            record.count
        );
        assert!(median < 0.5 && p99 < 2.0, "node {node}: {median} {p99}");
        if record.parent as usize == node {
            let own: f64 = words(&index, node, Plane::Brush)
                .into_iter()
                .map(|brush| (strokes::radius_m(brush) as f64).powi(2))
                .sum();
            // Radii are rounded up, by a 128th at most.
            assert!((0.0..0.05).contains(&(own / area - 1.0)), "{own} stands for {area}");
        }
    }
}

/// A point has the same brush in every node, wherever it is rounded to.
#[test]
fn a_sample_that_stands_for_one_point_is_its_stroke() {
    let place = Place::new(SceneKind::Street, 500_000);
    let (index, _) = place.build(&OPTIONS);
    let pairs = |node: usize| {
        words(&index, node, Plane::Facing).into_iter().zip(words(&index, node, Plane::Brush))
    };
    let of_points: HashSet<(u32, u32)> = leaves(&index).flat_map(pairs).collect();
    let inner = index.nodes().iter().enumerate().filter(|(_, record)| !record.is_leaf());
    let ones = inner.flat_map(|(node, _)| {
        pairs(node).zip(words(&index, node, Plane::Weight)).filter(|(_, weight)| *weight == 1)
    });
    let (same, other): (Vec<_>, Vec<_>) = ones.partition(|(pair, _)| of_points.contains(pair));
    println!(
        "{} samples of one point, {} with another stroke",
        same.len() + other.len(),
        other.len()
    );
    assert!(same.len() > 1000 && other.is_empty(), "{} of {}", other.len(), same.len());
}

#[test]
fn what_is_not_asked_for_is_not_there_and_takes_no_room() {
    let place = Place::new(SceneKind::Torus, 100_000);
    let bytes = |derive: DerivedPlanes| {
        let (index, summary) = place.build(&Options { derive, ..OPTIONS });
        let planes = [Plane::Facing, Plane::Brush, Plane::Corrected].map(|plane| index.has(plane));
        (planes, summary.bytes / index.nodes().iter().map(|node| node.count as u64).sum::<u64>())
    };
    let (none, least) = bytes(DerivedPlanes::NONE);
    assert_eq!(none, [false; 3]);
    let cases = [
        (DerivedPlanes { normals: true, ..DerivedPlanes::NONE }, [true, false, false], 4),
        (DerivedPlanes { strokes: true, ..DerivedPlanes::NONE }, [true, true, false], 8),
        (DerivedPlanes { luminance: true, ..DerivedPlanes::NONE }, [false, false, true], 3),
        (DerivedPlanes::ALL, [true; 3], 11),
    ];
    for (derive, planes, more) in cases {
        let (there, size) = bytes(derive);
        assert_eq!((there, size), (planes, least + more), "{derive:?}");
    }
}

/// Returns the stroke coverage of each pixel, of a cut with a point budget, and its number of
/// points.
fn painted(index: Index, view: &View, budget: u64) -> (Vec<f32>, u64) {
    gpu::with(gpu::Way::Compute64, |gpu| {
        let mut shown = DisplayAttribute::indexed(Attribute::White, [0.0, 1.0], [0, 255]);
        shown.further.strokes = true;
        let mut residency = Residency::open(gpu, Arc::new(index), shown, 1 << 28).unwrap();
        let update = residency
            .wait_until_resident(
                gpu,
                view,
                &Detail { budget, lod_px: 0.0, ..Detail::of(view.size) },
                &Silent,
            )
            .unwrap();
        let settings =
            RenderSettings { effects: Effects::of(Style::Strokes), ..RenderSettings::default() };
        let config = FrameConfig::new(&settings, view, residency.resident());
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, residency.resident(), &config).unwrap();
        let picture = g.download(&outcome.picture);
        let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");
        let covered = frame.read::<[f32; 4]>(&picture).iter().map(|pixel| pixel[3]).collect();
        (covered, update.cut.points)
    })
}

#[test]
fn strokes_of_a_tenth_of_the_points_cover_what_all_of_them_do() {
    // The paper's dragon has this many points.
    let place = Place::new(SceneKind::Torus, 437_645);
    let size = [400, 300];
    let view =
        View::new(Camera::framing(Preset::Iso, &place.cloud().core_points(), size), size).unwrap();
    let world = synth::build(SceneKind::Torus, 1, 0.1);
    let hit = |k: usize| {
        let (origin, direction) = view.ray((k % 400) as f64 + 0.5, (k / 400) as f64 + 0.5);
        world.trace(origin, direction).is_some()
    };
    let inside: Vec<bool> = (0..400 * 300).map(hit).collect();
    let surface = inside.iter().filter(|inside| **inside).count();
    for budget in [1, u64::MAX] {
        let (index, _) = place.build(&Options {
            derive: DerivedPlanes { strokes: true, ..DerivedPlanes::NONE },
            ..OPTIONS
        });
        let (covered, points) = painted(index, &view, budget);
        let holes = inside
            .iter()
            .zip(&covered)
            .filter(|&(inside, covered)| *inside && *covered < 0.5)
            .count();
        let near = |k: usize| {
            let (x, y) = (k as i64 % 400, k as i64 / 400);
            let around = (-3..=3i64)
                .flat_map(|dy| (-3..=3i64).map(move |dx| (dx, dy)))
                .filter(|(dx, dy)| dx * dx + dy * dy <= 9);
            let mut around = around
                .map(|(dx, dy)| (x + dx, y + dy))
                .filter(|(u, v)| (0..400).contains(u) && (0..300).contains(v));
            around.any(|(u, v)| inside[(v * 400 + u) as usize])
        };
        let beyond = (0..covered.len()).filter(|&k| covered[k] >= 0.5 && !near(k)).count();
        println!("{points} strokes: {holes} holes in {surface} pixels, {beyond} pixels beyond");
        assert!(
            surface > 10_000 && 1000 * holes <= surface,
            "{points} strokes: {holes} holes in {surface} pixels"
        );
        assert_eq!(beyond, 0, "{points} strokes");
        assert_eq!(points == 437_645, budget > 1);
    }
}

/// Interrupts the work once it searches neighbours.
struct Interrupting;

impl Progress for Interrupting {
    fn tick(&self, doing: &str, _done: u64, _total: u64) -> Result<()> {
        if doing == "looking around points" { Err(Error::Interrupted) } else { Ok(()) }
    }
}

#[test]
fn interrupted_it_leaves_nothing() {
    let place = Place::new(SceneKind::Torus, 100_000);
    let built =
        build::build(&[place.at("scan.las")], &place.at("scan.pnti"), &OPTIONS, &Interrupting);
    assert!(matches!(built, Err(Error::Interrupted)));
    assert_eq!(names(place.folder.path()), ["scan.las"]);
}

#[test]
fn a_picture_that_lacks_a_plane_says_in_one_line_how_to_make_it() {
    let place = Place::new(SceneKind::Torus, 60_000);
    let line = |words: &str| format!("-o {} --size 64x48 {words}", place.at("a.png").display());
    place.build(&Options { derive: DerivedPlanes::NONE, ..OPTIONS });
    let lacking = [
        ("--color normal", "--normals"),
        ("--effect phong=on,normals=file", "--normals"),
        ("--color corrected", "--luminance"),
    ];
    for (words, option) in lacking {
        let said = failed(&render(&place.at("scan.pnti"), &line(words)), 1);
        assert!(
            said.contains(&format!("scan.pnti {option}`")) && said.contains("scan.las"),
            "{said}"
        );
    }
    // Strokes can be found without.
    let strokes = line("--style strokes");
    let said = succeeded(&render(&place.at("scan.pnti"), &strokes));
    assert!(said.contains("scan.pnti --strokes`") && said.contains("scan.las"), "{said}");
    place.build(&OPTIONS);
    let said = succeeded(&render(&place.at("scan.pnti"), &strokes));
    assert!(!said.contains("--strokes"), "{said}");
    for (words, _) in lacking {
        succeeded(&render(&place.at("scan.pnti"), &line(words)));
    }
    let said =
        succeeded(&render(&place.at("scan.pnti"), &line("--light direction:1,1,-1 --explain")));
    assert!(said.contains("normals: those of the points"), "{said}");
    let said =
        succeeded(&render(&place.at("scan.las"), &line("--light direction:1,1,-1 --explain")));
    assert!(said.contains("normals: fitted to the depths"), "{said}");
    succeeded(&render(&place.at("scan.las"), &line("--color corrected")));
}

/// Returns a PLY file of a bumpy sheet with normals of its own: downward, so that they differ from
/// fitted ones.
fn with_normals(path: &Path) {
    let side = 300;
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", side * side);
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    for i in 0..side * side {
        let (x, y) = ((i % side) as f64 * 0.01, (i / side) as f64 * 0.01);
        text += &format!("{x:.4} {y:.4} {:.4} 0 0.6 -0.8\n", 0.05 * (3.0 * x).sin());
    }
    std::fs::write(path, text).unwrap();
}

#[test]
fn normals_of_files_are_kept_and_say_which_side_is_outside() {
    let place = Place { folder: tempfile::tempdir().unwrap() };
    with_normals(&place.at("scan.las"));
    let (index, _) = place.build(&Options {
        derive: DerivedPlanes { normals: true, ..DerivedPlanes::NONE },
        ..OPTIONS
    });
    assert!(index.directory.contents.oriented);
    for node in 0..index.nodes().len() {
        for facing in words(&index, node, Plane::Facing) {
            let normal = octahedral::unpack(facing).expect("a normal");
            assert!((normal - DVec3::new(0.0, 0.6, -0.8)).length() < 0.01, "{normal}");
        }
    }
}

/// The same scan twice, a third of a step apart: two trees, whose points are still neighbours.
#[test]
fn luminance_is_that_of_all_files_even_where_their_lattices_differ() {
    let place = Place::new(SceneKind::Street, 100_000);
    let mut bytes = std::fs::read(place.at("scan.las")).unwrap();
    let offset = f64::from_le_bytes(bytes[155..163].try_into().unwrap()) + 0.00037;
    bytes[155..163].copy_from_slice(&offset.to_le_bytes());
    std::fs::write(place.at("other.las"), bytes).unwrap();
    let files = [place.at("scan.las"), place.at("other.las")];
    let options = Options { derive: DerivedPlanes::ALL, ..OPTIONS };
    build::build(&files, &place.at("both.pnti"), &options, &Silent).unwrap();
    let index = Index::open(&place.at("both.pnti")).unwrap();
    // Two trees, and what stands above them, which knows all that they do.
    assert_eq!((index.directory.roots, index.directory.contents.lattices.len()), (1, 6));
    assert!(
        DerivedPlanes::ALL.planes().into_iter().all(|plane| index.nodes()[0].has(plane))
            && index.nodes()[0].lattice >= 4
    );
    let mut cloud = cloud::read(&files, &ReadOptions::new(ColumnSet::ALL, false), &Silent).unwrap();
    luminance::correct(&mut cloud, NEIGHBOURS, &Silent).unwrap();
    let mut expected: [HashMap<[i32; 3], Vec<[u8; 3]>>; 2] = Default::default();
    for (part, expected) in cloud.parts.iter().zip(&mut expected) {
        let columns = &part.columns;
        for (i, color) in columns.rgb.as_ref().unwrap().iter().enumerate() {
            expected.entry([columns.x[i], columns.y[i], columns.z[i]]).or_default().push(*color);
        }
    }
    let (mut same, mut all) = (0, 0);
    for leaf in leaves(&index) {
        // Each tree has two lattices, the file's own first.
        let expected = &expected[index.nodes()[leaf].lattice as usize / 2];
        for (at, color) in
            steps(&index, leaf).into_iter().zip(colors(&index, leaf, Plane::Corrected))
        {
            same += expected[&at].contains(&color) as usize;
            all += 1;
        }
    }
    // In memory all are converted to one lattice, whose rounding orders points at equal distance.
    println!("{same} of {all} are the same");
    assert!(same * 1000 > 995 * all, "{same} of {all}");
}
