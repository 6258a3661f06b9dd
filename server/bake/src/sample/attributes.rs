//! Colour, normal and occlusion of the voxels, from the visible surfels.
//!
//! Every visible surfel is assigned to one voxel: the roof of a column, the top beyond its clip, or a row of its wall.
//! A voxel's appearance is the mean of its surfels, weighted by area. A column is reflective if at least half of the
//! visible area of its top and sides is water or glass. Tops under another run do not count: a bridge over water is matt.

use super::cell_grid::CellGrid;
use super::ground::LocalGround;
use super::local_block::{LocalBlock, MIN_TOP_NORMAL_Z};
use super::settings::BlockInput;
use super::surfels::{SKY_SUBSETS, Surfel};
use super::texture::{self, SurfacePatch};
use crate::columns::merge::MergedColumn;
use crate::columns::object_votes::ObjectVotes;
use crate::columns::voxels::{SolidRun, VoxelAppearance, VoxelClip, VoxelColumn, VoxelNode, VoxelObjects};
use glam::{Vec2, Vec3, Vec3Swizzles};
use insula_protocol::{NODE_CELLS, TileId};
use rayon::prelude::*;

/// Largest vertical distance, in cells, of a surfel from the top (or underside) that it colours.
const TOP_REACH: f32 = 1.0;
/// Distances behind a surfel, in cells, at which a full voxel is looked for. The last one is a little in front of it: a
/// wall on a cell's border that is visible from inside has its column behind it.
const INWARD_STEPS: [f32; 5] = [0.02, 0.47, 0.92, 1.37, -0.02];
/// Most rows of a wall.
const MAX_ROWS: i32 = 4096;
/// Most rows of all walls of a block. The format has space for 4 million; further columns get one row.
const MAX_BLOCK_ROWS: usize = 6 << 20;

/// Area-weighted sum of surfels.
#[derive(Debug, Clone, Copy, Default)]
struct AppearanceSum {
    rgb: Vec3,
    ao: f32,
    weight: f32,
}

impl AppearanceSum {
    fn add(&mut self, surfel: &VisibleSurfel) {
        self.rgb += surfel.rgb * surfel.area_m2;
        self.ao += surfel.ao * surfel.area_m2;
        self.weight += surfel.area_m2;
    }

    /// Unknown if nothing was added.
    fn mean(&self) -> VoxelAppearance {
        if self.weight <= 0.0 {
            return VoxelAppearance::default();
        }
        VoxelAppearance {
            rgb: (self.rgb / self.weight).to_array(),
            ao: (self.ao / self.weight).min(1.0),
            is_known: true,
        }
    }
}

/// A visible surfel with its colour.
#[derive(Debug, Clone, Copy)]
struct VisibleSurfel {
    position: Vec3,
    /// Unit normal of the visible side.
    normal: Vec3,
    /// Linear RGB.
    rgb: Vec3,
    ao: f32,
    area_m2: f32,
    is_reflective: bool,
    /// Number in the city.
    object: u32,
}

/// Samples of one row of a wall.
#[derive(Debug, Clone, Copy, Default)]
struct RowSums {
    side: AppearanceSum,
    /// Tops of lower runs, and undersides.
    flat: AppearanceSum,
}

/// The surfels of one column.
#[derive(Debug, Default)]
struct ColumnAccumulator {
    roof: AppearanceSum,
    roof_normal: Vec3,
    /// The top beyond the clip.
    outer: AppearanceSum,
    wall_normal: Vec2,
    /// Row of `rows[0]`, in cells above height zero.
    first_row: i32,
    /// Length of `rows`; 0 if the column is not exposed.
    row_count: usize,
    rows: Vec<RowSums>,
    /// Area of the roof and the sides that is matt.
    matt_m2: f32,
    /// The rest of that area.
    reflective_m2: f32,
    roof_objects: ObjectVotes,
    wall_objects: ObjectVotes,
    /// Of the top beyond the clip.
    outer_objects: ObjectVotes,
    /// Of tops of lower runs.
    gap_objects: ObjectVotes,
}

/// The part of a column that a surfel belongs to.
enum SurfelTarget {
    Roof,
    /// The top beyond the clip.
    Outer,
    /// A row of the wall.
    Side(i32),
    /// The top of a lower run, in a row of the wall.
    LowerTop(i32),
    /// An underside in a row of the wall.
    Underside(i32),
}

