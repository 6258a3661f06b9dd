//! Why a bake failed. Every error is one line that says what failed, where, and what to do.

use crate::kept_work::has_kept_work;
use insula_protocol::{DecodeError, TileId};
use insula_scratch::error::ScratchError;
pub use insula_source::error::InputError;
use std::io;
use std::path::{Path, PathBuf};

/// An error that ends the bake. The output folder is then unchanged, and finished work stays in its `.partial` folder.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The inputs could not be read.
    #[error(transparent)]
    Read(#[from] InputError),
    /// An option has an invalid value.
    #[error("{option} {value}: {advice}")]
    Option {
        /// Name on the command line.
        option: &'static str,
        value: String,
        /// Which values are valid.
        advice: String,
    },
    /// The city cannot be written to the requested folder.
    #[error("{path}: {what}; choose another --out, or move it away")]
    Out { path: PathBuf, what: &'static str },
    /// A folder that the bake replaces or clears has something that it reads.
    #[error(
        "{place}: the bake would remove its input {input}, which is or lies in it; choose another {option}, or move the input"
    )]
    Inside {
        input: PathBuf,
        place: PathBuf,
        /// The option that names the folder.
        option: &'static str,
    },
    /// A second bake of the same city is running.
    #[error("{path}: another bake is writing to this folder; wait until it has finished, or choose another --out")]
    Busy {
        /// The scratch folder.
        path: PathBuf,
    },
    /// No space is left, or a quota or file size limit was reached.
    #[error("{path}: the disk is full ({cause}); make space, then run the same command {}", if *is_kept { "with --resume" } else { "again" })]
    DiskFull {
        path: PathBuf,
        cause: io::Error,
        /// Whether finished work is kept, for a bake that resumes.
        is_kept: bool,
    },
    /// A file could not be written, read back or renamed.
    #[error("{path}: cannot be {action}: {cause}; check that its folder exists and is writable")]
    Io {
        path: PathBuf,
        /// A participle such as `written` or `read`.
        action: &'static str,
        cause: io::Error,
    },
    /// The scratch scene would be larger than it may be.
    #[error(
        "the city needs more than {limit_mib} MiB of scratch files; repair its largest objects, use a larger --cell, raise --scratch, or split it"
    )]
    ScratchLimit { limit_mib: u64 },
    /// A scratch file is not as this bake wrote it.
    #[error("{path}: a scratch file changed during the bake; run the command again without --resume")]
    Scratch { path: PathBuf },
    /// A scene that was passed in is invalid.
    #[error("triangle {triangle}: {what}; repair the source")]
    Scene {
        /// Index into the scene's triangles.
        triangle: usize,
        what: &'static str,
    },
    /// No triangle fills a cell.
    #[error("the city is empty: none of its {triangles} triangles fills a cell of {cell_m} m; use a smaller --cell")]
    Empty { triangles: usize, cell_m: f64 },
    /// The quadtree would need more levels than the formats allow.
    #[error("the city is {side_m:.0} m wide, too wide for cells of {cell_m} m; use a larger --cell, or split the city")]
    Extent {
        /// Longer side of the bounds.
        side_m: f64,
        cell_m: f64,
    },
    /// The city has more blocks of leaves than the memory allows.
    #[error(
        "the city covers more than {limit} blocks of {side_m} m; use a larger --cell, raise --memory, or split the city"
    )]
    TooManyBlocks { limit: usize, side_m: f64 },
    /// A block of leaves needs more memory than it may use.
    #[error(
        "object {object}: with it, the block of leaves at {x:.0}, {y:.0} needs about {needed_mib} MiB, and may use {limit_mib} MiB; repair the object, use a larger --cell, or raise --memory"
    )]
    BlockTooLarge {
        /// The object with most surface in the block.
        object: String,
        /// World position of the block's south-west corner.
        x: f64,
        y: f64,
        needed_mib: u64,
        limit_mib: u64,
    },
    /// A node does not fit the formats.
    #[error("tile {id}: cannot be {action}: {cause}; try a larger --cell, and report this with the input")]
    Tile {
        id: TileId,
        /// A participle such as `encoded`.
        action: &'static str,
        cause: DecodeError,
    },
    /// The occlusion of a leaf's landmarks could not be computed.
    #[error("tile {tile}: no occlusion of its landmarks: {cause}; use a smaller mesh")]
    Occlusion { tile: TileId, cause: String },
    /// An archive could not be written.
    #[error("{path}: {what}; report this with the input")]
    Archive { path: PathBuf, what: String },
    /// The work store does not answer.
    #[error("{work}/{name}: {cause}; check that it is reachable and writable, and try again")]
    Work { work: String, name: String, cause: io::Error },
    /// The work store has an object where a step writes one, and no step wrote it.
    #[error("{work}/{what}")]
    Foreign { work: String, what: String },
    /// A step needs the result of an earlier one.
    #[error("{work}/{name}: not there yet; run the earlier steps first")]
    StepMissing { work: String, name: String },
    /// An object of the work store is of another job or version, or damaged.
    #[error("{work}/{name}: {what}")]
    StepDamaged { work: String, name: String, what: &'static str },
    /// A stage has fewer tasks.
    #[error("{stage} {task}: the stage has {tasks} tasks, from 0")]
    StepTask { stage: &'static str, task: usize, tasks: usize },
    /// The system could not start the worker threads.
    #[error("--threads {threads}: {cause}; use fewer threads")]
    Threads { threads: usize, cause: String },
}

impl From<ScratchError> for BakeError {
    fn from(error: ScratchError) -> Self {
        match error {
            ScratchError::Io { path, action, cause } => Self::io(&path, action, cause),
            ScratchError::Damaged => Self::Scratch { path: "records".into() },
        }
    }
}

impl BakeError {
    /// An input or output error at `path`: `DiskFull` if the disk is full, else `Io`.
    pub(crate) fn io(path: &Path, action: &'static str, cause: io::Error) -> Self {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        let path = path.to_owned();
        if matches!(cause.kind(), StorageFull | QuotaExceeded | FileTooLarge) {
            Self::DiskFull { path, cause, is_kept: false }
        } else {
            Self::Io { path, action, cause }
        }
    }

    pub(crate) fn work(work: String, name: &str, cause: io::Error) -> Self {
        match cause.kind() {
            io::ErrorKind::AlreadyExists => Self::Foreign { work, what: cause.to_string() },
            _ => Self::Work { work, name: name.to_owned(), cause },
        }
    }

    /// The error of a bake to `out`, which says whether work is kept there. Only its end tells.
    pub(crate) fn of_bake(self, out: &Path) -> Self {
        match self {
            Self::DiskFull { path, cause, .. } => Self::DiskFull { path, cause, is_kept: has_kept_work(out) },
            other => other,
        }
    }

    /// Whether the same step would fail again on any machine, so that no retry mends it.
    #[must_use]
    pub fn is_final(&self) -> bool {
        !matches!(
            self,
            Self::Read(InputError::Io { .. })
                | Self::Busy { .. }
                | Self::DiskFull { .. }
                | Self::Io { .. }
                | Self::ScratchLimit { .. }
                | Self::Threads { .. }
                | Self::Work { .. }
                | Self::StepMissing { .. }
        )
    }

    /// For `map_err` where a node is encoded or decoded.
    pub(crate) fn tile(id: TileId, action: &'static str) -> impl FnOnce(DecodeError) -> Self {
        move |cause| Self::Tile { id, action, cause }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;
    use std::fs;

    #[test]
    fn full_disk_has_its_own_variant_and_messages_are_one_line() {
        let full = BakeError::io(Path::new("a/b"), "written", io::ErrorKind::StorageFull.into());
        assert!(matches!(full, BakeError::DiskFull { .. }));
        assert!(full.to_string().ends_with("the same command again"), "{full}");
        let folder = TestFolder::new("disk-full");
        fs::create_dir_all(folder.path.join("b.partial/packs")).unwrap();
        let full = full.of_bake(&folder.path.join("b"));
        assert!(full.to_string().ends_with("--resume"), "{full}");
        let other = BakeError::io(Path::new("a/b"), "written", io::ErrorKind::PermissionDenied.into());
        assert!(other.to_string().starts_with("a/b: cannot be written"), "{other}");
        for error in [full, other, BakeError::tile(TileId::ROOT, "encoded")(DecodeError::Magic)] {
            assert!(!error.to_string().contains('\n'));
        }
    }
}
