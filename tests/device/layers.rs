//! Transparency: layers and their blend, against all surfaces on a ray, sorted and blended in f64.

use crate::cameras::orthographic;
use crate::gpu::{self, Way};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::colormap::srgb_to_linear;
use pointillist::cloud::{Cloud, Lattice};
use pointillist::graph::Graph;
use pointillist::passes::FrameContext;
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::Resident;
use pointillist::select::opacity::Opacities;
use pointillist::study::oracle::transparency::{self as oracle, Over};
use pointillist::synth::{self, World};
use pointillist::view::{Camera, Preset, Projection, View};

const SIDE: usize = 192;

/// Colours of classes 1, 2 and 3: the tori from the inside out.
const COLORS: [[u8; 3]; 3] = [[250, 40, 30], [40, 220, 60], [30, 60, 240]];

struct Drawn {
    /// Linear, over black; alpha is the coverage of the background.
    front: Vec<[f32; 4]>,
    peeled: Vec<f32>,
    left_over: bool,
    layer_m: f64,
}

fn tori(points: u64) -> (World, Cloud) {
    let world = synth::build(synth::SceneKind::NestedTori, 1, 0.0);
    let mut cloud = synth::collect("nested tori", &world, points, 1, 0.0, &Silent).unwrap();
    let columns = &mut cloud.parts[0].columns;
    columns.rgb = columns
        .class
        .as_ref()
        .map(|classes| classes.iter().map(|&class| COLORS[class as usize - 1]).collect());
    (world, cloud)
}

fn draw(cloud: &Cloud, view: &View, way: Way, opacities: &[&str], effects: &[&str]) -> Drawn {
    gpu::with(way, |gpu| {
        let opacities = Opacities(opacities.iter().map(|rule| rule.parse().unwrap()).collect());
        let mut shown = DisplayAttribute::new(Attribute::Rgb, cloud);
        shown.further.kind = opacities.needs_kinds();
        let mut resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
        resident.opacities = opacities;
        let mut settings = RenderSettings::default();
        ["shape=off", "edl=off"]
            .iter()
            .chain(effects)
            .for_each(|effect| settings.effects.set_any(effect).unwrap());
        let layer_m = FrameContext::of(view, &resident, settings.light).layer_m(0.0);
        let config = FrameConfig::new(&settings, view, &resident);
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, &resident, &config).unwrap();
        let layers = outcome.gbuffer.accumulation.expect("transparency runs");
        let (front, peeled) = (g.download(&layers.color), g.download(&layers.peeled));
        let left_over = g.download_buffer(&layers.left);
        let frame = g.submit_and_wait(&[]).unwrap();

        Drawn {
            front: frame.read(&front).to_vec(),
            peeled: frame.read(&peeled).to_vec(),
            left_over: frame.read::<u32>(&left_over)[0] > 0,
            layer_m,
        }
    })
}

fn view(cloud: &Cloud) -> View {
    let size = [SIDE as u32; 2];
    View::new(Camera::framing(Preset::Fit, &cloud.core_points(), size), size).unwrap()
}

