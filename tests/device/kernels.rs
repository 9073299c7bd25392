//! Every kernel against its f64 twin: random input, odd sizes, core and synchronization validation.
//! A validation message fails the submission, and the test.
//!
//! Images are reused with the pixels of an earlier frame. A pixel that a kernel omits shows another
//! frame's value, which no twin gives.

mod antialias;
mod ao;
mod encode;
mod exposure;
mod fill_mask;
mod luminance;
mod phong;
mod pullpush;
mod smooth;
mod splat;
mod surface;

use crate::cameras::{orthographic, perspective};
use crate::gpu::{self, WAYS, Way, bare, cloud, draw, part, random_keys};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::colormap::srgb_to_linear;
use pointillist::cloud::{Cloud, Columns, Lattice};
use pointillist::config::{NO_POINT, POINTS_PER_PAGE};
use pointillist::error::Error;
use pointillist::graph::{Gpu, Graph};
use pointillist::index::build::pack;
use pointillist::index::build::partition::PLACE_WORDS;
use pointillist::index::{self, Arrangement, Row};
use pointillist::passes::project::{Keys, Precision, Strip};
use pointillist::passes::{FrameContext, Switch, composite, edl, resolve};
use pointillist::progress::Silent;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::Resident;
use pointillist::study::oracle::{Bounded, edl as edl_oracle, project};
use pointillist::view::light::Light;
use pointillist::view::{Camera, View};
use std::ops::Range;

const SIZES: [[u32; 2]; 5] = [[1, 1], [1, 127], [127, 1], [63, 65], [331, 257]];

const UTM: Lattice =
    Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };

fn cameras() -> [Camera; 3] {
    let around = |x, y, z| UTM.offset + DVec3::new(x, y, z);
    [
        perspective(around(17.0, -23.0, 11.0), UTM.offset, 50.0),
        // The eye is inside of the cloud, with points behind and beside it.
        perspective(around(0.3, 0.2, 0.05), around(4.0, 1.0, 0.0), 75.0),
        orthographic(around(5.0, 6.0, 30.0), around(0.1, 0.2, 0.3), 19.0),
    ]
}

/// Returns three bumpy layers, 20 m wide, on the millimetre lattice of a projected coordinate
/// system.
fn scene(points: usize) -> Cloud {
    let (points, colors) = bumpy(points, 20_000, &mut Random(0x5EED));
    cloud(vec![part(UTM, &points, Some(colors))])
}

#[test]
fn project_and_resolve_agree_with_f64_and_both_key_ways_with_each_other() {
    let cloud = scene(150_000);
    for size in SIZES {
        for camera in cameras() {
            let view = View::new(camera, size).unwrap();
            for precision in [Precision::Auto, Precision::Planes(3)] {
                let settings = RenderSettings { precision, ..bare() };
                let [by64, by32] = WAYS.map(|way| draw(way, &cloud, &view, &settings));
                assert!(by64.bits() == by32.bits(), "{size:?} {camera:?}: the two ways differ");
                by64.assert_finite();
                let part = &cloud.parts[0];
                let source = project::Source::new(part, &view, precision, DVec3::ZERO);
                let agreement = project::check(
                    &view,
                    &[(source, project::positions(part, camera.eye))],
                    &by64.depth,
                );
                println!("{size:?} {:?} {precision:?} {agreement:?}", camera.projection);
                assert_eq!(agreement.objection(), None, "{size:?} {camera:?} {precision:?}");
                assert!(
                    by64.depth
                        .iter()
                        .zip(&by64.index)
                        .all(|(z, &id)| (*z == f32::INFINITY) == (id == NO_POINT))
                );
            }
        }
    }
}

/// Layers that a frame makes of given keys.
struct Resolved {
    depth: Vec<f32>,
    index: Vec<u32>,
    color: Vec<[f32; 4]>,
    lit: Vec<[f32; 4]>,
    picture: Vec<[f32; 4]>,
}

