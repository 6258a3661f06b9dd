//! The city that a bake updates. Unchanged blocks are copied from it.

use super::pack_inputs::PackInputs;
use crate::columns::deviation;
use crate::config::BakeConfig;
use crate::hash::ShortHash;
use crate::mesh::EncodedLod;
use crate::scene::object_numbers::IdentityKey;
use crate::scene::scratch_scene::hash_of_id;
use crate::write::fingerprints::Fingerprints;
use crate::write::tile_pack::{EncodedPack, EncodedTile, LeafMesh, PackId};
use insula_archive::BakedCity;
use insula_archive::city::{MANIFEST_FILE, content_version};
use insula_objects::block::ObjectBlock;
use insula_objects::schema::Schema;
use insula_protocol::object_tile::{self, BLOCK_OBJECTS, SCHEMA_ID};
use insula_protocol::subtree::{MeshLod, NodeDeviation};
use insula_protocol::tile::TileReader;
use insula_protocol::{BlockMap, Subtree, TileId, TileKind, mesh_tile};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// A city of an earlier bake.
pub(super) struct PreviousCity {
    inputs: PackInputs,
    nodes: BTreeMap<TileId, PreviousNode>,
    city: BakedCity,
}

impl PreviousCity {
    /// Opens the city. `plane_m` is the plane of the new one: blocks whose ground ends at another have other fingerprints. Fails with the
    /// reason if nothing of it can be reused.
    pub(super) fn open(folder: &Path, config: &BakeConfig, plane_m: Option<f32>) -> Result<Self, String> {
        if !folder.join(MANIFEST_FILE).exists() {
            return Err("there is no city in the folder".to_owned());
        }
        let city = BakedCity::open(folder).map_err(|cause| cause.to_string())?;
        let stated = &city.manifest().version;
        let found = content_version(folder, stated).map_err(|cause| cause.to_string())?;
        if found != *stated {
            return Err("its files do not have the version that its city.json states".to_owned());
        }
        if city.manifest().settings != config.settings {
            return Err("it was baked with different settings or by another version".to_owned());
        }
        let fingerprints = Fingerprints::read(folder).ok_or("it has no valid fingerprints.bin")?;
        if fingerprints.version != city.manifest().version {
            return Err("its fingerprints.bin belongs to another city".to_owned());
        }
        let nodes = read_nodes(&city).ok_or("its subtrees are damaged")?;
        let (depth, all) = (city.manifest().depth, nodes.keys().copied());
        let inputs = PackInputs::of_city(plane_m, depth, fingerprints.blocks, all);
        Ok(Self { inputs, nodes, city })
    }

    /// The city itself.
    pub(super) fn baked(&self) -> &BakedCity {
        &self.city
    }

    /// The number of each object, by identifier and how many before it have the same. Empty if the objects cannot be read.
    pub(super) fn object_numbers(&self) -> HashMap<IdentityKey, u32> {
        let mut numbers = HashMap::new();
        let mut occurrences: HashMap<u64, u32> = HashMap::new();
        let Some(schema) = self.schema() else { return numbers };
        for block in (0..schema.objects.div_ceil(BLOCK_OBJECTS)).filter_map(|block| self.object_block(block, &schema)) {
            for &id in block.ids() {
                let hash = hash_of_id(block.identifier(id).unwrap_or_default());
                let count = occurrences.entry(hash).or_default();
                numbers.insert((hash, *count), id);
                *count += 1;
            }
        }
        numbers
    }

    fn schema(&self) -> Option<Schema> {
        let bytes = tile_bytes(&self.city, TileKind::Objects, SCHEMA_ID)?;
        let schema: Schema = serde_json::from_slice(&object_tile::decode(SCHEMA_ID, &bytes).ok()?).ok()?;
        schema.check().is_ok().then_some(schema)
    }

    fn object_block(&self, block: u32, schema: &Schema) -> Option<ObjectBlock> {
        let id = object_tile::block_id(block)?;
        let bytes = tile_bytes(&self.city, TileKind::Objects, id)?;
        ObjectBlock::decode(block, &object_tile::decode(id, &bytes).ok()?, schema).ok()
    }