/// Compares with the exact "over" of all surfaces on the ray, within 3 L 2^-23 + 2^-9 (guide:
/// numerics, case 15).
#[test]
fn hard_15_layers_are_laid_over_each_other_as_sorted_surfaces_are() {
    let (world, cloud) = tori(3_000_000);
    let view = view(&cloud);
    let opacities = [0.3, 0.5, 1.0];
    for (way, fill) in [
        (Way::Compute64, "fill=method=mask"),
        (Way::Compute32, "fill=method=mask"),
        (Way::Compute64, "fill=auto"),
    ] {
        for opaque in [true, false] {
            let of = |class: u8| if opaque { opacities[3 - class as usize] } else { 0.5 };
            let rules = ["class:3=0.3", "class:2=0.5"];
            let rules = if opaque { &rules[..] } else { &["0.5"] };
            let drawn = draw(&cloud, &view, way, rules, &[fill, "smooth=off"]);
            let (mut inner, mut miscounted, mut wrong) = (0, 0, 0);
            for i in 0..SIDE * SIDE {
                let Some(surfaces) = oracle::layers(
                    &world,
                    &view,
                    drawn.layer_m,
                    [(i % SIDE) as f64 + 0.5, (i / SIDE) as f64 + 0.5],
                ) else {
                    continue;
                };
                inner += 1;
                let color = |class: u8| {
                    COLORS[class as usize - 1].map(|channel| srgb_to_linear(channel as f64 / 255.0))
                };
                let Over { color: expected, through, layers: count } = oracle::over(
                    surfaces.iter().map(|surface| (color(surface.class), of(surface.class))),
                );
                if drawn.peeled[i] != count as f32 {
                    miscounted += 1;
                    continue;
                }
                // Results of medians and means are packed into 8 bits of the square root.
                let packed = if fill == "fill=auto" { count as f64 * 0.5 / 255.0 } else { 0.0 };
                let bound = 3.0 * count as f64 * 2f64.powi(-23) + 2f64.powi(-9) + packed;
                let off = (0..3)
                    .map(|c| (drawn.front[i][c] as f64 - expected[c]).abs())
                    .fold((drawn.front[i][3] as f64 - 1.0 + through).abs(), f64::max);
                wrong += (off > bound) as usize;
            }
            let all = SIDE * SIDE;
            println!(
                "{way:?}, {fill}, opaque {opaque}: {inner} of {all} pixels away from contours; {miscounted} counted wrong, {wrong} more than the bound off"
            );
            assert!(inner > all / 2);
            assert!(
                miscounted as f64 <= 0.005 * inner as f64,
                "{miscounted} of {inner} pixels have another number of layers"
            );
            assert_eq!(wrong, 0, "of {inner} pixels");
        }
    }
}

/// Points are too sparse for masks: two planes are behind each other, with point spacings of three
/// and two and a half pixels.
#[test]
fn layers_of_sparse_points_have_no_holes() {
    let lattice = |apart: i32, y: i32| {
        (-20..=20).flat_map(move |i| (-20..=20).map(move |j| [apart * i, y, apart * j]))
    };
    let points: Vec<_> = lattice(300, 10_000).chain(lattice(250, 15_000)).collect();
    let colors =
        points.iter().map(|point| if point[1] == 10_000 { COLORS[0] } else { COLORS[2] }).collect();
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
    let cloud = gpu::cloud(vec![gpu::part(lattice, &points, Some(colors))]);
    // The planes' edges are out of sight at ten pixels per metre.
    let view = View::new(orthographic(DVec3::ZERO, DVec3::Y, 4.8), [48, 48]).unwrap();
    let over = oracle::over(
        [COLORS[0], COLORS[2]]
            .into_iter()
            .map(|color| (color.map(|channel| srgb_to_linear(channel as f64 / 255.0)), 0.5)),
    );
    let wrong = |visibility: &str| {
        let drawn = draw(
            &cloud,
            &view,
            Way::Compute64,
            &["0.5"],
            &["fill=method=mask", "smooth=off", visibility],
        );
        let off = |i: &usize| {
            (0..3).any(|c| (drawn.front[*i][c] as f64 - over.color[c]).abs() > 1e-5)
                || drawn.peeled[*i] != 2.0
        };
        (0..drawn.peeled.len()).filter(off).count()
    };
    let (found, masks) = (wrong("visibility=auto"), wrong("visibility=off"));
    println!("{found} pixels without both planes, {masks} by masks alone");
    assert!(masks > 1000, "{masks}");
    assert_eq!(found, 0);
}

