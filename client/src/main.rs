//! The program `insula`.

use insula_client::{args::Cli, commands};
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

/// Without a desktop, a library of the drivers complains on standard error, for each adapter, that this variable has no folder. It finds no
/// desktop in any folder either.
fn silence_wayland() {
    const RUNTIME: &str = "XDG_RUNTIME_DIR";
    if std::env::var_os(RUNTIME).is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var(RUNTIME, std::env::temp_dir()) };
    }
}
