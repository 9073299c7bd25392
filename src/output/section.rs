//! Profiles as pictures: the points of a slab over distance and height, with axes.
//!
//! The nearest point of a pixel is seen: that farthest to the right of the way from the start to
//! the end. So pictures do not depend on the order of the points, and take memory by their size
//! only.

use super::legend::{self, Legend};
use super::ticks::{multiples, number, round_above, round_below};
use crate::cloud::crs::Reference;
use glam::DVec2;
use std::fmt::Write;

/// A point of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SectionPoint {
    /// Distance from the start along the slab, and to its left `[m]`.
    pub place: DVec2,
    pub height: f64,
    pub color: [u8; 3],
}

/// What a picture of a profile shows, and how large.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Distance at the right `[m]`.
    pub length: f64,
    /// Heights at the bottom and top `[m]`.
    pub heights: [f64; 2],
    /// Size of the field of points `[px]`.
    pub size: DVec2,
    /// How much larger heights are drawn than distances.
    pub exaggeration: f64,
    /// Symbols of the units of distances and heights.
    pub units: [String; 2],
}

/// Share of a profile's heights above and below them.
const MARGIN: f64 = 0.02;

/// Least height of a picture, as a share of its width.
const FLATTEST: f64 = 0.05;

impl Axes {
    /// Returns the largest axes within a size that show these heights. Without an exaggeration, a
    /// round one is chosen, 1 or more.
    pub fn fitting(
        length: f64,
        [lo, hi]: [f64; 2],
        exaggeration: Option<f64>,
        most: DVec2,
        reference: &Reference,
    ) -> Axes {
        let scale = reference.height_scale();
        // At least some height, and a small margin.
        let tall = ((hi - lo) * (1.0 + 2.0 * MARGIN)).max(1e-3 * length / scale);
        let filling = (most.y / (tall * scale)) / (most.x / length);
        let exaggeration = exaggeration.unwrap_or_else(|| round_below(filling).clamp(1.0, 100.0));
        // Pixels a unit of distance, and of height.
        let along = (most.x / length).min(most.y / (exaggeration * tall * scale));
        let up = along * exaggeration * scale;
        let height = (tall * up).max((FLATTEST * most.x).min(most.y)).round();
        let half = 0.5 * height / up;
        let middle = 0.5 * (lo + hi);
        Axes {
            length,
            heights: [middle - half, middle + half],
            size: DVec2::new((length * along).round().max(1.0), height.max(1.0)),
            exaggeration,
            units: [reference.unit(), reference.height_unit()]
                .map(|unit| unit.symbol().to_string()),
        }
    }

    /// Returns where a distance and a height are `[px]`, from the top left.
    pub fn place(&self, distance: f64, height: f64) -> DVec2 {
        let [lo, hi] = self.heights;
        self.size * DVec2::new(distance / self.length, (hi - height) / (hi - lo))
    }

    /// Returns the ticks of distances and of heights, each with its label, so far apart `[px]` at
    /// least.
    pub fn ticks(&self, apart: DVec2) -> [Vec<(f64, String)>; 2] {
        let ticks = |range: [f64; 2], pixels: f64, apart: f64| {
            let length = range[1] - range[0];
            // At least one step is within the axis.
            let step = round_above(length * apart / pixels).min(round_below(length));
            let labelled = |tick: f64| (tick, number(tick + 0.0, step));
            multiples(step, range).into_iter().map(labelled).collect()
        };
        [ticks([0.0, self.length], self.size.x, apart.x), ticks(self.heights, self.size.y, apart.y)]
    }

    /// Describes the exaggeration as a ratio.
    pub fn ratio(&self) -> String {
        let factor = (100.0 * self.exaggeration).round() / 100.0;
        format!("heights : distances = {factor} : 1")
    }
}

/// Usual size of a picture of a file `[px]`.
pub const SIZE: [u32; 2] = [1600, 800];

/// Returns what axes leave of a picture of this size `[px]`.
pub fn room(size: [u32; 2]) -> DVec2 {
    let [left, top, right, bottom] = AROUND;
    DVec2::from_array(size.map(f64::from)) - DVec2::new(left + right, top + bottom)
}

/// Returns the sides of points on a canvas: larger where there are few `[px]`.
pub fn side(axes: &Axes, points: u64) -> usize {
    let apart = (axes.size.x * axes.size.y / points as f64).sqrt();
    (FINER as f64 * (0.5 * apart).clamp(1.0, 4.0)).round() as usize
}

