//! One module a command.
//!
//! In: [`Cli`]. Out: pictures, reports, windows. Next: the exit code.

pub mod connect;
pub mod fly;
pub mod snapshot;

use crate::{
    args::{Cli, Command},
    error::Result,
};

/// Does what was typed.
pub fn run(cli: Cli) -> Result<()> {
    let Cli { command, global } = cli;
    match command {
        Command::Snapshot(args) => snapshot::run(&args, &global),
        Command::Fly(args) => fly::run(&args, &global),
        _ => todo!(),
    }
}
