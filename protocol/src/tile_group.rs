//! Groups: tiles of one kind of neighbouring nodes of one level, in one response.
//!
//! A view needs many small tiles next to each other. One request for all of them saves round trips, and what a host asks for a
//! request. Groups are aligned to the quadtree, so that equal views ask for equal addresses, which caches hold.

use crate::codec::byte_reader::ByteReader;
use crate::codec::varint;
use crate::error::check_limit;
use crate::{DecodeError, TileId, TileKind, mesh_tile};

/// The first four bytes of every group.
pub const MAGIC: [u8; 4] = *b"INSG";
/// A group has at most 2 to the power of this many tiles, 64.
pub const MAX_DOUBLINGS: u8 = 6;
/// Most bytes of the tiles of a group. Tiles beyond are left out.
pub const MAX_TILES_BYTES: usize = 64 << 10;
/// Size of the largest group.
pub const MAX_BYTES: usize = MAX_TILES_BYTES + 4 + 5 * (1 << MAX_DOUBLINGS);

/// Stored instead of a tile's length.
const ABSENT: u32 = 0;
const LEFT_OUT: u32 = 1;
/// Added to a tile's length.
const FIRST_LENGTH: u32 = 2;

/// Which tiles a group has: those of a rectangle of nodes, as wide as it is high, or twice as wide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TileGroup {
    kind: TileKind,
    first: TileId,
    doublings: u8,
    lod: u8,
}

/// A tile of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroupMember<T> {
    Tile(T),
    /// The city has no such tile.
    Absent,
    /// The tile exists, but did not fit: it must be fetched by itself.
    LeftOut,
}

impl TileGroup {
    /// The tiles of `kind` of `2^doublings` nodes, the south-western one being `first`; of meshes, those of level of detail `lod`. `None`
    /// for kinds without groups (only subtrees, V-BlockMaps and meshes have them), for other than 1 to [`MAX_DOUBLINGS`] doublings, and if
    /// the rectangle does not begin at a multiple of its sides.
    pub fn new(kind: TileKind, first: TileId, doublings: u8, lod: u8) -> Option<Self> {
        Self::around(kind, first, doublings, lod).filter(|group| group.first == first)
    }

    /// The group of `2^doublings` tiles that has the tile of `kind` and `lod` of node `id`. `None` also if the level has fewer nodes.
    pub fn around(kind: TileKind, id: TileId, doublings: u8, lod: u8) -> Option<Self> {
        let is_level_of_detail = match kind {
            TileKind::BlockMap | TileKind::Subtree => lod == 0,
            TileKind::Mesh => lod < mesh_tile::MAX_LODS,
            TileKind::Objects | TileKind::Visibility => false,
        };
        if !is_level_of_detail || !(1..=MAX_DOUBLINGS).contains(&doublings) {
            return None;
        }
        let [width, height] = sides(doublings);
        let first = TileId::new(id.level(), id.x() / width * width, id.y() / height * height)?;
        (width >> id.level() <= 1).then_some(Self { kind, first, doublings, lod })
    }

    /// Kind of the tiles.
    pub const fn kind(self) -> TileKind {
        self.kind
    }

    /// The south-western node.
    pub const fn first(self) -> TileId {
        self.first
    }

    /// Level of detail of meshes, 0 being the finest; 0 for other kinds.
    pub const fn lod(self) -> u8 {
        self.lod
    }

    /// Number of nodes: a power of two from 2 to 64.
    pub fn node_count(self) -> usize {
        1 << self.doublings
    }

    /// The nodes in the order of a group's tiles: row by row from the south-west corner.
    pub fn nodes(self) -> impl Iterator<Item = TileId> {
        let ([width, height], first) = (sides(self.doublings), self.first);
        let node = move |index| TileId::new(first.level(), first.x() + index % width, first.y() + index / width);
        (0..width * height).filter_map(node)
    }

