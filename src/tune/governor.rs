//! The governor of moving pictures: times of frames in, places on the front out. Pure.
//!
//! ```text
//!     ms = the front's time of a tuning * load * what the tuning's own frames have told
//! ```
//!
//! The load is the median of the last frames, so that one late frame changes nothing. A tuning
//! whose frames take longer than asked for gives way to the most accurate one that fits. A finer
//! one has to fit with room to spare by the slowest of the last frames, so that noise never brings
//! it back.

use super::error::Errors;
use super::front::{Front, Limit};
use super::knobs::Tuning;
use std::time::Duration;

/// Time of a moving frame that is asked for without another: 30 frames a second look like motion.
pub const TARGET: Duration = Duration::from_millis(33);

/// How much longer than asked for a frame may take.
const LONGEST: f64 = 1.1;

/// Share of the time asked for within which a finer picture has to fit.
const SPARE: f64 = 0.85;

/// Frames that the load is the median of.
const FRAMES: usize = 3;

/// Frames that a finer tuning has to fit by.
const SURE: usize = 5;

/// Largest factor by which the first frame of a tuning corrects its own time.
const MOST_OFF: f64 = 1.5;

/// A tuning of the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    pub tuning: Tuning,
    /// Time, as the front has it `[ms]`.
    pub ms: f64,
    /// Mean errors against the picture at rest, as the front has them.
    pub errors: Errors,
    /// Factor on its time beside the load.
    own: f64,
}

/// The place on the front of the next moving frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Governor {
    /// Tunings that no other beats, the fastest first.
    steps: Vec<Step>,
    limit: Limit,
    place: usize,
    load: f64,
    /// Loads that the last frames tell, the newest last.
    recent: Vec<f64>,
    /// True if the next frame is the first of its tuning.
    is_new: bool,
    /// True if no frame has been measured yet.
    is_first: bool,
}

impl Governor {
    /// Returns a governor at the fastest tuning, so that the first picture comes soonest.
    pub fn new(front: &Front, limit: Limit) -> Governor {
        let mut steps: Vec<Step> = Vec::new();
        for tuned in &front.tuned {
            let Some(tuning) = tuned.tuning().filter(Tuning::is_no_finer) else { continue };
            if steps.last().is_none_or(|last| tuned.moving.px < last.errors.px) {
                steps.push(Step { tuning, ms: tuned.ms[1], errors: tuned.moving, own: 1.0 });
            }
        }
        if steps.is_empty() {
            let (tuning, errors) = (Tuning::usual(), Errors::default());
            steps.push(Step { tuning, ms: 1.0, errors, own: 1.0 });
        }
        let mut governor = Governor {
            steps,
            limit,
            place: 0,
            load: 1.0,
            recent: Vec::new(),
            is_new: false,
            is_first: true,
        };
        governor.set_limit(limit);
        governor
    }

    /// Forgets all frames: those of another cloud tell nothing of the next ones. The first picture
    /// of all points of files would otherwise be as fine as those of their sample.
    pub fn restart(&mut self) {
        (self.load, self.is_new, self.is_first) = (1.0, false, true);
        self.recent.clear();
        self.steps.iter_mut().for_each(|step| step.own = 1.0);
        self.set_limit(self.limit);
    }

    /// Sets what is asked for: a time, or an error that the fastest tuning is taken for.
    pub fn set_limit(&mut self, limit: Limit) {
        self.limit = limit;
        let place = match limit {
            // The next frame corrects it.
            Limit::Time(_) if self.is_first => 0,
            Limit::Time(most) => self.fitting(most, self.load).unwrap_or(0),
            Limit::Pixels(px) => self.within(|errors| errors.px <= px),
            Limit::Depth(part) => self.within(|errors| errors.depth <= part),
        };
        self.go(place);
    }

    pub fn limit(&self) -> Limit {
        self.limit
    }

    /// Returns the tunings that no other beats, the fastest first.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Returns the tuning of the next frame.
    pub fn tuning(&self) -> Tuning {
        self.steps[self.place].tuning
    }

    /// Returns the place of the next frame among them.
    pub fn place(&self) -> usize {
        self.place
    }

