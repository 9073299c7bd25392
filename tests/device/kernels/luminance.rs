//! Luminance correction against its f64 twin: random points, both spaces, both neighbourhoods, both
//! ways of adding, and a picture in more than one strip.

use crate::cameras::{orthographic, perspective};
use crate::gpu::{WAYS, Way, bare, cloud, draw, part, with};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::attribute::DisplayAttribute;
use pointillist::cloud::{self, Cloud, Lattice};
use pointillist::config::POINTS_PER_PAGE;
use pointillist::graph::{Gpu, Graph};
use pointillist::passes::project::Precision;
use pointillist::passes::{Switch, luminance};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::FrameConfig;
use pointillist::resident::Resident;
use pointillist::resident::station_overlap::OVERLAP_PX;
use pointillist::select::opacity::{Opacities, Rule, What};
use pointillist::study::oracle::{luminance as oracle, project};
use pointillist::view::{Camera, View};
use std::sync::Arc;

const LATTICE: Lattice =
    Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };

fn cameras() -> [Camera; 2] {
    let around = |x, y, z| LATTICE.offset + DVec3::new(x, y, z);
    [
        perspective(around(11.0, -17.0, 9.0), LATTICE.offset, 50.0),
        orthographic(around(5.0, 6.0, 30.0), around(0.1, 0.2, 0.3), 19.0),
    ]
}

fn scene(points: usize) -> Cloud {
    let (points, colors) = bumpy(points, 20_000, &mut Random(0x1057));
    cloud(vec![part(LATTICE, &points, Some(colors))])
}

/// Returns how many pixels changed, and how many are in doubt.
fn check(cloud: &Cloud, view: &View, luminance: luminance::Settings, ways: &[Way]) -> [usize; 3] {
    let mut settings = bare();
    settings.precision = Precision::Planes(3);
    let plain = draw(Way::Compute64, cloud, view, &settings);
    settings.effects.luminance.switch = Switch::On;
    settings.effects.luminance.settings = luminance;
    let drawn: Vec<_> = ways.iter().map(|&way| draw(way, cloud, view, &settings)).collect();
    assert!(
        drawn.iter().all(|layers| layers.bits() == drawn[0].bits()),
        "the ways of adding differ"
    );
    let got = &drawn[0];
    got.assert_finite();
    assert!(got.depth == plain.depth && got.index == plain.index);
    let part = &cloud.parts[0];
    let source = project::Source::new(part, view, settings.precision, DVec3::ZERO);
    let colors = part.columns.rgb.as_ref().unwrap();
    let positions = project::positions(part, view.camera.eye);
    let points: Vec<oracle::Point> = positions
        .iter()
        .zip(colors)
        .filter_map(|(v, &rgb)| Some((project::footprint(view, &source, *v)?, rgb)))
        .collect();
    let twin = oracle::colors(
        view.size,
        &luminance,
        luminance.epsilon as f32,
        &plain.depth,
        &plain.color,
        &points,
    );
    let (mut changed, mut doubtful) = (0, 0);
    for (i, twin) in twin.iter().enumerate() {
        let Some(twin) = twin else {
            doubtful += 1;
            continue;
        };
        let holds =
            (0..3).all(|c| twin[c].holds(got.color[i][c])) && got.color[i][3] == plain.color[i][3];
        assert!(
            holds,
            "{:?} {settings:?} pixel {i}: {:?} became {:?}, not {twin:?}",
            view.size, plain.color[i], got.color[i]
        );
        changed += (got.color[i] != plain.color[i]) as usize;
    }
    [twin.len(), changed, doubtful]
}

#[test]
fn luminance_is_the_mean_that_f64_finds() {
    let cloud = scene(60_000);
    let mut total = [0; 3];
    for size in [[1, 1], [7, 3], [65, 33], [127, 61]] {
        for camera in cameras() {
            let view = View::new(camera, size).unwrap();
            for space in [luminance::Space::Hsv, luminance::Space::Rgb] {
                for neighbourhood in [1.0, 3.0] {
                    for epsilon in [1e-3, 0.05, 3.0] {
                        let found = check(
                            &cloud,
                            &view,
                            luminance::Settings { space, neighbourhood, epsilon },
                            &WAYS,
                        );
                        total = [0, 1, 2].map(|k| total[k] + found[k]);
                    }
                }
            }
        }
    }
    println!("pixels, changed, doubtful: {total:?}");
    assert!(total[1] > total[0] / 5 && total[2] < total[0] / 10, "{total:?}");
}

/// Sums of three channels take 24 bytes per pixel: more than one binding of many devices.
#[test]
fn luminance_of_a_large_picture_is_corrected_band_by_band() {
    let cloud = scene(300_000);
    let view = View::new(cameras()[1], [2600, 2200]).unwrap();
    let settings =
        luminance::Settings { space: luminance::Space::Rgb, neighbourhood: 3.0, epsilon: 0.5 };
    let [_, changed, doubtful] = check(&cloud, &view, settings, &[Way::Compute64]);
    assert!(changed > 10_000 && doubtful < changed, "{changed} changed, {doubtful} doubtful");
}

