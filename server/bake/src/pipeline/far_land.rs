//! The land around the city: nodes that have no leaves of the city, as large as the distance allows.
//!
//! The quadtree is extended until it covers the land. A node without a part of the city that is not too coarse is made
//! from the elevation models as a leaf is made from triangles, and is not divided further. So land next to the city has
//! small columns, and land far away large ones.

use super::leaves::encode_leaves;
use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use crate::read::{FarModels, LandSquare};
use crate::sample::SampleSettings;
use crate::scene::grid::CityGrid;
use crate::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};
use crate::write::tile_pack::EncodedTile;
use insula_protocol::{NODE_CELLS, TileId};
use std::collections::HashSet;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Columns are not wider.
pub(super) const MAX_CELL_M: f64 = 64.0;
/// Cells around a node whose triangles shade it.
const MARGIN_CELLS: usize = 2;
/// Points of its grid of heights along each side: one at each corner of a cell.
const POINTS: usize = NODE_CELLS + 2 * MARGIN_CELLS + 1;
/// Directions from which its light is measured. Land is smooth, so a few are enough.
const VIEWS: u32 = 32;
/// Number of the material of land, and of water.
const LAND: u32 = 0;
const WATER: u32 = 1;

/// The nodes of the land around a city.
pub(super) struct FarLand<'a> {
    surroundings: &'a FarModels,
    /// The scene's origin in the world.
    origin: [f64; 3],
    /// By level, in the order of their ids.
    levels: Vec<Vec<TileId>>,
}

impl<'a> FarLand<'a> {
    /// The nodes of some levels at or below `root` around nodes of the city.
    pub(super) fn within(
        surroundings: &'a FarModels,
        origin: [f64; 3],
        grid: &CityGrid,
        nodes: impl Iterator<Item = TileId>,
        root: TileId,
        levels: RangeInclusive<u8>,
    ) -> Self {
        let mut of_city = HashSet::new();
        for node in nodes {
            let mut id = node;
            while of_city.insert(id)
                && let Some(parent) = id.parent()
            {
                id = parent;
            }
        }
        let mut land = Self { surroundings, origin, levels: vec![Vec::new(); usize::from(grid.depth)] };
        land.divide(grid, root, &of_city, *levels.end());
        (0..*levels.start()).zip(&mut land.levels).for_each(|(_, nodes)| nodes.clear());
        land.levels.iter_mut().for_each(|nodes| nodes.sort_unstable());
        land
    }

    pub(super) fn nodes(&self, level: u8) -> &[TileId] {
        self.levels.get(usize::from(level)).map_or(&[], Vec::as_slice)
    }

    /// Whether a node is land.
    pub(super) fn contains(&self, id: TileId) -> bool {
        self.nodes(id.level()).binary_search(&id).is_ok()
    }

    /// Hash of what its nodes are made from, besides their places.
    pub(super) fn input(&self, config: &BakeConfig, grid: &CityGrid) -> ShortHash {
        let mut hasher = blake3::Hasher::new();
        hasher.update(config.settings.as_bytes()).update(&self.surroundings.hash).update(&[grid.depth]);
        for number in self.origin.into_iter().chain(grid.corner).chain([grid.cell_m]) {
            hasher.update(&number.to_bits().to_le_bytes());
        }
        short_hash(&hasher.finalize())
    }

    fn divide(&mut self, grid: &CityGrid, id: TileId, of_city: &HashSet<TileId>, last: u8) {
        if id.level() >= grid.depth || id.level() > last || !self.is_within_reach(grid, id) {
            return;
        }
        if !of_city.contains(&id) && grid.cell_m_at(id.level()) <= MAX_CELL_M {
            self.levels[usize::from(id.level())].push(id);
            return;
        }
        id.children().for_each(|child| self.divide(grid, child, of_city, last));
    }

