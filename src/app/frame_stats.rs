//! How long pictures took, for `--timings` and `bench window`.

use super::render_thread::{FrameReport, FrameTimes};
use super::scripted_flight::{REST, ScriptedFlight};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Of one run of the window.
#[derive(Clone, Debug)]
pub struct FrameStats {
    began: Instant,
    /// The device, and its driver.
    pub device: String,
    /// From the start of the program to the first picture of a cloud.
    first: Option<Duration>,
    /// To the first that was whole.
    first_whole: Option<Duration>,
    /// Pictures at full quality, and those that were drawn while changes came.
    whole: u64,
    moving: Vec<Duration>,
}

/// One picture of a flight.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    /// When it was drawn.
    at: Instant,
    /// Since its camera was wanted.
    latency: Duration,
    /// RenderThread it.
    took: Duration,
    /// No point was drawn.
    empty: bool,
    /// Nodes were on their way.
    loading: bool,
    /// How long the loader had worked by then.
    loader: Duration,
    times: FrameTimes,
}

impl Picture {
    pub fn of(drawn: &FrameReport, at: Instant) -> Picture {
        let loader = drawn.loading.map_or(Duration::ZERO, |loading| loading.worked);
        let empty = drawn.statistics.points_drawn == 0;
        Picture {
            at,
            latency: drawn.latency,
            took: drawn.took,
            empty,
            loading: drawn.is_loading(),
            loader,
            times: drawn.times,
        }
    }
}

/// Half of them took no longer, 99 of a hundred took no longer, none took longer; milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    pub median: f64,
    pub p99: f64,
    pub worst: f64,
}

impl Spread {
    pub fn of(mut times: Vec<f64>) -> Spread {
        times.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            times
                .get(((share * times.len() as f64).ceil() as usize).saturating_sub(1))
                .copied()
                .unwrap_or_default()
        };
        Spread { median: rank(0.5), p99: rank(0.99), worst: rank(1.0) }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "median {:.1} ms, 99 % within {:.1} ms, worst {:.1} ms",
            self.median, self.p99, self.worst
        )
    }
}

