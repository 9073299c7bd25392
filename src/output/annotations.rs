//! Draws annotations: title, legend, scale bar, north arrow and axes. The window and the files of
//! pictures draw them alike; sizes are relative to the height of the picture.

use super::legend::{self, Legend, Row};
use super::overlay::{Corner, Overlay};
use super::ticks::{multiples, number, round_above, round_below};
use crate::cloud::Station;
use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::crs::Reference;
use crate::cloud::histograms::Histograms;
use crate::cloud::up::Up;
use crate::render::annotations::Annotations;
use crate::view::{Covered, Projection, View};
use egui::epaint::{ImageDelta, Primitive, TextureId};
use egui::{
    Align2, Color32, Context, FontId, FullOutput, ImageData, LayerId, Painter, Pos2, RawInput,
    Rect, Shape, Stroke, Vec2, pos2, vec2,
};
use glam::DVec3;

/// What a picture shows, as far as annotations name it.
#[derive(Clone, Debug)]
pub struct Shown {
    pub attribute: DisplayAttribute,
    pub reference: Reference,
    pub up: Up,
    /// Bounds of the points without strays: least and greatest (world). The scale bar asks for
    /// them.
    pub bounds: Option<[DVec3; 2]>,
    pub counts: Histograms,
    pub stations: Vec<Station>,
}

/// Height of a line of text, relative to the height of the picture, and the least `[px]`.
const LINE: f32 = 1.0 / 36.0;
const LEAST_LINE: f32 = 9.0;
/// Height of the north arrow and of the axes, and least height of a legend [lines].
const ARROW: f32 = 4.0;
const TRIAD: f32 = 5.0;
const LEAST_LEGEND: f32 = 6.0;
/// Margin of the dark field behind, in lines.
const FIELD: f32 = 0.5;
/// Behind what is drawn, so that it can be read on any picture.
const BEHIND: Color32 = Color32::from_rgba_premultiplied(14, 16, 19, 190);
const INK: Color32 = Color32::WHITE;
/// Rectangles of a ramp.
const PARTS: u32 = 64;
/// Widest text atlas `[px]`.
const ATLAS: usize = 1 << 14;

/// Returns why there is no arrow to the north; None if there is one.
pub fn no_north(up: Up) -> Option<&'static str> {
    (up != Up::Z).then_some("y points up, so north is unknown")
}

impl Annotations {
    /// Returns what to draw over the whole picture of a view.
    pub fn overlay(&self, view: &View, shown: &Shown) -> Overlay {
        if self.is_empty() {
            return Overlay::default();
        }
        let (context, output, _) = self.laid_out(view, shown);
        let mut overlay = Overlay::default();
        let text = output.textures_delta.set.iter().filter(|(id, _)| **id == TextureId::default());
        text.flat_map(|(_, deltas)| deltas).for_each(|delta| take(&mut overlay, delta));
        for clipped in context.tessellate(output.shapes, output.pixels_per_point) {
            let Primitive::Mesh(mesh) = clipped.primitive else { continue };
            let corner = |&index: &u32| {
                let vertex = mesh.vertices[index as usize];
                Corner {
                    at: vertex.pos.into(),
                    uv: vertex.uv.into(),
                    color: vertex.color.to_array().map(|channel| channel as f32 / 255.0),
                }
            };
            let triangles = mesh.indices.as_chunks::<3>().0;
            overlay.triangles.extend(triangles.iter().map(|[a, b, c]| [a, b, c].map(corner)));
        }
        overlay
    }

    /// Returns what they cover of a view.
    pub fn covered(&self, view: &View, shown: &Shown) -> Covered {
        if self.is_empty() { Covered::default() } else { self.laid_out(view, shown).2.covered }
    }

    /// Returns a note on what has no room in a view; None if all has.
    pub fn note(&self, view: &View, shown: &Shown) -> Option<String> {
        let left_out = if self.is_empty() { vec![] } else { self.laid_out(view, shown).2.left_out };
        let [width, height] = view.whole;
        (!left_out.is_empty())
            .then(|| format!("{width}x{height} pixels have no room for {}", left_out.join(" and ")))
    }

