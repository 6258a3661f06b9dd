//! Where the steps of a bake keep their results.

use insula_archive::file::open_regular;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Named objects that all machines of a bake reach: a folder, or a bucket of an object store.
///
/// Names are words of a-z, 0-9, `-`, `_` and `.`, separated by `/`. An object exists completely or not at all, and writing it again
/// replaces it at once: two machines may write the same one.
pub trait WorkStore: Send + Sync {
    /// The address, for messages.
    fn address(&self) -> String;

    /// Its folder, if it is one of this machine.
    fn folder(&self) -> Option<&Path> {
        None
    }

    /// Size of an object in bytes; `None` if there is none. Fails if the store does not answer, or if something else has the name.
    fn size(&self, name: &str) -> io::Result<Option<u64>>;

    /// A part of an object. Fails with `UnexpectedEof` if the object is shorter, or if the store does not answer.
    fn range(&self, name: &str, start: u64, length: u64) -> io::Result<Vec<u8>>;

    /// Copies an object to a new file. Fails if there is none, or if it cannot be copied.
    fn fetch(&self, name: &str, to: &Path) -> io::Result<()>;

    /// Writes an object. Fails if the store does not take it.
    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()>;

    /// Copies a file to an object. Fails as [`Self::put`], or if the file cannot be read.
    fn put_file(&self, name: &str, from: &Path) -> io::Result<()>;

    /// Names of all objects below `folder`, in ascending order. Fails if the store does not answer.
    fn list(&self, folder: &str) -> io::Result<Vec<String>>;

    /// Removes an object, if it exists. Fails if the store does not answer.
    fn remove(&self, name: &str) -> io::Result<()>;

    /// Removes the folders in which only removed objects of these names were, if the store has folders. What others put there stays, and
    /// so does a folder that cannot be removed.
    fn remove_folders(&self, _names: &[String]) {}

    /// Begins an object of `size` bytes that is written in parts, and returns a ticket for them. Fails as [`Self::put`].
    fn begin_parts(&self, name: &str, size: u64) -> io::Result<String>;

    /// Writes a part, of which `start` is the place in the object, and returns a receipt. A part may be written again. Fails as [`Self::put`], or if
    /// there is no such ticket.
    fn put_part(&self, name: &str, ticket: &str, number: u32, start: u64, bytes: Vec<u8>) -> io::Result<String>;

    /// Completes an object with the receipts for all parts in their order. Fails as [`Self::put_part`].
    fn finish_parts(&self, name: &str, ticket: &str, receipts: Vec<String>) -> io::Result<()>;

    /// Ends an object that was begun and not completed. Does nothing if no step began it. Fails if the store does not answer.
    fn abort_parts(&self, name: &str, ticket: &str) -> io::Result<()>;

    /// Some of the objects that were begun in parts and not completed, by whatever step, with their tickets: all of them if there are
    /// few, and none only if there are none. Fails if the store does not answer.
    fn begun_parts(&self) -> io::Result<Vec<(String, String)>>;
}

/// Bytes of a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum PartPiece {
    Given(Vec<u8>),
    /// A section of an object of the store.
    Stored {
        object: String,
        start: u64,
        length: u64,
    },
}

impl PartPiece {
    /// Number of its bytes.
    pub(super) fn length(&self) -> u64 {
        match self {
            Self::Given(bytes) => bytes.len() as u64,
            Self::Stored { length, .. } => *length,
        }
    }

    /// A section, which must be inside.
    pub(super) fn section(&self, from: u64, length: u64) -> Self {
        match self {
            Self::Given(bytes) => Self::Given(bytes[from as usize..(from + length) as usize].to_vec()),
            Self::Stored { object, start, .. } => Self::Stored { object: object.clone(), start: start + from, length },
        }
    }
}

/// Objects as files of a folder, which may be on a file system that machines share. Links in it are not followed.
#[derive(Debug)]
pub struct WorkFolder {
    root: PathBuf,
}

