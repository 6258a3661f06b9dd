//! The packed Hilbert R-tree between header and features: nodes of a box and an offset, from the root to the leaves.

use std::io::{self, BufRead, Read};

use super::Schema;
use crate::error::InputError;
use crate::read::input::Input;

/// West, south, east, north, and an offset.
const NODE_BYTES: u64 = 40;
/// Nodes that are read at once.
const CHUNK_NODES: u64 = 1024;

/// Features to read.
pub(super) enum Wanted {
    All,
    /// Offsets from the first feature, ascending.
    At(Vec<u64>),
}

impl Wanted {
    pub(super) fn is_all(&self) -> bool {
        matches!(self, Self::All)
    }

    /// The offset of each feature to read; without end and without offsets if all are read.
    pub(super) fn offsets(&self) -> Box<dyn Iterator<Item = Option<u64>> + '_> {
        match self {
            Self::All => Box::new(std::iter::repeat(None)),
            Self::At(offsets) => Box::new(offsets.iter().copied().map(Some)),
        }
    }
}

/// Reads past the index. With a wanted area (west, south, east, north), only the features whose boxes touch it are wanted.
/// Fails if the file ends before.
pub(super) fn read(
    input: &Input<'_>,
    reader: &mut Box<dyn BufRead + '_>,
    schema: &Schema,
    area: Option<[f64; 4]>,
) -> Result<Wanted, InputError> {
    if schema.index_node_size == 0 || schema.features == 0 {
        return Ok(Wanted::All);
    }
    let damaged = |what: &str| InputError::damaged(input.label, "index", what);
    let nodes = nodes(schema.features, schema.index_node_size).ok_or_else(|| damaged("its size is not possible"))?;
    let bytes = nodes.checked_mul(NODE_BYTES).ok_or_else(|| damaged("its size is not possible"))?;
    let Some(area) = area else {
        super::skip(input, reader, bytes)?;
        return Ok(Wanted::All);
    };
    super::skip(input, reader, (nodes - schema.features) * NODE_BYTES)?;
    read_leaves(reader, schema.features, area).map(Wanted::At).map_err(|cause| match cause.kind() {
        io::ErrorKind::UnexpectedEof => damaged("the file ends before its features"),
        _ => InputError::io(input.label, cause),
    })
}

/// Offsets of the leaves that touch an area. The upper levels are not used: reading all leaves takes little of the time of
/// reading the features.
fn read_leaves(reader: &mut Box<dyn BufRead + '_>, mut left: u64, [w, s, e, n]: [f64; 4]) -> io::Result<Vec<u64>> {
    let mut offsets = Vec::new();
    let mut chunk = Vec::new();
    while left > 0 {
        let count = left.min(CHUNK_NODES);
        chunk.clear();
        reader.by_ref().take(count * NODE_BYTES).read_to_end(&mut chunk)?;
        if (chunk.len() as u64) < count * NODE_BYTES {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        for node in chunk.as_chunks::<8>().0.as_chunks::<5>().0 {
            let [west, south, east, north] = [node[0], node[1], node[2], node[3]].map(f64::from_le_bytes);
            if !(west > e || east < w || south > n || north < s) {
                offsets.push(u64::from_le_bytes(node[4]));
            }
        }
        left -= count;
    }
    offsets.sort_unstable();
    offsets.dedup();
    Ok(offsets)
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
