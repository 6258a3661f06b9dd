//! Files that are read in any order: on disk, or in a bucket.

use super::address_reader::AddressReader;
use super::input_budget::InputBudget;
use super::temporary::{self, TemporaryFile};
use bytes::Bytes;
use lru::LruCache;
use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes of one request to a bucket.
const BLOCK_BYTES: u64 = 4 << 20;
/// Blocks of an object that are kept: columns of a table are read side by side. The compiler evaluates the `unwrap`.
const KEPT_BLOCKS: NonZeroUsize = NonZeroUsize::new(16).unwrap();

/// A file on disk, which is removed with this value if it is a copy.
#[derive(Debug)]
pub struct LocalFile {
    pub path: PathBuf,
    pub copy: Option<TemporaryFile>,
}

/// Copies bytes to a temporary file.
pub fn copy_to_disk(reader: &mut dyn Read) -> io::Result<LocalFile> {
    let copy = temporary::file_of(reader)?;
    Ok(LocalFile { path: copy.path().to_owned(), copy: Some(copy) })
}

/// The same of at most `limit` bytes. Fails if there are more.
pub fn copy_up_to(reader: &mut dyn Read, limit: u64) -> io::Result<LocalFile> {
    let local = copy_to_disk(&mut reader.take(limit.saturating_add(1)))?;
    if fs::metadata(&local.path)?.len() > limit {
        return Err(io::Error::other(format!("more than the {limit} bytes that are copied to disk; split the file")));
    }
    Ok(local)
}

/// A file that is read in any order. Cheap to clone.
#[derive(Clone)]
pub struct RandomFile {
    content: Arc<Mutex<Content>>,
    bytes: u64,
}

enum Content {
    /// With the file that is removed afterwards.
    Disk(File, #[expect(dead_code, reason = "removes the file when dropped")] LocalFile),
    Object {
        address: String,
        reader: &'static dyn AddressReader,
        /// Of all files of the input.
        budget: Arc<InputBudget>,
        blocks: LruCache<u64, Bytes>,
    },
}

/// Reads a file from a position on.
pub struct RandomReader {
    file: RandomFile,
    position: u64,
}

impl RandomFile {
    /// Opens a file on disk. Fails if it cannot be read.
    pub fn of_local(local: LocalFile) -> io::Result<Self> {
        let file = File::open(&local.path)?;
        let bytes = file.metadata()?.len();
        Ok(Self { content: Arc::new(Mutex::new(Content::Disk(file, local))), bytes })
    }

    /// An object of a bucket with `bytes` bytes.
    pub(crate) fn of_object(
        address: String,
        bytes: u64,
        reader: &'static dyn AddressReader,
        budget: Arc<InputBudget>,
    ) -> Self {
        let blocks = LruCache::new(KEPT_BLOCKS);
        Self { content: Arc::new(Mutex::new(Content::Object { address, reader, budget, blocks })), bytes }
    }

    /// Its size.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reads from a position on.
    pub fn reader(&self, position: u64) -> BufReader<RandomReader> {
        BufReader::with_capacity(1 << 16, RandomReader { file: self.clone(), position })
    }

    fn content(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads bytes at a position into `buffer`. Returns their number: 0 at the end of the file.
    fn read_at(&self, position: u64, buffer: &mut [u8]) -> io::Result<usize> {
        match &mut *self.content() {
            Content::Disk(file, _) => {
                file.seek(SeekFrom::Start(position))?;
                file.read(buffer)
            }
            Content::Object { address, reader, budget, blocks } => {
                if position >= self.bytes {
                    return Ok(0);
                }
                let start = position - position % BLOCK_BYTES;
                let block = blocks.try_get_or_insert(start, || {
                    let end = self.bytes.min(start + BLOCK_BYTES);
                    budget.check(address)?;
                    let block = reader.range(address, start..end)?;
                    budget.spend(block.len() as u64);
                    if block.len() as u64 == end - start { Ok(block.into()) } else { Err(changed()) }
                })?;
                let rest = &block[(position - start) as usize..];
                let count = rest.len().min(buffer.len());
                buffer[..count].copy_from_slice(&rest[..count]);
                Ok(count)
            }
        }
    }
}

fn changed() -> io::Error {
    io::Error::other("the object has changed while it was read")
}

impl Read for RandomReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read_at(self.position, buffer)?;
        self.position += count as u64;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::super::address_reader::ListedObject;
    use super::super::input_budget::MAX_INPUT_BYTES;
    use super::*;
    use std::ops::Range;

