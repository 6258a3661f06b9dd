//! The day animation: runs the time of day, and repeats the day.

use crate::sun::Daylight;
use std::time::Duration;
use web_time::Instant;

/// Longest step. Without a limit, the sun would jump after a stall.
const MAX_STEP: Duration = Duration::from_millis(500);
/// Selectable durations of a day, in seconds.
pub const DAY_SECS: std::ops::RangeInclusive<f64> = 4.0..=240.0;

/// Whether the time of day runs, and how fast.
#[derive(Debug, Clone, PartialEq)]
pub struct DayAnimation {
    /// Duration of 24 hours, within [`DAY_SECS`].
    pub day_secs: f64,
    /// Time of the last step, while the animation runs.
    last_step: Option<Instant>,
}

impl Default for DayAnimation {
    /// A paused day of 24 seconds.
    fn default() -> Self {
        Self { day_secs: 24.0, last_step: None }
    }
}

impl DayAnimation {
    /// Whether the time runs.
    pub fn is_running(&self) -> bool {
        self.last_step.is_some()
    }

    /// Starts or pauses.
    pub fn toggle(&mut self, now: Instant) {
        self.last_step = if self.is_running() { None } else { Some(now) };
    }

    /// Moves the hour of `daylight`, and keeps its date. A fixed bearing of the sun ends. Returns whether the time runs.
    pub fn advance(&mut self, daylight: &mut Daylight, now: Instant) -> bool {
        let Some(last) = self.last_step.replace(now) else {
            self.last_step = None;
            return false;
        };
        let step = now.duration_since(last).min(MAX_STEP);
        let hours_per_sec = 24.0 / self.day_secs.clamp(*DAY_SECS.start(), *DAY_SECS.end());
        daylight.hour = (daylight.hour + step.as_secs_f64() * hours_per_sec).rem_euclid(24.0);
        daylight.fixed_bearing = None;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sun::SunOptions;

    #[test]
    fn a_day_takes_its_seconds_and_repeats() {
        let mut daylight = Daylight::new(&SunOptions::default(), &insula_test_support::small_city::empty_manifest(0));
        let (date, begin, mut day) = (daylight.date, Instant::now(), DayAnimation::default());
        assert!(!day.advance(&mut daylight, begin) && !day.is_running() && daylight.hour == 14.5);
        day.toggle(begin);
        for tenth in 1..=100 {
            assert!(day.advance(&mut daylight, begin + Duration::from_millis(100) * tenth));
        }
        assert!((daylight.hour - 2.5).abs() < 1e-6 && daylight.date == date, "{}", daylight.hour);
        day.day_secs = 240.0;
        day.advance(&mut daylight, begin + Duration::from_secs(90));
        assert!((daylight.hour - 2.55).abs() < 1e-6, "a stall takes at most half a second: {}", daylight.hour);
        day.toggle(begin);
        assert!(!day.advance(&mut daylight, begin + Duration::from_secs(99)));
    }
}
