//! Why a bake failed: one line each that says what, where and what to do.
//!
//! In: the place and the cause. Out: [`BakeError`]. Next: the command line prints it and exits with a non-zero code.

use std::{
    io,
    path::{Path, PathBuf},
};

use insula_protocol::{DecodeError, TileId};

use crate::read::InputError;

/// A fault that ends the bake. The output folder is then as it was before; finished work lies in its `.partial` folder.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The inputs could not be read.
    #[error(transparent)]
    Read(#[from] InputError),
    /// An option makes no sense.
    #[error("{option} {value}: {advice}")]
    Option {
        /// Its name on the command line.
        option: &'static str,
        /// What was given.
        value: String,
        /// What may be given.
        advice: String,
    },
    /// The output cannot be where it was asked for.
    #[error("{path}: {what}; choose another --out, or move it away")]
    Out {
        /// The folder.
        path: PathBuf,
        /// What is in the way.
        what: &'static str,
    },
    /// A second bake of the same city is running.
    #[error("{path}: another bake is writing there; wait until it has finished, or choose another --out")]
    Busy {
        /// The scratch folder.
        path: PathBuf,
    },
    /// No space left, or a quota or file size limit reached.
    #[error("{path}: the disk is full ({cause}); make space, then run the same command with --resume")]
    DiskFull {
        /// The file that could not be written.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// A file could not be written, read back or renamed.
    #[error("{path}: cannot be {action}: {cause}; check that its folder exists and may be written")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// A participle: `written`, `read`.
        action: &'static str,
        /// The system's words.
        cause: io::Error,
    },
    /// A scratch file that this bake wrote is not what it was.
    #[error("{path}: a scratch file changed while baking; run the command again without --resume")]
    Scratch {
        /// The file.
        path: PathBuf,
    },
    /// A scene that no reader makes.
    #[error("triangle {triangle}: {what}; repair the source")]
    Scene {
        /// Index into the scene's triangles.
        triangle: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// There is nothing to bake.
    #[error("the city is empty: none of its {triangles} triangles fills a cell of {cell_m} m; use a smaller --cell")]
    Empty {
        /// How many triangles were read.
        triangles: usize,
        /// The cell that was asked for.
        cell_m: f64,
    },
    /// More levels would be needed than there are.
    #[error("the city is {side_m:.0} m wide, too wide for cells of {cell_m} m; use a larger --cell, or split the city")]
    Extent {
        /// The longer side of the bounds.
        side_m: f64,
        /// The cell that was asked for.
        cell_m: f64,
    },
    /// A node that the formats cannot hold.
    #[error("tile {id}: cannot be {action}: {cause}; try a larger --cell, and report this with the input")]
    Tile {
        /// The node.
        id: TileId,
        /// A participle.
        action: &'static str,
        /// What the protocol said.
        cause: DecodeError,
    },
    /// An archive could not be laid out.
    #[error("{path}: {what}; report this with the input")]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What its writer said.
        what: String,
    },
    /// The system refused threads.
    #[error("--threads {threads}: {cause}; use fewer threads")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// The system's words.
        cause: String,
    },
}

impl BakeError {
    /// An input or output fault at `path`; a full disk is told apart.
    pub(crate) fn io(path: &Path, action: &'static str, cause: io::Error) -> Self {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        let path = path.to_owned();
        if matches!(cause.kind(), StorageFull | QuotaExceeded | FileTooLarge) {
            Self::DiskFull { path, cause }
        } else {
            Self::Io { path, action, cause }
        }
    }

    /// For `map_err` where a node is coded.
    pub(crate) fn tile(id: TileId, action: &'static str) -> impl FnOnce(DecodeError) -> Self {
        move |cause| Self::Tile { id, action, cause }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_apart_and_every_message_is_one_line() {
        let full = BakeError::io(Path::new("a/b"), "written", io::ErrorKind::StorageFull.into());
        assert!(matches!(full, BakeError::DiskFull { .. }));
        assert!(full.to_string().contains("--resume"), "{full}");
        let other = BakeError::io(Path::new("a/b"), "written", io::ErrorKind::PermissionDenied.into());
        assert!(other.to_string().starts_with("a/b: cannot be written"), "{other}");
        for error in [full, other, BakeError::tile(TileId::ROOT, "encoded")(DecodeError::Magic)] {
            assert!(!error.to_string().contains('\n'));
        }
    }
}
