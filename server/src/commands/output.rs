//! Output to standard output and files.

use super::error::CommandError;
use crate::args::JsonArgs;
use insula_archive::new_file;
#[cfg(feature = "bake")]
use insula_command_line::output::{FileKind, Outputs, OverwriteArgs};
use insula_protocol::text::{printable_json, printable_lines};
use serde::Serialize;
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Prints lines to standard output, without anything that a terminal obeys. Errors are ignored, so that a closed pipe
/// (`| head`) does not fail the command.
pub(super) fn print(text: &str) {
    write_out(&printable_lines(text));
}

/// Prints JSON, as [`print()`] does.
fn print_json(json: &str) {
    write_out(&(printable_json(json) + "\n"));
}

/// Prints a value as JSON of several lines. Fails if it has no form in JSON.
pub(super) fn print_pretty(value: &impl Serialize) -> Result<(), CommandError> {
    let json = serde_json::to_string_pretty(value);
    print_json(&json.map_err(|error| CommandError::System { what: "encode JSON", source: error.into() })?);
    Ok(())
}

/// Says what a command did: its facts as JSON if that is asked for, else a text.
pub(super) fn print_result(args: JsonArgs, facts: &Value, text: &str) {
    match args.json {
        true => print_json(&facts.to_string()),
        false => print(text),
    }
}

fn write_out(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a file whole, in place of an older one. Devices and pipes are written directly. Fails if the system refuses.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), CommandError> {
    new_file::replace(path, bytes).map_err(|error| CommandError::write(path, error))
}

/// Checks that a command with one output may write it. Fails as [`Outputs::file`].
#[cfg(feature = "bake")]
pub(super) fn check_output<P: AsRef<Path>>(
    path: &Path,
    kind: FileKind,
    inputs: impl IntoIterator<Item = P>,
    overwrite: OverwriteArgs,
) -> Result<(), CommandError> {
    Outputs::new(overwrite).reading(inputs).file(path, kind).map_err(CommandError::Usage)
}
