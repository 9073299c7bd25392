//! SVG charts: panels of error over time, log-log, on common axes.
//!
//! Every configuration is a labelled mark. Those on the front, which no other beats in both, are
//! filled and joined by a step line; the others are hollow. A ring marks the choice of `auto`.
//! Errors of exactly 0 have no logarithm: they lie on a line of their own below the axis. Colours
//! are from the set of Okabe and Ito, and no meaning depends on colour alone.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub struct Mark {
    pub label: String,
    /// Lower quartile, median, upper quartile.
    pub x: [f64; 3],
    pub y: f64,
    pub front: bool,
    pub auto: bool,
}

pub struct Panel {
    pub title: String,
    pub marks: Vec<Mark>,
}

pub struct Chart {
    /// Size of a panel's plot `[px]`.
    pub plot: [i32; 2],
    pub title: String,
    pub x_axis: String,
    pub y_axis: String,
    pub columns: usize,
    pub panels: Vec<Panel>,
}

const INK: RGBColor = RGBColor(0x22, 0x26, 0x2B);
const SOFT: RGBColor = RGBColor(0x6B, 0x72, 0x7A);
const GRID: RGBColor = RGBColor(0xE4, 0xE7, 0xEA);
const FRONT: RGBColor = RGBColor(0x00, 0x72, 0xB2);
const AUTO: RGBColor = RGBColor(0xD5, 0x5E, 0x00);

/// Size of the plot of a small panel `[px]`.
pub const SMALL: [i32; 2] = [286, 178];
/// Size of the plot of a chart that has one panel `[px]`.
pub const LARGE: [i32; 2] = [760, 420];
/// Sizes `[px]`: the space between panels, and the margins for axes and titles.
const GAP: [i32; 2] = [22, 44];
const LEFT: i32 = 92;
const TOP: i32 = 92;
const RIGHT: i32 = 24;
const BOTTOM: i32 = 56;
/// Height of the line of zeros above the bottom of the plot `[px]`.
const ZERO_LIFT: i32 = 14;
const LINE_HEIGHT: i32 = 14;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The axes of all panels, and the size of a plot `[px]`.
struct Scale {
    axes: [Axis; 2],
    plot: [i32; 2],
}

/// A logarithmic axis onto a range of pixels.
struct Axis {
    lo: f64,
    hi: f64,
}

impl Axis {
    /// Returns an axis around all positive values with some margin; one decade if there are none.
    fn around(values: impl Iterator<Item = f64>, air: f64) -> Axis {
        let (lo, hi) = values
            .filter(|v| *v > 0.0 && v.is_finite())
            .map(f64::log10)
            .fold((f64::MAX, f64::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)));
        if lo > hi { Axis { lo: -0.5, hi: 0.5 } } else { Axis { lo: lo - air, hi: hi + air } }
    }

    fn at(&self, value: f64, pixels: i32) -> i32 {
        ((value.log10() - self.lo) / (self.hi - self.lo) * pixels as f64).round() as i32
    }

    /// Returns round numbers: 1, 2 and 5 in each decade for few decades, else every power of ten,
    /// or every second or third.
    fn ticks(&self) -> Vec<f64> {
        let decades = self.hi - self.lo;
        let stride = (decades / 6.0).ceil().max(1.0) as i32;
        let steps: &[f64] = if decades < 2.2 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let powers = (self.lo.floor() as i32..=self.hi.ceil() as i32)
            .filter(|power| power.rem_euclid(stride) == 0);
        powers
            .flat_map(|power| steps.iter().map(move |step| step * 10f64.powi(power)))
            .filter(|tick| (self.lo..=self.hi).contains(&tick.log10()))
            .collect()
    }
}

/// Formats 0.5, 20, or a power of ten with a raised exponent.
fn number(value: f64) -> String {
    if (0.005..2000.0).contains(&value) {
        return format!("{}", (value * 1e6).round() / 1e6);
    }
    let power = value.log10().floor() as i32;
    let raised: String = power
        .to_string()
        .chars()
        .map(|c| {
            c.to_digit(10).map_or('⁻', |digit| {
                ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit as usize]
            })
        })
        .collect();
    let factor = (value / 10f64.powi(power)).round();
    if factor == 1.0 { format!("10{raised}") } else { format!("{factor}·10{raised}") }
}