/// Pixels of a canvas beside one of the picture, so that points have smooth edges.
pub const FINER: usize = 2;

/// The points of a picture.
pub struct Canvas {
    size: [usize; 2],
    /// Nearness and colour of the nearest point of each pixel; the least of all points.
    keys: Vec<u64>,
}

/// No point.
const EMPTY: u64 = u64::MAX;

impl Canvas {
    pub fn new(axes: &Axes) -> Canvas {
        let size = axes.size.to_array().map(|side| FINER * side as usize);
        Canvas { size, keys: vec![EMPTY; size[0] * size[1]] }
    }

    /// Draws a point as a square of this side `[px of the canvas]`.
    pub fn draw(&mut self, axes: &Axes, point: &SectionPoint, side: usize) {
        let at = FINER as f64 * axes.place(point.place.x, point.height);
        let [r, g, b] = point.color.map(u64::from);
        let left = (point.place.y as f32).to_bits();
        let near = if left >> 31 == 1 { !left } else { left | 1 << 31 };
        let key = (near as u64) << 32 | r << 16 | g << 8 | b;
        let [columns, rows] = [0, 1].map(|axis| {
            let from = (at[axis] - 0.5 * side as f64).round().max(0.0) as usize;
            from.min(self.size[axis])..(from + side).min(self.size[axis])
        });
        for y in rows {
            for x in columns.clone() {
                let kept = &mut self.keys[y * self.size[0] + x];
                *kept = key.min(*kept);
            }
        }
    }

    pub fn size(&self) -> [u32; 2] {
        self.size.map(|side| side as u32)
    }

    /// Returns red, green, blue and opacity of each pixel, row by row from the top.
    pub fn rgba(&self) -> Vec<u8> {
        let pixel = |&key: &u64| match key {
            EMPTY => [0; 4],
            key => [(key >> 16) as u8, (key >> 8) as u8, key as u8, 255],
        };
        self.keys.iter().flat_map(pixel).collect()
    }

    fn png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let [width, height] = self.size();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&self.rgba()))
            .expect("a PNG in memory");
        bytes
    }
}

/// Height of letters in a picture of a file `[px]`, and the place of axes around the points: left,
/// top, right, bottom.
pub const LETTERS: f64 = 15.0;
pub const AROUND: [f64; 4] = [96.0, 48.0, 32.0, 64.0];

/// Height of a row of labels in a picture of a file `[px]`.
const ROW: f64 = 1.4 * LETTERS;
/// Greatest and least height of a ramp `[px]`, and colours in it.
const RAMP: [f64; 2] = [200.0, 60.0];
const PARTS: u32 = 64;
/// Height of a ramp's heading `[px]`.
const HEADING: f64 = 1.8 * LETTERS;
/// Distance of a legend from the points `[px]`.
const BESIDE: f64 = 24.0;

/// Returns the width of a text at most `[px]`: fonts are those of the program that shows it, and
/// few letters are wider.
fn wide(text: &str) -> f64 {
    0.62 * LETTERS * text.chars().count() as f64
}

/// A legend in a picture of a file.
#[derive(Clone, Debug)]
pub struct Beside {
    legend: Legend,
    /// Room that it takes at the right of the points `[px]`.
    width: f64,
    /// Height of the ramp, or of all rows `[px]`.
    height: f64,
}

impl Beside {
    /// Returns a legend that fits into a size beside points, which take half the width at least;
    /// `None` if there is no room.
    pub fn fitting(legend: Legend, room: DVec2) -> Option<Beside> {
        let widest = |texts: &mut dyn Iterator<Item = &str>| texts.map(wide).fold(0.0, f64::max);
        let (wanted, least, width) = match &legend {
            Legend::Ramp { heading, ends, .. } => {
                let ticks = legend::ticks(*ends, 6.0);
                let labels = widest(&mut ticks.iter().map(|(_, label)| &label[..]));
                let width = wide(heading).max(2.4 * LETTERS + labels);
                (HEADING + RAMP[0], HEADING + RAMP[1], width)
            }
            Legend::Labels(rows) => {
                let names = widest(&mut rows.iter().map(|row| &row.name[..]));
                let width = 1.5 * LETTERS + names.max(wide("and 99 more"));
                let rows = rows.len().min(legend::ROWS) + 1;
                (ROW * rows as f64, ROW * rows.min(3) as f64, width)
            }
        };
        let (width, height) = (BESIDE + width, wanted.min(room.y));
        (height >= least && width <= 0.5 * room.x).then_some(Beside { legend, width, height })
    }

