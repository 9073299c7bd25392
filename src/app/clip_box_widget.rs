//! Clip boxes: numbers in the panel, and edges over the picture with a handle on every face.

use super::measure::Measure;
use crate::names::Named;
use crate::select::clip::{Clip, Clips, Keeps};
use crate::view::{Camera, Projection, View};
use egui::{Color32, DragValue, Pos2, Rect, Sense, Stroke, Ui, Vec2};
use glam::DVec3;

/// Size of a new box around one place, as a share of the picture's height there.
const REACH: f64 = 0.25;

/// Margin of a new box around several places, as a share of their diagonal.
const BEYOND: f64 = 0.05;

/// Diameter of a handle `[points]`.
const HANDLE: f32 = 12.0;

/// Length of a drag that moves a number by the box's length `[points]`.
const TRAVEL: f64 = 200.0;

/// Returns a new box around the picked points, or else around the middle of the picture, with
/// corners on whole millimetres.
pub fn around(measure: &Measure, camera: &Camera) -> Clip {
    let places = measure.places();
    let [min, max] =
        [places.iter().copied().reduce(DVec3::min), places.iter().copied().reduce(DVec3::max)]
            .map(|corner| corner.unwrap_or(camera.target));
    let height = match camera.projection {
        Projection::Perspective => {
            2.0 * (camera.fov_y.to_radians() / 2.0).tan() * min.distance(camera.eye)
        }
        Projection::Orthographic => camera.ortho_height.unwrap_or(1.0),
    };
    let reach = if min == max { REACH * height / 2.0 } else { BEYOND * min.distance(max) };
    let millimetres = |p: DVec3| (p * 1e3).round() / 1e3;
    Clip { keeps: Keeps::Box, min: millimetres(min - reach), max: millimetres(max + reach) }
}

/// Lists all boxes as numbers; sets `added` if another is wanted.
pub fn list(ui: &mut Ui, clips: &mut Clips, added: &mut bool) {
    let title = format!("clip boxes, {} of {} on", clips.active(), clips.0.len());
    egui::CollapsingHeader::new(title)
        .id_salt(("clip boxes", clips.0.is_empty()))
        .default_open(!clips.0.is_empty())
        .show(ui, |ui| {
            *added = ui
                .button("add")
                .on_hover_text("B: around what was picked, or the middle of the picture")
                .clicked();
            let mut gone = None;
            for (number, clip) in clips.0.iter_mut().enumerate() {
                ui.horizontal(|ui| {
                    for &keeps in Keeps::ALL {
                        ui.selectable_value(&mut clip.keeps, keeps, keeps.name());
                    }
                    if ui.button("delete").clicked() {
                        gone = Some(number);
                    }
                });
                egui::Grid::new(("clip box", number)).show(ui, |ui| {
                    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                        let Clip { min, max, .. } = clip;
                        let length = max[axis] - min[axis];
                        let speed =
                            if length.is_finite() { (length / TRAVEL).max(1e-3) } else { 0.1 };
                        ui.label(name);
                        ui.add(DragValue::new(&mut min[axis]).speed(speed).max_decimals(4));
                        ui.add(DragValue::new(&mut max[axis]).speed(speed).max_decimals(4));
                        ui.end_row();
                        min[axis] = min[axis].min(max[axis]);
                    }
                });
            }
            if let Some(number) = gone {
                clips.0.remove(number);
            }
        });
}

/// Draws the edges of all active boxes, and a handle in the middle of every face.
pub fn handles(ui: &Ui, clips: &mut Clips, view: &View) {
    for (number, clip) in clips.0.iter_mut().enumerate() {
        // Infinite boxes have no visible edges.
        if clip.keeps == Keeps::Off || !(clip.min.is_finite() && clip.max.is_finite()) {
            continue;
        }
        let color =
            if clip.keeps == Keeps::Box { Color32::LIGHT_GREEN } else { Color32::LIGHT_RED };
        edges(ui, clip, view, color);
        for face in 0..6 {
            handle(ui, (number, face), clip, view, color);
        }
    }
}

fn edges(ui: &Ui, clip: &Clip, view: &View, color: Color32) {
    let painter = ui.ctx().layer_painter(egui::LayerId::background());
    let corner = |k: usize| {
        DVec3::from_array(
            [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { clip.max[axis] } else { clip.min[axis] }),
        )
    };
    for (k, axis) in (0..8)
        .flat_map(|k| (0..3).map(move |axis| (k, axis)))
        .filter(|(k, axis)| k >> axis & 1 == 0)
    {
        if let Some([a, b]) = in_front(view, corner(k), corner(k | 1 << axis)) {
            let ends = [a, b].map(|p| place(ui, view, p));
            if let [Some(a), Some(b)] = ends {
                painter.line_segment([a, b], Stroke::new(1.0, color));
            }
        }
    }
}

/// Clips a line to the part in front of the camera; None if all of it is behind.
fn in_front(view: &View, a: DVec3, b: DVec3) -> Option<[DVec3; 2]> {
    let depth = |p: DVec3| (p - view.camera.eye).dot(view.basis.forward);
    // Nearer than a thousandth of its length, projected coordinates grow large.
    let near = 1e-3 * a.distance(b) + f64::MIN_POSITIVE;
    let (da, db) = (depth(a), depth(b));
    let cut = || a + (b - a) * ((near - da) / (db - da));
    match (da >= near, db >= near) {
        (true, true) => Some([a, b]),
        (true, false) => Some([a, cut()]),
        (false, true) => Some([cut(), b]),
        (false, false) => None,
    }
}