    /// The place of a node in [`TileGroup::nodes`]; `None` if the group does not have it.
    pub fn position(self, id: TileId) -> Option<usize> {
        let [width, _] = sides(self.doublings);
        let is_in_group = Self::around(self.kind, id, self.doublings, self.lod) == Some(self);
        is_in_group.then(|| ((id.y() - self.first.y()) * width + id.x() - self.first.x()) as usize)
    }
}

/// Width and height of a rectangle of `2^doublings` nodes.
fn sides(doublings: u8) -> [u32; 2] {
    [1 << doublings.div_ceil(2), 1 << (doublings / 2)]
}

/// Which tiles of a group fit into [`MAX_TILES_BYTES`], by their lengths in the order of [`TileGroup::nodes`]; `None` stands for tiles
/// that do not exist.
pub fn fit<L: Into<u64>>(lengths: impl IntoIterator<Item = Option<L>>) -> Vec<GroupMember<()>> {
    let mut room = MAX_TILES_BYTES as u64;
    let mut member = |length: L| match room.checked_sub(length.into()) {
        Some(rest) => {
            room = rest;
            GroupMember::Tile(())
        }
        None => GroupMember::LeftOut,
    };
    lengths.into_iter().map(|length| length.map_or(GroupMember::Absent, &mut member)).collect()
}

/// The bytes of a group. Fails if its tiles have more than [`MAX_TILES_BYTES`].
pub fn encode<T: AsRef<[u8]>>(members: &[GroupMember<T>]) -> Result<Vec<u8>, DecodeError> {
    let (mut out, mut body) = (MAGIC.to_vec(), Vec::new());
    for member in members {
        match member {
            GroupMember::Absent => varint::push(&mut out, ABSENT),
            GroupMember::LeftOut => varint::push(&mut out, LEFT_OUT),
            GroupMember::Tile(bytes) => {
                let bytes = bytes.as_ref();
                check_limit("the size of a group's tiles", body.len().saturating_add(bytes.len()), MAX_TILES_BYTES)?;
                varint::push(&mut out, bytes.len() as u32 + FIRST_LENGTH);
                body.extend_from_slice(bytes);
            }
        }
    }
    out.extend_from_slice(&body);
    Ok(out)
}

