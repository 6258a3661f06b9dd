//! The city that a bake updates. Unchanged blocks are copied from it.

use std::{
    collections::{BTreeMap, HashMap},
    fs::File,
    future::Future,
    io::{self, Read, Seek, SeekFrom},
    path::Path,
    pin::pin,
    sync::{Mutex, PoisonError},
    task::{Context, Poll, Waker},
};

use insula_protocol::{Manifest, Subtree, TileId, TileKind, mesh_tile, subtree::MeshLod, tile::TileReader};
use pmtiles::{AsyncBackend, AsyncPmTilesReader, BackendResponse, HashMapCache, PmtError, PmtResult, TileCoord};

use crate::{
    config::BakeConfig,
    hash::ShortHash,
    mesh::Lod,
    scene::partition::LeafBlock,
    write::{fingerprints::Fingerprints, mesh_pack::LeafMesh, tile_pack::EncodedTile},
};

/// A city of an earlier bake.
pub(super) struct PreviousCity {
    fingerprints: HashMap<(u32, u32), ShortHash>,
    /// Lowest and highest point of every node, in metres above the city's origin.
    heights: BTreeMap<TileId, [f32; 2]>,
    /// Levels of detail of the leaves' meshes.
    lods: BTreeMap<TileId, Vec<MeshLod>>,
    tiles: Archive,
    /// `None` if no leaf has a mesh.
    meshes: Option<Archive>,
}

impl PreviousCity {
    /// Opens the city. Fails with the reason if nothing of it can be reused.
    pub(super) fn open(folder: &Path, config: &BakeConfig) -> Result<Self, String> {
        let json = std::fs::read(folder.join("city.json")).map_err(|_| "there is no city in the folder".to_owned())?;
        let manifest: Manifest =
            serde_json::from_slice(&json).map_err(|cause| format!("its city.json is damaged ({cause})"))?;
        manifest.check().map_err(|cause| format!("its city.json is invalid ({cause})"))?;
        if manifest.settings != config.settings {
            return Err("it was baked with different settings or by another version".to_owned());
        }
        let fingerprints = Fingerprints::read(folder).ok_or("it has no valid fingerprints.bin")?;
        if fingerprints.version != manifest.version {
            return Err("its fingerprints.bin belongs to another city".to_owned());
        }
        let failed = |cause: PmtError| format!("its archives cannot be read ({cause})");
        let tiles = Archive::open(&folder.join("blockmaps.pmtiles")).map_err(failed)?;
        let subtrees = Archive::open(&folder.join("subtrees.pmtiles")).map_err(failed)?;
        let PreviousNodes { heights, lods } = read_nodes(&subtrees).ok_or("its subtrees are damaged")?;
        let path = folder.join("meshes.pmtiles");
        let meshes = if lods.is_empty() { None } else { Some(Archive::open(&path).map_err(failed)?) };
        Ok(Self { fingerprints: fingerprints.blocks.into_iter().collect(), heights, lods, tiles, meshes })
    }

    /// Whether the block's input is unchanged.
    pub(super) fn has_block(&self, block: &LeafBlock, fingerprint: ShortHash) -> bool {
        self.fingerprints.get(&(block.x, block.y)) == Some(&fingerprint)
    }

    /// Whether the city has the node.
    pub(super) fn has_node(&self, id: TileId) -> bool {
        self.heights.contains_key(&id)
    }

    /// The node's tile; `None` if it does not exist or is damaged.
    pub(super) fn tile(&self, id: TileId) -> Option<EncodedTile> {
        let [z_min_m, z_max_m] = *self.heights.get(&id)?;
        let bytes = self.tiles.get(id)?;
        let is_valid = TileReader::new(&bytes, TileKind::BlockMap).is_ok();
        is_valid.then_some(EncodedTile { id, z_min_m, z_max_m, bytes })
    }

    /// The tiles of those of the nodes that exist; `None` if one is damaged.
    pub(super) fn tiles(&self, ids: &[TileId]) -> Option<Vec<EncodedTile>> {
        ids.iter().filter(|id| self.has_node(**id)).map(|id| self.tile(*id)).collect()
    }

    /// The meshes of those of the nodes that exist; `None` if one is damaged.
    pub(super) fn meshes(&self, ids: &[TileId]) -> Option<Vec<LeafMesh>> {
        let load_lod = |id: TileId, lod: u8, info: &MeshLod| {
            let bytes = self.meshes.as_ref()?.get(mesh_tile::archive_id(id, lod)?)?;
            let is_valid = TileReader::new(&bytes, TileKind::Mesh).is_ok() && bytes.len() == info.bytes as usize;
            is_valid.then_some(Lod { info: *info, bytes })
        };
        let load_leaf = |id: &TileId| {
            let lods = (0..).zip(self.lods.get(id).into_iter().flatten());
            Some(LeafMesh { id: *id, lods: lods.map(|(lod, info)| load_lod(*id, lod, info)).collect::<Option<_>>()? })
        };
        ids.iter().filter(|id| self.has_node(**id)).map(load_leaf).collect()
    }
}

/// What the subtrees say of all nodes.
#[derive(Default)]
struct PreviousNodes {
    heights: BTreeMap<TileId, [f32; 2]>,
    lods: BTreeMap<TileId, Vec<MeshLod>>,
}

/// Reads all nodes, beginning at the root's subtree. `None` if a subtree is missing or damaged.
fn read_nodes(archive: &Archive) -> Option<PreviousNodes> {
    let mut nodes = PreviousNodes::default();
    let mut roots = vec![TileId::ROOT];
    while let Some(root) = roots.pop() {
        let subtree = Subtree::decode(&archive.get(root)?).ok()?;
        nodes.lods.extend(subtree.meshes.into_iter().map(|mesh| (mesh.id, mesh.lods)));
        for node in subtree.nodes {
            nodes.heights.insert(node.id, [node.z_min_m, node.z_max_m]);
            if node.id != root && node.child_mask != 0 && Subtree::is_root(node.id) {
                roots.push(node.id);
            }
        }
    }
    Some(nodes)
}

/// A PMTiles archive in a file.
struct Archive(Mutex<AsyncPmTilesReader<Positioned, HashMapCache>>);

impl Archive {
    fn open(path: &Path) -> PmtResult<Self> {
        let backend = Positioned(Mutex::new(File::open(path)?));
        Ok(Self(Mutex::new(at_once(AsyncPmTilesReader::try_from_cached_source(backend, HashMapCache::default()))?)))
    }

    fn get(&self, id: TileId) -> Option<Vec<u8>> {
        let coord = TileCoord::new(id.level(), id.x(), id.y()).ok()?;
        // One reader at a time: nothing in it ever waits for another.
        let reader = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        at_once(reader.get_tile(coord)).ok()?.map(|bytes| bytes.to_vec())
    }
}

struct Positioned(Mutex<File>);

impl AsyncBackend for Positioned {
    async fn read(&self, offset: u64, length: usize) -> PmtResult<BackendResponse> {
        let mut file = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        // The first read asks for more than a small archive has; what is missing elsewhere is found out by its user.
        let mut bytes = Vec::new();
        (&mut *file).take(length as u64).read_to_end(&mut bytes)?;
        Ok(BackendResponse::new(bytes.into()))
    }
}

/// The crate's reader is written for servers; on a local file it never waits.
fn at_once<T>(future: impl Future<Output = PmtResult<T>>) -> PmtResult<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err(PmtError::Reading(io::Error::from(io::ErrorKind::WouldBlock))),
    }
}
