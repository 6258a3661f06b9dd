//! Files that readers read.

use super::packed::{is_packed, unpacked};
pub use super::random_file::LocalFile;
use super::random_file::{RandomFile, copy_to_disk};
use super::text::{START_BYTES, Start};
use crate::error::InputError;
use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::ops::Range;
use std::rc::Rc;

/// Files with a common parent: a source, its siblings and its images. Names are relative to it, with `/`.
pub trait SourceFiles {
    /// Opens a file. Fails with `NotFound` if it does not exist, and with `PermissionDenied` outside of the source's folder.
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>>;
    /// Size of a file in bytes.
    fn len(&self, name: &str) -> io::Result<u64>;
    /// The file on disk, for readers that need random access: itself, or a temporary copy of an archive's entry.
    fn on_disk(&self, name: &str) -> io::Result<LocalFile>;
    /// The file for reading in any order.
    fn random(&self, name: &str) -> io::Result<RandomFile> {
        RandomFile::of_local(self.on_disk(name)?)
    }
    /// Whether [`Self::random`] reads files where they are, rather than copies of them.
    fn is_random(&self) -> bool {
        false
    }
    /// Distinguishes these files from those of other sources.
    fn location(&self) -> String;
}

/// One of several equal shares of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    pub number: u64,
    pub count: u64,
}

impl Share {
    /// All of it.
    pub const WHOLE: Self = Self { number: 0, count: 1 };

    /// Its range of `total` things.
    pub fn of(self, total: u64) -> Range<u64> {
        // Not more than `total`.
        let bound = |number: u64| (u128::from(total) * u128::from(number) / u128::from(self.count)) as u64;
        bound(self.number)..bound(self.number + 1)
    }
}

/// The source that a reader reads.
#[derive(Clone, Copy)]
pub struct Input<'a> {
    /// For messages.
    pub label: &'a str,
    /// Name within `files`; it may end in `.gz`.
    pub name: &'a str,
    pub files: &'a dyn SourceFiles,
    /// Unpacked sources with more bytes are refused; so is any single allocation beyond it.
    pub max_bytes: u64,
    /// Longer lines or features of a text are refused or skipped.
    pub max_line_bytes: u64,
    /// West, south, east and north in degrees: readers may leave out objects outside of it. The sink filters again.
    pub bbox_deg: Option<[f64; 4]>,
    /// Attribute that the user names for heights of footprints.
    pub height_field: Option<&'a str>,
    /// What is read of it. Only formats that `slice` divides have shares.
    pub share: Share,
}

/// An opened source.
pub struct OpenInput<'a> {
    /// Its unpacked bytes; fails when there are more than the limit.
    pub reader: Box<dyn BufRead + 'a>,
    /// Packed bytes read so far, for [`super::object::ObjectSink::tick`].
    pub bytes_read: Rc<Cell<u64>>,
}

struct CountingReader<'a> {
    inner: Box<dyn Read + 'a>,
    count: Rc<Cell<u64>>,
}

impl Read for CountingReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.count.set(self.count.get() + read as u64);
        Ok(read)
    }
}

struct BoundedReader<R> {
    inner: R,
    left: u64,
}

impl<R: Read> Read for BoundedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.left =
            self.left.checked_sub(read as u64).ok_or_else(|| io::Error::other("more unpacked bytes than allowed"))?;
        Ok(read)
    }
}

impl<'a> Input<'a> {
    /// A whole source without options. A larger one than `max_bytes` is refused, and so is a larger part of it.
    pub fn new(label: &'a str, name: &'a str, files: &'a dyn SourceFiles, max_bytes: u64) -> Self {
        let (bbox_deg, height_field, share) = (None, None, Share::WHOLE);
        Self { label, name, files, max_bytes, max_line_bytes: max_bytes, bbox_deg, height_field, share }
    }

    /// Opens the source, and unpacks it if it is packed by gzip. A text is in UTF-8, without a byte order mark, whatever the file has.
    /// Fails if the file cannot be opened.
    pub fn open(&self) -> Result<OpenInput<'a>, InputError> {
        let io_error = |cause| InputError::io(self.label, cause);
        let inner = self.files.open(self.name).map_err(io_error)?;
        let bytes_read = Rc::new(Cell::new(0));
        let unpacked = unpacked(CountingReader { inner, count: Rc::clone(&bytes_read) }).map_err(io_error)?;
        let mut limited = BoundedReader { inner: unpacked, left: self.max_bytes };
        let mut start = Vec::with_capacity(START_BYTES);
        limited.by_ref().take(START_BYTES as u64).read_to_end(&mut start).map_err(io_error)?;
        let found = Start::of(self.name, &start);
        let all = BufReader::with_capacity(1 << 16, Cursor::new(start).chain(limited));
        let reader = match found {
            Some(start) => start.decoded(all).map_err(io_error)?,
            None => Box::new(all),
        };
        Ok(OpenInput { reader, bytes_read })
    }

    /// The source on disk, as [`Self::open`] has it: in a temporary file if it is packed or in another encoding. Fails if it cannot be
    /// read or is too large.
    pub fn on_disk(&self) -> Result<LocalFile, InputError> {
        let io_error = |cause| InputError::io(self.label, cause);
        let file = self.files.on_disk(self.name).map_err(io_error)?;
        if !self.is_plain(&mut File::open(&file.path).map_err(io_error)?).map_err(io_error)? {
            return copy_to_disk(&mut self.open()?.reader).map_err(io_error);
        }
        self.check_size(std::fs::metadata(&file.path).map_err(io_error)?.len())?;
        Ok(file)
    }

    /// The source for reading in any order, a copy of it as [`Self::on_disk`] makes one. Fails in the same way.
    pub fn random(&self) -> Result<RandomFile, InputError> {
        let io_error = |cause| InputError::io(self.label, cause);
        if self.files.is_random() {
            let file = self.files.random(self.name).map_err(io_error)?;
            if self.is_plain(&mut file.reader(0)).map_err(io_error)? {
                self.check_size(file.bytes())?;
                return Ok(file);
            }
        }
        RandomFile::of_local(self.on_disk()?).map_err(io_error)
    }

    /// Whether the file, whose bytes are given, is read as it is. Fails if it cannot be read.
    pub fn is_plain(&self, bytes: &mut impl Read) -> io::Result<bool> {
        let mut start = Vec::with_capacity(START_BYTES);
        bytes.take(START_BYTES as u64).read_to_end(&mut start)?;
        Ok(!is_packed(&mut &*start)? && Start::of(self.name, &start).is_none())
    }

    fn check_size(&self, bytes: u64) -> Result<(), InputError> {
        if bytes > self.max_bytes {
            let what = "its size in bytes".to_owned();
            return Err(InputError::TooLarge { path: self.label.to_owned(), what, limit: self.max_bytes });
        }
        Ok(())
    }

    /// Reads the whole unpacked source. Fails if it is larger than `limit` or [`Self::max_bytes`].
    pub fn read_all(&self, limit: u64) -> Result<Vec<u8>, InputError> {
        let limit = limit.min(self.max_bytes);
        let mut bytes = Vec::new();
        // The length tells that there are more, without an error of reading.
        let opened = Self { max_bytes: u64::MAX, ..*self }.open()?;
        let read = opened.reader.take(limit.saturating_add(1)).read_to_end(&mut bytes);
        read.map_err(|cause| InputError::io(self.label, cause))?;
        if bytes.len() as u64 > limit {
            return Err(InputError::TooLarge {
                path: self.label.to_owned(),
                what: "its size in bytes".to_owned(),
                limit,
            });
        }
        Ok(bytes)
    }
}
