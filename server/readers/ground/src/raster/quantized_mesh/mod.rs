//! Terrain of Cesium (quantized-mesh): `layer.json` and a pyramid of tiles, each a mesh of triangles. It is read as a
//! raster of the heights above the WGS84 ellipsoid at the finest level.
//!
//! | step | module |
//! |---|---|
//! | what `layer.json` says | `layer`, `template` |
//! | the tiles that exist | `pyramid`, `tiling` |
//! | triangles of a tile | `mesh` |
//! | pixels of a tile | `resolution`, `lattice` |

mod lattice;
mod layer;
mod mesh;
mod pyramid;
mod resolution;
mod template;
#[cfg(test)]
mod tests;
mod tiling;

use self::layer::Layer;
use self::mesh::Triangle;
use self::pyramid::{Pyramid, TileRange};
use self::tiling::{Projection, TileId};
use super::cache::BlockCache;
use super::error::RasterError;
use super::facts::{RasterFacts, RasterLimits, RasterSize, SampleKind, Window};
use super::place::GeoPlace;
use std::io;
use std::sync::Arc;

/// Pixels along a side of a raster. A finer level with more is left out.
const MAX_PIXELS: u32 = 1 << 31;
/// Bytes of a tile, packed or unpacked. A grid of 1025 x 1025 points has 32 MB.
const MAX_TILE_BYTES: u64 = 1 << 26;
/// Tiles from which the spacing of vertices is estimated.
const MAX_SAMPLES: usize = 8;

/// The files of a terrain: those of a folder or of an archive.
pub(crate) trait TileFiles: Send {
    /// Names of all files, relative to the folder of `layer.json`, with `/` between folders.
    fn names(&self) -> io::Result<Vec<String>>;

    /// The bytes of a file. Fails with [`io::ErrorKind::InvalidData`] if there are more than `max_bytes`, or if the
    /// file is damaged, so that a coarser tile is read in its place. Other errors are those of the whole terrain.
    fn read(&self, name: &str, max_bytes: u64) -> io::Result<Vec<u8>>;
}

/// An opened terrain.
pub(crate) struct QuantizedMesh {
    files: Box<dyn TileFiles>,
    projection: Projection,
    pyramid: Pyramid,
    /// The tiles of the raster.
    range: TileRange,
    /// Pixels along a tile's side.
    side: u32,
    size: RasterSize,
    limits: RasterLimits,
    meshes: BlockCache<Triangle>,
    /// Heights of the pixels of a tile.
    lattices: BlockCache<f32>,
}

impl QuantizedMesh {
    /// Opens a terrain by its `layer.json`, the names of its files, and a few tiles, by which the size of pixels is
    /// chosen.
    ///
    /// Fails if `layer.json` is invalid or has a format, projection or scheme that is not known, or if it has no tiles.
    pub(crate) fn open(
        layer_json: &[u8],
        tiles: Box<dyn TileFiles>,
        limits: RasterLimits,
    ) -> Result<(Self, RasterFacts), RasterError> {
        let layer = Layer::read(layer_json)?;
        let projection = layer.projection;
        let pyramid = Pyramid::new(&tiles.names()?, layer)?;
        let range = pyramid.finest_range(MAX_PIXELS / resolution::MIN_SIDE)?;
        // Both caches are used alike.
        let cache_bytes = limits.cache_bytes / 2;
        let mut terrain = Self {
            files: tiles,
            projection,
            pyramid,
            range,
            side: resolution::MIN_SIDE,
            size: RasterSize { width: 0, height: 0 },
            limits,
            meshes: BlockCache::new(cache_bytes),
            lattices: BlockCache::new(cache_bytes),
        };
        terrain.side = terrain.best_side()?;
        let [width, height] = range.size.map(|tiles| tiles * terrain.side);
        terrain.size = RasterSize { width, height };
        let facts = terrain.facts();
        Ok((terrain, facts))
    }

    /// Heights of a window by row from the north; NaN where no tile has one.
    ///
    /// Fails if the window is not within the raster or has not `len` pixels, or if the files cannot be read.
    pub(crate) fn read_heights(&mut self, window: Window, len: usize) -> Result<Vec<f32>, RasterError> {
        if window.checked_len(self.size, &self.limits)? != len {
            return Err(RasterError::Outside);
        }
        let mut heights = vec![f32::NAN; len];
        let tiles = |first: u32, length: u32| first / self.side..=(first + length - 1) / self.side;
        let (columns, rows) = (tiles(window.x, window.width), tiles(window.y, window.height));
        for row in rows {
            for column in columns.clone() {
                if let Some(lattice) = self.lattice([column, row])? {
                    copy(&lattice, self.side, [column, row], &mut heights, window);
                }
            }
        }
        Ok(heights)
    }

    /// Names of the first tiles that could not be read until now. Coarser tiles are read in their place.
    pub(crate) fn bad_tiles(&self) -> &[String] {
        self.pyramid.bad_names()
    }

