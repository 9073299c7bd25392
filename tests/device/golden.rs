//! Tiny pictures of synthetic clouds, compared with those committed: each effect alone, and each
//! way of colouring.
//!
//! Arithmetic that decides pixels is the same on every driver. The last bit of a channel may
//! differ, shapes may not.
//!
//! A picture that changed on purpose is accepted with
//! `POINTILLIST_UPDATE=1 cargo nextest run --release golden::`. Look at it before committing it.

use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::gpu::DeviceOptions;
use pointillist::graph::{Gpu, Graph};
use pointillist::output::image_io;
use pointillist::passes::{Effects, encode};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings, Style};
use pointillist::resident::Resident;
use pointillist::select::opacity::Opacities;
use pointillist::synth;
use pointillist::view::light::Light;
use pointillist::view::{Camera, Preset, View};
use std::path::Path;

const SIZE: [u32; 2] = [128, 96];
/// Codes of a channel that may differ, and the share of pixels that may differ by more.
const CODES: u8 = 2;
const SHARE: f64 = 1e-3;

fn check(name: &str, attribute: Attribute, effects: &str, preset: Preset) {
    check_style(Style::Points, name, attribute, effects, preset);
}

fn check_style(style: Style, name: &str, attribute: Attribute, effects: &str, preset: Preset) {
    check_lit(Light::default(), style, name, attribute, effects, preset);
}

fn check_lit(
    light: Light,
    style: Style,
    name: &str,
    attribute: Attribute,
    effects: &str,
    preset: Preset,
) {
    check_layers(&[], light, style, name, attribute, effects, preset);
}

fn check_layers(
    opacities: &[&str],
    light: Light,
    style: Style,
    name: &str,
    attribute: Attribute,
    effects: &str,
    preset: Preset,
) {
    check_scene(
        synth::SceneKind::NestedTori,
        opacities,
        light,
        style,
        name,
        attribute,
        effects,
        preset,
    );
}

#[allow(clippy::too_many_arguments)]
fn check_scene(
    scene: synth::SceneKind,
    opacities: &[&str],
    light: Light,
    style: Style,
    name: &str,
    attribute: Attribute,
    effects: &str,
    preset: Preset,
) {
    let mut gpu = Gpu::open(&DeviceOptions { validate: true, ..DeviceOptions::default() })
        .expect("a Vulkan device; tools/test installs one that needs no GPU");
    let world = synth::build(scene, 1, 0.0);
    let cloud = synth::collect("golden", &world, 60_000, 7, 0.0, &Silent).unwrap();
    let view = View::new(Camera::framing(preset, &cloud.core_points(), SIZE), SIZE).unwrap();
    let mut shown = DisplayAttribute::new(attribute, &cloud);
    shown.further.strokes = style == Style::Strokes;
    shown.further.kind = !opacities.is_empty();
    let mut settings =
        RenderSettings { effects: Effects::of(style), light, ..RenderSettings::default() };
    effects.split_whitespace().for_each(|effect| settings.effects.set_any(effect).unwrap());
    let mut resident = Resident::fill(&mut gpu, cloud, shown, &Silent).unwrap();
    resident.opacities = Opacities(opacities.iter().map(|rule| rule.parse().unwrap()).collect());
    let config = FrameConfig::new(&settings, &view, &resident);
    let mut g = Graph::new(&mut gpu);
    let outcome = frame::record(&mut g, &view, &resident, &config).unwrap();
    let encoded = encode::download(&mut g, &outcome.picture).unwrap();
    let done = g.submit_and_wait(&[]).unwrap();

    let golden = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/device/golden")
        .join(format!("{name}.png"));
    let fresh =
        std::env::temp_dir().join(format!("pointillist-golden-{name}-{}.png", std::process::id()));
    image_io::write_png(&fresh, SIZE, &encoded.read(&done)).unwrap();
    if std::env::var_os("POINTILLIST_UPDATE").is_some() {
        std::fs::copy(&fresh, &golden).unwrap();
    }
    let bytes = std::fs::metadata(&golden)
        .unwrap_or_else(|_| {
            panic!("{} is missing; make it with POINTILLIST_UPDATE=1", golden.display())
        })
        .len();
    assert!(bytes < 48 * 1024, "a golden picture is small, this one has {bytes} bytes");
    let (found, expected) = (pixels(&fresh), pixels(&golden));
    let differ = found
        .chunks(3)
        .zip(expected.chunks(3))
        .filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > CODES))
        .count();
    assert_eq!(found.len(), expected.len());
    assert!(
        differ as f64 <= SHARE * (SIZE[0] * SIZE[1]) as f64,
        "{name}: {differ} pixels differ from {}; the new picture is {}; if that is on purpose, run with POINTILLIST_UPDATE=1",
        golden.display(),
        fresh.display()
    );
    std::fs::remove_file(fresh).unwrap();
}

fn pixels(path: &Path) -> Vec<u8> {
    let mut reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes
}

