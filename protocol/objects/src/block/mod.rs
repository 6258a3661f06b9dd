//! Blocks of objects: the records of [`BLOCK_OBJECTS`] ids, column by column.
//!
//! A block has a header of [`HEADER_BYTES`] bytes: magic, version, CRC-32 of all bytes after it, block number, size of the payload.
//! The payload is one zstd frame:
//!
//! | part | content |
//! |---|---|
//! | ids | number of slots, which slots are in use; the objects in use are the rows |
//! | kinds | a column of numbers |
//! | identifiers | a list of texts |
//! | parents | which rows have one; differences of its id to the own |
//! | bounds | which rows have them; six columns: lower corners, extents |
//! | attributes | number of columns; of each the attribute, its type, which rows have it, and the values |
//!
//! All integers of the header are little-endian. `numbers`, `floats`, `text_list` and `columns` describe the codings.

mod columns;
mod cost;
mod decode;
mod encode;
mod floats;
pub(crate) mod numbers;
mod rows;
mod text_list;

use crate::kind::FeatureKind;
use crate::value::{Value, ValueRef};
use columns::AttributeColumn;
pub use encode::encode;
use text_list::TextList;

/// Number of ids of a block. Object `id` is in block `id / BLOCK_OBJECTS`.
pub const BLOCK_OBJECTS: usize = 512;
/// The first four bytes of every block.
pub const MAGIC: [u8; 4] = *b"INSO";
/// Version of the format. Any change of bytes raises it.
pub const VERSION: u16 = 1;
/// Bytes before the zstd frame.
pub const HEADER_BYTES: usize = 18;
/// Maximum size of a payload in bytes before compression.
pub const MAX_PAYLOAD_BYTES: usize = 16 << 20;

/// What is stored of an object.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectRecord {
    /// Identifier of the source, at most 4096 bytes. May be empty.
    pub identifier: String,
    pub kind: FeatureKind,
    /// Id of the object that it is a part of.
    pub parent: Option<u32>,
    pub bounds: Option<ObjectBounds>,
    /// Indices of attributes in the schema in ascending order, with values of the attributes' types.
    pub attributes: Vec<(u32, Value)>,
}

/// A box around an object in decimetres from the city's origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObjectBounds {
    pub min: [i32; 3],
    /// Not below `min`.
    pub max: [i32; 3],
}

impl ObjectBounds {
    /// Upper minus lower end in metres.
    pub fn height_m(&self) -> f64 {
        let [.., min] = self.min;
        let [.., max] = self.max;
        (f64::from(max) - f64::from(min)) / 10.0
    }

    /// The box around both.
    #[must_use]
    pub fn union(&self, other: Self) -> Self {
        let Self { mut min, mut max } = other;
        min.iter_mut().zip(self.min).for_each(|(low, own)| *low = own.min(*low));
        max.iter_mut().zip(self.max).for_each(|(high, own)| *high = own.max(*high));
        Self { min, max }
    }
}

/// A decoded block.
#[derive(Debug, Clone)]
pub struct ObjectBlock {
    /// Ids in use, ascending. An object's position is its row.
    ids: Vec<u32>,
    kinds: Vec<FeatureKind>,
    identifiers: TextList,
    parents: Vec<Option<u32>>,
    bounds: Vec<Option<ObjectBounds>>,
    /// By attribute, ascending.
    columns: Vec<AttributeColumn>,
}

impl ObjectBlock {
    /// The ids of the block's objects, ascending.
    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// All that is stored of an object. `None` if the block does not have it.
    pub fn record(&self, id: u32) -> Option<ObjectRecord> {
        let row = self.row(id)?;
        let value = |column: &AttributeColumn| Some((column.attribute, column.value(row)?.to_value()));
        Some(ObjectRecord {
            identifier: self.identifiers.get(row)?.to_owned(),
            kind: *self.kinds.get(row)?,
            parent: self.parent(id),
            bounds: self.bounds(id),
            attributes: self.columns.iter().filter_map(value).collect(),
        })
    }

    /// The object's identifier in the source.
    pub fn identifier(&self, id: u32) -> Option<&str> {
        self.identifiers.get(self.row(id)?)
    }

    /// The kind of an object; `None` if the block has no such object.
    pub fn kind(&self, id: u32) -> Option<FeatureKind> {
        self.kinds.get(self.row(id)?).copied()
    }

    /// The id of the object that the object is a part of.
    pub fn parent(&self, id: u32) -> Option<u32> {
        self.parents.get(self.row(id)?).copied().flatten()
    }

    /// The box of an object; `None` if the block has no such object, or if the object has no shape.
    pub fn bounds(&self, id: u32) -> Option<ObjectBounds> {
        self.bounds.get(self.row(id)?).copied().flatten()
    }

    /// The value of attribute `attribute` of the schema. `None` if the object does not have it.
    pub fn value(&self, id: u32, attribute: u32) -> Option<Value> {
        self.value_ref(self.row(id)?, attribute).map(ValueRef::to_value)
    }

    pub(crate) fn value_ref(&self, row: usize, attribute: u32) -> Option<ValueRef<'_>> {
        let at = self.columns.binary_search_by_key(&attribute, |column| column.attribute).ok()?;
        self.columns.get(at)?.value(row)
    }

    pub(crate) fn row(&self, id: u32) -> Option<usize> {
        self.ids.binary_search(&id).ok()
    }
}

#[cfg(test)]
mod tests;
