//! Logs, to standard error.
//!
//! In: `RUST_LOG`, or a level. Out: lines that a person or a collector reads. Next: nothing.

use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;

/// Starts them at `level` unless `RUST_LOG` is set, as lines for people or as JSON; a second call does nothing. For programs
/// only: a library leaves the choice to its program.
pub fn start(level: &str, json: bool) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    let lines = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let _ = if json {
        lines.json().flatten_event(true).with_current_span(false).with_span_list(false).try_init()
    } else {
        lines.with_ansi(std::io::stderr().is_terminal()).try_init()
    };
}