    /// Returns whether a frame has told the load, without which times are of another device.
    pub fn has_measured(&self) -> bool {
        !self.is_first
    }

    /// Returns the time of a frame of a place that is expected now `[ms]`.
    pub fn expected(&self, place: usize) -> f64 {
        self.steps[place].ms * self.steps[place].own * self.load
    }

    /// Takes a frame of a place into account. Chooses the place of the next one.
    pub fn after(&mut self, place: usize, took: Duration) {
        let step = &mut self.steps[place];
        let mut load = took.as_secs_f64() * 1e3 / (step.ms * step.own);
        if self.is_new && place == self.place {
            // What the first frame of a tuning is off is its own, and the load if it is too much.
            let off = (load / self.load).clamp(1.0 / MOST_OFF, MOST_OFF);
            step.own *= off;
            load /= off;
            self.is_new = false;
        }
        if self.recent.len() == SURE {
            self.recent.remove(0);
        }
        self.recent.push(load);
        let mut last = self.recent[self.recent.len().saturating_sub(FRAMES)..].to_vec();
        last.sort_by(f64::total_cmp);
        self.load = last[last.len() / 2];
        let slowest = self.recent.iter().copied().fold(0.0, f64::max);
        let is_sure = self.recent.len() == SURE || self.is_first;
        self.is_first = false;
        let Limit::Time(most) = self.limit else { return };
        if self.expected(self.place) > LONGEST * most {
            self.go(self.fitting(most, self.load).unwrap_or(0));
        } else if is_sure
            && let Some(finer) = self.fitting(SPARE * most, slowest)
            && finer > self.place
        {
            self.go(finer);
        }
    }

    /// Returns the most accurate place that fits.
    fn fitting(&self, most: f64, load: f64) -> Option<usize> {
        let fits = |step: &Step| step.ms * step.own * load <= most;
        self.steps.iter().rposition(fits)
    }

    /// Returns the fastest place whose errors are small enough, or else the most accurate.
    fn within(&self, holds: impl Fn(&Errors) -> bool) -> usize {
        let place = self.steps.iter().position(|step| holds(&step.errors));
        place.unwrap_or(self.steps.len() - 1)
    }

    fn go(&mut self, place: usize) {
        self.is_new |= place != self.place && !self.is_first;
        self.place = place;
    }
}

/// Divides a window's size, rounding up.
pub fn divided(size: [u32; 2], divisor: u32) -> [u32; 2] {
    size.map(|side| side.div_ceil(divisor))
}

#[cfg(test)]
mod tests {
    use super::super::front::Tuned;
    use super::*;

    /// A device whose frames take other times than a front says.
    struct Device {
        /// Factors on the front's times, by places.
        own: Vec<f64>,
        load: f64,
        /// Part by which a measured time is off at most.
        noise: f64,
        state: u64,
    }

    impl Device {
        fn new(places: usize, noise: f64, seed: u64) -> Device {
            let mut device = Device { own: Vec::new(), load: 1.0, noise, state: seed };
            device.own = (0..places).map(|_| 1.0 + 0.1 * device.random()).collect();
            device
        }

        /// Returns a number from -1 to 1.
        fn random(&mut self) -> f64 {
            self.state =
                self.state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.state >> 33) as f64 / (1u64 << 30) as f64 - 1.0
        }