fn text(size: i32, color: &'static RGBColor, bold: bool, h: HPos, v: VPos) -> TextStyle<'static> {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    TextStyle::from(FontDesc::new(
        FontFamily::Name("Helvetica, Arial, sans-serif"),
        size as f64,
        style,
    ))
    .color(color)
    .pos(Pos::new(h, v))
}

impl Chart {
    pub fn svg(&self) -> String {
        let columns = self.columns.min(self.panels.len()).max(1) as i32;
        let rows = self.panels.len().div_ceil(columns as usize).max(1) as i32;
        let size = [
            LEFT + columns * (self.plot[0] + GAP[0]) - GAP[0] + RIGHT,
            TOP + rows * (self.plot[1] + GAP[1]) - GAP[1] + BOTTOM,
        ];
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, (size[0] as u32, size[1] as u32))
                .into_drawing_area();
            // Writing into a string cannot fail.
            self.draw(&root, columns, size)
                .and_then(|()| root.present())
                .expect("an SVG in memory");
        }
        svg
    }

    fn draw(
        &self,
        root: &Area,
        columns: i32,
        size: [i32; 2],
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let marks = || self.panels.iter().flat_map(|panel| &panel.marks);
        let axes = [
            Axis::around(marks().flat_map(|mark| mark.x), 0.12),
            Axis::around(marks().map(|mark| mark.y), 0.5),
        ];
        let scale = Scale { axes, plot: self.plot };
        let zeros = marks().any(|mark| mark.y == 0.0);
        root.fill(&WHITE)?;
        root.draw_text(&self.title, &text(19, &INK, true, HPos::Left, VPos::Top), (LEFT, 14))?;
        self.legend(root, (LEFT, 50))?;
        let middle = (TOP + size[1] - BOTTOM) / 2;
        let upright =
            text(13, &INK, false, HPos::Center, VPos::Center).transform(FontTransform::Rotate270);
        root.draw_text(&self.y_axis, &upright, (20, middle))?;
        root.draw_text(
            &self.x_axis,
            &text(13, &INK, false, HPos::Center, VPos::Center),
            ((LEFT + size[0] - RIGHT) / 2, size[1] - 14),
        )?;
        for (i, panel) in self.panels.iter().enumerate() {
            let (column, row) = (i as i32 % columns, i as i32 / columns);
            let corner =
                (LEFT + column * (self.plot[0] + GAP[0]), TOP + row * (self.plot[1] + GAP[1]));
            let lowest = i + columns as usize >= self.panels.len();
            panel.grid(root, corner, &scale, zeros, [lowest, column == 0])?;
            panel.plot(root, corner, &scale)?;
        }
        Ok(())
    }

    /// Draws the legend.
    fn legend(
        &self,
        root: &Area,
        (x, y): (i32, i32),
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let style = text(12, &SOFT, false, HPos::Left, VPos::Center);
        let items = [
            ("on the front: nothing is both faster and more accurate", true, false, 0),
            ("beaten", false, false, 326),
            ("what auto does", true, true, 406),
        ];
        for (words, front, auto, shift) in items {
            symbol(root, (x + shift + 6, y), front, auto)?;
            root.draw_text(words, &style, (x + shift + 18, y))?;
        }
        Ok(())
    }
}

fn symbol(
    root: &Area,
    at: (i32, i32),
    front: bool,
    auto: bool,
) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
    if front {
        root.draw(&Circle::new(at, 4, FRONT.filled()))?;
    } else {
        root.draw(&Circle::new(at, 4, WHITE.filled()))?;
        root.draw(&Circle::new(at, 4, SOFT.stroke_width(2)))?;
    }
    if auto {
        root.draw(&Circle::new(at, 8, AUTO.stroke_width(2)))?;
    }
    Ok(())
}

impl Panel {
    fn grid(
        &self,
        root: &Area,
        (x, y): (i32, i32),
        scale: &Scale,
        zeros: bool,
        [below, beside]: [bool; 2],
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let (right, bottom) = (x + scale.plot[0], y + scale.plot[1]);
        root.draw_text(&self.title, &text(14, &INK, true, HPos::Left, VPos::Bottom), (x, y - 7))?;
        for tick in scale.axes[0].ticks() {
            let at = x + scale.axes[0].at(tick, scale.plot[0]);
            root.draw(&PathElement::new([(at, y), (at, bottom)], GRID))?;
            if below {
                root.draw_text(
                    &number(tick),
                    &text(12, &SOFT, false, HPos::Center, VPos::Top),
                    (at, bottom + 7),
                )?;
            }
        }
        let line = |at: i32, words: &str| {
            root.draw(&PathElement::new([(x, at), (right, at)], GRID))?;
            if beside {
                root.draw_text(
                    words,
                    &text(12, &SOFT, false, HPos::Right, VPos::Center),
                    (x - 8, at),
                )
            } else {
                Ok(())
            }
        };
        scale.axes[1]
            .ticks()
            .into_iter()
            .try_for_each(|tick| line(height(scale, tick, y), &number(tick)))?;
        if zeros {
            line(bottom - ZERO_LIFT, "exactly 0")?;
        }
        root.draw(&PathElement::new([(x, y), (x, bottom), (right, bottom)], SOFT))
    }