    fn is_within_reach(&self, grid: &CityGrid, id: TileId) -> bool {
        let (corner, side_m) = (grid.node_corner(id), grid.node_side_m(id.level()));
        let [low, high] = self.surroundings.bounds;
        (0..2).all(|axis| {
            let start = self.origin[axis] + corner[axis];
            start < high[axis] && start + side_m > low[axis]
        })
    }

    /// Makes a node; `None` where no height is known. Fails if a raster cannot be read, or if the node exceeds the
    /// format's limits.
    pub(super) fn bake(
        &self,
        config: &BakeConfig,
        grid: &CityGrid,
        id: TileId,
    ) -> Result<Option<EncodedTile>, BakeError> {
        // In this grid the node is a leaf.
        let grid = CityGrid { depth: id.level(), cell_m: grid.cell_m_at(id.level()), ..*grid };
        let scene = self.scene(&grid, id)?;
        if scene.triangles.is_empty() {
            return Ok(None);
        }
        let sample =
            SampleSettings { visibility: config.options.sample.visibility, ..SampleSettings::with_views(VIEWS) };
        let mut leaves = encode_leaves(scene, &grid, config, &sample, &[id], false)?;
        Ok(leaves.tiles.pop())
    }

    /// The node's triangles and those of its margin.
    fn scene(&self, grid: &CityGrid, id: TileId) -> Result<Scene, BakeError> {
        let cell_m = grid.cell_m;
        let margin_m = MARGIN_CELLS as f64 * cell_m;
        let first = grid.node_corner(id).map(|along| along - margin_m);
        let corner = [0, 1].map(|axis| self.origin[axis] + first[axis]);
        let heights = self.surroundings.heights(LandSquare { corner, step_m: cell_m, points: POINTS })?;
        let side_m = (POINTS - 1) as f64 * cell_m;
        let picture = self.surroundings.picture([corner, corner.map(|along| along + side_m)], cell_m / 2.0)?;
        let (texture, place) = picture.map(|picture| (picture.texture, picture.place)).unzip();
        let texture = texture.map(Arc::new);
        let colours = self.surroundings.colours;
        let land = if texture.is_some() { [255; 3] } else { colours.land };
        let material = |rgb, texture, is_reflective| Material { rgb, texture, is_reflective };
        let water = match &texture {
            Some(texture) => material(land, Some(Arc::clone(texture)), true),
            None => material(colours.water, None, true),
        };
        let materials = vec![material(land, texture, false), water];
        let position = |x: usize, y: usize| {
            let height = f64::from(heights[y * POINTS + x]);
            [corner[0] + x as f64 * cell_m, corner[1] + y as f64 * cell_m, height]
        };
        let mut triangles = Vec::with_capacity(2 * (POINTS - 1) * (POINTS - 1));
        for y in 0..POINTS - 1 {
            for x in 0..POINTS - 1 {
                let [a, b, c, d] = [position(x, y), position(x + 1, y), position(x + 1, y + 1), position(x, y + 1)];
                for corners in [[a, b, c], [a, c, d]] {
                    if corners.iter().any(|corner| corner[2].is_nan()) {
                        continue;
                    }
                    let local = |corner: [f64; 3]| [0, 1, 2].map(|axis| (corner[axis] - self.origin[axis]) as f32);
                    let uv = |corner| place.map_or([0.0; 2], |place| place.uv(corner));
                    let material = if corners.iter().all(is_sea) { WATER } else { LAND };
                    triangles.push(SceneTriangle {
                        corners: corners.map(local),
                        uv: corners.map(uv),
                        material,
                        object: 0,
                    });
                }
            }
        }
        let lowest = triangles.iter().flat_map(|triangle| triangle.corners).map(|corner| corner[2]);
        let base_z_m = lowest.reduce(f32::min).unwrap_or(0.0);
        let objects = vec![SceneObject { id: String::new(), kind: ObjectKind::Terrain, base_z_m }];
        Ok(Scene { origin: self.origin, triangles, objects, materials, ..Scene::default() })
    }
}

/// Elevation models have the sea at a height of exactly 0.
fn is_sea(corner: &[f64; 3]) -> bool {
    corner[2] == 0.0
}
