//! `insula-server`: bakes, serves, inspects and verifies cities.

use clap::{Parser, error::ErrorKind};
use insula_protocol::text::printable;
use insula_server::{
    args::{Args, ServerCommand},
    commands,
    memory::LimitedAllocator,
    telemetry,
};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: LimitedAllocator = LimitedAllocator;

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => return report_usage(&error),
    };
    // `serve` starts its log itself, after it has read its settings.
    if !matches!(args.command, ServerCommand::Serve(_)) {
        telemetry::start("warn", false);
    }
    match commands::run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", printable(&one_line(&error.to_string())));
            ExitCode::from(error.exit_code())
        }
    }
}

/// Prints help and version as clap formats them, and other errors as one line.
fn report_usage(error: &clap::Error) -> ExitCode {
    let is_requested = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
    if is_requested || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let _ = error.print();
    } else {
        let text = error.render().to_string();
        let message = text.split("\nUsage:").next().and_then(|text| text.split("\nFor more").next());
        eprintln!("{}; see --help", printable(&one_line(message.unwrap_or_default())));
    }
    if is_requested { ExitCode::SUCCESS } else { ExitCode::from(2) }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
