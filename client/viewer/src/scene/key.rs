//! Keys of tiles.

use insula_protocol::{TileId, TileKind, mesh_tile};

/// Identifies a tile: a V-BlockMap, a subtree, a level of detail of a mesh, objects, or visibility.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileKey {
    /// 0 for V-BlockMaps, 1 for subtrees, 2 for meshes, 3 for objects, 4 for visibility: the first criterion of the order.
    kind: u8,
    /// The node; for a subtree, its root.
    pub id: TileId,
    /// Level of detail of a mesh, 0 being the finest; 0 for other tiles.
    pub lod: u8,
}

impl TileKey {
    /// A node's V-BlockMap.
    pub const fn block_map(id: TileId) -> Self {
        Self { kind: 0, id, lod: 0 }
    }

    /// The subtree below a node.
    pub const fn subtree(id: TileId) -> Self {
        Self { kind: 1, id, lod: 0 }
    }

    /// A level of detail of a leaf's mesh.
    pub const fn mesh(id: TileId, lod: u8) -> Self {
        Self { kind: 2, id, lod }
    }

    /// A block of objects, or their schema, by its place in the archive ([`insula_protocol::object_tile`]).
    pub const fn objects(id: TileId) -> Self {
        Self { kind: 3, id, lod: 0 }
    }

    /// What can be seen from the streets of a node's cells ([`insula_protocol::visibility_tile`]).
    pub const fn visibility(id: TileId) -> Self {
        Self { kind: 4, id, lod: 0 }
    }

    /// The tile at a place of an archive, in a city whose leaves are at level `depth`; `None` if no tile can be there.
    pub fn in_archive(kind: TileKind, place: TileId, depth: u8) -> Option<Self> {
        Some(match kind {
            TileKind::BlockMap => Self::block_map(place),
            TileKind::Subtree => Self::subtree(place),
            TileKind::Mesh => {
                let (leaf, lod) = mesh_tile::from_archive_id(place, depth)?;
                Self::mesh(leaf, lod)
            }
            TileKind::Objects => Self::objects(place),
            TileKind::Visibility => Self::visibility(place),
        })
    }

    /// What the tile holds.
    pub const fn kind(self) -> TileKind {
        match self.kind {
            0 => TileKind::BlockMap,
            1 => TileKind::Subtree,
            2 => TileKind::Mesh,
            3 => TileKind::Objects,
            _ => TileKind::Visibility,
        }
    }
}
