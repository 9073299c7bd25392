//! Clouds whose transform stretches, shears or mirrors them.

use super::*;
use glam::{DMat3, DMat4};
use pointillist::cloud::Cloud;
use pointillist::cloud::attribute::DisplayAttribute;
use pointillist::graph::Gpu;
use std::collections::HashMap;

/// Where points lie.
const MIDDLE: DVec3 = DVec3::new(5e5, 4e6, 120.0);

/// Linear maps that are no similarities; the last one mirrors.
fn maps() -> [DMat3; 3] {
    [
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 3.0)),
        DMat3::from_cols_array(&[1.3, 0.2, 0.0, -0.4, 0.8, 0.1, 0.0, 0.5, 1.5]),
        DMat3::from_cols_array(&[-0.9, 0.3, 0.2, 0.5, 1.1, 0.0, 0.0, -0.4, 0.7]),
    ]
}

/// Returns a map about the middle of the points, and a translation.
fn about_middle(map: DMat3) -> DMat4 {
    let moved = DVec3::new(10.0, -20.0, 5.0);
    DMat4::from_translation(MIDDLE + moved)
        * DMat4::from_mat3(map)
        * DMat4::from_translation(-MIDDLE)
}

/// Returns points of a bumpy sphere of radius 1, and their normals.
fn sphere(count: u32) -> (Vec<DVec3>, Vec<DVec3>) {
    let direction = |i: u32| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let angle = i as f64 * 2.399963229728653;
        (DVec3::new(angle.cos(), angle.sin(), 0.0) * (1.0 - z * z).sqrt()).with_z(z)
    };
    ((0..count).map(|i| MIDDLE + direction(i)).collect(), (0..count).map(direction).collect())
}

fn colors(count: usize) -> Vec<[u8; 3]> {
    (0..count).map(|i| [(i * 7 % 251) as u8, (i * 31 % 253) as u8, (i % 200) as u8]).collect()
}

fn places(points: &[DVec3]) -> Vec<[f64; 3]> {
    points.iter().map(|point| point.to_array()).collect()
}

/// Returns the positions of points as they are kept, by id.
pub(super) fn by_id(points: &Points) -> HashMap<u32, DVec3> {
    let mut gpu = Gpu::open(&DeviceOptions::default()).unwrap();
    let cloud = Cloud::of_points(points).unwrap();
    let (shown, _) = DisplayAttribute::automatic(&cloud);
    let resident = Resident::fill(&mut gpu, cloud, shown, &Silent).unwrap();
    let positions = resident.positions(&mut gpu).unwrap();
    let ids =
        resident.nodes.iter().flat_map(|node| (0..node.count).map(|i| node.first_point() + i));
    ids.zip(positions).collect()
}

struct Picture {
    color: Vec<u8>,
    depth: Vec<f32>,
    ids: Vec<u32>,
    normals: Vec<[f32; 4]>,
}

/// Draws a cloud that `add` adds, with these settings.
fn drawn(
    settings: &[(&str, &str)],
    transform: Option<DMat4>,
    camera: Camera,
    add: impl FnOnce(&mut Renderer) -> pointillist::renderer::CloudId,
) -> Picture {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    settings.iter().for_each(|(name, value)| renderer.set(name, value).unwrap());
    let cloud = add(&mut renderer);
    if let Some(transform) = transform {
        renderer.set_transform(cloud, &transform.to_cols_array()).unwrap();
    }
    let targets = application.targets();
    let (report, color, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(report.points > 0);
    let (ids, normals) = std::mem::take(&mut application.layers);
    Picture { color, depth, ids: ids.iter().map(|id| id[0]).collect(), normals }
}

/// Returns the share of pixels whose colours differ by more than `by`.
fn differing(a: &Picture, b: &Picture, by: u8) -> f64 {
    let pixels = a.color.chunks(4).zip(b.color.chunks(4));
    let differs = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > by);
    pixels.filter(differs).count() as f64 / PIXELS as f64
}

