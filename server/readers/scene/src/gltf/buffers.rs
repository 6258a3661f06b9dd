//! Buffers and buffer views, loaded and decompressed when they are first needed.

use super::fault::{Budget, Fault};
use super::schema::{Meshopt, Root};
use super::uri::{self, Target};
use super::{Resources, meshopt};
use std::cell::OnceCell;

/// Kind of all faults of buffers.
const KIND: &str = "buffer of a glTF cannot be read";

/// The bytes of a document.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    binary: Option<&'a [u8]>,
    resources: Resources<'a>,
    budget: &'a Budget,
    /// Loaded buffers.
    buffers: Vec<OnceCell<Result<Vec<u8>, Fault>>>,
    /// Decompressed views.
    views: Vec<OnceCell<Result<Vec<u8>, Fault>>>,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(root: &'a Root, binary: Option<&'a [u8]>, resources: Resources<'a>, budget: &'a Budget) -> Self {
        Self {
            root,
            binary,
            resources,
            budget,
            buffers: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            views: root.buffer_views.iter().map(|_| OnceCell::new()).collect(),
        }
    }

    pub(super) fn budget(&self) -> &Budget {
        self.budget
    }

    /// Loads a file beside the document.
    pub(super) fn file(&self, path: &str) -> Result<Vec<u8>, Fault> {
        let bytes = (self.resources)(path).map_err(|error| Fault::new(KIND, format!("{path}: {error}")))?;
        self.budget.take_bytes(bytes.len() as u64)?;
        Ok(bytes)
    }

    pub(super) fn uri(&self, uri: &str) -> Result<Vec<u8>, Fault> {
        match uri::resolve(uri, |bytes| self.budget.take_bytes(bytes))? {
            Target::Content(bytes) => Ok(bytes),
            Target::File(path) => self.file(&path),
        }
    }

    /// The bytes of a view, decompressed.
    pub(super) fn view(&self, index: usize) -> Result<&[u8], Fault> {
        let view = self.root.buffer_views.get(index).ok_or_else(|| Fault::missing("buffer view", index))?;
        let extensions = view.extensions.as_deref();
        let compressed = extensions.and_then(|e| e.khr_meshopt.as_ref().or(e.ext_meshopt.as_ref()));
        let Some(compressed) = compressed else {
            return self.range(view.buffer, view.byte_offset, view.byte_length);
        };
        let cell = self.views.get(index).ok_or_else(|| Fault::missing("buffer view", index))?;
        let decoded = cell.get_or_init(|| self.decompress(compressed));
        decoded.as_deref().map_err(Fault::clone)
    }

    /// Distance between the elements of a view, if it states one.
    pub(super) fn stride(&self, index: usize) -> Option<u64> {
        let view = self.root.buffer_views.get(index)?;
        let extensions = view.extensions.as_deref();
        let compressed = extensions.and_then(|e| e.khr_meshopt.as_ref().or(e.ext_meshopt.as_ref()));
        // Indices of one accessor are always packed.
        let attributes = compressed.filter(|c| c.mode == "ATTRIBUTES").map(|c| c.byte_stride);
        view.byte_stride.or(attributes).filter(|stride| *stride > 0)
    }

    fn decompress(&self, compressed: &Meshopt) -> Result<Vec<u8>, Fault> {
        let source = self.range(compressed.buffer, compressed.byte_offset, compressed.byte_length)?;
        meshopt::decode(compressed, source, self.budget)
    }

    fn range(&self, buffer: usize, offset: u64, length: u64) -> Result<&[u8], Fault> {
        let bytes = self.buffer(buffer)?;
        let end = offset.checked_add(length).and_then(|end| usize::try_from(end).ok());
        let range = end.and_then(|end| bytes.get(usize::try_from(offset).ok()?..end));
        range.ok_or_else(|| {
            let size = bytes.len();
            Fault::new(
                KIND,
                format!("bytes {offset} to {offset} + {length} are not in buffer {buffer} of {size} bytes"),
            )
        })
    }

    fn buffer(&self, index: usize) -> Result<&[u8], Fault> {
        let (buffer, cell) =
            self.root.buffers.get(index).zip(self.buffers.get(index)).ok_or_else(|| Fault::missing("buffer", index))?;
        match (&buffer.uri, self.binary) {
            (Some(uri), _) => cell.get_or_init(|| self.uri(uri)).as_deref().map_err(Fault::clone),
            (None, Some(binary)) if index == 0 => Ok(binary),
            (None, _) => Err(Fault::new(KIND, format!("buffer {index} has no content"))),
        }
    }
}
