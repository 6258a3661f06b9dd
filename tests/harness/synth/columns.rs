//! The columns of a node at any level, from its raster. Walls wider than a cell are clipped where they are; of smaller parts, a
//! column has the height that half of its cell reaches.

use super::blocks::Part;
use super::{GROUND, OUTSIDE, Raster, SUB, Sample};
use glam::{DVec2, Vec2};
use insula_bake::columns::voxels::{
    SolidRun, VoxelAppearance, VoxelClip, VoxelColumn, VoxelCorner, VoxelNode, VoxelObjects, VoxelOuterTop, VoxelPlane,
};
use insula_protocol::blockmap::COLUMNS;
use insula_protocol::{NODE_CELLS, TileId};
use std::sync::OnceLock;

const ALL: usize = SUB * SUB;
/// Fewest samples of a part for a clipped column.
const FEWEST: usize = 2;
const STOREY_M: f64 = 3.2;
/// Distance of windows in a row.
const WINDOW_M: f64 = 2.6;
const WINDOW: [u8; 3] = [58, 68, 78];

/// A column before its neighbours are known.
#[derive(Debug, Clone, Copy)]
struct Cell {
    part: Option<u32>,
    top_m: f32,
    slope: Vec2,
    /// The planes and the height beyond them.
    clip: Option<(VoxelPlane, Option<VoxelPlane>, f32)>,
    gap: Option<[f32; 2]>,
    roof: [u8; 3],
    /// Colour beyond the planes.
    outer: [u8; 3],
    ground: [u8; 3],
}

impl Cell {
    /// Height at a position relative to the centre.
    fn height_at(&self, p: Vec2) -> f32 {
        match self.clip {
            Some((first, second, outer_m)) if beyond(&first, p) || second.is_some_and(|s| beyond(&s, p)) => outer_m,
            _ => self.top_m + self.slope.dot(p),
        }
    }

    fn lowest_m(&self, cell_m: f32) -> f32 {
        let slope = self.slope.abs().element_sum() * 0.5 * cell_m;
        self.clip.map_or(self.top_m - slope, |(.., outer_m)| outer_m.min(self.top_m - slope))
    }
}

fn beyond(plane: &VoxelPlane, p: Vec2) -> bool {
    Vec2::from(plane.normal).dot(p) > plane.offset_m
}

/// The columns of a node; `None` if it has none.
pub fn node(id: TileId, raster: &Raster) -> Option<VoxelNode> {
    let n = NODE_CELLS as i32;
    let side = NODE_CELLS + 2;
    let cells: Vec<Option<Cell>> =
        (0..side * side).map(|i| cell(raster, (i % side) as i32 - 1, (i / side) as i32 - 1)).collect();
    let at = |x: i32, y: i32| cells[(y + 1) as usize * side + (x + 1) as usize].as_ref();
    let mut node = VoxelNode::empty(id);
    for i in 0..COLUMNS {
        let (x, y) = (i as i32 % n, i as i32 / n);
        if let Some(own) = at(x, y) {
            let around = std::array::from_fn(|k| at(x + k as i32 % 3 - 1, y + k as i32 / 3 - 1));
            node.columns[i] = Some(column(raster, own, raster.centre(x, y), &around));
        }
    }
    (!node.is_empty()).then_some(node)
}

fn cell(raster: &Raster, x: i32, y: i32) -> Option<Cell> {
    let samples = raster.cell(x, y);
    let highest = samples.iter().filter(|s| s.part != OUTSIDE).max_by(|a, b| a.top_m.total_cmp(&b.top_m))?;
    let wall = (highest.part != GROUND).then(|| walled(raster, &samples, highest.part, raster.centre(x, y))).flatten();
    Some(wall.unwrap_or_else(|| median(raster, &samples)))
}