fn camera_of(transform: DMat4, points: &[DVec3]) -> Camera {
    let moved: Vec<_> = points.iter().map(|&point| transform.transform_point3(point)).collect();
    Camera::framing(Preset::Fit, &moved, SIZE)
}

/// Points, their positions as they are kept by id, and where they are.
struct Placed<'p> {
    points: &'p Points<'p>,
    own: &'p HashMap<u32, DVec3>,
    transform: DMat4,
}

/// Where a point of a position lies on the screen `[px]`, and its depth, through all matrices in
/// f64.
pub(super) fn on_screen(matrices: &Matrices, place: DVec3) -> [f64; 3] {
    let [view, projection] =
        [matrices.view, matrices.projection].map(|matrix| DMat4::from_cols_array(&matrix));
    let clip = projection * (view * place.extend(1.0));
    let ndc = clip.truncate() / clip.w;
    [(ndc.x + 1.0) / 2.0 * SIZE[0] as f64, (ndc.y + 1.0) / 2.0 * SIZE[1] as f64, ndc.z]
}

/// Distance from the edge of a pixel within which rounding may bring a point to another one `[px]`.
pub(super) const EDGE: f64 = 2e-3;

/// Returns the pixel of a place on the screen; None if it is at an edge, or beside the picture.
pub(super) fn pixel_of([x, y]: [f64; 2]) -> Option<usize> {
    let inside = [x, y].iter().all(|at| (EDGE..1.0 - EDGE).contains(&at.rem_euclid(1.0)));
    let on = x >= 0.0 && y >= 0.0 && x < SIZE[0] as f64 && y < SIZE[1] as f64;
    (inside && on).then(|| y as usize * SIZE[0] as usize + x as usize)
}

/// Depths that are right: rounding of positions, of depths in f32, and of what is stored.
pub(super) struct Slack {
    /// Depth that nothing is added to.
    base: f64,
    step: f64,
}

impl Slack {
    pub(super) fn of(matrices: &Matrices, format: vk::Format) -> Slack {
        let projection = DMat4::from_cols_array(&matrices.projection);
        let perspective = projection.z_axis.w != 0.0;
        // Of an orthographic projection, that of the near plane.
        let near = if projection.z_axis.z > 0.0 { 1.0 } else { 0.0 };
        let base = if perspective { projection.z_axis.z / projection.z_axis.w } else { near };
        let step = depth_bits(format).map_or(0.0, |bits| 1.0 / ((1u64 << bits) - 1) as f64);
        Slack { base, step }
    }

    pub(super) fn around(&self, depth: f64) -> f64 {
        1e-5 * (depth - self.base).abs() + 3e-7 + self.step
    }
}

/// Checks that every pixel shows the point that is nearest in f64, at its depth. Returns how many
/// do.
fn lie_where_f64_says(
    application: &mut Application,
    placed: &Placed,
    camera: ViewCamera,
    matrices: &Matrices,
    what: &str,
) -> usize {
    let mut renderer = application.renderer();
    renderer.set("style", "points").unwrap();
    let cloud = renderer.add_points(placed.points).unwrap();
    renderer.set_transform(cloud, &placed.transform.to_cols_array()).unwrap();
    (application.frame, application.safe) = (0, 0);
    let targets = application.targets();
    let view = FrameView { camera, area: WHOLE };
    let (_, _, depths) = application.settle(&mut renderer, targets, &[view]);
    let ids = application.layers.0.clone();
    drop(renderer);
    let seen = |own: DVec3| on_screen(matrices, placed.transform.transform_point3(own));
    let slack = Slack::of(matrices, application.depth.format);
    // Depths of a host of forward depth grow.
    let projection = DMat4::from_cols_array(&matrices.projection);
    let depth_at = |z: f64| {
        let clip = projection * glam::DVec4::new(0.0, 0.0, z, 1.0);
        clip.z / clip.w
    };
    let side = if projection.z_axis.w == 0.0 { -1.0 } else { projection.z_axis.w };
    let sign = if depth_at(side) > depth_at(2.0 * side) { 1.0 } else { -1.0 };
    let far = if sign > 0.0 { 0.0 } else { 1.0 };
    let mut nearest = vec![far; PIXELS];
    for &point in placed.own.values() {
        let [x, y, depth] = seen(point);
        if let Some(pixel) = pixel_of([x, y]) {
            let before = nearest[pixel];
            nearest[pixel] = if sign * depth > sign * before { depth } else { before };
        }
    }
    let mut shown = 0;
    for (pixel, (&[id, of], &depth)) in ids.iter().zip(&depths).enumerate() {
        let depth = depth as f64;
        let reached = sign * depth >= sign * nearest[pixel] - slack.around(depth);
        assert!(reached, "{what}: a point is missing in {pixel}, {depth} {}", nearest[pixel]);
        if id == NO_POINT {
            assert_eq!(depth, far, "{what}: pixel {pixel}");
            continue;
        }
        shown += 1;
        assert_eq!(of as u64, cloud.0);
        let [x, y, own_depth] = seen(placed.own[&id]);
        let corner = [pixel % SIZE[0] as usize, pixel / SIZE[0] as usize].map(|at| at as f64);
        let off = [x - corner[0] - 0.5, y - corner[1] - 0.5].map(f64::abs);
        assert!(off[0].max(off[1]) <= 0.5 + EDGE, "{what}: pixel {pixel}, {x} {y}");
        let off = (own_depth - depth).abs();
        assert!(off <= slack.around(own_depth), "{what}: {own_depth} {depth}");
    }
    shown
}

