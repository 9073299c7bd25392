//! How long pictures took, for `--timings` and `bench window`.

use super::drawing::Drawn;
use std::time::{Duration, Instant};

/// Of one run of the window.
#[derive(Clone, Debug)]
pub struct Statistics {
    pub began: Instant,
    /// From the start of the program to the first picture of a cloud.
    pub first: Option<Duration>,
    /// To the first that was whole.
    pub first_whole: Option<Duration>,
    /// From a change to the end of drawing it, of every picture that was drawn while changes came.
    pub moving: Vec<Duration>,
    /// Pictures at full quality.
    pub whole: u64,
    /// Of a flight without hands: from standing still to the whole picture, and pictures drawn at rest.
    pub flight: Option<(Option<Duration>, u64)>,
}

impl Statistics {
    pub fn new(began: Instant) -> Statistics {
        Statistics { began, first: None, first_whole: None, moving: Vec::new(), whole: 0, flight: None }
    }

    pub fn drawn(&mut self, drawn: &Drawn) {
        let since = self.began.elapsed();
        self.first.get_or_insert(since);
        if drawn.whole {
            self.whole += 1;
            self.first_whole.get_or_insert(since);
        } else {
            self.moving.push(drawn.latency);
        }
    }

    pub fn pictures(&self) -> u64 {
        self.whole + self.moving.len() as u64
    }

    /// Of the moving pictures: so that this share of them took no longer.
    pub fn quantile(&self, share: f64) -> Duration {
        let mut sorted = self.moving.clone();
        sorted.sort();
        let at = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(at.saturating_sub(1)).copied().unwrap_or_default()
    }
}

impl std::fmt::Display for Statistics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let or_never = |time: Option<Duration>| time.map_or("never".to_string(), |time| format!("after {:.0} ms", ms(time)));
        writeln!(f, "first picture {}, first whole one {}", or_never(self.first), or_never(self.first_whole))?;
        writeln!(f, "{} pictures: {} whole, {} while moving", self.pictures(), self.whole, self.moving.len())?;
        let [median, most, worst] = [0.5, 0.99, 1.0].map(|share| ms(self.quantile(share)));
        writeln!(f, "from change to picture: median {median:.1} ms, 99 % within {most:.1} ms, worst {worst:.1} ms")?;
        let Some((to_whole, at_rest)) = self.flight else { return Ok(()) };
        writeln!(f, "from standing still to the whole picture: {}; pictures drawn at rest: {at_rest}", or_never(to_whole))
    }
}
