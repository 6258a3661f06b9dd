//! Output to standard output and files.

use super::error::CommandError;
use insula_protocol::text::{printable_json, printable_lines};
use std::{io::Write, path::Path};

/// Prints lines to standard output, without anything that a terminal obeys. Errors are ignored, so that a closed pipe
/// (`| head`) does not fail the command.
pub(super) fn print(text: &str) {
    write_out(&printable_lines(text));
}

/// Prints JSON, as [`print`] does.
pub(super) fn print_json(json: &str) {
    write_out(&(printable_json(json) + "\n"));
}

fn write_out(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a file. Fails if the system refuses.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), CommandError> {
    std::fs::write(path, bytes)
        .map_err(|error| CommandError::Write { path: path.to_owned(), reason: error.to_string() })
}

/// Formats a size with a decimal unit, such as `1.5 MB`.
pub(super) fn human_bytes(bytes: u64) -> String {
    let (mut value, mut unit) = (bytes as f64, "B");
    for larger in ["kB", "MB", "GB", "TB"] {
        if value < 1000.0 {
            break;
        }
        (value, unit) = (value / 1000.0, larger);
    }
    if unit == "B" { format!("{bytes} B") } else { format!("{value:.1} {unit}") }
}
