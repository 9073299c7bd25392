//! Events of the render thread, applied to the window.

use super::load_thread::Categories;
use super::measure::Picked;
use super::navigation::Direction;
use super::render_thread::{FrameReport, RenderEvent};
use super::scripted_flight::Step;
use super::{App, print_line};
use crate::cloud::digits;
use crate::resident::Point;
use std::time::{Duration, Instant};
use winit::event_loop::ActiveEventLoop;

/// Longest time until the panel shows the facts of a new frame: frames come faster than one reads.
const BETWEEN: Duration = Duration::from_millis(100);

impl App {
    pub(super) fn render_event(&mut self, events: &ActiveEventLoop, event: RenderEvent) {
        match event {
            // The frame is not done yet, so the title stays.
            RenderEvent::FrameStarted => return self.move_on(),
            RenderEvent::FrameDone(report) => return self.frame_done(*report),
            RenderEvent::Measured(measured) => {
                (self.ui.pace.measured, self.ui.pace.texture) = (Some(measured), None);
            }
            RenderEvent::Priced(prices) => self.ui.prices = prices,
            RenderEvent::Counted(points) => self.counted(points),
            RenderEvent::Uploaded(info, token) => self.uploaded(*info, &token),
            RenderEvent::Picked { point, adds, token } if !token.is_cancelled() => {
                self.picked(point, adds);
            }
            // The user has forgotten the picked points since the click.
            RenderEvent::Picked { .. } => {}
            RenderEvent::NothingPicked { adds } => self.nothing_picked(adds),
            RenderEvent::Profile(profile) => {
                print_line(&profile.summary(&self.ui.measure.reference));
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
            // An error that recurs with every frame is shown once.
            RenderEvent::Failed(error)
                if self.ui.dismissed_error.as_ref() == Some(&error.to_string()) => {}
            RenderEvent::Failed(error) => self.report_error(&error),
            RenderEvent::Resolved(error) => self.ui.withdraw_error(&error),
            RenderEvent::UploadFailed(error, token) if !token.is_cancelled() => {
                self.upload_failed(&error)
            }
            RenderEvent::UploadFailed(..) => {}
            RenderEvent::Ended(error) => {
                if let Err(error) = self.rebuild(error) {
                    self.exit_error = Some(error);
                    events.exit();
                }
            }
        }
        self.title();
    }

    /// Takes the number of points that filters and clip boxes leave in view.
    fn counted(&mut self, points: u64) {
        (self.ui.drawn, self.ui.at_most) = (points, false);
        let Categories { bounds, reference, .. } = &self.ui.categories;
        if let (0, 1.., Some(bounds)) = (points, self.scene.clips.active(), bounds) {
            let corner = |at| reference.digits.round(at).to_array().map(digits::number).join(" ");
            let [low, high] = bounds.map(corner);
            self.ui.picture_notes.push(format!(
                "clip boxes leave no point in view; the cloud lies in {low} to {high}"
            ));
        }
    }

    pub(super) fn frame_done(&mut self, report: FrameReport) {
        // Neither the cloud nor the picture will change by itself.
        let rests = report.whole
            && !self.load.active
            && self.render_thread.as_ref().is_some_and(|thread| thread.is_newest(report.handled));
        self.stats.frame_done(&report, rests);
        let step = self
            .flight
            .as_mut()
            .and_then(|flight| flight.frame_done(&report, rests, Instant::now()));
        self.pick_buffer = Some(report.pick_buffer);
        (self.ui.drawn, self.ui.at_most) = (report.statistics.points_drawn, report.leaves_out);
        self.ui.loading = report.loading;
        if report.moving.is_some() {
            (self.ui.pace.moving, self.ui.pace.measured) = (report.moving, None);
            self.ui.prices.clear();
        }
        self.ui.bytes_read += report.loading.map_or(0, |loading| loading.bytes_read);
        (self.ui.latency, self.ui.took) = (report.latency, report.took);
        self.ui.passes = report.passes;
        (self.ui.decisions, self.ui.picture_notes) = (report.decisions, report.notes);
        match step {
            Some(Step::Start) if !self.ui.path.keys.is_empty() => self.play(),
            Some(Step::Start) => self.fly(Direction::Forward, true),
            Some(Step::Stop) => {
                self.ui.plays = false;
                self.fly(Direction::Forward, false);
            }
            None => {}
        }
        self.schedule_panel();
    }

    /// Schedules a layout of the panel: at once if something is drawn over the picture, which moves
    /// with it, else soon.
    fn schedule_panel(&mut self) {
        let over = !self.ui.measure.points.is_empty() || !self.scene.annotations.is_empty();
        if over || self.scene.clips.active() > 0 {
            return self.request_panel();
        }
        let soon = Instant::now() + BETWEEN;
        self.panel_due = Some(self.panel_due.map_or(soon, |when| when.min(soon)));
    }

    pub(super) fn picked(&mut self, point: Point, adds: bool) {
        if !adds {
            self.clear_picked();
        }
        self.ui.measure.points.push(Picked::new(point));
        print_line(&self.ui.measure.to_string());
        self.look_up(&point);
    }

    /// Updates the window's title: open files, and work in progress.
    pub(super) fn title(&mut self) {
        let Some(window) = &self.window else { return };
        let file = self
            .load
            .files
            .first()
            .and_then(|file| file.file_name())
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default();
        let more = if self.load.files.len() > 1 {
            format!(" and {} more", self.load.files.len() - 1)
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
        self.request_panel();
    }
}
