//! Phong lighting against its f64 twin.

use super::surface::{SIZES, layered_keys};
use crate::cameras::{orthographic, perspective};
use crate::gpu::{self, CANVAS_POINTS, Way, canvas, cloud, nothing, part, random_keys, views};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::{Cloud, Lattice, octahedral};
use pointillist::config::NO_POINT;
use pointillist::graph::Graph;
use pointillist::passes::project::{Keys, Strip};
use pointillist::passes::{FrameContext, Switch, phong, resolve};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::FrameConfig;
use pointillist::resident::Resident;
use pointillist::study::oracle;
use pointillist::view::light::Light;
use pointillist::view::{Projection, View};
use std::collections::HashMap;

#[test]
fn phong_lights_as_f64_does() {
    let random = &mut Random(0x9405);
    let (mut bounds, mut doubtful, mut changed) = (Vec::new(), 0, 0);
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                let lights = [
                    Light::Headlight,
                    Light::Direction(DVec3::new(1.0, 2.0, -1.5)),
                    Light::Position(DVec3::new(1.0, 3.0, 2.0)),
                ];
                for light in lights {
                    for (ambient, shininess, radius) in
                        [(0.2, 24.0, 3.0), (0.0, 1.0, 1.0), (0.5, 255.0, 2.0)]
                    {
                        for (layered, keys) in [
                            (false, random_keys(size, CANVAS_POINTS, random)),
                            (true, layered_keys(size, random)),
                        ] {
                            // Half of the runs are in shadows of any depth.
                            canvas.reached = random.bits().is_multiple_of(2);
                            let mut effects = nothing();
                            effects.phong.switch = Switch::On;
                            effects.phong.settings = phong::Settings {
                                ambient,
                                shininess,
                                radius,
                                diffuse: 1.0 - ambient,
                                ..phong::Settings::default()
                            };
                            let surface = canvas.draw_in(light, &view, &keys, &effects);
                            let (raw, got) = (&surface.raw, &surface.shaded);
                            assert!(got.depth == raw.depth && got.index == raw.index);
                            let twin = oracle::phong::shade(
                                &view,
                                light,
                                &effects.phong.settings,
                                &raw.depth,
                                &raw.color,
                                None,
                                canvas.reached.then_some(&raw.reached),
                            );
                            for (i, twin) in twin.iter().enumerate() {
                                let color = got.color[i];
                                let case = || {
                                    format!(
                                        "{:?} {size:?} {light} {:?} pixel {i}",
                                        view.camera.projection, effects.phong.settings
                                    )
                                };
                                assert_eq!(color[3], raw.color[i][3]);
                                let holds = |allowed: &[oracle::Bounded; 3]| {
                                    (0..3).all(|c| allowed[c].holds(color[c]))
                                };
                                assert!(
                                    twin.iter().any(holds),
                                    "{}: {color:?} is not {twin:?}",
                                    case()
                                );
                                doubtful += (twin.len() > 1) as usize;
                                changed += (color != raw.color[i]) as usize;
                                bounds.extend(layered.then_some(twin[0][1].error));
                            }
                        }
                    }
                }
            }
        }
    });
    bounds.sort_by(f64::total_cmp);
    let [middle, most] = [0.5, 0.9].map(|share| bounds[(share * bounds.len() as f64) as usize]);
    println!(
        "{changed} pixels lit, {doubtful} doubtful, bounds: median {middle:e}, nine in ten {most:e}"
    );
    assert!(changed > bounds.len() / 2 && doubtful < bounds.len() / 100 && most < 1e-3);
}

