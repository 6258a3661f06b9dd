//! Files that get their names when they are complete, so that a full disk or a killed program leaves the old ones.

use crate::file::open_regular;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Distinguishes the files of one process.
static NEXT: AtomicU32 = AtomicU32::new(0);
const MAX_TRIES: u32 = 10_000;

/// A file under a temporary name beside its own. It is removed unless it is committed. A device or a pipe is written directly.
#[derive(Debug)]
pub struct NewFile {
    /// Where the content goes: a link keeps pointing to its file.
    path: PathBuf,
    /// `None` for a device or a pipe.
    partial: Option<PathBuf>,
    file: File,
    is_done: bool,
}

impl NewFile {
    /// Creates the file. Fails if the folder does not exist, or if the system refuses.
    pub fn create(path: &Path) -> io::Result<Self> {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let found = fs::metadata(&path).ok();
        if found.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir()) {
            let file = File::options().write(true).open(&path)?;
            return Ok(Self { path, partial: None, file, is_done: true });
        }
        if path.file_name().is_none() || found.as_ref().is_some_and(fs::Metadata::is_dir) {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "not the name of a file"));
        }
        let (partial, file) = create_beside(&path)?;
        if let Some(found) = found {
            // Who could read the old file can read the new one. Some file systems have no permissions.
            let _ = file.set_permissions(found.permissions());
        }
        Ok(Self { path, partial: Some(partial), file, is_done: false })
    }

    /// The file for writing; all calls give the same position. What it buffers must be written before [`Self::commit`].
    pub fn file(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Gives the file its name, in place of an older one. Returns its length in bytes. Fails if it cannot be written; an older file is
    /// unchanged then.
    pub fn commit(mut self) -> io::Result<u64> {
        let Some(partial) = &self.partial else { return Ok(0) };
        self.file.sync_all()?;
        let bytes = self.file.metadata()?.len();
        fs::rename(partial, &self.path)?;
        self.is_done = true;
        if cfg!(unix) {
            // The file is there; whether its name survives a power failure is not for this program to say.
            let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let _ = File::open(folder).and_then(|folder| folder.sync_all());
        }
        Ok(bytes)
    }
}

/// Creates a file of an unused name. Names of this process may be taken: in a container each program has the same number, and one that was
/// killed leaves its files.
fn create_beside(path: &Path) -> io::Result<(PathBuf, File)> {
    let mut tries = 0;
    loop {
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let partial = path.with_file_name(OsString::from(format!(".insula-{}-{number}.tmp", std::process::id())));
        tries += 1;
        match File::options().read(true).write(true).create_new(true).open(&partial) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && tries < MAX_TRIES => {}
            opened => return opened.map(|file| (partial, file)),
        }
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if let Some(partial) = self.partial.as_ref().filter(|_| !self.is_done) {
            // Nothing can be done about a file that cannot be removed; its name says what it is.
            let _ = fs::remove_file(partial);
        }
    }
}

/// Writes a file whole, in place of an older one. Fails as [`NewFile`].
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let new = NewFile::create(path)?;
    new.file()?.write_all(bytes)?;
    new.commit().map(drop)
}

/// Removes a file that begins with a mark, by which its program knows what it wrote; others stay. Returns whether it was removed. Fails if
/// it cannot be read or removed.
pub fn remove_marked(path: &Path, mark: &[u8]) -> io::Result<bool> {
    let mut head = Vec::new();
    open_regular(path)?.take(mark.len() as u64).read_to_end(&mut head)?;
    if head == mark { fs::remove_file(path).map(|()| true) } else { Ok(false) }
}

/// Removes a folder if nothing is in it. Fails if something is.
pub fn remove_empty_folder(path: &Path) -> io::Result<()> {
    fs::remove_dir(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_replaced_whole_and_nothing_stays_beside_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        for text in ["first", "second"] {
            replace(&path, text.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
            let new = NewFile::create(&path).unwrap();
            new.file().unwrap().write_all(b"half").unwrap();
            drop(new);
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert!(replace(&folder.path().join("none/a.json"), b"x").is_err() && replace(folder.path(), b"x").is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        #[cfg(unix)]
        {
            use std::os::unix::fs::{PermissionsExt, symlink};
            let link = folder.path().join("link");
            symlink(&path, &link).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
            replace(&link, b"third").unwrap();
            assert!(link.is_symlink() && fs::read(&path).unwrap() == b"third");
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
            replace(Path::new("/dev/null"), b"x").unwrap();
        }
    }
    #[test]
    fn files_that_a_killed_program_of_the_same_number_left_are_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        // Other tests of this process take numbers, too.
        let next = NEXT.load(Ordering::Relaxed);
        let left = |number: u32| folder.path().join(format!(".insula-{}-{number}.tmp", std::process::id()));
        for number in next..next + 100 {
            fs::write(left(number), "left").unwrap();
        }
        replace(&path, b"whole").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "whole");
        assert!((next..next + 100).all(|number| fs::read_to_string(left(number)).unwrap() == "left"));
    }

    #[test]
    fn only_marked_files_and_empty_folders_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        fs::create_dir(&inner).unwrap();
        let [own, other, short] = ["own", "other", "short"].map(|name| inner.join(name));
        fs::write(&own, b"MARKED and more").unwrap();
        fs::write(&other, b"letters").unwrap();
        fs::write(&short, b"MAR").unwrap();
        let removed = [&own, &other, &short].map(|path| remove_marked(path, b"MARKED").unwrap());
        assert_eq!(removed, [true, false, false]);
        assert!(!own.exists() && other.exists() && short.exists());
        assert!(remove_marked(&own, b"MARKED").is_err() && remove_empty_folder(&inner).is_err());
        fs::remove_file(&other).unwrap();
        fs::remove_file(&short).unwrap();
        remove_empty_folder(&inner).unwrap();
        assert!(!inner.exists());
    }
}
