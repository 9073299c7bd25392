//! Colours of the panel, and its style.

use egui::{Color32, Context, Visuals};

/// Behind the panel, the windows beside it, and lists.
pub const FILL: Color32 = Color32::from_gray(27);
/// Behind buttons.
pub const BUTTON: Color32 = Color32::from_gray(52);
/// Behind fields of text.
pub const FIELD: Color32 = Color32::from_gray(12);
/// Behind what is chosen.
pub const CHOSEN: Color32 = Color32::from_rgb(0, 84, 120);

pub const TEXT: Color32 = Color32::from_gray(210);
/// Colour of what is chosen, or pointed at.
pub const STRONG: Color32 = Color32::WHITE;
/// Colour of what is less important.
pub const WEAK: Color32 = Color32::from_gray(158);
/// Colour of effects that run.
pub const RUNS: Color32 = Color32::LIGHT_GREEN;
pub const NOTE: Color32 = Color32::LIGHT_YELLOW;
pub const ERROR: Color32 = Color32::LIGHT_RED;
/// Colour of work in progress.
pub const BUSY: Color32 = Color32::LIGHT_BLUE;

/// Sets colours, and spacing.
pub fn set(context: &Context) {
    let mut visuals = Visuals::dark();
    (visuals.panel_fill, visuals.window_fill) = (FILL, FILL);
    visuals.extreme_bg_color = FIELD;
    visuals.weak_text_color = Some(WEAK);
    visuals.selection.bg_fill = CHOSEN;
    visuals.selection.stroke.color = STRONG;
    let widgets = &mut visuals.widgets;
    widgets.noninteractive.fg_stroke.color = TEXT;
    widgets.inactive.fg_stroke.color = TEXT;
    (widgets.inactive.bg_fill, widgets.inactive.weak_bg_fill) = (BUTTON, BUTTON);
    context.set_theme(egui::Theme::Dark);
    context.set_visuals_of(egui::Theme::Dark, visuals);
    context.all_styles_mut(|style| {
        // What comes and goes under a moving cursor is not read.
        style.interaction.tooltip_delay = 0.3;
        // Each step of an animation is another picture, and what moves is no answer yet.
        style.animation_time = 0.0;
        style.spacing.item_spacing = egui::vec2(6.0, 4.0);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the relative luminance of WCAG 2.1.
    fn luminance(color: Color32) -> f64 {
        let linear = |channel: u8| {
            let c = channel as f64 / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        let [r, g, b, _] = color.to_array();
        0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
    }

    fn contrast(a: Color32, b: Color32) -> f64 {
        let [a, b] = [luminance(a) + 0.05, luminance(b) + 0.05];
        a.max(b) / a.min(b)
    }

    /// WCAG 2.1, level AA, asks for 4.5 between text and what is behind it.
    #[test]
    fn text_has_the_contrast_of_wcag_aa() {
        assert!((contrast(Color32::BLACK, Color32::WHITE) - 21.0).abs() < 1e-9);
        let on_fill = [TEXT, STRONG, WEAK, RUNS, NOTE, ERROR, BUSY].map(|text| (text, FILL));
        let on_others = [(TEXT, BUTTON), (STRONG, BUTTON), (TEXT, FIELD), (STRONG, CHOSEN)];
        for (text, behind) in on_fill.into_iter().chain(on_others) {
            let contrast = contrast(text, behind);
            assert!(contrast >= 4.5, "{text:?} on {behind:?}: {contrast:.2}");
        }
    }

    /// What widgets show is what the constants say.
    #[test]
    fn widgets_have_the_colours_of_the_palette() {
        let context = Context::default();
        set(&context);
        let visuals = context.global_style().visuals.clone();
        let widgets = &visuals.widgets;
        for state in [widgets.noninteractive, widgets.inactive, widgets.hovered, widgets.active] {
            let contrast = contrast(state.fg_stroke.color, state.weak_bg_fill);
            assert!(contrast >= 4.5, "{state:?}: {contrast:.2}");
        }
        assert!(contrast(visuals.selection.stroke.color, visuals.selection.bg_fill) >= 4.5);
        assert!(contrast(visuals.weak_text_color(), visuals.window_fill) >= 4.5);
    }
}
