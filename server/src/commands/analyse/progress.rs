//! Progress of an analysis on standard error: a bar on a terminal, else a line now and then.

use super::super::bake_progress::{LINE_INTERVAL, left_text};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Shows how far an analysis is.
pub(super) struct AnalysisProgress {
    bar: ProgressBar,
    start: Instant,
    /// The share that was done before.
    first: f64,
    /// When the next line is due; `None` on a terminal.
    next_line: Option<Mutex<Instant>>,
}

impl AnalysisProgress {
    pub(super) fn start() -> Self {
        Self::start_from(0.0)
    }

    /// The same where a share was done by an earlier run, which says nothing of the time that is left.
    pub(super) fn start_from(first: f64) -> Self {
        let style = ProgressStyle::with_template("{wide_bar} {percent:>3}% {elapsed} (about {eta} left)");
        let bar = ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_position(position(first));
        bar.reset_eta();
        let start = Instant::now();
        let next_line = (!std::io::stderr().is_terminal()).then(|| Mutex::new(start + LINE_INTERVAL));
        Self { bar, start, first, next_line }
    }

    /// Shows the share that is done, 0 to 1.
    pub(super) fn at(&self, share: f64) {
        self.bar.set_position(position(share));
        // While one thread writes a line, others have nothing to add.
        let Some(mut next) = self.next_line.as_ref().and_then(|next| next.try_lock().ok()) else { return };
        let now = Instant::now();
        if now >= *next {
            *next = now + LINE_INTERVAL;
            eprintln!("{}", line(share, self.first, now.duration_since(self.start)));
        }
    }

    /// Ends the display.
    pub(super) fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// Of a bar.
fn position(share: f64) -> u64 {
    (share * 1000.0) as u64
}

/// The same words as those of a bake, without a stage.
fn line(share: f64, first: f64, elapsed: Duration) -> String {
    let left = (share > first && share < 1.0).then(|| elapsed.mul_f64((1.0 - share) / (share - first)));
    let left = left.map(left_text).unwrap_or_default();
    format!("analysing: {}% after {} s{left}", (share * 100.0) as u64, elapsed.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_plain() {
        let seconds = Duration::from_secs;
        assert_eq!(line(0.125, 0.0, Duration::from_millis(10_900)), "analysing: 12% after 10 s, 76 s left");
        assert_eq!(line(0.75, 0.5, seconds(600)), "analysing: 75% after 600 s, 10 min left");
        assert_eq!(line(0.5, 0.5, seconds(10)), "analysing: 50% after 10 s", "nothing has taken time yet");
    }
}