/// The sparse half of the picture has no holes, however many points the other half has.
#[test]
fn a_sparse_part_beside_a_dense_one_has_no_holes() {
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
    // Ten pixels per metre: spacing of half a pixel on the left, and of two and a half on the
    // right.
    let grid = |apart: i32, from: i32, to: i32| {
        let across = (0..(to - from) / apart).map(move |i| from + apart * i);
        let points: Vec<_> = across
            .flat_map(|x| (-5000 / apart..=5000 / apart).map(move |j| [x, 10_000, apart * j]))
            .collect();
        gpu::part(lattice, &points, Some(vec![COLORS[0]; points.len()]))
    };
    let cloud = gpu::cloud(vec![grid(50, -5000, 0), grid(250, 0, 5000)]);
    let view = View::new(orthographic(DVec3::ZERO, DVec3::Y, 4.8), [48, 48]).unwrap();
    let empty = |visibility: &str| {
        let drawn =
            draw(&cloud, &view, Way::Compute64, &["0.5"], &["fill=method=mask", visibility]);
        drawn.peeled.iter().filter(|count| **count != 1.0).count()
    };
    let (found, masks) = (empty("visibility=auto"), empty("visibility=off"));
    println!("{found} pixels without the plane, {masks} by masks alone");
    assert!(masks > 100, "{masks}");
    assert_eq!(found, 0);
}

/// Where surfaces turn away and points are two and a half pixels apart, depths are those of points
/// some pixels away. The rest of a surface is not a layer of its own, and no later layer is
/// omitted.
#[test]
fn layers_of_sparse_surfaces_are_counted_where_these_turn_away() {
    let (world, cloud) = tori(750_000);
    // The camera is near the axis and looks onto the inner side of the tube behind: its front, back
    // and inside are side by side.
    let (eye, target) = (DVec3::new(1.3, -2.6, 1.45), DVec3::new(-0.515, -0.497, 0.32));
    let camera = Camera {
        eye,
        target,
        up: DVec3::Z,
        fov_y: 13.3,
        projection: Projection::Perspective,
        ortho_height: None,
    };
    let view = View::new(camera, [SIDE as u32; 2]).unwrap();
    for fill in ["fill=method=mask", "fill=auto"] {
        let drawn = draw(&cloud, &view, Way::Compute64, &["0.5"], &[fill]);
        let expected = |i: &usize| {
            oracle::layers(
                &world,
                &view,
                drawn.layer_m,
                [(i % SIDE) as f64 + 0.5, (i / SIDE) as f64 + 0.5],
            )
        };
        let counts: Vec<_> =
            (0..SIDE * SIDE).filter_map(|i| Some((i, expected(&i)?.len()))).collect();
        let miscounted =
            counts.iter().filter(|(i, count)| drawn.peeled[*i] != *count as f32).count();
        println!("{fill}: {miscounted} of {} pixels counted wrong", counts.len());
        assert!(counts.len() > SIDE * SIDE / 2);
        assert!(
            miscounted as f64 <= 0.01 * counts.len() as f64,
            "{fill}: {miscounted} of {} pixels",
            counts.len()
        );
    }
}

/// Opacity 0 removes points; opacity 1 ends the layers; the limit of layers holds, and what it
/// omits is reported.
#[test]
fn points_of_no_opacity_are_not_there_and_layers_end_where_they_are_told_to() {
    let (_, cloud) = tori(400_000);
    let view = view(&cloud);
    let without = |class: u8| {
        let mut cloud = cloud.clone();
        let columns = &mut cloud.parts[0].columns;
        let kept: Vec<usize> =
            (0..columns.len()).filter(|&i| columns.class.as_ref().unwrap()[i] != class).collect();
        let parts: Vec<_> = kept.iter().map(|&i| columns.slice(i..i + 1)).collect();
        let mut slim = pointillist::cloud::Columns {
            rgb: Some(vec![]),
            class: Some(vec![]),
            ..Default::default()
        };
        for part in parts {
            slim.x.extend(part.x);
            slim.y.extend(part.y);
            slim.z.extend(part.z);
            slim.rgb.as_mut().unwrap().extend(part.rgb.unwrap());
            slim.class.as_mut().unwrap().extend(part.class.unwrap());
        }
        *columns = slim;
        cloud
    };
    for way in [Way::Compute64, Way::Compute32] {
        let plain = ["visibility=off", "fill=off", "smooth=off"];
        // Hidden points count for the spacing that a default layer distance would come from.
        let known = [&plain[..], &["transparency=layer=0.05"]].concat();
        let left_out = draw(&cloud, &view, way, &["class:3=0", "class:2=0.5"], &known);
        let gone = draw(&without(3), &view, way, &["class:3=0", "class:2=0.5"], &known);
        assert!(left_out.front == gone.front && left_out.peeled == gone.peeled);

        let two =
            draw(&cloud, &view, way, &["0.5"], &[&plain[..], &["transparency=layers=2"]].concat());
        assert_eq!(two.peeled.iter().copied().fold(0.0, f32::max), 2.0);
        assert!(two.left_over);
        let all =
            draw(&cloud, &view, way, &["0.5"], &[&plain[..], &["transparency=layers=64"]].concat());
        assert!(!all.left_over);
    }
}

