//! The program `insula`.

use insula_client::{args::Cli, commands};
use insula_command_line::{error_line, log, parse};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let cli: Cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    log::start("error,wgpu_hal=off", false);
    match commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}", error_line::<Cli>(&error.to_string()));
            ExitCode::from(error.exit_code())
        }
    }
}
