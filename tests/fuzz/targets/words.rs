//! Files that users write, filters, and values of options.

use super::{file, look};
use glam::DVec3;
use pointillist::cloud::attribute::Attribute;
use pointillist::cloud::crs::wkt;
use pointillist::cloud::filter::{Filter, Meaning, Origin};
use pointillist::cloud::length::Length;
use pointillist::cloud::rgb_range::RgbRange;
use pointillist::cloud::scalar::Scalar;
use pointillist::cloud::table::{self, Delimiter};
use pointillist::cloud::{Columns, Lattice};
use pointillist::extract::raster;
use pointillist::passes::Effects;
use pointillist::passes::splat::PointSize;
use pointillist::render::scene::Scene;
use pointillist::render::settings::Background;
use pointillist::select::clip::Clip;
use pointillist::select::opacity::Rule;
use pointillist::tune::front::Limit;
use pointillist::view::camera_path::CameraPath;
use pointillist::view::light::Light;
use pointillist::view::{Camera, View, map};
use std::fmt::Display;
use std::path::Path;
use std::str::FromStr;

const SIZE: [u32; 2] = [320, 180];

/// Reads a scene; one that was read is the same after it was written and read again.
pub fn scene(folder: &Path, bytes: &[u8]) {
    let scene = match Scene::read(&file(folder, "scene.json", bytes)) {
        Ok(scene) => scene,
        Err(error) => return look::one_line(&error.to_string()),
    };
    drop(View::new(scene.camera, SIZE));
    let again = folder.join("again.json");
    scene.write(&again).expect("a scene that was read can be written");
    let read = Scene::read(&again).unwrap_or_else(|error| panic!("written, then: {error}"));
    assert_eq!(read, scene);
    std::fs::remove_file(again).expect("it is there");
}

pub fn camera(folder: &Path, bytes: &[u8]) {
    let Ok(camera) = Camera::read(&file(folder, "camera.json", bytes)) else { return };
    match View::new(camera, SIZE) {
        Ok(view) => look_through(&view),
        Err(error) => look::one_line(&error.to_string()),
    }
}

/// Asks a view where points are. Finite points may lie anywhere, but never at NaN.
fn look_through(view: &View) {
    let unit = [view.basis.right, view.basis.up, view.basis.forward];
    assert!(unit.iter().all(|axis| (axis.length() - 1.0).abs() < 1e-6), "{:?}", view.basis);
    for place in [view.camera.target, DVec3::ZERO, DVec3::ONE * 1e6] {
        if let Some(pixel) = view.pixel(place) {
            assert!(pixel.iter().all(|at| !at.is_nan()), "{place} is seen at {pixel:?}");
        }
        let box_around = (place - DVec3::ONE, place + DVec3::ONE);
        if let Some((near, far)) = view.depths(box_around) {
            assert!(near <= far, "{near} to {far}");
        }
    }
}

pub fn path(folder: &Path, bytes: &[u8]) {
    let path = match CameraPath::read(&file(folder, "path.json", bytes)) {
        Ok(path) => path,
        Err(error) => return look::one_line(&error.to_string()),
    };
    let last = path.frames().saturating_sub(1);
    for number in [0, 1, last / 3, last / 2, last] {
        match View::new(path.frame(number), SIZE) {
            Ok(view) => look_through(&view),
            Err(error) => look::one_line(&error.to_string()),
        }
    }
    let again = folder.join("again.json");
    path.write(&again).expect("a path that was read can be written");
    let read = CameraPath::read(&again).unwrap_or_else(|error| panic!("written, then: {error}"));
    assert_eq!(read, path);
    std::fs::remove_file(again).expect("it is there");
}

