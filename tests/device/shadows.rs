//! Shadows: kernels against their twins, and marks of points against rays through the surfaces that
//! the points lie on.

use crate::cameras::{orthographic, perspective};
use crate::files::scan;
use crate::gpu::{self, Way, cloud, part, random_keys};
use crate::points::{Random, bumpy};
use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::{Cloud, Lattice};
use pointillist::config::POINTS_PER_PAGE;
use pointillist::graph::{Buffer, Gpu, Graph};
use pointillist::index::build;
use pointillist::index::format::Index;
use pointillist::passes::project::Precision;
use pointillist::passes::shadows::cameras::LightCamera;
use pointillist::passes::shadows::{
    self, Facts, Layer, Method, Reached, Settings, area_light_samples,
};
use pointillist::passes::{Effects, FrameContext, Switch};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::{Residency, Resident};
use pointillist::select::lod::Detail;
use pointillist::select::opacity::Opacities;
use pointillist::study::mesh::Mesh;
use pointillist::study::oracle::{project, shadows as oracle};
use pointillist::synth::{self, World};
use pointillist::view::light::Light;
use pointillist::view::{Camera, Preset, View};
use rayon::prelude::*;
use std::sync::Arc;

fn bounds(resident: &Resident) -> (DVec3, DVec3) {
    resident
        .nodes
        .iter()
        .map(|node| node.bounds())
        .reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))
        .unwrap()
}

/// Returns where points are, and how many samples of the light reach them.
fn marked(cloud: &Cloud, light: Light, settings: Settings) -> (Vec<(DVec3, u8)>, Facts) {
    gpu::with(Way::Compute64, |gpu| {
        let resident = Resident::fill(
            gpu,
            cloud.clone(),
            DisplayAttribute::new(Attribute::White, cloud),
            &Silent,
        )
        .unwrap();
        let view =
            View::new(Camera::framing(Preset::Fit, &cloud.core_points(), [64, 64]), [64, 64])
                .unwrap();
        let scene = FrameContext::of(&view, &resident, light);
        let mut effects = Effects::default();
        effects.shadows.switch = Switch::On;
        effects.shadows.settings = settings;
        let mut g = Graph::new(gpu);
        let marks = shadows::light_visibility(
            &mut g,
            &scene,
            &resident,
            &effects,
            &effects.decide(&scene),
            None,
        )
        .unwrap()
        .expect("switched on");
        let counts = g.download_buffer(&marks.counts);
        let frame = g.submit_and_wait(&[]).unwrap();
        let counts: &[u8] = frame.read(&counts);
        let ids = resident
            .nodes
            .iter()
            .flat_map(|node| (0..node.count).map(|i| (node.number * POINTS_PER_PAGE + i) as usize));
        let points = resident
            .positions(gpu)
            .unwrap()
            .into_iter()
            .zip(ids)
            .map(|(p, id)| (p, counts[id]))
            .collect();
        (points, marks.facts)
    })
}

const STEP: f64 = 1e-5;

/// Returns points on a lattice of hundredths of millimetres.
fn points(at: impl Iterator<Item = DVec3>) -> Cloud {
    let points: Vec<[i32; 3]> = at.map(|p| (p / STEP).round().as_ivec3().to_array()).collect();
    cloud(vec![part(Lattice { step: DVec3::splat(STEP), offset: DVec3::ZERO }, &points, None)])
}

/// Returns uniform points on the square of this half width along two axes.
fn square(count: usize, half: f64, u: DVec3, v: DVec3, seed: u64) -> impl Iterator<Item = DVec3> {
    let mut random = Random(seed);
    (0..count).map(move |_| u * random.within(-half, half) + v * random.within(-half, half))
}

/// guide: numerics, case 13: with a layer of sqrt(2) texels' sides and a quantum, no plane shades
/// itself at any angle up to the limit. If masks fill from neighbours, twice as much is needed.
///
/// The slope is taken from neighbours, but the theorem needs that across the lower corner of a
/// texel. Without filling, the plane's rim has none there, and is left out.
#[test]
fn hard_13_planes_do_not_shade_themselves() {
    let mut failures = Vec::new();
    for (fill, per_texel) in [(0.0, 40.0), (0.0, 16.0), (2.0, 4.0), (2.0, 2.0)] {
        for degrees in [0.0, 10.0, 30.0, 45.0, 60.0, 70.0, 78.0f64] {
            for around in [0.0, 20.0, 45.0f64] {
                let (angle, around) = (degrees.to_radians(), around.to_radians());
                let direction = DVec3::new(
                    angle.sin() * around.cos(),
                    angle.sin() * around.sin(),
                    -angle.cos(),
                );
                let count = 120_000;
                let cloud = points(square(count, 1.0, DVec3::X, DVec3::Y, 7));
                // The picture is at most as wide as the plane's diagonal, and foreshortened across
                // it.
                let texel = (4.0 * angle.cos() * per_texel / count as f64).sqrt();
                let wide = 2.0 * (around.cos() + around.sin());
                let settings =
                    Settings { fill, size: (wide / texel).ceil().max(8.0), ..Settings::default() };
                let lights = [Light::Direction(direction), Light::Position(direction * -3.0)];
                for light in lights {
                    let (marked, facts) = marked(&cloud, light, settings);
                    let rim = if fill > 0.0 { 0.0 } else { 2.0 * facts.texel_m / angle.cos() };
                    let dark = marked
                        .iter()
                        .filter(|(p, count)| *count == 0 && p.abs().max_element() < 1.0 - rim)
                        .count();
                    if dark > 0 {
                        failures.push(format!(
                            "fill {fill}, {per_texel} points a texel, {degrees} degrees, {light}: {dark} of {count} dark ({facts})"
                        ));
                    }
                }
            }
        }
    }
    assert!(failures.is_empty(), "{} cases:\n{}", failures.len(), failures.join("\n"));
}

