//! Files that appear whole or not at all.

use super::ExportError;
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

/// A file under a temporary name beside its final one. It is removed unless it is committed.
#[derive(Debug)]
pub(crate) struct OutputFile {
    path: PathBuf,
    partial: PathBuf,
    is_done: bool,
}

impl OutputFile {
    /// Creates `PATH.partial` and returns it for writing. Fails if it cannot be created.
    pub(crate) fn create(path: &Path) -> Result<(Self, File), ExportError> {
        let partial = with_suffix(path, ".partial");
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&partial);
        let file = file.map_err(ExportError::write(path))?;
        Ok((Self { path: path.to_owned(), partial, is_done: false }, file))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name, in place of an older one. Returns its size in bytes. Fails if it cannot be written.
    pub(crate) fn commit(mut self, file: File) -> Result<u64, ExportError> {
        let finish = || {
            file.sync_all()?;
            let bytes = file.metadata()?.len();
            drop(file);
            fs::rename(&self.partial, &self.path)?;
            Ok(bytes)
        };
        let bytes = finish().map_err(ExportError::write(&self.path))?;
        self.is_done = true;
        Ok(bytes)
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        if !self.is_done {
            // Nothing can be done about a file that cannot be removed; its name says what it is.
            let _ = fs::remove_file(&self.partial);
        }
    }
}

/// The path with `suffix` after its whole name.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn only_committed_files_remain() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let (output, mut file) = OutputFile::create(&path).unwrap();
        file.write_all(b"abc").unwrap();
        drop(output);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        for text in ["abc", "de"] {
            let (output, mut file) = OutputFile::create(&path).unwrap();
            file.write_all(text.as_bytes()).unwrap();
            assert_eq!(output.commit(file).unwrap(), text.len() as u64);
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let error = OutputFile::create(&folder.path().join("none/a.csv")).unwrap_err().to_string();
        assert!(error.contains("a.csv: cannot be written"), "{error}");
    }
}
