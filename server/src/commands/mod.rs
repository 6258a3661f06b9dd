//! What the commands do.
//!
//! In: checked arguments. Out: text on standard output, files, or one [`CommandError`]. Next: `main` prints it.

mod bake;
mod census;
mod error;
mod inspect;
mod mesh;
mod output;
mod serve;
mod tile_picture;
mod verify;

pub use error::CommandError;

use crate::args::{Args, Command};

/// Does what was asked.
pub fn run(args: Args) -> Result<(), CommandError> {
    match args.command {
        Command::Bake(args) => bake::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Compress(args) => mesh::compress(&args),
        Command::Decompress(args) => mesh::decompress(&args),
        Command::Simplify(args) => mesh::simplify(&args),
    }
}