/// Normals of points reach the pixels that show them, and pixels around take their mean. A quarter
/// of the points have none.
#[test]
fn phong_lights_by_the_normals_of_points_as_f64_does() {
    let random = &mut Random(0xFACE);
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
    let (points, colors) = bumpy(CANVAS_POINTS as usize, 20_000, random);
    let normals: Vec<[i8; 3]> = points
        .iter()
        .map(|_| {
            if random.bits().is_multiple_of(4) {
                [0; 3]
            } else {
                [(); 3].map(|()| random.bits() as i8)
            }
        })
        .collect();
    let of_place: HashMap<[i32; 3], u32> = points
        .iter()
        .zip(&normals)
        .map(|(&at, &normal)| (at, octahedral::of_bytes(normal)))
        .collect();
    let mut part = part(lattice, &points, Some(colors));
    part.columns.normal = Some(normals);
    let cloud = cloud(vec![part]);
    let (mut own, mut around, mut doubtful) = (0, 0, 0);
    gpu::with(Way::Compute64, |gpu| {
        let mut shown = DisplayAttribute::new(Attribute::Rgb, &cloud);
        shown.further.normal = true;
        let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
        let steps = |world: DVec3| (world / lattice.step).round().to_array().map(|v| v as i32);
        let words: Vec<u32> = resident
            .positions(gpu)
            .unwrap()
            .into_iter()
            .map(|world| of_place[&steps(world)])
            .collect();
        for size in SIZES {
            for view in views(size) {
                let light = Light::Direction(DVec3::new(1.0, 2.0, -1.5));
                let keys = layered_keys(size, random);
                let settings = phong::Settings { radius: 2.0, ..phong::Settings::default() };
                let scene = FrameContext::of(&view, &resident, light);
                assert!(scene.normals);
                let mut g = Graph::new(gpu);
                let uploaded = g.upload("keys", &keys).unwrap();
                let paint = resolve::paint(&mut g, &resident, &Default::default()).unwrap();
                let resolved = resolve::begin(&mut g, &view);
                let resolved = resolve::record(
                    &mut g,
                    &Keys::nearest(uploaded),
                    &paint,
                    Strip { top: 0, size },
                    resolved,
                );
                let gbuffer = resolved.gbuffer(&mut g, &view, &resident).unwrap();
                let facing = phong::facing(&mut g, &view, &gbuffer).expect("points have normals");
                let [depth, color, index, facing] =
                    [&gbuffer.depth, &gbuffer.color, &gbuffer.index, &facing]
                        .map(|image| g.download(image));
                let lit = phong::record(&mut g, &scene, &settings, gbuffer);
                let lit = g.download(&lit.color);
                let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");
                let (depth, color, index): (&[f32], &[[f32; 4]], &[u32]) =
                    (frame.read(&depth), frame.read(&color), frame.read(&index));
                let (facing, lit): (&[[f32; 4]], &[[f32; 4]]) =
                    (frame.read(&facing), frame.read(&lit));
                for (i, (&id, facing)) in index.iter().zip(facing).enumerate() {
                    let normal =
                        if id == NO_POINT { None } else { octahedral::unpack(words[id as usize]) };
                    let Some(normal) = normal else {
                        assert_eq!(*facing, [0.0; 4]);
                        continue;
                    };
                    own += 1;
                    let twin = oracle::phong::facing(&view, i, normal);
                    // Seen from the side, both are possible.
                    let holds =
                        |sign: f32| (0..3).all(|axis| twin[axis].holds(sign * facing[axis]));
                    assert!(
                        facing[3] == 1.0 && (holds(1.0) || holds(-1.0)),
                        "{size:?} pixel {i}: {facing:?} is not {twin:?}"
                    );
                }
                let twin =
                    oracle::phong::shade(&view, light, &settings, depth, color, Some(facing), None);
                for (i, twin) in twin.iter().enumerate() {
                    let holds = |allowed: &[oracle::Bounded; 3]| {
                        (0..3).all(|c| allowed[c].holds(lit[i][c]))
                    };
                    assert!(
                        twin.iter().any(holds),
                        "{:?} {size:?} pixel {i}: {:?} is not {twin:?}",
                        view.camera.projection,
                        lit[i]
                    );
                    doubtful += (twin.len() > 1) as usize;
                    around += (depth[i].is_finite() && facing[i][3] == 0.0) as usize;
                }
            }
        }
    });
    println!("{own} pixels of points with normals, {around} of others, {doubtful} doubtful");
    assert!(own > 10_000 && around > 1000 && doubtful < own / 20);
}

/// Points have normals to all sides. Drawn without back faces they give the picture of the front
/// faces alone.
#[test]
fn back_faces_are_left_out_where_that_is_asked_for() {
    let random = &mut Random(0xBACC);
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
    let (points, colors) = bumpy(20_000, 20_000, random);
    let normals: Vec<[i8; 3]> =
        points.iter().map(|_| [(); 3].map(|()| (random.bits() % 255) as i8)).collect();
    let of = |keep: &dyn Fn(usize) -> bool| {
        let kept: Vec<usize> = (0..points.len()).filter(|&i| keep(i)).collect();
        let mut part = part(
            lattice,
            &kept.iter().map(|&i| points[i]).collect::<Vec<_>>(),
            Some(kept.iter().map(|&i| colors[i]).collect()),
        );
        part.columns.normal = Some(kept.iter().map(|&i| normals[i]).collect());
        cloud(vec![part])
    };
    let camera = perspective(DVec3::new(17.0, -23.0, 11.0), DVec3::ZERO, 50.0);
    let flat = orthographic(DVec3::new(5.0, 6.0, 30.0), DVec3::new(0.1, 0.2, 0.3), 19.0);
    for camera in [camera, flat] {
        let view = View::new(camera, [331, 257]).unwrap();
        let faces = |i: usize| {
            let at = lattice.world(points[i].map(i64::from));
            let sight = if camera.projection == Projection::Perspective {
                at - camera.eye
            } else {
                view.basis.forward
            };
            octahedral::unpack(octahedral::of_bytes(normals[i]))
                .is_none_or(|normal| normal.dot(sight) <= 0.0)
        };
        for way in gpu::WAYS {
            let depth = |cloud: &Cloud, effect: &str| {
                gpu::with(way, |gpu| {
                    let mut shown = DisplayAttribute::new(Attribute::Rgb, cloud);
                    shown.further.normal = true;
                    let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
                    let mut settings = gpu::bare();
                    settings.effects.set_any(effect).unwrap();
                    let config = FrameConfig::new(&settings, &view, &resident);
                    let mut g = Graph::new(gpu);
                    let outcome = frame::record(&mut g, &view, &resident, &config).unwrap();
                    let depth = g.download(&outcome.gbuffer.depth);
                    let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");

                    frame.read::<f32>(&depth).to_vec()
                })
            };
            let (all, fronts) = (depth(&of(&|_| true), "phong=on"), depth(&of(&faces), "phong=on"));
            let dropped = depth(&of(&|_| true), "phong=on,backfaces=drop");
            let differ = |a: &[f32], b: &[f32]| {
                a.iter()
                    .zip(b)
                    .filter(|(a, b)| a != b && (**a - **b).abs() > 1e-5 * a.abs())
                    .count()
            };
            // A node's box differs without some points, and a point may fall into the neighbouring
            // pixel.
            let (off, changed) = (differ(&dropped, &fronts), differ(&all, &fronts));
            println!("{:?} {way:?}: {off} pixels off, of {changed}", camera.projection);
            assert!(changed > 3000 && off < changed / 300, "{off} of {changed}");
        }
    }
}
