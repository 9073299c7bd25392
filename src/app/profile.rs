//! Profiles: the points between two picked places, as a picture of heights over distance.

use super::actions::Action;
use super::measure;
use crate::cloud::Station;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::colormap;
use crate::cloud::crs::Reference;
use crate::cloud::histograms::Histograms;
use crate::output::legend::{self, Legend};
use crate::output::section::{self, Axes, Beside, Canvas, FINER, SectionPoint};
use crate::resident::slab_query::{SlabPoint, SlabPoints};
use crate::select::slab::Slab;
use egui::epaint::TextShape;
use egui::{
    Align2, Color32, ColorImage, FontId, Painter, Pos2, Rect, RichText, Sense, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, Vec2, pos2, vec2,
};
use glam::DVec2;
use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;

/// Largest size of the field of points `[points]`.
const SIZE: DVec2 = DVec2::new(560.0, 240.0);

/// Least size of it, and what the window has beside it and the axes: its frame, its title and rows
/// of text `[points]`.
const LEAST: Vec2 = vec2(80.0, 40.0);
const BESIDES: Vec2 = vec2(32.0, 124.0);

/// Room for the axes at its left, top, right and bottom `[points]`.
const AROUND: [f32; 4] = [64.0, 8.0, 16.0, 40.0];

/// Size of letters at the axes and of the legend `[points]`.
const LETTERS: f32 = 11.0;

/// Distance of the legend from the points, and the most of its height that a ramp takes `[points]`.
const BESIDE: f32 = 16.0;
const RAMP: f32 = 160.0;

/// Colours in a ramp.
const PARTS: u32 = 64;

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
    /// Points of each class, of each return number and of each station.
    labels: [BTreeMap<u32, u64>; 3],
    /// Axes and picture, and the room that they were made for.
    drawn: Option<(DVec2, Axes, TextureHandle)>,
}

