//! Tau while the cache is full: it rises smoothly to what fits, and falls back.
//!
//! In: what a selection reached, how full it made the cache. Out: how many times what was asked for. Next: `flow` selects
//! with it.
//!
//! A selection by itself never exceeds its budget, but where it breaks off may differ from frame to frame. With a tau
//! that just fits it does not break off, so nothing comes and goes at the limit.

/// How many times larger it becomes in a second, and smaller.
const RISE: f64 = 8.0;
const FALL: f64 = 1.5;
/// It falls while less than this share of the budget is taken.
const ROOM: f64 = 0.9;
/// What has come so near is there.
const NEAR: f64 = 1.001;
/// Longest time that counts, in seconds: after a pause it must not leap.
const LEAP_SECS: f64 = 0.1;

/// What tau is multiplied by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AdaptiveThreshold {
    times: f64,
    /// It had to rise since the camera moved last: to fall again would be to and fro.
    rose: bool,
    moves: bool,
}

impl Default for AdaptiveThreshold {
    fn default() -> Self {
        Self { times: 1.0, rose: false, moves: false }
    }
}

impl AdaptiveThreshold {
    /// At least 1.
    pub(super) fn times(&self) -> f64 {
        self.times
    }

    /// Whether the next selection will be made with another one.
    pub(super) fn moves(&self) -> bool {
        self.moves
    }

    /// A selection reached `times` what was asked for and took `share` of its budget; `secs` since the last one, `moved`
    /// if that was of another view.
    pub(super) fn learn(&mut self, times: f64, share: f64, secs: f64, moved: bool) {
        let secs = secs.clamp(0.0, LEAP_SECS);
        self.rose &= !moved;
        if times > self.times * NEAR {
            self.times = (self.times * RISE.powf(secs)).min(times);
            self.rose = true;
            self.moves = true;
        } else if self.times > 1.0 && share < ROOM && !self.rose {
            self.times = (self.times / FALL.powf(secs)).max(1.0);
            self.moves = true;
        } else {
            self.moves = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A selection that takes its whole budget at four times what is asked for, and less with a larger tau.
    fn select(raised: &AdaptiveThreshold, fits: f64) -> (f64, f64) {
        if raised.times() < fits { (fits, 0.99) } else { (raised.times(), fits / raised.times()) }
    }

    #[test]
    fn it_rises_to_what_fits_rests_and_falls_back() {
        let mut raised = AdaptiveThreshold::default();
        let frames = |raised: &mut AdaptiveThreshold, fits: f64, moved: bool| {
            for frame in 1..1000 {
                let before = raised.times();
                let (times, share) = select(raised, fits);
                raised.learn(times, share, 0.016, moved);
                assert!((0.98..1.05).contains(&(raised.times() / before)), "a leap");
                if !raised.moves() {
                    return frame;
                }
            }
            panic!("never rests: {raised:?}");
        };
        assert!(frames(&mut raised, 4.0, false) > 10);
        assert!((4.0 / NEAR..=4.0).contains(&raised.times()));
        // A camera that flies on over what takes as much: nothing changes.
        assert_eq!(frames(&mut raised, 4.0, true), 1);
        // It comes to where more fits.
        assert!(frames(&mut raised, 2.0, true) > 10);
        assert!((2.0..2.3).contains(&raised.times()), "{raised:?}");
        frames(&mut raised, 0.5, true);
        assert_eq!(raised.times(), 1.0);
    }

    #[test]
    fn a_camera_that_stands_does_not_go_to_and_fro() {
        let mut raised = AdaptiveThreshold::default();
        // Steps so coarse that either too much is taken or far too little.
        let coarse =
            |raised: &AdaptiveThreshold| if raised.times() < 3.0 { (3.0, 0.99) } else { (raised.times(), 0.4) };
        let mut last = 0.0;
        for _ in 0..1000 {
            let (times, share) = coarse(&raised);
            raised.learn(times, share, 0.016, false);
            assert!(raised.times() >= last);
            last = raised.times();
        }
        assert!(!raised.moves() && (3.0 / NEAR..=3.0).contains(&raised.times()), "{raised:?}");
    }
}
