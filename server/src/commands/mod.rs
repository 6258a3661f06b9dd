//! What the commands do.
//!
//! In: checked arguments. Out: text on standard output, files, or one [`CommandError`]. Next: `main` prints it.

mod bake;
mod error;
mod inspect;
mod map_image;
mod mesh;
mod output;
mod serve;
mod stats;
mod verify;

pub use error::CommandError;

use crate::args::{Args, ServerCommand};

/// Does what was asked.
pub fn run(args: Args) -> Result<(), CommandError> {
    match args.command {
        ServerCommand::Bake(args) => bake::run(&args),
        ServerCommand::Serve(args) => serve::run(&args),
        ServerCommand::Inspect(args) => inspect::run(&args),
        ServerCommand::Verify(args) => verify::run(&args),
        ServerCommand::Compress(args) => mesh::compress(&args),
        ServerCommand::Decompress(args) => mesh::decompress(&args),
        ServerCommand::Simplify(args) => mesh::simplify(&args),
    }
}
