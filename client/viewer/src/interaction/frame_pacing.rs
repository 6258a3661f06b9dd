//! Decides how finely frames are drawn: coarse while the view changes, fine when it rests.
//!
//! Where a changing view has no time for its frames, it first loses its second ray a pixel, then detail
//! ([`FramePacer::tau_factor`]), and only then pixels.

use super::frame_budget::FrameBudget;
use crate::frame::{MOVING_SAMPLES, STILL_SAMPLES};
use std::ops::RangeInclusive;
use std::time::Duration;
use web_time::Instant;

/// A view that has not changed for this time is drawn with more rays per pixel.
const REST: Duration = Duration::from_millis(250);
/// The same for the CPU ray-caster, whose steps input never waits for: full quality is to be there half a second after the last
/// motion.
const REST_IN_STEPS: Duration = Duration::from_millis(100);
/// Frames a second that a changing view is to have, unless a shell asks for another number.
pub const FRAME_RATE: f64 = 30.0;
/// Frame rates that can be asked for.
pub const FRAME_RATES: RangeInclusive<f64> = 5.0..=240.0;
/// Most of a frame's time that is taken for independent of its pixels. Two frames of different sizes may differ by chance.
const MAX_FIXED_SHARE: f64 = 0.75;
/// Longest frame of a resting view. A GPU draws it at once, and the user must wait for it to move on.
const MAX_STILL_FRAME: Duration = Duration::from_millis(400);
/// The same for the CPU ray-caster, which draws it in steps.
const MAX_STILL_FRAME_IN_STEPS: Duration = Duration::from_secs(4);
/// One that would take longer is drawn with one ray a pixel before.
const MAX_BLURRED: Duration = Duration::from_millis(400);
/// Duration of such a step: input is handled after it.
pub const STEP: Duration = Duration::from_millis(30);
/// Largest divisor of the number of pixels along a side.
const MAX_DIVISOR: u32 = 8;
/// That of the first frame, of which nothing is known: on a slow machine it is early, and on a fast one no mosaic.
const FIRST_DIVISOR: u32 = 4;
/// Most rays along a pixel's side whose frames are measured apart.
const MAX_PACED: usize = STILL_SAMPLES as usize;
/// Duration of a frame with 1, 2, ... rays along a pixel's side in relation to one with a single ray, before one was measured: the
/// CPU ray-caster casts all of them only where neighbouring pixels differ.
const ADAPTIVE_COST: [f64; MAX_PACED] = [1.0, 2.5, 5.0];

/// How finely a frame is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameDetail {
    /// The frame has this fraction of the window's pixels along each side.
    pub divisor: u32,
    /// Rays along a pixel's side.
    pub samples: u32,
    /// Whether the view changes, and does not only wait for tiles.
    pub is_changing: bool,
    /// Whether no later frame of this view will be finer.
    pub is_final: bool,
}

/// How long a frame took.
#[derive(Debug, Clone, Copy)]
pub struct FrameTime {
    /// Drawing the scene.
    pub scene: Duration,
    /// Everything.
    pub all: Duration,
}

/// Measures frames and chooses the detail of the next one.
///
/// How long a frame takes with more rays a pixel is learnt, because it depends on the view: where sampling is adaptive, nine rays cost
/// between two and nine times as much as one.
#[derive(Debug, Clone)]
pub struct FramePacer {
    last_change: Instant,
    frame_time: Duration,
    /// Time of a frame besides the scene.
    overhead: Duration,
    /// Estimated time of a frame with all pixels, by the rays along a pixel's side.
    full_frame_times: [Duration; MAX_PACED],
    /// Part of the scene's time that does not depend on the number of pixels.
    fixed: Duration,
    /// Rays along a pixel's side of the frame that was measured last.
    last_samples: u32,
    /// Divisor and time of the scene of the last whole frame.
    last_frame: Option<(u32, Duration)>,
    is_finished: bool,
    draws_in_steps: bool,
    /// Time of a frame of a changing view.
    budget: Duration,
    detail_budget: FrameBudget,
}

impl FramePacer {
    /// A pacer before the first frame. `draws_in_steps`: whether frames of a resting view are drawn in steps.
    pub fn new(now: Instant, draws_in_steps: bool) -> Self {
        // The estimate starts high, so that the first frame is coarse and appears early.
        let budget = budget_of(FRAME_RATE);
        let first = moving_limit(budget) * (FIRST_DIVISOR * FIRST_DIVISOR);
        let cost = |i: usize| if draws_in_steps { ADAPTIVE_COST[i] } else { ((i + 1) * (i + 1)) as f64 };
        Self {
            last_change: now,
            frame_time: Duration::ZERO,
            overhead: Duration::ZERO,
            full_frame_times: std::array::from_fn(|i| first.mul_f64(cost(i))),
            fixed: Duration::ZERO,
            last_samples: 1,
            last_frame: None,
            is_finished: false,
            draws_in_steps,
            budget,
            detail_budget: FrameBudget::default(),
        }
    }

