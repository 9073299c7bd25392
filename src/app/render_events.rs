//! RENDER THREAD -> WINDOW: what the picture shows, and how long it took.

use super::measure::Picked;
use super::navigation::Direction;
use super::render_thread::{FrameReport, RenderEvent};
use super::scripted_flight::Step;
use super::{App, print_line};
use crate::resident::Point;
use std::time::{Duration, Instant};
use winit::event_loop::ActiveEventLoop;

/// Pictures come faster than anybody reads.
const BETWEEN: Duration = Duration::from_millis(100);

impl App {
    pub(super) fn render_event(&mut self, events: &ActiveEventLoop, event: RenderEvent) {
        match event {
            // The picture is not there yet, so there is nothing to say.
            RenderEvent::FrameStarted => return self.move_on(),
            RenderEvent::FrameDone(drawn) => return self.drawn(*drawn),
            RenderEvent::Counted(points) => (self.ui.drawn, self.ui.at_most) = (points, false),
            RenderEvent::Uploaded(info, token) => self.uploaded(*info, &token),
            RenderEvent::Picked { point, adds } => self.picked(point, adds),
            RenderEvent::PickLater { at, adds } => self.picks_later = Some((at, adds)),
            RenderEvent::Profile(profile) => {
                print_line(&profile.says(&self.ui.measure.reference));
                (self.ui.profile, self.ui.error) = (Some(*profile), None);
            }
            RenderEvent::Status(text) => self.ui.doing = Some(text),
            RenderEvent::Saved(path) => {
                self.ui.doing = Some(format!("saved {}", path.display()));
                self.pending_saves.retain(|pending_saves| *pending_saves != path);
            }
            RenderEvent::SaveFailed(path, error) => {
                self.ui.doing = None;
                self.pending_saves.retain(|pending_saves| *pending_saves != path);
                self.report_error(&error);
            }
            // What goes wrong with every picture is read once.
            RenderEvent::Failed(error)
                if self.ui.dismissed_error.as_ref() == Some(&error.to_string()) => {}
            RenderEvent::Failed(error) => self.report_error(&error),
            RenderEvent::UploadFailed(error, token) if !token.is_cancelled() => {
                self.upload_failed(&error)
            }
            RenderEvent::UploadFailed(..) => {}
            RenderEvent::Ended(error) => {
                if let Err(error) = self.rebuild(error) {
                    self.ended = Some(error);
                    events.exit();
                }
            }
        }
        self.title();
    }

    pub(super) fn drawn(&mut self, drawn: FrameReport) {
        // Nothing more comes, of the cloud or of the picture.
        let rests = drawn.whole
            && !self.loading
            && self.render_thread.as_ref().is_some_and(|thread| thread.is_newest(drawn.handled));
        self.stats.drawn(&drawn, rests);
        let step =
            self.flight.as_mut().and_then(|flight| flight.drawn(&drawn, rests, Instant::now()));
        self.pick_buffer = Some(drawn.pick_buffer);
        if let Some((at, adds)) = self.picks_later.take() {
            self.pick(at, adds);
        }
        (self.ui.drawn, self.ui.at_most) = (drawn.statistics.points_drawn, drawn.leaves_out);
        self.ui.loading = drawn.loading;
        self.ui.bytes_read += drawn.loading.map_or(0, |loading| loading.bytes_read);
        (self.ui.latency, self.ui.took) = (drawn.latency, drawn.took);
        self.ui.passes = drawn.passes;
        (self.ui.decided, self.ui.picture_notes) = (drawn.decided, drawn.notes);
        match step {
            Some(Step::Start) if !self.ui.path.keys.is_empty() => self.play(),
            Some(Step::Start) => self.fly(Direction::Forward, true),
            Some(Step::Stop) => {
                self.ui.plays = false;
                self.fly(Direction::Forward, false);
            }
            None => {}
        }
        self.says_later();
    }

    /// What the panel says of pictures need not change with every one of them; what lies over the picture moves with it.
    fn says_later(&mut self) {
        if !self.ui.measure.points.is_empty() || self.scene.clips.active() > 0 {
            return self.ask_for_panel();
        }
        let soon = Instant::now() + BETWEEN;
        self.panel_due = Some(self.panel_due.map_or(soon, |when| when.min(soon)));
    }

    pub(super) fn picked(&mut self, point: Point, adds: bool) {
        if !adds {
            self.forget();
        }
        self.ui.measure.points.push(Picked::new(point));
        print_line(&self.ui.measure.to_string());
        self.look_up(&point);
    }

    /// Says what is open and what is going on.
    pub(super) fn title(&mut self) {
        let Some(window) = &self.window else { return };
        let file = self
            .files
            .first()
            .and_then(|file| file.file_name())
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default();
        let more = if self.files.len() > 1 {
            format!(" and {} more", self.files.len() - 1)
        } else {
            String::new()
        };
        self.ui.title = format!("{file}{more}");
        let parts =
            [Some(self.ui.title.clone()), self.ui.doing.clone(), Some("pointillist".into())];
        let title = parts
            .into_iter()
            .flatten()
            .filter(|part| !part.is_empty())
            .collect::<Vec<_>>()
            .join(" - ");
        if title != self.window_title {
            window.set_title(&title);
            self.window_title = title;
        }
        self.ask_for_panel();
    }
}