/// The clipped column of the highest part; `None` if the part is too small.
fn walled(raster: &Raster, samples: &[Sample; ALL], index: u32, centre: DVec2) -> Option<Cell> {
    let (part, cell_m) = (&raster.parts[index as usize], raster.cell_m);
    let count = samples.iter().filter(|s| s.part == index).count();
    if count < FEWEST || part.half.min_element() < 0.75 * cell_m {
        return None;
    }
    let local = part.local(centre);
    let inside = local.clamp(-part.half, part.half);
    let top_m = part.top_at(local) as f32;
    let others = || samples.iter().filter(|s| s.part != index && s.part != OUTSIDE);
    let mut clip = None;
    let mut outer = [0; 3];
    if count < ALL {
        let near = |axis: usize| part.half[axis] - local[axis].abs() < 0.72 * cell_m;
        let plane = |axis: usize| {
            let normal = if axis == 0 { part.axis } else { part.axis.perp() } * local[axis].signum();
            let offset_m = (part.half[axis] - local[axis].abs()) as f32;
            VoxelPlane { normal: normal.as_vec2().into(), offset_m }
        };
        let mut planes = (0..2).filter(|axis| near(*axis)).map(plane);
        let first = planes.next()?;
        let lower = others().count().max(1) as f32;
        let outer_m = others().map(|s| s.top_m).sum::<f32>() / lower;
        outer = others().next().map_or([0; 3], |s| colour(raster, s));
        if top_m - outer_m > 0.1 * cell_m as f32 {
            clip = Some((first, planes.next(), outer_m));
        }
    }
    let under = samples.iter().filter(|s| s.part == index && !s.under_m.is_nan()).map(|s| s.under_m);
    let gap = under.reduce(f32::max).map(|under_m| [under_m, part.bottom_m as f32]);
    let gap = gap.filter(|[low, high]| high - low > 0.75 * cell_m as f32);
    let ridge = local.y.abs() < 0.5 * cell_m;
    let slope = if ridge { Vec2::ZERO } else { part.slope(inside) };
    Some(Cell { part: Some(index), top_m, slope, clip, gap, roof: part.top, outer, ground: samples[ALL / 2].ground })
}

/// A column with the height that half of the cell reaches.
fn median(raster: &Raster, samples: &[Sample; ALL]) -> Cell {
    let mut sorted: Vec<&Sample> = samples.iter().filter(|s| s.part != OUTSIDE).collect();
    sorted.sort_by(|a, b| b.top_m.total_cmp(&a.top_m));
    let middle = sorted[(sorted.len() - 1) / 2];
    let near = || sorted.iter().filter(|s| (s.top_m - middle.top_m).abs() <= raster.cell_m as f32);
    let count = near().count().max(1) as u32;
    let sums = near().fold([0u32; 3], |sums, s| {
        let rgb = colour(raster, s);
        std::array::from_fn(|k| sums[k] + u32::from(rgb[k]))
    });
    let part = (middle.part != GROUND).then_some(middle.part);
    let hangs = part.filter(|_| !middle.under_m.is_nan());
    let gap = hangs.map(|index| [middle.under_m, raster.parts[index as usize].bottom_m as f32]);
    let gap = gap.filter(|[low, high]| f64::from(high - low) > 0.75 * raster.cell_m);
    let roof = sums.map(|sum| (sum / count) as u8);
    Cell { part, top_m: middle.top_m, slope: Vec2::ZERO, clip: None, gap, roof, outer: roof, ground: middle.ground }
}

fn colour(raster: &Raster, sample: &Sample) -> [u8; 3] {
    raster.parts.get(sample.part as usize).map_or(sample.ground, |part| part.top)
}