#[test]
fn points() {
    check("points", Attribute::Rgb, "edl=off", Preset::Fit);
}

#[test]
fn splats() {
    check_style(Style::Splats, "splat", Attribute::Rgb, "edl=on", Preset::Fit);
}

#[test]
fn splats_of_scattered_points() {
    check_scene(
        synth::SceneKind::Terrain,
        &[],
        Light::default(),
        Style::Auto,
        "scattered",
        Attribute::Rgb,
        "",
        Preset::Iso,
    );
}

#[test]
fn edl() {
    check("edl", Attribute::White, "edl=on", Preset::Fit);
}

#[test]
fn elevation_from_the_front() {
    check("elevation", Attribute::Elevation, "edl=auto,strength=0.6,radius=2", Preset::Front);
}

#[test]
fn class_from_above() {
    check("class", Attribute::Class, "edl=auto", Preset::Top);
}

#[test]
fn source_without_perspective() {
    check("source", Attribute::Source, "edl=auto", Preset::Iso);
}

#[test]
fn surface() {
    check_style(Style::Surface, "surface", Attribute::Rgb, "", Preset::Fit);
}

#[test]
fn visibility_alone() {
    check_style(
        Style::Surface,
        "visibility",
        Attribute::White,
        "fill=off shape=off edl=off",
        Preset::Fit,
    );
}

#[test]
fn fill_of_sparse_points() {
    check_style(
        Style::Surface,
        "fill",
        Attribute::Rgb,
        "visibility=on,levels=1,kernel=9 fill=on,method=median shape=off edl=off",
        Preset::Iso,
    );
}

#[test]
fn fill_by_masks() {
    check_style(
        Style::Surface,
        "dobrev",
        Attribute::Rgb,
        "fill=method=mask smooth=off shape=off antialias=off",
        Preset::Iso,
    );
}

#[test]
fn smooth_after_masks() {
    check_style(
        Style::Surface,
        "smooth",
        Attribute::Rgb,
        "fill=method=mask smooth=on,filter=gaussian antialias=off",
        Preset::Iso,
    );
}

#[test]
fn antialias_of_silhouettes() {
    check_style(Style::Surface, "antialias", Attribute::Rgb, "antialias=on", Preset::Fit);
}

#[test]
fn phong_with_the_camera() {
    check_style(Style::Surface, "phong", Attribute::White, "phong=on shape=off", Preset::Fit);
}

#[test]
fn phong_by_a_light() {
    check_lit(
        "direction:1,1,-1".parse().unwrap(),
        Style::Surface,
        "phong-direction",
        Attribute::Rgb,
        "",
        Preset::Top,
    );
    check_lit(
        "position:0,0,1".parse().unwrap(),
        Style::Surface,
        "phong-position",
        Attribute::White,
        "shape=off",
        Preset::Iso,
    );
}

#[test]
fn ao_on_white() {
    check_style(
        Style::Surface,
        "ao",
        Attribute::White,
        "ao=on,radius=1,strength=16 shape=off edl=off",
        Preset::Iso,
    );
}

#[test]
fn luminance_of_dense_points() {
    check("luminance", Attribute::Rgb, "luminance=on edl=off", Preset::Fit);
}

#[test]
fn exposure_of_five_stations() {
    check_scene(
        synth::SceneKind::Street,
        &[],
        Light::Headlight,
        Style::Points,
        "exposure",
        Attribute::Rgb,
        "edl=off",
        Preset::Fit,
    );
}

#[test]
fn shape_on_white() {
    check_style(
        Style::Surface,
        "shape",
        Attribute::Rgb,
        "shape=on,base=white,first=1",
        Preset::Top,
    );
}

#[test]
fn shadows() {
    check(
        "shadows",
        Attribute::White,
        "shadows=on,samples=16,radius=6 edl=off visibility=on fill=on",
        Preset::Fit,
    );
}

#[test]
fn strokes_of_every_brush() {
    for brush in ["dabs", "bristles", "ribbons"] {
        check_style(
            Style::Strokes,
            &format!("strokes-{brush}"),
            Attribute::Rgb,
            &format!("strokes=brush={brush},size=5"),
            Preset::Fit,
        );
    }
}

#[test]
fn strokes_in_front_are_all_there_is() {
    check_style(
        Style::Strokes,
        "strokes-opaque",
        Attribute::Rgb,
        "strokes=blend=opaque,size=5",
        Preset::Fit,
    );
    check_style(
        Style::Strokes,
        "strokes-blur",
        Attribute::White,
        "strokes=blend=blur",
        Preset::Top,
    );
}

/// The paper's figure 17: the innermost torus is opaque, the others less so.
#[test]
fn transparency() {
    let opacities = ["class:3=0.3", "class:2=0.5"];
    check_layers(
        &opacities,
        Light::Headlight,
        Style::Surface,
        "transparency",
        Attribute::Class,
        "",
        Preset::Fit,
    );
}
