//! Decides how finely frames are drawn: coarse while the view changes, fine when it rests.

use crate::frame::{MOVING_SAMPLES, STILL_SAMPLES};
use std::time::Duration;
use web_time::Instant;

/// A view that has not changed for this time is drawn with more rays per pixel.
const REST: Duration = Duration::from_millis(250);
/// While the view changes or tiles arrive, frames that would take longer are drawn with a half, a quarter or an eighth of the
/// pixels along each side.
const MAX_MOVING_FRAME: Duration = Duration::from_millis(45);
/// Longest frame of a resting view. A GPU draws it at once, and the user must wait for it to move on.
const MAX_STILL_FRAME: Duration = Duration::from_millis(400);
/// The same for the CPU ray-caster, which draws it in steps.
const MAX_STILL_FRAME_IN_STEPS: Duration = Duration::from_secs(4);
/// One that would take longer is drawn with one ray a pixel before.
const MAX_BLURRED: Duration = Duration::from_millis(300);
/// Duration of such a step: input is handled after it.
const STEP: Duration = Duration::from_millis(30);
/// Largest divisor of the number of pixels along a side.
const MAX_DIVISOR: u32 = 8;

/// How finely a frame is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameDetail {
    /// The frame has this fraction of the window's pixels along each side.
    pub divisor: u32,
    /// Rays along a pixel's side.
    pub samples: u32,
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
#[derive(Debug, Clone)]
pub struct FramePacer {
    last_change: Instant,
    frame_time: Duration,
    /// Estimated time of a frame with all pixels and one ray per pixel.
    full_frame_time: Duration,
    is_finished: bool,
    draws_in_steps: bool,
}

impl FramePacer {
    /// A pacer before the first frame. `draws_in_steps`: whether frames of a resting view are drawn in steps.
    pub fn new(now: Instant, draws_in_steps: bool) -> Self {
        // The estimate starts high, so that the first frame is coarse and appears early.
        let full_frame_time = MAX_MOVING_FRAME * (MAX_DIVISOR * MAX_DIVISOR);
        Self { last_change: now, frame_time: Duration::ZERO, full_frame_time, is_finished: false, draws_in_steps }
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
        let is_changing = now.duration_since(self.last_change) < REST;
        let is_final = !is_changing && is_settled;
        let mut divisor = 1;
        while !is_final && divisor < MAX_DIVISOR && self.full_frame_time / (divisor * divisor) > MAX_MOVING_FRAME {
            divisor *= 2;
        }
        let takes_at_most = |limit: Duration, samples: u32| self.full_frame_time * (samples * samples) <= limit;
        let still_limit = if self.draws_in_steps { MAX_STILL_FRAME_IN_STEPS } else { MAX_STILL_FRAME };
        let samples = if is_final {
            if takes_at_most(still_limit, STILL_SAMPLES) { STILL_SAMPLES } else { MOVING_SAMPLES }
        } else if takes_at_most(MAX_MOVING_FRAME, MOVING_SAMPLES) {
            MOVING_SAMPLES
        } else {
            1
        };
        FrameDetail { divisor, samples, is_final }
    }

    /// Ends a whole frame. Returns whether this was the first final frame of a view.
    pub fn end_frame(&mut self, frame: FrameTime, detail: FrameDetail, is_presented: bool) -> bool {
        self.frame_time = frame.all;
        self.full_frame_time = frame.scene * (detail.divisor * detail.divisor) / (detail.samples * detail.samples);
        let was_finished = self.is_finished;
        self.is_finished = detail.is_final && is_presented;
        self.is_finished && !was_finished
    }

    /// Ends a step that drew `share` of a frame with all pixels and the given rays along a pixel's side.
    pub fn end_step(&mut self, time: Duration, share: f64, samples: u32) {
        let frame_time = time.div_f64((share * f64::from(samples * samples)).max(1e-6));
        self.full_frame_time = (self.full_frame_time + frame_time) / 2;
    }

    /// The same for a frame that was drawn in steps.
    pub fn end_steps(&mut self) {
        self.is_finished = true;
    }

    /// Rays along a pixel's side that such a frame begins with.
    pub fn first_still_samples(&self, samples: u32) -> u32 {
        if self.full_frame_time * (samples * samples) > MAX_BLURRED { 1 } else { samples }
    }

    /// Number of rows of a step, of a frame with `height_px` rows and the given rays along a pixel's side.
    pub fn rows_per_step(&self, height_px: u32, samples: u32) -> u32 {
        let frame_secs = self.full_frame_time.as_secs_f64() * f64::from(samples * samples);
        let share = STEP.as_secs_f64() / frame_secs.max(1e-6);
        ((f64::from(height_px) * share) as u32).clamp(1, height_px.max(1))
    }

    /// Estimated time of a frame with all pixels and one ray per pixel.
    pub fn full_frame_time(&self) -> Duration {
        self.full_frame_time
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
        (!self.is_finished).then(|| self.last_change + REST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_coarse_while_the_view_changes_and_fine_after_a_rest() {
        let begin = Instant::now();
        let mut pacer = FramePacer::new(begin, false);
        pacer.full_frame_time = 3 * MAX_MOVING_FRAME;
        let coarse = FrameDetail { divisor: 2, samples: 1, is_final: false };
        assert_eq!(pacer.detail(begin, true), coarse);
        let later = begin + REST;
        assert_eq!(pacer.detail(later, false), coarse);
        let fine = FrameDetail { divisor: 1, samples: MOVING_SAMPLES, is_final: true };
        assert_eq!(pacer.detail(later, true), fine, "three rays along a side would take too long");
        let fast = FramePacer { full_frame_time: MAX_MOVING_FRAME / 4, ..pacer.clone() };
        let moving = FrameDetail { divisor: 1, samples: MOVING_SAMPLES, is_final: false };
        assert_eq!(fast.detail(begin, true), moving);
        assert_eq!(fast.detail(later, true), FrameDetail { samples: STILL_SAMPLES, ..fine });
        let in_steps = FramePacer { draws_in_steps: true, ..pacer.clone() };
        assert_eq!(in_steps.detail(later, true).samples, STILL_SAMPLES, "input does not wait for it");
        assert_eq!(in_steps.rows_per_step(900, 1), 200);
        assert_eq!(in_steps.rows_per_step(900, STILL_SAMPLES), 22);
        assert_eq!([&in_steps, &fast].map(|pacer| pacer.first_still_samples(STILL_SAMPLES)), [1, STILL_SAMPLES]);
        assert_eq!(pacer.final_frame_at(), Some(later));
        let time = FrameTime { scene: REST, all: REST };
        assert!(pacer.end_frame(time, fine, true));
        assert!(!pacer.end_frame(time, fine, true), "the final frame was drawn before");
        assert_eq!(pacer.final_frame_at(), None);
        pacer.end_step(REST, 0.25, 1);
        assert_eq!(pacer.full_frame_time, (REST / 4 + REST * 4) / 2);
        pacer.content_changed();
        assert!(pacer.final_frame_at().is_some());
    }
}