/// If the layer distance is less than the depth resolution, every layer is still deeper than the
/// one before, and peeling ends (guide: numerics, case 15).
#[test]
fn hard_15_peeling_ends_where_a_layer_is_less_than_a_quantum() {
    let (_, mut cloud) = tori(20_000);
    // Seen from 100 km away, where depths are 8 mm apart.
    let mut camera = Camera::framing(Preset::Fit, &cloud.core_points(), [64, 64]);
    camera.eye = camera.target + (camera.eye - camera.target).normalize() * 1e5;
    camera.fov_y = 2e-3;
    let view = View::new(camera, [64, 64]).unwrap();
    cloud.parts.truncate(1);
    let drawn = draw(
        &cloud,
        &view,
        Way::Compute64,
        &["0.02"],
        &["visibility=off", "fill=off", "smooth=off", "transparency=on,layer=0.001,layers=64"],
    );
    assert!(drawn.peeled.iter().all(|&layers| layers <= 64.0));
    assert!(drawn.front.iter().flatten().all(|value| value.is_finite()));
    assert!(drawn.peeled.iter().any(|&layers| layers > 16.0));
}

/// Tiles where a layer shows nothing are skipped by the layers behind it, whatever effects carry
/// over between tiles, and the picture is the same, bit by bit.
#[test]
fn layers_are_drawn_only_where_they_show_something_and_the_picture_is_the_same() {
    let (_, cloud) = tori(60_000);
    // Holes everywhere, a near part of the ring and much background.
    let mut camera = Camera::framing(Preset::Iso, &cloud.core_points(), [200, 136]);
    camera.eye = camera.target + (camera.eye - camera.target) * 0.6;
    let view = View::new(camera, [200, 136]).unwrap();
    let looks: [&[&str]; 8] = [
        &[],
        &["shape=on", "ao=on"],
        &["fill=method=mask"],
        &["fill=method=mask,iterations=20", "smooth=on,iterations=3", "antialias=on", "phong=on"],
        &["visibility=off", "fill=off", "edl=on,radius=3"],
        &["visibility=off", "fill=on,method=splat,radius=9", "edl=on"],
        &["fill=method=pullpush", "phong=on"],
        &[
            "visibility=levels=1,kernel=15",
            "fill=method=median,iterations=3,surrounded=4",
            "shadows=on,samples=2",
            "antialias=on",
        ],
    ];
    for way in [Way::Compute64, Way::Compute32] {
        for effects in looks {
            let of = |way, tiles: &str| {
                draw(
                    &cloud,
                    &view,
                    way,
                    &["class:3=0.3", "class:2=0.5"],
                    &[effects, &[tiles]].concat(),
                )
            };
            let (needed, all) =
                (of(way, "transparency=tiles=needed"), of(way, "transparency=tiles=all"));
            assert!(all.peeled.iter().any(|&layers| layers > 3.0), "{effects:?}");
            assert!(
                needed.front == all.front
                    && needed.peeled == all.peeled
                    && needed.left_over == all.left_over,
                "{way:?}, {effects:?}"
            );
            // Lists of tiles are texels.
            if way == Way::Compute64 {
                let without = of(Way::Words, "transparency=tiles=needed");
                assert!(
                    without.front == all.front && without.peeled == all.peeled,
                    "without texels, {effects:?}"
                );
            }
        }
    }
}