/// Every pixel shows the point that is nearest in f64, through all matrices, at its depth.
#[test]
fn points_of_an_affine_transform_lie_where_f64_says() {
    let (points, _) = sphere(30_000);
    let (points, colors) = (places(&points), colors(points.len()));
    let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&points)) };
    let own = by_id(&points);
    let mut application = Application::new(COLOR);
    for map in maps() {
        let transform = about_middle(map);
        let camera = camera_of(transform, &own.values().copied().collect::<Vec<_>>());
        let matrices = Matrices::of(&camera, SIZE, 0.01, f64::INFINITY).unwrap();
        let placed = Placed { points: &points, own: &own, transform };
        let camera = view_of(camera).camera;
        let what = format!("{map}");
        let shown = lie_where_f64_says(&mut application, &placed, camera, &matrices, &what);
        assert!(shown > 5000, "{shown} pixels");
    }
}

/// Depth is that of the host, in every form and format.
#[test]
fn depth_of_points_is_what_f64_says_in_every_form_and_format() {
    let (points, _) = sphere(30_000);
    let points = places(&points);
    let points = Points::new(Positions::F64(&points));
    let own = by_id(&points);
    let transform = about_middle(maps()[1]);
    let all: Vec<_> = own.values().map(|&own| transform.transform_point3(own)).collect();
    let placed = Placed { points: &points, own: &own, transform };
    let perspective = Camera::framing(Preset::Fit, &all, SIZE);
    let flat = Camera::framing(Preset::Top, &all, SIZE);
    assert_eq!(flat.projection, pointillist::renderer::Projection::Orthographic);
    let forwards = |matrices: Matrices| {
        let turned = DMat4::from_cols(
            DVec3::X.extend(0.0),
            DVec3::Y.extend(0.0),
            DVec3::NEG_Z.extend(0.0),
            DVec3::Z.extend(1.0),
        );
        let projection = turned * DMat4::from_cols_array(&matrices.projection);
        Matrices { projection: projection.to_cols_array(), ..matrices }
    };
    let shifted = |matrices: Matrices| {
        let mut projection = matrices.projection;
        // Of a perspective, and of an orthographic projection.
        let first = if projection[11] == 0.0 { 12 } else { 8 };
        (projection[first], projection[first + 1]) = (0.2, -0.15);
        Matrices { projection, ..matrices }
    };
    // Pixels that are not square, and a picture that is mirrored.
    let scaled = |matrices: Matrices, x: f64, y: f64| {
        let mut projection = matrices.projection;
        (projection[0], projection[5]) = (x * projection[0], y * projection[5]);
        Matrices { projection, ..matrices }
    };
    let of = |camera: &Camera, near, far| Matrices::of(camera, SIZE, near, far).unwrap();
    let endless = of(&perspective, 0.01, f64::INFINITY);
    let (near, far) = (0.5, 50.0);
    let finite = of(&perspective, near, far);
    let parallel = of(&flat, -10.0, 100.0);
    let ours = |camera, near, far| ViewCamera::Camera { camera, near, far };
    let matrices = |matrices| (ViewCamera::Matrices(matrices), matrices);
    let forms = [
        ("off-centre", matrices(shifted(endless))),
        ("forward", matrices(forwards(endless))),
        ("finite", matrices(finite)),
        ("finite, forward", matrices(forwards(finite))),
        ("finite, off-centre, forward", matrices(forwards(shifted(finite)))),
        ("orthographic", matrices(parallel)),
        ("orthographic, off-centre", matrices(shifted(parallel))),
        ("orthographic, forward", matrices(forwards(parallel))),
        ("mirrored", matrices(scaled(endless, -1.0, 1.0))),
        ("upside down", matrices(scaled(shifted(endless), 1.0, -1.0))),
        ("narrow", matrices(scaled(shifted(finite), 0.7, 1.0))),
        ("wide, mirrored", matrices(scaled(forwards(endless), -1.1, 0.8))),
        ("orthographic, low", matrices(scaled(parallel, 1.0, 0.6))),
        ("our camera", (ours(perspective, near, far), finite)),
        ("our camera, orthographic", (ours(flat, -10.0, 100.0), parallel)),
    ];
    let formats = [
        DEPTH,
        vk::Format::D16_UNORM,
        vk::Format::X8_D24_UNORM_PACK32,
        vk::Format::D24_UNORM_S8_UINT,
        vk::Format::D32_SFLOAT_S8_UINT,
    ];
    for format in formats {
        let is_usual = format == DEPTH;
        if !is_usual && !can_be_depth(format) {
            crate::skip::skip(&format!("the device has no depth of {format:?}"));
            continue;
        }
        let mut application = Application::with_depth(COLOR, format);
        // Forms differ in the kernel's numbers alone; formats in what is stored of them.
        let some = if is_usual { &forms[..] } else { &forms[2..6] };
        for (name, (camera, matrices)) in some {
            let what = format!("{format:?}, {name}");
            let shown = lie_where_f64_says(&mut application, &placed, *camera, matrices, &what);
            println!("{what}: {shown} pixels");
            assert!(shown > 4000, "{what}: {shown} pixels");
        }
    }
}

