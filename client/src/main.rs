//! The program `insula`.

use insula_client::{args::Cli, commands};
use insula_command_line::{one_line, parse};
use insula_protocol::text::printable;
use std::{io::IsTerminal, process::ExitCode};
use tracing_subscriber::{field::MakeExt, fmt::format};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let cli: Cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
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
            eprintln!("error: {}", one_line(&error.to_string()));
            ExitCode::from(error.exit_code())
        }
    }
}
