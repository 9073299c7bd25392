//! Colour and sums (guide: numerics, case 22, case 23, case 25).

use crate::cameras::{orthographic, perspective};
use crate::gpu::{WAYS, Way, bare, cloud, division_error, draw, part, with};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::attribute::DisplayAttribute;
use pointillist::cloud::{Cloud, Lattice};
use pointillist::graph::Graph;
use pointillist::passes::{Switch, luminance};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::Resident;
use pointillist::study::oracle::luminance as oracle;
use pointillist::view::View;

const METRES: Lattice = Lattice { step: DVec3::ONE, offset: DVec3::ZERO };

fn corrected(luminance: luminance::Settings) -> RenderSettings {
    let mut settings = bare();
    settings.effects.luminance.switch = Switch::On;
    settings.effects.luminance.settings = luminance;
    settings
}

fn alone(epsilon: f64) -> luminance::Settings {
    luminance::Settings { space: luminance::Space::Hsv, neighbourhood: 1.0, epsilon }
}

/// Returns a view from above. The lattice's cells from `(0, 0)` on are pixels from the lower left.
fn from_above(side: u32) -> View {
    let middle = DVec3::new(side as f64 / 2.0 - 0.5, side as f64 / 2.0 - 0.5, 0.0);
    let camera = pointillist::view::Camera {
        up: DVec3::Y,
        ..orthographic(middle + 16.0 * DVec3::Z, middle, side as f64)
    };
    View::new(camera, [side; 2]).unwrap()
}

/// Each of all 2^24 colours lies before a point of another value, so V becomes the mean of the two.
/// The result is that of hue and saturation.
#[test]
fn hard_22_hsv() {
    const SIDE: i32 = 1024;
    let view = from_above(SIDE as u32);
    let mut black = 0;
    for block in 0..16u32 {
        let color = |i: i32| [(block << 4 | i as u32 >> 16) as u8, (i >> 8) as u8, i as u8];
        let behind = |i: i32| (i as u32).wrapping_mul(2_654_435_761).to_le_bytes()[3];
        let cells = SIDE * SIDE;
        let points: Vec<_> = (0..2 * cells)
            .map(|i| [i % cells % SIDE, i % cells / SIDE, if i < cells { 1 } else { 0 }])
            .collect();
        let colors = (0..2 * cells)
            .map(|i| if i < cells { color(i) } else { [behind(i - cells), 0, 0] })
            .collect();
        let cloud = cloud(vec![part(METRES, &points, Some(colors))]);
        let got = draw(Way::Compute64, &cloud, &view, &corrected(alone(2.0)));
        for i in 0..cells {
            let [r, g, b] = color(i);
            let value = (r.max(g).max(b) as f64 + behind(i) as f64) / 2.0;
            let expected = oracle::with_value([r, g, b], value).map(oracle::linear);
            let drawn = got.color[((SIDE - 1 - i / SIDE) * SIDE + i % SIDE) as usize];
            assert!(
                (0..3).all(|c| expected[c].holds(drawn[c])),
                "{:?} with V {value}: {drawn:?}, not {expected:?}",
                [r, g, b]
            );
            black += ([r, g, b] == [0; 3] && drawn[..3] == [drawn[0]; 3]) as usize;
        }
    }
    assert_eq!(black, 1, "black becomes grey");
}

