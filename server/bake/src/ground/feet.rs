//! Where walls meet the ground: the lower edges of walls that no other wall continues, without those on roofs.

use super::grid::GroundGrid;
use super::hanging::{self, InAir};
use super::low_foot::{LOW_WALL_M, LOWEST_M, LowFoot, MAX_WALL_NORMAL_Z, MEDIAN_NEIGHBOURS, feet_around, median};
use crate::error::BakeError;
use crate::scene::scratch_scene::{ScratchScene, StoredObject};
use crate::scene::{ObjectKind, SceneTriangle};
use glam::Vec3;
use insula_scratch::record_list::RecordCursor;
use std::collections::{HashMap, HashSet};

/// Steepest lower edge, rise over run.
const MAX_EDGE_SLOPE: f32 = 0.6;
/// Walls of an object that are compared with each other. More are compared in parts, for bounded memory.
const MAX_WALLS: usize = 1 << 16;
/// Most points of one edge.
const MAX_POINTS: f32 = 4096.0;
/// How far behind its wall a foot's object is looked for.
const BEHIND_M: f32 = 0.05;
/// Steepest ground, and how far above it an object's lowest walls may begin.
const STEEP: [f32; 2] = [0.3, 2.0];
/// The same for walls that begin above their object's lowest point.
const GENTLE: [f32; 2] = [0.1, 0.5];
/// A foot bounds the vertices that have at least this share of the ground's height at it. Bounds of all four would sink low
/// buildings beside higher ones.
const MIN_SHARE: f32 = 0.15;

/// A point on a wall's lower edge.
#[derive(Debug, Clone, Copy)]
struct Foot {
    position: [f32; 3],
    /// What is kept of the lowest foot of each square.
    low: LowFoot,
}

/// Lowest and highest foot around each vertex; `low > high` where there is none.
#[derive(Debug)]
pub(super) struct VertexFeet {
    pub(super) low: Vec<f32>,
    pub(super) high: Vec<f32>,
    /// Whether there is a foot of any kind, on the ground or above it.
    pub(super) is_near: Vec<bool>,
}

/// Finds the feet that stand on the ground. Fails if the triangles cannot be read.
pub(super) fn find(city: &ScratchScene, grid: &GroundGrid) -> Result<VertexFeet, BakeError> {
    let mut feet = lowest_feet(city, grid, &HashSet::new())?;
    let InAir { objects: in_air, on_others } = hanging::find(city, grid, &feet)?;
    if !in_air.is_empty() {
        // One after the other, for bounded memory.
        drop(feet);
        feet = lowest_feet(city, grid, &in_air)?;
    }
    let medians = remove_outliers(&mut feet, grid, &on_others);
    let mut steep: Vec<f32> = feet.iter().map(|foot| foot.z_m).collect();
    drop(feet);
    let mut gentle = steep.clone();
    spread(&mut steep, grid, STEEP[0]);
    spread(&mut gentle, grid, GENTLE[0]);
    let mut feet = VertexFeet {
        low: vec![f32::INFINITY; grid.len()],
        high: vec![f32::NEG_INFINITY; grid.len()],
        is_near: vec![false; grid.len()],
    };
    for_each_foot(city, grid, |foot, [x, y]| {
        let (z, i) = (foot.low.z_m, grid.index(x, y));
        (0..4).for_each(|k| feet.is_near[grid.index(x + (k & 1), y + (k >> 1))] = true);
        let is_lowest = foot.low.is_lowest && !on_others.contains(&foot.low.object);
        let is_on_slope = (is_lowest && z <= steep[i] + STEEP[1]) || z <= gentle[i] + GENTLE[1];
        if is_on_slope && !in_air.contains(&foot.low.object) && foot.low.is_near_median(medians[i]) {
            let [u, v] = grid.within_square(foot.position, [x, y]);
            let shares = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
            for (k, _) in shares.into_iter().enumerate().filter(|(_, share)| *share >= MIN_SHARE) {
                let i = grid.index(x + (k & 1), y + (k >> 1));
                feet.low[i] = feet.low[i].min(z);
                feet.high[i] = feet.high[i].max(z);
            }
        }
    })?;
    Ok(feet)
}

/// The lowest foot of each square, without those of some objects.
fn lowest_feet(city: &ScratchScene, grid: &GroundGrid, without: &HashSet<u32>) -> Result<Vec<LowFoot>, BakeError> {
    let mut lowest = vec![LowFoot::NONE; grid.len()];
    for_each_foot(city, grid, |foot, [x, y]| {
        let known = &mut lowest[grid.index(x, y)];
        if foot.low.is_before(known) && !without.contains(&foot.low.object) {
            *known = foot.low;
        }
    })?;
    Ok(lowest)
}