    /// An object whose bytes are their position modulo 251.
    #[derive(Debug)]
    struct Pattern;

    impl AddressReader for Pattern {
        fn fetch(&self, _: &str, _: u64) -> io::Result<Vec<u8>> {
            Err(io::ErrorKind::Unsupported.into())
        }

        fn list(&self, _: &str) -> io::Result<Vec<ListedObject>> {
            Err(io::ErrorKind::Unsupported.into())
        }

        fn size(&self, _: &str) -> io::Result<u64> {
            Err(io::ErrorKind::Unsupported.into())
        }

        fn range(&self, address: &str, range: Range<u64>) -> io::Result<Vec<u8>> {
            let end = if address.ends_with("short") { range.end - 1 } else { range.end };
            Ok((range.start..end).map(|position| (position % 251) as u8).collect())
        }
    }

    fn object(address: &str, bytes: u64) -> RandomFile {
        RandomFile::of_object(address.to_owned(), bytes, &Pattern, Arc::new(InputBudget::start()))
    }

    fn bytes_at(file: &RandomFile, start: u64, length: usize) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        file.reader(start).read_exact(&mut bytes).map(|()| bytes)
    }

    #[test]
    fn objects_are_read_in_any_order_and_not_behind_their_end() {
        let bytes = 2 * BLOCK_BYTES + 100;
        let object = object("s3://b/a", bytes);
        let expected = |start: u64, length: u64| (start..start + length).map(|p| (p % 251) as u8).collect::<Vec<u8>>();
        for (start, length) in [(0, 10), (BLOCK_BYTES - 5, 10), (bytes - 100, 100), (3, BLOCK_BYTES + 9)] {
            assert_eq!(bytes_at(&object, start, length as usize).unwrap(), expected(start, length), "{start} {length}");
        }
        assert!(bytes_at(&object, bytes - 1, 2).is_err() && bytes_at(&object, u64::MAX, 2).is_err());
        let mut rest = Vec::new();
        object.reader(bytes - 7).read_to_end(&mut rest).unwrap();
        assert_eq!(rest, expected(bytes - 7, 7));
        assert!(bytes_at(&self::object("s3://b/short", 99), 0, 1).is_err());
    }

    #[test]
    fn an_input_without_end_is_given_up() {
        let budget = Arc::new(InputBudget::start());
        let of = |name: &str| RandomFile::of_object(name.into(), 2 * BLOCK_BYTES, &Pattern, Arc::clone(&budget));
        let first = of("s3://b/a");
        bytes_at(&first, 0, 1).unwrap();
        budget.spend(MAX_INPUT_BYTES);
        for file in [first, of("s3://b/b")] {
            let error = bytes_at(&file, BLOCK_BYTES, 1).unwrap_err().to_string();
            assert!(error.contains(&format!("more than {MAX_INPUT_BYTES} bytes in all")), "{error}");
        }
    }

    #[test]
    fn longer_files_are_not_copied_in_part() {
        let copied = |limit| copy_up_to(&mut &b"some text"[..], limit);
        assert_eq!(fs::read(copied(9).unwrap().path.as_path()).unwrap(), b"some text");
        assert!(copied(8).unwrap_err().to_string().contains("more than the 8 bytes"));
    }
}