/// One pixel has as many white points as u32 sums of 16 and of 8 bits wrap at. Their mean is white.
#[test]
fn hard_23_sums() {
    for count in [65_538, 16_843_010] {
        let side = (count as f64).sqrt().ceil() as i32;
        let points: Vec<_> = (0..count).map(|i| [i % side, i / side, 0]).collect();
        let step = 0.5 / side as f64;
        let lattice = Lattice { step: DVec3::splat(step), offset: DVec3::new(0.25, 0.25, 0.0) };
        let cloud = cloud(vec![part(lattice, &points, Some(vec![[255; 3]; count as usize]))]);
        let view = View::new(
            pointillist::view::Camera {
                up: DVec3::Y,
                ..orthographic(DVec3::new(0.5, 0.5, 16.0), DVec3::new(0.5, 0.5, 0.0), 1.0)
            },
            [1, 1],
        )
        .unwrap();
        for way in WAYS {
            let (colors, counts) = drawn_and_counted(way, &cloud, &view, &corrected(alone(1.0)));
            let error = with(way, |gpu| division_error(&gpu.device));
            let is_white = colors[0].iter().all(|channel| (channel - 1.0).abs() <= error);
            assert!(counts[0] == count as u64 && is_white, "{way:?}: {counts:?} {colors:?}");
        }
    }
}

/// Returns the colours of all pixels, and how many points each is the mean of.
fn drawn_and_counted(
    way: Way,
    cloud: &Cloud,
    view: &View,
    settings: &RenderSettings,
) -> (Vec<[f32; 4]>, Vec<u64>) {
    with(way, |gpu| {
        let (shown, _) = DisplayAttribute::automatic(cloud);
        let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
        let config = FrameConfig::new(settings, view, &resident);
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, &resident, &config).unwrap();
        let color = g.download(&outcome.gbuffer.color);
        let sums = g.find_buffer("sums").unwrap();
        let sums = g.download_buffer(&sums);
        let frame = g.submit_and_wait(&[]).unwrap();

        (
            frame.read(&color).to_vec(),
            frame.read::<u64>(&sums).iter().map(|sum| sum >> 36).collect(),
        )
    })
}

/// Coordinates are those of a projected system, seen at an angle. The epsilon is below the ulp of
/// depths, and the front point still finds itself.
#[test]
fn hard_25_two_passes_one_depth() {
    let (points, colors) = bumpy(200_000, 20_000, &mut Random(0x25));
    let lattice =
        Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };
    let cloud = cloud(vec![part(lattice, &points, Some(colors))]);
    let view = View::new(
        perspective(lattice.offset + DVec3::new(11.0, -17.0, 9.0), lattice.offset, 50.0),
        [331, 257],
    )
    .unwrap();
    for way in WAYS {
        let (colors, counts) = drawn_and_counted(way, &cloud, &view, &corrected(alone(1e-30)));
        let covered = colors.iter().filter(|color| color[3] > 0.0).count();
        assert!(covered > 10_000);
        assert!(
            colors.iter().zip(&counts).all(|(color, &count)| (color[3] > 0.0) == (count > 0)),
            "{way:?}"
        );
    }
}

#[test]
fn hard_23_any_order_and_fifty_runs_give_the_same_picture() {
    let (mut points, mut colors) = bumpy(60_000, 20_000, &mut Random(0x23));
    let lattice =
        Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };
    let view = View::new(
        perspective(lattice.offset + DVec3::new(11.0, -17.0, 9.0), lattice.offset, 50.0),
        [63, 47],
    )
    .unwrap();
    let straight = cloud(vec![part(lattice, &points, Some(colors.clone()))]);
    let random = &mut Random(0x5FF1E);
    for i in (1..points.len()).rev() {
        let j = (random.bits() % (i as u64 + 1)) as usize;
        points.swap(i, j);
        colors.swap(i, j);
    }
    let shuffled = cloud(vec![part(lattice, &points, Some(colors))]);
    for space in [luminance::Space::Hsv, luminance::Space::Rgb] {
        let settings = corrected(luminance::Settings { space, neighbourhood: 3.0, epsilon: 0.1 });
        let first = draw(Way::Compute64, &straight, &view, &settings);
        for run in 0..50 {
            let cloud = if run % 2 == 0 { &shuffled } else { &straight };
            assert!(
                first.bits() == draw(WAYS[run / 2 % 2], cloud, &view, &settings).bits(),
                "{space:?} run {run}"
            );
        }
    }
}
