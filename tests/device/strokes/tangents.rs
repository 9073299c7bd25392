//! What strokes are painted along: the same on the device as in f64, and turned with a cloud that
//! is turned in its file.

use super::*;
use crate::gpu;

/// Compares the kernel's f32 tangents with the f64 twin of the same bits: over the sphere, and from
/// 1e-1 to 1e-7 around the places where a method jumps.
#[test]
fn hard_19_tangents_of_the_device_agree_with_f64_over_the_sphere_and_up_to_its_pole() {
    use pointillist::passes::strokes::Tangents;
    use pointillist::passes::strokes::tangents::on_device;
    use pointillist::shader::Direction;
    use pointillist::study::oracle::strokes::tangent;

    let sphere = (0..20_000).map(|k| {
        let (z, turn) = (1.0 - 2.0 * (k as f64 + 0.5) / 20_000.0, k as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(z, r * turn.cos(), r * turn.sin())
    });
    let third = DVec3::ONE.normalize();
    let poles = [DVec3::X, DVec3::Y, DVec3::Z, third].into_iter().flat_map(|pole| [pole, -pole]);
    let near = poles.clone().flat_map(|pole| {
        let (t, b) = pole.any_orthonormal_pair();
        (1..=28).flat_map(move |power| {
            let far = 10f64.powf(-0.25 * power as f64);
            (0..16).map(move |k| {
                (pole
                    + far
                        * (t * (k as f64 * std::f64::consts::FRAC_PI_8 + 0.1).cos()
                            + b * (k as f64 * std::f64::consts::FRAC_PI_8 + 0.1).sin()))
                .normalize()
            })
        })
    });
    let normals: Vec<[f32; 3]> =
        sphere.chain(near).chain(poles).map(|n| n.as_vec3().to_array()).collect();
    let turns =
        (0..).map(|k| (k as f64 * 0.7).sin_cos()).map(|(sin, cos)| [cos as f32, sin as f32]);
    let directions: Vec<Direction> =
        normals.into_iter().zip(turns).map(|(normal, turn)| Direction { normal, turn }).collect();

    // guide: numerics, case 19.
    let most = 6.0 * 2f64.powi(-23);
    for way in
        [Tangents::Householder, Tangents::Eberly, Tangents::Squareplate, Tangents::Covariance]
    {
        let (found, _) = gpu::with(gpu::Way::Compute64, |gpu| {
            on_device(gpu, way, &directions).expect("no validation message")
        });
        let (mut worst, mut undecided) = ([0.0f64; 3], 0);
        for (Direction { normal, turn }, found) in directions.iter().zip(found) {
            let [n, found] = [*normal, found].map(|v| DVec3::from_array(v.map(f64::from)));
            let (t, b) = householder(n);
            let truth = tangent(way, n, t * turn[0] as f64 + b * turn[1] as f64);
            // Near the threshold, rounding decides whether this is a plate.
            let plate = n.cross(DVec3::new(n.y, n.z, n.x)).length_squared();
            if way == Tangents::Squareplate && (plate / 1e-6 - 1.0).abs() < 1e-3 {
                undecided += 1;
                continue;
            }
            let errors = [found.distance(truth), found.dot(n).abs(), (found.length() - 1.0).abs()];
            worst.iter_mut().zip(errors).for_each(|(worst, error)| *worst = worst.max(error));
            assert!(
                errors.iter().all(|error| *error <= most),
                "{way:?} of {n}: {found}, not {truth}"
            );
        }
        println!(
            "{way:?}: {:.2e} off, {:.2e} out of the plane, {:.2e} too long, {undecided} undecided",
            worst[0], worst[1], worst[2]
        );
        assert!(undecided < 10);
    }
}

/// A surface is turned in its file. Strokes turn with it, up to the lattice's rounding. In the axes
/// of the file, in which the formulas are written, they would not.
#[test]
fn strokes_turn_with_a_cloud_that_is_turned_in_its_file() {
    use glam::DQuat;
    use pointillist::cloud::Lattice;
    use pointillist::index::attributes::axes;
    use pointillist::index::format::Axes;
    use pointillist::passes::strokes::Tangents;
    use pointillist::study::oracle::strokes::tangent;

    let cloud = scene(SceneKind::Torus, 20_000, 0.0);
    let part = &cloud.parts[0];
    let (lo, hi) = part.bounds().unwrap();
    let middle = (lo + hi) / 2.0;
    let lattice = Lattice { step: DVec3::splat(1e-8), offset: DVec3::ZERO };
    let turned = |turn: DQuat| {
        let at = |i: usize| (turn * (world_of(part, i) - middle) / lattice.step).round();
        let axis =
            |of: fn(DVec3) -> f64| (0..part.columns.len()).map(|i| of(at(i)) as i32).collect();
        let columns =
            Columns { x: axis(|p| p.x), y: axis(|p| p.y), z: axis(|p| p.z), ..Columns::default() };
        Part { columns, lattice, ..part.clone() }
    };
    // Returns the tangent of every point, with normals outward.
    let tangents = |part: &Part, turn: DQuat, way: Tangents, axes: &Axes| -> Vec<DVec3> {
        let found = strokes(&part.columns, &part.lattice, &Silent).unwrap();
        let of = |(i, stroke): (usize, &Stroke)| {
            let plane = stroke.plane.expect("a torus has normals everywhere");
            let at = turn.inverse() * world_of(part, i);
            let out = turn * (at - DVec3::new(at.x, at.y, 0.0).normalize());
            let normal = if plane.normal.dot(out) < 0.0 { -plane.normal } else { plane.normal };
            if way == Tangents::Covariance {
                plane.along
            } else {
                axes.world(tangent(way, axes.own(normal), plane.along))
            }
        };
        found.iter().enumerate().map(of).collect()
    };
    let still = turned(DQuat::IDENTITY);
    let own = |part: &Part| axes::of(std::slice::from_ref(part));
    let file = |_: &Part| Axes::default();
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    for (name, turn) in [
        ("a quarter about z", quarter),
        ("askew", DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7)),
    ] {
        let there = turned(turn);
        for way in
            [Tangents::Householder, Tangents::Eberly, Tangents::Squareplate, Tangents::Covariance]
        {
            let measure = |axes: &dyn Fn(&Part) -> Axes| {
                let [before, after] = [(&still, DQuat::IDENTITY), (&there, turn)]
                    .map(|(part, turn)| tangents(part, turn, way, &axes(part)));
                let angle = |(a, b): (&DVec3, &DVec3)| {
                    (turn * *a).cross(*b).length().atan2((turn * *a).dot(*b).abs()).to_degrees()
                };
                let mut angles: Vec<f64> = before.iter().zip(&after).map(angle).collect();
                angles.sort_by(f64::total_cmp);
                [
                    angles.iter().sum::<f64>() / angles.len() as f64,
                    angles[angles.len() * 999 / 1000],
                ]
            };
            let [[mean, most], [of_file, _]] = [measure(&own), measure(&file)];
            println!(
                "{name}, {way:?}: {mean:.4} degrees in the mean, 99.9 %: {most:.4}; in the axes of the file {of_file:.1}"
            );
            assert!(mean < 0.02 && most < 0.5, "{name}, {way:?}: {mean} degrees, 99.9 %: {most}");
            // A quarter turn about z does not change what Eberly's method asks of x and y.
            let turns_by_itself =
                way == Tangents::Covariance || way == Tangents::Eberly && turn == quarter;
            assert!(of_file > 5.0 || turns_by_itself, "{name}, {way:?}: {of_file}");
        }
    }
}