/// Tests whether the device draws depth of a format.
pub(super) fn can_be_depth(format: vk::Format) -> bool {
    let device = Device::open(&DeviceOptions::default()).unwrap();
    // SAFETY: a plain query.
    let found =
        unsafe { device.instance.get_physical_device_format_properties(device.physical, format) };
    use vk::FormatFeatureFlags as Can;
    found
        .optimal_tiling_features
        .contains(Can::DEPTH_STENCIL_ATTACHMENT | Can::TRANSFER_SRC | Can::TRANSFER_DST)
}

/// Pictures are those of the same points transformed beforehand: same points, same shading.
#[test]
fn an_affine_transform_draws_what_transformed_points_do() {
    // Densely, and with gaps that are filled.
    for (count, most) in [(400_000, 1e-3), (15_000, 1e-3)] {
        draws_what_transformed_points_do(count, most);
    }
}

fn draws_what_transformed_points_do(count: u32, most: f64) {
    let (points, _) = sphere(count);
    let (own, colors) = (places(&points), colors(points.len()));
    let own = Points { colors: Some(&colors), ..Points::new(Positions::F64(&own)) };
    let own_by_id = by_id(&own);
    let turned = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2.0);
    for map in maps().into_iter().chain([turned]) {
        let transform = about_middle(map);
        let before: Vec<_> = points.iter().map(|&at| transform.transform_point3(at)).collect();
        let camera = Camera::framing(Preset::Fit, &before, SIZE);
        let before = places(&before);
        let before = Points { colors: Some(&colors), ..Points::new(Positions::F64(&before)) };
        let before_by_id = by_id(&before);
        let sun = ("light", "direction:1,2,-2");
        let shaded = [("effect", "phong=on"), ("effect", "shadows=on"), ("effect", "edl=on"), sun];
        let styles = [
            &[("style", "points")][..],
            &[("style", "surface")],
            &[&[("style", "surface")][..], &shaded].concat(),
        ];
        for settings in styles {
            let [moved, baked] =
                [(&own, Some(transform)), (&before, None)].map(|(points, transform)| {
                    drawn(settings, transform, camera, |renderer| {
                        renderer.add_points(points).unwrap()
                    })
                });
            let share = differing(&moved, &baked, 8);
            let same = |(&a, &b): (&u32, &u32)| match [a, b].contains(&NO_POINT) {
                true => a == b,
                false => {
                    let place = transform.transform_point3(own_by_id[&a]);
                    (place - before_by_id[&b]).length() < 1e-6
                }
            };
            let pairs = moved.ids.iter().zip(&baked.ids);
            let others = pairs.filter(|pair| !same(*pair)).count() as f64 / PIXELS as f64;
            println!(
                "{count} {:?} {map}: {share:.5} of colours, {others:.5} of ids differ",
                settings.last()
            );
            assert!(share <= most && others <= most, "{settings:?} {map}: {share} {others}");
        }
    }
}

