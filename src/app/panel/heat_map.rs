//! The error of the last moving picture against the one at rest, as colours over that.

use super::state::Pace;
use crate::tune::error::MOST_PX;
use egui::{Color32, ColorImage, Mesh, Pos2, Rect, TextureOptions, Ui, pos2, vec2};

/// Largest side of a texture `[px]`, as far as egui knows of the device.
const MOST_SIDE: usize = 2048;
/// Height of the bar that names colours `[points]`.
const BAR: f32 = 6.0;
/// Steps of the bar.
const STEPS: usize = 32;

/// Draws the map over the picture, if it is asked for and known.
pub fn show(ui: &Ui, pace: &mut Pace) {
    let (true, Some(measured)) = (pace.shows_errors, &pace.measured) else {
        pace.texture = None;
        return;
    };
    let context = ui.ctx();
    let texture = pace.texture.get_or_insert_with(|| {
        let image = image(measured.size.map(|side| side as usize), &measured.map);
        context.load_texture("errors", image, TextureOptions::NEAREST)
    });
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    let painter = context.layer_painter(egui::LayerId::background());
    painter.image(texture.id(), context.content_rect(), whole, Color32::WHITE);
}

/// Draws which colour is which error.
pub fn bar(ui: &mut Ui) {
    let (area, response) =
        ui.allocate_exact_size(vec2(ui.available_width(), BAR), egui::Sense::hover());
    let mut mesh = Mesh::default();
    for k in 0..=STEPS {
        let part = k as f32 / STEPS as f32;
        let x = area.left() + part * area.width();
        let fill = color(f64::from(part) * MOST_PX).to_opaque();
        mesh.colored_vertex(Pos2::new(x, area.top()), fill);
        mesh.colored_vertex(Pos2::new(x, area.bottom()), fill);
        if k > 0 {
            let last = 2 * k as u32;
            mesh.add_triangle(last - 2, last - 1, last);
            mesh.add_triangle(last - 1, last, last + 1);
        }
    }
    ui.painter().add(mesh);
    response.on_hover_text(format!("0 to {MOST_PX} px"));
}

/// Returns the map as an image. Pixels of images too large for a texture have the largest error of
/// several.
fn image([width, height]: [usize; 2], map: &[f32]) -> ColorImage {
    let many = width.max(height).div_ceil(MOST_SIDE).max(1);
    let size = [width.div_ceil(many), height.div_ceil(many)];
    let mut most = vec![0f32; size[0] * size[1]];
    for (i, px) in map.iter().enumerate() {
        let place = i / width / many * size[0] + i % width / many;
        most[place] = most[place].max(*px);
    }
    ColorImage::new(size, most.into_iter().map(|px| color(px.into())).collect())
}

/// Returns the colour of an error: from black over red and yellow to white. What has none only
/// darkens the picture.
fn color(px: f64) -> Color32 {
    let heat = |from: f64| (255.0 * (3.0 * px / MOST_PX - from).clamp(0.0, 1.0)) as u8;
    let [red, green, blue] = [0.0, 1.0, 2.0].map(heat);
    let opacity = if px > 0.0 { 230 } else { 140 };
    Color32::from_rgba_unmultiplied(red, green, blue, opacity)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_grow_with_the_error() {
        let sums = [0.0, 1.0, 2.0, 3.0, MOST_PX].map(|px| {
            let [red, green, blue, _] = color(px).to_array().map(u32::from);
            red + green + blue
        });
        assert!(sums.is_sorted_by(|a, b| a < b), "{sums:?}");
        assert_eq!((sums[0], color(MOST_PX).to_opaque()), (0, Color32::WHITE));
    }

    #[test]
    fn large_maps_keep_their_largest_errors() {
        let size = [2 * MOST_SIDE, 3];
        let mut map = vec![0.0; size[0] * size[1]];
        map[size[0] + 5] = 4.0;
        let image = image(size, &map);
        assert_eq!(image.size, [MOST_SIDE, 2]);
        let hot: Vec<usize> =
            (0..image.pixels.len()).filter(|i| image.pixels[*i] == color(4.0)).collect();
        assert_eq!(hot, [2]);
    }
}
