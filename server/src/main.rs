//! `insula-server`: bakes, serves, inspects and verifies cities.

use insula_command_line::{error_line, log, parse};
use insula_server::args::{Args, ServerCommand};
use insula_server::commands;
use insula_server::memory::LimitedAllocator;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: LimitedAllocator = LimitedAllocator;

fn main() -> ExitCode {
    let args: Args = match parse() {
        Ok(args) => args,
        Err(code) => return code,
    };
    // `serve` starts its log itself, after it has read its settings.
    if !matches!(args.command, ServerCommand::Serve(_)) {
        // tiny-skia warns of shapes without an area, which Insula handles.
        log::start("warn,tiny_skia=error", false);
    }
    match commands::run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}", error_line::<Args>(&error.to_string()));
            ExitCode::from(error.exit_code())
        }
    }
}
