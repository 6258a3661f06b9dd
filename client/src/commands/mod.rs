//! One module a command.
//!
//! In: [`Cli`]. Out: pictures, reports, windows. Next: the exit code.

pub mod connect;
#[cfg(feature = "embedded")]
pub mod demo;
#[cfg(feature = "embedded")]
mod embedded;
pub mod fly;
#[cfg(feature = "embedded")]
pub mod open;
pub mod snapshot;
pub mod view;

use crate::{
    args::{Cli, Command},
    error::Result,
};

/// Does what was typed.
pub fn run(cli: Cli) -> Result<()> {
    let Cli { command, global } = cli;
    match command {
        Command::View(args) => view::run(&args, &global),
        Command::Snapshot(args) => snapshot::run(&args, &global),
        Command::Fly(args) => fly::run(&args, &global),
        #[cfg(feature = "embedded")]
        Command::Open { inputs, cell, palette, sun } => open::run(&inputs, cell, palette.as_deref(), &sun, &global),
        #[cfg(feature = "embedded")]
        Command::Demo { headless, out, size, sun } => demo::run(headless, &out, size, &sun, &global),
        #[cfg(not(feature = "embedded"))]
        Command::Open { .. } | Command::Demo { .. } => Err(crate::error::ClientError::Usage(
            "this program was built without the embedded server: use insula-server, then insula view".into(),
        )),
    }
}