/// Counts of points. Those more than a texel from every edge of shadow are clear.
#[derive(Debug, Default)]
struct Verdict {
    clear: usize,
    falsely_dark: usize,
    falsely_lit: usize,
    /// Points nearer behind what shades them than its layer is deep along the light.
    in_gap: usize,
    in_band: usize,
    /// Points whose shading surface, or what might be one, was not scanned.
    unknown: usize,
}

impl Verdict {
    fn share(&self, count: usize) -> f64 {
        count as f64 / self.clear.max(1) as f64
    }

    /// Returns the shares of clear points that are falsely dark and falsely lit, and that of all
    /// points in the gap.
    fn percent(&self) -> [f64; 3] {
        let all = self.clear + self.in_gap + self.in_band + self.unknown;
        [
            self.share(self.falsely_dark),
            self.share(self.falsely_lit),
            self.in_gap as f64 / all.max(1) as f64,
        ]
        .map(|share| 100.0 * share)
    }
}

/// Judges marks. `first` is how far along a ray the first surface is, `scanned` whether points were
/// taken from there.
fn judge(
    marked: &[(DVec3, u8)],
    facts: &Facts,
    direction: DVec3,
    first: impl Fn(DVec3, DVec3) -> Option<f64> + Sync,
    scanned: impl Fn(DVec3) -> bool + Sync,
) -> Verdict {
    const FAR: f64 = 300.0;
    let travel = direction.normalize();
    let u = travel.cross(if travel.x.abs() < 0.5 { DVec3::X } else { DVec3::Y }).normalize();
    let v = travel.cross(u);
    let texel = facts.texel_m;
    let steepest = (1.0 / Settings::default().limit.powi(2) - 1.0).sqrt();
    let one = |&(p, count): &(DVec3, u8)| {
        // Distance from the point forward to the first surface beside it; negative if that is
        // behind.
        let front = |x: f64, y: f64| {
            let from = p + u * x + v * y - travel * FAR;
            first(from, travel).map_or(f64::NEG_INFINITY, |t| FAR - t)
        };
        let own = front(0.0, 0.0);
        let near = 1e-3 * texel;
        let slope = [front(near, 0.0) - front(-near, 0.0), front(0.0, near) - front(0.0, -near)]
            .map(|rise| rise / (2.0 * near));
        let slope =
            if slope.iter().all(|s| s.is_finite()) { slope[0].hypot(slope[1]) } else { 1e3 };
        let around = (0..9)
            .map(|k| [(k % 3 - 1) as f64, (k / 3 - 1) as f64])
            .map(|[x, y]| (front(x * texel, y * texel), x.hypot(y) * texel));
        let around: Vec<(f64, f64)> = around.collect();
        let ring: Vec<f64> = around.iter().map(|(front, _)| *front).collect();
        // Layer / <v, n> for the steepest slope within a texel of what shades the point.
        let curved = around
            .iter()
            .filter(|(_, run)| *run > 0.0)
            .map(|(front, run)| (front - own).abs() / run);
        let gap = facts.layer_m * 1f64.hypot(curved.fold(slope, f64::max).min(steepest));
        let mut verdict = Verdict::default();
        let most = ring.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let least = ring.iter().copied().fold(f64::INFINITY, f64::min);
        // A point is on its surface up to a lattice step, which a slope enlarges.
        let lit = own <= 5e-4 * (1.0 + slope);
        if most > 0.0 && !scanned(p - travel * own.max(0.0)) {
            verdict.unknown = 1;
        } else if lit && most <= texel + 1.5 * 1.4143 * texel * slope {
            (verdict.clear, verdict.falsely_dark) = (1, (count == 0) as usize);
        } else if !lit && least > gap {
            (verdict.clear, verdict.falsely_lit) = (1, (count > 0) as usize);
        } else if !lit && least > 0.0 {
            verdict.in_gap = 1;
        } else {
            verdict.in_band = 1;
        }
        verdict
    };
    marked.par_iter().map(one).reduce(Verdict::default, |a, b| Verdict {
        clear: a.clear + b.clear,
        falsely_dark: a.falsely_dark + b.falsely_dark,
        falsely_lit: a.falsely_lit + b.falsely_lit,
        in_gap: a.in_gap + b.in_gap,
        in_band: a.in_band + b.in_band,
        unknown: a.unknown + b.unknown,
    })
}

/// A ring that lies on a plane.
struct Ring(World);

const LIFT: DVec3 = DVec3::new(0.0, 0.0, 0.4);

impl Ring {
    fn new() -> Ring {
        Ring(synth::build(synth::SceneKind::Torus, 1, 0.0))
    }

    fn cloud(&self, count: usize) -> Cloud {
        let ring = synth::collect("torus", &self.0, count as u64, 1, 0.0, &Silent).unwrap();
        let Lattice { step, offset } = ring.parts[0].lattice;
        let columns = &ring.parts[0].columns;
        let at = |i: usize| {
            offset
                + step * DVec3::new(columns.x[i] as f64, columns.y[i] as f64, columns.z[i] as f64)
                + LIFT
                - self.0.offset
        };
        points((0..count).map(at).chain(square(count, 2.5, DVec3::X, DVec3::Y, 11)))
    }

    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let ground = -origin.z / direction.z;
        let at = origin + direction * ground;
        let ground = (ground > 0.0 && at.x.abs() <= 2.5 && at.y.abs() <= 2.5).then_some(ground);
        let ring = self.0.first(origin - LIFT, direction);
        [ground, ring].into_iter().flatten().reduce(f64::min)
    }
}

