//! The commands of `insula`, one module each, and what they share (`connect`, `headless`, `proposal`, `embedded`).

#[cfg(feature = "embedded")]
mod city_tiles;
pub mod connect;
#[cfg(feature = "embedded")]
mod demo;
#[cfg(feature = "embedded")]
mod draw;
#[cfg(feature = "embedded")]
mod embedded;
mod fly;
pub mod headless;
#[cfg(feature = "embedded")]
mod open;
mod proposal;
mod snapshot;
mod view;

use crate::args::{Cli, ClientCommand};
use crate::error::{ClientError, Result};

/// Runs the command of a command line. Fails as the command does.
pub fn run(cli: Cli) -> Result<()> {
    let Cli { command, global } = cli;
    match command {
        ClientCommand::View(args) => view::run(&args, &global),
        ClientCommand::Snapshot(args) => snapshot::run(&args, &global),
        ClientCommand::Fly(args) => fly::run(&args, &global),
        ClientCommand::Setup(setup) => setup.run::<Cli>().map_err(|(path, source)| ClientError::File { path, source }),
        #[cfg(feature = "embedded")]
        ClientCommand::Open(args) => open::run(&args, &global),
        #[cfg(feature = "embedded")]
        ClientCommand::Demo(args) => demo::run(&args, &global),
        #[cfg(feature = "embedded")]
        ClientCommand::Draw(args) => draw::run(&args, &global),
        #[cfg(not(feature = "embedded"))]
        ClientCommand::Open(_) | ClientCommand::Demo(_) | ClientCommand::Draw(_) => Err(ClientError::Usage(
            "this program was built without the embedded server: use insula-server, then insula view".into(),
        )),
    }
}