/// Normals of a file are turned with their surface, also where it is mirrored.
#[test]
fn normals_of_points_follow_an_affine_transform() {
    let folder = tempfile::tempdir().unwrap();
    let (points, normals) = sphere(200_000);
    let file = |name: &str, transform: DMat4| {
        let of_normals = DMat3::from_mat4(transform).inverse().transpose();
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
        for name in ["x", "y", "z", "nx", "ny", "nz"] {
            text += &format!("property double {name}\n");
        }
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        for (&point, &normal) in points.iter().zip(&normals) {
            let (p, n) = (transform.transform_point3(point), (of_normals * normal).normalize());
            text += &format!("{} {} {} {} {} {} 200 150 90\n", p.x, p.y, p.z, n.x, n.y, n.z);
        }
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    for map in maps() {
        let transform = about_middle(map);
        let camera = camera_of(transform, &points);
        let phong = [
            ("style", "surface"),
            ("effect", "phong=on,normals=file,backfaces=drop"),
            ("light", "direction:1,2,-2"),
        ];
        let files = [
            (file("own.ply", DMat4::IDENTITY), Some(transform)),
            (file("before.ply", transform), None),
        ];
        let [moved, baked] = files.map(|(path, transform)| {
            drawn(&phong, transform, camera, |renderer| {
                renderer.open(&[path], &OpenSettings::default()).unwrap()
            })
        });
        let share = differing(&moved, &baked, 6);
        // Against those of the surface itself, of as many pixels.
        let (view, back) = (View::new(camera, SIZE).unwrap(), transform.inverse());
        let off = |picture: &Picture| {
            let seen = picture.normals.iter().zip(&picture.depth).enumerate();
            let mut off: Vec<f64> = seen
                .filter(|(_, (_, depth))| **depth > 0.0)
                .map(|(pixel, (normal, &depth))| {
                    let [x, y] = [pixel % SIZE[0] as usize, pixel / SIZE[0] as usize];
                    let (origin, ray) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
                    let place = origin + ray * 0.01 / depth as f64;
                    let truth = back.transform_point3(place) - MIDDLE;
                    let truth = DMat3::from_mat4(back).transpose() * truth;
                    let [x, y, z, _] = normal.map(f64::from);
                    truth.angle_between(DVec3::new(x, y, z)).to_degrees()
                })
                .collect();
            off.sort_by(f64::total_cmp);
            [off[off.len() / 2], off[off.len() * 99 / 100]]
        };
        let (moved, baked) = (off(&moved), off(&baked));
        println!(
            "{map}: {share:.5} of colours differ; normals off by {moved:.2?}, {baked:.2?} degrees"
        );
        assert!(share < 0.02, "{map}: {share}");
        assert!((0..2).all(|k| moved[k] <= baked[k] + 0.5), "{map}: {moved:?} {baked:?}");
    }
}

/// Returns points a centimetre apart.
fn on_lattice(steps: &[[i32; 3]]) -> Points<'_> {
    let (scale, offset) = ([0.01, 0.01, 0.01], MIDDLE.to_array());
    Points::new(Positions::Steps { steps, scale, offset })
}