#[test]
fn a_ring_on_a_plane_is_shaded_as_rays_say() {
    let ring = Ring::new();
    let cloud = ring.cloud(400_000);
    for direction in [DVec3::new(0.5, 0.3, -0.8), DVec3::new(1.0, 0.2, -0.5), DVec3::NEG_Z] {
        let (marked, facts) = marked(&cloud, Light::Direction(direction), Settings::default());
        let verdict = judge(&marked, &facts, direction, |o, d| ring.first(o, d), |_| true);
        println!("{direction}: {verdict:?}, {:.3?} % ({facts})", verdict.percent());
        assert!(verdict.clear > 600_000, "{verdict:?}");
        assert!(
            verdict.share(verdict.falsely_dark) < 0.005
                && verdict.share(verdict.falsely_lit) < 0.005,
            "{direction}: {verdict:?}"
        );
    }
}

#[test]
fn the_street_is_shaded_as_rays_say() {
    let world = synth::build(synth::SceneKind::Street, 1, 0.0);
    let cloud = synth::collect("street", &world, 1_500_000, 1, 0.0, &Silent).unwrap();
    let direction = DVec3::new(0.3, 0.8, -0.8);
    let (mut marked, facts) = marked(&cloud, Light::Direction(direction), Settings::default());
    marked.iter_mut().for_each(|(p, _)| *p -= world.offset);
    let sees = |station: &synth::Station, p: DVec3| {
        world.first(station.position, p - station.position).is_some_and(|t| t > 1.0 - 1e-4)
    };
    let scanned = |p: DVec3| world.stations().iter().any(|station| sees(station, p));
    let some: Vec<_> = marked.into_iter().step_by(5).collect();
    let verdict = judge(&some, &facts, direction, |o, d| world.first(o, d), scanned);
    println!("{verdict:?}, {:.3?} % ({facts})", verdict.percent());
    assert!(
        verdict.share(verdict.falsely_dark) < 0.005 && verdict.share(verdict.falsely_lit) < 0.005,
        "{verdict:?}"
    );
}

/// Everything behind a closed surface is dark, even if the light's picture has gaps. Everything
/// behind a plate is dark, however near.
#[test]
fn nothing_behind_a_closed_surface_is_lit() {
    let lights = [DVec3::NEG_Z, DVec3::new(0.5, 1.0, -1.0), DVec3::new(1.0, 0.3, -0.5)];
    // Rays through tori take long.
    let scenes = [
        (synth::SceneKind::NestedTori, 0.0, 40),
        (synth::SceneKind::Step, 0.05, 8),
        (synth::SceneKind::Step, 0.1, 8),
        (synth::SceneKind::Step, 0.2, 8),
    ];
    for (scene, gap, every) in scenes {
        let mut world = synth::build(scene, 1, gap);
        world.offset = DVec3::ZERO;
        let cloud = synth::collect("scene", &world, 1_000_000, 1, 0.0, &Silent).unwrap();
        for direction in lights {
            let (marked, facts) = marked(&cloud, Light::Direction(direction), Settings::default());
            // Points of the two inner rings; the outer one lies 13 cm around them.
            let is_inner = |p: DVec3| {
                scene == synth::SceneKind::NestedTori && (p.x.hypot(p.y) - 1.0).hypot(p.z) < 0.3
            };
            let (inner, lit) = marked
                .iter()
                .filter(|(p, _)| is_inner(*p))
                .fold((0, 0), |(all, lit), (_, count)| (all + 1, lit + (*count > 0) as usize));
            let some: Vec<_> = marked.into_iter().step_by(every).collect();
            let verdict = judge(&some, &facts, direction, |o, d| world.first(o, d), |_| true);
            let what = format!(
                "{scene:?} {gap}, {direction}: of {inner} inner points {lit} lit, {verdict:?}, {:.3?} % ({facts})",
                verdict.percent()
            );
            println!("{what}");
            assert!(verdict.clear > some.len() / 2 && lit * 2000 <= inner, "{what}");
            assert!(
                verdict.share(verdict.falsely_dark) < 0.005
                    && verdict.share(verdict.falsely_lit) < 0.005,
                "{what}"
            );
        }
    }
}