    /// Starts again for another ray-caster, and keeps the frame rate.
    pub fn restart(&mut self, now: Instant, draws_in_steps: bool) {
        *self = Self { budget: self.budget, ..Self::new(now, draws_in_steps) };
    }

    /// Sets the frames a second that a changing view is to have. Others than [`FRAME_RATES`] become the nearest of them.
    pub fn set_frame_rate(&mut self, rate: f64) {
        let rate = if rate.is_nan() { FRAME_RATE } else { rate.clamp(*FRAME_RATES.start(), *FRAME_RATES.end()) };
        self.budget = budget_of(rate);
    }

    /// What the chosen tau is multiplied by: more than 1 only while the view changes, on a machine that would not have the frame rate
    /// with it.
    pub fn tau_factor(&self, now: Instant) -> f64 {
        if self.is_changing(now) { self.detail_budget.factor() } else { 1.0 }
    }

    fn is_changing(&self, now: Instant) -> bool {
        now.duration_since(self.last_change) < self.rest()
    }

    /// The part of a time for a frame that is for the scene: at least half of it. Where the rest takes long, the scene is not made ever
    /// coarser for it.
    fn for_scene(&self, frame: Duration) -> Duration {
        frame.saturating_sub(self.overhead).max(frame / 2)
    }

    /// The view changed: frames are coarse until it rests.
    pub fn view_changed(&mut self, now: Instant) {
        self.last_change = now;
        self.is_finished = false;
    }

    /// Tiles arrived: the view is the same but its frame may improve.
    pub fn content_changed(&mut self) {
        self.is_finished = false;
    }

    /// The detail of the next frame. `is_settled`: all tiles of the view are resident.
    pub fn detail(&self, now: Instant, is_settled: bool) -> FrameDetail {
        let is_changing = self.is_changing(now);
        let is_final = !is_changing && is_settled;
        let moving_limit = self.for_scene(moving_limit(self.budget));
        let mut divisor = 1;
        while !is_final && divisor < MAX_DIVISOR && self.estimate_divided(divisor) > moving_limit {
            divisor *= 2;
        }
        let still_limit = if self.draws_in_steps { MAX_STILL_FRAME_IN_STEPS } else { MAX_STILL_FRAME };
        let samples = if is_final {
            if self.estimate(STILL_SAMPLES) <= still_limit { STILL_SAMPLES } else { MOVING_SAMPLES }
        } else if self.estimate(MOVING_SAMPLES) <= self.for_scene(self.budget) && self.tau_factor(now) == 1.0 {
            MOVING_SAMPLES
        } else {
            1
        };
        FrameDetail { divisor, samples, is_changing, is_final }
    }

    /// How long a view must not change before it rests.
    fn rest(&self) -> Duration {
        if self.draws_in_steps { REST_IN_STEPS } else { REST }
    }

    /// Estimated time of a frame with all pixels.
    fn estimate(&self, samples: u32) -> Duration {
        self.full_frame_times[place_of(samples)]
    }

    /// Estimated time of a frame with a ray a pixel and this fraction of the pixels along each side.
    fn estimate_divided(&self, divisor: u32) -> Duration {
        let full = self.estimate(1);
        let fixed = self.fixed.min(full);
        fixed + (full - fixed) / (divisor * divisor)
    }

    /// Learns from two frames with different numbers of pixels how much of their time does not depend on these.
    fn learn_fixed(&mut self, scene: Duration, detail: FrameDetail) {
        let last = self.last_frame.replace((detail.divisor, scene));
        let Some((last_divisor, last_scene)) = last.filter(|_| detail.samples == self.last_samples) else { return };
        let pixels = |divisor: u32| 1.0 / f64::from(divisor * divisor);
        let more_pixels = pixels(detail.divisor) - pixels(last_divisor);
        if more_pixels == 0.0 {
            return;
        }
        let per_pixel = (scene.as_secs_f64() - last_scene.as_secs_f64()) / more_pixels;
        let least = scene.min(last_scene).as_secs_f64();
        let fixed = (scene.as_secs_f64() - per_pixel * pixels(detail.divisor)).clamp(0.0, MAX_FIXED_SHARE * least);
        self.fixed = Duration::from_secs_f64(fixed);
    }

