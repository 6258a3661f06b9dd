//! `insula-server`: bakes cities, serves them, looks into them and checks them.

use clap::{Parser, error::ErrorKind};
use insula_server::{
    args::{Args, ServerCommand},
    commands, telemetry,
};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => return usage(&error),
    };
    // A server tells what happens, and starts its log when its settings are known; what ends soon speaks only of trouble.
    if !matches!(args.command, ServerCommand::Serve(_)) {
        telemetry::start("warn", false);
    }
    match commands::run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", one_line(&error.to_string()));
            ExitCode::from(error.exit_code())
        }
    }
}

/// Help and version as they are; a slip as one line.
fn usage(error: &clap::Error) -> ExitCode {
    let wanted = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
    if wanted || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let _ = error.print();
    } else {
        let text = error.render().to_string();
        let what = text.split("\nUsage:").next().and_then(|text| text.split("\nFor more").next()).unwrap_or_default();
        eprintln!("{}; see --help", one_line(what));
    }
    if wanted { ExitCode::SUCCESS } else { ExitCode::from(2) }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
