//! Logs, to standard error.
//!
//! In: `RUST_LOG`, or a level. Out: lines that a person or a collector reads. Next: nothing.

use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;

/// Starts them at `level` unless `RUST_LOG` is set; a second call does nothing. For programs only: a library leaves the choice to its program.
pub fn start(level: &str) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    let ansi = std::io::stderr().is_terminal();
    let _ = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(ansi).try_init();
}
