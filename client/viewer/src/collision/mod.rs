//! Where a city is solid, as far as its resident tiles say: ground below a point, points inside of buildings, obstacles on a way.
//!
//! The ray-caster's pages may be on a GPU, so that each resident tile keeps the shapes of its columns or triangles in main memory
//! as well ([`crate::solids`]). A place has the accuracy of its finest resident tile: of a leaf's mesh if there is
//! one, else of columns. Where nothing is resident, and beyond the city, there is only the ground plane.
//!
//! What a pixel shows is a question for the ray-caster: a frame of one pixel gives the point below the pointer as it is drawn, at
//! any distance. These solids say where a camera can stand near that point, and whether a short way is free.

#[cfg(test)]
mod tests;

use crate::cache::AtlasCache;
use crate::solids::{SolidInterval, TileSolids, exits_of};
use glam::{DVec2, DVec3, Vec3Swizzles};
use insula_protocol::mesh_tile::MAX_LODS;
use insula_protocol::{Manifest, TileId};

/// Most tiles that a way is followed through.
const MAX_TILES: usize = 1024;
/// Heights that differ by less are the same, in metres.
const SAME_HEIGHT_M: f64 = 1e-3;
/// Height of eyes above what they stand on.
pub const EYE_HEIGHT_M: f64 = 1.7;

/// A resident tile, and the place that it covers.
struct CoveringTile<'a> {
    /// `None` where nothing is resident.
    solids: Option<TileSolids<'a>>,
    /// South-west corner of the tile's node at the city's height zero, in world metres.
    corner: DVec3,
    /// The square in which no finer tile is resident, in world metres.
    square: [DVec2; 2],
}

/// The solids of a city's resident tiles. All points are in world metres.
///
/// ```text
/// walking:   z = solids.ground_below(eye + step).map(|ground| ground + eye_height)
/// collision: solids.hit_on_way(eye, next_eye)
/// rescue:    if let Some(z) = solids.lifted_eye_z(eye) { eye.z = z }
/// ```
#[derive(Debug, Clone, Copy)]
pub struct CitySolids<'a> {
    manifest: &'a Manifest,
    cache: &'a AtlasCache,
}

impl<'a> CitySolids<'a> {
    /// The solids of the tiles in `cache`, which are those of the manifest's city.
    pub fn new(manifest: &'a Manifest, cache: &'a AtlasCache) -> Self {
        Self { manifest, cache }
    }

    /// Height of the highest ground or roof that is not above `point`. `None` below the ground plane and where the plane is
    /// inside of a solid, if there is nothing else.
    pub fn ground_below(&self, point: DVec3) -> Option<f64> {
        let intervals = self.intervals_at(point.xy());
        let tops = intervals.iter().map(|solid| solid.top).filter(|top| *top <= point.z + SAME_HEIGHT_M);
        let highest = tops.max_by(f64::total_cmp);
        let plane = self.manifest.ground_z_m;
        let is_plane_hidden = intervals.iter().any(|solid| solid.bottom <= plane && plane < solid.top);
        let plane = Some(plane).filter(|plane| *plane <= point.z && !is_plane_hidden);
        highest.into_iter().chain(plane).max_by(f64::total_cmp)
    }

    /// Whether a point is in a building or below terrain. Surfaces themselves are outside.
    pub fn is_inside(&self, point: DVec3) -> bool {
        self.intervals_at(point.xy()).iter().any(|solid| solid.bottom < point.z && point.z < solid.top)
    }

    /// The lowest height at or above a point that is in no solid: that of the point itself if it is outside.
    pub fn free_height_above(&self, point: DVec3) -> f64 {
        free_height(self.intervals_at(point.xy()), point.z)
    }

    /// Height of an eye that is lifted out of what it is inside of, or below; `None` if it is outside.
    pub fn lifted_eye_z(&self, eye: DVec3) -> Option<f64> {
        lifted_eye_z(self.manifest, self.intervals_at(eye.xy()), eye.z)
    }

    /// The first point of the way between two points that meets a solid, as [`Self::hit_on_way`], or the ground plane from above.
    pub fn surface_on_way(&self, from: DVec3, to: DVec3) -> Option<DVec3> {
        let plane = self.manifest.ground_z_m;
        let is_crossed = from.z > plane && to.z < plane;
        let ground = is_crossed.then(|| from.lerp(to, (from.z - plane) / (from.z - to.z)));
        self.hit_on_way(from, ground.unwrap_or(to)).or(ground)
    }