const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.7];

fn resolved(
    cloud: &Cloud,
    attribute: Attribute,
    view: &View,
    settings: &edl::Settings,
    keys: &[[u32; 2]],
) -> Resolved {
    gpu::with(Way::Compute64, |gpu| {
        let resident =
            Resident::fill(gpu, cloud.clone(), DisplayAttribute::new(attribute, cloud), &Silent)
                .unwrap();
        let mut g = Graph::new(gpu);
        let uploaded = g.upload("keys", keys).unwrap();
        let paint = resolve::paint(&mut g, &resident, &Default::default()).unwrap();
        let resolved = resolve::begin(&mut g, view);
        let resolved = resolve::record(
            &mut g,
            &Keys::nearest(uploaded),
            &paint,
            Strip { top: 0, size: view.size },
            resolved,
        );
        let gbuffer = resolved.gbuffer(&mut g, view, &resident).unwrap();
        let [depth, index, color] =
            [&gbuffer.depth, &gbuffer.index, &gbuffer.color].map(|image| g.download(image));
        let gbuffer = edl::record(
            &mut g,
            &FrameContext::of(view, &resident, Light::default()),
            settings,
            gbuffer,
        );
        let lit = g.download(&gbuffer.color);
        let picture = composite::record(&mut g, view, BACKGROUND, &gbuffer);
        let picture = g.download(&picture);
        let frame = g.submit_and_wait(&[]).unwrap();

        Resolved {
            depth: frame.read(&depth).to_vec(),
            index: frame.read(&index).to_vec(),
            color: frame.read(&color).to_vec(),
            lit: frame.read(&lit).to_vec(),
            picture: frame.read(&picture).to_vec(),
        }
    })
}

/// Returns the words that the points of a one-node cloud show, by id.
fn words(cloud: &Cloud, shown: &DisplayAttribute) -> Vec<u32> {
    let part = &cloud.parts[0];
    let words = |columns: &Columns, points: Range<usize>, rows: &mut [Row<4>]| {
        shown.write_words((columns, &part.lattice), (&[], 0), points, rows, PLACE_WORDS);
    };
    let organised =
        index::partition(part.columns.clone(), &words, Arrangement::Morton, &Silent).unwrap();
    assert_eq!(organised.nodes.len(), 1);
    let frame = pack::frame(&organised.rows);
    let mut pages = vec![vec![0; part.columns.len()]; frame.planes as usize + 1];
    let mut to: Vec<&mut [u32]> = pages.iter_mut().map(Vec::as_mut_slice).collect();
    pack::pack(&organised.rows, &frame, organised.arrangement, &mut to);
    pages.pop().unwrap()
}

#[test]
fn resolve_gives_the_depth_the_point_and_the_colour_of_every_key() {
    let random = &mut Random(0xC0105);
    let count = POINTS_PER_PAGE / 2;
    let mut cloud = scene(count as usize);
    cloud.parts[0].columns.intensity = Some((0..count).map(|_| random.bits() as u16).collect());
    cloud.parts[0].columns.normal =
        Some((0..count).map(|_| [0; 3].map(|_: i32| (random.bits() % 255) as u8 as i8)).collect());
    for size in SIZES {
        let view = View::new(cameras()[0], size).unwrap();
        let keys = random_keys(size, count, random);
        for attribute in [Attribute::Rgb, Attribute::Intensity, Attribute::Normal, Attribute::White]
        {
            let shown = DisplayAttribute::new(attribute, &cloud);
            let words = words(&cloud, &shown);
            let got = resolved(&cloud, attribute, &view, &edl::Settings::default(), &keys);
            for (i, key) in keys.iter().enumerate() {
                let at = (size, attribute, i, key);
                if key[0] == NO_POINT {
                    assert_eq!(
                        (got.depth[i], got.index[i], got.color[i]),
                        (f32::INFINITY, NO_POINT, [0.0; 4]),
                        "{at:?}"
                    );
                    continue;
                }
                assert_eq!(
                    (got.depth[i].to_bits(), got.index[i], got.color[i][3]),
                    (key[1], key[0], 1.0),
                    "{at:?}"
                );
                let allowed = colors(attribute, words[key[0] as usize], shown.stretch);
                assert!(
                    allowed.iter().any(|color| (0..3).all(|c| color[c].holds(got.color[i][c]))),
                    "{at:?}: {:?}, not {allowed:?}",
                    got.color[i]
                );
            }
        }
    }
}

