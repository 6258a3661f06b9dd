//! The generated ground: a surface under the buildings where the sources have no terrain, and a skirt around the city
//! that meets the surrounding plane.
//!
//! It makes triangles of one more terrain object, which all later stages treat as the sources' own, and the height of the
//! plane.
//!
//! | step | module |
//! |---|---|
//! | a regular grid over the city and its skirt | `grid` |
//! | heights where walls meet the ground | `feet`, `low_foot` |
//! | objects that hang in the air or are buried | `hanging` |
//! | heights beside given terrain | `under` |
//! | a smooth field through both, and down to the plane | `insula_read_ground::relax` |
//! | triangles, fewer where it is flat | `mesh` |
//! | landmarks that stand on them | `standing` |

mod feet;
mod grid;
mod hanging;
mod low_foot;
mod mesh;
mod standing;
mod under;

use crate::error::BakeError;
use crate::sample::rasterise;
use crate::scene::scratch_scene::{ObjectPlacement, ScratchScene, StoredMaterial, StoredObject};
use crate::scene::{ObjectKind, SceneTriangle};
use grid::GroundGrid;
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::ground::{GROUND_COLOUR, HEIGHTS_PER_CELL};
use insula_read_ground::relax::{Bounds, smooth_field};
use mesh::HeightRange;
use serde::Serialize;

/// Increased whenever the same city would get another ground.
pub const ALGORITHM: u32 = 8;
/// Buildings may sink this far where that makes the ground smoother.
const SINK_M: f32 = 0.8;
/// Generated ground passes this far below given terrain, and ends below it.
const UNDER_TERRAIN_M: f32 = 0.3;
/// Distance, in steps, that it reaches below given terrain.
const UNDER_TERRAIN_STEPS: u16 = 2;
/// Ground at the plane's height that is further from all buildings is left to the plane.
const NEAR_M: f64 = 32.0;
/// Unless a square of twice this side does not fit between the buildings there: the plane has neither occlusion nor the light of
/// lamps, which shows as a patch in a square or on a river.
const OPEN_M: f64 = 128.0;
/// Largest error of the triangles near buildings, and elsewhere.
const TOLERANCE_M: [f32; 2] = [0.4, 0.8];
/// Rounding of heights of feet and between vertices.
const ROUNDING_M: f32 = 0.01;
/// The plane takes the median of the border's heights, but hardly any ground lies deeper below it: a viewer outside would
/// look under the ground there. This is the share of the ground that may, and how deep the rest may lie.
const LOW_SHARE: f64 = 0.02;
const MAX_DEPTH_M: f32 = 2.0;
/// Terrain is level if this share of it is, and land is at least this share of it.
const LEVEL_SHARE: f64 = 0.9;
const LAND_SHARE: f64 = 0.05;
/// Horizontal length of the skirt per metre of its height. It is at least [`NEAR_M`] long.
const SKIRT_RUN: f32 = 6.0;

/// Whether a bake generates ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GroundOption {
    /// Ground where the sources have no terrain, and a skirt around it.
    Auto,
    /// Only the terrain of the sources.
    #[default]
    None,
}

/// The generated ground of a city.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroundReport {
    /// Always true; distinguishes it from terrain of the sources.
    pub generated: bool,
    /// Whether the sources have terrain, so that only its surroundings and holes are generated.
    pub around_terrain: bool,
    /// Distance of the heights in metres.
    pub spacing_m: f64,
    pub triangles: u64,
    /// World height of the lowest and highest point.
    pub z_range_m: [f64; 2],
    /// World height of the surrounding plane.
    pub plane_z_m: f64,
}

