//! Statistics of frame times, for `--timings` and `bench window`.

use super::render_thread::{FrameReport, FrameTimes};
use super::scripted_flight::{REST, ScriptedFlight};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Statistics of one run of the window.
#[derive(Clone, Debug)]
pub struct FrameStats {
    began: Instant,
    /// The device, and its driver.
    pub device: String,
    /// Time from the start of the program to the first frame of a cloud.
    first: Option<Duration>,
    /// Time from the start to the first whole frame.
    first_whole: Option<Duration>,
    /// Number of frames at full quality.
    whole: u64,
    /// Number of frames drawn while changes came.
    moving: u64,
    /// Latencies of the last [`MOST_LATENCIES`] of these.
    latencies: VecDeque<Duration>,
}

/// Most latencies that are kept for the report: a window may be open for days.
const MOST_LATENCIES: usize = 1 << 14;

/// Measurements of one frame of a flight.
#[derive(Clone, Copy, Debug)]
pub struct FrameSample {
    /// Time at which it was done.
    at: Instant,
    /// Time since its camera was set.
    latency: Duration,
    /// Time on the device.
    took: Duration,
    /// True if no point was drawn.
    empty: bool,
    /// True if nodes were being loaded.
    loading: bool,
    /// Processor time of the loader thread until then.
    loader: Duration,
    times: FrameTimes,
}

impl FrameSample {
    pub fn of(report: &FrameReport, at: Instant) -> FrameSample {
        let loader = report.loading.map_or(Duration::ZERO, |loading| loading.worked);
        let empty = report.statistics.points_drawn == 0;
        FrameSample {
            at,
            latency: report.latency,
            took: report.took,
            empty,
            loading: report.is_loading(),
            loader,
            times: report.times,
        }
    }
}

/// Median, 99th percentile and maximum of times `[ms]`.
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

/// The report of `--timings`; times are wall-clock `[ms]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Summary {
    pub device: String,
    pub first_ms: Option<f64>,
    pub first_whole_ms: Option<f64>,
    pub whole: u64,
    pub moving: u64,
    /// Time from a change to its frame, of the last frames drawn while changes came.
    pub change_ms: Spread,
    /// The scripted flight, if there was one.
    pub flight: Option<FlightSummary>,
}

/// The report of a scripted flight.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FlightSummary {
    pub pictures: usize,
    /// Frames without a point: if the flight leaves the cloud, its times are not the cloud's.
    pub empty: usize,
    /// Time from one frame to the next.
    pub frame_ms: Spread,
    /// Time from setting a camera to its frame.
    pub latency_ms: Spread,
    /// Part of the latency that drawing takes.
    pub drawing_ms: Spread,
    /// Frames drawn while nodes were being loaded.
    pub loading: usize,
    /// Time from the frame before to each of these.
    pub loading_ms: Spread,
    /// Part of every frame that uploading of loaded nodes takes.
    pub took_in_ms: Spread,
    /// Most that loading takes of every frame: uploading, and the processor time of its thread.
    pub loader_ms: Spread,
    /// Frame times over twice the median.
    pub slow: usize,
    /// Slow frames during which nodes were being loaded.
    pub slow_loading: usize,
    /// Slow frames that might not be slow without the loader: if its processor time had been idle.
    pub slow_for_loader: usize,
    /// Slow frames by cause: the step that exceeded its own median most.
    pub slow_by: Vec<(String, usize)>,
    /// Time from the stop to the whole picture.
    pub to_whole_ms: Option<f64>,
    /// Length of the rest.
    pub rest_ms: f64,
    /// Frames drawn at rest.
    pub rest_pictures: u64,
    pub rest_cpu_ms: Option<f64>,
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Causes of a frame's time. The loader's is uploading its nodes, and the processor time of its
/// thread: a device that shares the cores waits at most that long.
const CAUSES: [&str; 7] = [
    "fitting the window",
    "the loader",
    "recording",
    "the device",
    "reading back",
    "showing",
    "between frames",
];

/// Index of the loader in [`CAUSES`].
const LOADER: usize = 1;

/// The time from one frame to the next `[ms]`, and its parts.
struct Step {
    ms: f64,
    by_cause: [f64; CAUSES.len()],
    loading: bool,
}

