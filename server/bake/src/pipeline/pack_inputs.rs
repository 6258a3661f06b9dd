//! What packs are made from, as a hash by which finished ones are found again.

use crate::hash::{ShortHash, short_hash};
use crate::write::tile_pack::{PackId, PackNodes};
use insula_protocol::TileId;
use std::collections::HashMap;

/// The hash of the input of each pack of a city: of a block of leaves its fingerprint, of parents that of the packs of their children.
#[derive(Debug)]
pub(super) struct PackInputs {
    /// Height of the plane at which generated ground ends, on which parents depend.
    plane_m: Option<f32>,
    of_packs: HashMap<PackId, ShortHash>,
}

impl PackInputs {
    pub(super) fn new(plane_m: Option<f32>) -> Self {
        Self { plane_m, of_packs: HashMap::new() }
    }

    /// Those of a finished city with these nodes, and these blocks of leaves at level `depth`.
    pub(super) fn of_city(
        plane_m: Option<f32>,
        depth: u8,
        blocks: Vec<((u32, u32), ShortHash)>,
        nodes: impl Iterator<Item = TileId>,
    ) -> Self {
        let mut inputs = Self::new(plane_m);
        for ((x, y), input) in blocks {
            inputs.set(PackId { level: depth, y, x }, input);
        }
        let parents = nodes.filter(|id| id.level() < depth).collect();
        // The deepest level is the last.
        for PackNodes { pack, nodes } in PackNodes::group(parents).into_iter().rev() {
            let input = inputs.of_parents(nodes.iter().map(|id| (*id, inputs.of_parent(*id))));
            if let Some(input) = input {
                inputs.set(pack, input);
            }
        }
        inputs
    }

    pub(super) fn set(&mut self, pack: PackId, input: ShortHash) {
        self.of_packs.insert(pack, input);
    }

    /// Hash of what a pack is made from; `None` if it is not known.
    pub(super) fn of_pack(&self, pack: PackId) -> Option<ShortHash> {
        self.of_packs.get(&pack).copied()
    }

    /// Hash of what a parent is made from: that of the pack of its children, which are together in one. `None` if it is not known.
    pub(super) fn of_parent(&self, id: TileId) -> Option<ShortHash> {
        self.of_pack(PackId::of(id.child(0)?))
    }

    /// Hash of what a pack of parents is made from, by that of each; `None` if one is not known.
    pub(super) fn of_parents(&self, parents: impl Iterator<Item = (TileId, Option<ShortHash>)>) -> Option<ShortHash> {
        let mut hasher = blake3::Hasher::new();
        if let Some(plane_m) = self.plane_m {
            hasher.update(&plane_m.to_bits().to_le_bytes());
        }
        for (id, input) in parents {
            hasher.update(&[id.level()]).update(&id.x().to_le_bytes()).update(&id.y().to_le_bytes());
            hasher.update(&input?);
        }
        Some(short_hash(&hasher.finalize()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_below_changes_the_inputs_of_all_levels_above() {
        let id = |level, x, y| TileId::new(level, x, y).unwrap();
        let nodes = [TileId::ROOT, id(1, 1, 0), id(2, 3, 0), id(2, 3, 1), id(3, 6, 0), id(3, 7, 3)];
        let root = |blocks: &[((u32, u32), u8)], plane_m| {
            let blocks = blocks.iter().map(|(place, hash)| (*place, [*hash; 16])).collect();
            PackInputs::of_city(plane_m, 3, blocks, nodes.into_iter()).of_parent(TileId::ROOT)
        };
        let base = root(&[((3, 0), 9), ((3, 1), 1)], None);
        assert!(
            base.is_some() && root(&[((3, 0), 9), ((3, 1), 1), ((0, 0), 5)], None) == base,
            "a block without leaves"
        );
        assert_ne!(root(&[((3, 0), 9), ((3, 1), 2)], None), base, "another block of leaves");
        assert_ne!(root(&[((3, 0), 9), ((3, 1), 1)], Some(0.0)), base, "another plane");
        assert_eq!(root(&[((3, 0), 9)], None), None, "a block that is not known");
    }
}