/// Adds generated ground to a city, unless there is nothing that stands on the ground. `cell_m` is the side of a leaf's
/// column. Fails if the triangles cannot be read or written.
pub(crate) fn add(city: &mut ScratchScene, cell_m: f64) -> Result<Option<GroundReport>, BakeError> {
    let Some([min, max]) = city.bounds else { return Ok(None) };
    let leaf_m = cell_m * NODE_CELLS as f64;
    let Some(grid) = GroundGrid::covering(min, max, city.origin, leaf_m) else { return Ok(None) };
    let steps = HeightSteps { step_m: cell_m / f64::from(HEIGHTS_PER_CELL), origin_m: city.origin[2] };
    let Some(surface) = Surface::build(city, &grid, steps)? else { return Ok(None) };
    let triangles = mesh::triangulate(&grid, &surface.field, &surface.range(), surface.plane_m);
    let heights = || triangles.iter().flatten().map(|corner| corner[2]);
    let (low, high) = (heights().fold(f32::INFINITY, f32::min), heights().fold(f32::NEG_INFINITY, f32::max));
    if triangles.is_empty() {
        return Ok(None);
    }
    if !surface.has_terrain {
        standing::move_to(city, &triangles)?;
    }
    push_object(city, &triangles, surface.plane_m)?;
    let world = |z: f32| city.origin[2] + f64::from(z);
    Ok(Some(GroundReport {
        generated: true,
        around_terrain: surface.has_terrain,
        spacing_m: grid.step_m,
        triangles: triangles.len() as u64,
        z_range_m: [world(low), world(high)],
        plane_z_m: world(surface.shown_plane_m),
    }))
}

/// The height field and what is known of each vertex.
struct Surface<'a> {
    grid: &'a GroundGrid,
    field: Vec<f32>,
    bounds: Bounds,
    /// Vertices of squares where something stands, or hangs in the air.
    is_near: Vec<bool>,
    /// Vertices on given terrain.
    is_given: Vec<bool>,
    /// Heights of vertices beside given terrain.
    beside: Vec<Option<f32>>,
    has_terrain: bool,
    /// The height at which generated ground ends.
    plane_m: f32,
    /// The height of the surrounding plane.
    shown_plane_m: f32,
}

impl<'a> Surface<'a> {
    /// `None` if no height is known anywhere.
    fn build(city: &ScratchScene, grid: &'a GroundGrid, steps: HeightSteps) -> Result<Option<Self>, BakeError> {
        let terrain = terrain_heights(city, grid)?;
        let feet = feet::find(city, grid)?;
        let mut bounds = Bounds::unknown(grid.size);
        for i in 0..grid.len() {
            if terrain[i].is_finite() {
                let z = steps.round(terrain[i] - UNDER_TERRAIN_M, f64::floor);
                (bounds.low[i], bounds.high[i]) = (z, z);
            } else if feet.low[i] <= feet.high[i] {
                let low = steps.round(feet.high[i] - ROUNDING_M, f64::ceil);
                (bounds.low[i], bounds.high[i]) = (low, low.max(feet.low[i] + SINK_M));
            }
        }
        let is_near = feet.is_near;
        if !(0..grid.len()).any(|i| bounds.is_known(i)) {
            return Ok(None);
        }
        let free = smooth_field(&bounds);
        let under_m = UNDER_TERRAIN_M + 2.0 * steps.step_m as f32;
        let plane_m = plane_height(grid, &free, steps);
        let level_m = level_height(&terrain, steps.step_m as f32);
        let shown_plane_m = level_m.filter(|z| (plane_m..=plane_m + under_m).contains(z)).unwrap_or(plane_m);
        let mut beside = under::beside(grid, &terrain);
        let mut skirted = bounds.clone();
        let distances = grid.distances(|i| bounds.is_known(i));
        for i in 0..grid.len() {
            // Feet of buildings count more than the edge of terrain, and the plane hides what is beside level terrain.
            beside[i] = beside[i].filter(|_| !bounds.is_known(i) && shown_plane_m == plane_m);
            let skirt_m = (SKIRT_RUN * (free[i] - plane_m).abs()).max(NEAR_M as f32);
            let is_end = grid.is_rim(grid.place(i)) || f32::from(distances[i]) * grid.step_m as f32 > skirt_m;
            let z = beside[i].map(|z| steps.round(z, f64::floor)).or(is_end.then_some(plane_m));
            if let Some(z) = z {
                (skirted.low[i], skirted.high[i]) = (z, z);
            }
        }
        let mut field = smooth_field(&skirted);
        for (i, z) in field.iter_mut().enumerate() {
            let nearest = steps.round(*z, f64::round);
            *z = if skirted.is_known(i) { nearest.max(skirted.low[i]) } else { nearest };
        }
        let is_given: Vec<bool> = terrain.iter().map(|z| z.is_finite()).collect();
        let has_terrain = is_given.contains(&true);
        Ok(Some(Self { grid, field, bounds, is_near, is_given, beside, has_terrain, plane_m, shown_plane_m }))
    }

