//! Which point a pixel shows, which colour it has, and at which sizes (guide: numerics, case 4 to
//! 6, case 24, case 25).

use crate::cameras::{orthographic, perspective};
use crate::gpu::{WAYS, Way, bare, cloud, draw, part};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::{self, ColumnSet, Lattice, ReadOptions};
use pointillist::config::{
    CHUNKS_PER_PAGE, NEAR_M, NO_POINT, PAGES_PER_BLOCK, POINTS_PER_CHUNK, POINTS_PER_PAGE,
};
use pointillist::passes::project::Precision;
use pointillist::progress::Silent;
use pointillist::render::settings::RenderSettings;
use pointillist::study::oracle::project;
use pointillist::synth::chunk::{Chunk, Lattice as FileLattice};
use pointillist::synth::las_file::LasFile;
use pointillist::view::View;
use rayon::prelude::*;

/// Two layers are two quanta of f32 apart. The nearer is drawn in every pixel, at its own depth.
/// Lattice steps are one quantum, and the camera looks along an axis: depths are whole steps, and
/// no rounding can hide anything.
#[test]
fn hard_04_depth_quanta() {
    for depth in [1.0, 64.0, 1024.0, 8192.0] {
        let quantum = depth * 2f64.powi(-23);
        let aside = |i: i32| (i - 8) << 12;
        let grid = |y: i32| {
            (0..16).flat_map(move |x| (0..16).map(move |z| [aside(x) + 2048, y, aside(z) + 2048]))
        };
        // The farther layer comes first, then the nearer, then the farther again: the order must
        // not matter.
        let points: Vec<_> =
            grid((1 << 23) + 2).chain(grid(1 << 23)).chain(grid((1 << 23) + 2)).collect();
        let cloud = cloud(vec![part(
            Lattice { step: DVec3::splat(quantum), offset: DVec3::ZERO },
            &points,
            None,
        )]);
        let view =
            View::new(orthographic(DVec3::ZERO, DVec3::Y, 16.0 * 4096.0 * quantum), [16, 16])
                .unwrap();
        let exact = RenderSettings { precision: Precision::Planes(3), ..bare() };
        assert_eq!(
            draw(Way::Compute64, &cloud, &view, &exact).depth,
            vec![depth as f32; 256],
            "at {depth} m"
        );
        // Without the nearer layer all is two quanta farther: nothing is rounded onto anything.
        let mut behind = cloud.clone();
        let keep = |column: &mut Vec<i32>| *column = column[..256].to_vec();
        let columns = &mut behind.parts[0].columns;
        [&mut columns.x, &mut columns.y, &mut columns.z].into_iter().for_each(keep);
        assert_eq!(
            draw(Way::Compute64, &behind, &view, &exact).depth,
            vec![(depth + 2.0 * quantum) as f32; 256],
            "at {depth} m"
        );
    }
}

/// A key is `depth bits << 32 | id`, and a point is kept if `depth >= near`. Over all 2^32
/// patterns, kept depths are ordered as their bits are, each before the next. Others are NaN,
/// negative, -0, or nearer than `near`.
#[test]
fn hard_05_packed_ordering() {
    let key = |bits: u32, id: u32| (bits as u64) << 32 | id as u64;
    let kept = |bits: u32| f32::from_bits(bits) >= NEAR_M;
    let (near, infinity) = (NEAR_M.to_bits(), f32::INFINITY.to_bits());
    (0..1u32 << 12).into_par_iter().for_each(|block| {
        let mut wrong = 0u32;
        for low in 0..1u32 << 20 {
            let bits = block << 20 | low;
            let expected = (near..=infinity).contains(&bits);
            wrong += (kept(bits) != expected) as u32;
            // The smaller of two kept neighbours has the smaller key, whatever the ids.
            let ordered = f32::from_bits(bits) < f32::from_bits((bits + 1) & 0x7FFF_FFFF)
                && key(bits, NO_POINT) < key(bits.wrapping_add(1), 0);
            wrong += (expected && bits < infinity && !ordered) as u32;
        }
        assert_eq!(wrong, 0, "among the patterns from {:#x}", block << 20);
    });
    // Equal depths are ordered by id. The value for "no point" is greater than the key of any
    // finite depth.
    assert!(key(near, 0) < key(near, 1) && key(infinity, NO_POINT) < u64::MAX);
}

#[test]
fn hard_05_coincident_points_show_the_same_one_whatever_their_order() {
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
    let colors: Vec<[u8; 3]> = (0..100u8).map(|i| [i + 1, 255 - i, i / 2]).collect();
    let picture = |colors: Vec<[u8; 3]>| {
        let cloud = cloud(vec![part(lattice, &[[0, 1000, 0]; 100], Some(colors))]);
        draw(
            Way::Compute64,
            &cloud,
            &View::new(perspective(DVec3::ZERO, DVec3::Y, 60.0), [3, 3]).unwrap(),
            &bare(),
        )
    };
    let forward = picture(colors.clone());
    let backward = picture(colors.into_iter().rev().collect());
    assert!(forward.bits() == backward.bits());
    assert_eq!(forward.index.iter().filter(|id| **id != NO_POINT).count(), 1);
}

/// Chunk counts at +-1 of 65,535 workgroups cannot occur: a dispatch walks the nodes of one block
/// of 256 pages, every node takes at least two pages, so there are at most 2,048 chunks.
#[test]
fn hard_06_a_dispatch_never_has_more_workgroups_than_one_row() {
    const { assert!(PAGES_PER_BLOCK / 2 * CHUNKS_PER_PAGE <= 65_535) };
    assert_eq!(CHUNKS_PER_PAGE * POINTS_PER_CHUNK, POINTS_PER_PAGE);
}

