//! Files of a source that consists of many: opened by name, unpacked, counted and within the limit.

use insula_source::input::Input;
use insula_source::packed::unpacked;
use std::cell::Cell;
use std::io::{self, Read};

/// The files of a source.
pub(crate) struct TileFiles<'a> {
    pub(crate) input: Input<'a>,
    /// Whether the files come over HTTP: then queries are part of their names.
    pub(crate) is_remote: bool,
    bytes_read: Cell<u64>,
}

impl<'a> TileFiles<'a> {
    pub(crate) fn new(input: Input<'a>) -> Self {
        let location = input.files.location();
        let is_remote = location.starts_with("http://") || location.starts_with("https://");
        Self { input, is_remote, bytes_read: Cell::new(0) }
    }

    /// Bytes of all files read so far, unpacked.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes_read.get()
    }

    /// Reads a file and unpacks gzip, whatever its name. Fails if it has more than [`Input::max_bytes`] unpacked bytes.
    pub(crate) fn read(&self, name: &str) -> io::Result<Vec<u8>> {
        let limit = self.input.max_bytes;
        let mut bytes = Vec::new();
        self.open(name)?.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > limit {
            return Err(io::Error::other(format!("more than {limit} unpacked bytes")));
        }
        self.bytes_read.set(self.bytes_read.get() + bytes.len() as u64);
        Ok(bytes)
    }

    /// At most the first `count` bytes of a file, unpacked.
    pub(crate) fn read_start(&self, name: &str, count: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.open(name)?.take(count).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        let files = self.input.files;
        let packed_name = format!("{name}.gz");
        let packed = match files.open(name) {
            Err(error) if error.kind() == io::ErrorKind::NotFound && !self.is_remote => {
                files.open(&packed_name).map_err(|_| error)?
            }
            opened => opened?,
        };
        unpacked(packed)
    }
}
