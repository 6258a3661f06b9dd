//! What the commands do.
//!
//! In: checked arguments. Out: text on standard output, files, or one [`CommandError`]. Next: `main` prints it.

mod bake;
mod census;
mod inspect;
mod mesh;
mod serve;
mod tile_picture;
mod verify;

use crate::{
    args::{Args, Command},
    config::ConfigError,
    http::ServeError,
    store::StoreError,
};
use std::{io::Write, path::PathBuf};

/// Why a command failed: one line that says what, where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A city cannot be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The config file cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file that the config names cannot be used, or the system refuses.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// No socket.
    #[error("cannot listen on {address}: {source}; give another --listen, port 0 picks a free one")]
    Listen {
        /// As typed.
        address: String,
        /// Why not.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("cannot write {}: {reason}; is there space, and may you write there?", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// The operating system refuses something else.
    #[error("cannot {what}: {source}; try again")]
    System {
        /// What was tried.
        what: &'static str,
        /// Why not.
        source: std::io::Error,
    },
    /// There is no such tile in the city, or it is damaged.
    #[error("cannot show tile {tile}: {reason}; `insula-server inspect CITY` lists the levels, `verify` the bad tiles")]
    Tile {
        /// Its place.
        tile: String,
        /// What is wrong.
        reason: String,
    },
    /// `verify` found faults; they have been printed.
    #[error("{faults} faults in {}; bake the city again, or copy it again from where it is whole", path.display())]
    Faults {
        /// The city's folder.
        path: PathBuf,
        /// How many.
        faults: usize,
    },
    /// A file is no mesh that can be used.
    #[error("{}: {reason}", path.display())]
    Mesh {
        /// Which.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// The bake failed.
    #[error("{0}")]
    Bake(String),
    /// What was typed makes no sense.
    #[error("{0}")]
    Usage(String),
}

impl CommandError {
    /// 2 for slips of the user, else 1.
    pub fn exit_code(&self) -> u8 {
        if matches!(self, Self::Usage(_)) { 2 } else { 1 }
    }
}

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

/// Prints to standard output. A reader who has seen enough (`| head`) is no error.
fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a file whole.
fn write(path: &std::path::Path, bytes: &[u8]) -> Result<(), CommandError> {
    std::fs::write(path, bytes)
        .map_err(|error| CommandError::Write { path: path.to_owned(), reason: error.to_string() })
}

/// Bytes as people read them.
fn human_bytes(bytes: u64) -> String {
    let (mut value, mut unit) = (bytes as f64, "B");
    for larger in ["kB", "MB", "GB", "TB"] {
        if value < 1000.0 {
            break;
        }
        (value, unit) = (value / 1000.0, larger);
    }
    if unit == "B" { format!("{bytes} B") } else { format!("{value:.1} {unit}") }
}