/// A light in a closed surface is so near to it that points lie far apart in the light's pictures.
/// Nothing shines through between them, nor past the borders of those pictures. Where a nearer part
/// of the surface ends, its shadow is wider by the gaps. With few points, the layer that gaps
/// require reaches to the surface around it.
#[test]
fn a_light_in_a_closed_surface_lights_nothing_outside_of_it() {
    let mut world = synth::build(synth::SceneKind::NestedTori, 1, 0.0);
    world.offset = DVec3::ZERO;
    for (count, most_outside) in [(100_000, 0.02), (1_000_000, 1e-5)] {
        let cloud = synth::collect("scene", &world, count, 1, 0.0, &Silent).unwrap();
        for place in [DVec3::X, DVec3::new(0.6, 0.75, 0.05)] {
            let (marked, facts) = marked(&cloud, Light::Position(place), Settings::default());
            let ring = |p: DVec3| DVec3::new(p.x, p.y, 0.0).normalize();
            let is_outside = |p: DVec3| p.distance(ring(p)) > 0.2;
            let sees = |p: DVec3| world.first(place, p - place).is_some_and(|t| t > 0.999);
            let is_grazed = |p: DVec3| {
                (p - ring(p)).normalize().dot((p - place).normalize()).abs()
                    < Settings::default().limit
            };
            let (mut outside, mut lit_outside) = (0, 0);
            for (_, lit) in marked.iter().filter(|(p, _)| is_outside(*p)) {
                (outside, lit_outside) = (outside + 1, lit_outside + (*lit > 0) as usize);
            }
            let around = |(p, lit): &(DVec3, u8)| {
                let sees = !is_outside(*p) && sees(*p) && !is_grazed(*p);
                (sees as usize, (sees && *lit == 0) as usize)
            };
            let (seen, dark) =
                marked.par_iter().map(around).reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            let what = format!(
                "{count} points, {place}: of {outside} outside {lit_outside} lit, of {seen} that it sees {dark} dark ({facts})"
            );
            println!("{what}");
            assert!(
                lit_outside as f64 <= most_outside * outside as f64
                    && dark as f64 <= 0.1 * seen as f64,
                "{what}"
            );
        }
    }
}

#[test]
fn a_mesh_is_shaded_as_rays_say() {
    let Some(path) = shared("data/objects/bun_zipper.ply") else { return };
    // Upright, and twenty times as large.
    let mesh = Mesh::read(&path, |p| DVec3::new(p.x, -p.z, p.y) * 20.0).unwrap();
    let cloud = points((0..600_000).map(|i| mesh.sample(&mut synth::noise::Random::new(1, 0, i))));
    let direction = DVec3::new(0.5, 0.3, -0.8);
    let (marked, facts) = marked(&cloud, Light::Direction(direction), Settings::default());
    let verdict = judge(&marked, &facts, direction, |o, d| mesh.first(o, d), |_| true);
    println!("{verdict:?}, {:.3?} % ({facts})", verdict.percent());
    assert!(
        verdict.share(verdict.falsely_dark) < 0.005 && verdict.share(verdict.falsely_lit) < 0.005,
        "{verdict:?}"
    );
}

#[test]
fn peeling_marks_the_same_points_as_comparing_depths() {
    let cloud = Ring::new().cloud(15_000);
    for light in
        [Light::Direction(DVec3::new(0.5, 0.3, -0.8)), Light::Position(DVec3::new(0.3, 0.2, 0.9))]
    {
        let settings = Settings { samples: 2.0, peels: 160.0, ..Settings::default() };
        let [depth, index] = [Method::Depth, Method::Index]
            .map(|method| marked(&cloud, light, Settings { method, ..settings }));
        let lit = depth.0.iter().filter(|(_, count)| *count > 0).count();
        let differing = depth.0.iter().zip(&index.0).filter(|(a, b)| a != b).count();
        println!("{light}: {lit} lit, {differing} differ ({})", depth.1);
        assert!(lit > 7_500 && lit < 29_000, "{light}: {lit} lit");
        assert_eq!(differing, 0, "{light}");
    }
}

/// Dobrev et al. 2010, sec. 6: ka + m (kd + ks). In full shadow a surface shows the ambient part of
/// its colour only. In full light it looks as without shadows.
#[test]
fn shadows_take_what_phong_adds_and_leave_its_ambient_part() {
    let floor = square(300_000, 1.5, DVec3::X, DVec3::Y, 3);
    let plate = square(100_000, 0.5, DVec3::X, DVec3::Y, 5).map(|p| p + DVec3::Z * 0.5);
    let mut cloud = points(floor.chain(plate));
    let color = [200, 100, 50];
    cloud.parts[0].columns.rgb = Some(vec![color; 400_000]);
    let view =
        View::new(perspective(DVec3::new(0.5, -2.5, 2.5), DVec3::ZERO, 60.0), [200, 150]).unwrap();
    for fill in ["fill=off", "fill=on,method=mask", "fill=on,method=splat"] {
        let drawn = |shadows: &str| {
            let mut settings = RenderSettings {
                light: Light::Direction(DVec3::new(0.3, 0.2, -1.0)),
                ..gpu::bare()
            };
            for effect in
                ["phong=on,ambient=0.25,diffuse=0.75,specular=1,shininess=2", fill, shadows]
            {
                settings.effects.set_any(effect).unwrap();
            }
            gpu::draw(Way::Compute64, &cloud, &view, &settings).color
        };
        let [lit, shaded] = ["shadows=off", "shadows=on,ambient=0.9"].map(drawn);
        let ambient = color.map(|channel| {
            (0.25 * pointillist::cloud::colormap::srgb_to_linear(channel as f64 / 255.0)) as f32
        });
        let in_shadow = |pixel: &[f32; 4]| (0..3).all(|c| (pixel[c] - ambient[c]).abs() <= 1e-6);
        // Between points of plate and floor, normals may face away from the light.
        let [dark, away] =
            [&shaded, &lit].map(|pixels| pixels.iter().filter(|pixel| in_shadow(pixel)).count());
        let odd = lit
            .iter()
            .zip(&shaded)
            .filter(|(lit, shaded)| !in_shadow(shaded) && lit != shaded)
            .count();
        println!(
            "{fill}: {dark} of {} pixels in shadow, {odd} neither as in shadow nor as in light",
            lit.len()
        );
        assert!(dark > 300 && odd == 0 && away * 2 < dark, "{fill}: {away} face away");
    }
}

