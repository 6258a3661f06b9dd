//! The city that is there already: what of it still holds.
//!
//! In: a city folder that a bake made. Out: [`Before`], which hands out its tiles. Next: `leaves` and `parents` take from it
//! what did not change.

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

use insula_archive::{BakedCity, city::MANIFEST_FILE};
use insula_protocol::{
    Subtree, TileId, mesh_tile,
    route::Layer,
    subtree::MeshLod,
    tile::{Kind, TileReader},
};

use crate::{
    config::Config,
    mesh::Lod,
    scene::{partition::Block, scratch_scene::ShortHash},
    write::{fingerprints::Fingerprints, mesh_pack::LeafMesh, pack::Tile},
};

/// A city made before.
pub(super) struct Before {
    fingerprints: HashMap<(u32, u32), ShortHash>,
    /// Lowest and highest point of every node.
    heights: BTreeMap<TileId, [f32; 2]>,
    /// Leaves' levels of detail.
    lods: BTreeMap<TileId, Vec<MeshLod>>,
    city: BakedCity,
}

impl Before {
    /// Opens the city, or says why nothing of it can be used.
    pub(super) fn open(folder: &Path, config: &Config) -> Result<Self, String> {
        if !folder.join(MANIFEST_FILE).exists() {
            return Err("there is no city to update".to_owned());
        }
        let city = BakedCity::open(folder).map_err(|cause| cause.to_string())?;
        if city.manifest().settings != config.settings {
            return Err("it was made with other settings or by another version".to_owned());
        }
        let fingerprints = Fingerprints::read(folder).ok_or("it has no usable fingerprints")?;
        if fingerprints.version != city.manifest().version {
            return Err("its fingerprints are another city's".to_owned());
        }
        let (heights, lods) = nodes(&city).ok_or("its subtrees are damaged")?;
        Ok(Self { fingerprints: fingerprints.blocks.into_iter().collect(), heights, lods, city })
    }

    /// Whether the block is as it was.
    pub(super) fn holds(&self, block: &Block, fingerprint: ShortHash) -> bool {
        self.fingerprints.get(&(block.x, block.y)) == Some(&fingerprint)
    }

    /// Whether the node existed.
    pub(super) fn has(&self, id: TileId) -> bool {
        self.heights.contains_key(&id)
    }

    /// The node's tile if it is sound.
    pub(super) fn tile(&self, id: TileId) -> Option<Tile> {
        let [z_min_m, z_max_m] = *self.heights.get(&id)?;
        let bytes = tile_bytes(&self.city, Layer::BlockMaps, id)?;
        let sound = TileReader::new(&bytes, Kind::BlockMap).is_ok();
        sound.then_some(Tile { id, z_min_m, z_max_m, bytes })
    }

    /// The tiles of those nodes that existed; `None` if one is damaged.
    pub(super) fn tiles(&self, ids: &[TileId]) -> Option<Vec<Tile>> {
        ids.iter().filter(|id| self.has(**id)).map(|id| self.tile(*id)).collect()
    }

    /// The meshes of those nodes that existed; `None` if one is damaged.
    pub(super) fn meshes(&self, ids: &[TileId]) -> Option<Vec<LeafMesh>> {
        let lod = |id: TileId, (lod, info): (u8, &MeshLod)| {
            let bytes = tile_bytes(&self.city, Layer::Meshes, mesh_tile::place(id, lod)?)?;
            let sound = TileReader::new(&bytes, Kind::Mesh).is_ok() && bytes.len() == info.bytes as usize;
            sound.then_some(Lod { info: *info, bytes })
        };
        let leaf = |id: &TileId| {
            let lods = self.lods.get(id).into_iter().flatten();
            Some((*id, (0..).zip(lods).map(|numbered| lod(*id, numbered)).collect::<Option<Vec<_>>>()?))
        };
        ids.iter().filter(|id| self.has(**id)).map(leaf).collect()
    }
}

fn tile_bytes(city: &BakedCity, kind: Layer, id: TileId) -> Option<Vec<u8>> {
    city.tile(kind, id).ok()?.map(Vec::from)
}

type Nodes = (BTreeMap<TileId, [f32; 2]>, BTreeMap<TileId, Vec<MeshLod>>);

/// Every node, found from the root's subtree on: heights and meshes.
fn nodes(city: &BakedCity) -> Option<Nodes> {
    let (mut heights, mut lods, mut roots) = (BTreeMap::new(), BTreeMap::new(), vec![TileId::ROOT]);
    while let Some(root) = roots.pop() {
        let subtree = Subtree::decode(&tile_bytes(city, Layer::Subtrees, root)?).ok()?;
        lods.extend(subtree.meshes.into_iter().map(|mesh| (mesh.id, mesh.lods)));
        for node in subtree.nodes {
            heights.insert(node.id, [node.z_min_m, node.z_max_m]);
            if node.id != root && node.child_mask != 0 && Subtree::is_root(node.id) {
                roots.push(node.id);
            }
        }
    }
    Some((heights, lods))
}
