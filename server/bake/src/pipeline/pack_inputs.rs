//! What packs are made from, as a hash by which finished ones are found again.

use crate::hash::{ShortHash, short_hash};
use crate::write::tile_pack::PackId;
use insula_protocol::TileId;
use std::collections::HashMap;

/// The hash of the input of each pack of a city: of a block of leaves its fingerprint, of parents that of the packs of their children.
#[derive(Debug, Default)]
pub(super) struct PackInputs {
    /// Height of the plane at which generated ground ends, on which parents depend.
    plane_m: Option<f32>,
    of_packs: HashMap<PackId, ShortHash>,
}

impl PackInputs {
    pub(super) fn new(plane_m: Option<f32>) -> Self {
        Self { plane_m, of_packs: HashMap::new() }
    }

    pub(super) fn set(&mut self, pack: PackId, input: ShortHash) {
        self.of_packs.insert(pack, input);
    }

    /// Hash of what a parent is made from: that of the pack of its children, which are together in one. `None` if it is not known.
    pub(super) fn of_parent(&self, id: TileId) -> Option<ShortHash> {
        self.of_packs.get(&PackId::of(id.child(0)?)).copied()
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
        let root_input = |leaf: u8, plane_m: Option<f32>| {
            let mut inputs = PackInputs::new(plane_m);
            inputs.set(PackId { level: 3, y: 1, x: 3 }, [leaf; 16]);
            inputs.set(PackId { level: 3, y: 0, x: 3 }, [9; 16]);
            for (pack, nodes) in [([1, 0], vec![id(2, 3, 0), id(2, 3, 1)]), ([0, 0], vec![id(1, 1, 0)])] {
                let level = nodes[0].level();
                let of_nodes = nodes.iter().map(|id| (*id, inputs.of_parent(*id)));
                let input = inputs.of_parents(of_nodes).unwrap();
                inputs.set(PackId { level, y: pack[1], x: pack[0] }, input);
            }
            inputs.of_parent(TileId::ROOT).unwrap()
        };
        let base = root_input(1, None);
        assert_eq!(root_input(1, None), base);
        assert_ne!(root_input(2, None), base, "another block of leaves");
        assert_ne!(root_input(1, Some(0.0)), base, "another plane");
        let inputs = PackInputs::default();
        assert_eq!(inputs.of_parents([(TileId::ROOT, inputs.of_parent(TileId::ROOT))].into_iter()), None);
    }
}