/// Adds appearance to the block's columns and cuts them into leaves.
pub(super) fn build_nodes(
    block: &LocalBlock,
    input: &BlockInput<'_>,
    cells: &CellGrid,
    surfels: &[Surfel],
    ground: Option<&LocalGround>,
) -> Vec<VoxelNode> {
    let [width, height] = block.cells;
    let mut accumulators: Vec<ColumnAccumulator> = (0..width * height)
        .into_par_iter()
        .map(|i| ColumnAccumulator::new(cells, (i % width) as i32, (i / width) as i32))
        .collect();
    limit_rows(&mut accumulators, MAX_BLOCK_ROWS);
    accumulators.par_iter_mut().for_each(ColumnAccumulator::allocate);
    let visible: Vec<Option<VisibleSurfel>> =
        surfels.par_iter().map(|surfel| visible_surfel(block, input, surfel)).collect();
    // In the order of the surfels, so that the sums do not depend on the number of threads.
    for surfel in visible.iter().flatten() {
        if let Some((column, target)) = find_target(block, cells, surfel) {
            accumulators[column].add(target, surfel);
        }
    }
    let node = |leaf: &TileId| VoxelNode {
        ground: ground.and_then(|ground| ground.of_leaf(block, *leaf)),
        ..leaf_node(block, *leaf, cells, &accumulators)
    };
    input.leaves.par_iter().map(node).collect()
}

/// Leaves one row to each column past the first `limit` rows.
fn limit_rows(accumulators: &mut [ColumnAccumulator], limit: usize) {
    let mut sum = 0;
    for accumulator in accumulators {
        sum += accumulator.row_count;
        if sum > limit {
            accumulator.row_count = accumulator.row_count.min(1);
        }
    }
}

/// `None` if the surfel is not visible.
fn visible_surfel(block: &LocalBlock, input: &BlockInput<'_>, surfel: &Surfel) -> Option<VisibleSurfel> {
    let side = surfel.visible_side();
    if surfel.sightings[side] == 0 {
        return None;
    }
    let triangle = &block.triangles[surfel.triangle as usize];
    let patch = SurfacePatch {
        triangle: triangle.source,
        corners: &triangle.corners,
        centre: surfel.position,
        side_m: block.cell_m * 0.5,
    };
    let rgb = texture::mean_colour(input.scene, patch);
    let is_reflective = input.scene.is_reflective(triangle.source);
    // An unoccluded surface has the mean cosine 1/4 over all directions of the sphere, which is 1/2 over those of the
    // upper half. The surfel was tested against one of the subsets.
    let ao = surfel.sky_cosines[side] * (2 * SKY_SUBSETS) as f32 / block.sky_directions as f32;
    let normal = if side == 0 { triangle.normal } else { -triangle.normal };
    let object = input.scene.object_number(triangle.source);
    Some(VisibleSurfel { position: surfel.position, normal, rgb, ao, area_m2: surfel.area_m2, is_reflective, object })
}

/// The column and the part of it that a surfel belongs to: in its own cell if that is full there, else in the nearest
/// full cell behind it. `None` if there is none, or if the column lies outside of the block.
fn find_target(block: &LocalBlock, cells: &CellGrid, surfel: &VisibleSurfel) -> Option<(usize, SurfelTarget)> {
    let c = block.cell_m;
    for depth in INWARD_STEPS {
        let p = surfel.position - surfel.normal * (depth * c);
        let (x, y) = ((p.x / c).floor() as i32, (p.y / c).floor() as i32);
        let is_in_block = x >= 0 && y >= 0 && (x as usize) < block.cells[0] && (y as usize) < block.cells[1];
        let Some(cell) = cells.at(x, y) else { continue };
        let from_centre = p.xy() - (Vec2::new(x as f32, y as f32) + 0.5) * c;
        if let Some(target) = match_column(&cell.column, from_centre, surfel, c) {
            return is_in_block.then(|| (y as usize * block.cells[0] + x as usize, target));
        }
        // Stepping along a vertical normal would stay in the same cell.
        if surfel.normal.z.abs() > 0.9 {
            return None;
        }
    }
    None
}

