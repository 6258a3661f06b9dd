//! The log on standard error.

use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;

/// Starts logging at `level`, which `RUST_LOG` overrides, as text or JSON lines. Further calls have no effect. Only programs
/// call this: in a library it would override the choice of the program that embeds it.
pub fn start(level: &str, json: bool) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    let subscriber = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let _ = if json {
        subscriber.json().flatten_event(true).with_current_span(false).with_span_list(false).try_init()
    } else {
        subscriber.with_ansi(std::io::stderr().is_terminal()).try_init()
    };
}
