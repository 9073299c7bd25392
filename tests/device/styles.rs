//! The style `auto` draws as by eye: surfaces where points are of surfaces, splats where they are
//! not.

use crate::gpu::{self, Way};
use crate::shared::shared;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::{self, Cloud, ReadOptions};
use pointillist::index::build;
use pointillist::index::format::Index;
use pointillist::passes::{Effect, Effects};
use pointillist::progress::Silent;
use pointillist::render::settings::{FrameConfig, RenderSettings, Style};
use pointillist::resident::Resident;
use pointillist::synth::noise::Random;
use pointillist::synth::{self, SceneKind};
use pointillist::view::{Camera, Preset, View};

/// Asserts that between these shares of the points are drawn as splats, and that the reason says
/// so.
fn check(name: &str, cloud: Cloud, between: [f64; 2]) {
    gpu::with(Way::Compute64, |gpu| {
        let size = [640, 480];
        let view = View::new(Camera::framing(Preset::Fit, &cloud.core_points(), size), size);
        let view = view.expect("a view");
        let shown = DisplayAttribute::new(Attribute::White, &cloud);
        let resident = Resident::fill(gpu, cloud, shown, &Silent).expect("resident");
        let config = |style: Style| {
            let effects = Effects::of(style);
            FrameConfig::new(&RenderSettings { effects, ..Default::default() }, &view, &resident)
        };
        let auto = config(Style::Auto);
        let share = auto.sampling.scattered;
        let reason = auto.decisions.reason(Effect::Scattered).expect("a decision").clone();
        println!("{name}: {share:.3}, {}", reason.why);
        assert!((between[0]..=between[1]).contains(&share), "{name}: {share}");
        assert_eq!(reason.runs, share > 0.0, "{name}: {reason:?}");
        assert_eq!(auto.decisions.runs(Effect::Splat), share > 0.0, "{name}");
        // There is nothing to fill where no point lies on a surface.
        assert_eq!(auto.decisions.runs(Effect::Fill), share < 1.0, "{name}");
        assert_eq!(reason.why.contains("lie on no surface"), share > 0.0, "{name}: {reason:?}");
        for (style, splats) in
            [(Style::Surface, false), (Style::Points, false), (Style::Splats, true)]
        {
            let decisions = config(style).decisions;
            let runs = [Effect::Scattered, Effect::Splat].map(|effect| decisions.runs(effect));
            assert_eq!(runs, [false, splats], "{name} {style:?}");
        }
    });
}

fn scene(kind: SceneKind, points: u64) -> Cloud {
    let world = synth::build(kind, 3, 0.0);
    synth::collect("styles", &world, points, 3, kind.default_noise(), &Silent).unwrap()
}

#[test]
fn generated_surfaces_are_surfaces_and_a_crown_is_not() {
    check("torus", scene(SceneKind::NestedTori, 100_000), [0.0, 0.0]);
    check("street", scene(SceneKind::Street, 500_000), [0.0, 0.1]);
    let mut crown = gpu::part(
        cloud::Lattice { step: glam::DVec3::splat(0.01), offset: glam::DVec3::ZERO },
        &[],
        None,
    );
    for i in 0..50_000 {
        let mut random = Random::new(5, 0, i);
        let at = [0; 3].map(|_| 2.0 * random.unit() - 1.0);
        if at.map(|at| at * at).iter().sum::<f64>() < 1.0 {
            let [x, y, z] = at.map(|at| (300.0 * at) as i32);
            crown.columns.x.push(x);
            crown.columns.y.push(y);
            crown.columns.z.push(z);
        }
    }
    check("crown", gpu::cloud(vec![crown]), [1.0, 1.0]);
}

#[test]
fn points_that_faces_join_lie_on_surfaces_however_thin_the_object_is() {
    let folder = tempfile::tempdir().unwrap();
    let random = |i: u64| {
        let mut random = Random::new(6, 0, i);
        [0; 3].map(|_| random.unit())
    };
    let lines = |first: &str| -> String {
        (0..20_000).map(random).map(|[x, y, z]| format!("{first}{x:.4} {y:.4} {z:.4}\n")).collect()
    };
    let head = "ply\nformat ascii 1.0\nelement vertex 20000\nproperty float x\nproperty float y\nproperty float z\n";
    let list = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for (name, text, faces) in [
        ("points.obj", lines("v "), false),
        ("mesh.obj", lines("v ") + "f 1 2 3\n", true),
        ("points.ply", format!("{head}end_header\n{}", lines("")), false),
        ("mesh.ply", format!("{head}{list}{}3 0 1 2\n", lines("")), true),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let share = if faces { 0.0 } else { 1.0 };
        let options = ReadOptions::new(Default::default(), false);
        let files = [path];
        check(name, cloud::read(&files, &options, &Silent).unwrap(), [share; 2]);
        let index = folder.path().join(format!("{name}.pnti"));
        build::build(&files, &index, &build::Options::usual(false), &Silent).unwrap();
        assert_eq!(Index::open(&index).unwrap().has_faces(), faces, "{name}");
    }
}

#[test]
fn scans_are_drawn_as_by_eye() {
    for (file, between) in [
        // Forests.
        ("data/ground/pine_plot.laz", [0.6, 0.95]),
        ("data/ground/MLS_Clip.laz", [0.9, 1.0]),
        ("data/ground/UAS_Clip.laz", [0.6, 1.0]),
        // Houses and trees; a park.
        ("data/aerial/ign_2strips.laz", [0.1, 0.5]),
        ("data/aerial/autzen_trim.laz", [0.02, 0.3]),
        // Surfaces, the first with noise, the last with crumbs within.
        ("data/photogrammetry/lion_takanawa_full.laz", [0.0, 0.05]),
        ("data/objects/bun_zipper.ply", [0.0, 0.0]),
        ("data/objects/armadillo.obj", [0.0, 0.0]),
        ("data/objects/stanford_dragon_437k.ply", [0.0, 0.01]),
    ] {
        let Some(path) = shared(file) else { continue };
        let options = ReadOptions::new(Default::default(), false);
        check(file, cloud::read(&[path], &options, &Silent).unwrap(), between);
    }
}