/// guide: numerics, case 14: behind a half plane a point gets the light of each sample whose ray
/// passes the edge. Rays within texels of the edge are left out.
#[test]
fn hard_14_behind_an_edge_every_sample_is_the_ray_to_its_place() {
    let floor = square(300_000, 1.5, DVec3::X, DVec3::Y, 3);
    let plate =
        square(300_000, 1.5, DVec3::X, DVec3::Y, 5).map(|p| DVec3::new(p.x / 2.0 - 0.75, p.y, 1.0));
    let cloud = points(floor.chain(plate));
    let settings = Settings { samples: 16.0, radius: 12.0, ..Settings::default() };
    let (marked, facts) = marked(&cloud, Light::Direction(DVec3::NEG_Z), settings);
    let basis = Camera { target: DVec3::NEG_Z, ..orthographic(DVec3::ZERO, DVec3::NEG_Z, 1.0) }
        .basis()
        .unwrap();
    let tangent = 12f64.to_radians().tan();
    // Distance by which a ray to the floor passes the edge where it crosses the plate's height.
    let aside: Vec<f64> =
        area_light_samples::places(16, area_light_samples::Pattern::Stratified, 0)
            .iter()
            .map(|[u, v]| {
                let forward = basis.forward + (basis.right * u + basis.up * v) * tangent;
                forward.x / forward.z
            })
            .collect();
    let (mut between, mut wrong) = (0, 0);
    for (p, count) in marked.iter().filter(|(p, _)| p.z < 0.5 && p.x.abs() < 0.5 && p.y.abs() < 0.8)
    {
        let lit = |slack: f64| aside.iter().filter(|aside| p.x + *aside > slack).count();
        let band = 2.0 * facts.texel_m;
        between += (1..16).contains(count) as usize;
        wrong += !(lit(band)..=lit(-band)).contains(&(*count as usize)) as usize;
    }
    println!("{between} points half in shadow, {wrong} wrong ({facts})");
    assert!(
        between > 10_000 && wrong == 0,
        "{between} points half in shadow, {wrong} wrong ({facts})"
    );
}

/// Cast over several frames, however many at a time, samples add up to the marks of one frame that
/// casts all. Then nothing more is cast.
#[test]
fn samples_add_up_frame_by_frame_to_the_same_marks() {
    let cloud = points(square(40_000, 1.0, DVec3::X, DVec3::Y, 3).chain(square(
        20_000,
        0.4,
        DVec3::X,
        DVec3::Z,
        5,
    )));
    for method in [Method::Depth, Method::Index] {
        for light in [
            Light::Direction(DVec3::new(0.2, 0.3, -1.0)),
            Light::Position(DVec3::new(0.1, 0.5, 0.3)),
        ] {
            let mut effects = Effects::default();
            effects.shadows.switch = Switch::On;
            effects.shadows.settings = Settings {
                method,
                samples: 7.0,
                radius: 0.2,
                size: 100.0,
                peels: 8.0,
                ..Settings::default()
            };
            let of = |at_once: &[Option<u32>]| {
                gpu::with(Way::Compute64, |gpu| {
                    let resident = Resident::fill(
                        gpu,
                        cloud.clone(),
                        DisplayAttribute::new(Attribute::White, &cloud),
                        &Silent,
                    )
                    .unwrap();
                    let view = View::new(
                        Camera::framing(Preset::Fit, &cloud.core_points(), [64, 64]),
                        [64, 64],
                    )
                    .unwrap();
                    let scene = FrameContext::of(&view, &resident, light);
                    let frames: Vec<_> = (at_once.iter())
                        .map(|&at_once| {
                            let mut g = Graph::new(gpu);
                            let marks = shadows::light_visibility(
                                &mut g,
                                &scene,
                                &resident,
                                &effects,
                                &effects.decide(&scene),
                                at_once,
                            )
                            .unwrap()
                            .expect("switched on");
                            let counts = g.download_buffer(&marks.counts);
                            let frame = g.submit_and_wait(&[]).unwrap();
                            let (counts, passes) =
                                (frame.read::<u8>(&counts)[..60_000].to_vec(), frame.passes.len());
                            (marks.facts.cast, counts, passes)
                        })
                        .collect();
                    frames
                })
            };
            let whole = of(&[None]).pop().unwrap();
            let frames = of(&[Some(0), Some(0), Some(1), Some(3), Some(1), Some(1), Some(1), None]);
            assert_eq!(
                frames.iter().map(|frame| frame.0).collect::<Vec<_>>(),
                [1, 1, 2, 5, 6, 7, 7, 7]
            );
            assert!(frames[5].1 == whole.1 && frames[7].1 == whole.1, "{method:?}, {light}");
            assert!(frames[4].1 != whole.1 && whole.1.iter().any(|&count| (1..7).contains(&count)));
            // Only the marks are read.
            assert!([1, 6, 7].iter().all(|&frame| frames[frame].2 == 1), "{method:?}, {light}");
            let begun = of(&[Some(2), None]).pop().unwrap();
            assert!(begun.1 == whole.1);
        }
    }
}

