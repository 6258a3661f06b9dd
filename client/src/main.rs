//! The program `insula`.

use clap::Parser;
use insula_client::{args::Cli, commands};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => return usage_error(&error),
        Err(help) => help.exit(),
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("error,wgpu_hal=off"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", error.to_string().replace('\n', " "));
            ExitCode::from(error.exit_code())
        }
    }
}

/// Prints a usage error in one line, like all other errors.
fn usage_error(error: &clap::Error) -> ExitCode {
    let text = error.to_string();
    let first = text.split("\n\n").next().unwrap_or("error: usage");
    // Without any arguments, clap prints the help text instead of an error.
    let first = if first.starts_with("error:") { first } else { "error: no command given" };
    let line = first.split_whitespace().collect::<Vec<_>>().join(" ");
    eprintln!("{line}: see insula --help");
    ExitCode::from(2)
}
