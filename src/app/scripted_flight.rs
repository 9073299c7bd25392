//! A scripted flight, to measure the window: along a camera path or straight ahead as soon as the
//! cloud is complete, then a rest, then the end.

use super::frame_stats::{self, FrameSample};
use super::render_thread::FrameReport;
use std::time::{Duration, Instant};

/// The state and measurements of a scripted flight.
pub struct ScriptedFlight {
    length: Duration,
    stage: Stage,
    /// All frames of the flight.
    pub pictures: Vec<FrameSample>,
    /// Time from the stop to the whole picture.
    pub to_whole: Option<Duration>,
    /// Frames that were drawn at rest.
    pub at_rest: u64,
    /// Processor time of the rest; None if the system does not report it.
    pub rest_cpu: Option<Duration>,
    /// Processor time at the start of the rest.
    cpu_before: Option<Duration>,
}

#[derive(Clone, Copy)]
enum Stage {
    Before,
    Under(Instant),
    Stopped(Instant),
    /// The picture is whole, and the panel is still being updated.
    Settling(Instant),
    Rest(Instant),
    Over,
}

/// A task of the window for the flight.
pub enum Step {
    Start,
    Stop,
}

/// Time for the panel to show the facts of the last frame.
const SETTLING: Duration = Duration::from_millis(500);

/// Length of the rest.
pub const REST: Duration = Duration::from_secs(2);

impl ScriptedFlight {
    pub fn new(length: Duration) -> ScriptedFlight {
        ScriptedFlight {
            length,
            stage: Stage::Before,
            pictures: Vec::new(),
            to_whole: None,
            at_rest: 0,
            rest_cpu: None,
            cpu_before: None,
        }
    }

    /// Takes a frame into account; `rests` if neither cloud nor picture will change by itself.
    /// Returns what the window has to do.
    pub fn frame_done(&mut self, report: &FrameReport, rests: bool, now: Instant) -> Option<Step> {
        let (stage, step) = match self.stage {
            Stage::Before if rests => (Stage::Under(now), Some(Step::Start)),
            Stage::Under(since) => {
                self.pictures.push(FrameSample::of(report, now));
                match now - since >= self.length {
                    // If the path is at rest, no other frame follows.
                    true if rests => (self.is_whole(Duration::ZERO, now), Some(Step::Stop)),
                    true => (Stage::Stopped(now), Some(Step::Stop)),
                    false => (Stage::Under(since), None),
                }
            }
            Stage::Stopped(since) if rests => (self.is_whole(now - since, now), None),
            Stage::Rest(since) => {
                self.at_rest += 1;
                (Stage::Rest(since), None)
            }
            stage => (stage, None),
        };
        self.stage = stage;
        step
    }

    fn is_whole(&mut self, after: Duration, now: Instant) -> Stage {
        self.to_whole = Some(after);
        Stage::Settling(now)
    }

    /// Returns when [`Self::wake`] has to be called; None if frames drive the flight.
    pub fn wakes(&self) -> Option<Instant> {
        match self.stage {
            Stage::Settling(since) => Some(since + SETTLING),
            Stage::Rest(since) => Some(since + REST),
            _ => None,
        }
    }

    /// Advances the stages that last a fixed time; returns true when the flight is over.
    pub fn wake(&mut self, now: Instant) -> bool {
        if self.wakes().is_none_or(|when| when > now) {
            return false;
        }
        match self.stage {
            Stage::Settling(_) => {
                self.cpu_before = frame_stats::processor_time();
                self.stage = Stage::Rest(now);
                false
            }
            _ => {
                let taken = frame_stats::processor_time().zip(self.cpu_before);
                self.rest_cpu = taken.map(|(after, before)| after.saturating_sub(before));
                self.stage = Stage::Over;
                true
            }
        }
    }
}
