//! Files of a folder and files in memory.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::input::{LocalFile, SourceFiles};

/// Why a file outside of the source's folder is not read.
pub(super) const OUTSIDE: &str = "it lies outside of the source's folder; allow its folder with --texture-root";

/// The files of a folder and of its subfolders.
pub(super) struct FolderFiles {
    path: PathBuf,
    /// Name and path of the source, which the user chose: it may be a link to anywhere.
    source: (String, PathBuf),
    /// Folders besides `path` from which files may be read, without links.
    roots: Rc<[PathBuf]>,
}

impl FolderFiles {
    /// The files of the folder at `path`, of which `source` (a name within it) is chosen by the user, at `source_path`.
    pub(super) fn of_file(path: PathBuf, source: String, source_path: PathBuf, roots: Rc<[PathBuf]>) -> Self {
        Self { path, source: (source, source_path), roots }
    }

    /// Path of a plain file. A name in a city file must not make the bake read a device, wait for a pipe, or publish a
    /// file from elsewhere: after links and `..`, the file must lie in the source's folder or in one of the roots.
    fn path_of(&self, name: &str) -> io::Result<PathBuf> {
        let (source, path) = &self.source;
        let path = if name == source { path.clone() } else { self.allowed_path(name)? };
        if fs::metadata(&path)?.is_file() {
            Ok(path)
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file"))
        }
    }

    /// The file of that name in the source's folder or a root. An absolute name must lie in a root.
    fn allowed_path(&self, name: &str) -> io::Result<PathBuf> {
        let own = if self.path.as_os_str().is_empty() { Path::new(".") } else { &self.path };
        let own = fs::canonicalize(own)?;
        let mut refused = None;
        for folder in std::iter::once(&own).chain(&*self.roots) {
            let Ok(path) = fs::canonicalize(folder.join(name)) else { continue };
            let is_own = !Path::new(name).is_absolute() && path.starts_with(&own);
            if is_own || self.roots.iter().any(|root| path.starts_with(root)) {
                return Ok(path);
            }
            refused = Some(io::Error::new(io::ErrorKind::PermissionDenied, OUTSIDE));
        }
        Err(refused.unwrap_or_else(|| io::ErrorKind::NotFound.into()))
    }
}

impl SourceFiles for FolderFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(File::open(self.path_of(name)?)?))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        Ok(fs::metadata(self.path_of(name)?)?.len())
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        Ok(LocalFile { path: self.path_of(name)?, copy: None })
    }

    fn is_random(&self) -> bool {
        true
    }

    fn location(&self) -> String {
        // Differs between any two folders, also between those whose names are not text.
        self.path.to_str().map_or_else(|| format!("{:?}", self.path), str::to_owned)
    }
}

/// Files in memory.
pub(super) struct EmbeddedFiles<'a> {
    pub(super) files: &'a [(&'a str, &'a [u8])],
}

impl EmbeddedFiles<'_> {
    fn find(&self, name: &str) -> io::Result<&[u8]> {
        let found = self.files.iter().find(|(own, _)| *own == name).map(|(_, bytes)| *bytes);
        found.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not among the given files"))
    }
}

impl SourceFiles for EmbeddedFiles<'_> {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(self.find(name)?))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        Ok(self.find(name)?.len() as u64)
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        copy_to_disk(&mut self.find(name)?)
    }

    fn location(&self) -> String {
        String::new()
    }
}

/// Copies bytes to a temporary file.
pub(super) fn copy_to_disk(reader: &mut dyn Read) -> io::Result<LocalFile> {
    let mut file = tempfile::NamedTempFile::new()?;
    io::copy(reader, &mut file)?;
    file.flush()?;
    let copy = file.into_temp_path();
    Ok(LocalFile { path: copy.to_path_buf(), copy: Some(copy) })
}
