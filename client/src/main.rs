//! The program `insula`.

use clap::Parser;
use insula_client::{args::Cli, commands};
use insula_protocol::text::printable;
use std::{io::IsTerminal, process::ExitCode};
use tracing_subscriber::{field::MakeExt, fmt::format};

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
    let fields = format::debug_fn(|writer, field, value| match field.name() {
        "message" => write!(writer, "{}", printable(&format!("{value:?}"))),
        name => write!(writer, "{name}={}", printable(&format!("{value:?}"))),
    });
    let log = tracing_subscriber::fmt().fmt_fields(fields.delimited(" ")).with_env_filter(filter);
    log.with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr).init();
    match commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", printable(&error.to_string()));
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
    eprintln!("{}: see insula --help", printable(&line));
    ExitCode::from(2)
}
