//! Decides how finely frames are drawn: coarse while the view changes, fine when it rests.

use insula_viewer::frame::{MOVING_SAMPLES, STILL_SAMPLES};
use std::time::{Duration, Instant};

/// A view that has not changed for this time is drawn with more rays per pixel.
const REST: Duration = Duration::from_millis(250);
/// While the view changes or tiles arrive, frames that would take longer are drawn with a half or a quarter of the pixels
/// along each side.
const MAX_MOVING_FRAME: Duration = Duration::from_millis(45);
/// Longest frame of a resting view. The user must not wait for it to move on.
const MAX_STILL_FRAME: Duration = Duration::from_millis(400);
/// Largest divisor of the number of pixels along a side.
const MAX_DIVISOR: u32 = 4;
/// Longest time step of the camera. Without a limit, it would jump after a stall.
const MAX_STEP_SECS: f64 = 0.2;

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

/// Measures frames and chooses the detail of the next one.
#[derive(Debug, Clone)]
pub struct FramePacer {
    last_frame: Instant,
    last_change: Instant,
    frame_time: Duration,
    /// Estimated time of a frame with all pixels and one ray per pixel.
    full_frame_time: Duration,
    is_finished: bool,
}

impl FramePacer {
    /// A pacer before the first frame.
    pub fn new(now: Instant) -> Self {
        // The estimate starts high, so that the first frame is coarse and appears early.
        let full_frame_time = MAX_MOVING_FRAME * (MAX_DIVISOR * MAX_DIVISOR);
        Self { last_frame: now, last_change: now, frame_time: Duration::ZERO, full_frame_time, is_finished: false }
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

    /// A movement begins: the time since the last frame is not part of it.
    pub fn movement_began(&mut self, now: Instant) {
        self.last_frame = now;
    }

    /// Begins a frame. Returns the seconds since the last one, limited to a fifth of a second.
    pub fn begin_frame(&mut self, now: Instant) -> f64 {
        let secs = now.duration_since(self.last_frame).as_secs_f64().min(MAX_STEP_SECS);
        self.last_frame = now;
        secs
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
        let samples = if is_final {
            if takes_at_most(MAX_STILL_FRAME, STILL_SAMPLES) { STILL_SAMPLES } else { MOVING_SAMPLES }
        } else if takes_at_most(MAX_MOVING_FRAME, MOVING_SAMPLES) {
            MOVING_SAMPLES
        } else {
            1
        };
        FrameDetail { divisor, samples, is_final }
    }

    /// Ends a frame that was drawn with `detail`. Returns whether this was the first final frame of a view.
    pub fn end_frame(&mut self, begin: Instant, detail: FrameDetail, is_presented: bool) -> bool {
        self.frame_time = begin.elapsed();
        self.full_frame_time = self.frame_time * (detail.divisor * detail.divisor) / (detail.samples * detail.samples);
        let was_finished = self.is_finished;
        self.is_finished = detail.is_final && is_presented;
        self.is_finished && !was_finished
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
        let mut pacer = FramePacer::new(begin);
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
        assert_eq!(pacer.final_frame_at(), Some(later));
        assert!(pacer.end_frame(later, fine, true));
        assert!(!pacer.end_frame(later, fine, true), "the final frame was drawn before");
        assert_eq!(pacer.final_frame_at(), None);
        pacer.content_changed();
        assert!(pacer.final_frame_at().is_some());
        assert!(pacer.begin_frame(begin + Duration::from_secs(9)) <= MAX_STEP_SECS);
    }
}