/// The part of a column that the surfel lies on; `None` if it lies on none.
fn match_column(column: &MergedColumn, from_centre: Vec2, surfel: &VisibleSurfel, c: f32) -> Option<SurfelTarget> {
    let row_at = |z: f32| (z / c).floor() as i32;
    let (z, normal_z) = (surfel.position.z, surfel.normal.z);
    let (solids, top_m) = (&column.solids, column.top_at(from_centre));
    let is_beyond_clip = column.clip.is_some_and(|clip| clip.is_outside(from_centre));
    if is_beyond_clip && normal_z > MIN_TOP_NORMAL_Z {
        return ((z - top_m).abs() < TOP_REACH * c).then_some(SurfelTarget::Outer);
    }
    let last = solids.len().checked_sub(1)?;
    for (i, run) in solids.iter().enumerate().rev() {
        let run_top_m = if i == last { top_m } else { run.top_m };
        if normal_z > MIN_TOP_NORMAL_Z {
            if (z - run_top_m).abs() < TOP_REACH * c {
                let is_roof = i == last;
                return Some(if is_roof {
                    SurfelTarget::Roof
                } else {
                    SurfelTarget::LowerTop(row_at(run_top_m - 1e-3 * c))
                });
            }
        } else if normal_z < -MIN_TOP_NORMAL_Z {
            if (z - run.bottom_m).abs() < TOP_REACH * c {
                return Some(SurfelTarget::Underside(row_at(run.bottom_m + 1e-3 * c)));
            }
        } else if z > run.bottom_m - 0.5 * c && z < run_top_m + 0.5 * c {
            return Some(SurfelTarget::Side(row_at(z.min(run_top_m - 1e-3 * c).max(run.bottom_m))));
        }
    }
    None
}

impl ColumnAccumulator {
    fn new(cells: &CellGrid, x: i32, y: i32) -> Self {
        let mut accumulator = Self::default();
        let Some(cell) = cells.at(x, y) else { return accumulator };
        if let (Some(first), true) = (cell.column.solids.first(), cells.is_exposed(x, y)) {
            let top_m = cell.column.solids.last().map_or(first.top_m, |run| run.top_m);
            accumulator.first_row = (first.bottom_m / cells.cell_m()).floor() as i32;
            let end = (top_m / cells.cell_m()).ceil() as i32;
            accumulator.row_count = (end.saturating_sub(accumulator.first_row)).clamp(1, MAX_ROWS) as usize;
        }
        accumulator
    }

    /// Makes space for the sums of the rows.
    fn allocate(&mut self) {
        self.rows = vec![RowSums::default(); self.row_count];
    }

    fn add(&mut self, target: SurfelTarget, surfel: &VisibleSurfel) {
        if matches!(target, SurfelTarget::Roof | SurfelTarget::Side(_)) {
            let sum = if surfel.is_reflective { &mut self.reflective_m2 } else { &mut self.matt_m2 };
            *sum += surfel.area_m2;
        }
        match target {
            SurfelTarget::Roof => {
                self.roof.add(surfel);
                self.roof_objects.add(surfel.object, surfel.area_m2);
                self.roof_normal += surfel.normal * surfel.area_m2;
            }
            SurfelTarget::Outer => {
                self.outer.add(surfel);
                self.outer_objects.add(surfel.object, surfel.area_m2);
            }
            SurfelTarget::Side(row) => {
                self.wall_objects.add(surfel.object, surfel.area_m2);
                self.wall_normal += surfel.normal.xy() * surfel.area_m2;
                if let Some(sums) = self.row(row) {
                    sums.side.add(surfel);
                }
            }
            SurfelTarget::LowerTop(row) => {
                self.gap_objects.add(surfel.object, surfel.area_m2);
                if let Some(sums) = self.row(row) {
                    sums.flat.add(surfel);
                }
            }
            SurfelTarget::Underside(row) => {
                if let Some(sums) = self.row(row) {
                    sums.flat.add(surfel);
                }
            }
        }
    }

    /// The sums of a row, or of the nearest row that the wall has; `None` if it has none.
    fn row(&mut self, row: i32) -> Option<&mut RowSums> {
        let last = self.rows.len() as i32 - 1;
        if last < 0 { None } else { self.rows.get_mut((row - self.first_row).clamp(0, last) as usize) }
    }