        /// Draws frames. Returns their times without noise, and the places of those that differ
        /// from the one before.
        fn run(&mut self, governor: &mut Governor, frames: usize) -> (Vec<f64>, Vec<usize>) {
            let (mut times, mut changes) = (Vec::new(), Vec::new());
            for _ in 0..frames {
                let place = governor.place();
                let ms = governor.steps()[place].ms * self.own[place] * self.load;
                let seen = ms * (1.0 + self.noise * self.random());
                governor.after(place, Duration::from_secs_f64(seen / 1e3));
                times.push(ms);
                if governor.place() != place {
                    changes.push(governor.place());
                }
            }
            (times, changes)
        }
    }

    /// Returns a front of 32 tunings, each slower by 15 % than the one before.
    fn front() -> Front {
        let tuned = |k: i32| {
            let errors = Errors { px: 2.0 * 0.8f64.powi(k), depth: 0.001 * 0.8f64.powi(k) };
            Tuned {
                values: Vec::new(),
                mean: errors,
                most: errors,
                moving: errors,
                ms: [2.0 * 1.15f64.powi(k); 3],
                point_ms: 1.0,
                pixel_ms: 1.0,
                spread: 1.0,
            }
        };
        Front {
            device: "device".into(),
            driver: "driver".into(),
            is_cpu: true,
            scenes: Vec::new(),
            size: [1, 1],
            rounds: 1,
            tuned: (0..32).map(tuned).collect(),
        }
    }

    /// Noise of the simulated devices.
    const NOISE: f64 = 0.1;

    fn devices() -> impl Iterator<Item = (Governor, Device)> {
        (1..200).flat_map(|seed| {
            [0.0, NOISE].map(|noise| {
                let governor = Governor::new(&front(), Limit::Time(33.0));
                let device = Device::new(governor.steps().len(), noise, seed);
                (governor, device)
            })
        })
    }

    #[test]
    fn frames_take_at_most_a_tenth_more_than_asked_for_after_three_of_them() {
        for (mut governor, mut device) in devices() {
            let longest = 33.0 * LONGEST * (1.0 + device.noise);
            let (times, _) = device.run(&mut governor, 40);
            let late = times[3..].iter().filter(|ms| **ms > longest).count();
            // A tuning that is new may be late once.
            assert!(late <= 2, "{times:?}");
            assert!(times[3] > 33.0 * 0.5, "{times:?}");
        }
    }

    /// All points of files take many times as long as the sample that is seen before.
    #[test]
    fn the_first_frame_of_another_cloud_is_the_fastest() {
        for (mut governor, mut device) in devices() {
            let fresh = governor.clone();
            device.run(&mut governor, 40);
            assert!(governor.place() > 0);
            governor.restart();
            assert_eq!(governor, fresh);
        }
        let mut exact = Governor::new(&front(), Limit::Pixels(0.5));
        let place = exact.place();
        exact.restart();
        assert!(place > 0 && exact.place() == place);
    }

    #[test]
    fn a_load_is_answered_within_five_frames() {
        let (mut late, mut all) = (0, 0);
        for (mut governor, mut device) in devices() {
            let longest = 33.0 * LONGEST * (1.0 + device.noise);
            device.run(&mut governor, 40);
            // A spinning thread takes half of the device; it ends; a cloud of four times the
            // points.
            for load in [2.0, 1.0, 4.0] {
                device.load = load;
                let (times, _) = device.run(&mut governor, 100);
                all += 1;
                late += usize::from(times[5] > longest);
                let most = times[99].max(times[5]);
                assert!(most < 33.0 * 1.5 && times[99] > 33.0 * 0.5, "{load} {times:?}");
            }
        }
        assert!(late * 100 <= all, "{late} of {all}");
    }

    #[test]
    fn noise_makes_no_oscillation() {
        for (mut governor, mut device) in devices() {
            device.run(&mut governor, 40);
            let (_, changes) = device.run(&mut governor, 1000);
            assert!(changes.len() <= 4, "{changes:?}");
            if device.noise == 0.0 {
                assert_eq!(changes, Vec::<usize>::new());
            }
        }
    }

    #[test]
    fn one_late_frame_changes_nothing() {
        let mut governor = Governor::new(&front(), Limit::Time(33.0));
        let mut device = Device::new(32, 0.0, 1);
        device.run(&mut governor, 40);
        let place = governor.place();
        governor.after(place, Duration::from_secs(1));
        assert_eq!(governor.place(), place);
        assert_eq!(device.run(&mut governor, 100).1, Vec::<usize>::new());
    }

    #[test]
    fn an_error_gets_the_fastest_that_holds_it_and_no_time_changes_that() {
        let mut governor = Governor::new(&front(), Limit::Pixels(0.5));
        let place = governor.place();
        assert!(governor.steps()[place].errors.px <= 0.5);
        assert!(governor.steps()[place - 1].errors.px > 0.5);
        governor.after(place, Duration::from_secs(1));
        assert_eq!(governor.place(), place);
        governor.set_limit(Limit::Depth(1e-9));
        assert_eq!(governor.place(), 31);
    }
}