    fn laid_out(&self, view: &View, shown: &Shown) -> (Context, FullOutput, Drawn) {
        let context = Context::default();
        let rect =
            Rect::from_min_size(Pos2::ZERO, vec2(view.whole[0] as f32, view.whole[1] as f32));
        let input = RawInput {
            screen_rect: Some(rect),
            max_texture_side: Some(ATLAS),
            ..RawInput::default()
        };
        let mut all = Drawn::default();
        let output = context.run_ui(input, |ui| {
            let painter = ui.ctx().layer_painter(LayerId::background());
            all = self.draw(&painter, rect, view, shown);
        });
        (context, output, all)
    }

    /// Draws into a rectangle that shows a whole view.
    pub fn draw(&self, painter: &Painter, rect: Rect, view: &View, shown: &Shown) -> Drawn {
        let line = (LINE * rect.height().min(1.5 * rect.width())).max(LEAST_LINE);
        let sheet = Sheet { painter, rect, line, view, shown };
        let edges = if self.axes { sheet.axes() } else { Vec2::ZERO };
        let inner = Rect::from_min_max(
            pos2(rect.left() + edges.x + line, rect.top() + line),
            pos2(rect.right() - line, rect.bottom() - edges.y - line),
        );
        let mut free = rect;
        free.min.x += edges.x;
        free.max.y -= edges.y;
        // What is left of the column at the right. What has no room there is left out.
        let (mut room, column) = (inner, inner.right() - TRIAD * line);
        if let Some(title) = &self.title {
            let at = pos2(rect.center().x, inner.top());
            let wide = sheet.width_of(title) / line;
            let size = (1.6 * line).min(inner.width() / wide.max(1.0));
            let place = sheet.text(at, Align2::CENTER_TOP, title, size, true);
            free.min.y = place.bottom() + FIELD * line;
            if place.right() + line > column {
                room.min.y = free.min.y + FIELD * line;
            }
        }
        if self.scale_bar {
            let bar = sheet.scale_bar(inner);
            free.max.y = bar.top() - FIELD * line;
            if bar.right() + line > column {
                room.max.y = free.max.y - FIELD * line;
            }
        }
        let mut left_out = Vec::new();
        let mut has = |name: &'static str, room: Rect, lines: f32| {
            let has = room.height() >= lines * line;
            left_out.extend((!has).then_some(name));
            has
        };
        let mut beside = Vec::new();
        if self.north_arrow && no_north(shown.up).is_none() && has("the north arrow", room, ARROW) {
            let place = sheet.north_arrow(room);
            room.min.y = place.bottom() + line;
            beside.push(place);
        }
        if self.axes && edges == Vec2::ZERO && has("the axes", room, TRIAD) {
            let place = sheet.triad(room);
            room.max.y = place.top() - line;
            beside.push(place);
        }
        if self.legend && has("the legend", room, LEAST_LEGEND) {
            beside.extend(sheet.legend(inner, room));
        }
        for place in beside {
            free.max.x = free.max.x.min(place.left() - FIELD * line);
        }
        let [x, y] = [rect.width(), rect.height()];
        let parts = [
            (free.left() - rect.left()) / x,
            (rect.right() - free.right()) / x,
            (free.top() - rect.top()) / y,
            (rect.bottom() - free.bottom()) / y,
        ];
        let [left, right, top, bottom] = parts.map(|part| f64::from(part.clamp(0.0, 1.0)));
        Drawn { covered: Covered { left, right, top, bottom }, left_out }
    }
}

/// Annotations as they were drawn.
#[derive(Default)]
pub struct Drawn {
    /// Edges that they cover: the title's rows, those of the scale bar, and so on.
    pub covered: Covered,
    /// Names of those without room.
    pub left_out: Vec<&'static str>,
}

/// Adds a change of the texture.
fn take(overlay: &mut Overlay, delta: &ImageDelta) {
    let ImageData::Color(image) = &delta.image;
    let texels = image.pixels.iter().map(|pixel| pixel.to_array());
    match delta.pos {
        None => (overlay.texture_size, overlay.texture) = (image.size, texels.collect()),
        Some([left, top]) => {
            for (i, texel) in texels.enumerate() {
                let [x, y] = [left + i % image.size[0], top + i / image.size[0]];
                overlay.texture[y * overlay.texture_size[0] + x] = texel;
            }
        }
    }
}

/// Returns a place of this size at the right, halfway up if there is room.
fn beside(inner: Rect, room: Rect, size: Vec2) -> Rect {
    let top = (inner.center().y - size.y / 2.0).min(room.bottom() - size.y).max(room.top());
    Rect::from_min_size(pos2(inner.right() - size.x, top), size)
}