/// What `--timings` says. Milliseconds are wall-clock time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Summary {
    pub device: String,
    pub first_ms: Option<f64>,
    pub first_whole_ms: Option<f64>,
    pub whole: u64,
    pub moving: u64,
    /// From change to picture, of the pictures that were drawn while changes came.
    pub change_ms: Spread,
    /// Without hands.
    pub flight: Option<FlightSummary>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FlightSummary {
    pub pictures: usize,
    /// Of these, without a point: what is said of a flight that leaves the cloud is not said of the cloud.
    pub empty: usize,
    /// From one picture to the next.
    pub frame_ms: Spread,
    /// From when a camera was wanted to its picture.
    pub latency_ms: Spread,
    /// Of that, drawing it.
    pub drawing_ms: Spread,
    /// Pictures that were drawn while nodes were on their way, and the time since the one before them.
    pub loading: usize,
    pub loading_ms: Spread,
    /// Of every picture's time, what went into taking in nodes that had come.
    pub took_in_ms: Spread,
    /// From one picture to the next, what the loader takes at most: taking in, and as long as its thread had a core.
    pub loader_ms: Spread,
    /// Times from one picture to the next that are over twice the median, and those of them during which nodes were on their way.
    pub slow: usize,
    pub slow_loading: usize,
    /// Of all slow ones, those that might not be without the loader: if nothing had been drawn for as long as it had a core meanwhile.
    pub slow_for_loader: usize,
    /// Of all slow ones, how many are slow by what: whatever took longest beyond its own median.
    pub slow_by: Vec<(String, usize)>,
    /// From standing still to the whole picture.
    pub to_whole_ms: Option<f64>,
    /// Of nothing to do, then the pictures drawn and the processor time taken in it.
    pub rest_ms: f64,
    pub rest_pictures: u64,
    pub rest_cpu_ms: Option<f64>,
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// What a frame's time may have gone into. The loader's is taking in what it brought, and as long as its thread had a core: a device that shares its cores waits for it as long at most.
const CAUSES: [&str; 7] = [
    "fitting the window",
    "the loader",
    "recording",
    "the device",
    "reading back",
    "showing",
    "what is between pictures",
];

const LOADER: usize = 1;

/// From one picture to the next, milliseconds.
struct Step {
    ms: f64,
    by_cause: [f64; CAUSES.len()],
    loading: bool,
}

impl Step {
    fn between(before: &Picture, after: &Picture) -> Step {
        let frame = ms(after.at - before.at);
        let FrameTimes { fitting, taking_in, recording, drawing, reading_back, showing } =
            after.times;
        let worked = after.loader.saturating_sub(before.loader);
        let between =
            frame - ms(fitting + taking_in + recording + drawing + reading_back + showing);
        let [a, b, c, d, e, f] = [
            fitting,
            taking_in + worked,
            recording,
            drawing.saturating_sub(worked),
            reading_back,
            showing,
        ]
        .map(ms);
        let by_cause = [a, b, c, d, e, f, between.max(0.0)];
        Step { ms: frame, by_cause, loading: after.loading }
    }
}

/// How many frames are slow by what, of those that took more than this; the commonest first.
fn slow_by(steps: &[Step], slow: f64) -> Vec<(String, usize)> {
    let usual: Vec<f64> = (0..CAUSES.len())
        .map(|cause| Spread::of(steps.iter().map(|step| step.by_cause[cause]).collect()).median)
        .collect();
    let mut counts = [0; CAUSES.len()];
    for step in steps.iter().filter(|step| step.ms > slow) {
        let excess = |cause: &usize| step.by_cause[*cause] - usual[*cause];
        counts[(0..CAUSES.len())
            .max_by(|a, b| excess(a).total_cmp(&excess(b)))
            .expect("there are causes")] += 1;
    }
    let mut named: Vec<_> = CAUSES
        .iter()
        .map(ToString::to_string)
        .zip(counts)
        .filter(|(_, count)| *count > 0)
        .collect();
    named.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    named
}

impl FlightSummary {
    pub fn of(flight: &ScriptedFlight) -> FlightSummary {
        let steps: Vec<Step> =
            flight.pictures.windows(2).map(|pair| Step::between(&pair[0], &pair[1])).collect();
        let of_pictures = |time: fn(&Picture) -> Duration| {
            Spread::of(flight.pictures.iter().map(|picture| ms(time(picture))).collect())
        };
        let frame_ms = Spread::of(steps.iter().map(|step| step.ms).collect());
        let limit = 2.0 * frame_ms.median;
        let slow = || steps.iter().filter(|step| step.ms > limit);
        FlightSummary {
            frame_ms,
            took_in_ms: of_pictures(|picture| picture.times.taking_in),
            loader_ms: Spread::of(steps.iter().map(|step| step.by_cause[LOADER]).collect()),
            slow: slow().count(),
            slow_by: slow_by(&steps, limit),
            slow_loading: slow().filter(|step| step.loading).count(),
            slow_for_loader: slow().filter(|step| step.ms - step.by_cause[LOADER] <= limit).count(),
            pictures: flight.pictures.len(),
            empty: flight.pictures.iter().filter(|picture| picture.empty).count(),
            latency_ms: of_pictures(|picture| picture.latency),
            drawing_ms: of_pictures(|picture| picture.took),
            loading: flight.pictures.iter().filter(|picture| picture.loading).count(),
            loading_ms: Spread::of(
                steps.iter().filter(|step| step.loading).map(|step| step.ms).collect(),
            ),
            to_whole_ms: flight.to_whole.map(ms),
            rest_ms: ms(REST),
            rest_pictures: flight.at_rest,
            rest_cpu_ms: flight.rest_cpu.map(ms),
        }
    }
}

impl FlightSummary {
    /// What slow frames are slow by, in words.
    pub fn causes(&self) -> String {
        self.slow_by
            .iter()
            .map(|(cause, count)| format!("{cause} {count}"))
            .collect::<Vec<_>>()
            .join(", ")
    }
}

impl FrameStats {
    pub fn new(began: Instant) -> FrameStats {
        FrameStats {
            began,
            device: String::new(),
            first: None,
            first_whole: None,
            moving: Vec::new(),
            whole: 0,
        }
    }

    /// `rests`: nothing of the cloud is missing in it.
    pub fn drawn(&mut self, drawn: &FrameReport, rests: bool) {
        let since = self.began.elapsed();
        self.first.get_or_insert(since);
        if drawn.whole {
            self.whole += 1;
        } else {
            self.moving.push(drawn.latency);
        }
        if rests {
            self.first_whole.get_or_insert(since);
        }
    }

    pub fn summary(&self, flight: Option<&ScriptedFlight>) -> Summary {
        Summary {
            device: self.device.clone(),
            first_ms: self.first.map(ms),
            first_whole_ms: self.first_whole.map(ms),
            whole: self.whole,
            moving: self.moving.len() as u64,
            change_ms: Spread::of(self.moving.iter().copied().map(ms).collect()),
            flight: flight.map(FlightSummary::of),
        }
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let or_never =
            |time: Option<f64>| time.map_or("never".to_string(), |ms| format!("after {ms:.0} ms"));
        writeln!(
            f,
            "first picture {}, first whole one {}",
            or_never(self.first_ms),
            or_never(self.first_whole_ms)
        )?;
        writeln!(
            f,
            "{} pictures: {} whole, {} while moving",
            self.whole + self.moving,
            self.whole,
            self.moving
        )?;
        writeln!(f, "from change to picture: {}", self.change_ms)?;
        let Some(flight) = &self.flight else { return Ok(()) };
        let rate = if flight.frame_ms.median > 0.0 { 1e3 / flight.frame_ms.median } else { 0.0 };
        writeln!(
            f,
            "flight: {} pictures, {rate:.1} a second; from one to the next: {}",
            flight.pictures, flight.frame_ms
        )?;
        writeln!(f, "  from camera to picture: {}", flight.latency_ms)?;
        writeln!(f, "  of that, drawing: {}", flight.drawing_ms)?;
        if flight.empty > 0 {
            writeln!(
                f,
                "  {} pictures without a point: the flight has left the cloud, and its times are not the cloud's",
                flight.empty
            )?;
        }
        if flight.loading > 0 {
            writeln!(
                f,
                "  {} pictures while nodes were on their way: {}",
                flight.loading, flight.loading_ms
            )?;
            writeln!(f, "  taking in what had come: {}", flight.took_in_ms)?;
            writeln!(f, "  the loader's part: {}", flight.loader_ms)?;
        }
        if flight.slow > 0 {
            let FlightSummary { slow, slow_loading, slow_for_loader, .. } = flight;
            write!(f, "  {slow} over twice the median, by {}; ", flight.causes())?;
            writeln!(
                f,
                "nodes were on their way in {slow_loading}, and {slow_for_loader} might not be slow without the loader"
            )?;
        }
        writeln!(f, "from standing still to the whole picture: {}", or_never(flight.to_whole_ms))?;
        let cpu = flight
            .rest_cpu_ms
            .map_or(String::new(), |ms| format!(", {ms:.0} ms of processor time"));
        writeln!(f, "at rest, {:.0} ms: {} pictures{cpu}", flight.rest_ms, flight.rest_pictures)
    }
}

/// User's and system's, of all threads of this process, where the system tells in the way that Linux does.
pub fn processor_time() -> Option<Duration> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name in parentheses may hold anything; then come the state and ten numbers.
    let mut fields =
        stat.rsplit_once(')')?.1.split_whitespace().skip(11).map(|field| field.parse::<u64>().ok());
    // Hundredths of a second, whatever the machine.
    Some(Duration::from_millis(10 * (fields.next()?? + fields.next()??)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_frame_is_slow_by_what_took_longer_than_it_mostly_does() {
        let step = |by_cause: [f64; CAUSES.len()]| Step {
            ms: by_cause.iter().sum(),
            by_cause,
            loading: false,
        };
        let mut steps: Vec<_> =
            (0..20).map(|_| step([0.0, 1.0, 1.0, 7.0, 0.5, 0.5, 0.0])).collect();
        steps.push(step([0.0, 22.0, 1.0, 7.0, 0.5, 0.5, 0.0]));
        steps.push(step([0.0, 1.0, 1.0, 9.0, 0.5, 0.5, 17.0]));
        steps.push(step([0.0, 1.0, 1.0, 9.0, 0.5, 0.5, 28.0]));
        assert_eq!(
            slow_by(&steps, 20.0),
            [("what is between pictures".to_string(), 2), ("the loader".to_string(), 1)]
        );
    }

    #[test]
    fn a_frame_is_slow_for_the_loader_if_it_would_not_be_without_what_that_worked() {
        let started = Instant::now();
        let at = |after: u64, loader: u64| Picture {
            at: started + Duration::from_millis(after),
            latency: Duration::ZERO,
            took: Duration::ZERO,
            empty: false,
            loading: loader > 0,
            loader: Duration::from_millis(loader),
            times: FrameTimes { taking_in: Duration::from_millis(1), ..FrameTimes::default() },
        };
        let mut flight = ScriptedFlight::new(Duration::from_secs(1));
        // Of 10 ms, but for one of 24 with 5 of the loader and 1 of taking in, and one of 24 with 2 of the loader.
        flight.pictures = [(0, 0), (10, 0), (20, 0), (44, 5), (54, 5), (78, 7), (88, 7)]
            .map(|(after, loader)| at(after, loader))
            .into();
        let summary = FlightSummary::of(&flight);
        assert_eq!((summary.slow, summary.slow_loading, summary.slow_for_loader), (2, 2, 1));
        // The device drew for 8 ms, but for one of 22 with 14 of the loader, and one of 21.
        let drew = |drawing: u64, picture: Picture| Picture {
            times: FrameTimes { drawing: Duration::from_millis(drawing), ..FrameTimes::default() },
            ..picture
        };
        flight.pictures =
            [(0, 0, 8), (10, 0, 8), (20, 0, 8), (44, 14, 22), (54, 14, 8), (77, 14, 21)]
                .map(|(after, loader, drawing)| drew(drawing, at(after, loader)))
                .into();
        assert_eq!(
            FlightSummary::of(&flight).slow_by,
            [("the loader".to_string(), 1), ("the device".to_string(), 1)]
        );
    }

    #[test]
    fn a_spread_names_times_that_were_taken() {
        let spread = Spread::of((1..=200).map(f64::from).rev().collect());
        assert_eq!(spread, Spread { median: 100.0, p99: 198.0, worst: 200.0 });
        assert_eq!(Spread::of(vec![7.0]), Spread { median: 7.0, p99: 7.0, worst: 7.0 });
        assert_eq!(Spread::of(Vec::new()), Spread::default());
    }
}
