//! Temporary files and folders. They are removed when their value is dropped, and when a signal or a failed allocation ends the program.
//! The prefix of their names identifies those that a killed program leaves.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::{Builder, TempDir, TempPath};

/// Prefix of all names.
const PREFIX: &str = "insula-";

/// Paths that this process created and has not removed.
static ALL: Paths = Paths(Mutex::new(BTreeSet::new()));

struct Paths(Mutex<BTreeSet<PathBuf>>);

impl Paths {
    fn lock(&self) -> MutexGuard<'_, BTreeSet<PathBuf>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Creates a path and lists it. The lock is held meanwhile, so that no path exists without being listed.
    fn add<T: AsRef<Path>>(&self, create: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
        let mut paths = self.lock();
        let made = create()?;
        paths.insert(made.as_ref().to_owned());
        Ok(made)
    }

    /// Removes all listed paths. The lock is never released, so that no path is added afterwards.
    fn remove(mut paths: MutexGuard<'_, BTreeSet<PathBuf>>) {
        for path in std::mem::take(&mut *paths) {
            remove(&path);
        }
        std::mem::forget(paths);
    }
}

/// Removes a file or folder. Nothing can be done about what cannot be removed.
fn remove(path: &Path) {
    if !path.is_dir() {
        let _ = fs::remove_file(path);
        return;
    }
    // Other threads may be writing into the folder: they find it no more.
    let mut away = path.as_os_str().to_owned();
    away.push(".removed");
    let away = if fs::rename(path, &away).is_ok() { Path::new(&away) } else { path };
    let _ = fs::remove_dir_all(away);
}

/// A file or folder in the system's temporary folder. It is removed when this value is dropped.
#[derive(Debug)]
pub struct Temporary<T: AsRef<Path>>(T);

/// A temporary file.
pub type TemporaryFile = Temporary<TempPath>;
/// A temporary folder.
pub type TemporaryFolder = Temporary<TempDir>;

impl<T: AsRef<Path>> Temporary<T> {
    /// Its path.
    pub fn path(&self) -> &Path {
        self.0.as_ref()
    }
}

impl<T: AsRef<Path>> Drop for Temporary<T> {
    fn drop(&mut self) {
        let mut paths = ALL.lock();
        // Before it leaves the list: a signal may end the program at any time.
        remove(self.path());
        paths.remove(self.path());
    }
}

/// Copies bytes to a new file. Fails if they cannot be read or written.
pub fn file_of(bytes: &mut dyn Read) -> io::Result<TemporaryFile> {
    let mut file = None;
    let made = ALL.add(|| {
        let (opened, path) = Builder::new().prefix(PREFIX).tempfile()?.into_parts();
        file = Some(opened);
        Ok(path)
    });
    let made = made.map(Temporary)?;
    file.map(|mut file| io::copy(bytes, &mut file)).transpose()?;
    Ok(made)
}

/// A new folder. Fails if it cannot be created.
pub fn folder() -> io::Result<TemporaryFolder> {
    ALL.add(|| Builder::new().prefix(PREFIX).tempdir()).map(Temporary)
}

/// Removes all listed paths. Call it only before the process exits: a thread that creates or drops one afterwards blocks forever.
pub fn remove_all() {
    Paths::remove(ALL.lock());
}

/// The same, but does nothing while any thread, including this one, holds the list.
pub fn remove_all_unless_busy() {
    if let Ok(paths) = ALL.0.try_lock() {
        Paths::remove(paths);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_listed_is_removed_at_the_end_of_the_program() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("scratch/deep")).unwrap();
        for name in ["copy", "scratch/deep/triangles", "other"] {
            fs::write(path(name), "x").unwrap();
        }
        let all = Paths(Mutex::new(["copy", "scratch", "gone"].map(path).into()));
        Paths::remove(all.lock());
        assert!(!path("copy").exists() && !path("scratch").exists() && path("other").exists());
    }

    #[test]
    fn files_and_folders_are_listed_as_long_as_they_exist() {
        let is_listed = |path: &Path| ALL.lock().contains(path);
        let (file, folder) = (file_of(&mut &b"text"[..]).unwrap(), super::folder().unwrap());
        assert_eq!(fs::read_to_string(file.path()).unwrap(), "text");
        let paths = [file.path(), folder.path()].map(Path::to_owned);
        assert!(paths.iter().all(|path| is_listed(path) && path.to_string_lossy().contains(PREFIX)));
        drop((file, folder));
        assert!(!paths.iter().any(|path| is_listed(path) || path.exists()));
    }

    #[test]
    fn nothing_exists_after_it_left_the_list() {
        struct IsGone(PathBuf);
        impl AsRef<Path> for IsGone {
            fn as_ref(&self) -> &Path {
                &self.0
            }
        }
        // Dropped after the value that holds it has left the list.
        impl Drop for IsGone {
            fn drop(&mut self) {
                assert!(!self.0.exists());
            }
        }
        let folder = tempfile::tempdir().unwrap();
        for is_folder in [false, true] {
            let path = folder.path().join("scratch");
            if is_folder { fs::create_dir_all(path.join("deep")) } else { fs::write(&path, "x") }.unwrap();
            drop(Temporary(IsGone(path)));
        }
    }
}