fn column(raster: &Raster, own: &Cell, centre: DVec2, around: &[Option<&Cell>; 9]) -> VoxelColumn {
    let cell_m = raster.cell_m as f32;
    let lowest = around.iter().flatten().map(|c| c.lowest_m(cell_m)).fold(f32::INFINITY, f32::min);
    let under = own.gap.map_or(lowest, |[under_m, _]| under_m.min(lowest));
    let bottom_m = under.min(own.top_m) - 0.25 * cell_m;
    let solids = match own.gap {
        Some([low, high]) => vec![SolidRun { bottom_m, top_m: low }, SolidRun { bottom_m: high, top_m: own.top_m }],
        None => vec![SolidRun { bottom_m, top_m: own.top_m }],
    };
    let mut open = Vec2::ZERO;
    let mut deepest = 0.0f32;
    for (k, dir) in [(1, Vec2::NEG_Y), (3, Vec2::NEG_X), (5, Vec2::X), (7, Vec2::Y)] {
        let Some(other) = around[k] else { continue };
        let edge = dir * (0.5 * cell_m);
        let drop = own.height_at(edge) - other.height_at(-edge);
        open += dir * drop.max(0.0);
        deepest = deepest.max(drop);
    }
    let exposed = own.clip.is_some() || own.gap.is_some() || deepest > cell_m;
    let wall_normal = own.clip.map_or(open.to_array(), |(plane, ..)| plane.normal);
    let part = own.part.map(|index| &raster.parts[index as usize]);
    let first_row = (bottom_m / cell_m).floor() as i32;
    let rows = if exposed { (own.top_m / cell_m).ceil() as i32 - first_row } else { 0 };
    let wall = (first_row..first_row + rows).map(|row| {
        let z_m = (f64::from(row) + 0.5) * raster.cell_m;
        let push_part = |part| facade(part, centre, wall_normal, z_m, raster.cell_m);
        let rgb = if z_m < 0.0 { own.ground } else { part.map_or(own.roof, push_part) };
        appearance(rgb, wall_ao(z_m))
    });
    let inclined = own.slope != Vec2::ZERO;
    let normal = own.slope.extend(-1.0).normalize_or(glam::Vec3::NEG_Z) * -1.0;
    let roof_ao = if own.part.is_some() { 1.0 } else { 0.8 };
    let clip = own.clip.map(|(plane, second, outer_m)| {
        let corner = second.map(|plane| VoxelCorner { plane, concave: false });
        VoxelClip {
            plane,
            corner,
            outer: Some(VoxelOuterTop { top_m: outer_m, appearance: appearance(own.outer, 0.7) }),
        }
    });
    VoxelColumn {
        solids,
        inclined,
        suspended: false,
        normal: normal.into(),
        roof: appearance(own.roof, roof_ao),
        exposed,
        wall_normal,
        first_row,
        wall: wall.collect(),
        clip,
        objects: VoxelObjects::default(),
        thin: None,
        reflective: false,
    }
}

/// Colour of a wall at a height.
fn facade(part: &Part, centre: DVec2, normal: [f32; 2], z_m: f64, cell_m: f64) -> [u8; 3] {
    if !part.windows {
        return part.wall;
    }
    let mix = |share: f64| {
        let of = |k: usize| f64::from(part.wall[k]) * (1.0 - share) + f64::from(WINDOW[k]) * share;
        std::array::from_fn(|k| of(k) as u8)
    };
    if cell_m > 1.5 {
        return mix(0.3);
    }
    let tangent = Vec2::from(normal).normalize_or(Vec2::X).perp().as_dvec2();
    let across = (centre - part.centre).dot(tangent).rem_euclid(WINDOW_M) / WINDOW_M;
    let up = z_m.rem_euclid(STOREY_M) / STOREY_M;
    if (0.25..0.8).contains(&up) && across < 0.55 { WINDOW } else { part.wall }
}

/// Low walls see less of the sky.
fn wall_ao(z_m: f64) -> f32 {
    (0.45 + z_m * 0.02).clamp(0.45, 0.85) as f32
}

fn appearance(rgb: [u8; 3], ao: f32) -> VoxelAppearance {
    static LINEAR: OnceLock<[f32; 256]> = OnceLock::new();
    let linear = LINEAR.get_or_init(|| {
        std::array::from_fn(|v| {
            let v = v as f32 / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        })
    });
    VoxelAppearance { rgb: rgb.map(|c| linear[usize::from(c)]), ao, is_known: true }
}