/// Counts lie at +-1 of what a lane, a chunk and a page hold.
#[test]
fn hard_06_counts_around_every_limit() {
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
    for limit in [4, 32, 4096, 8192, 65_536, 2 * 65_536] {
        for count in limit - 1..=limit + 1 {
            // Every point has its own pixel, so lost and repeated ones are counted.
            let width = 512;
            let points: Vec<_> =
                (0..count).map(|i| [(i % width) * 10 + 5, (i / width) * 10 + 5, 0]).collect();
            let cloud = cloud(vec![part(lattice, &points, None)]);
            let eye = DVec3::new(2.56, 2.56, 1.0);
            let view = View::new(orthographic(eye, eye - DVec3::Z, 5.12), [512, 512]).unwrap();
            for way in WAYS {
                let layers = draw(
                    way,
                    &cloud,
                    &view,
                    &RenderSettings { precision: Precision::Planes(3), ..bare() },
                );
                let mut ids: Vec<u32> =
                    layers.index.into_iter().filter(|id| *id != NO_POINT).collect();
                ids.sort_unstable();
                ids.dedup();
                assert_eq!(ids.len(), count as usize, "{way:?}");
            }
        }
    }
}

#[test]
fn hard_06_sizes() {
    let (points, colors) = bumpy(100_000, 20_000, &mut Random(6));
    let lattice =
        Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 0.0) };
    let cloud = cloud(vec![part(lattice, &points, Some(colors))]);
    for size in [
        [1, 1],
        [1, 2],
        [3, 1],
        [1, 16_384],
        [16_384, 1],
        [127, 251],
        [509, 13],
        [2, 8191],
        [8191, 3],
        [64, 64],
        [65, 64],
        [63, 64],
    ] {
        for camera in [
            perspective(lattice.offset + DVec3::new(0.0, -30.0, 12.0), lattice.offset, 60.0),
            orthographic(
                lattice.offset + DVec3::Z * 20.0,
                lattice.offset,
                20.0 * (size[1] as f64 / size[0] as f64).min(1.0),
            ),
        ] {
            let view = View::new(camera, size).unwrap();
            let [by64, by32] = WAYS.map(|way| draw(way, &cloud, &view, &bare()));
            assert!(by64.bits() == by32.bits(), "{size:?}");
            by64.assert_finite();
            let source = project::Source::new(&cloud.parts[0], &view, Precision::Auto, DVec3::ZERO);
            let agreement = project::check(
                &view,
                &[(source, project::positions(&cloud.parts[0], camera.eye))],
                &by64.depth,
            );
            println!("{size:?} {agreement:?}");
            assert_eq!(agreement.objection(), None, "{size:?} {camera:?}");
        }
    }
}

/// A LAS file has all 65,536 values in each channel.
#[test]
fn hard_24_16_bit_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("colours.las");
    let lattice = FileLattice { step: 0.001, offset: DVec3::ZERO };
    let mut chunk = Chunk::new(lattice, 1 << 16);
    for v in 0..=u16::MAX {
        chunk.x.push(v as i32);
        [&mut chunk.y, &mut chunk.z].into_iter().for_each(|column| column.push(0));
        chunk.rgb.push([v, u16::MAX - v, v.rotate_left(8)]);
        [&mut chunk.intensity, &mut chunk.source].into_iter().for_each(|column| column.push(0));
        chunk.class.push(0);
        chunk.returns.push((1, 1));
        chunk.gps_time.push(0.0);
        chunk.scan_angle.push(0);
    }
    let mut file = LasFile::create(&path, lattice, 1 << 16).unwrap();
    file.write(&chunk).unwrap();
    file.finish().unwrap();
    let cloud = cloud::read(&[path], &ReadOptions::new(ColumnSet::ALL, true), &Silent).unwrap();
    let part = &cloud.parts[0];
    assert_eq!(part.rgb_scale.bits(), 16);
    // 65535 = 255 * 257, and v / 257 is never a half: rounding has one answer.
    let exact = |v: u16| (v as f64 / 257.0).round() as u8;
    for (color, expected) in part.columns.rgb.as_ref().unwrap().iter().zip(&chunk.rgb) {
        assert_eq!(*color, expected.map(exact));
    }
}

/// The second of two passes recomputes the depths of the first. If one bit differed, a covered
/// pixel would find no point at its depth, and keep "no point".
#[test]
fn hard_25_two_passes_one_depth() {
    let (points, colors) = bumpy(200_000, 2_000_000, &mut Random(25));
    let lattice =
        Lattice { step: DVec3::splat(1e-5), offset: DVec3::new(500_000.0, 5_000_000.0, 0.0) };
    let cloud = cloud(vec![part(lattice, &points, Some(colors))]);
    for eye in [DVec3::new(13.0, -21.0, 7.0), DVec3::new(0.1, 0.2, 0.3), DVec3::new(1e5, 1e5, 1e5)]
    {
        let view =
            View::new(perspective(lattice.offset + eye, lattice.offset, 60.0), [400, 300]).unwrap();
        for precision in [Precision::Planes(1), Precision::Planes(2), Precision::Auto] {
            let layers =
                draw(Way::Compute32, &cloud, &view, &RenderSettings { precision, ..bare() });
            let covered = layers.depth.iter().filter(|z| z.is_finite()).count();
            assert!(covered > 0);
            assert_eq!(
                layers.index.iter().filter(|id| **id != NO_POINT).count(),
                covered,
                "{precision:?}"
            );
        }
    }
}