impl Step {
    fn between(before: &FrameSample, after: &FrameSample) -> Step {
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

/// Counts the frames slower than `slow` `[ms]` by cause, the most frequent cause first.
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
        let of_pictures = |time: fn(&FrameSample) -> Duration| {
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
    /// Formats the causes of slow frames.
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
            moving: 0,
            latencies: VecDeque::new(),
            whole: 0,
        }
    }

    /// Takes a frame into account; `rests` if nothing of the cloud is missing in it.
    pub fn frame_done(&mut self, report: &FrameReport, rests: bool) {
        let since = self.began.elapsed();
        self.first.get_or_insert(since);
        if report.whole {
            self.whole += 1;
        } else {
            self.moving += 1;
            if self.latencies.len() == MOST_LATENCIES {
                self.latencies.pop_front();
            }
            self.latencies.push_back(report.latency);
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
            moving: self.moving,
            change_ms: Spread::of(self.latencies.iter().copied().map(ms).collect()),
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
            "first frame {}, first whole one {}",
            or_never(self.first_ms),
            or_never(self.first_whole_ms)
        )?;
        writeln!(
            f,
            "{} frames: {} whole, {} while moving",
            self.whole + self.moving,
            self.whole,
            self.moving
        )?;
        writeln!(f, "from change to frame: {}", self.change_ms)?;
        let Some(flight) = &self.flight else { return Ok(()) };
        let rate = if flight.frame_ms.median > 0.0 { 1e3 / flight.frame_ms.median } else { 0.0 };
        writeln!(
            f,
            "flight: {} frames, {rate:.1} a second; from one to the next: {}",
            flight.pictures, flight.frame_ms
        )?;
        writeln!(f, "  from camera to frame: {}", flight.latency_ms)?;
        writeln!(f, "  of that, drawing: {}", flight.drawing_ms)?;
        if flight.empty > 0 {
            writeln!(
                f,
                "  {} frames without a point: the flight has left the cloud, so its times are not the cloud's",
                flight.empty
            )?;
        }
        if flight.loading > 0 {
            writeln!(
                f,
                "  {} frames while nodes were loading: {}",
                flight.loading, flight.loading_ms
            )?;
            writeln!(f, "  uploading loaded nodes: {}", flight.took_in_ms)?;
            writeln!(f, "  loader in total: {}", flight.loader_ms)?;
        }
        if flight.slow > 0 {
            let FlightSummary { slow, slow_loading, slow_for_loader, .. } = flight;
            write!(f, "  {slow} over twice the median, by {}; ", flight.causes())?;
            writeln!(
                f,
                "nodes were loading in {slow_loading}, and {slow_for_loader} might not be slow without the loader"
            )?;
        }
        writeln!(f, "from the stop to the whole picture: {}", or_never(flight.to_whole_ms))?;
        let cpu = flight
            .rest_cpu_ms
            .map_or(String::new(), |ms| format!(", {ms:.0} ms of processor time"));
        writeln!(f, "at rest, {:.0} ms: {} frames{cpu}", flight.rest_ms, flight.rest_pictures)
    }
}

/// Returns user and system time of all threads of this process; None if there is no `/proc`.
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
    fn a_slow_frame_counts_for_the_step_that_exceeded_its_median_most() {
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
            [("between frames".to_string(), 2), ("the loader".to_string(), 1)]
        );
    }

    #[test]
    fn a_frame_is_slow_for_the_loader_if_it_is_fast_without_its_time() {
        let started = Instant::now();
        let at = |after: u64, loader: u64| FrameSample {
            at: started + Duration::from_millis(after),
            latency: Duration::ZERO,
            took: Duration::ZERO,
            empty: false,
            loading: loader > 0,
            loader: Duration::from_millis(loader),
            times: FrameTimes { taking_in: Duration::from_millis(1), ..FrameTimes::default() },
        };
        let mut flight = ScriptedFlight::new(Duration::from_secs(1));
        // Frames of 10 ms, but for one of 24 with 5 of the loader and 1 of taking in, and one of 24
        // with 2 of the loader.
        flight.pictures = [(0, 0), (10, 0), (20, 0), (44, 5), (54, 5), (78, 7), (88, 7)]
            .map(|(after, loader)| at(after, loader))
            .into();
        let summary = FlightSummary::of(&flight);
        assert_eq!((summary.slow, summary.slow_loading, summary.slow_for_loader), (2, 2, 1));
        // The device drew for 8 ms, but for one of 22 with 14 of the loader, and one of 21.
        let drew = |drawing: u64, picture: FrameSample| FrameSample {
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
