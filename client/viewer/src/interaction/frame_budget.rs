//! The tolerated error by the machine's speed (Vacca 2008, 3.7): while frames take longer than the asked rate allows, a larger error
//! is tolerated, as Funkhouser and Séquin (1993) keep a frame's cost within a budget.
//!
//! Levels of detail are steps, so a factor that just suffices may not exist. What was too slow lately is not tried again at once, so
//! the factor does not swing between two levels.

/// Largest factor of the tolerated error: two levels of detail.
pub(super) const MAX_FACTOR: f64 = 4.0;
/// Factor by which it may rise in a second, and fall.
const RISE_PER_SEC: f64 = 8.0;
const FALL_PER_SEC: f64 = 1.5;
/// It rises while a frame takes more than this share of its budget, and falls while it takes less than that.
const MOST_LOAD: f64 = 1.1;
const LEAST_LOAD: f64 = 0.8;
/// A factor that was too small, times this, is the least one for some seconds of motion.
const MARGIN: f64 = 1.1;
const RETRY_SECS: f64 = 3.0;
/// Longest time that one frame counts for, in seconds: the factor must not jump after a pause.
const MAX_STEP_SECS: f64 = 0.1;

/// What the chosen tau is multiplied by, so that frames keep a rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameBudget {
    factor: f64,
    /// The least factor, and for how many more seconds of motion.
    least: f64,
    least_secs: f64,
}

impl Default for FrameBudget {
    fn default() -> Self {
        Self { factor: 1.0, least: 1.0, least_secs: 0.0 }
    }
}

impl FrameBudget {
    /// From 1 to [`MAX_FACTOR`].
    pub(super) fn factor(&self) -> f64 {
        self.factor
    }

    /// Takes in a frame of a changing view: the time that it takes with all pixels, in shares of its budget, and the seconds since the
    /// last frame.
    pub(super) fn update(&mut self, load: f64, secs: f64) {
        let secs = secs.clamp(0.0, MAX_STEP_SECS);
        self.least_secs -= secs;
        if self.least_secs <= 0.0 {
            self.least = 1.0;
        }
        if load > MOST_LOAD {
            self.least = (self.factor * MARGIN).min(MAX_FACTOR);
            self.least_secs = RETRY_SECS;
            self.factor = (self.factor * RISE_PER_SEC.powf(secs).min(load)).min(MAX_FACTOR);
        } else if load < LEAST_LOAD {
            let fallen = self.factor / FALL_PER_SEC.powf(secs);
            self.factor = fallen.max(self.least.min(self.factor));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flies for some seconds over a city whose frames take `load` of their budget at a factor. Returns the factors.
    fn fly(budget: &mut FrameBudget, secs: f64, load: impl Fn(f64) -> f64) -> Vec<f64> {
        let (mut factors, mut at) = (Vec::new(), 0.0);
        while at < secs {
            let load = load(budget.factor());
            let frame_secs = load / 30.0;
            budget.update(load, frame_secs);
            at += frame_secs;
            factors.push(budget.factor());
            assert!((1.0..=MAX_FACTOR).contains(&budget.factor()));
        }
        factors
    }

    /// How often factors turn round.
    fn turns(factors: &[f64]) -> usize {
        let steps: Vec<f64> = factors.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step != 0.0).collect();
        steps.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count()
    }

    #[test]
    fn the_rate_is_kept_and_fine_detail_comes_back() {
        let mut budget = FrameBudget::default();
        let hard = |factor: f64| 1.8 / factor;
        let factors = fly(&mut budget, 4.0, hard);
        assert!(factors.windows(2).all(|pair| (0.9..1.24).contains(&(pair[1] / pair[0]))), "it jumps: {factors:?}");
        assert!(hard(budget.factor()) <= MOST_LOAD && hard(budget.factor()) > LEAST_LOAD, "{budget:?}");
        assert_eq!(turns(&factors), 0, "it stays where it suffices: {factors:?}");
        fly(&mut budget, 8.0, |factor| 0.5 / factor);
        assert_eq!(budget.factor(), 1.0, "an easy view is as fine as chosen");
        fly(&mut budget, 8.0, |_| 20.0);
        assert_eq!(budget.factor(), MAX_FACTOR, "and a view that nothing helps is bounded");
    }

    #[test]
    fn it_does_not_swing_between_two_levels() {
        let mut budget = FrameBudget::default();
        // Too slow below a factor of 2, and far faster above.
        let factors = fly(&mut budget, 30.0, |factor| if factor < 2.0 { 1.4 } else { 0.5 });
        assert!(turns(&factors) <= 20, "{} turns in 30 seconds", turns(&factors));
        let slow = factors.iter().filter(|factor| **factor < 2.0).count();
        assert!(slow * 8 < factors.len(), "{slow} of {} frames are too slow", factors.len());
    }

    #[test]
    fn a_pause_counts_as_one_frame() {
        let mut budget = FrameBudget::default();
        budget.update(30.0, 600.0);
        assert!(budget.factor() < 1.25, "{budget:?}");
    }
}
