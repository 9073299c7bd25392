//! Animation: flying with held keys, and playing a camera path.
//!
//! Every frame that starts requests the next step, so there are as many steps as frames.

use super::App;
use super::navigation::{Direction, Input};
use std::time::{Duration, Instant};

/// Duration of a flight's first step, before any frame time is known.
const FIRST_STEP: Duration = Duration::from_millis(16);

/// Longest step, even if a frame took longer.
const LONGEST_STEP: Duration = Duration::from_millis(200);

/// Time to the next step if the camera did not move, as at a rest of a path: then no frame requests
/// it.
const STANDING: Duration = Duration::from_millis(16);

/// Clock of flights and of the camera path.
pub(super) struct Animation {
    pub last_step: Instant,
    /// Time of the next step if no frame requests it.
    pub next_step: Option<Instant>,
    /// Time on the camera path.
    pub path_time: Duration,
}

impl Animation {
    pub fn new(now: Instant) -> Animation {
        Animation { last_step: now, next_step: None, path_time: Duration::ZERO }
    }
}

impl App {
    pub(super) fn fly(&mut self, direction: Direction, pressed: bool) {
        let flew = self.navigation.is_flying();
        self.navigate(Input::Fly { direction, pressed });
        if !flew && self.navigation.is_flying() {
            self.animation.last_step = Instant::now();
            self.step(FIRST_STEP);
        }
    }

    /// Starts or stops playing the camera path.
    pub(super) fn play(&mut self) {
        self.ui.plays = !self.ui.plays && !self.ui.path.keys.is_empty();
        if self.ui.plays {
            self.animation.path_time = Duration::ZERO;
            self.animation.last_step = Instant::now();
            self.step(Duration::ZERO);
        }
    }

    /// Advances the camera by the time since the last step.
    pub(super) fn move_on(&mut self) {
        self.animation.next_step = None;
        if self.ui.plays || self.navigation.is_flying() {
            let by = self.animation.last_step.elapsed().min(LONGEST_STEP);
            self.animation.last_step = Instant::now();
            self.step(by);
        }
    }

    fn step(&mut self, by: Duration) {
        let before = self.navigation.camera;
        if self.ui.plays {
            self.animation.path_time += by;
            let camera = self.ui.path.camera(self.animation.path_time.as_secs_f64());
            // Between two keys, eye and target may coincide.
            if self.viewport.view(camera).is_ok() {
                self.navigation.camera = camera;
            }
            if self.animation.path_time.as_secs_f64() >= self.ui.path.duration() {
                // A scripted flight repeats the path until its time is over.
                (self.ui.plays, self.animation.path_time) = (self.flight.is_some(), Duration::ZERO);
            }
        } else {
            self.navigation.advance(by.as_secs_f64());
        }
        match self.navigation.camera == before {
            true => self.animation.next_step = Some(Instant::now() + STANDING),
            false => self.post_scene(),
        }
    }
}
