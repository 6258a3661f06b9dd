//! Files of a folder and files in memory.

use super::file_names::key;
use super::input::{LocalFile, SourceFiles};
use super::random_file::copy_to_disk;
use std::cell::RefCell;
use std::collections::HashMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

/// Why a file outside of the source's folder is not read.
pub const OUTSIDE: &str = "it lies outside of the source's folder; allow its folder with --texture-root";

/// Names of folders that are kept. In larger folders, names are found as they are only.
const MAX_NAMES: usize = 1 << 18;

/// What the files of all sources have in common.
#[derive(Default)]
pub struct FileRoots {
    /// Folders besides its own from which the files of a source may be read, without links.
    folders: Vec<PathBuf>,
    /// Names by their keys in the folders in which a name was not found.
    listed: RefCell<HashMap<PathBuf, HashMap<String, OsString>>>,
}

impl FileRoots {
    /// Roots at these folders, whose links are resolved.
    pub fn new(folders: Vec<PathBuf>) -> Self {
        Self { folders, ..Self::default() }
    }

    /// The file of a folder whose name differs in case or Unicode normal form only.
    fn similar_path(&self, folder: &Path, name: &str) -> Option<PathBuf> {
        let mut path = folder.to_owned();
        for part in Path::new(name).components() {
            let next = path.join(part);
            path = match part {
                Component::Normal(part) if fs::symlink_metadata(&next).is_err() => {
                    path.join(self.similar_name(&path, part.to_str()?)?)
                }
                Component::Prefix(_) | Component::RootDir => return None,
                _ => next,
            };
        }
        fs::canonicalize(path).ok()
    }

    /// Of several names with one key, the first counts.
    fn similar_name(&self, folder: &Path, name: &str) -> Option<OsString> {
        let mut listed = self.listed.borrow_mut();
        if !listed.contains_key(folder) {
            let names = names_by_key(folder);
            if listed.values().map(HashMap::len).sum::<usize>() + listed.len() + names.len() > MAX_NAMES {
                listed.clear();
            }
            listed.insert(folder.to_owned(), names);
        }
        listed.get(folder)?.get(&key(name)).cloned()
    }
}

/// The names in a folder by their keys; none of a folder that cannot be read or is too large.
fn names_by_key(folder: &Path) -> HashMap<String, OsString> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<OsString> = entries.map(|entry| entry.file_name()).take(MAX_NAMES + 1).collect();
    if names.len() > MAX_NAMES {
        return HashMap::new();
    }
    names.sort_unstable();
    let mut by_key = HashMap::new();
    for name in names {
        if let Some(key) = name.to_str().map(key) {
            by_key.entry(key).or_insert(name);
        }
    }
    by_key
}

/// The files of a folder and of its subfolders.
pub struct FolderFiles {
    path: PathBuf,
    /// Name and path of the source, which the user chose: it may be a link to anywhere.
    source: (String, PathBuf),
    roots: Rc<FileRoots>,
}

impl FolderFiles {
    /// The files of the folder at `path`, of which `source` (a name within it) is chosen by the user, at `source_path`.
    pub fn of_file(path: PathBuf, source: String, source_path: PathBuf, roots: Rc<FileRoots>) -> Self {
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
        for folder in std::iter::once(&own).chain(&self.roots.folders) {
            let found = fs::canonicalize(folder.join(name)).ok();
            let Some(path) = found.or_else(|| self.roots.similar_path(folder, name)) else { continue };
            let is_own = !Path::new(name).is_absolute() && path.starts_with(&own);
            if is_own || self.roots.folders.iter().any(|root| path.starts_with(root)) {
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
pub struct EmbeddedFiles<'a> {
    pub files: &'a [(&'a str, &'a [u8])],
}

impl EmbeddedFiles<'_> {
    fn find(&self, name: &str) -> io::Result<&[u8]> {
        let by_key = || self.files.iter().find(|(own, _)| key(own) == key(name));
        let found = self.files.iter().find(|(own, _)| *own == name).or_else(by_key).map(|(_, bytes)| *bytes);
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
