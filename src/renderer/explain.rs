//! Text about what a frame shows, and why.

use super::{CloudState, FrameReport, Renderer};
use std::fmt::Write;

impl Renderer {
    /// Describes a frame, line by line: how complete it is, the state of each cloud, whether each
    /// effect runs and why, device times of the passes of the last completed frame, and errors.
    pub fn explain(&self, report: &FrameReport) -> String {
        let mut text = String::new();
        let settled = if report.settled { "settled" } else { "not settled" };
        let (points, missing) = (report.points, report.missing);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "frame: {settled}, {points} points, {missing} nodes missing");
        for cloud in &self.clouds {
            let hidden = if cloud.visible { "" } else { ", hidden" };
            let _ = match cloud.state() {
                CloudState::Loading { doing, done } => {
                    let doing = if doing.is_empty() { "loading" } else { &doing };
                    writeln!(text, "cloud {}: {doing}, {:.0} %", cloud.id.0, 100.0 * done)
                }
                CloudState::Uploading => writeln!(text, "cloud {}: uploading{hidden}", cloud.id.0),
                CloudState::Ready => writeln!(text, "cloud {}: ready{hidden}", cloud.id.0),
                CloudState::Failed(why) => writeln!(text, "cloud {}: failed: {why}", cloud.id.0),
            };
        }
        for effect in &report.effects {
            let runs = if effect.runs { "on" } else { "off" };
            let _ = writeln!(text, "effect {}: {runs}: {}", effect.name, effect.why);
        }
        for pass in &self.times {
            let _ = writeln!(text, "pass {}: {:.3} ms", pass.name, pass.milliseconds);
        }
        for error in &report.errors {
            let _ = writeln!(text, "error: {error}");
        }
        text
    }
}