/// Where annotations are drawn.
struct Sheet<'s> {
    painter: &'s Painter,
    rect: Rect,
    /// Height of a line of text.
    line: f32,
    view: &'s View,
    shown: &'s Shown,
}

impl Sheet<'_> {
    /// Draws text, with a dark field behind it if `backed`. Returns its place.
    fn text(&self, at: Pos2, align: Align2, text: &str, size: f32, backed: bool) -> Rect {
        let font = FontId::proportional(size);
        let galley = self.painter.layout_no_wrap(text.to_owned(), font, INK);
        let place = align.anchor_size(at, galley.size());
        if backed {
            self.field(place);
        }
        self.painter.galley(place.min, galley, INK);
        place
    }

    fn width_of(&self, text: &str) -> f32 {
        let font = FontId::proportional(self.line);
        self.painter.layout_no_wrap(text.to_owned(), font, INK).size().x
    }

    /// Draws the dark field behind a place.
    fn field(&self, place: Rect) {
        self.painter.rect_filled(place.expand(FIELD * self.line), 0.3 * self.line, BEHIND);
    }

    fn stroke(&self) -> Stroke {
        Stroke::new(0.12 * self.line, INK)
    }

    /// Returns how much larger the rectangle is than the picture in pixels.
    fn enlarged(&self) -> f64 {
        (self.rect.width() / self.view.whole[0] as f32) as f64
    }

    /// Returns the depth of the points in the middle of the picture: halfway through their bounds,
    /// along the ray through the middle, or of the middle of the bounds where that ray misses them.
    /// None if that is behind the camera, or there are no points.
    fn depth(&self) -> Option<f64> {
        let [low, high] = self.shown.bounds?;
        let (eye, forward) = (self.view.camera.eye, self.view.basis.forward);
        let (enters, leaves) = (0..3).fold((0.0, f64::INFINITY), |(enters, leaves), axis| {
            let [a, b] = [low, high].map(|corner| (corner[axis] - eye[axis]) / forward[axis]);
            (a.min(b).max(enters), a.max(b).min(leaves))
        });
        let depth = match enters <= leaves {
            true => (enters + leaves) / 2.0,
            false => ((low + high) / 2.0 - eye).dot(forward),
        };
        Some(depth).filter(|depth| *depth > 0.0 && depth.is_finite())
    }

    /// Draws a bar of a round length; of a perspective view, at the depth of the points in its
    /// middle. Returns its place.
    fn scale_bar(&self, inner: Rect) -> Rect {
        let projection = self.view.camera.projection;
        let depth = match projection {
            Projection::Orthographic => Some(1.0),
            Projection::Perspective => self.depth(),
        };
        let Some(depth) = depth else {
            let at = inner.left_bottom();
            return self.text(at, Align2::LEFT_BOTTOM, "no points ahead", self.line, true);
        };
        let per_unit = self.enlarged() * self.view.focal_px() / depth;
        let length = round_below(0.25 * inner.width() as f64 / per_unit);
        let unit = self.shown.reference.unit();
        let unit = unit.symbol();
        let label = format!("{} {unit}", number(length, length));
        let middle = format!("{label} in the middle");
        let away = format!("{middle}, {} {unit} away", number(depth, round_below(depth / 10.0)));
        // Leaves out what has no room.
        let fits = |label: &String| self.width_of(label) <= inner.width();
        let label = match projection {
            Projection::Orthographic => label,
            Projection::Perspective => [away, middle].into_iter().find(fits).unwrap_or(label),
        };
        let (width, line) = ((length * per_unit) as f32, self.line);
        let whole = vec2(width.max(self.width_of(&label)), 1.7 * line);
        let place = Rect::from_min_size(pos2(inner.left(), inner.bottom() - whole.y), whole);
        self.field(place);
        self.text(place.left_top(), Align2::LEFT_TOP, &label, line, false);
        let [left, right] = [place.left_bottom(), place.left_bottom() + vec2(width, 0.0)];
        let tick = vec2(0.0, -0.4 * line);
        for [from, to] in [[left, right], [left, left + tick], [right, right + tick]] {
            self.painter.line_segment([from, to], self.stroke());
        }
        place
    }

    /// Draws an arrow towards north, as the picture shows it, at the top right. Returns its place.
    fn north_arrow(&self, inner: Rect) -> Rect {
        let (basis, line) = (&self.view.basis, self.line);
        let seen = vec2(basis.right.y as f32, -basis.up.y as f32);
        let way = if seen.length() < 1e-3 { vec2(0.0, -1.0) } else { seen.normalized() };
        let place = Rect::from_min_size(
            pos2(inner.right() - ARROW * line, inner.top()),
            Vec2::splat(ARROW * line),
        );
        self.field(place);
        // Seen from aside it is shorter.
        let reach = line * seen.length().clamp(0.5, 1.0);
        let (tip, aside) = (place.center() + way * 1.1 * reach, vec2(-way.y, way.x) * 0.5 * line);
        let tail = place.center() - way * 1.6 * reach;
        let notch = place.center() - way * 1.1 * reach;
        for side in [1.0, -1.0] {
            let shape = vec![tip, tail + aside * side, notch];
            let fill = if side > 0.0 { INK } else { Color32::from_gray(120) };
            self.painter.add(Shape::convex_polygon(shape, fill, Stroke::NONE));
        }
        self.text(tip + way * 0.6 * line, Align2::CENTER_CENTER, "N", 0.9 * line, false);
        place
    }

    /// Draws the ramp with round values, or the labels that occur, at the right. Returns its place,
    /// if there is one.
    fn legend(&self, inner: Rect, room: Rect) -> Option<Rect> {
        let Shown { attribute, reference, counts, stations, .. } = self.shown;
        Some(match Legend::of(attribute, reference, counts, stations)? {
            Legend::Ramp { heading, ends, shown } => self.ramp(inner, room, &heading, ends, &shown),
            Legend::Labels(rows) => self.labels(inner, room, &rows),
        })
    }

    fn ramp(
        &self,
        inner: Rect,
        room: Rect,
        heading: &str,
        ends: [f64; 2],
        shown: &DisplayAttribute,
    ) -> Rect {
        let line = self.line;
        let height = (14.0 * line).min(room.height());
        let ticks = legend::ticks(ends, f64::from(6.0 * height / (14.0 * line)));
        let widest = ticks.iter().map(|(_, label)| self.width_of(label)).fold(0.0, f32::max);
        let width = (2.4 * line + widest).max(self.width_of(heading));
        let place = beside(inner, room, vec2(width, height));
        self.field(place);
        self.text(place.left_top(), Align2::LEFT_TOP, heading, line, false);
        let bar = Rect::from_min_max(
            place.left_top() + vec2(0.0, 1.8 * line),
            pos2(place.left() + 1.4 * line, place.bottom()),
        );
        for (part, [r, g, b]) in (0..).zip(legend::colors(shown, PARTS)) {
            let y = |part: u32| bar.bottom() - bar.height() * part as f32 / PARTS as f32;
            let part =
                Rect::from_min_max(pos2(bar.left(), y(part + 1)), pos2(bar.right(), y(part)));
            self.painter.rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
        }
        for (share, label) in ticks {
            let at = pos2(bar.right(), bar.bottom() - bar.height() * share as f32);
            self.painter.line_segment([at, at + vec2(0.5 * line, 0.0)], self.stroke());
            self.text(at + vec2(0.9 * line, 0.0), Align2::LEFT_CENTER, &label, line, false);
        }
        place
    }

    fn labels(&self, inner: Rect, room: Rect, rows: &[Row]) -> Rect {
        let line = self.line;
        let most = (room.height() / (1.3 * line)) as usize - 1;
        let (rows, left_out) = legend::most_frequent(rows, most);
        let mut texts: Vec<String> = rows.iter().map(|row| row.name.clone()).collect();
        if left_out > 0 {
            texts.push(format!("and {left_out} more"));
        }
        let widest = texts.iter().map(|text| self.width_of(text)).fold(0.0, f32::max);
        let size = vec2(1.5 * line + widest, 1.3 * line * texts.len() as f32);
        let place = beside(inner, room, size);
        self.field(place);
        for (k, text) in texts.iter().enumerate() {
            let at = place.left_top() + vec2(0.0, 1.3 * line * (k as f32 + 0.5));
            if let Some(Row { color: [r, g, b], .. }) = rows.get(k) {
                let square = Rect::from_center_size(at + vec2(0.5 * line, 0.0), Vec2::splat(line));
                self.painter.rect_filled(square, 0.0, Color32::from_rgb(*r, *g, *b));
            }
            self.text(at + vec2(1.5 * line, 0.0), Align2::LEFT_CENTER, text, line, false);
        }
        place
    }

    /// Draws coordinates along the left and the lower edge if the picture is a map or an elevation:
    /// without perspective, along an axis. Returns the room that they take; none if it is neither.
    fn axes(&self) -> Vec2 {
        let (view, line, rect) = (self.view, self.line, self.rect);
        let along = |way: DVec3| (0..3).find(|&axis| way[axis].abs() > 1.0 - 1e-9);
        let (Projection::Orthographic, Some(across), Some(upward)) =
            (view.camera.projection, along(view.basis.right), along(view.basis.up))
        else {
            return Vec2::ZERO;
        };
        let [width, height] = view.whole.map(f64::from);
        let reference = &self.shown.reference;
        // Labels are coordinates of the files.
        let [start, end] = [view.ray(0.0, height).0, view.ray(width, 0.0).0]
            .map(|corner| reference.in_files(corner.truncate()).extend(corner.z));
        let is_angle = |axis: usize| reference.has_angles() && axis < 2;
        let ticks = |axis: usize| {
            // Axes of one unit have the same step.
            let same = [across, upward].into_iter().filter(|own| is_angle(*own) == is_angle(axis));
            let step =
                round_above(same.map(|own| (end - start)[own].abs()).fold(0.0, f64::max) / 8.0);
            let (from, to) = (start[axis], end[axis]);
            multiples(step, [from.min(to), from.max(to)])
                .into_iter()
                .map(move |tick| (((tick - from) / (to - from)) as f32, number(tick, step)))
                .collect::<Vec<_>>()
        };
        let (right, up) = (ticks(across), ticks(upward));
        let widest = up.iter().map(|(_, label)| self.width_of(label)).fold(0.0, f32::max);
        let room = vec2(widest + 1.2 * line, 1.9 * line);
        let corner = pos2(rect.left() + room.x, rect.bottom() - room.y);
        let left = Rect::from_min_max(rect.left_top(), pos2(corner.x, rect.bottom()));
        let below = Rect::from_min_max(corner, rect.right_bottom());
        for field in [left, below] {
            self.painter.rect_filled(field, 0.0, BEHIND);
        }
        self.painter.line_segment([pos2(corner.x, rect.top()), corner], self.stroke());
        self.painter.line_segment([corner, pos2(rect.right(), corner.y)], self.stroke());
        for (share, label) in right {
            let at = pos2(rect.left() + share * rect.width(), corner.y);
            let half = self.width_of(&label) / 2.0;
            if at.x - half > corner.x && at.x + half < rect.right() {
                self.painter.line_segment([at, at + vec2(0.0, 0.4 * line)], self.stroke());
                self.text(at + vec2(0.0, 0.5 * line), Align2::CENTER_TOP, &label, line, false);
            }
        }
        for (share, label) in up {
            let at = pos2(corner.x, rect.bottom() - share * rect.height());
            if at.y + line < corner.y && at.y - line > rect.top() {
                self.painter.line_segment([at, at - vec2(0.4 * line, 0.0)], self.stroke());
                self.text(at - vec2(0.6 * line, 0.0), Align2::RIGHT_CENTER, &label, line, false);
            }
        }
        room
    }

    /// Draws the three axes as the picture shows them, at the lower right. Returns their place.
    fn triad(&self, inner: Rect) -> Rect {
        let (basis, line) = (&self.view.basis, self.line);
        let place = Rect::from_min_max(
            inner.right_bottom() - Vec2::splat(TRIAD * line),
            inner.right_bottom(),
        );
        self.field(place);
        let colors = [[235, 90, 80], [110, 200, 90], [90, 150, 250]];
        let mut arms: Vec<(f64, Vec2, usize)> = (0..3)
            .map(|axis| {
                let way = DVec3::AXES[axis];
                let seen = vec2(way.dot(basis.right) as f32, -way.dot(basis.up) as f32);
                (way.dot(basis.forward), seen, axis)
            })
            .collect();
        // The farthest first.
        arms.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, seen, axis) in arms {
            let [r, g, b] = colors[axis];
            let stroke = Stroke::new(0.2 * line, Color32::from_rgb(r, g, b));
            let tip = place.center() + seen * 1.7 * line;
            self.painter.line_segment([place.center(), tip], stroke);
            let name = ["x", "y", "z"][axis];
            self.text(tip + seen * 0.6 * line, Align2::CENTER_CENTER, name, line, false);
        }
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::attribute::Attribute;
    use crate::passes::encode::Channels;
    use crate::view::{Camera, Preset};

    #[test]
    fn steps_are_round_and_labels_as_precise_as_they() {
        assert_eq!([0.3, 1.0, 4.9, 5.0, 99.0].map(round_below), [0.2, 1.0, 2.0, 5.0, 50.0]);
        assert_eq!([0.3, 1.0, 4.9, 5.1, 99.0].map(round_above), [0.5, 1.0, 5.0, 10.0, 100.0]);
        assert_eq!(multiples(20.0, [-25.0, 41.0]), [-20.0, 0.0, 20.0, 40.0]);
        assert_eq!([number(0.25, 0.05), number(1200.0, 200.0)], ["0.25", "1200"]);
    }

    fn shown(attribute: Attribute) -> Shown {
        Shown {
            attribute: DisplayAttribute::indexed(attribute, [0.0, 100.0], [0, 65_535]),
            reference: Reference::default(),
            up: Up::Z,
            bounds: Some([DVec3::ZERO, DVec3::new(80.0, 50.0, 30.0)]),
            counts: Histograms {
                classes: (0..40).map(|class| (class, 10 + class as u64)).collect(),
                returns: Vec::new(),
            },
            stations: Vec::new(),
        }
    }

    /// Returns the picture's pixels that annotations change.
    fn changed(annotations: &Annotations, size: [u32; 2], preset: Preset) -> Vec<[u32; 2]> {
        let points = [DVec3::ZERO, DVec3::new(80.0, 50.0, 30.0)];
        let view = View::new(Camera::framing(preset, &points, size), size).unwrap();
        let overlay = annotations.overlay(&view, &shown(Attribute::Elevation));
        let mut pixels = vec![128; 3 * (size[0] * size[1]) as usize];
        overlay.blend(&mut pixels, Channels::Rgb, size[0] as usize, 0);
        let changed = pixels.as_chunks::<3>().0.iter().enumerate();
        changed
            .filter(|(_, pixel)| **pixel != [128; 3])
            .map(|(i, _)| [i as u32 % size[0], i as u32 / size[0]])
            .collect()
    }

    /// Annotations of a window are drawn beside its panel.
    #[test]
    fn nothing_is_drawn_outside_of_the_rectangle() {
        let all = Annotations {
            title: Some("Title".into()),
            legend: true,
            scale_bar: true,
            north_arrow: true,
            axes: true,
        };
        let own = shown(Attribute::Elevation);
        let points = [DVec3::ZERO, DVec3::new(80.0, 50.0, 30.0)];
        for preset in [Preset::Fit, Preset::Top] {
            let view = View::new(Camera::framing(preset, &points, [440, 480]), [440, 480]).unwrap();
            let rect = Rect::from_min_size(pos2(200.0, 0.0), vec2(440.0, 480.0));
            let context = Context::default();
            let output = context.run_ui(RawInput::default(), |ui| {
                let painter = ui.ctx().layer_painter(LayerId::background());
                all.draw(&painter, rect, &view, &own);
            });
            let drawn: Vec<Pos2> = context
                .tessellate(output.shapes, 1.0)
                .into_iter()
                .filter_map(|clipped| match clipped.primitive {
                    Primitive::Mesh(mesh) => Some(mesh.vertices),
                    Primitive::Callback(_) => None,
                })
                .flat_map(|vertices| vertices.into_iter().map(|vertex| vertex.pos))
                .collect();
            // Edges are feathered by a pixel.
            assert!(!drawn.is_empty() && drawn.iter().all(|at| rect.expand(1.0).contains(*at)));
        }
    }

    /// A click moves the target only.
    #[test]
    fn the_scale_bar_follows_the_view_and_not_what_it_turns_about() {
        let (size, own) = ([640, 480], shown(Attribute::Elevation));
        let bar = Annotations { scale_bar: true, ..Annotations::default() };
        let camera = Camera {
            eye: DVec3::new(40.0, -100.0, 15.0),
            target: DVec3::new(40.0, 0.0, 15.0),
            projection: Projection::Perspective,
            ..Camera::framing(Preset::Fit, &[], size)
        };
        let label = |camera: Camera| {
            let view = View::new(camera, size).unwrap();
            bar.overlay(&view, &own).triangles.iter().flatten().map(|corner| corner.at).collect()
        };
        let here: Vec<[f32; 2]> = label(camera);
        assert_eq!(here, label(Camera { target: DVec3::new(40.0, 30.0, 15.0), ..camera }));
        assert_ne!(here, label(Camera { eye: DVec3::new(40.0, -400.0, 15.0), ..camera }));
        let depth = |camera: Camera| {
            let (painter, view) = (painter(), View::new(camera, size).unwrap());
            let rect = Rect::EVERYTHING;
            let sheet = Sheet { painter: &painter, rect, line: 9.0, view: &view, shown: &own };
            sheet.depth()
        };
        assert_eq!(depth(camera), Some(125.0));
        // Beside the points, their middle counts; from within, halfway out; behind, nothing.
        let aside = DVec3::new(0.0, 0.0, 500.0);
        let above = Camera { eye: camera.eye + aside, target: camera.target + aside, ..camera };
        assert_eq!(depth(above), Some(125.0));
        assert_eq!(
            depth(Camera {
                eye: DVec3::new(40.0, 10.0, 15.0),
                target: DVec3::new(40.0, 20.0, 15.0),
                ..camera
            }),
            Some(20.0)
        );
        assert_eq!(depth(Camera { target: DVec3::new(40.0, -200.0, 15.0), ..camera }), None);
    }

    fn painter() -> Painter {
        Context::default().layer_painter(LayerId::background())
    }

    #[test]
    fn what_is_asked_for_is_drawn_at_its_place_and_grows_with_the_picture() {
        let all = Annotations {
            title: Some("Title".into()),
            legend: true,
            scale_bar: true,
            north_arrow: true,
            axes: true,
        };
        assert!(changed(&Annotations::default(), [64, 64], Preset::Fit).is_empty());
        let one = |change: fn(&mut Annotations, &Annotations)| {
            let mut one = Annotations::default();
            change(&mut one, &all);
            changed(&one, [640, 480], Preset::Fit)
        };
        let all_at = |pixels: &[[u32; 2]], within: fn(&[u32; 2]) -> bool| {
            assert!(pixels.len() > 500 && pixels.iter().all(within), "{}", pixels.len());
        };
        all_at(&one(|own, all| own.title.clone_from(&all.title)), |at| at[1] < 60);
        all_at(&one(|own, _| own.legend = true), |at| at[0] > 400);
        all_at(&one(|own, _| own.scale_bar = true), |at| at[0] < 300 && at[1] > 400);
        all_at(&one(|own, _| own.north_arrow = true), |at| at[0] > 500 && at[1] < 100);
        all_at(&one(|own, _| own.axes = true), |at| at[0] > 500 && at[1] > 350);
        // A map has its coordinates along two edges.
        let axes = Annotations { axes: true, ..Annotations::default() };
        let map = changed(&axes, [640, 480], Preset::Top);
        assert!(map.contains(&[1, 1]) && map.contains(&[638, 478]) && !map.contains(&[400, 200]));
        let shares = [[640, 480], [1280, 960]]
            .map(|size| changed(&all, size, Preset::Fit).len() as f64 / (size[0] * size[1]) as f64);
        assert!((shares[0] / shares[1] - 1.0).abs() < 0.5, "{shares:?}");
        // What has no room is left out, and named.
        let note = |size: [u32; 2]| {
            let view = View::new(Camera::framing(Preset::Fit, &[], size), size).unwrap();
            all.note(&view, &shown(Attribute::Elevation))
        };
        assert_eq!(note([640, 480]), None);
        let small = note([200, 100]).unwrap();
        assert!(small.starts_with("200x100 ") && small.contains("the legend"), "{small}");
    }

    #[test]
    fn a_legend_of_many_labels_names_the_most_frequent() {
        let size = [640, 480];
        let view = View::new(Camera::framing(Preset::Fit, &[], size), size).unwrap();
        let legend = Annotations { legend: true, ..Annotations::default() };
        let overlay = legend.overlay(&view, &shown(Attribute::Class));
        assert!(!overlay.triangles.is_empty());
        let colors = legend.overlay(&view, &shown(Attribute::Rgb));
        assert!(colors.triangles.is_empty());
    }
}
