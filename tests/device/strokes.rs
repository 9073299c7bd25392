//! What a brush needs to know of points, against analytic truth. The result is the same for any
//! number of threads and order of the file.

mod tangents;

use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::{Cloud, Columns, Part};
use pointillist::index::attributes::strokes::{Stroke, householder, strokes};
use pointillist::progress::Silent;
use pointillist::synth::{self, SceneKind};

fn scene(scene: SceneKind, points: u64, noise: f64) -> Cloud {
    synth::collect("scene", &synth::build(scene, 1, 0.1), points, 3, noise, &Silent).unwrap()
}

fn world_of(part: &Part, i: usize) -> DVec3 {
    part.lattice.world([part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from))
}

/// Returns the sorted angles between strokes' normals and the torus's own in degrees, and how many
/// normals are unknown.
fn angles(part: &Part, strokes: &[Stroke], center: DVec3) -> (Vec<f64>, usize) {
    let truth = |p: DVec3| {
        let p = p - center;
        let ring = DVec3::new(p.x, p.y, 0.0).normalize();
        (p - ring).normalize()
    };
    let known = strokes.iter().enumerate().filter_map(|(i, stroke)| Some((i, stroke.plane?)));
    let mut angles: Vec<f64> = known
        .map(|(i, plane)| {
            plane.normal.cross(truth(world_of(part, i))).length().min(1.0).asin().to_degrees()
        })
        .collect();
    angles.sort_by(f64::total_cmp);
    let unknown = strokes.len() - angles.len();
    (angles, unknown)
}

#[test]
fn normals_of_a_torus_are_within_a_degree_and_with_noise_within_five() {
    // The torus of radii 1 and 0.4 has 15.8 square metres, so points are 12.6 mm apart.
    let (count, spacing) = (100_000, 0.0126);
    for (noise, most) in [(0.0, 1.0), (spacing / 4.0, 5.0)] {
        let cloud = scene(SceneKind::Torus, count, noise);
        let part = &cloud.parts[0];
        let (lo, hi) = part.bounds().unwrap();
        let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
        let (angles, unknown) = angles(part, &found, (lo + hi) / 2.0);
        let [median, p99] =
            [0.5, 0.99].map(|share| angles[((angles.len() - 1) as f64 * share) as usize]);
        println!("noise {noise}: median {median:.3} degrees, 99 % {p99:.3}, unknown {unknown}");
        assert!(median < most, "{median} degrees");
        assert_eq!(unknown, 0);
        let mut radii: Vec<f64> = found.iter().map(|stroke| stroke.radius_m).collect();
        radii.sort_by(f64::total_cmp);
        println!(
            "radius: median {:.5}, largest {:.5}",
            radii[radii.len() / 2],
            radii[radii.len() - 1]
        );
    }
}

/// Compares with the surfaces that scanners' rays hit, leaves, bars and corners included.
#[test]
fn normals_of_a_street_are_within_a_degree_and_with_noise_within_five() {
    let world = synth::build(SceneKind::Street, 1, 0.1);
    let mut spacing = 0.0;
    for (share, most) in [(0.0, 1.0), (0.25, 5.0)] {
        let noise = share * spacing;
        let cloud = scene(SceneKind::Street, 300_000, noise);
        let part = &cloud.parts[0];
        let (sources, stations) = (part.columns.source.as_ref().unwrap(), world.stations());
        // Noise is along the rays.
        let truth = |i: usize| {
            let eye = stations[sources[i] as usize - 1].position;
            let to = world_of(part, i) - world.offset - eye;
            world
                .trace(eye, to)
                .filter(|hit| ((hit.t - 1.0) * to.length()).abs() < 0.001 + 6.0 * noise)
                .map(|hit| hit.normal)
        };
        let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
        let known = found
            .iter()
            .enumerate()
            .filter_map(|(i, stroke)| Some((stroke.plane?.normal, truth(i)?)));
        let mut angles: Vec<f64> = known
            .map(|(found, truth)| found.cross(truth).length().min(1.0).asin().to_degrees())
            .collect();
        angles.sort_by(f64::total_cmp);
        let (median, undefined) = (
            angles[angles.len() / 2],
            found.iter().filter(|stroke| stroke.plane.is_none()).count(),
        );
        println!(
            "noise of {noise:.4} m: median {median:.3} degrees, of {} points; {undefined} have no normal",
            angles.len()
        );
        assert!(
            10 * angles.len() > 9 * found.len() && median < most,
            "{median} degrees, of {} points",
            angles.len()
        );
        let mut radii: Vec<f64> = found.iter().map(|stroke| stroke.radius_m).collect();
        radii.sort_by(f64::total_cmp);
        spacing = radii[radii.len() / 2];
    }
}

#[test]
fn hard_18_points_on_a_line_have_no_normal_and_a_single_point_the_least_radius() {
    let mut cloud = scene(SceneKind::Plane, 2000, 0.0);
    let part = &mut cloud.parts[0];
    part.columns = Columns {
        x: (0..2000).map(|i| 10 * i).collect(),
        y: vec![0; 2000],
        z: vec![5; 2000],
        ..Columns::default()
    };
    assert!(
        strokes(&part.columns, &part.lattice, &Silent)
            .unwrap()
            .iter()
            .all(|stroke| stroke.plane.is_none())
    );
    part.columns =
        Columns { x: vec![1; 3000], y: vec![2; 3000], z: vec![3; 3000], ..Columns::default() };
    let step = part.lattice.step.x;
    assert!(
        strokes(&part.columns, &part.lattice, &Silent)
            .unwrap()
            .iter()
            .all(|stroke| stroke.plane.is_none() && stroke.radius_m == step / 2.0)
    );
    part.columns = Columns::default();
    assert!(strokes(&part.columns, &part.lattice, &Silent).unwrap().is_empty());
}