/// Calls `visit` for points on all lower edges with their square of the grid.
fn for_each_foot(
    city: &ScratchScene,
    grid: &GroundGrid,
    mut visit: impl FnMut(&Foot, [usize; 2]),
) -> Result<(), BakeError> {
    let step_m = (0.25 * grid.step_m) as f32;
    let mut walls = WallBatch { city, objects: city.objects.cursor(), step_m, walls: Vec::new(), uses: HashMap::new() };
    let mut visit_point = |foot: &Foot| {
        let [x, y, _] = foot.position;
        visit(foot, grid.square(x.into(), y.into()));
    };
    city.try_for_each(|triangle| walls.add(triangle, &mut visit_point))?;
    walls.flush(&mut visit_point)
}

/// Walls of one object.
struct WallBatch<'a> {
    city: &'a ScratchScene,
    objects: RecordCursor<'a, StoredObject>,
    /// Distance of points along an edge.
    step_m: f32,
    walls: Vec<SceneTriangle>,
    /// Number of walls at each edge.
    uses: HashMap<[[u32; 3]; 2], u32>,
}

impl WallBatch<'_> {
    fn add(&mut self, triangle: &SceneTriangle, visit: &mut impl FnMut(&Foot)) -> Result<(), BakeError> {
        let is_other = self.walls.first().is_some_and(|wall| wall.object != triangle.object);
        if is_other || self.walls.len() >= MAX_WALLS {
            self.flush(visit)?;
        }
        let [a, b, c] = triangle.corners.map(Vec3::from_array);
        let normal = (b - a).cross(c - a);
        let is_wall = normal.z.abs() <= MAX_WALL_NORMAL_Z * normal.length() && normal.length() > 1e-6;
        let object = triangle.object;
        // Landmarks follow the ground, not the ground them.
        let kind = self.objects.get(object as usize)?.kind;
        let has_feet = kind != ObjectKind::Terrain && !self.city.standing.contains(&object);
        if has_feet && is_wall {
            for k in 0..3 {
                *self.uses.entry(edge(triangle, k)).or_default() += 1;
            }
            self.walls.push(*triangle);
        }
        Ok(())
    }

    fn flush(&mut self, visit: &mut impl FnMut(&Foot)) -> Result<(), BakeError> {
        for wall in &self.walls {
            let StoredObject { base_z_m, bounds_m: [low, high], .. } = self.objects.get(wall.object as usize)?;
            // Where the source says how far the object is above the ground, the ground is there.
            let above_m = (low[2] - base_z_m).max(0.0);
            let is_slab = high[2] - base_z_m < LOW_WALL_M;
            for k in (0..3).filter(|k| self.uses.get(&edge(wall, *k)) == Some(&1)) {
                let [a, b, c] = [0, 1, 2].map(|i| Vec3::from_array(wall.corners[(k + i) % 3]));
                let length_m = (b - a).truncate().length();
                if (b.z - a.z).abs() > MAX_EDGE_SLOPE * length_m || 2.0 * c.z <= a.z + b.z {
                    continue;
                }
                let outwards = (b - a).cross(c - a).truncate().normalize_or_zero() * BEHIND_M;
                let middle = (a + b) / 2.0;
                let wall_top_m = a.z.max(b.z).max(c.z) - above_m;
                let n = (length_m / self.step_m).ceil().clamp(1.0, MAX_POINTS);
                for i in 0..=n as u32 {
                    let mut position = (a + (b - a) * (i as f32 / n)).to_array();
                    let to_middle = (middle - Vec3::from_array(position)).truncate().clamp_length_max(BEHIND_M);
                    position[2] -= above_m;
                    let behind = [0, 1].map(|axis| position[axis] - outwards[axis] + to_middle[axis]);
                    let (z_m, object) = (position[2], wall.object);
                    let is_lowest = !is_slab && z_m <= base_z_m + LOWEST_M;
                    visit(&Foot { position, low: LowFoot { z_m, wall_top_m, behind, object, is_lowest } });
                }
            }
        }
        self.walls.clear();
        self.uses.clear();
        Ok(())
    }
}

/// Edge `k` of a triangle, the same for both directions.
fn edge(triangle: &SceneTriangle, k: usize) -> [[u32; 3]; 2] {
    let [a, b] = [k, (k + 1) % 3].map(|i| triangle.corners[i].map(|v| (v + 0.0).to_bits()));
    if a <= b { [a, b] } else { [b, a] }
}