    /// The heights that triangles may have.
    fn range(&self) -> HeightRange {
        let grid = self.grid;
        let near_steps = (NEAR_M / grid.step_m).ceil().max(2.0) as u16;
        let to_building = grid.distances(|i| self.is_near[i] && !self.is_given[i]);
        let to_gap = grid.distances(|i| !self.is_given[i]);
        let open_steps = (OPEN_M / grid.step_m).ceil() as u16;
        let to_open =
            grid.distances(|i| to_building[i] > near_steps.saturating_add(open_steps) || grid.is_rim(grid.place(i)));
        let n = grid.len();
        let mut range =
            HeightRange { low: vec![f32::NEG_INFINITY; n], high: vec![f32::INFINITY; n], is_needed: vec![false; n] };
        for i in 0..n {
            let z = self.field[i];
            let is_near = to_building[i] <= near_steps;
            let is_given = self.is_given[i];
            let is_within = is_near || to_open[i] > open_steps;
            // The plane that goes on at the height of level terrain needs no ground below it, which would show at its end.
            let is_under = is_given && self.shown_plane_m == self.plane_m && to_gap[i] <= UNDER_TERRAIN_STEPS;
            range.is_needed[i] = if is_given { is_under } else { is_within || z != self.plane_m };
            let tolerance_m = TOLERANCE_M[usize::from(!is_near)];
            if is_given {
                range.high[i] = z + UNDER_TERRAIN_M / 2.0;
            } else if range.is_needed[i] {
                (range.low[i], range.high[i]) = (z - tolerance_m, z + tolerance_m);
                if self.bounds.is_known(i) {
                    range.low[i] = self.bounds.low[i] - ROUNDING_M;
                    range.high[i] = range.high[i].max(self.bounds.high[i]);
                }
            }
            if let Some(z) = self.beside[i] {
                range.high[i] = z + UNDER_TERRAIN_M / 2.0;
            }
        }
        range
    }
}

/// The heights that the ground of tiles can have, so that triangles and tiles agree, and a change of the city changes no
/// ground far away.
#[derive(Debug, Clone, Copy)]
struct HeightSteps {
    step_m: f64,
    /// World height of the scene's zero.
    origin_m: f64,
}

impl HeightSteps {
    fn round(self, z: f32, to_whole: fn(f64) -> f64) -> f32 {
        (to_whole((f64::from(z) + self.origin_m) / self.step_m) * self.step_m - self.origin_m) as f32
    }
}

/// The height of terrain that is level, but for a few piers, and for the sea a part of a cell below the land. The plane goes on at this
/// height, and not at that of the ground below: a step all around the city would throw a shadow.
fn level_height(terrain: &[f32], step_m: f32) -> Option<f32> {
    let mut given: Vec<f32> = terrain.iter().copied().filter(|z| z.is_finite()).collect();
    given.sort_unstable_by(f32::total_cmp);
    let least = ((LAND_SHARE * given.len() as f64) as usize).max(1);
    let land = given.windows(least).rev().find(|same| same[least - 1] - same[0] <= ROUNDING_M)?[0];
    let level = given.iter().filter(|z| (-step_m..=ROUNDING_M).contains(&(**z - land))).count();
    (level as f64 >= LEVEL_SHARE * given.len() as f64).then_some(land)
}

