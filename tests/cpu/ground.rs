//! Heights above ground of a simulated countryside, whose ground is known.

use crate::files::scan;
use glam::DVec3;
use pointillist::cloud::attribute::Attribute;
use pointillist::cloud::filter::Filter;
use pointillist::cloud::scalar::Scalar;
use pointillist::cloud::{self, Cloud, ReadOptions, ground};
use pointillist::extract::Selection;
use pointillist::extract::count::count;
use pointillist::extract::input::Input;
use pointillist::index::build::{Options, build};
use pointillist::progress::Silent;
use pointillist::synth::{Relief, SceneKind};

/// Returns the differences from the true heights of points in the middle of the land: their mean
/// magnitude, and that which 95 % stay below.
fn errors(cloud: &Cloud) -> [f64; 2] {
    let part = &cloud.parts[0];
    let (columns, heights) =
        (&part.columns, part.columns.scalar(Scalar::HeightAboveGround).unwrap());
    let mut errors = Vec::new();
    for (i, height) in heights.iter().enumerate() {
        let place = part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from));
        let own = place - DVec3::new(500_000.0, 5_000_000.0, 100.0);
        if own.x.abs() < 280.0 && own.y.abs() < 200.0 {
            errors.push((height - (own.z - Relief.height(own.x, own.y).0)).abs());
        }
    }
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    [mean, errors[errors.len() * 95 / 100]]
}

#[test]
fn heights_of_trees_and_houses_are_those_above_the_land() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.laz");
    scan(&path, SceneKind::Terrain, 1_000_000);
    let wanted = Attribute::Scalar(Scalar::HeightAboveGround).wanted();
    let mut cloud =
        cloud::read(&[path], &ReadOptions::new(wanted, false), &Silent).expect("a scan");
    let said = cloud.notes.join("\n");
    assert!(said.contains("height-above-ground is measured from a surface through"), "{said}");
    let [mean, most] = errors(&cloud);
    println!("by class: mean {mean:.3} m, 95 % below {most:.3} m");
    assert!(mean < 0.1 && most < 0.3, "{mean} {most}");
    cloud.parts[0].columns.class = None;
    cloud.parts[0].columns.scalars.clear();
    let said = ground::heights(&mut cloud).unwrap();
    assert!(said.contains("no point is of class 2"), "{said}");
    let [mean, most] = errors(&cloud);
    println!("by lowest points: mean {mean:.3} m, 95 % below {most:.3} m");
    assert!(mean < 0.5 && most < 1.5, "{mean} {most}");
}

#[test]
fn files_in_batches_and_an_index_have_the_heights_of_a_cloud_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let [file, indexed] = ["terrain.laz", "terrain.pnti"].map(|name| folder.path().join(name));
    scan(&file, SceneKind::Terrain, 300_000);
    build(std::slice::from_ref(&file), &indexed, &Options::usual(false), &Silent).unwrap();
    let filter: Filter = "height-above-ground=1.5..12".parse().unwrap();
    let read = ReadOptions::new(filter.wanted(), false);
    let mut cloud = cloud::read(std::slice::from_ref(&file), &read, &Silent).unwrap();
    cloud.filter(&filter).unwrap();
    assert!(cloud.len() > 10_000, "{}", cloud.len());
    for path in [file, indexed] {
        let input = Input::open(&[path], &read, &Silent).unwrap();
        let selection = Selection { filter: filter.clone(), ..Selection::default() };
        assert_eq!(count(&input, &selection, &Silent).unwrap().points, cloud.len());
    }
}
