//! Level of detail of an index: what is drawn and loaded, and its limits.

use super::state::UiState;
use super::text::weak;
use crate::app::render_thread::Loading;
use crate::cloud::filter::grouped;
use crate::select::lod::LodOptions;
use crate::view::View;
use egui::{DragValue, Ui};

/// Shows how much of an index is drawn and loaded, and edits the level of detail.
pub fn show(ui: &mut Ui, state: &UiState, view: Option<&View>, options: &mut LodOptions) {
    let (
        Some(Loading {
            fitting, nodes, awaited, largest_error_px, pool_bytes: [pool, used], ..
        }),
        Some(view),
    ) = (state.loading, view)
    else {
        return;
    };
    let reading = if awaited > 0 {
        format!("{awaited} of {nodes} nodes loading")
    } else {
        format!("{nodes} nodes, all loaded")
    };
    let said = format!("index: {reading}, {:.1} MB read", state.bytes_read as f64 / 1e6);
    let fine = format!(
        "Largest projected error: {largest_error_px:.2} px. Pool: {} of at most {} MiB in use.",
        used >> 20,
        pool >> 20
    );
    ui.separator();
    ui.label(said).on_hover_text(fine);
    let asked = options.of(view.size);
    let (mut most, mut lod) = (asked.budget, asked.lod_px);
    ui.horizontal(|ui| {
        if ui
            .add(
                DragValue::new(&mut most)
                    .range(1_000..=u32::MAX as u64)
                    .clamp_existing_to_range(false)
                    .speed(10_000.0)
                    .suffix(" points at most"),
            )
            .changed()
        {
            options.budget = Some(most);
        }
        if ui
            .add(
                DragValue::new(&mut lod)
                    .range(0.0..=64.0)
                    .clamp_existing_to_range(false)
                    .speed(0.02)
                    .max_decimals(2)
                    .suffix(" px apart"),
            )
            .changed()
        {
            options.lod_px = Some(lod);
        }
        if *options != LodOptions::default() && ui.small_button("auto").clicked() {
            *options = LodOptions::default();
        }
    });
    if let Some(fitting) = fitting {
        weak(ui, format!("{} points fit the device's memory", grouped(fitting)));
    }
}