    pub fn width(&self) -> f64 {
        self.width
    }
}

/// Returns a legend as SVG, with its top left corner at a place.
fn svg_legend(Beside { legend, height, .. }: &Beside, [x, y]: [f64; 2]) -> String {
    let mut out = String::new();
    let mut write = |words: std::fmt::Arguments| {
        // Never fails, since it writes to memory.
        let _ = writeln!(out, "{words}");
    };
    let hex = |[r, g, b]: [u8; 3]| format!("#{r:02x}{g:02x}{b:02x}");
    match legend {
        Legend::Ramp { heading, ends, shown } => {
            let (top, ramp) = (y + HEADING, height - HEADING);
            let part = ramp / f64::from(PARTS);
            write(format_args!(r#"<text x="{x}" y="{}">{}</text>"#, y + LETTERS, escaped(heading)));
            for (k, color) in (1..).zip(legend::colors(shown, PARTS)) {
                // Each reaches below the next, so that no seam is between them.
                write(format_args!(
                    r#"<rect x="{x}" y="{:.2}" width="{}" height="{:.2}" fill="{}"/>"#,
                    top + ramp - part * f64::from(k),
                    1.4 * LETTERS,
                    part * f64::from(k.min(2)),
                    hex(color)
                ));
            }
            for (share, label) in legend::ticks(*ends, 6.0 * ramp / RAMP[0]) {
                let (x, y) = (x + 1.4 * LETTERS, top + ramp * (1.0 - share));
                write(format_args!(
                    r##"<path d="M{x} {y:.1}h6" stroke="#22262b"/><text x="{}" y="{y:.1}" dy="0.35em">{label}</text>"##,
                    x + 10.0
                ));
            }
        }
        Legend::Labels(rows) => {
            let (rows, left_out) = legend::most_frequent(rows, (height / ROW) as usize - 1);
            for (k, row) in rows.iter().enumerate() {
                let y = y + ROW * k as f64;
                write(format_args!(
                    r#"<rect x="{x}" y="{y:.1}" width="{LETTERS}" height="{LETTERS}" fill="{}"/><text x="{}" y="{:.1}" dy="0.35em">{}</text>"#,
                    hex(row.color),
                    x + 1.5 * LETTERS,
                    y + 0.5 * LETTERS,
                    escaped(&row.name)
                ));
            }
            if left_out > 0 {
                let y = y + ROW * rows.len() as f64 + 0.5 * LETTERS;
                let x = x + 1.5 * LETTERS;
                write(format_args!(
                    r#"<text x="{x}" y="{y:.1}" dy="0.35em">and {left_out} more</text>"#
                ));
            }
        }
    }
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// Returns a picture as SVG: axes and their names, around the points, and a legend at their
/// right. A narrow profile gets room for its words, up to a width `[px]`; of titles, which come
/// from the longest on, and of the words below, it has the first that fits.
pub fn svg(
    axes: &Axes,
    titles: &[String],
    points: &Canvas,
    legend: Option<&Beside>,
    widest: f64,
) -> String {
    let [left, top, right, bottom] = AROUND;
    let DVec2 { x: width, y: height } = axes.size;
    let (low, end) = (top + height, left + width);
    let [aside, tall] = legend.map_or([0.0; 2], |own| [own.width, own.height]);
    let fitting = |texts: &[String]| {
        texts.iter().find(|text| left + wide(text) <= widest).cloned().unwrap_or_default()
    };
    let distance = format!("distance [{}]", axes.units[0]);
    let across = fitting(&[format!("{distance}; {}", axes.ratio()), distance]);
    let title = fitting(titles);
    let words = left + wide(&title).max(wide(&across));
    // A legend may reach below the axes of a flat profile.
    let whole = [(end + aside + right).max(words), (low + bottom).max(top + tall)];
    let title = escaped(&title);
    let mut out = format!(
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="{}" height="{}" viewBox="0 0 {0} {1}" font-family="Helvetica, Arial, sans-serif" font-size="{LETTERS}" fill="#22262b">
<rect width="100%" height="100%" fill="#ffffff"/>
<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="#dde1e4"/>
<text x="{left}" y="{}" font-weight="bold">{title}</text>
"##,
        whole[0],
        whole[1],
        top - 30.0 + LETTERS,
    );
    let [distances, heights] = axes.ticks(DVec2::new(90.0, 36.0));
    let mut write = |words: std::fmt::Arguments| {
        // Never fails, since it writes to memory.
        let _ = writeln!(out, "{words}");
    };
    for (tick, label) in distances {
        let x = left + axes.place(tick, 0.0).x;
        write(format_args!(
            r##"<path d="M{x:.1} {low}v6M{x:.1} {top}v{height}" stroke="#6b727a" stroke-opacity="0.5"/><text x="{x:.1}" y="{}" text-anchor="middle">{label}</text>"##,
            low + 8.0 + LETTERS
        ));
    }
    for (tick, label) in heights {
        let y = top + axes.place(0.0, tick).y;
        write(format_args!(
            r##"<path d="M{left} {y:.1}h-6M{left} {y:.1}h{width}" stroke="#6b727a" stroke-opacity="0.5"/><text x="{}" y="{y:.1}" dy="0.35em" text-anchor="end">{label}</text>"##,
            left - 10.0
        ));
    }
    write(format_args!(
        r##"<image x="{left}" y="{top}" width="{width}" height="{height}" preserveAspectRatio="none" href="data:image/png;base64,{}"/>"##,
        base64(&points.png())
    ));
    write(format_args!(
        r##"<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#22262b"/>
<text x="{left}" y="{}">{across}</text>
<text transform="translate(22 {}) rotate(-90)" text-anchor="middle">height [{}]</text>
{}</svg>"##,
        low + bottom - 8.0,
        top + 0.5 * height,
        axes.units[1],
        legend.map_or(String::new(), |legend| svg_legend(legend, [end + BESIDE, top])),
    ));
    out
}

/// Returns bytes as base64 (RFC 4648).
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |i: usize| three.get(i).map_or(0, |&byte| byte as u32);
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i > three.len() { '=' } else { digit as char });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_has_the_words_of_its_standard() {
        let words = ["", "f", "fo", "foo", "foobar"].map(|word| base64(word.as_bytes()));
        assert_eq!(words, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYmFy"]);
    }

    #[test]
    fn axes_keep_their_exaggeration_and_stay_within_their_size() {
        let most = DVec2::new(1600.0, 800.0);
        for (length, heights, asked) in [
            (100.0, [5.0, 25.0], None),
            (100.0, [5.0, 25.0], Some(1.0)),
            (3.0, [0.0, 250.0], None),
            (1000.0, [7.0, 7.0], None),
            (1000.0, [7.0, 9.0], Some(20.0)),
        ] {
            let axes = Axes::fitting(length, heights, asked, most, &Reference::default());
            assert!(axes.size.cmple(most).all() && axes.exaggeration >= 1.0, "{axes:?}");
            assert!(asked.is_none_or(|asked| asked == axes.exaggeration), "{axes:?}");
            let [lo, hi] = axes.heights;
            assert!(lo <= heights[0] && hi >= heights[1], "{axes:?}");
            let drawn = (axes.size.y / (hi - lo)) / (axes.size.x / length);
            assert!((drawn / axes.exaggeration - 1.0).abs() < 0.2, "{drawn} {axes:?}");
        }
    }

    #[test]
    fn the_nearest_point_of_a_pixel_is_seen_in_any_order() {
        let axes = Axes::fitting(
            10.0,
            [0.0, 5.0],
            Some(1.0),
            DVec2::new(100.0, 100.0),
            &Reference::default(),
        );
        let point = |left: f64, color: [u8; 3]| SectionPoint {
            place: DVec2::new(5.0, left),
            height: 2.5,
            color,
        };
        let points = [point(0.2, [9; 3]), point(-0.3, [1, 2, 3]), point(0.0, [7; 3])];
        let drawn = [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|order| {
            let mut canvas = Canvas::new(&axes);
            order.iter().for_each(|&i| canvas.draw(&axes, &points[i], 2));
            canvas.rgba()
        });
        assert!(drawn.iter().all(|rgba| *rgba == drawn[0]));
        let seen: Vec<&[u8]> = drawn[0].chunks(4).filter(|pixel| pixel[3] > 0).collect();
        assert_eq!(seen, [[1, 2, 3, 255]; 4]);
    }
}