/// Nodes of an index come and go. The others keep their marks, unless their light passes there. All
/// marks equal those of casting everything anew.
#[test]
fn marks_of_nodes_that_come_and_go_are_those_of_casting_all_anew() {
    let folder = tempfile::tempdir().unwrap();
    let (las, pnti) = (folder.path().join("terrain.las"), folder.path().join("terrain.pnti"));
    scan(&las, synth::SceneKind::Terrain, 3_000_000);
    build::build(&[las], &pnti, &build::Options::usual(false), &Silent).unwrap();
    let index = Arc::new(Index::open(&pnti).unwrap());
    let (low, high) = index.bounds(&index.nodes()[0]);
    let middle = (low + high) / 2.0;
    let lights = [
        Light::Direction(DVec3::new(0.3, 0.8, -0.8)),
        Light::Position(middle + DVec3::new(100.0, -300.0, 500.0)),
    ];
    for (light, samples) in lights.into_iter().zip([1.0, 3.0]) {
        gpu::with(Way::Compute64, |gpu| {
            let mut residency = Residency::open(
                gpu,
                index.clone(),
                DisplayAttribute::indexed(Attribute::White, [0.0; 2], [0, 255]),
                u64::MAX,
            )
            .unwrap();
            let mut effects = Effects::default();
            effects.shadows.switch = Switch::On;
            effects.shadows.settings = Settings { samples, radius: 1.0, ..Settings::default() };
            let marks = |gpu: &mut Gpu, resident: &Resident, view: &View, anew: bool| {
                let mut g = Graph::new(gpu);
                if anew {
                    ["light visibility", "light visibility beside"]
                        .iter()
                        .for_each(|name| g.invalidate(name));
                }
                let scene = FrameContext::of(view, resident, light);
                let marks = shadows::light_visibility(
                    &mut g,
                    &scene,
                    resident,
                    &effects,
                    &effects.decide(&scene),
                    None,
                )
                .unwrap()
                .expect("switched on");
                let counts = g.download_buffer(&marks.counts);
                let frame = g.submit_and_wait(&[]).unwrap();
                let pages = frame.read::<u8>(&counts).chunks_exact(POINTS_PER_PAGE as usize);
                let of_nodes: Vec<Vec<u8>> = resident
                    .nodes
                    .iter()
                    .zip(pages)
                    .map(|(node, page)| page[..node.count as usize].to_vec())
                    .collect();
                (marks.facts, of_nodes)
            };
            let (mut partly, mut dark) = (0, false);
            for step in 0..10u64 {
                let eye = DVec3::new(
                    middle.x - 10.0 + 8.0 * (step / 5) as f64,
                    middle.y - 300.0,
                    high.z + 250.0,
                );
                let view = View::new(perspective(eye, middle, 60.0), [320, 200]).unwrap();
                let detail = Detail {
                    budget: 1_300_000 + 120_000 * step,
                    lod_px: 0.0,
                    ..Detail::of([320, 200])
                };
                residency.wait_until_resident(gpu, &view, &detail, &Silent).unwrap();
                let resident = residency.resident();
                let (facts, found) = marks(gpu, resident, &view, false);
                let (all, expected) = marks(gpu, resident, &view, true);
                assert_eq!(
                    (all.tested as usize, facts.cast, facts.size),
                    (resident.nodes.len(), samples as u32, all.size)
                );
                assert!(
                    found == expected,
                    "step {step}, {light}: {} of {} nodes tested again",
                    facts.tested,
                    all.tested
                );
                println!(
                    "step {step}: {} of {} nodes tested again ({facts})",
                    facts.tested, all.tested
                );
                partly += (facts.tested > 0 && facts.tested < all.tested) as u32;
                dark |= found.iter().flatten().any(|&count| count == 0);
            }
            assert!(partly >= 2 && dark, "{light}: {partly} steps kept marks");
        });
    }
}

/// Returns for each picture of a light, the largest first and each half as wide and high as the one
/// before, the depths that it begins with, the depths with gaps closed, and how deep light reaches.
fn reached(gpu: &mut Gpu, view: &View, keys: &[[u32; 2]], layer: &Layer) -> Vec<[Vec<f32>; 3]> {
    let raw: Vec<f32> = keys
        .iter()
        .map(|[id, z]| if *id == u32::MAX { f32::INFINITY } else { f32::from_bits(*z) })
        .collect();
    let mut g = Graph::new(gpu);
    let uploaded = g.upload("keys", keys).unwrap();
    let reached = shadows::reach(&mut g, view, &uploaded, layer);
    assert_eq!(reached.filled.is_some(), layer.fill > 0);
    let (mut picture, mut depth, mut downloads) = (Some(&reached), None, Vec::new());
    while let Some(Reached { filled, limit, coarser, .. }) = picture {
        downloads.push(
            [depth, filled.as_ref(), Some(limit)]
                .map(|buffer| buffer.map(|buffer| g.download_buffer(buffer))),
        );
        (depth, picture) = coarser
            .as_ref()
            .map_or((None, None), |(depth, reached)| (Some(depth), Some(&**reached)));
    }
    let frame = g.submit_and_wait(&[]).unwrap();
    let read = |download: &Option<Buffer>| {
        download.as_ref().map_or(raw.clone(), |buffer| frame.read(buffer).to_vec())
    };

    downloads.iter().map(|buffers| buffers.each_ref().map(read)).collect()
}

/// Tests whether a point lies within `fill` texels of a texel, in rows of `width`.
fn near_a_point(depth: &[f32], width: usize, fill: u32, i: usize) -> bool {
    let span =
        |at: usize, end: usize| at.saturating_sub(fill as usize)..(at + fill as usize + 1).min(end);
    span(i / width, depth.len() / width)
        .any(|y| span(i % width, width).any(|x| depth[y * width + x].is_finite()))
}