/// Returns the colours of a part of the picture, drawn as the whole is.
fn colors(gpu: &mut Gpu, resident: &Resident, config: &FrameConfig, part: &View) -> Vec<[f32; 4]> {
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, part, resident, config).unwrap();
    let color = g.download(&outcome.gbuffer.color);
    let frame = g.submit_and_wait(&[]).unwrap();

    frame.read(&color).to_vec()
}

/// Colours have codes for 255 stations, but nodes tell any.
#[test]
fn a_node_of_one_station_knows_it_however_many_there_are() {
    let many = POINTS_PER_PAGE as usize;
    let single = (0..300).map(|station: i32| ([10 * station, 0, 0], station));
    let heap = |station: i32| std::iter::repeat_n(([5000 * station, 0, 0], station), many);
    let (points, stations): (Vec<[i32; 3]>, Vec<i32>) =
        single.chain(heap(7)).chain(heap(299)).unzip();
    let colors = vec![[90; 3]; points.len()];
    let mut cloud = cloud(vec![part(LATTICE, &points, Some(colors))]);
    let sources = stations.iter().map(|&station| 2 * station as u16);
    cloud.parts[0].columns.source = Some(sources.collect());
    cloud.stations = cloud::stations(&cloud.parts[0], 0);
    let (shown, _) = DisplayAttribute::automatic(&cloud);
    for kind in [false, true] {
        let mut shown = shown;
        shown.further.kind = kind;
        with(Way::Compute64, |gpu| {
            let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
            let known = resident.nodes.iter().map(|node| node.station).collect::<Vec<_>>();
            assert_eq!(known, [None, Some(7), Some(299)], "with kinds: {kind}");
        });
    }
}

/// Four stations lie side by side, and the second and the third meet. Pixels there are means,
/// others are unchanged.
#[test]
fn what_one_station_alone_has_seen_keeps_its_colours() {
    let mut random = Random(0x51DE);
    let stations = [-14_000, -5_000, 1_000, 12_000].map(|x| {
        let (points, colors) = bumpy(40_000, 8_000, &mut random);
        part(
            LATTICE,
            &points.iter().map(|p| [p[0] + x, p[1], p[2]]).collect::<Vec<_>>(),
            Some(colors),
        )
    });
    let mut cloud = cloud(stations.to_vec());
    cloud.stations = cloud
        .parts
        .iter()
        .enumerate()
        .flat_map(|(number, part)| cloud::stations(part, number))
        .collect();
    let camera = orthographic(LATTICE.offset + DVec3::new(0.0, 0.0, 30.0), LATTICE.offset, 10.0);
    let view = View::new(camera, [900, 260]).unwrap();
    let [off, on] = [Switch::Off, Switch::On].map(|switch| {
        let mut settings = bare();
        settings.effects.exposure.switch = Switch::Off;
        settings.effects.luminance.switch = switch;
        settings
    });
    for way in WAYS {
        with(way, |gpu| {
            let (shown, _) = DisplayAttribute::automatic(&cloud);
            let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
            let overlap = resident.overlap(&view);
            assert!(overlap.count > 0 && overlap.count < overlap.seen, "{overlap:?}");
            let walked: Vec<bool> =
                resident.nodes.iter().map(|node| overlap.touches(&view, node)).collect();
            assert_eq!(walked, [false, true, true, false]);
            let [off, on] =
                [&off, &on].map(|settings| FrameConfig::new(settings, &view, &resident));
            let auto = FrameConfig { overlap: Arc::new(overlap.clone()), ..on.clone() };
            let [plain, means, partly] =
                [&off, &on, &auto].map(|config| colors(gpu, &resident, config, &view));
            let mut differ = 0;
            for (i, partly) in partly.iter().enumerate() {
                let [x, y] = [i as u32 % 900, i as u32 / 900];
                let several =
                    overlap.several[(y / OVERLAP_PX * overlap.size[0] + x / OVERLAP_PX) as usize];
                assert_eq!(
                    partly,
                    if several { &means[i] } else { &plain[i] },
                    "{way:?} pixel {x} {y}"
                );
                differ += (means[i] != plain[i]) as usize;
            }
            assert!(differ > 10_000, "{differ}");
            let window = view.window([312, 64], [264, 128]);
            let piece = colors(gpu, &resident, &auto, &window);
            // Means look at a neighbour.
            for (i, color) in piece.iter().enumerate() {
                let [x, y] = [i % 264, i / 264];
                let is_inside = (1..263).contains(&x) && (1..127).contains(&y);
                assert!(
                    !is_inside || *color == partly[(y + 64) * 900 + x + 312],
                    "{way:?} pixel {x} {y} of a piece"
                );
            }
            // Hidden points disagree with no station.
            let mut resident = resident;
            let mut without = |number: &str| {
                resident.opacities =
                    Opacities(vec![Rule { what: What::Station(number.into()), opacity: 0.0 }]);
                resident.overlap(&view).count
            };
            assert_eq!([without("2"), without("1")], [0, overlap.count]);
        });
    }
}
