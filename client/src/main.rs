//! The program `insula`.

use insula_client::args::Cli;
use insula_client::commands;
use insula_command_line::{error_line, log, parse};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    silence_wayland();
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

/// Without a desktop, a library of the drivers complains on standard error, for each adapter, that this variable has no folder. Below a file
/// it finds no desktop either. In a folder that all can write to, somebody else could pretend to be one.
fn silence_wayland() {
    const RUNTIME: &str = "XDG_RUNTIME_DIR";
    if cfg!(target_os = "linux") && std::env::var_os(RUNTIME).is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var(RUNTIME, "/dev/null") };
    }
}
