//! A flight without hands, to measure the window by: straight ahead for a while as soon as the cloud is there, then a rest, then the end.

use std::time::{Duration, Instant};

pub struct Flight {
    length: Duration,
    stage: Stage,
    /// From standing still to the whole picture.
    pub to_whole: Option<Duration>,
    /// Pictures that were drawn at rest.
    pub at_rest: u64,
}

#[derive(Clone, Copy)]
enum Stage {
    Before,
    Under(Instant),
    Stopped(Instant),
    Rest(Instant),
}

/// What hands would do.
pub enum Hands {
    Start,
    Stop,
}

const REST: Duration = Duration::from_secs(2);

impl Flight {
    pub fn new(length: Duration) -> Flight {
        Flight { length, stage: Stage::Before, to_whole: None, at_rest: 0 }
    }

    /// A picture is on the screen.
    pub fn drawn(&mut self, whole: bool, now: Instant) -> Option<Hands> {
        let (stage, hands) = match self.stage {
            Stage::Before if whole => (Stage::Under(now), Some(Hands::Start)),
            Stage::Under(since) if now - since >= self.length && whole => {
                // No picture follows, for none is finer.
                self.to_whole = Some(Duration::ZERO);
                (Stage::Rest(now), Some(Hands::Stop))
            }
            Stage::Under(since) if now - since >= self.length => (Stage::Stopped(now), Some(Hands::Stop)),
            Stage::Stopped(since) if whole => {
                self.to_whole = Some(now - since);
                (Stage::Rest(now), None)
            }
            Stage::Rest(since) => {
                self.at_rest += 1;
                (Stage::Rest(since), None)
            }
            stage => (stage, None),
        };
        self.stage = stage;
        hands
    }

    /// When it is over, as far as that is known.
    pub fn over(&self) -> Option<Instant> {
        match self.stage {
            Stage::Rest(since) => Some(since + REST),
            _ => None,
        }
    }
}
