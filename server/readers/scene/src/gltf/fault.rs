//! Faults that cost a part of a scene, and the limits that end the reading of it.

use std::cell::Cell;

/// Most elements of accessors without content: zeros, which cost the file nothing.
const MAX_ZEROS: u64 = 1 << 22;

/// Why a part of a scene is left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    /// Short and fixed.
    pub(super) kind: &'static str,
    pub(super) what: String,
}

impl Fault {
    pub(super) fn new(kind: &'static str, what: impl Into<String>) -> Self {
        Self { kind, what: what.into() }
    }

    /// A reference to an item that does not exist.
    pub(super) fn missing(what: &str, index: usize) -> Self {
        Self::new("missing part of a glTF", format!("{what} {index} does not exist"))
    }

    /// Data whose decoder is left out of this program.
    #[cfg(not(all(feature = "basis", feature = "draco", feature = "meshopt")))]
    pub(super) fn left_out(feature: &str) -> Self {
        Self::new("packed data of a glTF is not read", insula_source::error::left_out(feature))
    }

    /// The problem with its place in front.
    pub(super) fn at(self, place: &str) -> (&'static str, String) {
        (self.kind, if self.what.is_empty() { place.to_owned() } else { format!("{place}: {}", self.what) })
    }
}

/// What may still be allocated. The first request beyond it ends the decoding of the scene.
#[derive(Debug)]
pub(super) struct Budget {
    bytes: Cell<u64>,
    vertices: Cell<u64>,
    zeros: Cell<u64>,
    exceeded: Cell<Option<(&'static str, u64)>>,
    max_bytes: u64,
    max_vertices: u64,
}

impl Budget {
    pub(super) fn new(bytes: u64, vertices: u64) -> Self {
        Self {
            bytes: Cell::new(bytes),
            vertices: Cell::new(vertices),
            zeros: Cell::new(MAX_ZEROS),
            exceeded: Cell::new(None),
            max_bytes: bytes,
            max_vertices: vertices,
        }
    }

    /// Takes bytes of decoded buffers and images.
    pub(super) fn take_bytes(&self, bytes: u64) -> Result<(), Fault> {
        self.take(&self.bytes, bytes, "the size of its decoded buffers in bytes", self.max_bytes)
    }

    /// Takes vertices of primitives.
    pub(super) fn take_vertices(&self, vertices: u64) -> Result<(), Fault> {
        self.take(&self.vertices, vertices, "its number of vertices", self.max_vertices)
    }

    /// Takes elements of accessors without content.
    pub(super) fn take_zeros(&self, elements: u64) -> Result<(), Fault> {
        self.take(&self.zeros, elements, "its number of elements without a buffer view", MAX_ZEROS)
    }

    /// What was requested beyond which limit, if anything.
    pub(super) fn exceeded(&self) -> Option<(&'static str, u64)> {
        self.exceeded.get()
    }

    fn take(&self, left: &Cell<u64>, amount: u64, what: &'static str, limit: u64) -> Result<(), Fault> {
        let rest = left.get().checked_sub(amount).ok_or_else(|| self.note(what, limit))?;
        left.set(rest);
        Ok(())
    }

    fn note(&self, what: &'static str, limit: u64) -> Fault {
        self.exceeded.set(Some((what, limit)));
        Fault::new("beyond the limits", what)
    }
}

/// What a decompressor with limits of its own needs.
#[cfg(feature = "draco")]
impl Budget {
    pub(super) fn bytes_left(&self) -> u64 {
        self.bytes.get()
    }

    pub(super) fn vertices_left(&self) -> u64 {
        self.vertices.get()
    }

    /// Notes that a decompressor refused to go beyond the limits.
    pub(super) fn exceed(&self, what: &'static str) -> Fault {
        self.note(what, self.max_bytes)
    }
}