/// Parses a filter and asks it for points.
pub fn filter(_: &Path, bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let filter: Filter = match text.parse() {
        Ok(filter) => filter,
        Err(why) => return look::one_line(&why),
    };
    let columns = Columns {
        x: vec![-5, 0, i32::MAX],
        y: vec![0, 1, 2],
        z: vec![i32::MIN, 0, 7],
        intensity: Some(vec![0, 7, u16::MAX]),
        class: Some(vec![0, 2, 255]),
        returns: Some(vec![0, 0x11, 0x75]),
        source: Some(vec![0, 1, 2]),
        gps_time: Some(vec![f64::NAN, -1.0, 1e300]),
        ..Columns::default()
    };
    let origin =
        |source: usize| Origin { file: "a.las".into(), scan: None, source: Some(source as u16) };
    let meaning = Meaning { intensity_range: [0.0, 65_535.0], sources: 3, origin: &origin };
    let lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::new(5e5, 5e6, 0.0) };
    let left = filter.compile(&meaning).left(&columns, &lattice, [0; 3]);
    assert_eq!(left.len(), 3);
    drop(filter.words());
    let _ = filter.leaves_none_of(&[(2, 1)], &[(1, 1)]);
}

/// Parses a value. One that is printed is the same after it was parsed again.
fn value<T: FromStr<Err = String> + Display + PartialEq + std::fmt::Debug>(text: &str) {
    match text.parse::<T>() {
        Ok(value) => {
            let printed = value.to_string();
            let again = printed.parse::<T>();
            assert!(again.as_ref() == Ok(&value), "{value:?} is printed as {printed}: {again:?}");
        }
        Err(why) => look::one_line(&why),
    }
}

/// Takes a result that only has to come.
fn ignore<T>(_: T) {}

/// Parses a value of an option; the first byte names it.
pub fn option(_: &Path, bytes: &[u8]) {
    let Some((which, text)) = bytes.split_first() else { return };
    let Ok(text) = std::str::from_utf8(text) else { return };
    match which % 16 {
        0 => value::<Clip>(text),
        1 => value::<Rule>(text),
        2 => value::<Background>(text),
        3 => value::<Light>(text),
        4 => ignore(text.parse::<Attribute>()),
        5 => ignore(text.parse::<RgbRange>()),
        6 => ignore(text.parse::<Delimiter>()),
        7 => ignore(text.parse::<table::Columns>()),
        8 => ignore(text.parse::<Limit>()),
        9 => ignore(text.parse::<map::Extent>()),
        10 => ignore(text.parse::<Length>()),
        11 => ignore(text.parse::<raster::Value>()),
        12 => ignore(text.parse::<Scalar>()),
        13 => ignore(text.parse::<PointSize>()),
        14 => ignore(wkt::parse(text)),
        _ => {
            let mut effects = Effects::default();
            if effects.set(text).is_ok() {
                let mut again = Effects::default();
                for effect in effects.clone().list() {
                    let printed = effect.to_string();
                    again.set(&printed).unwrap_or_else(|why| panic!("{printed}: {why}"));
                }
                assert_eq!(again, effects, "{text}");
            }
        }
    }
}

pub const SCENE_WORDS: &[&str] = &[
    "\"eye\"",
    "\"target\"",
    "\"up\"",
    "\"fov_y\"",
    "\"projection\"",
    "orthographic",
    "perspective",
    "\"ortho_height\"",
    "1e308",
    "-1e308",
    "1e-320",
    "0",
    "null",
    "[0,0,0]",
    "\"keys\"",
    "\"time\"",
    "\"frames_per_second\"",
    "\"effects\"",
    "\"opacity\"",
    "\"clip\"",
    "\"light\"",
    "\"color\"",
    "\"scale\"",
    "\"only\"",
    "\"not\"",
    "\"layer\"",
    "\"budget\"",
    "\"lod\"",
    "\"background\"",
    "\"annotations\"",
    "shadows=on,samples=4",
    "box:0,0,0,1,1,1",
    "sun:60,30",
];
pub const FILTER_WORDS: &[&str] = &[
    "class=",
    "return=",
    "returns=",
    "source=",
    "file=",
    "scan=",
    "intensity=",
    "x=",
    "gps-time=",
    "extra:a=",
    "..",
    ",",
    "first",
    "last",
    "single",
    "ground",
    "noise",
    "--not ",
    "--only ",
    "1e308",
    "-",
    "nan",
    "inf",
    "nir=",
    "scan-angle=",
    "height-above-ground=",
];
pub const OPTION_WORDS: &[&str] = &[
    "box:",
    "outside:",
    "off:",
    "inf",
    "nan",
    "1e308",
    "class=2:0.5",
    "station=",
    "sun:",
    "headlight",
    "area:",
    "#ffffff",
    "x,y,z",
    "PROJCS[",
    "GEOGCS[",
    "AUTHORITY[\"EPSG\",\"32632\"]",
    "UNIT[",
    "surface=on,",
    "edl=on,strength=",
    "shadows=on,",
    "strokes=on,",
    "auto",
    "off",
    ":",
    "@",
    "ms",
    "px",
];