    /// Takes in the time of a frame with all pixels.
    fn measured(&mut self, time: Duration, samples: u32) {
        let place = place_of(samples);
        let change = time.as_secs_f64() / self.full_frame_times[place].as_secs_f64().max(1e-6);
        if samples == self.last_samples {
            // The view has become harder or easier, for all frames.
            self.full_frame_times =
                self.full_frame_times.map(|time| time.mul_f64(change.clamp(1e-3, 1e3)).min(MAX_ESTIMATE));
        }
        self.full_frame_times[place] = time.min(MAX_ESTIMATE);
        self.last_samples = samples;
        // More rays take longer, but at most in proportion.
        let most = |i: usize, from: usize| ((i + 1) * (i + 1)) as f64 / ((from + 1) * (from + 1)) as f64;
        for i in 0..MAX_PACED {
            let (least, greatest) = match i < place {
                true => (time.mul_f64(most(i, place)), time),
                false => (time, time.mul_f64(most(i, place))),
            };
            self.full_frame_times[i] = self.full_frame_times[i].max(least).min(greatest).min(MAX_ESTIMATE);
        }
    }

    /// Ends a whole frame. Returns whether this was the first final frame of a view.
    pub fn end_frame(&mut self, frame: FrameTime, detail: FrameDetail, is_presented: bool) -> bool {
        self.frame_time = frame.all;
        self.overhead = (self.overhead + frame.all.saturating_sub(frame.scene)) / 2;
        self.learn_fixed(frame.scene, detail);
        let fixed = self.fixed.min(frame.scene);
        self.measured(fixed + (frame.scene - fixed) * (detail.divisor * detail.divisor), detail.samples);
        if detail.is_changing {
            let load = self.estimate(1).as_secs_f64() / self.for_scene(self.budget).as_secs_f64();
            self.detail_budget.update(load, frame.all.as_secs_f64());
        }
        let was_finished = self.is_finished;
        self.is_finished = detail.is_final && is_presented;
        self.is_finished && !was_finished
    }

    /// Ends a step that drew `share` of a frame with all pixels and the given rays along a pixel's side.
    pub fn end_step(&mut self, time: Duration, share: f64, samples: u32) {
        let frame_time = time.div_f64(share.max(1e-6)).min(MAX_ESTIMATE);
        let place = place_of(samples);
        self.full_frame_times[place] = (self.full_frame_times[place] + frame_time) / 2;
    }

    /// The same for a frame that was drawn in steps.
    pub fn end_steps(&mut self) {
        self.is_finished = true;
    }

    /// Rays along a pixel's side that such a frame begins with.
    pub fn first_still_samples(&self, samples: u32) -> u32 {
        if self.estimate(samples) > MAX_BLURRED { 1 } else { samples }
    }

    /// Number of rows of a step, of a frame with `height_px` rows and the given rays along a pixel's side.
    pub fn rows_per_step(&self, height_px: u32, samples: u32) -> u32 {
        let share = STEP.as_secs_f64() / self.estimate(samples).as_secs_f64().max(1e-6);
        ((f64::from(height_px) * share) as u32).clamp(1, height_px.max(1))
    }

    /// Estimated time of a frame with all pixels and one ray per pixel.
    pub fn full_frame_time(&self) -> Duration {
        self.estimate(1)
    }

    /// How long the view has not changed.
    pub fn since_change(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.last_change)
    }

    /// Duration of the last frame.
    pub fn frame_time(&self) -> Duration {
        self.frame_time
    }

    /// Whether the final frame of the view is on the screen.
    pub fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// When the final frame is due; `None` if it is on the screen.
    pub fn final_frame_at(&self) -> Option<Instant> {
        (!self.is_finished).then(|| self.last_change + self.rest())
    }
}

/// Time of a frame at a frame rate.
fn budget_of(rate: f64) -> Duration {
    Duration::from_nanos((1e9 / rate) as u64)
}

/// While the view changes or tiles arrive, frames that would take longer, with everything besides the scene, are drawn with a half, a
/// quarter or an eighth of the pixels along each side. Below, detail is to do.
fn moving_limit(budget: Duration) -> Duration {
    budget + budget / 2
}

/// Longest time of a frame that is told from longer ones.
const MAX_ESTIMATE: Duration = Duration::from_secs(3600);

