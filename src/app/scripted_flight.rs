//! A flight without hands, to measure the window by: along a camera path, or straight ahead, as soon as the cloud is there; then a rest, then the end.

use super::frame_stats::{self, Picture};
use super::render_thread::FrameReport;
use std::time::{Duration, Instant};

pub struct ScriptedFlight {
    length: Duration,
    stage: Stage,
    /// All that were drawn on the way.
    pub pictures: Vec<Picture>,
    /// From standing still to the whole picture.
    pub to_whole: Option<Duration>,
    /// Pictures that were drawn at rest.
    pub at_rest: u64,
    /// Processor time that the rest took, where the system tells.
    pub rest_cpu: Option<Duration>,
    /// When the rest began, and what had been taken then.
    cpu_before: Option<Duration>,
}

#[derive(Clone, Copy)]
enum Stage {
    Before,
    Under(Instant),
    Stopped(Instant),
    /// The whole picture is there, and what it made the panel do is being done.
    Settling(Instant),
    Rest(Instant),
    Over,
}

/// What hands would do.
pub enum Step {
    Start,
    Stop,
}

/// The panel shows the last picture's state.
const SETTLING: Duration = Duration::from_millis(500);

/// How long nothing is done.
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

    /// A picture is on the screen, and is all that is wanted or not.
    pub fn drawn(&mut self, drawn: &FrameReport, rests: bool, now: Instant) -> Option<Step> {
        let (stage, step) = match self.stage {
            Stage::Before if rests => (Stage::Under(now), Some(Step::Start)),
            Stage::Under(since) => {
                self.pictures.push(Picture::of(drawn, now));
                match now - since >= self.length {
                    // No picture follows where the path rests.
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

    /// When something is to be done although nothing happens.
    pub fn wakes(&self) -> Option<Instant> {
        match self.stage {
            Stage::Settling(since) => Some(since + SETTLING),
            Stage::Rest(since) => Some(since + REST),
            _ => None,
        }
    }

    /// Goes on by itself; true when it is over.
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