    /// The first point of the way between two points that meets a solid: `from` itself if it is inside of one. `None` if the way
    /// is free. For short ways: one through very many tiles is followed only in part. The ground plane is no solid.
    pub fn hit_on_way(&self, from: DVec3, to: DVec3) -> Option<DVec3> {
        let way = to - from;
        let length_m = way.length();
        if !length_m.is_finite() {
            return None;
        }
        if self.is_inside(from) {
            return Some(from);
        }
        // Far enough behind a border to be in the next tile.
        let step = (SAME_HEIGHT_M / length_m.max(SAME_HEIGHT_M)).min(1.0);
        let mut t = 0.0;
        for _ in 0..MAX_TILES {
            let tile = self.tile_at((from + way * t).xy());
            let end = exits_of(tile.square, from.xy(), way.xy()).min_element().clamp(t, 1.0);
            let hit = tile.solids.and_then(|solids| solids.first_hit(from - tile.corner, way, [t, end]));
            if let Some(t) = hit {
                return Some(from + way * t);
            }
            if end >= 1.0 {
                return None;
            }
            t = end + step;
            if t > 1.0 {
                return None;
            }
        }
        None
    }

    /// The solids above and below a place, as world heights.
    fn intervals_at(&self, p: DVec2) -> Vec<SolidInterval> {
        let tile = self.tile_at(p);
        let local = p - tile.corner.xy();
        let mut intervals = tile.solids.map(|solids| solids.intervals_at(local)).unwrap_or_default();
        for solid in &mut intervals {
            (solid.bottom, solid.top) = (solid.bottom + tile.corner.z, solid.top + tile.corner.z);
        }
        intervals
    }

    /// The finest resident tile at a place.
    fn tile_at(&self, p: DVec2) -> CoveringTile<'a> {
        let Manifest { origin, depth, .. } = self.manifest;
        let origin = DVec3::from(*origin);
        let leaf_side_m = self.manifest.node_side_m(*depth);
        let cell = ((p - origin.xy()) / leaf_side_m).floor();
        let square = [origin.xy() + cell * leaf_side_m, origin.xy() + (cell + 1.0) * leaf_side_m];
        let nothing = CoveringTile { solids: None, corner: origin, square };
        let side = f64::from(1u32 << (*depth).min(31));
        if !(cell.min_element() >= 0.0 && cell.max_element() < side) {
            return CoveringTile { square: self.outside_of(p), ..nothing };
        }
        for level in (0..=*depth).rev() {
            let above = depth - level;
            let Some(id) = TileId::new(level, cell.x as u32 >> above, cell.y as u32 >> above) else { continue };
            // Finer tiles may be resident beside this place, so that the square stays a leaf's.
            if let Some(solids) = self.solids_of(id, level == *depth) {
                return CoveringTile { solids: Some(solids), corner: self.manifest.node_corner(id).into(), square };
            }
        }
        nothing
    }

    fn solids_of(&self, id: TileId, is_leaf: bool) -> Option<TileSolids<'a>> {
        let lods = if is_leaf { MAX_LODS } else { 0 };
        let mesh = (0..lods).find_map(|lod| self.cache.mesh_solids(id, lod)).map(TileSolids::Mesh);
        mesh.or_else(|| self.cache.column_solids(id).map(TileSolids::Columns))
    }

    /// The half plane or strip beside the city that holds a place, as a square that may be infinite.
    fn outside_of(&self, p: DVec2) -> [DVec2; 2] {
        let low = DVec3::from(self.manifest.origin).xy();
        let high = low + self.manifest.root_side_m;
        let mut square = [DVec2::NEG_INFINITY, DVec2::INFINITY];
        for axis in 0..2 {
            if p[axis] < low[axis] {
                square[1][axis] = low[axis];
                return square;
            }
            if p[axis] >= high[axis] {
                square[0][axis] = high[axis];
                return square;
            }
        }
        square
    }
}

/// The lowest height at or above `z` that is in none of the solids at a place.
fn free_height(mut solids: Vec<SolidInterval>, mut z: f64) -> f64 {
    solids.sort_by(|a, b| a.bottom.total_cmp(&b.bottom));
    for solid in solids {
        if solid.bottom < z + SAME_HEIGHT_M && z < solid.top {
            z = solid.top;
        }
    }
    z
}

/// Height of an eye at height `z` that is lifted out of the solids at its place, which are world heights, or out of the Earth; `None`
/// if it is outside.
pub fn lifted_eye_z(manifest: &Manifest, solids: Vec<SolidInterval>, z: f64) -> Option<f64> {
    // Below all that stands there is the Earth, and not the outside.
    let is_below = z < manifest.bounds[0][2].min(manifest.ground_z_m);
    // Terrain lies below all else, as a sheet: an eye below all solids at its place is below it.
    let lowest = solids.iter().min_by(|a, b| a.bottom.total_cmp(&b.bottom));
    let terrain_z = lowest.filter(|lowest| manifest.has_terrain && z < lowest.bottom).map(|lowest| lowest.top);
    let is_inside = is_below || terrain_z.is_some() || solids.iter().any(|solid| solid.bottom < z && z < solid.top);
    let lowest_free = terrain_z.unwrap_or(if is_below { manifest.ground_z_m } else { z });
    is_inside.then(|| free_height(solids, lowest_free) + EYE_HEIGHT_M)
}
