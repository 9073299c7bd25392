//! What is told of picked points is what the file says of them.

use super::{Application, COLOR, SIZE, files, indexed, view_of};
use pointillist::cloud::attribute::Attribute;
use pointillist::cloud::{self, ColumnSet, ReadOptions};
use pointillist::gpu::TestOverrides;
use pointillist::progress::Silent;
use pointillist::renderer::{OpenSettings, Picked, PickedPoint, Preset, Renderer, RendererOptions};
use std::collections::HashMap;
use std::path::PathBuf;

/// Picks a grid of pixels of a file that is coloured by an attribute, with device memory that is
/// mapped or not.
fn picked(path: &PathBuf, color: &str, unmapped: bool) -> Vec<PickedPoint> {
    let mut application = Application::new(COLOR);
    let overrides = TestOverrides { unmapped, ..TestOverrides::default() };
    let options = RendererOptions { overrides, ..RendererOptions::default() };
    // SAFETY: the renderer is dropped before the application.
    let mut renderer = unsafe { Renderer::new(&application.host(), options) }.unwrap();
    let settings = OpenSettings { color: Some(color.into()), ..OpenSettings::default() };
    renderer.open(std::slice::from_ref(path), &settings).unwrap();
    renderer.set("style", "points").unwrap();
    let targets = application.targets();
    let framing = loop {
        if let Some(camera) = renderer.framing(Preset::Fit, SIZE) {
            break [view_of(camera)];
        }
        application.draw(&mut renderer, targets, &[], None);
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    application.settle(&mut renderer, targets, &framing);
    let grid = (0..SIZE[1]).step_by(12).flat_map(|y| (0..SIZE[0]).step_by(12).map(move |x| [x, y]));
    let picks: Vec<_> = grid.map(|pixel| renderer.pick(pixel)).collect();
    (0..2).for_each(|_| drop(application.draw(&mut renderer, targets, &framing, None)));
    let answers = picks.into_iter().map(|pick| renderer.picked(pick));
    answers
        .filter_map(|answer| match answer {
            Picked::Point(point) if point.id.is_some() => Some(point),
            Picked::Pending => panic!("no answer"),
            _ => None,
        })
        .collect()
}

#[test]
fn attributes_of_picked_points_are_those_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("street.las");
    files::scan(&path, pointillist::synth::SceneKind::Street, 200_000);
    let columns = ["rgb", "intensity", "class"].map(|name| name.parse::<Attribute>().unwrap());
    let wanted = columns.into_iter().fold(ColumnSet::default(), |all, one| all.and(one.wanted()));
    let read = ReadOptions::new(wanted, false);
    let cloud = cloud::read(std::slice::from_ref(&path), &read, &Silent).unwrap();
    let (columns, lattice) = (&cloud.parts[0].columns, &cloud.parts[0].lattice);
    let place = |i: usize| {
        let steps = [columns.x[i], columns.y[i], columns.z[i]].map(|steps| steps as i64);
        lattice.world(steps).to_array().map(f64::to_bits)
    };
    let numbers: HashMap<_, _> = (0..columns.len()).map(|i| (place(i), i)).collect();
    let height = {
        let heights = || (0..columns.len()).map(|i| f64::from_bits(place(i)[2]));
        heights().fold(f64::MIN, f64::max) - heights().fold(f64::MAX, f64::min)
    };
    for color in ["rgb", "intensity", "class", "elevation"] {
        let points = picked(&path, color, false);
        println!("{color}: {} points", points.len());
        assert!(points.len() > 50, "{color}: {}", points.len());
        for point in points {
            let i = numbers[&point.position.to_array().map(f64::to_bits)];
            let (class, intensity) =
                (columns.class.as_ref().unwrap()[i], columns.intensity.as_ref().unwrap()[i]);
            assert!(point.exact && point.class == Some(class), "{color} {point:?}");
            match (color, point.value) {
                ("rgb", value) => {
                    assert_eq!(point.color, Some(columns.rgb.as_ref().unwrap()[i]));
                    assert_eq!(value, None);
                }
                ("intensity", value) => assert_eq!(value, Some(intensity as f64)),
                ("class", value) => assert_eq!(value, Some(class as f64)),
                (_, value) => {
                    let off = value.unwrap() - point.position.z;
                    assert!(off.abs() <= height / 65_535.0, "{point:?} {off} {height}");
                }
            }
        }
    }
}

/// Answers are the same, of files and of an index, where device memory is not mapped.
#[test]
fn picked_points_have_attributes_where_device_memory_is_not_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("street.las");
    files::scan(&path, pointillist::synth::SceneKind::Street, 200_000);
    let index = indexed(&[&path], "");
    for file in [path, index] {
        for color in ["rgb", "intensity"] {
            let [mapped, unmapped] = [false, true].map(|unmapped| picked(&file, color, unmapped));
            println!("{} {color}: {} points", file.display(), mapped.len());
            assert!(mapped.len() > 50 && mapped == unmapped, "{color} {mapped:?} {unmapped:?}");
            let told = |point: &PickedPoint| point.class.is_some() && point.color.is_some();
            assert!(unmapped.iter().all(told), "{unmapped:?}");
        }
    }
}
