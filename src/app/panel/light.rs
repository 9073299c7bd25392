//! The widget that chooses the light.

use super::text;
use crate::config::SUN;
use crate::view::light::Light;
use egui::{Color32, DragValue, Sense, Slider, Stroke, Ui, Vec2, vec2};
use glam::DVec3;

/// Radius of the ball `[points]`.
const RADIUS: f32 = 34.0;

/// Chooses the kind of light and its direction or position. A new lamp stands at `eye` (world).
pub fn choose(ui: &mut Ui, light: &mut Light, eye: DVec3) {
    text::named(ui, "light", |ui| {
        for (name, other) in [
            ("headlight", Light::Headlight),
            ("sun", Light::Direction(SUN)),
            ("lamp", Light::Position(eye)),
        ] {
            let is_it = std::mem::discriminant(light) == std::mem::discriminant(&other);
            if ui.selectable_label(is_it, name).clicked() && !is_it {
                *light = other;
            }
        }
    });
    match light {
        Light::Headlight => {}
        Light::Direction(way) => {
            ui.horizontal(|ui| {
                ball(ui, way);
                ui.vertical(|ui| angles(ui, way));
            });
        }
        Light::Position(place) => {
            ui.horizontal(|ui| {
                for (name, number) in
                    [("x", &mut place.x), ("y", &mut place.y), ("z", &mut place.z)]
                {
                    ui.add(
                        DragValue::new(number)
                            .prefix(format!("{name} "))
                            .speed(0.1)
                            .max_decimals(3),
                    );
                }
            });
        }
    }
}

/// Draws the sky from above, north up, with a spot where light comes from; a click or drag moves
/// it.
fn ball(ui: &mut Ui, way: &mut DVec3) {
    let (response, painter) =
        ui.allocate_painter(Vec2::splat(2.0 * RADIUS + 4.0), Sense::click_and_drag());
    let centre = response.rect.center();
    if let Some(at) = response.interact_pointer_pos() {
        *way = -sky((at - centre) / RADIUS);
    }
    let from = -way.normalize();
    let high = from.z >= 0.0;
    painter.circle(centre, RADIUS, Color32::from_gray(45), Stroke::new(1.0, Color32::GRAY));
    painter
        .line_segment([centre, centre - vec2(0.0, RADIUS)], Stroke::new(1.0, Color32::DARK_GRAY));
    let spot = centre + RADIUS * vec2(from.x as f32, -from.y as f32);
    painter.circle(
        spot,
        5.0,
        if high { Color32::YELLOW } else { Color32::TRANSPARENT },
        Stroke::new(1.5, Color32::YELLOW),
    );
    response.on_hover_text("drag: where light comes from, as seen from above, north up");
}

/// The way to a place on the ball, which has a radius of 1 and x to the right, y down; beyond its
/// rim, to the horizon.
fn sky(at: Vec2) -> DVec3 {
    let flat = at / at.length().max(1.0);
    let (x, y) = (flat.x as f64, -flat.y as f64);
    DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt())
}

fn angles(ui: &mut Ui, way: &mut DVec3) {
    let from = -way.normalize();
    let (mut azimuth, mut height) =
        (from.x.atan2(from.y).to_degrees(), from.z.clamp(-1.0, 1.0).asin().to_degrees());
    let turned =
        ui.add(Slider::new(&mut azimuth, -180.0..=180.0).suffix("°").text("from")).changed()
            | ui.add(Slider::new(&mut height, -89.0..=89.0).suffix("°").text("high")).changed();
    if turned {
        let (around, up) = (azimuth.to_radians(), height.to_radians());
        *way = -DVec3::new(around.sin() * up.cos(), around.cos() * up.cos(), up.sin());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_ball_is_overhead_and_its_rim_the_horizon() {
        assert_eq!(sky(Vec2::ZERO), DVec3::Z);
        assert!((sky(vec2(0.0, -5.0)) - DVec3::Y).length() < 1e-6);
        let between = sky(vec2(0.6, 0.0));
        assert!((between - DVec3::new(0.6, 0.0, 0.8)).length() < 1e-6);
    }
}