    /// Number of all tiles that could not be read until now.
    pub(crate) fn bad_tile_count(&self) -> usize {
        self.pyramid.bad_count()
    }

    /// What is known of the raster.
    fn facts(&self) -> RasterFacts {
        let (corner, tile_side) = self.projection.corner(self.range.first);
        let step = tile_side / f64::from(self.side);
        let mut facts = RasterFacts::new(self.size, SampleKind::F32);
        facts.place = GeoPlace::from_corner(corner, [step, 0.0], [0.0, -step]);
        facts.crs.horizontal = Some(self.projection.crs().to_owned());
        facts.crs.is_ellipsoidal = true;
        facts.crs.height_unit_m = Some(1.0);
        facts
    }

    /// Pixels along a tile's side by the vertices of some tiles, as many as the largest raster may have.
    fn best_side(&mut self) -> Result<u32, RasterError> {
        let level = self.range.level;
        let step = self.pyramid.of_level(level).count().div_ceil(MAX_SAMPLES).max(1);
        let samples: Vec<TileId> = self.pyramid.of_level(level).step_by(step).collect();
        let mut meshes = Vec::with_capacity(samples.len());
        for tile in samples {
            meshes.extend(self.mesh(tile)?);
        }
        let mut side = resolution::pixels_of_side(&meshes);
        while self.range.size.iter().any(|tiles| *tiles > MAX_PIXELS / side) {
            side /= 2;
        }
        Ok(side)
    }

    /// Heights of the pixels of a tile of the range; `None` if neither the tile nor a coarser one exists.
    fn lattice(&mut self, [column, row]: [u32; 2]) -> Result<Option<Arc<Vec<f32>>>, RasterError> {
        let TileRange { level, first, .. } = self.range;
        let tile = TileId { level, column: first.column + column, row: first.row + row };
        if let Some(lattice) = self.lattices.get(cache_key(tile)) {
            return Ok(Some(lattice));
        }
        let mut heights = Vec::new();
        // What a tile leaves open, a coarser one fills.
        for (levels, ancestor) in (0..=level).filter_map(|levels| Some((levels, tile.ancestor(levels)?))) {
            let Some(mesh) = self.mesh(ancestor)? else { continue };
            heights.resize(self.side as usize * self.side as usize, f32::NAN);
            lattice::fill(&mut heights, &self.projection.places(tile, levels, self.side), &mesh);
            if !heights.iter().any(|height| height.is_nan()) {
                break;
            }
        }
        if heights.is_empty() {
            return Ok(None);
        }
        let heights = Arc::new(heights);
        self.lattices.put(cache_key(tile), Arc::clone(&heights));
        Ok(Some(heights))
    }

    /// The triangles of a tile; `None` if it does not exist, or is bad.
    fn mesh(&mut self, tile: TileId) -> Result<Option<Arc<Vec<Triangle>>>, RasterError> {
        if let Some(mesh) = self.meshes.get(cache_key(tile)) {
            return Ok(Some(mesh));
        }
        let Some(name) = self.pyramid.name(tile) else { return Ok(None) };
        let max_bytes = self.limits.max_chunk_bytes.min(MAX_TILE_BYTES);
        let bytes = self.files.read(&name, max_bytes).map_err(RasterError::from);
        match bytes.and_then(|bytes| mesh::read_triangles(&bytes, max_bytes)) {
            Ok(triangles) => {
                let mesh = Arc::new(triangles);
                self.meshes.put(cache_key(tile), Arc::clone(&mesh));
                Ok(Some(mesh))
            }
            Err(RasterError::Io(cause)) => Err(RasterError::Io(cause)),
            Err(_) => {
                self.pyramid.set_bad(tile, name);
                Ok(None)
            }
        }
    }
}

fn cache_key(tile: TileId) -> (usize, u64) {
    (tile.level.into(), u64::from(tile.row) << 32 | u64::from(tile.column))
}

/// Copies the pixels that a tile, `side` x `side` pixels, has in a window.
fn copy(lattice: &[f32], side: u32, tile: [u32; 2], heights: &mut [f32], window: Window) {
    let overlap = |tile: u32, first: u32, length: u32| {
        let start = tile * side;
        let last = u64::from(first) + u64::from(length);
        (start.max(first), (u64::from(start) + u64::from(side)).min(last) as u32)
    };
    let (west, east) = overlap(tile[0], window.x, window.width);
    let (north, south) = overlap(tile[1], window.y, window.height);
    let index = |x: u32, y: u32, width: u32| y as usize * width as usize + x as usize;
    let length = (east - west) as usize;
    for y in north..south {
        let from = index(west - tile[0] * side, y - tile[1] * side, side);
        let to = index(west - window.x, y - window.y, window.width);
        if let (Some(from), Some(to)) = (lattice.get(from..from + length), heights.get_mut(to..to + length)) {
            to.copy_from_slice(from);
        }
    }
}