#[test]
fn light_passes_agree_with_f64() {
    gpu::with(Way::Compute64, |gpu| {
        let mut random = Random(0x11647);
        let (mut taken, mut kept) = (0, 0);
        for size in [[1, 1], [1, 67], [67, 1], [131, 77]] {
            for camera in
                [perspective(DVec3::ZERO, DVec3::X, 70.0), orthographic(DVec3::ZERO, DVec3::X, 3.0)]
            {
                // With thin layers slopes between texels count, too.
                for (fill, texels, halvings) in [
                    (0, None, 0),
                    (1, None, 0),
                    (1, Some(0.02), 2),
                    (1, Some(0.3), 0),
                    (2, None, 3),
                ] {
                    let view = View::new(camera, size).unwrap();
                    let settings = Settings { fill: fill as f64, ..Settings::default() };
                    let usual = Layer::new(&view, (DVec3::ZERO, DVec3::ONE), &settings);
                    let own =
                        Layer { metres: 0.001, texels: texels.unwrap_or(usual.texels), ..usual };
                    // Surfaces up to a depth of five are sparse, and up to half of it after
                    // halving.
                    let layer = Layer {
                        halvings,
                        spacing_m: if own.perspective {
                            5.01 * shadows::cameras::SPARSE * own.texel
                        } else {
                            1.0
                        },
                        ..own
                    };
                    let mut keys = random_keys(size, 1000, &mut random);
                    // Whole tiles have no point.
                    keys.iter_mut()
                        .enumerate()
                        .filter(|(i, _)| i % size[0] as usize >= 80)
                        .for_each(|(_, key)| *key = [u32::MAX; 2]);
                    let pictures = reached(gpu, &view, &keys, &layer);
                    assert_eq!(pictures.len(), 1 + halvings as usize);
                    let (mut size, mut layer) = (size, layer);
                    for (number, [depth, front, joined]) in pictures.iter().enumerate() {
                        let keys: Vec<_> = depth
                            .iter()
                            .map(|z| if z.is_finite() { [1, z.to_bits()] } else { [u32::MAX; 2] })
                            .collect();
                        // The same picture by itself.
                        let alone = reached(
                            gpu,
                            &View::new(camera, size).unwrap(),
                            &keys,
                            &Layer { halvings: 0, ..layer },
                        );
                        let [_, filled, limit] = &alone[0];
                        let [width, half] = [size[0] as usize, size[0].div_ceil(2) as usize];
                        // The reach of light does not matter where no point is.
                        for i in (0..depth.len()).filter(|&i| near_a_point(depth, width, fill, i)) {
                            let possible = match fill {
                                0 => vec![depth[i]],
                                1 => oracle::fill(size, &layer, 0, depth, i),
                                // Results of earlier steps are not available.
                                _ => vec![filled[i]],
                            };
                            assert!(
                                possible.contains(&filled[i]),
                                "{size:?} {i}: filled {} of {possible:?}",
                                filled[i]
                            );
                            let bounds = oracle::limit(size, &layer, filled, i);
                            let holds = bounds.is_empty() && limit[i] == f32::INFINITY
                                || bounds.iter().any(|bound| bound.holds(limit[i]));
                            assert!(holds, "{size:?} {i}: limit {} of {bounds:?}", limit[i]);
                            let parent = i / width / 2 * half + i % width / 2;
                            // A halved picture is known where the finer one has something sparse.
                            let is_known = number == 0 || front[i].is_finite();
                            let coarser = pictures
                                .get(number + 1)
                                .map(|[_, front, joined]| (front[parent], joined[parent]));
                            let taken_from = coarser
                                .filter(|&(z, reach)| z < layer.sparse_m() && reach < limit[i]);
                            if is_known {
                                assert_eq!(
                                    (front[i], joined[i]),
                                    taken_from.unwrap_or((filled[i], limit[i])),
                                    "{size:?} {i}, halved {number} times"
                                );
                            }
                            taken += taken_from.is_some() as usize;
                            kept += (coarser.is_some() && taken_from.is_none()) as usize;
                        }
                        if let Some([halved, ..]) = pictures.get(number + 1) {
                            for (k, &z) in halved.iter().enumerate() {
                                let of = (0..4)
                                    .map(|n| [2 * (k % half) + n % 2, 2 * (k / half) + n / 2]);
                                let of = of.filter(|at| at[0] < width && at[1] < size[1] as usize);
                                assert_eq!(
                                    z,
                                    of.map(|at| depth[at[1] * width + at[0]])
                                        .fold(f32::INFINITY, f32::min),
                                    "{size:?} halved {k}"
                                );
                            }
                        }
                        size = size.map(|side| side.div_ceil(2));
                        layer = Layer { texel: 2.0 * layer.texel, ..layer };
                    }
                }
            }
        }
        println!("{taken} texels as a coarser picture has them, {kept} as the finer");
        assert!(taken > 1000 && kept > 1000);
    });
}

