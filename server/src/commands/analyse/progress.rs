//! Progress of an analysis on standard error: a bar on a terminal, else a line now and then.

use super::super::bake_progress::LINE_INTERVAL;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Shows how far an analysis is.
pub(super) struct AnalysisProgress {
    bar: ProgressBar,
    start: Instant,
    /// When the next line is due; `None` on a terminal.
    next_line: Option<Mutex<Instant>>,
}

impl AnalysisProgress {
    pub(super) fn start() -> Self {
        let style = ProgressStyle::with_template("{wide_bar} {percent:>3}% {elapsed} (about {eta} left)");
        let bar = ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let start = Instant::now();
        let next_line = (!std::io::stderr().is_terminal()).then(|| Mutex::new(start + LINE_INTERVAL));
        Self { bar, start, next_line }
    }

    /// Shows the share that is done, 0 to 1.
    pub(super) fn at(&self, share: f64) {
        self.bar.set_position((share * 1000.0) as u64);
        // While one thread writes a line, others have nothing to add.
        let Some(mut next) = self.next_line.as_ref().and_then(|next| next.try_lock().ok()) else { return };
        let now = Instant::now();
        if now >= *next {
            *next = now + LINE_INTERVAL;
            eprintln!("{}", line(share, now.duration_since(self.start)));
        }
    }

    /// Ends the display.
    pub(super) fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// The same words as those of a bake, without a stage.
fn line(share: f64, elapsed: Duration) -> String {
    format!("analysing: {}% after {} s", (share * 100.0) as u64, elapsed.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_plain() {
        assert_eq!(line(0.129, Duration::from_millis(70_900)), "analysing: 12% after 70 s");
    }
}
