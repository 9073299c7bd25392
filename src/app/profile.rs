//! Profiles: the points between two picked places, as a picture of heights over distance and as
//! CSV.

use super::actions::Action;
use super::measure;
use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::colormap;
use crate::cloud::crs::Reference;
use crate::output::section::{self, Axes, Canvas, FINER, SectionPoint};
use crate::resident::slab_query::{SlabPoint, SlabPoints};
use crate::select::slab::Slab;
use egui::epaint::TextShape;
use egui::{
    Align2, Color32, ColorImage, FontId, Painter, Pos2, Rect, RichText, Sense, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, pos2, vec2,
};
use glam::DVec2;
use std::f32::consts::FRAC_PI_2;

/// Largest size of the field of points `[points]`.
const SIZE: DVec2 = DVec2::new(560.0, 240.0);

/// Room for the axes at its left, top, right and bottom `[points]`.
const AROUND: [f32; 4] = [64.0, 8.0, 16.0, 40.0];

/// Side of a point `[points]`.
const POINT: usize = 2;

/// Least distances between ticks `[points]`.
const APART: DVec2 = DVec2::new(80.0, 30.0);

/// Default width of a profile, as a share of its length.
pub const SHARE: f64 = 0.02;

/// A section as it is shown.
pub struct Profile {
    pub slab: Slab,
    section: SlabPoints,
    shown: DisplayAttribute,
    /// Lowest and highest point.
    heights: [f64; 2],
    /// Axes and picture, made when first shown.
    drawn: Option<(Axes, TextureHandle)>,
}

impl Profile {
    pub fn new(slab: Slab, section: SlabPoints, shown: DisplayAttribute) -> Profile {
        let heights = || section.points.iter().map(|found| found.point.position.z);
        let (lo, hi) =
            (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        let heights = if lo <= hi { [lo, hi] } else { [0.0; 2] };
        Profile { slab, section, shown, heights, drawn: None }
    }

    fn point(&self, found: &SlabPoint) -> SectionPoint {
        SectionPoint {
            place: found.place,
            position: found.point.position,
            labels: measure::kind(&found.point),
            numbers: Vec::new(),
            color: colormap::color_of(&self.shown, found.shown),
        }
    }

    fn image(&self, axes: &Axes) -> ColorImage {
        let mut canvas = Canvas::new(axes);
        for found in &self.section.points {
            canvas.draw(axes, &self.point(found), POINT * FINER);
        }
        let size = canvas.size().map(|side| side as usize);
        ColorImage::from_rgba_unmultiplied(size, &canvas.rgba())
    }

    /// Returns a CSV table with a line per point: its place in the profile, its place in the world,
    /// and their unit.
    pub fn csv(&self, reference: &Reference) -> String {
        let line = |found: &SlabPoint| section::line(&self.point(found), reference);
        std::iter::once(section::head("station", &[]))
            .chain(self.section.points.iter().map(line))
            .collect()
    }

    /// Drops the texture, whose device is lost.
    pub fn forget_texture(&mut self) {
        self.drawn = None;
    }

    /// Describes the profile: points, length and width.
    pub fn summary(&self, reference: &Reference) -> String {
        let SlabPoints { points, resident, all } = &self.section;
        let part = if resident < all {
            format!(", of the {resident} of {all} that are loaded")
        } else {
            String::new()
        };
        let [length, width] =
            [self.slab.length, self.slab.width].map(|length| reference.unit().length(length, 3));
        format!("profile: {} points{part}, {length} long, {width} wide", points.len())
    }

    pub fn show(&mut self, ui: &mut Ui, reference: &Reference, actions: &mut Vec<Action>) {
        let drawn = self.drawn.take();
        let (axes, texture) = drawn.unwrap_or_else(|| {
            let axes = Axes::fitting(self.slab.length, self.heights, None, SIZE, reference);
            let image = self.image(&axes);
            (axes, ui.ctx().load_texture("profile", image, TextureOptions::LINEAR))
        });
        let [left, top, right, bottom] = AROUND;
        let size = vec2(axes.size.x as f32, axes.size.y as f32);
        let whole = size + vec2(left + right, top + bottom);
        let (all, response) = ui.allocate_exact_size(whole, Sense::hover());
        let field = Rect::from_min_size(all.min + vec2(left, top), size);
        draw(ui.painter(), &axes, field);
        let all_of_it = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
        ui.painter().image(texture.id(), field, all_of_it, Color32::WHITE);
        let here = response.hover_pos().filter(|at| field.contains(*at));
        ui.label(match here {
            Some(at) => {
                let [lo, hi] = axes.heights;
                let along = (at - field.min) / size;
                let (distance, height) =
                    (along.x as f64 * axes.length, hi - along.y as f64 * (hi - lo));
                let (unit, high) = (reference.unit(), reference.height_unit());
                format!("distance {}, height {}", unit.length(distance, 3), high.length(height, 3))
            }
            None => axes.ratio(),
        });
        self.drawn = Some((axes, texture));
        ui.label(RichText::new(self.summary(reference)).weak());
        ui.horizontal(|ui| {
            if ui.button("csv").on_hover_text("C").clicked() {
                actions.push(Action::SaveProfile);
            }
            if ui.button("close").clicked() {
                actions.push(Action::CloseProfile);
            }
        });
    }
}

/// Draws the ticks and names of the axes around a field, and lines across it.
fn draw(painter: &Painter, axes: &Axes, field: Rect) {
    const TICK: f32 = 4.0;
    const LETTERS: f32 = 11.0;
    painter.rect_filled(field, 0.0, Color32::from_gray(8));
    let ink = painter.ctx().global_style().visuals.text_color();
    let (font, fine) = (FontId::proportional(LETTERS), Stroke::new(1.0, Color32::from_gray(45)));
    let text = |at: Pos2, anchor: Align2, text: &str| {
        painter.text(at, anchor, text, font.clone(), ink);
    };
    let at = |distance: f64, height: f64| {
        let place = axes.place(distance, height);
        field.min + vec2(place.x as f32, place.y as f32)
    };
    let [distances, heights] = axes.ticks(APART);
    for (tick, label) in distances {
        let x = at(tick, 0.0).x;
        painter.vline(x, field.y_range(), fine);
        painter.vline(x, field.bottom()..=field.bottom() + TICK, Stroke::new(1.0, ink));
        text(pos2(x, field.bottom() + TICK + 1.0), Align2::CENTER_TOP, &label);
    }
    for (tick, label) in heights {
        let y = at(0.0, tick).y;
        painter.hline(field.x_range(), y, fine);
        painter.hline(field.left() - TICK..=field.left(), y, Stroke::new(1.0, ink));
        text(pos2(field.left() - TICK - 2.0, y), Align2::RIGHT_CENTER, &label);
    }
    painter.rect_stroke(field, 0.0, Stroke::new(1.0, ink), StrokeKind::Outside);
    let below = pos2(field.center().x, field.bottom() + TICK + LETTERS + 5.0);
    text(below, Align2::CENTER_TOP, &format!("distance [{}]", axes.units[0]));
    let name = format!("height [{}]", axes.units[1]);
    let galley = painter.layout_no_wrap(name, font.clone(), ink);
    let upwards = pos2(field.left() - AROUND[0], field.center().y + galley.size().x / 2.0);
    let turned = TextShape::new(upwards, galley, ink).with_angle(-FRAC_PI_2);
    painter.add(turned);
}
