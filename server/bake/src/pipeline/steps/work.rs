//! Where the steps of a bake keep their results.

use std::{
    fs,
    io::{self, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use serde::{Deserialize, Serialize};

/// Named objects that all machines of a bake reach: a folder, or a bucket of an object store.
///
/// Names are words of a-z, 0-9, `-`, `_` and `.`, separated by `/`. An object exists completely or not at all, and writing it again
/// replaces it at once: two machines may write the same one.
pub trait WorkStore: Send + Sync {
    /// The address, for messages.
    fn address(&self) -> String;

    /// Size of an object in bytes; `None` if there is none. Fails if the store does not answer.
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

    /// Begins an object of `size` bytes that is written in parts, and returns a ticket for them. Fails as [`Self::put`].
    fn begin_parts(&self, name: &str, size: u64) -> io::Result<String>;

    /// Writes a part, of which `start` is the place in the object, and returns a receipt. A part may be written again. Fails as [`Self::put`], or if
    /// there is no such ticket.
    fn put_part(&self, name: &str, ticket: &str, number: u32, start: u64, bytes: Vec<u8>) -> io::Result<String>;

    /// Writes a part that is made of given bytes and of sections of other objects. Fails as [`Self::put_part`], and with an error that
    /// names the object if one is missing or shorter.
    fn put_pieces(
        &self,
        name: &str,
        ticket: &str,
        number: u32,
        start: u64,
        pieces: Vec<PartPiece>,
    ) -> io::Result<String> {
        let length: u64 = pieces.iter().map(PartPiece::length).sum();
        let mut bytes = Vec::with_capacity(usize::try_from(length).map_err(|_| io::ErrorKind::OutOfMemory)?);
        for piece in pieces {
            match piece {
                PartPiece::Given(given) => bytes.extend(given),
                PartPiece::Stored { object, start, length } => {
                    bytes.extend(self.range(&object, start, length).map_err(|cause| in_object(&object, &cause))?);
                }
            }
        }
        self.put_part(name, ticket, number, start, bytes)
    }

    /// Completes an object with the receipts for all parts in their order. Fails as [`Self::put_part`].
    fn finish_parts(&self, name: &str, ticket: &str, receipts: Vec<String>) -> io::Result<()>;

    /// Ends an object that was begun and not completed. Fails if the store does not answer.
    fn abort_parts(&self, name: &str, ticket: &str) -> io::Result<()>;

    /// Some of the objects that were begun in parts and not completed, by whatever step, with their tickets: all of them if there are
    /// few, and none only if there are none. Fails if the store does not answer.
    fn begun_parts(&self) -> io::Result<Vec<(String, String)>>;
}

/// Bytes of a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum PartPiece {
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
    pub fn length(&self) -> u64 {
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

/// An error that names the object whose bytes are missing.
fn in_object(name: &str, cause: &io::Error) -> io::Error {
    io::Error::new(cause.kind(), format!("{name}: {cause}"))
}

/// Objects as files of a folder, which may be on a file system that machines share.
#[derive(Debug)]
pub struct WorkFolder {
    root: PathBuf,
}

/// Distinguishes temporary files of one process.
static NEXT_TEMPORARY: AtomicU64 = AtomicU64::new(0);
/// Folder of files that are not complete.
const TEMPORARY: &str = "temporary";
/// Folder of files that are written in parts.
const PARTS: &str = "parts";

impl WorkFolder {
    /// The folder is created with the first object.
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Fails for a name that no object has.
    fn path(&self, name: &str) -> io::Result<PathBuf> {
        let is_word = |word: &str| {
            let is_allowed = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"-_.".contains(&byte);
            !word.is_empty() && !word.starts_with('.') && word.bytes().all(is_allowed)
        };
        if name.split('/').all(is_word) {
            Ok(self.root.join(name))
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{name}: no name of an object")))
        }
    }

    /// Copies a section of an object to the place of a file.
    fn copy_section(&self, name: &str, start: u64, length: u64, to: &mut fs::File) -> io::Result<()> {
        let mut from = fs::File::open(self.path(name)?)?;
        from.seek(SeekFrom::Start(start))?;
        // Between files, the kernel copies.
        if io::copy(&mut from.take(length), to)? < length { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(()) }
    }

    /// Writes a file under a name of its own, then renames it.
    fn write(&self, name: &str, write: impl FnOnce(&mut fs::File) -> io::Result<()>) -> io::Result<()> {
        let path = self.path(name)?;
        let folder = self.root.join(TEMPORARY);
        fs::create_dir_all(&folder)?;
        let number = NEXT_TEMPORARY.fetch_add(1, Ordering::Relaxed);
        let mut temporary = tempfile::Builder::new().prefix(&format!("{number}-")).tempfile_in(&folder)?;
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

    fn size(&self, name: &str) -> io::Result<Option<u64>> {
        match fs::metadata(self.path(name)?) {
            Ok(meta) => Ok(Some(meta.len())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn range(&self, name: &str, start: u64, length: u64) -> io::Result<Vec<u8>> {
        let mut file = fs::File::open(self.path(name)?)?;
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
        let mut open = vec![folder.to_owned()];
        while let Some(folder) = open.pop() {
            let entries = match fs::read_dir(self.path(&folder)?) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                entries => entries?,
            };
            for entry in entries {
                let entry = entry?;
                let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
                if entry.file_type()?.is_dir() { open.push(name) } else { names.push(name) }
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

    fn begin_parts(&self, name: &str, size: u64) -> io::Result<String> {
        self.path(name)?;
        let ticket = format!("{PARTS}/{}", blake3::hash(name.as_bytes()).to_hex());
        let path = self.root.join(&ticket);
        fs::create_dir_all(self.root.join(PARTS))?;
        // Parts that are there stay: they are equal.
        fs::OpenOptions::new().write(true).create(true).truncate(false).open(path)?.set_len(size)?;
        Ok(ticket)
    }

    fn put_part(&self, name: &str, ticket: &str, number: u32, start: u64, bytes: Vec<u8>) -> io::Result<String> {
        self.put_pieces(name, ticket, number, start, vec![PartPiece::Given(bytes)])
    }

    fn put_pieces(&self, _: &str, ticket: &str, _: u32, start: u64, pieces: Vec<PartPiece>) -> io::Result<String> {
        let mut file = fs::OpenOptions::new().write(true).open(self.path(ticket)?)?;
        file.seek(SeekFrom::Start(start))?;
        for piece in pieces {
            match piece {
                PartPiece::Given(bytes) => io::Write::write_all(&mut file, &bytes)?,
                PartPiece::Stored { object, start, length } => {
                    let copied = self.copy_section(&object, start, length, &mut file);
                    copied.map_err(|cause| in_object(&object, &cause))?;
                }
            }
        }
        file.sync_all()?;
        Ok(String::new())
    }

    fn finish_parts(&self, name: &str, ticket: &str, _: Vec<String>) -> io::Result<()> {
        let path = self.path(name)?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        fs::rename(self.path(ticket)?, path)
    }

    fn abort_parts(&self, _: &str, ticket: &str) -> io::Result<()> {
        self.remove(ticket)
    }

    fn begun_parts(&self) -> io::Result<Vec<(String, String)>> {
        let tickets = [self.list(PARTS)?, self.list(TEMPORARY)?].concat();
        Ok(tickets.into_iter().map(|ticket| (ticket.clone(), ticket)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

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
        let of_objects = |length| {
            vec![PartPiece::Given(b"s".to_vec()), PartPiece::Stored { object: "a/b".to_owned(), start: 1, length }]
        };
        store.put_pieces("e", &ticket, 0, 0, of_objects(5)).unwrap();
        assert_eq!(
            store.put_pieces("e", &ticket, 0, 0, of_objects(6)).unwrap_err().kind(),
            io::ErrorKind::UnexpectedEof
        );
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
    }
}