/// Folder of files that are not complete.
const TEMPORARY: &str = "temporary";
/// Folder of files that are written in parts.
const PARTS: &str = "parts";

/// Begins the names of files that are not complete.
fn hash_of(name: &str) -> String {
    blake3::hash(name.as_bytes()).to_hex().to_string()
}

impl WorkFolder {
    /// The folder is created with the first object.
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Fails for a name that no object has, and if it leads through a link.
    fn path(&self, name: &str) -> io::Result<PathBuf> {
        let is_word = |word: &str| {
            let is_allowed = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"-_.".contains(&byte);
            !word.is_empty() && !word.starts_with('.') && word.bytes().all(is_allowed)
        };
        let refused = |what: &str| Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{name}: {what}")));
        if !name.split('/').all(is_word) {
            return refused("no name of an object");
        }
        let mut path = self.root.clone();
        for word in name.split('/') {
            path.push(word);
            if path.is_symlink() {
                return refused("a link, which steps do not follow");
            }
        }
        Ok(path)
    }

    /// The path of a file that is not complete. Its name begins with the hash of the object's, so that no other file has such a name.
    fn incomplete(&self, ticket: &str) -> io::Result<Option<PathBuf>> {
        let Some((folder, name)) = ticket.split_once('/') else { return Ok(None) };
        let (hash, rest) = name.split_at_checked(blake3::OUT_LEN * 2).unwrap_or((name, ""));
        let is_own = blake3::Hash::from_hex(hash).is_ok()
            && rest.bytes().all(|byte| byte.is_ascii_alphanumeric() || b".-".contains(&byte))
            && (folder == PARTS && rest.is_empty() || folder == TEMPORARY && rest.starts_with('.'));
        let path = self.path(folder)?.join(name);
        let is_file = || fs::symlink_metadata(&path).is_ok_and(|found| found.is_file());
        Ok((is_own && is_file()).then_some(path))
    }

    /// The same of a file that must be there.
    fn begun(&self, ticket: &str) -> io::Result<PathBuf> {
        self.incomplete(ticket)?.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, format!("{ticket}: not begun")))
    }

    /// Writes a file under a name of its own, then renames it.
    fn write(&self, name: &str, write: impl FnOnce(&mut fs::File) -> io::Result<()>) -> io::Result<()> {
        let path = self.path(name)?;
        let folder = self.path(TEMPORARY)?;
        fs::create_dir_all(&folder)?;
        let mut temporary = tempfile::Builder::new().prefix(&format!("{}.", hash_of(name))).tempfile_in(&folder)?;
        write(temporary.as_file_mut())?;
        temporary.as_file().sync_all()?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        // Other users of a shared file system read results too.
        #[cfg(unix)]
        temporary.as_file().set_permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644))?;
        temporary.persist(&path).map_err(|error| error.error)?;
        Ok(())
    }
}

impl WorkStore for WorkFolder {
    fn address(&self) -> String {
        self.root.display().to_string()
    }

    fn folder(&self) -> Option<&Path> {
        Some(&self.root)
    }