    fn plot(
        &self,
        root: &Area,
        (x, y): (i32, i32),
        scale: &Scale,
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let place = |mark: &Mark| {
            (x + scale.axes[0].at(mark.x[1], scale.plot[0]), height(scale, mark.y, y))
        };
        let mut front: Vec<(i32, i32)> =
            self.marks.iter().filter(|mark| mark.front).map(place).collect();
        front.sort_unstable();
        // Between two settings, nothing better than the slower one's error is known for less than
        // its time: a step, not a slope.
        let steps = front.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1), pair[1]]);
        root.draw(&PathElement::new(steps.collect::<Vec<_>>(), FRONT.mix(0.45).stroke_width(2)))?;
        for mark in &self.marks {
            let (_, at) = place(mark);
            let ends =
                [mark.x[0], mark.x[2]].map(|ms| (x + scale.axes[0].at(ms, scale.plot[0]), at));
            root.draw(&PathElement::new(ends, if mark.front { FRONT } else { SOFT }))?;
        }
        for mark in &self.marks {
            symbol(root, place(mark), mark.front, mark.auto)?;
        }
        // Labels stand right of marks and bars, pushed apart where marks are close, and left if
        // there is no room.
        let mut names: Vec<(&Mark, (i32, i32))> =
            self.marks.iter().map(|mark| (mark, place(mark))).collect();
        names.sort_by_key(|(_, at)| at.1);
        let lines = spread(
            &names.iter().map(|(_, at)| at.1).collect::<Vec<_>>(),
            y + 6,
            y + scale.plot[1] - 8,
        );
        for ((mark, at), line) in names.into_iter().zip(lines) {
            let ends = [mark.x[0], mark.x[2]].map(|ms| x + scale.axes[0].at(ms, scale.plot[0]));
            let right = (at.0 + 13).max(ends[1] + 7);
            let room = right + 7 * mark.label.len() as i32 <= x + scale.plot[0] + GAP[0] / 2;
            let (edge, side) = if room {
                (right, HPos::Left)
            } else {
                ((at.0 - 13).min(ends[0] - 7), HPos::Right)
            };
            let color = if mark.auto {
                &AUTO
            } else if mark.front {
                &INK
            } else {
                &SOFT
            };
            // White around the letters separates them from bars of other marks.
            for (dx, dy) in [(-2, 0), (2, 0), (0, -2), (0, 2)] {
                root.draw_text(
                    &mark.label,
                    &text(12, &WHITE, mark.auto, side, VPos::Center),
                    (edge + dx, line + dy),
                )?;
            }
            root.draw_text(
                &mark.label,
                &text(12, color, mark.auto, side, VPos::Center),
                (edge, line),
            )?;
        }
        Ok(())
    }
}

fn height(scale: &Scale, value: f64, top: i32) -> i32 {
    // Positive errors stay above the line of zeros.
    let room = scale.plot[1] - 2 * ZERO_LIFT;
    if value > 0.0 {
        top + room - scale.axes[1].at(value, room)
    } else {
        top + scale.plot[1] - ZERO_LIFT
    }
}

/// Moves sorted heights down as little as keeps lines apart, then up if they leave the plot.
fn spread(heights: &[i32], top: i32, bottom: i32) -> Vec<i32> {
    let mut placed: Vec<i32> = Vec::new();
    for &height in heights {
        let least = placed.last().map_or(top, |last| last + LINE_HEIGHT);
        placed.push(height.max(least));
    }
    let mut most = bottom;
    for height in placed.iter_mut().rev() {
        *height = (*height).min(most);
        most = *height - LINE_HEIGHT;
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_numbers_short() {
        assert_eq!(Axis { lo: 0.0, hi: 1.1 }.ticks(), [1.0, 2.0, 5.0, 10.0]);
        assert_eq!(Axis { lo: -3.2, hi: 0.5 }.ticks().len(), 4);
        assert_eq!([0.5, 20.0, 1e-7, 1e4].map(number), ["0.5", "20", "10⁻⁷", "10⁴"]);
    }

    #[test]
    fn names_never_overlap() {
        assert_eq!(spread(&[10, 11, 12, 80], 0, 90), [10, 24, 38, 80]);
        assert_eq!(spread(&[85, 86], 0, 90), [76, 90]);
    }
}
