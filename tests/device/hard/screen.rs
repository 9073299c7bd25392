//! Silhouettes, small filters, and light on the screen (guide: numerics, the rules, case 12, case
//! 17, case 26).

use crate::gpu::{CANVAS_POINTS, canvas, effects, random_keys, views};
use crate::points::Random;
use glam::DVec3;
use pointillist::config::NO_POINT;
use pointillist::view::Projection;
use pointillist::view::light::Light;

/// The 1/z of tilted planes, grazing ones too, is affine, and gives no edge above 16 ulps. The
/// Laplacian of z itself does.
#[test]
fn hard_12_silhouettes() {
    let size = [127, 61];
    let view = views(size)[0];
    assert_eq!(view.camera.projection, Projection::Perspective);
    let jump = 16.0 / (1u64 << 23) as f64;
    canvas(|canvas| {
        let mut bent = 0;
        for (tilt_x, tilt_y) in
            [(0.0, 0.0), (1e-4, 2e-4), (1e-3, -5e-4), (7e-3, 3e-3), (-7.8e-3, 1e-3)]
        {
            let key = |i: u32| {
                let (x, y) = ((i % size[0]) as f64 - 63.0, (i / size[0]) as f64 - 30.0);
                [i % CANVAS_POINTS, ((7.0 / (1.0 + tilt_x * x + tilt_y * y)) as f32).to_bits()]
            };
            let keys: Vec<_> = (0..size[0] * size[1]).map(key).collect();
            let mut draw = |laplacian: &str| {
                let surface = canvas.draw(
                    &view,
                    &keys,
                    &effects(&[&format!("antialias=on,laplacian={laplacian},jump={jump}")]),
                );
                let inner =
                    |i: &usize| (1..126).contains(&(i % 127)) && (1..60).contains(&(i / 127));
                (0..keys.len())
                    .filter(inner)
                    .filter(|&i| surface.blended.color[i] != surface.raw.color[i])
                    .count()
            };
            assert_eq!(draw("inverse"), 0, "{tilt_x} {tilt_y}");
            bent += draw("depth");
        }
        assert!(bent > 1000, "{bent}");
    });
}

/// Half a pixel of white over black is half the light: 0.5 linear, which a screen shows as 188.
#[test]
fn hard_17_blending_space() {
    let size = [16, 16];
    canvas(|canvas| {
        let view = views(size)[0];
        let keys: Vec<_> = (0..256)
            .map(|i| if i % 16 < 8 { [9, 5f32.to_bits()] } else { [NO_POINT; 2] })
            .collect();
        let surface = canvas.draw(&view, &keys, &effects(&["antialias=on"]));
        let (inside, beside, outside) = (
            surface.raw.color[7 * 16 + 3],
            surface.blended.color[7 * 16 + 7],
            surface.blended.color[7 * 16 + 8],
        );
        // Three quarters of the weights 1 2 1 lie on the side of the surface, a quarter on the
        // other.
        for c in 0..3 {
            assert!(
                (beside[c] - 0.75 * inside[c]).abs() < 1e-6
                    && (outside[c] - 0.25 * inside[c]).abs() < 1e-6,
                "{inside:?} {beside:?} {outside:?}"
            );
        }
        assert_eq!((beside[3], outside[3]), (0.75, 0.25));
        let picture = surface.picture[7 * 16 + 8];
        assert!((picture[2] - (0.25 * inside[2] + 0.75 * 0.7)).abs() < 1e-6, "{picture:?}");
        assert!(
            surface.blended.color[7 * 16 + 10] == [0.0; 4]
                && surface.blended.color[7 * 16 + 5] == inside
        );
    });
}

/// Constants are unchanged to the last bit, beside holes and at the picture's edges, however often
/// filters run.
#[test]
fn hard_26_small_filters() {
    let random = &mut Random(26);
    let size = [65, 33];
    canvas(|canvas| {
        for z in [1e-3f32, 0.7, 1.0f32.next_up(), 5.3, 1000.0, 1e6, 3e38] {
            for filter in ["alleviated", "gaussian", "box"] {
                for missing in [0, 3] {
                    let keys: Vec<_> = (0..65 * 33)
                        .map(|_| {
                            if random.bits() % 8 < missing {
                                [NO_POINT; 2]
                            } else {
                                [5, z.to_bits()]
                            }
                        })
                        .collect();
                    let surface = canvas.draw(
                        &views(size)[1],
                        &keys,
                        &effects(&[&format!("smooth=on,filter={filter},iterations=5,pixels=all")]),
                    );
                    assert!(surface.smoothed == surface.raw, "{filter} at {z}");
                }
            }
        }
    });
}

/// guide: numerics, rule 5: whatever the depths, settings and light are, nothing is NaN, and only
/// the background's depth is infinite.
#[test]
fn hard_00_light_and_filters_leave_nothing_that_is_no_number() {
    let random = &mut Random(0x1165);
    let wild = |bits: u32| bits & 0x7F80_0000 == 0x7F80_0000;
    let lights = [
        Light::Headlight,
        Light::Direction(DVec3::new(1e-100, 1e-3, -1e3)),
        Light::Position(DVec3::new(5e6, 5e6, 100.0)),
        Light::Position(DVec3::ZERO),
    ];
    canvas(|canvas| {
        for size in [[1, 1], [7, 3], [65, 33]] {
            for view in views(size) {
                for light in lights {
                    for asked in [
                        ["fill=on,method=mask", "smooth=on", "phong=on", "antialias=on"],
                        [
                            "fill=on,method=mask,layer=1e9",
                            "smooth=on,filter=box,iterations=4,pixels=all",
                            "phong=on,radius=7",
                            "antialias=on,laplacian=depth",
                        ],
                        [
                            "fill=on,method=mask,layer=1e-300,iterations=40",
                            "shape=on",
                            "phong=on,radius=1,shininess=255",
                            "antialias=on,jump=0,threshold=high",
                        ],
                    ] {
                        let mut keys = random_keys(size, CANVAS_POINTS, random);
                        for key in keys.iter_mut().filter(|key| key[0] != NO_POINT) {
                            match random.bits() % 40 {
                                0 => key[1] = pointillist::config::NEAR_M.to_bits(),
                                1 => key[1] = 3e38f32.to_bits(),
                                _ => {}
                            }
                        }
                        let surface = canvas.draw_in(light, &view, &keys, &effects(&asked));
                        let colors = surface
                            .smoothed
                            .color
                            .iter()
                            .chain(&surface.shaded.color)
                            .chain(&surface.blended.color)
                            .chain(&surface.picture);
                        let floats = colors.flatten().chain(&surface.lit).chain(&surface.left);
                        let count = floats.filter(|value| wild(value.to_bits())).count();
                        let depths = surface
                            .blended
                            .depth
                            .iter()
                            .filter(|z| wild(z.to_bits()) && **z != f32::INFINITY)
                            .count();
                        assert_eq!(
                            (count, depths),
                            (0, 0),
                            "{:?} {size:?} {light} {asked:?}",
                            view.camera.projection
                        );
                    }
                }
            }
        }
    });
}