    /// Whether a block of leaves was made from the same input.
    pub(super) fn has_block(&self, block: PackId, input: ShortHash) -> bool {
        self.inputs.of_pack(block) == Some(input)
    }

    /// A parent's tile without points; `None` if it was made from another input, which may be unknown, or is damaged.
    pub(super) fn parent(&self, id: TileId, input: Option<ShortHash>) -> Option<EncodedTile> {
        if self.inputs.of_parent(id) == Some(input?) { self.tile(id) } else { None }
    }

    /// Those of a block's leaves that exist, with their points and meshes; `None` if the block was made from another input, or is damaged.
    pub(super) fn block(&self, block: PackId, input: ShortHash, leaves: &[TileId]) -> Option<EncodedPack> {
        let mut content = self.has_block(block, input).then(EncodedPack::default)?;
        for id in leaves.iter().copied().filter(|id| self.nodes.contains_key(id)) {
            let tile = self.tile(id)?;
            let points = deviation::leaf_points(&BlockMap::decode(id, &tile.bytes).ok()?);
            content.tiles.push(EncodedTile { points, ..tile });
            content.meshes.push(self.mesh(id)?);
        }
        Some(content)
    }

    fn tile(&self, id: TileId) -> Option<EncodedTile> {
        let PreviousNode { z_m: [z_min_m, z_max_m], deviation, .. } = *self.nodes.get(&id)?;
        let bytes = tile_bytes(&self.city, TileKind::BlockMap, id)?;
        let is_valid = TileReader::new(&bytes, TileKind::BlockMap).is_ok();
        // A parent is reused with all of its children, so it was not drawn instead of them.
        let shows_children = false;
        is_valid.then_some(EncodedTile { id, z_min_m, z_max_m, deviation, points: Vec::new(), bytes, shows_children })
    }

    fn mesh(&self, id: TileId) -> Option<LeafMesh> {
        let load = |(lod, info): (u8, &MeshLod)| {
            let bytes = tile_bytes(&self.city, TileKind::Mesh, mesh_tile::archive_id(id, lod)?)?;
            let is_valid = TileReader::new(&bytes, TileKind::Mesh).is_ok() && bytes.len() == info.bytes as usize;
            is_valid.then_some(EncodedLod { info: *info, bytes })
        };
        let lods = (0..).zip(&self.nodes.get(&id)?.lods).map(load).collect::<Option<_>>()?;
        Some(LeafMesh { id, lods })
    }
}

fn tile_bytes(city: &BakedCity, kind: TileKind, id: TileId) -> Option<Vec<u8>> {
    city.tile(kind, id).ok()?.map(Vec::from)
}

/// What the subtrees say of a node.
struct PreviousNode {
    /// Its lowest and highest point, in metres above the city's origin.
    z_m: [f32; 2],
    deviation: NodeDeviation,
    /// Levels of detail of a leaf's mesh.
    lods: Vec<MeshLod>,
}

/// Reads all nodes, beginning at the root's subtree. `None` if a subtree is missing or damaged.
fn read_nodes(city: &BakedCity) -> Option<BTreeMap<TileId, PreviousNode>> {
    let mut all = BTreeMap::new();
    let mut roots = vec![TileId::ROOT];
    while let Some(root) = roots.pop() {
        let Subtree { nodes, meshes, deviations } =
            Subtree::decode(&tile_bytes(city, TileKind::Subtree, root)?).ok()?;
        if deviations.len() != nodes.len() {
            return None;
        }
        for (node, deviation) in nodes.into_iter().zip(deviations) {
            let z_m = [node.z_min_m, node.z_max_m];
            all.insert(node.id, PreviousNode { z_m, deviation, lods: Vec::new() });
            if node.id != root && node.child_mask != 0 && Subtree::is_root(node.id) {
                roots.push(node.id);
            }
        }
        for mesh in meshes {
            all.get_mut(&mesh.id)?.lods = mesh.lods;
        }
    }
    Some(all)
}
