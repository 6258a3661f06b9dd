//! The commands of `insula-server`.

#[cfg(feature = "bake")]
mod addresses;
#[cfg(feature = "bake")]
mod analyse;
#[cfg(feature = "bake")]
mod ao;
#[cfg(feature = "bake")]
mod bake;
#[cfg(feature = "bake")]
mod bake_progress;
#[cfg(feature = "bake")]
mod bake_steps;
#[cfg(feature = "bake")]
mod bucket_client;
#[cfg(feature = "bake")]
mod changes;
#[cfg(feature = "bake")]
mod compare;
mod error;
#[cfg(feature = "bake")]
mod export;
mod inspect;
#[cfg(feature = "bake")]
mod interrupt;
mod map_image;
#[cfg(feature = "bake")]
mod mesh;
mod objects;
mod output;
mod publish;
mod search;
mod serve;
mod sign;
mod site_documents;
mod site_folder;
#[cfg(feature = "bake")]
mod survey;
mod verify;
mod volume;
#[cfg(feature = "bake")]
mod work_store;

use crate::args::{Args, ServerCommand};
use crate::http::OPENAPI;
pub use error::CommandError;
pub use publish::publish_site;

/// Runs a command. Fails with its error, which [`CommandError::exit_code`] maps to the exit code.
pub fn run(args: Args) -> Result<(), CommandError> {
    match args.command {
        ServerCommand::Serve(args) => serve::run(&args),
        ServerCommand::Sign(args) => sign::run(&args),
        ServerCommand::Publish(args) => publish::run(&args),
        ServerCommand::Inspect(args) => inspect::run(&args),
        ServerCommand::Objects(args) => objects::run(&args),
        ServerCommand::Search(args) => search::run(&args),
        ServerCommand::Verify(args) => verify::run(&args),
        ServerCommand::Openapi => {
            output::print(OPENAPI);
            Ok(())
        }
        ServerCommand::Setup(setup) => setup.run::<Args>().map_err(|(path, error)| CommandError::write(path, error)),
        #[cfg(feature = "bake")]
        ServerCommand::Bake(args) => match &args.work {
            Some(work) => bake_steps::run(&args, work),
            None => bake::run(&args),
        },
        #[cfg(feature = "bake")]
        ServerCommand::Analyse(args) => analyse::run(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Export(args) => export::run(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Changes(args) => changes::run(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Compress(args) => mesh::compress(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Decompress(args) => mesh::decompress(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Simplify(args) => mesh::simplify(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Compare(args) => compare::run(&args),
        #[cfg(feature = "bake")]
        ServerCommand::Ao(args) => ao::run(&args),
        #[cfg(not(feature = "bake"))]
        ServerCommand::Bake(_)
        | ServerCommand::Compress(_)
        | ServerCommand::Decompress(_)
        | ServerCommand::Simplify(_)
        | ServerCommand::Compare(_)
        | ServerCommand::Ao(_) => Err(CommandError::Bake(
            "this program can only serve; use one that was built with the feature `bake`".into(),
        )),
    }
}
