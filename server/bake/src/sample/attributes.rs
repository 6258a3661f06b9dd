//! Colours, normals and occlusion for the columns (design 5, step 3).
//!
//! In: [`CellGrid`] and the candidates that were seen. Out: a [`VoxelNode`] a leaf. Next: `mend`.

use super::{settings::BlockInput, solids::CellGrid, texture};
use crate::columns::{
    merge::MergedColumn,
    voxels::{SolidRun, VoxelAppearance, VoxelClip, VoxelColumn, VoxelNode},
};
use crate::sample::{
    local_block::{LocalBlock, TOP_Z},
    surface_samples::{SurfaceSample, TURNS},
};
use glam::{Vec2, Vec3, Vec3Swizzles};
use insula_protocol::{NODE_CELLS, TileId};
use rayon::prelude::*;

/// How far, in cells, a sample may lie from the top that it colours.
const TOP_REACH: f32 = 1.0;

/// Sums over the samples of one voxel.
#[derive(Debug, Clone, Copy, Default)]
struct AppearanceSum {
    rgb: Vec3,
    ao: f32,
    weight: f32,
}

impl AppearanceSum {
    fn add(&mut self, seen: &VisibleSample) {
        self.rgb += seen.rgb * seen.area_m2;
        self.ao += seen.ao * seen.area_m2;
        self.weight += seen.area_m2;
    }

    fn look(&self) -> VoxelAppearance {
        if self.weight <= 0.0 {
            return VoxelAppearance::default();
        }
        VoxelAppearance { rgb: (self.rgb / self.weight).to_array(), ao: (self.ao / self.weight).min(1.0), alpha: 1.0 }
    }
}

/// A candidate that was seen, with its colour.
#[derive(Debug, Clone, Copy)]
struct VisibleSample {
    p: Vec3,
    /// Towards where it was seen from.
    normal: Vec3,
    rgb: Vec3,
    ao: f32,
    area_m2: f32,
}

/// A column being filled.
#[derive(Debug, Default)]
struct ColumnAccumulator {
    roof: AppearanceSum,
    roof_normal: Vec3,
    /// The top beyond a wall inside the cell.
    outer: AppearanceSum,
    wall_normal: Vec2,
    first_row: i32,
    /// Sides; then tops and undersides of the same rows.
    rows: Vec<[AppearanceSum; 2]>,
}

/// Where a sample goes.
enum SampleTarget {
    Roof,
    Outer,
    Side(i32),
    Flat(i32),
}

/// Colours the block's columns and cuts them into leaves.
pub(super) fn build(
    block: &LocalBlock,
    input: &BlockInput<'_>,
    cells: &CellGrid,
    candidates: &[SurfaceSample],
) -> Vec<VoxelNode> {
    let [width, height] = block.cells;
    let mut drafts: Vec<ColumnAccumulator> = (0..width * height)
        .into_par_iter()
        .map(|i| draft(cells, (i % width) as i32, (i / width) as i32, block.cell_m))
        .collect();
    let seen: Vec<Option<VisibleSample>> = candidates.par_iter().map(|c| seen(block, input, c)).collect();
    for seen in seen.iter().flatten() {
        if let Some((x, y, place)) = place(block, cells, seen) {
            add(&mut drafts[y * width + x], place, seen);
        }
    }
    input.leaves.par_iter().map(|leaf| node(block, *leaf, cells, &drafts)).collect()
}

fn draft(cells: &CellGrid, x: i32, y: i32, cell_m: f32) -> ColumnAccumulator {
    let mut draft = ColumnAccumulator::default();
    let Some(cell) = cells.at(x, y) else { return draft };
    if let (Some(first), true) = (cell.column.solids.first(), cells.exposed(x, y)) {
        let highest = cell.column.solids.last().map_or(first.top_m, |s| s.top_m);
        draft.first_row = (first.bottom_m / cell_m).floor() as i32;
        let end = (highest / cell_m).ceil() as i32;
        draft.rows = vec![[AppearanceSum::default(); 2]; (end - draft.first_row).clamp(1, 4096) as usize];
    }
    draft
}

fn seen(block: &LocalBlock, input: &BlockInput<'_>, candidate: &SurfaceSample) -> Option<VisibleSample> {
    let side = usize::from(candidate.sightings[1] > candidate.sightings[0]);
    if candidate.sightings[side] == 0 {
        return None;
    }
    let triangle = &block.triangles[candidate.triangle as usize];
    let rgb = texture::colour(input.scene, triangle.source, &triangle.corners, candidate.p, block.cell_m * 0.5);
    // Over all directions of the sphere the mean of a positive cosine is a quarter: half of that of the upper ones alone.
    let ao = candidate.sky[side] * (2 * TURNS) as f32 / block.sky_directions as f32;
    let normal = if side == 0 { triangle.normal } else { -triangle.normal };
    Some(VisibleSample { p: candidate.p, normal, rgb, ao, area_m2: candidate.area_m2 })
}

