//! Statistics of a city for `inspect`, gathered from its manifest and archives.

use crate::store::CityStore;
use insula_archive::{CityError, ReadError};
use insula_protocol::subtree::MeshLod;
use insula_protocol::{Manifest, Subtree};
use serde::Serialize;

/// A city's manifest with the totals of its archives.
#[derive(Debug, Serialize)]
pub(super) struct CityStats<'a> {
    pub(super) manifest: &'a Manifest,
    /// Size of all archives.
    pub(super) file_bytes: u64,
    pub(super) subtree_tiles: u64,
    /// Subtree tiles that cannot be read. The errors of their nodes and their meshes are not counted.
    pub(super) damaged_subtree_tiles: usize,
    /// Root first.
    pub(super) levels: Vec<LevelStats>,
    /// Finest level of detail first.
    pub(super) meshes: Vec<MeshLodStats>,
}

/// Totals of the meshes of one level of detail.
#[derive(Debug, Default, Serialize)]
pub(super) struct MeshLodStats {
    /// 0 for the finest.
    pub(super) lod: usize,
    pub(super) leaves: u64,
    pub(super) bytes: u64,
    pub(super) triangles: u64,
    pub(super) texture_px: u64,
    /// Largest error in metres.
    pub(super) error_m: f32,
}

/// Totals of one level of the quadtree.
#[derive(Debug, Default, Serialize)]
pub(super) struct LevelStats {
    pub(super) level: u8,
    /// Width of a column in metres.
    pub(super) cell_m: f64,
    pub(super) nodes: u64,
    /// Size of all V-BlockMaps; the other sizes are per node.
    pub(super) bytes: u64,
    pub(super) bytes_min: u64,
    pub(super) bytes_mean: f64,
    pub(super) bytes_max: u64,
    /// Smallest and largest geometric error of the nodes in metres; `None` if no subtree tile could be read.
    pub(super) error_m_min: Option<f64>,
    pub(super) error_m_max: Option<f64>,
}

impl<'a> CityStats<'a> {
    /// Fails if a directory of V-BlockMaps cannot be read.
    pub(super) fn collect(city: &'a CityStore) -> Result<Self, CityError> {
        let manifest = city.manifest();
        let empty_level = |level| LevelStats {
            level,
            cell_m: manifest.cell_m_at(level),
            bytes_min: u64::MAX,
            ..LevelStats::default()
        };
        let mut levels: Vec<LevelStats> = (0..=manifest.depth).map(empty_level).collect();
        for (id, length) in city.blockmaps().lengths() {
            let failed =
                |error: ReadError| CityError::Archive { location: city.location().into(), source: error.into() };
            let length = length.map_err(failed)?;
            if let Some(level) = levels.get_mut(usize::from(id.level())) {
                level.add_bytes(u64::from(length));
            }
        }
        let mut damaged_subtree_tiles = 0;
        let mut meshes: Vec<MeshLodStats> = Vec::new();
        for (_, bytes) in city.subtrees().tiles() {
            let Some(subtree) = bytes.ok().and_then(|bytes| Subtree::decode(&bytes).ok()) else {
                damaged_subtree_tiles += 1;
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
        Ok(Self { manifest, file_bytes: city.file_bytes(), subtree_tiles, damaged_subtree_tiles, levels, meshes })
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
