//! The adaptive error threshold: raises tau smoothly while the cache is full, and lowers it again when there is room. While frames
//! are too slow, it is at least what the shell asks for ([`FramePacer::tau_factor`]).
//!
//! [`FramePacer::tau_factor`]: crate::interaction::frame_pacing::FramePacer::tau_factor
//!
//! A selection never exceeds its budget, but where it stops refining may differ from frame to frame. With a tau that just fits
//! it does not stop early, so nothing appears and disappears at the limit.

/// Factor by which the threshold may rise in a second.
const RISE_PER_SEC: f64 = 8.0;
/// Factor by which it may fall in a second.
const FALL_PER_SEC: f64 = 1.5;
/// It falls only while a selection takes less than this share of its budget.
const MAX_BUDGET_SHARE: f64 = 0.9;
/// Relative difference that counts as none.
const TOLERANCE: f64 = 1.001;
/// Longest time that one frame counts for, in seconds: the threshold must not jump after a pause.
const MAX_STEP_SECS: f64 = 0.1;

/// What the requested tau is multiplied by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AdaptiveThreshold {
    factor: f64,
    /// The least factor, by the machine's speed.
    for_speed: f64,
    /// It has risen since the camera last moved. It must not fall before the camera moves again, or it would oscillate.
    has_risen: bool,
    is_changing: bool,
}

/// The result of a selection, to which the threshold adapts.
#[derive(Debug, Clone, Copy)]
pub(super) struct SelectionOutcome {
    /// Error threshold that the selection reached, divided by the requested tau.
    pub(super) factor: f64,
    /// Share of the budget that it took.
    pub(super) budget_share: f64,
    /// Seconds since the last selection.
    pub(super) secs: f64,
    /// Whether the last selection was of another view.
    pub(super) has_moved: bool,
}

impl Default for AdaptiveThreshold {
    fn default() -> Self {
        Self { factor: 1.0, for_speed: 1.0, has_risen: false, is_changing: false }
    }
}

impl AdaptiveThreshold {
    /// The factor for the next selection, at least 1.
    pub(super) fn factor(&self) -> f64 {
        self.factor.max(self.for_speed)
    }

    /// Sets the least factor. Returns whether that changes it.
    pub(super) fn set_for_speed(&mut self, factor: f64) -> bool {
        let factor = factor.max(1.0);
        std::mem::replace(&mut self.for_speed, factor) != factor
    }

    /// Whether the next selection has another factor than the last one.
    pub(super) fn is_changing(&self) -> bool {
        self.is_changing
    }

    /// Adapts the factor to a selection.
    pub(super) fn update(&mut self, outcome: SelectionOutcome) {
        let secs = outcome.secs.clamp(0.0, MAX_STEP_SECS);
        self.has_risen &= !outcome.has_moved;
        self.is_changing = true;
        if outcome.factor > self.factor() * TOLERANCE {
            self.factor = (self.factor() * RISE_PER_SEC.powf(secs)).min(outcome.factor);
            self.has_risen = true;
        } else if self.factor > 1.0 && outcome.budget_share < MAX_BUDGET_SHARE && !self.has_risen {
            self.factor = (self.factor / FALL_PER_SEC.powf(secs)).max(1.0);
        } else {
            self.is_changing = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(factor: f64, budget_share: f64, has_moved: bool) -> SelectionOutcome {
        SelectionOutcome { factor, budget_share, secs: 0.016, has_moved }
    }

    /// A selection that just fits into its budget at factor `fits`, and takes less with a larger factor.
    fn select(threshold: &AdaptiveThreshold, fits: f64, has_moved: bool) -> SelectionOutcome {
        match threshold.factor() < fits {
            true => outcome(fits, 0.99, has_moved),
            false => outcome(threshold.factor(), fits / threshold.factor(), has_moved),
        }
    }

    #[test]
    fn rises_to_what_fits_settles_and_falls_back() {
        let mut threshold = AdaptiveThreshold::default();
        let frames_until_settled = |threshold: &mut AdaptiveThreshold, fits: f64, has_moved: bool| {
            for frame in 1..1000 {
                let before = threshold.factor();
                threshold.update(select(threshold, fits, has_moved));
                assert!((0.98..1.05).contains(&(threshold.factor() / before)), "it jumps");
                if !threshold.is_changing() {
                    return frame;
                }
            }
            panic!("never settles: {threshold:?}");
        };
        assert!(frames_until_settled(&mut threshold, 4.0, false) > 10);
        assert!((4.0 / TOLERANCE..=4.0).contains(&threshold.factor()));
        // The camera moves on, and the view needs as much as before.
        assert_eq!(frames_until_settled(&mut threshold, 4.0, true), 1);
        // The view needs less.
        assert!(frames_until_settled(&mut threshold, 2.0, true) > 10);
        assert!((2.0..2.3).contains(&threshold.factor()), "{threshold:?}");
        frames_until_settled(&mut threshold, 0.5, true);
        assert_eq!(threshold.factor(), 1.0);
    }

    #[test]
    fn does_not_oscillate_while_the_camera_is_still() {
        let mut threshold = AdaptiveThreshold::default();
        // So coarse a step that the selection takes either too much or far too little.
        let select = |threshold: &AdaptiveThreshold| match threshold.factor() < 3.0 {
            true => outcome(3.0, 0.99, false),
            false => outcome(threshold.factor(), 0.4, false),
        };
        let mut last = 0.0;
        for _ in 0..1000 {
            threshold.update(select(&threshold));
            assert!(threshold.factor() >= last);
            last = threshold.factor();
        }
        assert!(!threshold.is_changing() && (3.0 / TOLERANCE..=3.0).contains(&threshold.factor()), "{threshold:?}");
    }

    #[test]
    fn the_larger_of_memory_and_speed_decides() {
        let mut threshold = AdaptiveThreshold::default();
        assert!(threshold.set_for_speed(3.0) && !threshold.set_for_speed(3.0));
        assert_eq!(threshold.factor(), 3.0);
        // What is selected with it fits, so memory asks for nothing.
        threshold.update(outcome(3.0, 0.5, true));
        assert_eq!((threshold.factor, threshold.is_changing()), (1.0, false));
        // It does not fit: the threshold rises from there.
        threshold.update(outcome(6.0, 0.99, true));
        assert!((3.0..3.2).contains(&threshold.factor()), "{threshold:?}");
        threshold.set_for_speed(f64::NAN);
        assert!((3.0..3.2).contains(&threshold.factor()), "{threshold:?}");
    }
}