/// Picks give the file's own coordinates to the last bit, and clip boxes are in these.
#[test]
fn picks_and_clip_boxes_of_an_affine_transform_are_the_clouds_own() {
    let steps: Vec<[i32; 3]> = (0..160_000).map(|i| [i % 400, i / 400, i % 3]).collect();
    let place =
        |step: [i32; 3]| MIDDLE + DVec3::splat(0.01) * DVec3::from_array(step.map(f64::from));
    for map in maps() {
        let transform = about_middle(map);
        let all: Vec<_> = steps.iter().map(|&step| place(step)).collect();
        let camera = camera_of(transform, &all);
        let (low, high) = (place([50, 120, 0]), place([300, 399, 2]));
        let clip = format!("box:{},{},{},{},{},{}", low.x, low.y, low.z, high.x, high.y, high.z);
        let left: Vec<[i32; 3]> = steps
            .iter()
            .copied()
            .filter(|&step| place(step).cmpge(low).all() && place(step).cmple(high).all())
            .collect();
        assert!(left.len() > 50_000 && left.len() < 100_000);
        let points = ("style", "points");
        let clipped = drawn(&[points, ("clip", &clip)], Some(transform), camera, |renderer| {
            renderer.add_points(&on_lattice(&steps)).unwrap()
        });
        let alone = drawn(&[points], Some(transform), camera, |renderer| {
            renderer.add_points(&on_lattice(&left)).unwrap()
        });
        let covered =
            |picture: &Picture| picture.ids.iter().map(|&id| id != NO_POINT).collect::<Vec<bool>>();
        let (clipped, alone) = (covered(&clipped), covered(&alone));
        let off = clipped.iter().zip(&alone).filter(|(a, b)| a != b).count();
        let all = alone.iter().filter(|covered| **covered).count();
        assert!(off * 1000 <= all && all > 1000, "{off} of {all} pixels");

        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        let cloud = renderer.add_points(&on_lattice(&steps)).unwrap();
        renderer.set_transform(cloud, &transform.to_cols_array()).unwrap();
        let (targets, views) = (application.targets(), [view_of(camera)]);
        application.settle(&mut renderer, targets, &views);
        let pick = renderer.pick(SIZE.map(|side| side / 2));
        application.draw(&mut renderer, targets, &views, None);
        application.draw(&mut renderer, targets, &views, None);
        let Picked::Point(point) = renderer.picked(pick) else { panic!("a point in the middle") };
        assert!(
            point.exact && steps.iter().any(|&step| place(step) == point.position),
            "{point:?}"
        );
        let world = transform.transform_point3(point.position);
        assert!((point.world - world).length() < 1e-8, "{point:?} {world}");
        let [x, y] = View::new(camera, SIZE).unwrap().pixel(world).unwrap();
        assert!((x - 160.5).hypot(y - 120.5) < 2.0, "{x} {y}");

        // Strokes are those of clouds as they are; what is refused changes nothing.
        renderer.set("style", "strokes").unwrap();
        let (report, ..) = application.draw(&mut renderer, targets, &views, None);
        assert!(report.errors[0].contains("drawn as points") && report.points > 0, "{report:?}");
        let flat = DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0)).to_cols_array();
        let refused = renderer.set_transform(cloud, &flat).unwrap_err().to_string();
        assert!(refused.contains("must not flatten"), "{refused}");
    }
}