/// Where the time of a frame with these rays along a pixel's side is kept.
fn place_of(samples: u32) -> usize {
    (samples.max(1) as usize).min(MAX_PACED) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOVING_FRAME: Duration = Duration::from_millis(48);

    /// A pacer whose frames take `time` with a ray a pixel, and in proportion with more.
    fn pacer_of(begin: Instant, draws_in_steps: bool, time: Duration) -> FramePacer {
        let full_frame_times = [time, time * 4, time * 9];
        FramePacer { full_frame_times, ..FramePacer::new(begin, draws_in_steps) }
    }

    #[test]
    fn frames_are_coarse_while_the_view_changes_and_fine_after_a_rest() {
        let begin = Instant::now();
        let mut pacer = pacer_of(begin, false, 3 * MOVING_FRAME);
        let coarse = FrameDetail { divisor: 2, samples: 1, is_changing: true, is_final: false };
        assert_eq!(pacer.detail(begin, true), coarse);
        let later = begin + REST;
        assert_eq!(pacer.detail(later, false), FrameDetail { is_changing: false, ..coarse });
        let fine = FrameDetail { divisor: 1, samples: MOVING_SAMPLES, is_changing: false, is_final: true };
        assert_eq!(pacer.detail(later, true), fine, "three rays along a side would take too long");
        let fast = pacer_of(begin, false, MOVING_FRAME / 6);
        let moving = FrameDetail { divisor: 1, samples: MOVING_SAMPLES, is_changing: true, is_final: false };
        assert_eq!(fast.detail(begin, true), moving);
        assert_eq!(fast.detail(later, true), FrameDetail { samples: STILL_SAMPLES, ..fine });
        let in_steps = pacer_of(begin, true, 3 * MOVING_FRAME);
        assert_eq!(in_steps.detail(begin + REST_IN_STEPS, true).samples, STILL_SAMPLES, "input does not wait for it");
        assert_eq!(in_steps.rows_per_step(960, 1), 200);
        assert_eq!(in_steps.rows_per_step(960, STILL_SAMPLES), 22);
        assert_eq!([&in_steps, &fast].map(|pacer| pacer.first_still_samples(STILL_SAMPLES)), [1, STILL_SAMPLES]);
        assert_eq!(pacer.final_frame_at(), Some(later));
        let time = FrameTime { scene: REST, all: REST };
        assert!(pacer.end_frame(time, fine, true));
        assert!(!pacer.end_frame(time, fine, true), "the final frame was drawn before");
        assert_eq!(pacer.final_frame_at(), None);
        let before = pacer.full_frame_time();
        pacer.end_step(REST, 0.25, 1);
        assert_eq!(pacer.full_frame_time(), (before + REST * 4) / 2);
        pacer.content_changed();
        assert!(pacer.final_frame_at().is_some());
    }

    #[test]
    fn the_first_frame_is_early_and_no_mosaic() {
        let begin = Instant::now();
        for draws_in_steps in [false, true] {
            let detail = FramePacer::new(begin, draws_in_steps).detail(begin, false);
            assert_eq!((detail.divisor, detail.samples), (4, 1));
        }
    }

    #[test]
    fn the_cost_of_more_rays_is_learnt() {
        let begin = Instant::now();
        let mut pacer = FramePacer::new(begin, true);
        let draw = |pacer: &mut FramePacer, samples: u32, ms: u64| {
            let scene = Duration::from_millis(ms);
            let detail = FrameDetail { divisor: 1, samples, is_changing: true, is_final: false };
            pacer.end_frame(FrameTime { scene, all: scene }, detail, true);
        };
        draw(&mut pacer, 1, 20);
        assert_eq!(pacer.estimate(2), Duration::from_millis(50), "before it is known");
        draw(&mut pacer, 2, 30);
        let known = pacer.full_frame_times;
        assert_eq!(known[..2], [Duration::from_millis(20), Duration::from_millis(30)]);
        // An easier view is easier for all.
        draw(&mut pacer, 2, 15);
        assert_eq!(pacer.full_frame_times, known.map(|time| time / 2));
        // Nine rays take as long as one at least, and nine times as long at most.
        draw(&mut pacer, 1, 2);
        assert!(pacer.estimate(3) <= Duration::from_millis(18), "{:?}", pacer.full_frame_times);
        draw(&mut pacer, 1, 400);
        assert!(pacer.estimate(3) >= Duration::from_millis(400), "{:?}", pacer.full_frame_times);
    }

    #[test]
    fn the_time_that_does_not_depend_on_pixels_is_learnt() {
        let begin = Instant::now();
        let mut pacer = FramePacer::new(begin, true);
        let draw = |pacer: &mut FramePacer| {
            let divisor = pacer.detail(begin, false).divisor;
            // 6 ms and 72 ms for all pixels.
            let scene = Duration::from_micros(6000 + 72_000 / u64::from(divisor * divisor));
            pacer.end_frame(
                FrameTime { scene, all: scene },
                FrameDetail { divisor, samples: 1, is_changing: true, is_final: false },
                true,
            );
            divisor
        };
        let divisors: Vec<u32> = (0..6).map(|_| draw(&mut pacer)).collect();
        assert_eq!((divisors[0], divisors[5]), (FIRST_DIVISOR, 2), "{divisors:?}");
        assert!(pacer.full_frame_time().abs_diff(Duration::from_millis(78)) < Duration::from_millis(1));
        // A frame that took long by chance is forgotten with the next one.
        let slow = Duration::from_millis(90);
        pacer.end_frame(
            FrameTime { scene: slow, all: slow },
            FrameDetail { divisor: 2, samples: 1, is_changing: true, is_final: false },
            true,
        );
        let divisors: Vec<u32> = (0..6).map(|_| draw(&mut pacer)).collect();
        assert_eq!(divisors[5], 2, "{divisors:?}");
    }

    #[test]
    fn a_moving_frame_leaves_time_for_what_is_not_the_scene() {
        let begin = Instant::now();
        let mut pacer = pacer_of(begin, true, Duration::from_millis(40));
        assert_eq!(pacer.detail(begin, true).divisor, 1);
        let detail = FrameDetail { divisor: 1, samples: 1, is_changing: true, is_final: false };
        let time = FrameTime { scene: Duration::from_millis(40), all: Duration::from_millis(70) };
        for _ in 0..8 {
            pacer.end_frame(time, detail, true);
        }
        assert_eq!(pacer.detail(begin, true).divisor, 2, "30 ms are for the rest of the frame");
    }

    /// Flies for `frames` frames whose scene takes `ms` with all pixels, one ray a pixel and a factor of tau of 1, and less with
    /// larger ones. Returns the divisors.
    fn fly(pacer: &mut FramePacer, now: Instant, frames: usize, ms: f64) -> Vec<u32> {
        let frame = |pacer: &mut FramePacer| {
            pacer.view_changed(now);
            let detail = pacer.detail(now, false);
            let rays = f64::from(detail.samples * detail.samples) / f64::from(detail.divisor * detail.divisor);
            let scene = Duration::from_secs_f64(ms / 1e3 * rays / pacer.tau_factor(now).sqrt());
            pacer.end_frame(FrameTime { scene, all: scene }, detail, true);
            detail.divisor
        };
        (0..frames).map(|_| frame(pacer)).collect()
    }

    #[test]
    fn a_slow_machine_loses_detail_before_pixels() {
        let begin = Instant::now();
        let mut pacer = FramePacer::new(begin, true);
        fly(&mut pacer, begin, 100, 55.0);
        let factor = pacer.tau_factor(begin);
        let ms = pacer.full_frame_time().as_secs_f64() * 1e3;
        assert!((2.0..4.0).contains(&factor) && ms < 1.11e3 / FRAME_RATE, "{ms} ms at {factor}");
        assert!(fly(&mut pacer, begin, 100, 55.0).iter().all(|divisor| *divisor == 1));
        // Detail alone does not do, so pixels go too.
        assert!(fly(&mut pacer, begin, 100, 400.0)[50..].iter().all(|divisor| *divisor > 1));
        assert_eq!(pacer.tau_factor(begin), 4.0);
        // A view that rests has the chosen detail and all pixels, at once.
        let later = begin + REST_IN_STEPS;
        assert_eq!(pacer.tau_factor(later), 1.0);
        assert_eq!(
            pacer.detail(later, true),
            FrameDetail { divisor: 1, samples: 3, is_changing: false, is_final: true }
        );
    }

    #[test]
    fn frames_that_wait_for_tiles_say_nothing_about_detail() {
        let begin = Instant::now();
        let mut pacer = FramePacer::new(begin, true);
        let scene = Duration::from_millis(200);
        for _ in 0..100 {
            let detail = pacer.detail(begin + REST_IN_STEPS, false);
            pacer.end_frame(FrameTime { scene, all: scene }, detail, true);
        }
        assert_eq!(pacer.tau_factor(begin), 1.0);
    }

    #[test]
    fn the_frame_rate_is_that_of_the_shell() {
        let begin = Instant::now();
        let factor_at = |rate: f64| {
            let mut pacer = FramePacer::new(begin, true);
            pacer.set_frame_rate(rate);
            fly(&mut pacer, begin, 200, 30.0);
            pacer.tau_factor(begin)
        };
        assert_eq!([factor_at(f64::NAN), factor_at(5.0), factor_at(0.0)], [1.0; 3]);
        assert!(factor_at(60.0) > 2.0);
    }
}
