//! When frames are drawn, and how finely: coarse while something moves, fine after a rest.
//!
//! In: changes, how long frames take. Out: [`Detail`]s, times to wake. Next: `city` draws.

use insula_viewer::frame::{MOVING_SAMPLES, STILL_SAMPLES};
use std::time::{Duration, Instant};

/// A standing picture is drawn again with more rays a pixel after so long.
const REST: Duration = Duration::from_millis(250);
/// While something moves or arrives, frames slower than this are drawn with fewer pixels: a half or a quarter a side.
const SLOW: Duration = Duration::from_millis(45);
/// A standing picture may take so long: who moves on must not wait for it.
const LONG: Duration = Duration::from_millis(400);
/// Coarsest.
const DIVIDE_MOST: u32 = 4;
/// Longest step of a camera: a stall must not become a leap.
const LEAP_SECS: f64 = 0.2;

/// How finely a frame is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Detail {
    /// Pixels of the window along a side of one that is drawn.
    pub divide: u32,
    /// Rays along a pixel's side.
    pub samples: u32,
    /// As good as it gets.
    pub fine: bool,
}

/// The rhythm of frames.
#[derive(Debug, Clone)]
pub struct Pace {
    last_frame: Instant,
    last_change: Instant,
    frame_time: Duration,
    /// What a frame of all pixels, one ray each, takes.
    full_time: Duration,
    rested: bool,
}

impl Pace {
    /// Nothing drawn yet.
    pub fn new(now: Instant) -> Self {
        // As slow as can be, until it is known: the first picture must not be late.
        let (frame_time, full_time) = (Duration::ZERO, SLOW * (DIVIDE_MOST * DIVIDE_MOST));
        Self { last_frame: now, last_change: now, frame_time, full_time, rested: false }
    }

    /// The picture will differ: draw soon, and finely only after a rest.
    pub fn changed(&mut self, now: Instant) {
        self.last_change = now;
        self.rested = false;
    }

    /// Something arrived that may make the picture better.
    pub fn stir(&mut self) {
        self.rested = false;
    }

    /// A movement begins: the time that nothing moved does not count.
    pub fn restart(&mut self, now: Instant) {
        self.last_frame = now;
    }

    /// A frame begins; seconds since the last one.
    pub fn begin(&mut self, now: Instant) -> f64 {
        let secs = now.duration_since(self.last_frame).as_secs_f64().min(LEAP_SECS);
        self.last_frame = now;
        secs
    }

    /// How finely to draw, so that a frame is not slow while anything changes.
    pub fn detail(&self, now: Instant, settled: bool) -> Detail {
        let restless = now.duration_since(self.last_change) < REST;
        let mut divide = 1;
        while (restless || !settled) && divide < DIVIDE_MOST && self.full_time / (divide * divide) > SLOW {
            divide *= 2;
        }
        let fine = !restless && settled;
        let affordable = self.full_time * (MOVING_SAMPLES * MOVING_SAMPLES) <= SLOW;
        let stills =
            if self.full_time * (STILL_SAMPLES * STILL_SAMPLES) <= LONG { STILL_SAMPLES } else { MOVING_SAMPLES };
        let samples = match (fine, affordable) {
            (true, _) => stills,
            (false, true) => MOVING_SAMPLES,
            (false, false) => 1,
        };
        Detail { divide, samples, fine }
    }

    /// A frame ends; returns whether a picture that changed is now as good as it gets.
    pub fn end(&mut self, begin: Instant, detail: Detail, shown: bool) -> bool {
        self.frame_time = begin.elapsed();
        self.full_time = self.frame_time * (detail.divide * detail.divide) / (detail.samples * detail.samples);
        let before = self.rested;
        self.rested = detail.fine && shown;
        self.rested && !before
    }

    /// What the last frame took.
    pub fn frame_time(&self) -> Duration {
        self.frame_time
    }

    /// Whether the last picture was as good as it gets, and nothing has happened since.
    pub fn is_rested(&self) -> bool {
        self.rested
    }

    /// When a finer picture is due.
    pub fn rest_at(&self) -> Option<Instant> {
        (!self.rested).then(|| self.last_change + REST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_while_it_moves_and_fine_after_a_rest() {
        let begin = Instant::now();
        let mut pace = Pace::new(begin);
        pace.full_time = 3 * SLOW;
        let coarse = Detail { divide: 2, samples: 1, fine: false };
        assert_eq!(pace.detail(begin, true), coarse);
        let later = begin + REST;
        assert_eq!(pace.detail(later, false), coarse);
        let rested = Detail { divide: 1, samples: MOVING_SAMPLES, fine: true };
        assert_eq!(pace.detail(later, true), rested, "three rays a side would take too long");
        let quick = Pace { full_time: SLOW / 4, ..pace.clone() };
        assert_eq!(quick.detail(begin, true), Detail { divide: 1, samples: MOVING_SAMPLES, fine: false });
        assert_eq!(quick.detail(later, true), Detail { samples: STILL_SAMPLES, ..rested });
        assert_eq!(pace.rest_at(), Some(later));
        assert!(pace.end(later, rested, true));
        assert!(!pace.end(later, rested, true), "it rested before");
        assert_eq!(pace.rest_at(), None);
        pace.stir();
        assert!(pace.rest_at().is_some());
        assert!(pace.begin(begin + Duration::from_secs(9)) <= LEAP_SECS);
    }
}
