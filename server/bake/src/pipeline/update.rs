//! The city that is there already: what of it still holds.
//!
//! In: a city folder that a bake made. Out: [`Before`], which hands out its tiles. Next: `leaves` and `parents` take from it
//! what did not change.

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
    tiles: Archive,
    /// Missing where no leaf has a mesh.
    meshes: Option<Archive>,
}

impl Before {
    /// Opens the city, or says why nothing of it can be used.
    pub(super) fn open(folder: &Path, config: &Config) -> Result<Self, String> {
        let json = std::fs::read(folder.join("city.json")).map_err(|_| "there is no city to update".to_owned())?;
        let manifest: Manifest =
            serde_json::from_slice(&json).map_err(|cause| format!("its city.json is damaged ({cause})"))?;
        manifest.check().map_err(|cause| format!("its city.json is unsound ({cause})"))?;
        if manifest.settings != config.settings {
            return Err("it was made with other settings or by another version".to_owned());
        }
        let fingerprints = Fingerprints::read(folder).ok_or("it has no usable fingerprints")?;
        if fingerprints.version != manifest.version {
            return Err("its fingerprints are another city's".to_owned());
        }
        let failed = |cause: PmtError| format!("its archives cannot be read ({cause})");
        let tiles = Archive::open(&folder.join("blockmaps.pmtiles")).map_err(failed)?;
        let subtrees = Archive::open(&folder.join("subtrees.pmtiles")).map_err(failed)?;
        let (heights, lods) = nodes(&subtrees).ok_or("its subtrees are damaged")?;
        let path = folder.join("meshes.pmtiles");
        let meshes = if lods.is_empty() { None } else { Some(Archive::open(&path).map_err(failed)?) };
        Ok(Self { fingerprints: fingerprints.blocks.into_iter().collect(), heights, lods, tiles, meshes })
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
        let bytes = self.tiles.get(id)?;
        let sound = TileReader::new(&bytes, TileKind::BlockMap).is_ok();
        sound.then_some(Tile { id, z_min_m, z_max_m, bytes })
    }

    /// The tiles of those nodes that existed; `None` if one is damaged.
    pub(super) fn tiles(&self, ids: &[TileId]) -> Option<Vec<Tile>> {
        ids.iter().filter(|id| self.has(**id)).map(|id| self.tile(*id)).collect()
    }

    /// The meshes of those nodes that existed; `None` if one is damaged.
    pub(super) fn meshes(&self, ids: &[TileId]) -> Option<Vec<LeafMesh>> {
        let lod = |id: TileId, (lod, info): (u8, &MeshLod)| {
            let bytes = self.meshes.as_ref()?.get(mesh_tile::archive_id(id, lod)?)?;
            let sound = TileReader::new(&bytes, TileKind::Mesh).is_ok() && bytes.len() == info.bytes as usize;
            sound.then_some(Lod { info: *info, bytes })
        };
        let leaf = |id: &TileId| {
            let lods = self.lods.get(id).into_iter().flatten();
            Some((*id, (0..).zip(lods).map(|numbered| lod(*id, numbered)).collect::<Option<Vec<_>>>()?))
        };
        ids.iter().filter(|id| self.has(**id)).map(leaf).collect()
    }
}

type Nodes = (BTreeMap<TileId, [f32; 2]>, BTreeMap<TileId, Vec<MeshLod>>);

/// Every node, found from the root's subtree on: heights and meshes.
fn nodes(archive: &Archive) -> Option<Nodes> {
    let (mut heights, mut lods, mut roots) = (BTreeMap::new(), BTreeMap::new(), vec![TileId::ROOT]);
    while let Some(root) = roots.pop() {
        let subtree = Subtree::decode(&archive.get(root)?).ok()?;
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