    fn size(&self, name: &str) -> io::Result<Option<u64>> {
        match fs::symlink_metadata(self.path(name)?) {
            Ok(meta) if !meta.is_file() => Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")),
            Ok(meta) => Ok(Some(meta.len())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn range(&self, name: &str, start: u64, length: u64) -> io::Result<Vec<u8>> {
        let mut file = open_regular(&self.path(name)?)?;
        let end = start.checked_add(length).filter(|end| file.metadata().is_ok_and(|meta| *end <= meta.len()));
        end.ok_or(io::ErrorKind::UnexpectedEof)?;
        let length = usize::try_from(length).map_err(|_| io::ErrorKind::OutOfMemory)?;
        file.seek(SeekFrom::Start(start))?;
        let mut bytes = vec![0; length];
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn fetch(&self, name: &str, to: &Path) -> io::Result<()> {
        let from = self.path(name)?;
        drop(open_regular(&from)?);
        // A link costs nothing, but not every file system has it.
        fs::hard_link(&from, to).or_else(|_| fs::copy(&from, to).map(drop))
    }

    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        self.write(name, |file| io::Write::write_all(file, &bytes))
    }

    fn put_file(&self, name: &str, from: &Path) -> io::Result<()> {
        self.write(name, |file| io::copy(&mut fs::File::open(from)?, file).map(drop))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        // Folders of others in it may have any names.
        let mut open = vec![(folder.to_owned(), self.path(folder)?)];
        while let Some((folder, path)) = open.pop() {
            let entries = match fs::read_dir(path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                entries => entries?,
            };
            for entry in entries {
                let entry = entry?;
                let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
                if entry.file_type()?.is_dir() { open.push((name, entry.path())) } else { names.push(name) }
            }
        }
        names.sort_unstable();
        Ok(names)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        match fs::remove_file(self.path(name)?) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    fn remove_folders(&self, names: &[String]) {
        let own = [TEMPORARY, PARTS].into_iter();
        let ancestors = names.iter().flat_map(|name| name.match_indices('/').map(move |(end, _)| &name[..end]));
        let folders: BTreeSet<&str> = own.chain(ancestors).collect();
        // In reverse order, a folder comes after those that it contains.
        for folder in folders.into_iter().rev() {
            if let Ok(path) = self.path(folder) {
                // It fails for one that is not empty.
                let _ = fs::remove_dir(path);
            }
        }
    }

    fn begin_parts(&self, name: &str, size: u64) -> io::Result<String> {
        self.path(name)?;
        let ticket = format!("{PARTS}/{}", hash_of(name));
        let path = self.path(&ticket)?;
        fs::create_dir_all(self.path(PARTS)?)?;
        if path.exists() && !path.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{ticket}: not a regular file")));
        }
        // Parts that are there stay: they are equal.
        fs::OpenOptions::new().write(true).create(true).truncate(false).open(path)?.set_len(size)?;
        Ok(ticket)
    }

    fn put_part(&self, _: &str, ticket: &str, _: u32, start: u64, bytes: Vec<u8>) -> io::Result<String> {
        let mut file = fs::OpenOptions::new().write(true).open(self.begun(ticket)?)?;
        file.seek(SeekFrom::Start(start))?;
        io::Write::write_all(&mut file, &bytes)?;
        file.sync_all()?;
        Ok(String::new())
    }

    fn finish_parts(&self, name: &str, ticket: &str, _: Vec<String>) -> io::Result<()> {
        let path = self.path(name)?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        fs::rename(self.begun(ticket)?, path)
    }

    fn abort_parts(&self, _: &str, ticket: &str) -> io::Result<()> {
        let removed = self.incomplete(ticket)?.map(fs::remove_file);
        match removed {
            Some(Err(error)) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    fn begun_parts(&self) -> io::Result<Vec<(String, String)>> {
        let mut begun = Vec::new();
        for ticket in [self.list(PARTS)?, self.list(TEMPORARY)?].concat() {
            if self.incomplete(&ticket)?.is_some() {
                begun.push((ticket.clone(), ticket));
            }
        }
        Ok(begun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn folders_of_removed_objects_go_and_those_of_others_stay() {
        let folder = TestFolder::new("work-folders");
        let store = WorkFolder::new(&folder.path);
        let names = ["scan/0/a", "scan/0/b", "city/x"].map(str::to_owned);
        names.iter().for_each(|name| store.put(name, b"a".to_vec()).unwrap());
        fs::create_dir(folder.path.join("city/mine")).unwrap();
        names.iter().for_each(|name| store.remove(name).unwrap());
        store.remove_folders(&names);
        let left: Vec<_> = fs::read_dir(&folder.path).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["city"]);
        assert!(folder.path.join("city/mine").is_dir());
    }

    #[test]
    fn objects_are_replaced_listed_made_of_parts_and_removed() {
        let folder = TestFolder::new("work-folder");
        let store = WorkFolder::new(&folder.path.join("work"));
        assert_eq!((store.size("a/b").unwrap(), store.list("a").unwrap()), (None, vec![]));
        store.put("a/b", b"first".to_vec()).unwrap();
        store.put("a/b", b"second".to_vec()).unwrap();
        store.put("a/c/d", b"!".to_vec()).unwrap();
        assert_eq!(store.range("a/b", 1, 3).unwrap(), b"eco");
        assert_eq!(store.range("a/b", 1, 6).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        assert_eq!(store.range("a/b", 1, u64::MAX).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        assert_eq!(store.list("a").unwrap(), ["a/b", "a/c/d"]);
        let ticket = store.begin_parts("e", 7).unwrap();
        for (number, start, bytes) in [(1, 6, "!"), (0, 0, "second"), (0, 0, "second")] {
            store.put_part("e", &ticket, number, start, bytes.into()).unwrap();
        }
        assert_eq!(store.size("e").unwrap(), None);
        store.finish_parts("e", &ticket, vec![String::new(); 2]).unwrap();
        assert!(store.put_part("e", &ticket, 0, 0, vec![1]).is_err());
        store.fetch("e", &folder.path.join("copy")).unwrap();
        assert_eq!(fs::read(folder.path.join("copy")).unwrap(), b"second!");
        let ticket = store.begin_parts("f", 1 << 30).unwrap();
        assert_eq!(store.begun_parts().unwrap(), [(ticket.clone(), ticket.clone())]);
        store.abort_parts("f", &ticket).unwrap();
        assert!(store.list("parts").unwrap().is_empty() && store.begun_parts().unwrap().is_empty());
        store.remove("a/b").unwrap();
        store.remove("a/b").unwrap();
        assert_eq!(store.size("a/b").unwrap(), None);
        assert_eq!(fs::read_dir(folder.path.join("work/temporary")).unwrap().count(), 0);
    }

    #[test]
    fn names_do_not_lead_out_of_the_folder() {
        let folder = TestFolder::new("work-names");
        let store = WorkFolder::new(&folder.path);
        for name in ["../a", "/etc/passwd", "a//b", "", ".hidden", "a/../b", "A", "a\\b"] {
            assert!(store.put(name, Vec::new()).is_err(), "{name}");
        }
        #[cfg(unix)]
        {
            let mine = TestFolder::new("work-mine");
            fs::write(mine.path.join("a"), "dear").unwrap();
            std::os::unix::fs::symlink(&mine.path, folder.path.join("scan")).unwrap();
            assert!(store.put("scan/a", Vec::new()).is_err() && store.remove("scan/a").is_err());
            assert!(store.list("scan").is_err() && store.size("scan/a").is_err());
            assert_eq!(fs::read(mine.path.join("a")).unwrap(), b"dear");
        }
    }

    #[test]
    fn files_of_others_among_those_that_are_not_complete_stay() {
        let folder = TestFolder::new("work-incomplete");
        let store = WorkFolder::new(&folder.path);
        store.begin_parts("a", 4).unwrap();
        for name in ["temporary/1-mine", "parts/letters.txt", "temporary/My photos/a.png"] {
            fs::create_dir_all(folder.path.join(name).parent().unwrap()).unwrap();
            fs::write(folder.path.join(name), "dear").unwrap();
            store.abort_parts(name, name).unwrap();
            assert!(folder.path.join(name).exists());
        }
        // A process that was killed leaves such a file.
        let left = format!("temporary/{}.aB3xyZ", hash_of("a"));
        fs::write(folder.path.join(&left), "half").unwrap();
        let begun = store.begun_parts().unwrap();
        assert_eq!(begun.len(), 2);
        begun.iter().for_each(|(name, ticket)| store.abort_parts(name, ticket).unwrap());
        assert!(store.begun_parts().unwrap().is_empty() && !folder.path.join(&left).exists());
    }
}
