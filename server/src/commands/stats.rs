//! What a city holds, counted.
//!
//! In: an opened city. Out: [`CityStats`]. Next: `inspect` shows it.

use crate::store::CityStore;
use insula_protocol::{Manifest, Subtree, subtree::MeshLod};
use serde::Serialize;

/// A city's manifest and what its archives hold.
#[derive(Debug, Serialize)]
pub(super) struct CityStats<'a> {
    pub(super) manifest: &'a Manifest,
    /// Of all archives.
    pub(super) file_bytes: u64,
    pub(super) subtree_tiles: u64,
    /// Subtree tiles that cannot be read; their nodes' errors are missing below.
    pub(super) damaged_subtree_tiles: usize,
    /// Root first.
    pub(super) levels: Vec<LevelStats>,
    /// Leaves' meshes, the finest level of detail first; empty without any.
    pub(super) meshes: Vec<MeshLodStats>,
}

/// All meshes of one level of detail.
#[derive(Debug, Default, Serialize)]
pub(super) struct MeshLodStats {
    /// 0 for the finest.
    pub(super) lod: usize,
    pub(super) leaves: u64,
    pub(super) bytes: u64,
    pub(super) triangles: u64,
    pub(super) texture_px: u64,
    /// Largest error.
    pub(super) error_m: f32,
}

/// One level of the quadtree.
#[derive(Debug, Default, Serialize)]
pub(super) struct LevelStats {
    pub(super) level: u8,
    /// Side of a column.
    pub(super) cell_m: f64,
    pub(super) nodes: u64,
    /// Of V-BlockMaps: all, and of one node.
    pub(super) bytes: u64,
    pub(super) bytes_min: u64,
    pub(super) bytes_mean: f64,
    pub(super) bytes_max: u64,
    /// World errors of its nodes; `None` without subtree tiles.
    pub(super) error_m_min: Option<f64>,
    pub(super) error_m_max: Option<f64>,
}

impl<'a> CityStats<'a> {
    pub(super) fn take(city: &'a CityStore) -> Self {
        let manifest = city.manifest();
        let level = |level| LevelStats {
            level,
            cell_m: manifest.cell_m_at(level),
            bytes_min: u64::MAX,
            ..LevelStats::default()
        };
        let mut levels: Vec<LevelStats> = (0..=manifest.depth).map(level).collect();
        for (id, length) in city.blockmaps().lengths() {
            if let Some(level) = levels.get_mut(usize::from(id.level())) {
                level.add_bytes(u64::from(length));
            }
        }
        let mut damaged = 0;
        let mut meshes: Vec<MeshLodStats> = Vec::new();
        for (_, bytes) in city.subtrees().tiles() {
            let Some(subtree) = bytes.ok().and_then(|bytes| Subtree::decode(&bytes).ok()) else {
                damaged += 1;
                continue;
            };
            for (lod, info) in subtree.meshes.iter().flat_map(|mesh| mesh.lods.iter().enumerate()) {
                if meshes.len() <= lod {
                    meshes.push(MeshLodStats { lod: meshes.len(), ..MeshLodStats::default() });
                }
                meshes[lod].add(info);
            }
            for node in &subtree.nodes {
                if let Some(level) = levels.get_mut(usize::from(node.id.level())) {
                    level.add_error(f64::from(node.error_m));
                }
            }
        }
        for level in &mut levels {
            level.finish();
        }
        let subtree_tiles = city.subtrees().len();
        Self { manifest, file_bytes: city.file_bytes(), subtree_tiles, damaged_subtree_tiles: damaged, levels, meshes }
    }
}

impl MeshLodStats {
    fn add(&mut self, info: &MeshLod) {
        self.leaves += 1;
        self.bytes += u64::from(info.bytes);
        self.triangles += u64::from(info.triangles);
        self.texture_px += u64::from(info.texture_px);
        self.error_m = self.error_m.max(info.error_m);
    }
}

impl LevelStats {
    fn add_bytes(&mut self, bytes: u64) {
        self.nodes += 1;
        self.bytes += bytes;
        self.bytes_min = self.bytes_min.min(bytes);
        self.bytes_max = self.bytes_max.max(bytes);
    }

    fn add_error(&mut self, error_m: f64) {
        self.error_m_min = Some(self.error_m_min.map_or(error_m, |min| min.min(error_m)));
        self.error_m_max = Some(self.error_m_max.map_or(error_m, |max| max.max(error_m)));
    }

    fn finish(&mut self) {
        if self.nodes == 0 {
            self.bytes_min = 0;
        } else {
            self.bytes_mean = self.bytes as f64 / self.nodes as f64;
        }
    }
}
