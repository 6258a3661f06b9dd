//! The packed Hilbert R-tree between header and features: nodes of a box and an offset, from the root to the leaves.

use super::Schema;
use crate::vector::feature::are_apart;
use ::flatgeobuf::Header;
use insula_source::error::InputError;
use insula_source::input::Input;
use std::io::{self, BufRead, Read};

/// West, south, east, north, and an offset.
const NODE_BYTES: u64 = 40;
/// Nodes that are read at once.
const CHUNK_NODES: u64 = 1024;

/// Features to read.
pub(super) enum Wanted {
    All,
    /// Offsets from the first feature, ascending, with the features' numbers.
    At(Vec<(u64, u64)>),
}

impl Wanted {
    pub(super) fn is_all(&self) -> bool {
        matches!(self, Self::All)
    }

    /// The offset and number of each feature to read; without end and without offsets if all are read.
    pub(super) fn features(&self) -> Box<dyn Iterator<Item = (Option<u64>, u64)> + '_> {
        match self {
            Self::All => Box::new((0..).map(|number| (None, number))),
            Self::At(features) => Box::new(features.iter().map(|(offset, number)| (Some(*offset), *number))),
        }
    }
}

/// Size of the index in bytes; `None` if the file has none. Fails if it is not possible.
pub(super) fn bytes(input: &Input<'_>, header: &Header<'_>) -> Result<Option<u64>, InputError> {
    let (features, node_size) = (header.features_count(), header.index_node_size());
    if node_size == 0 || features == 0 {
        return Ok(None);
    }
    let bytes = nodes(features, node_size).and_then(|nodes| nodes.checked_mul(NODE_BYTES));
    bytes.map(Some).ok_or_else(|| InputError::damaged(input.label, "index", "its size is not possible"))
}

/// Reads past the index. With a wanted area (west, south, east, north), only the features whose boxes touch it are wanted.
/// Fails if the file ends before.
pub(crate) fn read(
    input: &Input<'_>,
    reader: &mut dyn BufRead,
    schema: &Schema,
    area: Option<[f64; 4]>,
) -> Result<Wanted, InputError> {
    let Some(bytes) = schema.index_bytes else { return Ok(Wanted::All) };
    let damaged = |what: &str| InputError::damaged(input.label, "index", what);
    let Some(area) = area else {
        super::skip(input, reader, bytes)?;
        return Ok(Wanted::All);
    };
    super::skip(input, reader, bytes - schema.features * NODE_BYTES)?;
    read_leaves(reader, schema.features, area).map(Wanted::At).map_err(|cause| match cause.kind() {
        io::ErrorKind::UnexpectedEof => damaged("the file ends before its features"),
        _ => InputError::io(input.label, cause),
    })
}

/// Offsets of the leaves that touch an area. The upper levels are not used: reading all leaves takes little of the time of
/// reading the features.
fn read_leaves(reader: &mut dyn BufRead, features: u64, area: [f64; 4]) -> io::Result<Vec<(u64, u64)>> {
    let mut wanted = Vec::new();
    let mut chunk = Vec::new();
    let mut first = 0;
    while first < features {
        let count = (features - first).min(CHUNK_NODES);
        chunk.clear();
        Read::take(&mut *reader, count * NODE_BYTES).read_to_end(&mut chunk)?;
        if (chunk.len() as u64) < count * NODE_BYTES {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        for (number, node) in (first..).zip(chunk.as_chunks::<8>().0.as_chunks::<5>().0) {
            let extent = [node[0], node[1], node[2], node[3]].map(f64::from_le_bytes);
            if !are_apart(extent, area) {
                wanted.push((u64::from_le_bytes(node[4]), number));
            }
        }
        first += count;
    }
    wanted.sort_unstable();
    wanted.dedup_by_key(|(offset, _)| *offset);
    Ok(wanted)
}

/// Place in the index, in bytes, of the offset of a feature.
pub(super) fn place_of_offset(index_bytes: u64, features: u64, number: u64) -> u64 {
    index_bytes - (features - number) * NODE_BYTES + (NODE_BYTES - 8)
}

/// Number of nodes of a tree; `None` if it is not possible.
fn nodes(features: u64, node_size: u16) -> Option<u64> {
    if node_size < 2 {
        return None;
    }
    let mut level = features;
    let mut nodes = features;
    while level > 1 {
        level = level.div_ceil(u64::from(node_size));
        nodes = nodes.checked_add(level)?;
    }
    // A tree of one feature has a root above it.
    if features == 1 { Some(2) } else { Some(nodes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_trees() {
        let crate_size =
            |features, node_size| ::flatgeobuf::packed_r_tree::PackedRTree::index_size(features, node_size);
        for features in [1, 2, 15, 16, 17, 256, 257, 179, 100_000] {
            for node_size in [2, 16, 65535] {
                let bytes = nodes(features, node_size).unwrap() * NODE_BYTES;
                assert_eq!(bytes, crate_size(features as usize, node_size) as u64, "{features} {node_size}");
            }
        }
        assert_eq!(nodes(7, 1), None);
        assert_eq!(nodes(u64::MAX, 2), None);
    }
}
