//! Files that appear whole or not at all.

use super::ExportError;
use insula_archive::new_file::NewFile;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A file under a temporary name beside its final one. It is removed unless it is committed.
#[derive(Debug)]
pub(crate) struct OutputFile {
    path: PathBuf,
    new: NewFile,
}

impl OutputFile {
    /// Creates the file and returns it for writing. Fails if it cannot be created.
    pub(crate) fn create(path: &Path) -> Result<(Self, File), ExportError> {
        let new = NewFile::create(path).map_err(ExportError::write(path))?;
        let file = new.file().map_err(ExportError::write(path))?;
        Ok((Self { path: path.to_owned(), new }, file))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name, in place of an older one. Returns its size in bytes. Fails if it cannot be written.
    pub(crate) fn commit(self, file: File) -> Result<u64, ExportError> {
        drop(file);
        self.new.commit().map_err(ExportError::write(&self.path))
    }
}

/// The path with `suffix` after its whole name.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}