fn words(part: &Part) -> Vec<[u32; 2]> {
    let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
    found
        .iter()
        .enumerate()
        .map(|(i, stroke)| stroke.words([part.columns.x[i], part.columns.y[i], part.columns.z[i]]))
        .collect()
}

#[test]
fn strokes_do_not_depend_on_threads() {
    let cloud = scene(SceneKind::Street, 60_000, 0.002);
    let [one, three] = [1, 3].map(|threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| words(&cloud.parts[0]))
    });
    assert!(one == three);
}

#[test]
fn hard_19_tangents_are_orthonormal_over_the_sphere_and_up_to_its_pole() {
    let check = |n: DVec3| {
        let (t, b) = householder(n);
        let worst = [
            t.dot(n),
            b.dot(n),
            t.dot(b),
            t.length() - 1.0,
            b.length() - 1.0,
            t.cross(b).dot(n) - 1.0,
        ]
        .into_iter()
        .fold(0.0f64, |worst, e| worst.max(e.abs()));
        assert!(worst < 1e-14, "{n}: {worst}");
    };
    for k in 0..20_000 {
        // A spiral from pole to pole.
        let (z, turn) = (1.0 - 2.0 * (k as f64 + 0.5) / 20_000.0, k as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        check(DVec3::new(z, r * turn.cos(), r * turn.sin()));
    }
    for power in 1..=150 {
        let far = 10f64.powi(-power);
        check(DVec3::new(-1.0, far, 0.3 * far).normalize());
    }
    check(DVec3::NEG_X);
    check(DVec3::X);
}

/// Pictures of painted points.
mod painted {
    use super::*;
    use crate::gpu;
    use pointillist::cloud::attribute::DisplayAttribute;
    use pointillist::cloud::colormap::linear_to_srgb;
    use pointillist::cloud::{self, ReadOptions};
    use pointillist::graph::{Gpu, Graph};
    use pointillist::passes::Effects;
    use pointillist::passes::strokes::Facts;
    use pointillist::render::frame;
    use pointillist::render::settings::{FrameConfig, RenderSettings, Style};
    use pointillist::resident::Resident;
    use pointillist::select::opacity::Opacities;
    use pointillist::study::mesh::Mesh;
    use pointillist::study::oracle::strokes as oracle;
    use pointillist::study::truth::{Surface, Truth};
    use pointillist::view::{Camera, Preset, Projection, View};

    struct Painted {
        picture: Vec<[f32; 4]>,
        depth: Vec<f32>,
        facts: Facts,
    }

    fn resident(gpu: &mut Gpu, cloud: &Cloud) -> Resident {
        let (mut shown, _) = DisplayAttribute::automatic(cloud);
        (shown.further.strokes, shown.further.kind) = (true, true);
        Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap()
    }

    fn config(view: &View, resident: &Resident, effect: &str) -> FrameConfig {
        let mut settings = RenderSettings {
            effects: Effects::of(Style::Strokes),
            background: [0; 3],
            ..RenderSettings::default()
        };
        [effect, "edl=off"].iter().for_each(|effect| settings.effects.set_any(effect).unwrap());
        FrameConfig::new(&settings, view, resident)
    }

    fn paint(cloud: &Cloud, view: &View, effect: &str) -> Painted {
        paint_through(cloud, view, effect, &[])
    }

    /// Paints a cloud whose points are not all opaque.
    fn paint_through(cloud: &Cloud, view: &View, effect: &str, opacities: &[&str]) -> Painted {
        gpu::with(gpu::Way::Compute64, |gpu| {
            let mut resident = resident(gpu, cloud);
            resident.opacities =
                Opacities(opacities.iter().map(|rule| rule.parse().unwrap()).collect());
            paint_resident(gpu, &resident, view, effect)
        })
    }

    fn paint_resident(gpu: &mut Gpu, resident: &Resident, view: &View, effect: &str) -> Painted {
        let config = config(view, resident, effect);
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, resident, &config).unwrap();
        let [picture, depth] =
            [&outcome.picture, &outcome.gbuffer.depth].map(|image| g.download(image));
        let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");
        Painted {
            picture: frame.read(&picture).to_vec(),
            depth: frame.read(&depth).to_vec(),
            facts: outcome.strokes.unwrap().facts,
        }
    }

    fn torus(points: u64) -> (Cloud, View) {
        let cloud = scene(SceneKind::Torus, points, 0.0);
        let view =
            View::new(Camera::framing(Preset::Iso, &cloud.core_points(), [161, 120]), [161, 120])
                .unwrap();
        (cloud, view)
    }

    fn bits(picture: &[[f32; 4]]) -> &[u32] {
        bytemuck::cast_slice(picture)
    }

    /// Returns the root of the mean square over all channels.
    fn error(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
        let squares = a
            .iter()
            .flatten()
            .zip(b.iter().flatten())
            .map(|(a, b)| (*a as f64 - *b as f64).powi(2));
        (squares.sum::<f64>() / (4 * a.len()) as f64).sqrt()
    }

    #[test]
    fn hard_16_every_pass_of_the_a_buffer_is_nearer_to_the_exact_sort_and_the_last_is_the_same() {
        let (cloud, view) = torus(6000);
        let exact = paint(&cloud, &view, "strokes=on,blend=abuffer,sort=exact");
        let deepest = exact.facts.deepest;
        assert!(deepest > 4 && exact.facts.fragments > 20_000, "{:?}", exact.facts);
        let mut before = f64::INFINITY;
        for passes in [1, 2, 4, 8, 16, deepest - 1] {
            let bubble = paint(
                &cloud,
                &view,
                &format!("strokes=on,blend=abuffer,sort=bubble,passes={passes}"),
            );
            assert_eq!(bubble.facts.fragments, exact.facts.fragments);
            let now = error(&bubble.picture, &exact.picture);
            println!("{passes} of {deepest} passes: {now:.6}");
            assert!(now < before || now == 0.0, "{passes} passes: {now} after {before}");
            before = now;
        }
        let settled = paint(&cloud, &view, "strokes=on,blend=abuffer,sort=bubble");
        assert!(
            bits(&settled.picture) == bits(&exact.picture),
            "a sorted picture is the sorted picture"
        );
    }

    /// A frame of a picture at rest.
    struct Frame {
        picture: Vec<[f32; 4]>,
        /// Strokes were sought, and their fragments counted and made.
        painted: bool,
        /// More frames change nothing.
        settled: bool,
        facts: Facts,
    }

    fn draw(
        gpu: &mut Gpu,
        view: &View,
        resident: &Resident,
        effect: &str,
        at_once: Option<u32>,
    ) -> Frame {
        let config = FrameConfig { strokes_at_once: at_once, ..config(view, resident, effect) };
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, resident, &config).unwrap();
        let (picture, strokes) = (g.download(&outcome.picture), outcome.strokes.unwrap());
        let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");

        Frame {
            picture: frame.read(&picture).to_vec(),
            painted: frame.passes.iter().any(|(name, _)| name == "stroke_fragments"),
            settled: strokes
                .unordered
                .is_none_or(|unordered| frame.read::<u32>(&unordered)[0] == 0),
            facts: strokes.facts,
        }
    }

    /// Draws frames as a window does, until one is settled.
    fn rest(
        gpu: &mut Gpu,
        view: &View,
        resident: &Resident,
        effect: &str,
        at_once: u32,
    ) -> Vec<Frame> {
        let mut frames: Vec<Frame> = Vec::new();
        while frames.last().is_none_or(|frame| !frame.settled) {
            assert!(frames.len() < 1000, "frames never stop");
            frames.push(draw(gpu, view, resident, effect, Some(at_once)));
        }
        frames
    }

    #[test]
    fn hard_16_at_rest_every_frame_is_nearer_to_the_exact_sort_and_the_last_one_is_it() {
        let (cloud, view) = torus(6000);
        gpu::with(gpu::Way::Compute64, |gpu| {
            let resident = resident(gpu, &cloud);
            for effect in [
                "strokes=on",
                "strokes=on,order=stroke,brush=bristles",
                "strokes=on,sort=bubble,passes=5",
            ] {
                let exact = draw(gpu, &view, &resident, effect, None);
                for at_once in [1, 4] {
                    let frames = rest(gpu, &view, &resident, effect, at_once);
                    let errors: Vec<f64> =
                        frames.iter().map(|frame| error(&frame.picture, &exact.picture)).collect();
                    println!(
                        "{effect}, {at_once} a frame, {} fragments in a pixel at most: {errors:.5?}",
                        exact.facts.deepest
                    );
                    assert!(
                        errors.windows(2).all(|pair| pair[1] < pair[0]),
                        "{effect}: {errors:?}"
                    );
                    assert!(
                        frames.len() > 1
                            && frames.len() <= exact.facts.deepest.div_ceil(at_once) as usize
                    );
                    assert!(
                        bits(&frames.last().unwrap().picture) == bits(&exact.picture),
                        "{effect}, {at_once}"
                    );
                    // Counted and painted once, and known from then on.
                    assert!(
                        frames
                            .iter()
                            .enumerate()
                            .all(|(number, frame)| frame.painted == (number == 0)),
                        "{effect}, {at_once}"
                    );
                    let counts = |facts: &Facts| {
                        (facts.listed, facts.fragments, facts.hidden, facts.deepest, facts.parts)
                    };
                    assert!(
                        frames.iter().all(|frame| counts(&frame.facts) == counts(&exact.facts)),
                        "{effect}, {at_once}"
                    );
                    // A further frame for another panel changes nothing. Later ones begin anew.
                    let more = draw(gpu, &view, &resident, effect, Some(at_once));
                    assert!(
                        !more.painted
                            && more.settled
                            && bits(&more.picture) == bits(&exact.picture),
                        "{effect}, {at_once}"
                    );
                    assert!(draw(gpu, &view, &resident, "strokes=on,noise=7", Some(1)).painted);
                }
            }
        });
    }

    #[test]
    fn an_a_buffer_is_kept_while_view_points_and_settings_stay() {
        let (cloud, view) = torus(6000);
        gpu::with(gpu::Way::Compute64, |gpu| {
            let mut resident = resident(gpu, &cloud);
            let other = View::new(
                Camera { eye: view.camera.eye + DVec3::new(0.1, 0.0, 0.0), ..view.camera },
                view.size,
            )
            .unwrap();
            let smaller = View::new(view.camera, [80, 60]).unwrap();
            let effect = "strokes=on";
            let settled = |gpu: &mut Gpu, resident: &Resident, view: &View, effect: &str| {
                let frames = rest(gpu, view, resident, effect, 6);
                assert!(
                    bits(&frames.last().unwrap().picture)
                        == bits(&draw(gpu, view, resident, effect, None).picture),
                    "{effect}"
                );
                frames[0].painted
            };
            assert!(settled(gpu, &resident, &view, effect), "the first time");
            assert!(!settled(gpu, &resident, &view, effect), "nothing has changed");
            // These settings do not change a fragment.
            assert!(!settled(gpu, &resident, &view, "strokes=on,radius=5,memory=600"));
            // Strokes that hide each other, drawn while the camera moves, leave what is kept alone.
            draw(gpu, &other, &resident, "strokes=on,blend=blur", Some(6));
            assert!(!settled(gpu, &resident, &view, effect));
            for view in [&other, &smaller, &view] {
                assert!(settled(gpu, &resident, view, effect), "another view");
            }
            for effect in [
                "strokes=on,size=2.5",
                "strokes=on,order=stroke",
                "strokes=on,tangents=eberly",
                effect,
            ] {
                assert!(settled(gpu, &resident, &view, effect), "{effect}");
            }
            resident.opacities = Opacities(vec!["0.5".parse().unwrap()]);
            assert!(settled(gpu, &resident, &view, effect), "other opacities");
            resident.opacities = Opacities::default();
            assert!(settled(gpu, &resident, &view, effect), "and back");
            resident.nodes[0].count -= 1;
            assert!(settled(gpu, &resident, &view, effect), "a point less");
            // Fragments beyond the memory are not kept. They are painted whole, part by part.
            let parts = draw(gpu, &view, &resident, "strokes=on,size=6,memory=1", Some(1));
            assert!(parts.facts.parts > 1 && parts.settled, "{:?}", parts.facts);
            assert!(
                bits(&parts.picture)
                    == bits(&draw(gpu, &view, &resident, "strokes=on,size=6", None).picture)
            );
        });
    }

    /// A pixel has a few hundred strokes, or each stroke touches every tile. lavapipe ends all
    /// loops of an invocation together after 65,535 rounds, which has lost some of both.
    #[test]
    fn hard_16_no_stroke_of_a_crowded_tile_is_lost_and_none_that_touches_many() {
        let cloud = scene(SceneKind::NestedTori, 80_000, 0.0);
        let view =
            View::new(Camera::framing(Preset::Fit, &cloud.core_points(), [17, 13]), [17, 13])
                .unwrap();
        let part = &cloud.parts[0];
        let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
        for effect in ["strokes=on", "strokes=on,order=stroke,sort=bubble"] {
            let mut effects = Effects::default();
            effects.set_any(effect).unwrap();
            let settings = &effects.strokes.settings;
            // Points that are not opaque hide none wholly.
            for (rules, opacity) in [(&[][..], 1.0), (&["0.9"], 0.9)] {
                let painted = paint_through(&cloud, &view, effect, rules);
                let facts = painted.facts;
                let counted = oracle::fragments(&view, settings, part, &found, &|_| opacity);
                println!("{effect}, opacity {opacity}: {counted} fragments; {facts}");
                assert!(facts.listed > 8 * 8192 && (facts.hidden > 0) == (opacity == 1.0));
                // Faint traces may be rounded away.
                assert!(
                    (facts.fragments + facts.hidden).abs_diff(counted) < counted / 1000,
                    "{counted}: {facts}"
                );
                let agreement = oracle::compare(
                    &oracle::paint(&view, settings, part, &found, &|_| opacity),
                    &painted.picture,
                    &painted.depth,
                );
                assert!(
                    agreement.pixels > 20 && agreement.color_off == 0,
                    "{effect}: {agreement:?}"
                );
            }
        }

        // The counts equal those of small windows of the picture, up to roundings.
        let cloud = scene(SceneKind::Plane, 600, 0.0);
        let view =
            View::new(Camera::framing(Preset::Top, &cloud.core_points(), [320, 256]), [320, 256])
                .unwrap();
        let listed =
            |view: &View| paint(&cloud, view, "strokes=on,size=32,largest=1.6").facts.listed;
        let corners = (0..4).flat_map(|y| (0..4).map(move |x| [80 * x, 64 * y]));
        let [whole, windows] =
            [listed(&view), corners.map(|corner| listed(&view.window(corner, [80, 64]))).sum()];
        println!("{whole} in the lists of tiles, {windows} in those of windows");
        assert!(whole > 600 * 100 && whole.abs_diff(windows) < whole / 1000, "{whole}, {windows}");
    }

    /// The one is rasterised, the other drawn by tiles. Both know the nearest opaque stroke, with
    /// the same bits.
    #[test]
    fn z_buffered_strokes_are_as_deep_as_those_of_an_a_buffer() {
        let (cloud, view) = torus(6000);
        let target = view.camera.target;
        let inside = cloud.core_points().iter().fold(DVec3::splat(f64::INFINITY), |least, p| {
            if p.distance(target) < least.distance(target) { *p } else { least }
        });
        let cameras = [
            view.camera,
            Camera { projection: Projection::Orthographic, ortho_height: Some(3.0), ..view.camera },
            // Among the strokes, where some reach behind the camera.
            Camera { eye: inside + DVec3::new(0.02, 0.01, 0.03), ..view.camera },
            // Along the surface.
            Camera { eye: target + DVec3::new(4.0, 0.0, 0.02), ..view.camera },
        ];
        for (number, camera) in cameras.into_iter().enumerate() {
            for (size, effect) in [
                ([161, 120], "strokes=on"),
                ([97, 113], "strokes=on,size=24,long=1"),
                ([64, 64], "strokes=on,brush=ribbons,size=0.4"),
            ] {
                let view = View::new(camera, size).unwrap();
                let [blended, nearest] = ["abuffer", "opaque"]
                    .map(|blend| paint(&cloud, &view, &format!("{effect},blend={blend}")));
                let shown: Vec<_> = blended
                    .depth
                    .iter()
                    .zip(&nearest.depth)
                    .filter(|(_, z)| z.is_finite())
                    .collect();
                println!("camera {number}, {effect}: {} pixels", shown.len());
                assert!(
                    shown.len() > 100 && shown.iter().all(|(a, b)| a.to_bits() == b.to_bits()),
                    "camera {number}, {effect}"
                );
                let hidden = blended
                    .picture
                    .iter()
                    .zip(&nearest.depth)
                    .filter(|(color, z)| !z.is_finite() && color[3] > 0.99)
                    .count();
                assert!(
                    hidden < size[0] as usize * size[1] as usize / 100,
                    "camera {number}, {effect}: {hidden} pixels that only the A-buffer has"
                );
            }
        }
    }

    #[test]
    fn memory_bounds_how_much_is_painted_at_once_and_changes_no_pixel() {
        let (cloud, view) = torus(60_000);
        // The strokes of a single tile are more than the memory holds, too.
        let far = View::new(view.camera, [17, 13]).unwrap();
        for (view, effect) in [
            (&view, "strokes=on,blend=abuffer"),
            (&view, "strokes=on,blend=opaque"),
            (&far, "strokes=on,blend=abuffer"),
            (&far, "strokes=on,blend=opaque"),
        ] {
            let whole = paint(&cloud, view, effect);
            let parts = paint(&cloud, view, &format!("{effect},memory=1"));
            println!("{effect}: {}; {}", whole.facts, parts.facts);
            assert!(whole.facts.parts == 1 && parts.facts.parts > 1);
            assert!(parts.facts.bytes <= 1 << 20, "{:?}", parts.facts);
            assert_eq!(
                (parts.facts.listed, parts.facts.fragments),
                (whole.facts.listed, whole.facts.fragments)
            );
            assert!(bits(&parts.picture) == bits(&whole.picture));
        }
    }

    /// Counts of pixels whose rays hit a surface, of those that no stroke covers, and of covered
    /// pixels more than three away from it.
    #[derive(Debug)]
    struct Coverage {
        surface: usize,
        holes: usize,
        beyond: usize,
    }

    fn coverage(
        view: &View,
        painted: &Painted,
        inside: &[bool],
        hits: impl Fn(DVec3, DVec3) -> bool + Sync,
    ) -> Coverage {
        let [width, height] = view.size.map(i64::from);
        // Nearby pixels count by their centres. Where those miss, as at the tip of a claw, quarters
        // of a pixel all around count.
        let near = |k: i64| {
            let around = |steps: i64| {
                (-3 * steps..=3 * steps)
                    .flat_map(move |dy| (-3 * steps..=3 * steps).map(move |dx| [dx, dy]))
            };
            let within = |[dx, dy]: &[i64; 2], steps: i64| dx * dx + dy * dy <= 9 * steps * steps;
            let pixel = |[dx, dy]: [i64; 2]| [k % width + dx, k / width + dy];
            let is_inside = |[x, y]: [i64; 2]| {
                (0..width).contains(&x)
                    && (0..height).contains(&y)
                    && inside[(y * width + x) as usize]
            };
            let hit = |[dx, dy]: [i64; 2]| {
                let (origin, direction) = view.ray(
                    (k % width) as f64 + 0.5 + 0.25 * dx as f64,
                    (k / width) as f64 + 0.5 + 0.25 * dy as f64,
                );
                hits(origin, direction)
            };
            around(1).filter(|at| within(at, 1)).map(pixel).any(is_inside)
                || around(4).filter(|at| within(at, 4)).any(hit)
        };
        let covered = |k: i64| painted.picture[k as usize][3] >= 0.5;
        Coverage {
            surface: inside.iter().filter(|inside| **inside).count(),
            holes: (0..width * height).filter(|&k| inside[k as usize] && !covered(k)).count(),
            beyond: (0..width * height)
                .filter(|&k| covered(k) && !inside[k as usize] && !near(k))
                .count(),
        }
    }

    /// Checks coverage from all sides for every brush and blending.
    fn covers(cloud: &Cloud, hits: impl Fn(DVec3, DVec3) -> bool + Sync) {
        gpu::with(gpu::Way::Compute64, |gpu| {
            let resident = resident(gpu, cloud);
            covers_in(cloud, hits, |view, effect| paint_resident(gpu, &resident, view, effect));
        });
    }

    /// Checks coverage in pictures that `paint` makes.
    fn covers_in(
        cloud: &Cloud,
        hits: impl Fn(DVec3, DVec3) -> bool + Sync,
        mut paint: impl FnMut(&View, &str) -> Painted,
    ) {
        let size = [400, 300];
        for preset in [Preset::Iso, Preset::Top, Preset::Front, Preset::Side, Preset::Fit] {
            let view =
                View::new(Camera::framing(preset, &cloud.core_points(), size), size).unwrap();
            let ray = |k: u32| view.ray((k % size[0]) as f64 + 0.5, (k / size[0]) as f64 + 0.5);
            let inside: Vec<bool> = (0..size[0] * size[1])
                .map(ray)
                .map(|(origin, direction)| hits(origin, direction))
                .collect();
            for (blend, brush) in ["abuffer", "blur"]
                .into_iter()
                .flat_map(|blend| ["dabs", "bristles", "ribbons"].map(|brush| (blend, brush)))
            {
                let painted = paint(&view, &format!("strokes=on,blend={blend},brush={brush}"));
                let found = coverage(&view, &painted, &inside, &hits);
                println!(
                    "{preset:?}, {blend}, {brush}, {} points: {found:?}; {}",
                    cloud.len(),
                    painted.facts
                );
                assert!(
                    found.surface > 10_000 && 1000 * found.holes <= found.surface,
                    "{preset:?}, {blend}, {brush}: {found:?}"
                );
                assert!(found.beyond == 0, "{preset:?}, {blend}, {brush}: {found:?}");
            }
        }
    }

    #[test]
    fn a_torus_of_few_points_is_covered_within_its_silhouette_and_three_pixels_beyond() {
        let world = synth::build(SceneKind::Torus, 1, 0.1);
        // A tenth of the 437,645 points of the paper's dragon.
        covers(&scene(SceneKind::Torus, 43_765, 0.0), |origin, direction| {
            world.trace(origin, direction).is_some()
        });
    }

    /// Returns every `every`-th point of the Stanford dragon, and its surface.
    fn dragon(every: usize) -> Option<(Cloud, Mesh)> {
        let path = shared("data/objects/stanford_dragon_437k.ply")?;
        let mesh = Mesh::read(&path, |p| p).unwrap();
        let mut cloud = cloud::read(&[path], &ReadOptions::default(), &Silent).unwrap();
        let columns = &mut cloud.parts[0].columns;
        let some = |values: &[i32]| values.iter().step_by(every).copied().collect();
        *columns = Columns {
            x: some(&columns.x),
            y: some(&columns.y),
            z: some(&columns.z),
            ..Columns::default()
        };
        Some((cloud, mesh))
    }

    #[test]
    fn a_tenth_of_a_dragon_is_covered_within_its_silhouette_and_three_pixels_beyond() {
        let Some((cloud, mesh)) = dragon(10) else { return };
        covers(&cloud, |origin, direction| mesh.first(origin, direction).is_some());
    }

    /// A surface that rays meet.
    struct Met<F>(F);

    impl<F: Fn(DVec3, DVec3) -> Option<f64> + Sync> Surface for Met<F> {
        fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
            self.0(origin, direction)
        }
    }

    /// Counts of pixels more than two from every edge of the surface: all, those with the depth of
    /// what lies behind it, and those with a tenth of its light.
    #[derive(Debug)]
    struct Seen {
        pixels: usize,
        behind: usize,
        light: usize,
    }

    /// Share of a depth by which something is behind, as in `truth`.
    const BEHIND: f64 = 0.005;

    fn seen(
        cloud: &Cloud,
        view: &View,
        effect: &str,
        first: impl Fn(DVec3, DVec3) -> Option<f64> + Sync,
    ) -> Seen {
        let (mut cloud, eye, forward) = (cloud.clone(), view.camera.eye, view.basis.forward);
        let part = &cloud.parts[0];
        // Seen points are red, hidden ones blue.
        let color = |i: usize| {
            let p = world_of(part, i);
            let from = match view.camera.projection {
                Projection::Perspective => eye,
                Projection::Orthographic => p - forward * (p - eye).dot(forward),
            };
            if first(from, p - from).is_some_and(|t| t < 1.0 - BEHIND) {
                [0, 0, 255]
            } else {
                [255, 0, 0]
            }
        };
        let colors = (0..part.columns.len()).map(color).collect();
        cloud.parts[0].columns.rgb = Some(colors);
        // Colours make clusters, which do not matter here.
        let painted = paint(&cloud, view, &format!("{effect},long=0"));
        let truth = Truth::cast(view, &Met(first));
        let mut seen = Seen { pixels: 0, behind: 0, light: 0 };
        for i in (0..truth.depth.len()).filter(|&i| truth.interior[i]) {
            let [red, _, blue, _] = painted.picture[i];
            let depth = painted.depth[i] as f64;
            seen.pixels += 1;
            seen.behind += (depth > truth.within[i][1] + BEHIND * truth.depth[i]) as usize;
            seen.light += (blue > 0.1 * (red + blue)) as usize;
        }
        seen
    }

    #[test]
    fn no_surface_shows_what_lies_behind_it() {
        let torus = |points: u64, size: [u32; 2]| {
            let (world, cloud) =
                (synth::build(SceneKind::Torus, 1, 0.1), scene(SceneKind::Torus, points, 0.0));
            let view =
                View::new(Camera::framing(Preset::Iso, &cloud.core_points(), size), size).unwrap();
            seen(&cloud, &view, "strokes=on", |origin, direction| world.first(origin, direction))
        };
        let dragon = |every: usize, size: [u32; 2]| {
            let (cloud, mesh) = dragon(every)?;
            let view =
                View::new(Camera::framing(Preset::Iso, &cloud.core_points(), size), size).unwrap();
            Some(seen(&cloud, &view, "strokes=on", |origin, direction| {
                mesh.first(origin, direction)
            }))
        };
        // Thousandths. At a tenth of the dragon's points no stroke knows how crests and hollows run
        // between them.
        let all = [
            ("torus", 1, Some(torus(437_645, [960, 600]))),
            ("a tenth of its points", 1, Some(torus(43_765, [400, 300]))),
            ("a tenth of its points, near", 1, Some(torus(43_765, [960, 600]))),
            ("dragon", 1, dragon(1, [960, 600])),
            ("a tenth of its points", 8, dragon(10, [400, 300])),
        ];
        for (name, most, seen) in
            all.into_iter().filter_map(|(name, most, seen)| Some((name, most, seen?)))
        {
            println!("{name}: {seen:?}");
            assert!(
                seen.pixels > 10_000 && 1000 * seen.behind <= most * seen.pixels,
                "{name}: {seen:?}"
            );
            assert!(1000 * seen.light <= most * seen.pixels, "{name}: {seen:?}");
        }
    }

    #[test]
    fn hard_20_strokes_agree_with_f64_whatever_the_tangents_the_brush_and_the_camera() {
        let cloud = scene(SceneKind::NestedTori, 1500, 0.0);
        let part = &cloud.parts[0];
        let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
        let size = [67, 53];
        let fit = Camera::framing(Preset::Fit, &cloud.core_points(), size);
        let flat = Camera { projection: Projection::Orthographic, ortho_height: Some(1.5), ..fit };
        for camera in [fit, flat] {
            let view = View::new(camera, size).unwrap();
            for effect in [
                "tangents=householder",
                "tangents=eberly,brush=ribbons",
                "tangents=squareplate,brush=bristles",
                "tangents=covariance,noise=60",
                "tangents=householder,order=stroke",
                "detail=0",
                "blend=opaque",
                "blend=opaque,brush=ribbons",
            ] {
                let effect = format!("strokes=on,size=1.5,{effect}");
                let mut effects = Effects::default();
                effects.set_any(&effect).unwrap();
                let painted = paint(&cloud, &view, &effect);
                let truth = oracle::paint(&view, &effects.strokes.settings, part, &found, &|_| 1.0);
                let agreement = oracle::compare(&truth, &painted.picture, &painted.depth);
                println!("{effect} {:?}: {agreement:?}", camera.projection);
                assert!(
                    agreement.pixels > 500 && agreement.color_off == 0 && agreement.depth_off == 0,
                    "{effect}: {agreement:?}"
                );
            }
        }
    }

    #[test]
    fn strokes_that_let_light_through_agree_with_f64() {
        let cloud = scene(SceneKind::NestedTori, 1500, 0.0);
        let part = &cloud.parts[0];
        let (found, class) = (
            strokes(&part.columns, &part.lattice, &Silent).unwrap(),
            part.columns.class.as_ref().unwrap(),
        );
        let size = [67, 53];
        let view =
            View::new(Camera::framing(Preset::Fit, &cloud.core_points(), size), size).unwrap();
        let effect = "strokes=on,size=1";
        let mut effects = Effects::default();
        effects.set_any(effect).unwrap();
        let opaque = paint(&cloud, &view, effect);
        for (rules, opacity) in [
            (&["0.5"][..], (|_| 0.5) as fn(u8) -> f64),
            (&["class:3=0.3", "class:2=0.6"], |class| [1.0, 1.0, 0.6, 0.3][class as usize]),
            (&["class:3=0", "0.25"], |class| if class == 3 { 0.0 } else { 0.25 }),
        ] {
            let painted = paint_through(&cloud, &view, effect, rules);
            let truth = oracle::paint(&view, &effects.strokes.settings, part, &found, &|i| {
                opacity(class[i])
            });
            let agreement = oracle::compare(&truth, &painted.picture, &painted.depth);
            println!("{rules:?}: {agreement:?}");
            assert!(
                agreement.pixels > 500 && agreement.color_off == 0 && agreement.depth_off == 0,
                "{rules:?}: {agreement:?}"
            );
            let shows = error(&painted.picture, &opaque.picture);
            assert!(shows > 0.05, "{rules:?} shows: {shows}");
        }
    }

    /// Seen straight from above, all strokes of a plane are equally deep. Strokes of any colour are
    /// painted over.
    #[test]
    fn of_strokes_of_one_depth_no_colour_comes_first() {
        let mut cloud = scene(SceneKind::Plane, 2000, 0.0);
        let axis = |of: fn(i32) -> i32| (0..400).map(of).collect::<Vec<i32>>();
        let (x, y, z) = (axis(|k| 1000 * (k % 20)), axis(|k| 1000 * (k / 20)), vec![0; 400]);
        let is_red = |k: usize| (k % 20 + k / 20).is_multiple_of(2);
        let rgb = (0..400).map(|k| if is_red(k) { [255, 0, 0] } else { [0, 0, 255] }).collect();
        cloud.parts[0].columns = Columns { rgb: Some(rgb), x, y, z, ..Columns::default() };
        let view =
            View::new(Camera::framing(Preset::Top, &cloud.core_points(), [240, 240]), [240, 240])
                .unwrap();
        for order in ["pixel", "stroke"] {
            let painted =
                paint(&cloud, &view, &format!("strokes=on,noise=0,detail=0,long=0,order={order}"));
            let shows = |k: &usize| {
                let off = world_of(&cloud.parts[0], *k) - view.camera.eye;
                let [x, y] = [off.dot(view.basis.right), -off.dot(view.basis.up)]
                    .map(|metres| (metres * view.focal_px() + 120.0) as usize);
                let [red, _, blue, _] = painted.picture[240 * y + x];
                (red > blue) == is_red(*k)
            };
            let own = [true, false]
                .map(|red| (0..400).filter(|k| is_red(*k) == red).filter(shows).count());
            println!(
                "order={order}: {own:?} of 200 red and 200 blue strokes are seen at their middles"
            );
            assert!(own.iter().all(|own| (40..160).contains(own)), "order={order}: {own:?}");
        }
    }

    /// A place that was measured twice is painted once. A point that is not drawn hides none at its
    /// place.
    #[test]
    fn points_at_one_place_are_one_stroke() {
        // Each place has one other near it, so that sizes are the same however often they occur.
        let (scene, places) = (scene(SceneKind::Plane, 2000, 0.0), [[0, 0, 0], [4000, 900, 300]]);
        let with = |classes: &[u8]| {
            let mut cloud = scene.clone();
            let axis = |axis: usize| {
                places.iter().flat_map(|at| vec![at[axis]; classes.len()]).collect::<Vec<i32>>()
            };
            cloud.parts[0].columns = Columns {
                x: axis(0),
                y: axis(1),
                z: axis(2),
                class: Some(classes.repeat(places.len())),
                ..Columns::default()
            };
            cloud
        };
        let camera = Camera::framing(Preset::Iso, &with(&[2]).core_points(), [161, 120]);
        let view = View::new(camera, [161, 120]).unwrap();
        for effect in ["strokes=on", "strokes=on,blend=opaque"] {
            for (class, classes, hidden) in [
                (2, &[2, 2, 2][..], &[][..]),
                (2, &[2, 6], &["class:6=0"]),
                (6, &[2, 6], &["class:2=0"]),
            ] {
                let once = paint_through(&with(&[class]), &view, effect, hidden);
                let again = paint_through(&with(classes), &view, effect, hidden);
                println!("{effect}, {classes:?}: {}; {}", once.facts, again.facts);
                assert!(once.depth.iter().filter(|depth| depth.is_finite()).count() > 500);
                assert!(bits(&again.picture) == bits(&once.picture), "{effect}, {classes:?}");
            }
        }
    }

    /// Half black over white is 188 of 255. Each stroke lets through its share of what those before
    /// it leave. Coverages have 8 bits.
    #[test]
    fn hard_17_strokes_let_light_through_linearly() {
        // Sheets of black points, one behind the other, painted with strokes too small to touch.
        let sheets = |count: i32| {
            let mut cloud = scene(SceneKind::Plane, 2000, 0.0);
            let axis = |of: fn(i32) -> i32| (0..400 * count).map(of).collect::<Vec<i32>>();
            let (x, y, z) = (
                axis(|k| 1000 * (k % 20)),
                axis(|k| 1000 * (k / 20 % 20)),
                axis(|k| 20_000 * (k / 400)),
            );
            cloud.parts[0].columns =
                Columns { rgb: Some(vec![[0; 3]; x.len()]), x, y, z, ..Columns::default() };
            cloud
        };
        for (count, opacity) in [(1, 0.5f64), (4, 0.5), (7, 0.1), (40, 0.02)] {
            let cloud = sheets(count);
            let view = View::new(
                Camera::framing(Preset::Top, &cloud.core_points(), [200, 200]),
                [200, 200],
            )
            .unwrap();
            let painted = paint_through(
                &cloud,
                &view,
                "strokes=on,size=0.3,noise=0",
                &[&opacity.to_string()],
            );
            let most = painted.picture.iter().map(|pixel| pixel[3] as f64).fold(0.0, f64::max);
            let truth = 1.0 - (1.0 - opacity).powi(count);
            println!(
                "{count} strokes of {opacity}: {most:.4} of the light taken, {truth:.4} is true"
            );
            assert!(
                (most - truth).abs() <= count as f64 / 510.0 + 1.0 / 512.0,
                "{count} strokes of {opacity}: {most}, not {truth}"
            );
            if count == 1 {
                let white = 255.0 * linear_to_srgb(1.0 - most);
                assert!((white - 188.0).abs() <= 1.0, "{white} of 255");
            }
        }
    }
}