/// The voxel that a sample belongs to: its own cell if that is full there, else the next one inwards.
fn place(block: &LocalBlock, cells: &CellGrid, seen: &VisibleSample) -> Option<(usize, usize, SampleTarget)> {
    let c = block.cell_m;
    // At last a little outwards: a wall that is seen from inside, on a cell's border, has its column behind it.
    for inwards in [0.02, 0.47, 0.92, 1.37, -0.02] {
        let p = seen.p - seen.normal * (inwards * c);
        let (x, y) = ((p.x / c).floor() as i32, (p.y / c).floor() as i32);
        let inside = x >= 0 && y >= 0 && (x as usize) < block.cells[0] && (y as usize) < block.cells[1];
        let Some(cell) = cells.at(x, y) else { continue };
        let from_centre = p.xy() - (Vec2::new(x as f32, y as f32) + 0.5) * c;
        if let Some(place) = match_solid(&cell.column, from_centre, seen, c) {
            return inside.then_some((x as usize, y as usize, place));
        }
        if seen.normal.z.abs() > 0.9 {
            return None;
        }
    }
    None
}

fn match_solid(column: &MergedColumn, from_centre: Vec2, seen: &VisibleSample, c: f32) -> Option<SampleTarget> {
    let row = |z: f32| (z / c).floor() as i32;
    let (solids, top) = (&column.solids, column.top_at(from_centre));
    let beyond = column.clip.is_some_and(|clip| clip.is_outside(from_centre));
    if beyond && seen.normal.z > TOP_Z {
        return ((seen.p.z - top).abs() < TOP_REACH * c).then_some(SampleTarget::Outer);
    }
    let last = solids.len().checked_sub(1)?;
    for (i, solid) in solids.iter().enumerate().rev() {
        let high = if i == last { top } else { solid.top_m };
        if seen.normal.z > TOP_Z {
            if (seen.p.z - high).abs() < TOP_REACH * c {
                return Some(if i == last { SampleTarget::Roof } else { SampleTarget::Flat(row(high - 1e-3 * c)) });
            }
        } else if seen.normal.z < -TOP_Z {
            if (seen.p.z - solid.bottom_m).abs() < TOP_REACH * c {
                return Some(SampleTarget::Flat(row(solid.bottom_m + 1e-3 * c)));
            }
        } else if seen.p.z > solid.bottom_m - 0.5 * c && seen.p.z < high + 0.5 * c {
            return Some(SampleTarget::Side(row(seen.p.z.min(high - 1e-3 * c).max(solid.bottom_m))));
        }
    }
    None
}

fn add(draft: &mut ColumnAccumulator, place: SampleTarget, seen: &VisibleSample) {
    let (row, kind) = match place {
        SampleTarget::Roof => {
            draft.roof.add(seen);
            draft.roof_normal += seen.normal * seen.area_m2;
            return;
        }
        SampleTarget::Outer => return draft.outer.add(seen),
        SampleTarget::Side(row) => {
            draft.wall_normal += seen.normal.xy() * seen.area_m2;
            (row, 0)
        }
        SampleTarget::Flat(row) => (row, 1),
    };
    let last = draft.rows.len() as i32 - 1;
    if last >= 0 {
        draft.rows[(row - draft.first_row).clamp(0, last) as usize][kind].add(seen);
    }
}

fn node(block: &LocalBlock, leaf: TileId, cells: &CellGrid, drafts: &[ColumnAccumulator]) -> VoxelNode {
    let mut node = VoxelNode::empty(leaf);
    let x0 = (leaf.x() - block.first_leaf[0]) as usize * NODE_CELLS;
    let y0 = (leaf.y() - block.first_leaf[1]) as usize * NODE_CELLS;
    for (i, column) in node.columns.iter_mut().enumerate() {
        let (x, y) = (x0 + i % NODE_CELLS, y0 + i / NODE_CELLS);
        *column = finish(cells, x as i32, y as i32, &drafts[y * block.cells[0] + x]);
    }
    node
}

fn finish(cells: &CellGrid, x: i32, y: i32, draft: &ColumnAccumulator) -> Option<VoxelColumn> {
    let cell = cells.at(x, y)?;
    let (first, last) = (cell.column.solids.first()?, cell.column.solids.last()?);
    let exposed = !draft.rows.is_empty();
    // A gap that no side shows is none.
    let solids = if exposed {
        cell.column.solids.clone()
    } else {
        vec![SolidRun { bottom_m: first.bottom_m, top_m: last.top_m }]
    };
    let [sx, sy] = cell.column.slope;
    let mean = draft.roof_normal.normalize_or(Vec3::Z);
    let normal = if cell.column.inclined { Vec3::new(-sx, -sy, 1.0).normalize_or(Vec3::Z) } else { mean };
    // The top of a lower solid shows its own colour, not its side's; elsewhere the side is what is seen.
    let flat_rows: Vec<i32> =
        solids[..solids.len() - 1].iter().map(|s| ((s.top_m - 1e-3) / cells.cell_m()).floor() as i32).collect();
    let wall = draft.rows.iter().enumerate().map(|(i, [side, flat])| {
        let row = draft.first_row + i as i32;
        let (first, second) = if flat_rows.contains(&row) { (flat, side) } else { (side, flat) };
        if first.weight > 0.0 { first.look() } else { second.look() }
    });
    let mut clip = cell.column.clip.map(VoxelClip::from);
    if let Some((_, look)) = clip.as_mut().and_then(|clip| clip.outer.as_mut()) {
        *look = draft.outer.look();
    }
    Some(VoxelColumn {
        clip,
        inclined: cell.column.inclined,
        suspended: !cell.grounded,
        normal: normal.to_array(),
        roof: draft.roof.look(),
        exposed,
        wall_normal: clip.map_or(draft.wall_normal.to_array(), |clip| clip.plane.normal),
        first_row: draft.first_row,
        wall: wall.collect(),
        solids,
    })
}
