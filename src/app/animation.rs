//! WHAT MOVES BY ITSELF: keys that are held, and a camera path that is played. Every picture that begins asks for the next step, so that there are as many as the device draws.

use super::App;
use super::navigation::{Direction, Input};
use crate::view::View;
use std::time::{Duration, Instant};

/// What a flight's first step takes, before a picture has said how long pictures take.
const FIRST_STEP: Duration = Duration::from_millis(16);

/// A picture that took longer does not fly further than one that took as long.
const LONGEST_STEP: Duration = Duration::from_millis(200);

/// Where a step leads nowhere, as at a rest of a path, no picture asks for the next one, but this time does.
const STANDING: Duration = Duration::from_millis(16);

impl App {
    pub(super) fn fly(&mut self, direction: Direction, pressed: bool) {
        let flew = self.navigation.is_flying();
        self.navigate(Input::Fly { direction, pressed });
        if !flew && self.navigation.is_flying() {
            self.moved = Instant::now();
            self.step(FIRST_STEP);
        }
    }

    /// From the first key of the path to the last, or no longer.
    pub(super) fn play(&mut self) {
        self.ui.plays = !self.ui.plays && !self.ui.path.keys.is_empty();
        if self.ui.plays {
            self.played = Duration::ZERO;
            self.moved = Instant::now();
            self.step(Duration::ZERO);
        }
    }

    /// As far as the time since the last step goes.
    pub(super) fn move_on(&mut self) {
        self.moves = None;
        if self.ui.plays || self.navigation.is_flying() {
            let by = self.moved.elapsed().min(LONGEST_STEP);
            self.moved = Instant::now();
            self.step(by);
        }
    }

    fn step(&mut self, by: Duration) {
        let before = self.navigation.camera;
        if self.ui.plays {
            self.played += by;
            let camera = self.ui.path.camera(self.played.as_secs_f64());
            // Between two keys the eye may meet what it looks at.
            if View::new(camera, self.size()).is_ok() {
                self.navigation.camera = camera;
            }
            if self.played.as_secs_f64() >= self.ui.path.duration() {
                // A flight without hands ends by its own time, and begins the path again until then.
                (self.ui.plays, self.played) = (self.flight.is_some(), Duration::ZERO);
            }
        } else {
            self.navigation.advance(by.as_secs_f64());
        }
        match self.navigation.camera == before {
            true => self.moves = Some(Instant::now() + STANDING),
            false => self.post_scene(),
        }
    }
}
