//! One exposure for all stations, against colours that were evened beforehand on the CPU.

use crate::cameras::{orthographic, perspective};
use crate::gpu::{WAYS, Way, bare, draw, part};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::colormap::linear_to_srgb;
use pointillist::cloud::{Cloud, Lattice, Station};
use pointillist::index::attributes::exposure::balance;
use pointillist::passes::resolve;
use pointillist::render::settings::RenderSettings;
use pointillist::study::oracle::exposure as oracle;
use pointillist::view::View;
use std::collections::HashSet;

const LATTICE: Lattice =
    Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };

/// Returns three stations, two of them in one file, with no two points in one place and gains other
/// than 1.
fn scene() -> Cloud {
    let (points, colors) = bumpy(60_000, 20_000, &mut Random(0xE4905));
    let mut taken = HashSet::new();
    let (points, colors): (Vec<_>, Vec<_>) =
        points.into_iter().zip(colors).filter(|(point, _)| taken.insert(*point)).unzip();
    let lit = |i: usize, light: f64| colors[i].map(|v| (v as f64 * light).round() as u8);
    let of = |stations: &[(u16, f64)], rest: usize| {
        let own: Vec<usize> = (0..points.len()).filter(|i| i % 2 == rest).collect();
        let station = |i: usize| stations[i / 2 % stations.len()];
        let places: Vec<_> = own.iter().map(|&i| points[i]).collect();
        let mut part =
            part(LATTICE, &places, Some(own.iter().map(|&i| lit(i, station(i).1)).collect()));
        part.columns.source = Some(own.iter().map(|&i| station(i).0).collect());
        part
    };
    let parts = vec![of(&[(3, 1.0), (700, 0.6)], 0), of(&[(3, 0.35)], 1)];
    let count = |part: usize, source: u16| {
        parts[part].columns.source.iter().flatten().filter(|own| **own == source).count() as u64
    };
    let stations = [(0, 3), (0, 700), (1, 3)].map(|(part, source)| Station {
        part,
        source: Some(source),
        name: format!("{part} {source}"),
        points: count(part, source),
    });
    Cloud { parts, stations: stations.to_vec(), ..Cloud::default() }
}

/// Returns the same cloud with colours of 8 bits that have one exposure.
fn evened(cloud: &Cloud, gains: &[f64]) -> Cloud {
    assert!(gains[0] < 0.8 && gains[2] > 1.5, "{gains:?}");
    let levels =
        resolve::levels(&DisplayAttribute::indexed(Attribute::Rgb, [0.0; 2], [0, 255]), gains);
    let mut evened = cloud.clone();
    for (number, part) in evened.parts.iter_mut().enumerate() {
        let source = part.columns.source.as_ref().unwrap();
        for (color, source) in part.columns.rgb.as_mut().unwrap().iter_mut().zip(source) {
            let station = cloud
                .stations
                .iter()
                .position(|own| own.part == number && own.source == Some(*source))
                .unwrap();
            *color = color.map(|v| levels[256 * station + v as usize] as u8);
        }
    }
    evened
}

fn settings(effects: &[&str]) -> RenderSettings {
    let mut settings = bare();
    effects.iter().for_each(|effect| settings.effects.set_any(effect).unwrap());
    settings
}

#[test]
fn exposures_are_those_of_colours_that_were_made_even_beforehand() {
    let cloud = scene();
    let gains = balance(&cloud).unwrap().gains;
    let evened = evened(&cloud, &gains);
    let around = |x, y, z| LATTICE.offset + DVec3::new(x, y, z);
    for camera in [
        perspective(around(11.0, -17.0, 9.0), LATTICE.offset, 50.0),
        orthographic(around(5.0, 6.0, 30.0), around(0.1, 0.2, 0.3), 19.0),
    ] {
        let view = View::new(camera, [127, 61]).unwrap();
        let (plain, got) = (
            draw(Way::Compute64, &cloud, &view, &bare()),
            draw(Way::Compute64, &cloud, &view, &settings(&["exposure=on"])),
        );
        let twin = draw(Way::Compute64, &evened, &view, &bare());
        got.assert_finite();
        assert!(got.depth == twin.depth && got.index == twin.index);
        let code = |linear: f32| 255.0 * linear_to_srgb(linear as f64);
        let drawn = got.color.iter().zip(&plain.color).filter(|(color, _)| color[3] > 0.0);
        for (got, plain) in drawn {
            let of = |gain: &f64| {
                (0..3).all(|c| got[c] == oracle::linear(code(plain[c]).round() as u8, *gain) as f32)
            };
            assert!(gains.iter().any(of), "{plain:?} became {got:?}");
        }
        let colors = || got.color.iter().zip(&twin.color);
        // These are not rounded to 8 bits.
        assert!(
            colors()
                .all(|(got, twin)| (0..3).all(|c| (code(got[c]) - code(twin[c])).abs() < 0.501)
                    && got[3] == twin[3])
        );
        assert!(
            got.color.iter().zip(&plain.color).filter(|(got, plain)| got != plain).count() > 1000
        );
        // Sums are of 8-bit values, and therefore the same.
        for luminance in ["luminance=on", "luminance=on,space=rgb,neighbourhood=1,epsilon=0.5"] {
            let twin = draw(Way::Compute64, &evened, &view, &settings(&[luminance]));
            for way in WAYS {
                assert!(
                    draw(way, &cloud, &view, &settings(&["exposure=on", luminance])).bits()
                        == twin.bits(),
                    "{luminance} {way:?}"
                );
            }
        }
    }
}