/// The cut of an index follows where its nodes are drawn: near enough, all points are there.
#[test]
fn an_index_is_cut_where_an_affine_transform_draws_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.las");
    files::scan(&path, pointillist::synth::SceneKind::Torus, 600_000);
    let options = pointillist::cloud::ReadOptions::new(Default::default(), false);
    let cloud = pointillist::cloud::read(std::slice::from_ref(&path), &options, &Silent).unwrap();
    let core = cloud.core_points();
    let index = indexed(&[&path], "");
    let middle = core.iter().sum::<DVec3>() / core.len() as f64;
    for map in maps() {
        let about = DMat4::from_translation(middle);
        let transform = about * DMat4::from_mat3(map) * about.inverse();
        let mut camera = camera_of(transform, &core);
        // Beside the middle, and nearer.
        let at = transform.transform_point3(core[core.len() / 3]);
        camera = Camera { eye: at + (camera.eye - camera.target) * 0.15, target: at, ..camera };
        let points = [("style", "points")];
        let [whole, nodes] = [&path, &index].map(|path| {
            drawn(&points, Some(transform), camera, |renderer| {
                renderer.open(std::slice::from_ref(path), &OpenSettings::default()).unwrap()
            })
        });
        let off =
            whole.depth.iter().zip(&nodes.depth).filter(|(a, b)| (*a - *b).abs() > 1e-4 * **a);
        let (off, all) = (off.count(), whole.depth.iter().filter(|depth| **depth > 0.0).count());
        println!("{map}: {off} of {all} pixels");
        assert!(off * 200 <= all && all > 5000, "{map}: {off} of {all} pixels");
    }
}

/// Mirrored pictures are the others seen in a mirror, and normals do not depend on the pixels'
/// shape.
#[test]
fn distorted_views_show_the_same_surface() {
    let (points, _) = sphere(60_000);
    let places = places(&points);
    let points = Points::new(Positions::F64(&places));
    let camera = camera_of(DMat4::IDENTITY, &by_id(&points).into_values().collect::<Vec<_>>());
    let drawn = |x: f64, y: f64| {
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        renderer.add_points(&points).unwrap();
        let mut matrices = Matrices::of(&camera, SIZE, 0.01, f64::INFINITY).unwrap();
        (matrices.projection[0], matrices.projection[5]) =
            (x * matrices.projection[0], y * matrices.projection[5]);
        let view = FrameView { camera: ViewCamera::Matrices(matrices), area: WHOLE };
        let targets = application.targets();
        let (_, color, depth) = application.settle(&mut renderer, targets, &[view]);
        let (ids, normals) = std::mem::take(&mut application.layers);
        Picture { color, depth, ids: ids.iter().map(|id| id[0]).collect(), normals }
    };
    let (straight, mut mirrored) = (drawn(1.0, 1.0), drawn(-1.0, 1.0));
    let width = SIZE[0] as usize;
    mirrored.color = mirrored
        .color
        .chunks(4 * width)
        .flat_map(|row| row.chunks(4).rev().flatten())
        .copied()
        .collect();
    let share = differing(&straight, &mirrored, 2);
    println!("{:.2} % of the pixels differ in a mirror", 100.0 * share);
    assert!(share < 0.01, "{share}");
    // Mean angle to the sphere's own normals [degrees].
    let own = by_id(&points);
    let off = |picture: &Picture| {
        let pixels = picture.ids.iter().zip(&picture.normals).filter(|(id, _)| **id != NO_POINT);
        let angles: Vec<f64> = pixels
            .map(|(id, &[x, y, z, _])| {
                let seen = DVec3::new(x as f64, y as f64, z as f64);
                assert!((seen.length() - 1.0).abs() < 1e-3 || seen == DVec3::ZERO, "{seen}");
                seen.angle_between(own[id] - MIDDLE).to_degrees()
            })
            .filter(|angle| !angle.is_nan())
            .collect();
        assert!(angles.len() > 5000, "{}", angles.len());
        angles.iter().sum::<f64>() / angles.len() as f64
    };
    let straight = off(&straight);
    for (x, y) in [(0.5, 1.0), (1.0, 0.6), (-0.7, 1.0)] {
        let found = off(&drawn(x, y));
        println!("normals are off by {found:.2} degrees, {straight:.2} of square pixels");
        assert!(found < 1.5 * straight + 0.5, "{found} {straight}");
    }
}