/// Removes feet far from the median of those around them. Returns that median for each square; NaN where there are too few.
///
/// Feet of high walls decide, if there are any: a bridge's deck has more walls than its piers.
fn remove_outliers(lowest: &mut [LowFoot], grid: &GroundGrid, on_others: &HashSet<u32>) -> Vec<f32> {
    let (mut sure, mut all) = (Vec::new(), Vec::new());
    let median_m = |i: usize| {
        sure.clear();
        all.clear();
        if lowest[i].z_m.is_finite() {
            for foot in feet_around(lowest, grid, i) {
                all.push(foot.z_m);
                if foot.is_sure() && !on_others.contains(&foot.object) {
                    sure.push(foot.z_m);
                }
            }
        }
        let is_enough = all.len() > MEDIAN_NEIGHBOURS;
        median(if sure.is_empty() { &mut all } else { &mut sure }).filter(|_| is_enough).unwrap_or(f32::NAN)
    };
    let medians: Vec<f32> = (0..lowest.len()).map(median_m).collect();
    for (foot, median_m) in lowest.iter_mut().zip(&medians) {
        foot.z_m = if foot.is_near_median(*median_m) { foot.z_m } else { f32::INFINITY };
    }
    medians
}

/// Replaces each height by the lowest that ground of a slope can have there, seen from the others.
fn spread(lowest: &mut [f32], grid: &GroundGrid, slope: f32) {
    let [width, height] = grid.size;
    let straight = slope * grid.step_m as f32;
    let diagonal = straight * std::f32::consts::SQRT_2;
    let mut relax = |x: usize, y: usize, dy: i32, dx: i32| {
        let mut best = lowest[y * width + x];
        for (step_x, step_y, rise) in [(dx, 0, straight), (-1, dy, diagonal), (0, dy, straight), (1, dy, diagonal)] {
            let (other_x, other_y) = (x.checked_add_signed(step_x as isize), y.checked_add_signed(step_y as isize));
            if let (Some(other_x), Some(other_y)) = (other_x, other_y)
                && other_x < width
                && other_y < height
            {
                best = best.min(lowest[other_y * width + other_x] + rise);
            }
        }
        lowest[y * width + x] = best;
    };
    for y in 0..height {
        (0..width).for_each(|x| relax(x, y, -1, -1));
        (0..width).rev().for_each(|x| relax(x, y, -1, 1));
    }
    for y in (0..height).rev() {
        (0..width).rev().for_each(|x| relax(x, y, 1, 1));
        (0..width).for_each(|x| relax(x, y, 1, -1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Scene, SceneObject};

    /// A box without floor and roof: four walls.
    fn walls(scene: &mut Scene, low: [f32; 3], high: [f32; 3]) {
        let object = scene.objects.len() as u32;
        let id = object.to_string();
        scene.objects.push(SceneObject { id, kind: ObjectKind::Building, base_z_m: low[2] });
        let corners = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
        for k in 0..4 {
            let (a, b) = (corners[k], corners[(k + 1) % 4]);
            let at = |p: [f32; 2], z: f32| [p[0], p[1], z];
            for corners in
                [[at(a, low[2]), at(b, low[2]), at(b, high[2])], [at(a, low[2]), at(b, high[2]), at(a, high[2])]]
            {
                scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object });
            }
        }
    }

    #[test]
    fn feet_stand_on_the_ground_and_not_on_roofs_or_in_basements() {
        let materials = vec![Material { rgb: [0; 3], texture: None, is_reflective: false }];
        let mut scene = Scene { materials, ..Scene::default() };
        for i in 0..6 {
            let x = 20.0 * i as f32;
            let base = if i == 2 { -12.0 } else { 0.05 * x };
            walls(&mut scene, [x, 0.0, base], [x + 12.0, 12.0, 15.0]);
        }
        // A penthouse on the roof of the first one.
        walls(&mut scene, [4.0, 4.0, 15.0], [8.0, 8.0, 18.0]);
        let city = ScratchScene::from_scene(scene).unwrap();
        let [min, max] = city.bounds.unwrap();
        let grid = GroundGrid::covering(min, max, [0.0; 3], 64.0).unwrap();
        let feet = find(&city, &grid).unwrap();
        let known: Vec<usize> = (0..grid.len()).filter(|i| feet.low[*i] <= feet.high[*i]).collect();
        assert!(known.len() > 30, "{}", known.len());
        assert!(known.iter().all(|i| feet.low[*i] >= 0.0 && feet.high[*i] <= 5.0));
        let [x, y] = grid.square(100.0, 0.0);
        assert_eq!(feet.high[grid.index(x, y)], 5.0);
    }
}