fn place(ui: &Ui, view: &View, p: DVec3) -> Option<Pos2> {
    view.pixel(p).map(|[x, y]| egui::pos2(x as f32, y as f32) / ui.ctx().pixels_per_point())
}

/// Draws and drags one handle. Faces are numbered: lower then upper of x, of y, of z.
fn handle(ui: &Ui, id: (usize, usize), clip: &mut Clip, view: &View, color: Color32) {
    let (axis, upper) = (id.1 / 2, id.1 % 2 == 1);
    let mut middle = (clip.min + clip.max) / 2.0;
    middle[axis] = if upper { clip.max[axis] } else { clip.min[axis] };
    let Some(at) = place(ui, view, middle).filter(|at| ui.ctx().content_rect().contains(*at))
    else {
        return;
    };
    let around = Rect::from_center_size(at, Vec2::splat(HANDLE));
    let area = egui::Area::new(egui::Id::new(("clip handle", id)))
        .fixed_pos(around.min)
        .order(egui::Order::Middle)
        .constrain(false);
    let dragged = area.show(ui.ctx(), |ui| {
        let (_, response) = ui.allocate_exact_size(Vec2::splat(HANDLE), Sense::drag());
        let filled = if response.hovered() || response.dragged() { Color32::WHITE } else { color };
        ui.painter().circle_filled(response.rect.center(), HANDLE / 3.0, filled);
        // The handle follows the cursor, also if it has left the handle.
        response.interact_pointer_pos().filter(|_| response.dragged())
    });
    if let Some(to) = dragged.inner {
        let by = (to - at) * ui.ctx().pixels_per_point();
        let moved = along(view, middle, DVec3::AXES[axis], [by.x as f64, by.y as f64]);
        let [min, max] = [clip.min[axis], clip.max[axis]];
        if upper {
            clip.max[axis] = (max + moved).max(min);
        } else {
            clip.min[axis] = (min + moved).min(max);
        }
    }
}

/// Returns how far a point at `p` moves along an axis `[m]` to follow a drag `[px]`; 0 if the axis
/// is seen end on.
fn along(view: &View, p: DVec3, axis: DVec3, [x, y]: [f64; 2]) -> f64 {
    let step = 1e-3 * p.distance(view.camera.eye);
    let (Some(a), Some(b)) = (view.pixel(p), view.pixel(p + axis * step)) else { return 0.0 };
    let per_metre = [(b[0] - a[0]) / step, (b[1] - a[1]) / step];
    let squared = per_metre[0] * per_metre[0] + per_metre[1] * per_metre[1];
    // A move far beyond the picture comes from an axis that is seen nearly end on.
    let moved = (x * per_metre[0] + y * per_metre[1]) / squared;
    if moved.is_finite() && moved.abs() < 3.0 * p.distance(view.camera.eye) { moved } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::measure::Picked;
    use crate::resident::Point;

    fn camera() -> Camera {
        serde_json::from_str(r#"{"eye": [500000, 4999990, 5], "target": [500000, 5000000, 5]}"#)
            .unwrap()
    }

    #[test]
    fn a_new_box_is_around_what_was_picked_or_what_is_looked_at() {
        let mut measure = Measure::default();
        let clip = around(&measure, &camera());
        assert!(clip.min.cmplt(camera().target).all() && clip.max.cmpgt(camera().target).all());
        for p in [[500_001.0, 5_000_000.0, 2.0], [500_003.0, 5_000_004.0, 6.0]] {
            measure.points.push(Picked::new(Point {
                position: DVec3::from_array(p),
                exact: true,
                color: [0; 3],
                value: None,
                kind: None,
            }));
        }
        let clip = around(&measure, &camera());
        assert_eq!(
            (clip.min, clip.max),
            (DVec3::new(500_000.7, 4_999_999.7, 1.7), DVec3::new(500_003.3, 5_000_004.3, 6.3))
        );
    }

    #[test]
    fn a_face_follows_the_cursor_along_its_axis_and_edges_end_before_the_camera() {
        let view = View::new(camera(), [400, 300]).unwrap();
        let p = view.camera.target;
        let [x, y] = view.pixel(p).unwrap();
        for (axis, drag) in [(DVec3::X, [7.0, 3.0]), (DVec3::Z, [2.0, -9.0])] {
            let [to_x, to_y] = view.pixel(p + axis * along(&view, p, axis, drag)).unwrap();
            let wanted = if axis == DVec3::X { [7.0, 0.0] } else { [0.0, -9.0] };
            assert!((to_x - x - wanted[0]).hypot(to_y - y - wanted[1]) < 1e-2, "{to_x} {to_y}");
        }
        assert_eq!(along(&view, p, DVec3::Y, [5.0, 5.0]), 0.0);
        let behind = view.camera.eye - DVec3::Y;
        let [a, b] = in_front(&view, behind, p).unwrap();
        assert!(view.pixel(a).is_some() && b == p);
        assert!(in_front(&view, behind, behind - DVec3::Y).is_none());
    }
}