    /// The column of a cell with the appearance of its surfels; `None` if the cell is empty.
    fn finish(&self, cells: &CellGrid, x: i32, y: i32) -> Option<VoxelColumn> {
        let cell = cells.at(x, y)?;
        let (first, last) = (cell.column.solids.first()?, cell.column.solids.last()?);
        let exposed = !self.rows.is_empty();
        // Without a strip the column cannot show a gap.
        let solids = if exposed {
            cell.column.solids.clone()
        } else {
            vec![SolidRun { bottom_m: first.bottom_m, top_m: last.top_m }]
        };
        let [sx, sy] = cell.column.slope;
        let normal = if cell.column.thin.is_some() {
            Vec3::Z
        } else if cell.column.is_inclined {
            Vec3::new(-sx, -sy, 1.0).normalize_or(Vec3::Z)
        } else {
            self.roof_normal.normalize_or(Vec3::Z)
        };
        let mut clip = cell.column.clip.map(VoxelClip::from);
        if let Some(outer) = clip.as_mut().and_then(|clip| clip.outer.as_mut()) {
            outer.appearance = self.outer.mean();
        }
        let has_outer = clip.is_some_and(|clip| clip.outer.is_some());
        Some(VoxelColumn {
            clip,
            inclined: cell.column.is_inclined,
            suspended: !cell.is_grounded,
            normal: normal.to_array(),
            roof: self.roof.mean(),
            exposed,
            wall_normal: clip.map_or(self.wall_normal.to_array(), |clip| clip.plane.normal),
            first_row: self.first_row,
            wall: self.wall(&solids, cells.cell_m()),
            solids,
            thin: cell.column.thin,
            reflective: self.reflective_m2 > 0.0 && self.reflective_m2 >= self.matt_m2,
            objects: VoxelObjects {
                roof: self.roof_objects.winner(),
                wall: self.wall_objects.winner(),
                lower: if has_outer { self.outer_objects.winner() } else { self.gap_objects.winner() },
            },
        })
    }

    /// The appearance of each row: its side's, or at the top of a lower run that of the top.
    fn wall(&self, solids: &[SolidRun], cell_m: f32) -> Vec<VoxelAppearance> {
        let top_rows: Vec<i32> =
            solids[..solids.len() - 1].iter().map(|run| ((run.top_m - 1e-3) / cell_m).floor() as i32).collect();
        let row_appearance = |(row, sums): (i32, &RowSums)| {
            let (first, second) =
                if top_rows.contains(&row) { (&sums.flat, &sums.side) } else { (&sums.side, &sums.flat) };
            if first.weight > 0.0 { first.mean() } else { second.mean() }
        };
        (self.first_row..).zip(&self.rows).map(row_appearance).collect()
    }
}

fn leaf_node(block: &LocalBlock, leaf: TileId, cells: &CellGrid, accumulators: &[ColumnAccumulator]) -> VoxelNode {
    let mut node = VoxelNode::empty(leaf);
    let x0 = (leaf.x() - block.first_leaf[0]) as usize * NODE_CELLS;
    let y0 = (leaf.y() - block.first_leaf[1]) as usize * NODE_CELLS;
    for (i, column) in node.columns.iter_mut().enumerate() {
        let (x, y) = (x0 + i % NODE_CELLS, y0 + i / NODE_CELLS);
        *column = accumulators[y * block.cells[0] + x].finish(cells, x as i32, y as i32);
    }
    node
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_past_the_row_limit_get_one_row() {
        let counts = |counts: [usize; 4], limit: usize| {
            let mut all = counts.map(|row_count| ColumnAccumulator { row_count, ..ColumnAccumulator::default() });
            limit_rows(&mut all, limit);
            all.map(|accumulator| accumulator.row_count)
        };
        assert_eq!(counts([5, 0, 7, 3], 15), [5, 0, 7, 3]);
        assert_eq!(counts([5, 0, 7, 3], 14), [5, 0, 7, 1]);
        assert_eq!(counts([50, 0, 7, 3], 14), [1, 0, 1, 1]);
    }
}