fn texts(all: &[&str]) -> Vec<Vec<u8>> {
    all.iter().map(|text| text.as_bytes().to_vec()).collect()
}

pub fn scene_seeds(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        r#"{"camera": {"eye": [0, -10, 5], "target": [0, 0, 0]}}"#,
        r#"{"camera": {"eye": [1,2,3], "target": [4,5,6], "up": [0,1,0], "fov_y": 30, "projection": "orthographic", "ortho_height": 12},
            "color": "intensity", "effects": ["edl=on", "shadows=on"], "opacity": ["class=2:0.5"],
            "only": ["class=2"], "not": ["noise"], "clip": ["box:0,0,0,1,1,1"], "budget": 100000,
            "lod": 1.5, "layer": 0.2, "light": "sun:120,40", "background": "102030"}"#,
        r#"{"camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}, "scale": {"gamma": 1.5}, "annotations": {"title": "a"}}"#,
    ])
}

pub fn camera_seeds(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        r#"{"eye": [0, -10, 5], "target": [0, 0, 0]}"#,
        r#"{"eye": [1,2,3], "target": [4,5,6], "up": [0,1,0], "fov_y": 30, "projection": "orthographic", "ortho_height": 12}"#,
        r#"{"eye": [1e300,2,3], "target": [-1e300,5,6], "up": [0,0,1e-300]}"#,
    ])
}

pub fn path_seeds(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        r#"{"keys": [{"time": 0, "camera": {"eye": [0,-10,5], "target": [0,0,0]}}]}"#,
        r#"{"frames_per_second": 30, "keys": [{"time": 0, "camera": {"eye": [0,-10,5], "target": [0,0,0]}},
            {"time": 1.5, "camera": {"eye": [3,-10,5], "target": [0,1,0]}},
            {"time": 4, "camera": {"eye": [3,10,5], "target": [0,1,0], "projection": "orthographic", "ortho_height": 9}}]}"#,
    ])
}

pub fn filter_seeds(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        "ground",
        "class=ground,6 --not return=last",
        "--only intensity=100..2000 --not noise --where gps-time=..5",
        "extra:reflectance=-1..1 x=5e5.. returns=1..3,7",
        "file=a,b scan=c source=1,3..9",
    ])
}

pub fn option_seeds(_: &Path) -> Vec<Vec<u8>> {
    let seeds = [
        "box:0,0,0,1,1,inf",
        "class=2:0.5",
        "#102030",
        "sun:120,40",
        "extra:reflectance",
        "0..4095",
        ";",
        "x,y,z,-,intensity",
        "20ms",
        "0,0,10,10",
        "0.5",
        "height:max",
        "extra:a",
        "auto",
        "PROJCS[\"a\",GEOGCS[\"b\",DATUM[\"c\",SPHEROID[\"d\",6378137,298.25]],PRIMEM[\"e\",0],UNIT[\"degree\",0.017]],PROJECTION[\"Transverse_Mercator\"],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32632\"]]",
        "edl=on,strength=0.5",
    ];
    let seed = |(k, text): (usize, &&str)| [&[k as u8], text.as_bytes()].concat();
    seeds.iter().enumerate().map(seed).collect()
}