/// Returns the colours that a word may have: two where a ramp's arithmetic may fall on either side
/// of a step, else one.
fn colors(attribute: Attribute, word: u32, [lo, hi]: [u32; 2]) -> Vec<[Bounded; 3]> {
    let byte = |channel: u32| word >> (8 * channel) & 255;
    // Computed on the CPU in f64 and rounded once: exact on both sides.
    let linear = |encoded: f64| Bounded::exact(srgb_to_linear(encoded) as f32);
    match attribute {
        Attribute::Rgb => vec![[0, 1, 2].map(|c| linear(byte(c) as f64 / 255.0))],
        Attribute::Normal => {
            vec![[0, 1, 2].map(|c| Bounded::exact(byte(c)) / Bounded::exact(254.0))]
        }
        Attribute::White => vec![[linear(0.9); 3]],
        _ => {
            let scale = Bounded::exact(255.0f32 / (hi as f32 - lo as f32).max(1.0));
            // The last byte is the station.
            let word = word & 0xFF_FFFF;
            let step = ((Bounded::exact(word) - Bounded::exact(lo)) * scale).max(0.0).min(255.0);
            let steps = [step.value - step.error, step.value + step.error]
                .map(|step| step.clamp(0.0, 255.0).floor());
            // Greys begin above the background.
            steps.map(|step| [linear(0.2 + (1.0 - 0.2) * (step / 255.0)); 3]).to_vec()
        }
    }
}

#[test]
fn edl_and_composite_stay_within_their_bounds() {
    let random = &mut Random(0xED1);
    let cloud = scene(2000);
    let mut widest = 0f64;
    for size in SIZES {
        for camera in cameras() {
            for (strength, radius, cap) in
                [(0.35, 1.0, 8.0), (20.0, 3.0, 64.0), (0.0, 1.0, 8.0), (1.0, 64.0, 1e6)]
            {
                let view = View::new(camera, size).unwrap();
                let settings = edl::Settings { strength, radius, cap };
                let got = resolved(
                    &cloud,
                    Attribute::Rgb,
                    &view,
                    &settings,
                    &random_keys(size, 2000, random),
                );
                let twin = edl_oracle::shade(&view, &settings, &got.depth, &got.color);
                for (i, twin) in twin.iter().enumerate() {
                    let lit = got.lit[i];
                    assert_eq!(lit[3], got.color[i][3]);
                    for (c, twin) in twin.iter().enumerate() {
                        assert!(
                            twin.holds(lit[c]),
                            "{size:?} {settings:?} pixel {i}: {} is not {twin:?}",
                            lit[c]
                        );
                        widest = widest.max(twin.error);
                        let over = Bounded::exact(lit[c])
                            + Bounded::exact(BACKGROUND[c])
                                * (Bounded::exact(1.0) - Bounded::exact(lit[3]));
                        assert!(
                            over.holds(got.picture[i][c]),
                            "{size:?} pixel {i}: {} is not {over:?}",
                            got.picture[i][c]
                        );
                    }
                    assert_eq!(got.picture[i][3], lit[3]);
                }
            }
        }
    }
    println!("widest bound {widest:e}");
}