impl Profile {
    pub fn new(slab: Slab, section: SlabPoints, shown: DisplayAttribute) -> Profile {
        let heights = || section.points.iter().map(|found| found.point.position.z);
        let (lo, hi) =
            (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        let heights = if lo <= hi { [lo, hi] } else { [0.0; 2] };
        let mut labels = [(); 3].map(|()| BTreeMap::<u32, u64>::new());
        for own in section.points.iter().filter_map(|found| measure::kind(&found.point)) {
            let counted = labels.iter_mut().zip(own);
            counted.for_each(|(counts, label)| *counts.entry(label).or_default() += 1);
        }
        Profile { slab, section, shown, heights, labels, drawn: None }
    }

    fn point(&self, found: &SlabPoint) -> SectionPoint {
        SectionPoint {
            place: found.place,
            height: found.point.position.z,
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

    /// Returns what its points show.
    pub fn shown(&self) -> Attribute {
        self.shown.attribute
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

    /// Returns the legend of what its points show.
    pub fn legend(&self, reference: &Reference, stations: &[Station]) -> Option<Legend> {
        let [classes, returns, of_stations] = &self.labels;
        let bytes = |counts: &BTreeMap<u32, u64>| {
            counts.iter().map(|(&label, &points)| (label as u8, points)).collect()
        };
        let counts = Histograms { classes: bytes(classes), returns: bytes(returns) };
        let station = |(at, &points): (&u32, &u64)| {
            Some(Station { points, ..stations.get(*at as usize)?.clone() })
        };
        let stations: Vec<Station> = of_stations.iter().filter_map(station).collect();
        Legend::of(&self.shown, reference, &counts, &stations)
    }

    /// Returns the profile as SVG, as the command line draws it.
    pub fn svg(&self, reference: &Reference, legend: Option<Legend>) -> String {
        let room = section::room(section::SIZE);
        let legend = legend.and_then(|legend| Beside::fitting(legend, room));
        let most = room - DVec2::new(legend.as_ref().map_or(0.0, Beside::width), 0.0);
        let axes = Axes::fitting(self.slab.length, self.heights, None, most, reference);
        let points = self.section.points.len();
        let side = section::side(&axes, points as u64);
        let mut canvas = Canvas::new(&axes);
        for found in &self.section.points {
            canvas.draw(&axes, &self.point(found), side);
        }
        let titles = [self.summary(reference), format!("{points} points")];
        section::svg(&axes, &titles, &canvas, legend.as_ref(), section::SIZE[0].into())
    }

    pub fn show(
        &mut self,
        ui: &mut Ui,
        reference: &Reference,
        legend: Option<&Legend>,
        actions: &mut Vec<Action>,
    ) {
        let [left, top, right, bottom] = AROUND;
        let room = ui.ctx().content_rect().size() - vec2(left + right, top + bottom) - BESIDES;
        let room = room.max(LEAST);
        // In a small window the legend is left out.
        let legend = legend.map(|legend| LegendText::of(legend, ui.painter(), room.y + bottom));
        let legend = legend.filter(|legend| legend.size.x <= 0.5 * room.x);
        let aside = legend.as_ref().map_or(0.0, |legend| legend.size.x);
        let room = SIZE.min(DVec2::new(f64::from(room.x - aside), f64::from(room.y)));
        let drawn = self.drawn.take().filter(|(made_for, ..)| *made_for == room);
        let (_, axes, texture) = drawn.unwrap_or_else(|| {
            let axes = Axes::fitting(self.slab.length, self.heights, None, room, reference);
            let image = self.image(&axes);
            (room, axes, ui.ctx().load_texture("profile", image, TextureOptions::LINEAR))
        });
        let size = vec2(axes.size.x as f32, axes.size.y as f32);
        let aside = legend.as_ref().map_or(vec2(0.0, 0.0), |legend| legend.size);
        // A legend may reach below the axes of a flat profile.
        let high = (size.y + bottom).max(aside.y);
        let whole = vec2(left + size.x + right + aside.x, top + high);
        let (all, response) = ui.allocate_exact_size(whole, Sense::hover());
        let field = Rect::from_min_size(all.min + vec2(left, top), size);
        draw(ui.painter(), &axes, field);
        if let Some(legend) = &legend {
            legend.draw(ui.painter(), field.right_top() + vec2(BESIDE, 0.0));
        }
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
        self.drawn = Some((room, axes, texture));
        ui.label(RichText::new(self.summary(reference)).weak());
        ui.horizontal(|ui| {
            if ui.button("save").on_hover_text("C: as SVG, and as CSV").clicked() {
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

/// A legend, as it is written beside a profile.
struct LegendText {
    /// Title of a ramp.
    heading: String,
    /// Colours from the bottom to the top of a ramp; none of labels.
    ramp: Vec<[u8; 3]>,
    /// Numbers at their heights in a ramp, from 0 to 1; or labels, with their colours.
    rows: Vec<(f64, Option<[u8; 3]>, String)>,
    /// Room that it takes at the right of the points `[points]`.
    size: Vec2,
}

impl LegendText {
    /// Returns a legend that is at most this high; labels that have no room are counted.
    fn of(legend: &Legend, painter: &Painter, most: f32) -> LegendText {
        let (heading, ramp, rows, height) = match legend {
            Legend::Ramp { heading, ends, shown } => {
                let ramp = RAMP.min(most - 1.8 * LETTERS).max(LETTERS);
                let ticks = legend::ticks(*ends, f64::from(5.0 * ramp / RAMP).max(1.0)).into_iter();
                let rows: Vec<_> = ticks.map(|(share, label)| (share, None, label)).collect();
                let colors = legend::colors(shown, PARTS).collect();
                (heading.clone(), colors, rows, 1.8 * LETTERS + ramp)
            }
            Legend::Labels(all) => {
                let lines = ((most / (1.4 * LETTERS)) as usize).max(2);
                let shown = if all.len() > lines { lines - 1 } else { all.len() };
                let (kept, left_out) = legend::most_frequent(all, shown);
                let row = |row: legend::Row| (0.0, Some(row.color), row.name);
                let mut rows: Vec<_> = kept.into_iter().map(row).collect();
                if left_out > 0 {
                    rows.push((0.0, None, format!("and {left_out} more")));
                }
                let height = 1.4 * LETTERS * rows.len() as f32;
                (String::new(), Vec::new(), rows, height)
            }
        };
        let width_of = |text: &str| {
            let font = FontId::proportional(LETTERS);
            painter.layout_no_wrap(text.to_owned(), font, Color32::WHITE).size().x
        };
        let widest = rows.iter().map(|(_, _, text)| width_of(text)).fold(0.0, f32::max);
        let width = width_of(&heading).max(2.4 * LETTERS + widest);
        LegendText { heading, ramp, rows, size: vec2(BESIDE + width, height).ceil() }
    }

    /// Draws it with its top left corner at a place.
    fn draw(&self, painter: &Painter, at: Pos2) {
        let ink = painter.ctx().global_style().visuals.text_color();
        let text = |at: Pos2, anchor: Align2, text: &str| {
            painter.text(at, anchor, text, FontId::proportional(LETTERS), ink);
        };
        text(at, Align2::LEFT_TOP, &self.heading);
        let ramp = self.size.y - 1.8 * LETTERS;
        let bar = Rect::from_min_size(at + vec2(0.0, 1.8 * LETTERS), vec2(1.4 * LETTERS, ramp));
        let part = ramp / self.ramp.len().max(1) as f32;
        for (k, [r, g, b]) in self.ramp.iter().enumerate() {
            let top = bar.bottom() - part * (k + 1) as f32;
            let part = Rect::from_min_size(pos2(bar.left(), top), vec2(bar.width(), part));
            painter.rect_filled(part, 0.0, Color32::from_rgb(*r, *g, *b));
        }
        for (k, (share, color, label)) in self.rows.iter().enumerate() {
            let row = at + vec2(0.0, 1.4 * LETTERS * (k as f32 + 0.5));
            let beside = if self.ramp.is_empty() {
                row + vec2(1.5 * LETTERS, 0.0)
            } else {
                let y = bar.bottom() - bar.height() * *share as f32;
                painter.hline(bar.right()..=bar.right() + 4.0, y, Stroke::new(1.0, ink));
                pos2(bar.right() + 7.0, y)
            };
            if let Some([r, g, b]) = color {
                let middle = row + vec2(0.5 * LETTERS, 0.0);
                let square = Rect::from_center_size(middle, Vec2::splat(LETTERS));
                painter.rect_filled(square, 0.0, Color32::from_rgb(*r, *g, *b));
            }
            text(beside, Align2::LEFT_CENTER, label);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::attribute::class_name;
    use crate::resident::Point;
    use glam::DVec3;

    #[test]
    fn a_legend_has_the_classes_of_the_profile_alone() {
        let slab = Slab::new(DVec3::ZERO, DVec3::X, 0.5).unwrap();
        let point = |class: u32| SlabPoint {
            point: Point {
                position: DVec3::ZERO,
                exact: true,
                color: [0; 3],
                value: None,
                kind: Some(class | 1 << 8),
            },
            shown: class,
            place: DVec2::ZERO,
        };
        let points = [6, 2, 6].map(point).to_vec();
        let section = SlabPoints { points, ..SlabPoints::default() };
        let shown = DisplayAttribute::indexed(Attribute::Class, [0.0; 2], [0, 255]);
        let profile = Profile::new(slab, section, shown);
        let Some(Legend::Labels(rows)) = profile.legend(&Reference::default(), &[]) else {
            panic!("no labels");
        };
        let found: Vec<([u8; 3], Option<&str>)> =
            rows.iter().map(|row| (row.color, Some(&row.name[..]))).collect();
        let wanted =
            [2, 6].map(|class| (colormap::color_of(&shown, class.into()), class_name(class)));
        assert_eq!(found, wanted);
    }

    /// Returns the profile's window in a window of a size.
    fn laid_out(size: Vec2) -> Rect {
        let slab = Slab::new(DVec3::ZERO, DVec3::new(100.0, 0.0, 0.0), 2.0).unwrap();
        let point = |i: u32| SlabPoint {
            point: Point {
                position: DVec3::new(f64::from(i), 0.0, f64::from(i % 37)),
                exact: true,
                color: [0; 3],
                value: None,
                kind: Some((i % 12) | (1 << 8)),
            },
            shown: i % 12,
            place: DVec2::new(f64::from(i), 0.0),
        };
        let points = (0..100).map(point).collect();
        let section = SlabPoints { points, resident: 100, all: 100 };
        let shown = DisplayAttribute::indexed(Attribute::Class, [0.0; 2], [0, 255]);
        let mut profile = Profile::new(slab, section, shown);
        let reference = Reference::default();
        let legend = profile.legend(&reference, &[]);
        let context = egui::Context::default();
        let screen = Rect::from_min_size(Pos2::ZERO, size);
        let mut place = Rect::NOTHING;
        // Its size is known after the first frame.
        for _ in 0..4 {
            let input = egui::RawInput { screen_rect: Some(screen), ..Default::default() };
            let _ = context.run_ui(input, |ui| {
                let window = egui::Window::new("profile").default_pos([336.0, 60.0]);
                let show =
                    |ui: &mut Ui| profile.show(ui, &reference, legend.as_ref(), &mut Vec::new());
                place = window.show(ui.ctx(), show).expect("it is open").response.rect;
            });
        }
        place
    }

    #[test]
    fn a_profile_fits_into_small_windows() {
        for size in [vec2(1280.0, 800.0), vec2(730.0, 500.0), vec2(480.0, 300.0)] {
            let place = laid_out(size);
            let screen = Rect::from_min_size(Pos2::ZERO, size);
            assert!(screen.contains_rect(place), "{size}: {place}");
        }
        // Where there is room, it is as large as ever.
        let place = laid_out(vec2(1280.0, 800.0));
        assert!(f64::from(place.width()) > SIZE.x, "{place}");
    }
}
