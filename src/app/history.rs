//! Undo and redo: the scenes before and after each change.
//!
//! A drag and what is typed into one field are one step. The camera is no part of it.

use crate::render::scene::Scene;

/// Most steps that are kept.
const MOST: usize = 200;

#[derive(Default)]
pub struct History {
    past: Vec<Scene>,
    future: Vec<Scene>,
    /// State of the last step: true while more of it may follow.
    is_open: bool,
}

/// Tests whether two scenes are the same but for their cameras.
pub fn same(a: &Scene, b: &Scene) -> bool {
    *a == Scene { camera: a.camera, ..b.clone() }
}

impl History {
    /// Records a change, if there is one. `continues`: more of the same step may follow.
    pub fn record(&mut self, before: &Scene, after: &Scene, continues: bool) {
        let changed = !same(before, after);
        if changed {
            if !self.is_open {
                self.past.push(before.clone());
                self.past.drain(..self.past.len().saturating_sub(MOST));
            }
            self.future.clear();
        }
        self.is_open = continues && (self.is_open || changed);
    }

    /// Returns the scene before the last change; None if there is none.
    pub fn undo(&mut self, now: &Scene) -> Option<Scene> {
        Self::step(&mut self.past, &mut self.future, now)
    }

    /// Returns the scene after the change undone last; None if there is none.
    pub fn redo(&mut self, now: &Scene) -> Option<Scene> {
        Self::step(&mut self.future, &mut self.past, now)
    }

    /// Returns the numbers of steps that can be undone, and redone.
    pub fn steps(&self) -> [usize; 2] {
        [self.past.len(), self.future.len()]
    }

    fn step(from: &mut Vec<Scene>, to: &mut Vec<Scene>, now: &Scene) -> Option<Scene> {
        let scene = from.pop()?;
        to.push(now.clone());
        Some(Scene { camera: now.camera, ..scene })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::color_scale::ColorScale;
    use crate::cloud::filter::Filter;
    use crate::render::annotations::Annotations;
    use crate::render::settings::RenderSettings;
    use crate::select::clip::Clips;
    use crate::select::lod::LodOptions;
    use crate::select::opacity::Opacities;
    use crate::view::{Camera, Preset};
    use glam::DVec3;

    fn scene(red: u8, height: f64) -> Scene {
        let corners = [DVec3::ZERO, DVec3::new(1.0, 1.0, height)];
        Scene {
            camera: Camera::framing(Preset::Top, &corners, [4, 3]),
            color: None,
            settings: RenderSettings { background: [red, 0, 0], ..RenderSettings::default() },
            scale: ColorScale::default(),
            opacities: Opacities::default(),
            filter: Filter::default(),
            clips: Clips::default(),
            lod: LodOptions::default(),
            annotations: Annotations::default(),
        }
    }

    #[test]
    fn undo_and_redo_step_through_changes_and_keep_the_camera() {
        let mut history = History::default();
        history.record(&scene(1, 1.0), &scene(2, 1.0), false);
        history.record(&scene(2, 1.0), &scene(2, 9.0), false);
        history.record(&scene(2, 1.0), &scene(3, 1.0), false);
        assert_eq!(history.steps(), [2, 0]);
        let now = scene(3, 5.0);
        let undone = history.undo(&now).unwrap();
        assert_eq!(undone, scene(2, 5.0));
        assert_eq!(history.undo(&undone).unwrap(), scene(1, 5.0));
        assert!(history.undo(&scene(1, 5.0)).is_none());
        assert_eq!(history.redo(&scene(1, 5.0)).unwrap(), scene(2, 5.0));
        // A change ends what could be redone.
        history.record(&scene(2, 5.0), &scene(7, 5.0), false);
        assert_eq!(history.steps(), [2, 0]);
    }

    #[test]
    fn a_drag_is_one_step() {
        let mut history = History::default();
        history.record(&scene(1, 1.0), &scene(1, 1.0), true);
        history.record(&scene(1, 1.0), &scene(2, 1.0), true);
        history.record(&scene(2, 1.0), &scene(2, 1.0), true);
        history.record(&scene(2, 1.0), &scene(3, 1.0), true);
        history.record(&scene(3, 1.0), &scene(4, 1.0), false);
        history.record(&scene(4, 1.0), &scene(5, 1.0), false);
        assert_eq!(history.undo(&scene(5, 1.0)).unwrap(), scene(4, 1.0));
        assert_eq!(history.undo(&scene(4, 1.0)).unwrap(), scene(1, 1.0));
    }
}
