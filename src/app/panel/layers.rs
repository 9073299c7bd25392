//! Which points are drawn: a tree of files, stations, classes and returns, and clip boxes.

use super::state::UiState;
use super::{detail, filters, ramp, text, theme};
use crate::app::actions::Action;
use crate::app::clip_box_widget;
use crate::app::load_thread::Categories;
use crate::cloud::Station;
use crate::cloud::attribute::{Attribute, class_name};
use crate::cloud::filter::grouped;
use crate::render::scene::Scene;
use crate::select::opacity::{Opacities, Rule, What};
use crate::view::View;
use egui::collapsing_header::{CollapsingState, paint_default_icon};
use egui::{Align, Color32, Layout, RichText, Sense, Stroke, Ui, pos2, vec2};

pub fn show(
    ui: &mut Ui,
    state: &mut UiState,
    view: Option<&View>,
    scene: &mut Scene,
    actions: &mut Vec<Action>,
) {
    // Before the tree, which has fewer rows when they leave fewer kinds of points.
    filters::show(ui, state, &mut scene.filter);
    ui.separator();
    for branch in tree(state) {
        branch.show(ui, &mut scene.opacities, true);
    }
    ui.separator();
    let mut added = false;
    clip_box_widget::list(ui, &mut scene.clips, &mut added);
    if added {
        actions.push(Action::AddBox);
    }
    detail::show(ui, state, view, &mut scene.lod);
}

/// A row of the tree, and what is below it.
struct Branch {
    /// The points that its eye hides; None: a title without an eye.
    what: Option<What>,
    name: String,
    points: u64,
    /// Colour of its points, if they have one.
    swatch: Option<(Attribute, u8)>,
    below: Vec<Branch>,
    /// Initial state: true if what is below is shown.
    is_open: bool,
}

/// Returns the tree: files with their stations, then classes and returns if there are several.
fn tree(state: &UiState) -> Vec<Branch> {
    let Categories { classes, returns, stations, .. } = &state.categories;
    let is_shown = |attribute| state.shown.is_some_and(|shown| shown.attribute == attribute);
    let swatch = |attribute, number| is_shown(attribute).then_some((attribute, number));
    let station = |Station { name, source, points, .. }: &Station, file: &str| Branch {
        what: Some(What::Station(name.clone())),
        name: name.strip_prefix(file).map_or(name.as_str(), str::trim_start).into(),
        points: *points,
        // Colours are of the lower byte of the source.
        swatch: swatch(Attribute::Source, source.unwrap_or(0) as u8),
        below: Vec::new(),
        is_open: false,
    };
    let file = |name: &String| {
        let what = What::File(name.clone());
        let own: Vec<&Station> = stations.iter().filter(|station| what.has(station)).collect();
        let below: Vec<Branch> = own.iter().map(|own| station(own, name)).collect();
        Branch {
            what: Some(what),
            name: name.clone(),
            points: own.iter().map(|station| station.points).sum(),
            swatch: if let [one] = &below[..] { one.swatch } else { None },
            below: if below.len() > 1 { below } else { Vec::new() },
            is_open: is_shown(Attribute::Source),
        }
    };
    let of_kind = |title: &str,
                   attribute,
                   kinds: &[(u8, u64)],
                   what: fn(u8) -> What,
                   name: fn(u8) -> String| {
        let below = kinds.iter().map(|&(number, points)| Branch {
            what: Some(what(number)),
            name: name(number),
            points,
            swatch: swatch(attribute, number),
            below: Vec::new(),
            is_open: false,
        });
        (kinds.len() > 1).then(|| Branch {
            what: None,
            name: title.into(),
            points: kinds.iter().map(|(_, points)| points).sum(),
            swatch: None,
            below: below.collect(),
            is_open: is_shown(attribute) || attribute == Attribute::Class,
        })
    };
    let files = state.files.iter().map(file).filter(|file| file.points > 0);
    // Scans with names of their own, as in E57, are of no file by name.
    let is_of_a_file =
        |station: &Station| state.files.iter().any(|name| What::File(name.clone()).has(station));
    let others = stations.iter().filter(|own| !is_of_a_file(own)).map(|own| station(own, ""));
    let mut all: Vec<Branch> = files.chain(others).collect();
    all.extend(of_kind("classes", Attribute::Class, classes, What::Class, |number| {
        class_name(number).map_or(number.to_string(), |name| format!("{number} {name}"))
    }));
    all.extend(of_kind("returns", Attribute::Return, returns, What::Return, |number| {
        number.to_string()
    }));
    all
}

