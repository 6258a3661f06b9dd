//! Which nodes exist below a node, where they lie in height and how wrong they are, five levels at a time.
//!
//! In: a tile of kind `Subtree`. Out: [`Subtree`]. Next: the client's scene tree.
//!
//! A subtree tile lists its root and the nodes up to five levels below it. There is one for the city's root, and one for
//! each node of levels 5, 10, ... that has children: such a node stands in two, at the bottom of one and at the top of the
//! other, so that a leaf needs none of its own.

use crate::{
    TileId,
    codec::varint::Reader,
    error::DecodeError,
    tile::{Kind, TileReader, TileWriter},
};

/// Levels below a subtree's root that it lists.
pub const LEVELS: u8 = 5;
/// Most nodes in one subtree: 1 + 4 + 16 + 64 + 256 + 1024.
pub const MAX_NODES: usize = 1365;

const TAG_NODES: u8 = 1;
const NODE_BYTES: usize = 21;

/// What is known of a node without its tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeInfo {
    /// Which node.
    pub id: TileId,
    /// Bit q is set if the child in quadrant q exists.
    pub child_mask: u8,
    /// Lowest point in metres above the city's origin.
    pub z_min_m: f32,
    /// Highest point likewise.
    pub z_max_m: f32,
    /// World error in metres (design 4); never below any child's.
    pub error_m: f32,
    /// Radius around the centre of the node's box; the sphere holds the children's.
    pub radius_m: f32,
    /// Bytes of the node's V-BlockMap tile.
    pub blockmap_bytes: u32,
}

/// The nodes of up to five levels, breadth first, children in quadrant order.
#[derive(Debug, Clone, PartialEq)]
pub struct Subtree {
    /// At least the root.
    pub nodes: Vec<NodeInfo>,
}

impl Subtree {
    /// Whether `id` is the root of a subtree tile, if it has children.
    pub fn is_root(id: TileId) -> bool {
        id.level().is_multiple_of(LEVELS)
    }

    /// The root of the subtree tile that lists the children of `id`.
    pub fn root_of(id: TileId) -> TileId {
        id.ancestor(id.level() / LEVELS * LEVELS).unwrap_or(TileId::ROOT)
    }

    /// The tile's bytes. The nodes must be in breadth-first order, complete, as [`Subtree::decode`] gives them.
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        let root = self.nodes.first().ok_or(DecodeError::Invalid("a subtree without nodes"))?.id;
        let mut raw = Vec::with_capacity(self.nodes.len() * NODE_BYTES);
        for node in &self.nodes {
            raw.push(node.child_mask);
            for v in [node.z_min_m, node.z_max_m, node.error_m, node.radius_m] {
                raw.extend_from_slice(&v.to_le_bytes());
            }
            raw.extend_from_slice(&node.blockmap_bytes.to_le_bytes());
        }
        let mut writer = TileWriter::new(Kind::Subtree, Some(root));
        writer.section(TAG_NODES, &raw)?;
        writer.finish()
    }

    /// Reads a tile; ids follow from the child masks.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, Kind::Subtree)?;
        let id = tile.id.ok_or(DecodeError::Invalid("a subtree without a name"))?;
        if !Self::is_root(id) {
            return Err(DecodeError::Invalid("a subtree whose level is no multiple of five"));
        }
        let raw = tile.section(TAG_NODES, MAX_NODES * NODE_BYTES)?;
        let mut reader = Reader::new(&raw);
        let end = id.level() + LEVELS;
        let mut ids = vec![id];
        let mut nodes = Vec::with_capacity(raw.len() / NODE_BYTES);
        let mut next = 0;
        while let Some(&id) = ids.get(next) {
            next += 1;
            let node = read_node(&mut reader, id)?;
            if id.level() < end {
                ids.extend((0..4).filter(|q| node.child_mask >> q & 1 == 1).filter_map(|q| id.child(q)));
            }
            nodes.push(node);
        }
        reader.finish()?;
        Ok(Self { nodes })
    }
}

fn read_node(reader: &mut Reader<'_>, id: TileId) -> Result<NodeInfo, DecodeError> {
    let node = NodeInfo {
        id,
        child_mask: reader.u8()?,
        z_min_m: reader.f32()?,
        z_max_m: reader.f32()?,
        error_m: reader.f32()?,
        radius_m: reader.f32()?,
        blockmap_bytes: reader.u32()?,
    };
    if node.child_mask > 15 || (node.child_mask != 0 && id.child(0).is_none()) {
        return Err(DecodeError::Invalid("a child mask names children that cannot be"));
    }
    if node.z_min_m > node.z_max_m || node.error_m < 0.0 || node.radius_m < 0.0 {
        return Err(DecodeError::Invalid("a node's bounds are turned around"));
    }
    Ok(node)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Subtree {
        let node = |id: TileId, child_mask| NodeInfo {
            id,
            child_mask,
            z_min_m: -1.5,
            z_max_m: 40.0 + f32::from(id.level()),
            error_m: 16.0 / f32::from(1 + id.level()),
            radius_m: 100.0,
            blockmap_bytes: 1234,
        };
        let root = TileId::ROOT;
        let a = root.child(1).unwrap();
        let b = root.child(2).unwrap();
        let c = a.child(3).unwrap();
        Subtree { nodes: vec![node(root, 0b0110), node(a, 0b1000), node(b, 0), node(c, 0)] }
    }

    #[test]
    fn round_trip() {
        let bytes = sample().encode().unwrap();
        assert_eq!(Subtree::decode(&bytes).unwrap(), sample());
    }

    #[test]
    fn every_truncation_and_every_flipped_byte_is_an_error() {
        let bytes = sample().encode().unwrap();
        for len in 0..bytes.len() {
            assert!(Subtree::decode(&bytes[..len]).is_err(), "{len}");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert_eq!(Subtree::decode(&longer), Err(DecodeError::TrailingBytes(1)));
        for at in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0x10;
            assert!(Subtree::decode(&wrong).is_err(), "{at}");
        }
    }

    #[test]
    fn roots() {
        let id = TileId::new(7, 100, 3).unwrap();
        assert_eq!(Subtree::root_of(id), TileId::new(5, 25, 0).unwrap());
        assert!(Subtree::is_root(TileId::ROOT) && !Subtree::is_root(id));
    }
}
