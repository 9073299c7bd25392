//! Profiles: the points between two picked places, as a picture of heights over distance and as
//! CSV.

use super::actions::Action;
use super::measure;
use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::colormap;
use crate::cloud::crs::Reference;
use crate::output::section::{self, SectionPoint};
use crate::resident::slab_query::{SlabPoint, SlabPoints};
use crate::select::slab::Slab;
use egui::{Color32, ColorImage, RichText, TextureHandle, TextureOptions, Ui, Vec2};
use glam::DVec2;

/// Size of the picture `[px]`.
const SIZE: [usize; 2] = [520, 220];

/// Default width of a profile, as a share of its length.
pub const SHARE: f64 = 0.02;

/// Least height of a profile's picture, as a share of its length.
const FLATTEST: f64 = 0.02;

/// A section as it is shown.
pub struct Profile {
    pub slab: Slab,
    section: SlabPoints,
    shown: DisplayAttribute,
    /// Heights at the bottom and top of the picture.
    heights: [f64; 2],
    /// Texture of the picture, made when first shown.
    texture: Option<TextureHandle>,
}

impl Profile {
    pub fn new(slab: Slab, section: SlabPoints, shown: DisplayAttribute) -> Profile {
        let heights = || section.points.iter().map(|found| found.point.position.z);
        let (lo, hi) =
            (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        // A small margin, and at least some height.
        let middle = if lo <= hi { (lo + hi) / 2.0 } else { 0.0 };
        let half = (0.52 * (hi - lo)).max(FLATTEST * slab.length / 2.0).max(f64::MIN_POSITIVE);
        Profile { slab, section, shown, heights: [middle - half, middle + half], texture: None }
    }

    /// Returns how much larger the picture draws heights than distances.
    fn raised(&self, reference: &Reference) -> f64 {
        let [lo, hi] = self.heights;
        let height = (hi - lo) * reference.height_scale();
        (SIZE[1] as f64 / height) / (SIZE[0] as f64 / self.slab.length)
    }

    fn pixel(&self, found: &SlabPoint) -> [usize; 2] {
        let [lo, hi] = self.heights;
        let at =
            DVec2::new(found.place.x / self.slab.length, (hi - found.point.position.z) / (hi - lo));
        [0, 1].map(|axis| ((at[axis] * SIZE[axis] as f64) as usize).min(SIZE[axis] - 1))
    }

    /// Draws every point as a pixel; the last one of a pixel wins.
    fn image(&self) -> ColorImage {
        let mut image = ColorImage::filled(SIZE, Color32::from_gray(8));
        for found in &self.section.points {
            let [r, g, b] = colormap::color_of(&self.shown, found.shown);
            image[self.pixel(found).into()] = Color32::from_rgb(r, g, b);
        }
        image
    }

    /// Returns a CSV table with a line per point: its place in the profile, its place in the world,
    /// and their unit.
    pub fn csv(&self, reference: &Reference) -> String {
        let line = |found: &SlabPoint| {
            let point = SectionPoint {
                place: found.place,
                position: found.point.position,
                labels: measure::kind(&found.point),
                color: colormap::color_of(&self.shown, found.shown),
            };
            section::line(&point, reference)
        };
        std::iter::once(section::head("station"))
            .chain(self.section.points.iter().map(line))
            .collect()
    }

    /// Drops the texture, whose device is lost.
    pub fn forget_texture(&mut self) {
        self.texture = None;
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
        let image = self.texture.is_none().then(|| self.image());
        let texture = self.texture.get_or_insert_with(|| {
            ui.ctx().load_texture("profile", image.unwrap_or_default(), TextureOptions::NEAREST)
        });
        let size = Vec2::new(SIZE[0] as f32, SIZE[1] as f32);
        let shown = ui.add(egui::Image::new((texture.id(), size)));
        let [lo, hi] = self.heights;
        let here = shown.hover_pos().map(|at| (at - shown.rect.min) / size);
        let here = here.map(|at| (at.x as f64 * self.slab.length, hi - at.y as f64 * (hi - lo)));
        ui.label(match here {
            Some((distance, height)) => {
                let (unit, high) = (reference.unit(), reference.height_unit());
                format!("distance {}, height {}", unit.length(distance, 3), high.length(height, 3))
            }
            None => format!(
                "heights {lo:.2} to {hi:.2} {}, exaggerated {:.2} times",
                reference.height_unit().symbol(),
                self.raised(reference)
            ),
        });
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