impl Branch {
    /// Shows the row, and what is below it unless that is folded. `is_drawn`: nothing above hides
    /// it.
    fn show(self, ui: &mut Ui, opacities: &mut Opacities, is_drawn: bool) {
        let Branch { what, name, points, swatch, below, is_open } = self;
        let id = ui.make_persistent_id(("layer", &name));
        let mut folded = CollapsingState::load_with_default_open(ui.ctx(), id, is_open);
        let mut drawn = what.as_ref().is_none_or(|what| !hides(opacities, what));
        let row = ui.horizontal(|ui| {
            match below.is_empty() {
                false => drop(folded.show_toggle_button(ui, paint_default_icon)),
                true => {
                    drop(ui.allocate_exact_size(vec2(ui.spacing().indent, 0.0), Sense::hover()))
                }
            }
            if let Some(what) = what
                && eye(ui, drawn).on_hover_text("show or hide").clicked()
            {
                drawn = !drawn;
                opacities.0.retain(|rule| !(rule.what == what && rule.opacity == 0.0));
                if !drawn {
                    opacities.0.push(Rule { what, opacity: 0.0 });
                }
            }
            if let Some((attribute, number)) = swatch {
                ramp::swatch(ui, attribute, number);
            }
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                ui.label(RichText::new(grouped(points)).color(theme::WEAK));
                ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                    let color = if drawn && is_drawn { theme::TEXT } else { theme::WEAK };
                    text::line(ui, RichText::new(name).color(color));
                });
            });
        });
        folded.show_body_indented(&row.response, ui, |ui| {
            below.into_iter().for_each(|branch| branch.show(ui, opacities, drawn && is_drawn));
        });
    }
}

fn hides(opacities: &Opacities, what: &What) -> bool {
    opacities.0.iter().any(|rule| rule.what == *what && rule.opacity == 0.0)
}

/// An eye to click on, open or closed.
fn eye(ui: &mut Ui, is_open: bool) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(vec2(16.0, 16.0), Sense::click());
    let color = match (response.hovered(), is_open) {
        (true, _) => theme::STRONG,
        (false, true) => theme::TEXT,
        (false, false) => theme::WEAK,
    };
    let (middle, stroke) = (rect.center(), Stroke::new(1.3, color));
    /// Half of the width and of the height of an eye `[points]`.
    const HALF: [f32; 2] = [7.0, 4.5];
    let lid = |up: f32| -> Vec<_> {
        let at = |k: i32| {
            let x = k as f32 / 8.0;
            pos2(middle.x + HALF[0] * x, middle.y - up * HALF[1] * (1.0 - x * x))
        };
        (-8..=8).map(at).collect()
    };
    ui.painter().line(lid(-1.0), stroke);
    if is_open {
        ui.painter().line(lid(1.0), stroke);
        ui.painter().circle(middle, 2.2, color, Stroke::new(0.0, Color32::TRANSPARENT));
    } else {
        for x in [-4.0, 0.0, 4.0] {
            let from = pos2(middle.x + x, middle.y + if x == 0.0 { 4.5 } else { 3.2 });
            ui.painter().line_segment([from, from + vec2(0.3 * x, 2.6)], stroke);
        }
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_their_stations_and_single_kinds_are_left_out() {
        let station =
            |part, source, name: &str, points| Station { part, source, name: name.into(), points };
        let stations = vec![
            station(0, Some(3), "a.las source 3", 5),
            station(0, Some(7), "a.las source 7", 6),
            station(1, None, "b.ply", 9),
            station(2, None, "north", 4),
        ];
        let categories = Categories {
            classes: vec![(2, 15), (6, 5)],
            returns: vec![(1, 20)],
            stations,
            ..Categories::default()
        };
        let files = ["a.las", "b.ply", "c.e57"].map(str::to_string).into();
        let state = UiState { files, categories, ..UiState::default() };
        let rows = |branches: &[Branch]| -> Vec<(String, u64, usize)> {
            let row = |branch: &Branch| (branch.name.clone(), branch.points, branch.below.len());
            branches.iter().map(row).collect()
        };
        let tree = tree(&state);
        let row = |name: &str, points, below| (name.to_string(), points, below);
        assert_eq!(
            rows(&tree),
            [row("a.las", 11, 2), row("b.ply", 9, 0), row("north", 4, 0), row("classes", 20, 2)]
        );
        assert_eq!(rows(&tree[0].below), [row("source 3", 5, 0), row("source 7", 6, 0)]);
        assert_eq!(rows(&tree[3].below), [row("2 ground", 15, 0), row("6 building", 5, 0)]);
        assert_eq!(tree[0].below[1].what, Some(What::Station("a.las source 7".into())));
    }
}