#[test]
fn marks_agree_with_f64() {
    let lattice =
        Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };
    let (steps, _) = bumpy(100_000, 20_000, &mut Random(0x5EED));
    let cloud = cloud(vec![part(lattice, &steps, None)]);
    let around = |x, y, z| lattice.offset + DVec3::new(x, y, z);
    for camera in [
        perspective(around(17.0, -23.0, 21.0), lattice.offset, 50.0),
        orthographic(around(5.0, 6.0, 30.0), lattice.offset, 19.0),
    ] {
        gpu::with(Way::Compute64, |gpu| {
            let view = View::new(camera, [331, 257]).unwrap();
            let resident = Resident::fill(
                gpu,
                cloud.clone(),
                DisplayAttribute::new(Attribute::White, &cloud),
                &Silent,
            )
            .unwrap();
            let mut g = Graph::new(gpu);
            let counts =
                g.buffer("light visibility", resident.nodes.len() as u64 * POINTS_PER_PAGE as u64);
            let mut tally = shadows::Tally::new(&mut g, counts, false);
            let sight = LightCamera { view, margin: 0, halvings: 0, spacing_m: 0.0 };
            let reached = shadows::cast(
                &mut g,
                &sight,
                &resident,
                bounds(&resident),
                &Settings::default(),
                &mut tally,
            )
            .unwrap();
            let (counts, limit) =
                (g.download_buffer(&tally.light_visibility), g.download_buffer(&reached.limit));
            let frame = g.submit_and_wait(&[]).unwrap();
            let (counts, limit): (&[u8], &[f32]) = (frame.read(&counts), frame.read(&limit));
            let source = project::Source::new(&cloud.parts[0], &view, Precision::Auto, DVec3::ZERO);
            let ids = resident.nodes.iter().flat_map(|node| {
                (0..node.count).map(|i| (node.number * POINTS_PER_PAGE + i) as usize)
            });
            let (mut agreeing, mut in_band, mut lit) = (0, 0, 0);
            for (p, id) in resident.positions(gpu).unwrap().into_iter().zip(ids) {
                let footprint = project::footprint(&view, &source, p - camera.eye);
                let columns = footprint.map(|f| f.x.map(|x| x.floor() as i64));
                let rows = footprint.map(|f| f.y.map(|y| y.floor() as i64));
                let mut possible = [false; 2];
                if let (Some(f), Some([left, right]), Some([top, bottom])) =
                    (footprint, columns, rows)
                {
                    for (x, y) in (top..=bottom).flat_map(|y| (left..=right).map(move |x| (x, y))) {
                        let inside = (0..331).contains(&x) && (0..257).contains(&y);
                        let limit = if inside {
                            limit[(y * 331 + x) as usize] as f64
                        } else {
                            f64::NEG_INFINITY
                        };
                        possible[1] |= f.z[0] <= limit;
                        possible[0] |= f.z[1] > limit;
                    }
                } else {
                    possible[0] = true;
                }
                lit += counts[id] as usize;
                assert!(
                    counts[id] < 2 && possible[counts[id] as usize],
                    "{p}: {} of {possible:?}",
                    counts[id]
                );
                if possible == [true; 2] { in_band += 1 } else { agreeing += 1 }
            }
            println!("{:?}: {agreeing} agree, {in_band} in the band, {lit} lit", camera.projection);
            assert!(in_band < 200 && lit > 10_000, "{in_band} in the band, {lit} lit");
        });
    }
}

/// Light passes run when the light, the nodes or a setting has changed, and only then. What is kept
/// equals what was computed.
#[test]
fn marks_are_kept_while_light_and_nodes_stay() {
    let cloud = Ring::new().cloud(20_000);
    let sun = Light::Direction(DVec3::new(0.5, 0.3, -0.8));
    gpu::with(Way::Compute64, |gpu| {
        let shown = DisplayAttribute::new(Attribute::White, &cloud);
        let mut resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
        let view = |preset| {
            View::new(Camera::framing(preset, &cloud.core_points(), [64, 64]), [64, 64]).unwrap()
        };
        let mut settings = RenderSettings { light: sun, ..RenderSettings::points() };
        settings.effects.set_any("shadows=on").unwrap();
        let draw =
            |gpu: &mut Gpu, resident: &Resident, preset: Preset, settings: &RenderSettings| {
                let view = view(preset);
                let config = FrameConfig::new(settings, &view, resident);
                let mut g = Graph::new(gpu);
                let outcome = frame::record(&mut g, &view, resident, &config).unwrap();
                let picture = g.download(&outcome.picture);
                let frame = g.submit_and_wait(&[]).unwrap();
                let cast = frame.passes.iter().any(|(name, _)| name == "shadow_test");
                let picture: Vec<[u32; 4]> = frame.read(&picture).to_vec();
                (cast, picture)
            };
        let (cast, first) = draw(gpu, &resident, Preset::Fit, &settings);
        assert!(cast, "the first frame casts");
        assert_eq!(
            draw(gpu, &resident, Preset::Fit, &settings),
            (false, first.clone()),
            "nothing has changed"
        );
        assert!(!draw(gpu, &resident, Preset::Iso, &settings).0, "the camera is not the light");
        let mut darker = settings.clone();
        darker.effects.set_any("shadows=on,ambient=0.1").unwrap();
        assert!(
            !draw(gpu, &resident, Preset::Fit, &darker).0,
            "how dark shadows are is not what is in them"
        );
        assert!(
            draw(
                gpu,
                &resident,
                Preset::Fit,
                &RenderSettings { light: Light::Direction(DVec3::NEG_Z), ..settings.clone() }
            )
            .0,
            "another light"
        );
        assert_eq!(draw(gpu, &resident, Preset::Fit, &settings), (true, first.clone()), "and back");
        resident.opacities = Opacities(vec!["class:1=0".parse().unwrap()]);
        assert!(
            draw(gpu, &resident, Preset::Fit, &settings).0,
            "points that are left out cast none"
        );
        resident.opacities = Opacities::default();
        assert_eq!(
            draw(gpu, &resident, Preset::Fit, &settings),
            (true, first.clone()),
            "and with them again"
        );
        resident.nodes[0].count -= 1;
        assert!(draw(gpu, &resident, Preset::Fit, &settings).0, "another node");
        let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
        assert_eq!(
            draw(gpu, &resident, Preset::Fit, &settings),
            (true, first),
            "another cloud, if with the same points"
        );
    });
}