/// An oracle that accepts everything proves nothing: colours and depths that the kernel did not
/// write are refused.
#[test]
fn the_oracles_refuse_what_is_wrong() {
    let cloud = scene(150_000);
    let view = View::new(cameras()[0], [331, 257]).unwrap();
    let part = &cloud.parts[0];
    let source = project::Source::new(part, &view, Precision::Auto, DVec3::ZERO);
    let positions = project::positions(part, view.camera.eye);
    let check = |depth: &[f32]| project::check(&view, &[(source, positions.clone())], depth);
    let depth = draw(Way::Compute64, &cloud, &view, &bare()).depth;
    let covered = depth.iter().filter(|z| z.is_finite()).count();
    assert!(covered > 10_000);
    // A row further down, half a millimetre too far, emptied, and not a number.
    let moved: Vec<f32> = (0..depth.len()).map(|i| depth[i.saturating_sub(331)]).collect();
    assert!(check(&moved).wrong > covered / 2);
    assert!(check(&depth.iter().map(|z| z + 5e-4).collect::<Vec<_>>()).wrong > covered / 2);
    assert!(check(&vec![f32::INFINITY; depth.len()]).wrong > covered / 2);
    assert_eq!(check(&vec![f32::NAN; depth.len()]).wrong, depth.len());
    // Eyes are moved by a hundredth of a pixel: one point in a hundred falls into another pixel,
    // and the bounds are narrow enough to tell.
    let mut aside = view;
    aside.camera.eye += view.basis.right * (0.01 * 31.0 / view.focal_px());
    let depth = draw(Way::Compute64, &cloud, &aside, &bare()).depth;
    assert!(check(&depth).wrong > covered / 500, "{:?}", check(&depth));
}

#[test]
fn a_frame_without_barriers_is_reported_by_synchronization_validation() {
    let cloud = scene(1000);
    let view = View::new(cameras()[0], [63, 65]).unwrap();
    for way in WAYS {
        gpu::with(way, |gpu| {
            let resident =
                Resident::fill(gpu, cloud.clone(), DisplayAttribute::automatic(&cloud).0, &Silent)
                    .unwrap();
            let mut settings = bare();
            settings.effects.edl.switch = Switch::On;
            let config = FrameConfig::new(&settings, &view, &resident);
            let mut g = Graph::new(gpu);
            g.without_barriers = true;
            let outcome =
                pointillist::render::frame::record(&mut g, &view, &resident, &config).unwrap();
            g.download(&outcome.picture);
            let Err(Error::Validation(said)) = g.submit_and_wait(&[]) else {
                panic!("{way:?}: hazards went unnoticed")
            };
            assert!(said.contains("SYNC-HAZARD"), "{way:?}: {said}");
        });
    }
    // The device reports nothing afterwards, either.
    draw(Way::Compute64, &cloud, &view, &bare());
}

#[test]
fn persistent_buffers_are_freed_once_frames_do_without_them() {
    const BYTES: u64 = 16 << 20;
    // More frames than unused memory is kept for.
    const FRAMES: u32 = 100;
    gpu::with(Way::Compute64, |gpu| {
        let frame = |gpu: &mut Gpu, needs: bool| {
            let mut g = Graph::new(gpu);
            let mut read = g.buffer("read", 256);
            g.fill(&mut read, 1);
            let held = needs.then(|| {
                let wanted = |held| held + 1;
                let (mut kept, held) = g.persistent("kept", BYTES, vec![7], wanted).unwrap();
                g.fill(&mut kept, 2);
                g.copy_parts("read", &kept, &mut read, vec![[0, 0, 256]]);
                held
            });
            g.download_buffer(&read);
            g.submit_and_wait(&[]).unwrap();
            held
        };
        assert_eq!(frame(gpu, false), None);
        let without = gpu.memory.allocated;
        for before in 0..FRAMES {
            assert_eq!(frame(gpu, true), Some(before));
        }
        assert!(gpu.memory.allocated >= without + BYTES);
        (0..FRAMES).for_each(|_| assert_eq!(frame(gpu, false), None));
        assert_eq!(gpu.memory.allocated, without);
        assert_eq!(frame(gpu, true), Some(0));
    });
}