/// The tiles of a group of `count` nodes, as ranges of `bytes`. They are not checked. Fails if these are no such group, or has more than
/// [`MAX_TILES_BYTES`].
pub fn decode(bytes: &[u8], count: usize) -> Result<Vec<GroupMember<std::ops::Range<usize>>>, DecodeError> {
    check_limit("the size of a group", bytes.len(), MAX_BYTES)?;
    check_limit("the number of a group's tiles", count, 1 << MAX_DOUBLINGS)?;
    let mut reader = ByteReader::new(bytes);
    if reader.array()? != MAGIC {
        return Err(DecodeError::Magic);
    }
    let lengths = (0..count).map(|_| reader.varint()).collect::<Result<Vec<u32>, _>>()?;
    let body_bytes = reader.rest().len();
    let mut start = bytes.len() - body_bytes;
    let members = lengths.into_iter().map(|stored| match stored {
        ABSENT => Ok(GroupMember::Absent),
        LEFT_OUT => Ok(GroupMember::LeftOut),
        length => {
            let end = start + (length - FIRST_LENGTH) as usize;
            if end > bytes.len() {
                return Err(DecodeError::Truncated { wanted: end, found: bytes.len() });
            }
            Ok(GroupMember::Tile(std::mem::replace(&mut start, end)..end))
        }
    });
    let members = members.collect::<Result<_, _>>()?;
    if start == bytes.len() { Ok(members) } else { Err(DecodeError::TrailingBytes(bytes.len() - start)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(level: u8, x: u32, y: u32) -> TileId {
        TileId::new(level, x, y).unwrap()
    }

    #[test]
    fn nodes_of_a_group_are_a_rectangle() {
        let group = TileGroup::around(TileKind::BlockMap, id(5, 13, 22), 3, 0).unwrap();
        assert_eq!((group.first(), group.node_count()), (id(5, 12, 22), 8));
        let nodes: Vec<TileId> = group.nodes().collect();
        assert_eq!((nodes.len(), nodes[1], nodes[4], nodes[7]), (8, id(5, 13, 22), id(5, 12, 23), id(5, 15, 23)));
        for (position, node) in nodes.iter().enumerate() {
            assert_eq!(group.position(*node), Some(position));
        }
        assert_eq!(group.position(id(5, 16, 22)), None);
        assert_eq!(group.position(id(4, 12, 11)), None);
        let all = TileGroup::around(TileKind::Subtree, id(3, 7, 1), MAX_DOUBLINGS, 0).unwrap();
        assert_eq!((all.first(), all.nodes().count()), (id(3, 0, 0), 64));
    }

    #[test]
    fn impossible_groups_do_not_exist() {
        let first = id(3, 0, 0);
        assert!(TileGroup::new(TileKind::Mesh, first, 6, 3).is_some());
        for (kind, first, doublings, lod) in [
            (TileKind::BlockMap, first, 0, 0),
            (TileKind::BlockMap, first, 7, 0),
            (TileKind::BlockMap, first, 1, 1),
            (TileKind::BlockMap, id(3, 1, 0), 1, 0),
            (TileKind::BlockMap, id(3, 0, 1), 2, 0),
            (TileKind::Mesh, first, 1, mesh_tile::MAX_LODS),
            (TileKind::Subtree, first, 1, 1),
            (TileKind::Objects, first, 1, 0),
            (TileKind::Visibility, first, 1, 0),
            (TileKind::BlockMap, id(2, 0, 0), 5, 0),
            (TileKind::BlockMap, TileId::ROOT, 1, 0),
        ] {
            assert_eq!(TileGroup::new(kind, first, doublings, lod), None, "{first} {doublings}");
        }
    }

    #[test]
    fn tiles_come_back_and_large_ones_are_left_out() {
        let [small, large] = [vec![1u8; 300], vec![2u8; MAX_TILES_BYTES - 300]];
        let lengths = [0, 300, MAX_TILES_BYTES as u32, large.len() as u32, 300];
        let fitting = fit(lengths.map(|length| (length > 0).then_some(length)));
        let tile = GroupMember::Tile(());
        assert_eq!(fitting, [GroupMember::Absent, tile, GroupMember::LeftOut, tile, GroupMember::LeftOut]);
        let members = [GroupMember::Absent, GroupMember::Tile(&small), GroupMember::LeftOut, GroupMember::Tile(&large)];
        let bytes = encode(&members).unwrap();
        assert!(bytes.len() <= MAX_BYTES);
        for (decoded, member) in decode(&bytes, 4).unwrap().into_iter().zip(members) {
            match (decoded, member) {
                (GroupMember::Tile(range), GroupMember::Tile(tile)) => assert_eq!(&bytes[range], tile),
                (GroupMember::Absent, GroupMember::Absent) | (GroupMember::LeftOut, GroupMember::LeftOut) => {}
                other => panic!("{other:?}"),
            }
        }
        assert!(encode(&[GroupMember::Tile(&large), GroupMember::Tile(&vec![0; 301])]).is_err());
    }

    #[test]
    fn damaged_groups_are_errors() {
        let tiles = [GroupMember::Tile(vec![7u8; 200]), GroupMember::Absent, GroupMember::Tile(vec![8u8; 5])];
        let bytes = encode(&tiles).unwrap();
        assert!(decode(&bytes, 3).is_ok());
        assert!((0..bytes.len()).all(|end| decode(&bytes[..end], 3).is_err()));
        assert_eq!(decode(&[&bytes[..], &[0]].concat(), 3), Err(DecodeError::TrailingBytes(1)));
        assert!(decode(&bytes, 4).is_err() && decode(&bytes, 65).is_err());
        assert_eq!(decode(b"INSUxxxx", 4), Err(DecodeError::Magic));
        let claims = [&MAGIC[..], &[0xff, 0xff, 0xff, 0xff, 0x0f], &[0; 3]].concat();
        assert!(matches!(decode(&claims, 4), Err(DecodeError::Truncated { .. })));
        assert!(decode(&vec![0; MAX_BYTES + 1], 4).is_err());
    }
}