/// The height of the plane for a field without a skirt.
fn plane_height(grid: &GroundGrid, field: &[f32], steps: HeightSteps) -> f32 {
    let quantile = |mut heights: Vec<f32>, share: f64| {
        let k = (share * heights.len() as f64) as usize;
        if heights.is_empty() { f32::INFINITY } else { *heights.select_nth_unstable_by(k, f32::total_cmp).1 }
    };
    let border = quantile(grid.border().map(|i| field[i]).collect(), 0.5);
    steps.round(border.min(quantile(field.to_vec(), LOW_SHARE) + MAX_DEPTH_M), f64::floor)
}

/// Adds the triangles as one terrain object.
fn push_object(city: &mut ScratchScene, triangles: &[[[f32; 3]; 3]], plane_m: f32) -> Result<(), BakeError> {
    let (material, object) = (city.materials.len() as u32, city.objects.len() as u32);
    city.materials.push(StoredMaterial::matt(GROUND_COLOUR, None));
    // The plane's height, not the lowest point, so that blocks do not depend on ground far away.
    let bounds_m = [[0.0, 0.0, plane_m]; 2];
    city.objects.push(StoredObject { kind: ObjectKind::GeneratedGround, base_z_m: plane_m, bounds_m, identity: None });
    city.names.push("generated ground".into());
    let mut stored_object = object;
    if !city.placements.is_empty() {
        stored_object = city.placements.len() as u32;
        city.placements.push(ObjectPlacement { offset_m: [0.0; 3], object: Some(object) });
    }
    let all = triangles.iter().map(|corners| {
        let [a, b, c] = *corners;
        let turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let corners = if turn >= 0.0 { [a, b, c] } else { [a, c, b] };
        SceneTriangle { corners, uv: [[0.0; 2]; 3], material, object: stored_object }
    });
    city.stored.append(all)?;
    city.triangles += triangles.len() as u64;
    if let Some([min, max]) = &mut city.bounds {
        for corner in triangles.iter().flatten() {
            for axis in 0..3 {
                min[axis] = min[axis].min(corner[axis].into());
                max[axis] = max[axis].max(corner[axis].into());
            }
        }
    }
    Ok(())
}

/// Triangles that are steeper, by the z of their unit normal, have no height.
const MIN_NORMAL_Z: f32 = 0.05;

/// The highest terrain at each vertex; not finite where there is none. Fails if the triangles cannot be read.
fn terrain_heights(city: &ScratchScene, grid: &GroundGrid) -> Result<Vec<f32>, BakeError> {
    let mut heights = vec![f32::NEG_INFINITY; grid.len()];
    let mut has_terrain = false;
    city.objects.try_for_each(|_, object| {
        has_terrain |= object.kind == ObjectKind::Terrain;
        Ok::<_, BakeError>(())
    })?;
    if !has_terrain {
        return Ok(heights);
    }
    let mut objects = city.objects.cursor();
    city.try_for_each(|triangle| {
        if objects.get(triangle.object as usize)?.kind != ObjectKind::Terrain {
            return Ok(());
        }
        // In steps from the south-west vertex.
        let [a, b, c] = triangle.corners.map(|corner| {
            let along = |axis: usize| ((f64::from(corner[axis]) - grid.corner[axis]) / grid.step_m) as f32;
            glam::Vec3::new(along(0), along(1), corner[2])
        });
        let n = (b - a).cross(c - a);
        if n.z.abs() <= MIN_NORMAL_Z * n.length() {
            return Ok(());
        }
        // Points of the scan conversion lie half a step from the origin.
        let corners = [a, b, c].map(|p| [p.x + 0.5, p.y + 0.5]);
        rasterise(corners, 1.0, grid.size, |y, first, end| {
            for x in first..end {
                let z = a.z - (n.x * (x as f32 - a.x) + n.y * (y as f32 - a.y)) / n.z;
                let highest = &mut heights[grid.index(x, y)];
                *highest = highest.max(z);
            }
        });
        Ok(())
    })?;
    Ok(heights)
}
