//! A parent's columns from its children's: four columns become one.
//!
//! In: up to four children's maps. Out: the parent's [`VoxelNode`]. Next: `parametrise`.
//!
//! Vacca 2008 (3.6.1) samples every level from the source's triangles. Here a parent needs only its children: 4 x 4
//! vertical lines run through each of its cells, that is, through the children's columns, and are merged as in a leaf.
//! The children's walls propose the clip planes. Their gaps, exact or as open rows of walls, stay open as long as
//! they are higher than half a cell.

use crate::columns::clip::{CellClip, CornerPlane, WallPlane};
use crate::columns::fill::{fill_unknown, mean_of_known};
use crate::columns::merge::{LINES_PER_SIDE, MergedColumn, PARENT_GAPS, VerticalLine, line_position_m};
use crate::columns::object_votes::ObjectVotes;
use crate::columns::srgb::linear_from_srgb;
use crate::columns::voxels::{
    SolidRun, ThinShares, VoxelAppearance, VoxelClip, VoxelColumn, VoxelGround, VoxelNode, VoxelObjects,
};
use crate::columns::wall_fit::{CellObservations, WallPiece};
use crate::scene::grid::CityGrid;
use glam::{Vec2, Vec3};
use insula_protocol::blockmap::ground::{SKY_MAX, SQUARES, VERTEX_COUNT, VERTICES, is_used_vertex};
use insula_protocol::blockmap::{
    CLIP_STEPS_PER_CELL, COLUMNS, MapColumn, NO_OBJECT, STEPS_PER_CELL, ThinShare, strip_rows,
};
use insula_protocol::texel::AO_MAX;
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId, octahedral};

/// How far, in cells, a grounded column reaches below the lowest top around it.
const SKIRT: f32 = 0.25;

/// A child's column in metres.
pub(super) struct ChildColumn {
    pub(super) merged: MergedColumn,
    pub(super) is_grounded: bool,
    roof_normal: Vec3,
    roof: VoxelAppearance,
    /// The top beyond the column's clip.
    outer: Option<VoxelAppearance>,
    wall: Option<ChildWall>,
    is_reflective: bool,
    objects: VoxelObjects,
}

/// The wall strip of a child's column.
struct ChildWall {
    /// Horizontal unit vector out of the wall.
    normal: Vec2,
    /// Row of `rows[0]`, in the child's cells above height zero.
    first_row: i32,
    rows: Vec<VoxelAppearance>,
}

/// The columns of up to four children in quadrant order; no columns for a missing child.
pub(super) type ChildColumns = [Vec<Option<ChildColumn>>; 4];

/// The columns of a parent while they are made.
pub(super) struct ParentColumns {
    pub(super) children: ChildColumns,
    pub(super) merged: Vec<MergedColumn>,
    pub(super) is_grounded: Vec<bool>,
    /// Side of a parent's cell.
    pub(super) cell_m: f32,
}

/// The parent `id` of `children`, which are given in quadrant order. `plane_m` is the height at which generated ground ends,
/// above the grid's height zero; without it, ground continues as at its nearest vertices.
pub fn parent_node(grid: &CityGrid, id: TileId, children: [Option<&BlockMap>; 4], plane_m: Option<f32>) -> VoxelNode {
    let cell_m = grid.cell_m_at(id.level()) as f32;
    let columns = ParentColumns::new(children.map(|map| map.map_or_else(Vec::new, child_columns)), cell_m);
    let mut node = VoxelNode::empty(id);
    for i in 0..COLUMNS {
        node.columns[i] = columns.column(i);
    }
    fill_unknown(&mut node);
    node.ground = parent_ground(children, plane_m);
    node
}

/// The ground of a parent: every second vertex of its children, and ground where one of four squares has some.
fn parent_ground(children: [Option<&BlockMap>; 4], plane_m: Option<f32>) -> Option<VoxelGround> {
    let mut squares = 0;
    // Sums of heights and of the sky, and their number.
    let mut sums = [[0.0; 3]; VERTEX_COUNT];
    for (q, map) in children.into_iter().enumerate() {
        let Some((map, ground)) = map.and_then(|map| Some((map, map.ground.as_ref()?))) else { continue };
        let first = [q & 1, q >> 1].map(|n| n * SQUARES / 2);
        for i in (0..SQUARES * SQUARES).filter(|i| ground.squares >> i & 1 == 1) {
            squares |= 1 << ((first[1] + i / SQUARES / 2) * SQUARES + first[0] + i % SQUARES / 2);
        }
        let surface = ground.surface();
        let base_m = map.z_base_m() as f32;
        let is_even = |i: &usize| (i % VERTICES).is_multiple_of(2) && (i / VERTICES).is_multiple_of(2);
        for i in (0..VERTEX_COUNT).filter(is_even) {
            if is_used_vertex(ground.squares, i % VERTICES, i / VERTICES) {
                let sum = &mut sums[(first[1] + i / VERTICES / 2) * VERTICES + first[0] + i % VERTICES / 2];
                let sky = f32::from(ground.sky[i]) / f32::from(SKY_MAX);
                *sum = [sum[0] + base_m + surface.heights[i] * map.cell_m, sum[1] + sky, sum[2] + 1.0];
            }
        }
    }
    let outside_m = plane_m.unwrap_or(f32::NAN);
    let heights_m = sums.map(|[z_m, _, n]| if n > 0.0 { z_m / n } else { outside_m });
    VoxelGround::new(heights_m, sums.map(|[_, sky, n]| sky / n), squares, None)
}

/// The four child columns under the parent's column `i`, in quadrant order.
pub(super) fn four_children(children: &ChildColumns, i: usize) -> [Option<&ChildColumn>; 4] {
    let (x, y) = (i % NODE_CELLS * 2, i / NODE_CELLS * 2);
    std::array::from_fn(|q| {
        let (x, y) = (x + (q & 1), y + (q >> 1));
        let child = (x / NODE_CELLS) | ((y / NODE_CELLS) << 1);
        children[child].get(y % NODE_CELLS * NODE_CELLS + x % NODE_CELLS)?.as_ref()
    })
}

fn child_columns(map: &BlockMap) -> Vec<Option<ChildColumn>> {
    let step_m = map.z_step_m();
    let base_m = map.z_base_m() as f32;
    let metres = |code: u16| base_m + f32::from(code) * step_m;
    let objects = |i: usize| match &map.objects {
        Some(objects) => VoxelObjects { roof: objects.roof[i], wall: objects.wall[i], lower: objects.lower[i] },
        None => VoxelObjects::default(),
    };
    let column = |(i, column): (usize, &Option<MapColumn>)| {
        let column = child_column(column.as_ref()?, map, metres);
        Some(ChildColumn { objects: objects(i), ..column })
    };
    map.columns().iter().enumerate().map(column).collect()
}

fn child_column(column: &MapColumn, map: &BlockMap, metres: impl Fn(u16) -> f32) -> ChildColumn {
    let solids = solid_codes(column, map.z_shift).into_iter();
    let solids = solids.map(|[bottom, top]| SolidRun { bottom_m: metres(bottom), top_m: metres(top) }).collect();
    let normal = Vec3::from_array(octahedral::decode(column.roof_normal));
    let slope = if column.inclined { [-normal.x / normal.z.max(0.1), -normal.y / normal.z.max(0.1)] } else { [0.0; 2] };
    let wall = column.strip.as_ref().map(|strip| ChildWall {
        normal: azimuth_vector(strip.azimuth),
        first_row: map.z_base_cells + i32::from(strip_rows(column.z_min, column.z_max, map.z_shift).0),
        rows: strip.texels.iter().map(|texel| appearance(*texel)).collect(),
    });
    let plane = |normal: Vec2, offset: i8| WallPlane {
        normal,
        offset_m: f32::from(offset) / CLIP_STEPS_PER_CELL as f32 * map.cell_m,
    };
    let clip = column.clip.zip(wall.as_ref()).map(|(clip, wall)| CellClip {
        plane: plane(wall.normal, clip.offset),
        corner: clip.corner.map(|corner| CornerPlane {
            plane: plane(azimuth_vector(corner.azimuth), corner.offset),
            is_concave: corner.concave,
        }),
        outer_top_m: clip.outer.map(|outer| metres(outer.z)),
    });
    ChildColumn {
        merged: MergedColumn { solids, slope, is_inclined: column.inclined, clip, thin: column.thin.map(thin_shares) },
        is_grounded: !column.suspended,
        roof_normal: normal,
        roof: appearance(column.roof),
        outer: column.clip.and_then(|clip| clip.outer).map(|outer| appearance(outer.roof)),
        wall,
        is_reflective: column.reflective,
        objects: VoxelObjects::default(),
    }
}

fn thin_shares(share: ThinShare) -> ThinShares {
    let [side, top] = share.shares();
    ThinShares { side, top }
}

/// The full height codes of a column, from the bottom up: all but its gap and the open rows of its wall.
///
/// A row is opaque if anything touches it, so a run that ends at a open row ends half a row before it on average.
fn solid_codes(column: &MapColumn, z_shift: u8) -> Vec<[u16; 2]> {
    let codes = STEPS_PER_CELL >> z_shift;
    let (first, _) = strip_rows(column.z_min, column.z_max, z_shift);
    let rows = column.strip.iter().flat_map(|strip| strip.texels.iter().enumerate());
    let open: Vec<u16> = rows.filter(|(_, texel)| texel.is_open()).map(|(k, _)| (first + k as u16) * codes).collect();
    let exact = column.gap.map_or_else(
        || vec![[column.z_min, column.z_max]],
        |[low, high]| vec![[column.z_min, low], [high, column.z_max]],
    );
    let mut solids = Vec::new();
    for span in exact {
        let runs = open.iter().fold(vec![span], |runs, low| {
            let split =
                runs.into_iter().flat_map(|[bottom, top]| [[bottom, top.min(*low)], [bottom.max(low + codes), top]]);
            split.filter(|[bottom, top]| bottom < top).collect()
        });
        solids.extend(runs.into_iter().map(|run| shrunk(run, span, codes)));
    }
    // A column without anything opaque still has ends.
    if solids.is_empty() { vec![[column.z_min, column.z_max]] } else { solids }
}

/// A run without half a row at the ends that it does not share with `span`, but at least a quarter of a row.
fn shrunk([bottom, top]: [u16; 2], span: [u16; 2], codes_per_row: u16) -> [u16; 2] {
    let (half, least) = (codes_per_row / 2, (codes_per_row / 4).max(1));
    let low = if bottom > span[0] { bottom + half } else { bottom };
    let high = if top < span[1] { top - half.min(top) } else { top };
    if low + least <= high {
        return [low, high];
    }
    let middle = low.min(top - 1);
    let low = (middle - (least / 2).min(middle)).max(bottom);
    [low, (low + least).min(top)]
}

/// Unit vector of an azimuth in 256ths of a turn.
fn azimuth_vector(azimuth: u8) -> Vec2 {
    let (sin, cos) = libm::sincosf(f32::from(azimuth) / 256.0 * std::f32::consts::TAU);
    Vec2::new(cos, sin)
}

fn appearance(texel: Texel) -> VoxelAppearance {
    VoxelAppearance {
        rgb: linear_from_srgb(texel.rgb()).to_array(),
        ao: f32::from(texel.ao()) / f32::from(AO_MAX),
        is_known: !texel.is_open(),
    }
}

/// The parent's column over four child columns, and whether it stands on the ground.
fn merge_four(four: &[Option<&ChildColumn>; 4], cell_m: f32) -> (MergedColumn, bool) {
    // Most of a rural extract.
    if four.iter().all(Option::is_none) {
        return (MergedColumn::default(), false);
    }
    // Thin ground columns at four heights would have nothing in common, so all grounded columns get the lowest bottom.
    let lowest_m = four
        .iter()
        .flatten()
        .filter(|child| child.is_grounded)
        .filter_map(|child| Some(child.merged.opaque_solids().first()?.bottom_m))
        .fold(f32::INFINITY, f32::min);
    let lines: Vec<VerticalLine> = (0..LINES_PER_SIDE * LINES_PER_SIDE)
        .map(|i| {
            let position_m = line_position_m(i, cell_m);
            let q = usize::from(position_m.x > 0.0) | usize::from(position_m.y > 0.0) << 1;
            let Some(child) = four[q] else { return VerticalLine { position_m, runs: Vec::new() } };
            let mut runs = child.merged.opaque_runs_at(position_m - quadrant_centre_m(q, cell_m));
            if let (true, Some(first)) = (child.is_grounded, runs.first_mut()) {
                first.bottom_m = lowest_m;
            }
            VerticalLine { position_m, runs }
        })
        .collect();
    let walls: Vec<WallPiece> =
        (0..4).filter_map(|q| Some((four[q]?, q))).flat_map(|(child, q)| wall_pieces(child, q, cell_m)).collect();
    let observations = CellObservations { lines: &lines, walls: &walls, cell_m, least_gaps: PARENT_GAPS };
    let merged = observations.fit_column(Vec::new);
    // A deck does not stand on the ground because a few pillars do.
    let is_grounded = merged.solids.first().is_some_and(|run| lowest_m.is_finite() && run.bottom_m <= lowest_m);
    (merged, is_grounded)
}

/// Centre of the child cell in quadrant `q`, in metres from the parent cell's centre.
fn quadrant_centre_m(q: usize, cell_m: f32) -> Vec2 {
    (Vec2::new((q & 1) as f32, (q >> 1) as f32) - 0.5) * (0.5 * cell_m)
}

/// The walls of a child's column: at its clip, or else on its cell's border.
fn wall_pieces(child: &ChildColumn, q: usize, cell_m: f32) -> Vec<WallPiece> {
    let Some(wall) = child.wall.as_ref().filter(|_| child.merged.thin.is_none()) else { return Vec::new() };
    let planes = match child.merged.clip {
        None => vec![WallPlane { normal: wall.normal, offset_m: 0.25 * cell_m * wall.normal.abs().max_element() }],
        Some(CellClip { plane, corner: None, .. }) => vec![plane],
        Some(CellClip { plane, corner: Some(corner), .. }) => vec![plane, corner.plane],
    };
    let area_m2 = wall.rows.len() as f32 * 0.25 * cell_m * cell_m / planes.len() as f32;
    let piece = |plane: WallPlane| WallPiece {
        normal: plane.normal,
        position_m: quadrant_centre_m(q, cell_m) + plane.normal * plane.offset_m,
        area_m2,
    };
    planes.into_iter().map(piece).collect()
}

impl ParentColumns {
    fn new(children: ChildColumns, cell_m: f32) -> Self {
        let (merged, is_grounded) = (0..COLUMNS).map(|i| merge_four(&four_children(&children, i), cell_m)).unzip();
        let mut columns = Self { children, merged, is_grounded, cell_m };
        columns.lower_bottoms();
        columns.add_thin();
        columns
    }

    /// Lowers grounded columns whose bottom is above the lowest top around them: there would be a gap between the two.
    fn lower_bottoms(&mut self) {
        let tops_m: Vec<f32> =
            self.merged.iter().map(|merged| merged.solids.first().map_or(f32::INFINITY, |run| run.top_m)).collect();
        let n = NODE_CELLS as i32;
        for i in (0..COLUMNS).filter(|i| self.is_grounded[*i]) {
            let (x, y) = (i as i32 % n, i as i32 / n);
            let mut lowest_m = tops_m[i];
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                let (x, y) = (x + dx, y + dy);
                if (0..n).contains(&x) && (0..n).contains(&y) {
                    lowest_m = lowest_m.min(tops_m[(y * n + x) as usize]);
                }
            }
            if let Some(first) = self.merged[i].solids.first_mut().filter(|first| lowest_m < first.bottom_m) {
                first.bottom_m = lowest_m - SKIRT * self.cell_m;
            }
        }
    }

    /// MapColumn `i` with the mean appearance of its children; `None` if it is empty.
    fn column(&self, i: usize) -> Option<VoxelColumn> {
        let (own, cell_m) = (&self.merged[i], self.cell_m);
        let (first, last) = (*own.solids.first()?, *own.solids.last()?);
        let children: Vec<&ChildColumn> = four_children(&self.children, i).into_iter().flatten().collect();
        let exposed = self.is_exposed(i, &children);
        let solids =
            if exposed { own.solids.clone() } else { vec![SolidRun { bottom_m: first.bottom_m, top_m: last.top_m }] };
        // Only children at the column's top colour its roof; a lower terrace must not tint it.
        let is_at_top = |child: &&ChildColumn| {
            child.merged.solids.last().is_some_and(|run| (run.top_m - last.top_m).abs() < cell_m)
        };
        let at_top: Vec<&ChildColumn> = children.iter().copied().filter(is_at_top).collect();
        let tops = if at_top.is_empty() { &children } else { &at_top };
        let [sx, sy] = own.slope;
        let normal = if own.thin.is_some() {
            Vec3::Z
        } else if own.is_inclined {
            Vec3::new(-sx, -sy, 1.0).normalize_or(Vec3::Z)
        } else {
            tops.iter().map(|child| child.roof_normal).sum::<Vec3>().normalize_or(Vec3::Z)
        };
        let first_row = (first.bottom_m / cell_m).floor() as i32;
        let rows = if exposed { ((last.top_m / cell_m).ceil() as i32 - first_row).clamp(1, 4096) } else { 0 };
        let mut clip = own.clip.map(VoxelClip::from);
        if let Some(outer) = clip.as_mut().and_then(|clip| clip.outer.as_mut()) {
            outer.appearance = mean_top_at(&children, outer.top_m, cell_m);
        }
        let outer_m = clip.and_then(|clip| clip.outer).map(|outer| outer.top_m);
        let lower_top_m = outer_m.or((solids.len() > 1).then_some(first.top_m));
        let walls = children.iter().filter_map(|child| child.wall.as_ref());
        let reflective = tops.iter().filter(|child| child.is_reflective).count();
        let mean_wall_normal = walls.map(|wall| wall.normal * wall.rows.len() as f32).sum::<Vec2>().to_array();
        Some(VoxelColumn {
            clip,
            solids,
            thin: own.thin,
            inclined: own.is_inclined,
            suspended: !self.is_grounded[i],
            normal: normal.to_array(),
            roof: mean_of_known(tops.iter().map(|child| child.roof)),
            exposed,
            wall_normal: clip.map_or(mean_wall_normal, |clip| clip.plane.normal),
            first_row,
            wall: (first_row..first_row + rows).map(|row| wall_row(&children, row)).collect(),
            reflective: reflective > 0 && 2 * reflective >= tops.len(),
            objects: objects_of(&children, tops, lower_top_m, cell_m),
        })
    }

    /// Whether column `i` gets a wall strip, by the same rules as in a leaf. The node's border has no known neighbours;
    /// there a column is exposed if one of its children is.
    fn is_exposed(&self, i: usize, children: &[&ChildColumn]) -> bool {
        let n = NODE_CELLS as i32;
        let (x, y) = (i as i32 % n, i as i32 / n);
        let own = &self.merged[i];
        let is_on_border = x == 0 || y == 0 || x == n - 1 || y == n - 1;
        let is_hanging_slab = !self.is_grounded[i] && own.is_slab(self.cell_m);
        if own.clip.is_some()
            || own.thin.is_some()
            || own.solids.len() > 1
            || is_hanging_slab
            || is_on_border && children.iter().any(|child| child.wall.is_some())
        {
            return true;
        }
        [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().any(|(dx, dy)| {
            let (nx, ny) = (x + dx, y + dy);
            if !(0..n).contains(&nx) || !(0..n).contains(&ny) {
                return false;
            }
            let neighbour = &self.merged[(ny * n + nx) as usize];
            own.open_side_m(Some(neighbour), Vec2::new(dx as f32, dy as f32) * (0.5 * self.cell_m)) > self.cell_m
        })
    }
}

/// The objects that most of the children show: `tops` are those at the column's top.
fn objects_of(children: &[&ChildColumn], tops: &[&ChildColumn], lower_top_m: Option<f32>, cell_m: f32) -> VoxelObjects {
    let mut votes: [ObjectVotes; 3] = Default::default();
    tops.iter().for_each(|child| votes[0].add(child.objects.roof, 1.0));
    for child in children {
        if let Some(wall) = &child.wall {
            votes[1].add(child.objects.wall, wall.rows.len() as f32);
        }
        let Some(lower_top_m) = lower_top_m else { continue };
        let is_at_lower = |top_m: f32| (top_m - lower_top_m).abs() < cell_m;
        if child.merged.solids.last().is_some_and(|run| is_at_lower(run.top_m)) {
            votes[2].add(child.objects.roof, 1.0);
        }
        let gap_m = child.merged.solids.first().filter(|_| child.merged.solids.len() > 1).map(|run| run.top_m);
        if child.merged.clip.and_then(|clip| clip.outer_top_m).or(gap_m).is_some_and(is_at_lower) {
            votes[2].add(child.objects.lower, 1.0);
        }
    }
    let [roof, wall, lower] = votes.map(|votes| votes.winner());
    let wall = if wall == NO_OBJECT { roof } else { wall };
    VoxelObjects { roof, wall, lower: if lower == NO_OBJECT { roof } else { lower } }
}

/// Mean of the children's roofs, and of the tops beyond their clips, at about the height `z_m`.
fn mean_top_at(children: &[&ChildColumn], z_m: f32, cell_m: f32) -> VoxelAppearance {
    let tops = children.iter().flat_map(|child| {
        let roof = child.merged.solids.last().map(|run| (run.top_m, child.roof));
        let outer = child.merged.clip.and_then(|clip| clip.outer_top_m).zip(child.outer);
        [roof, outer].into_iter().flatten()
    });
    mean_of_known(tops.filter(|(top_m, _)| (top_m - z_m).abs() < cell_m).map(|(_, appearance)| appearance))
}

/// Mean of the children's walls in a row of the parent, which is two rows of a child.
fn wall_row(children: &[&ChildColumn], row: i32) -> VoxelAppearance {
    mean_of_known(children.iter().filter_map(|child| child.wall.as_ref()).flat_map(|wall| {
        [row * 2, row * 2 + 1]
            .into_iter()
            .filter_map(move |r| wall.rows.get(usize::try_from(r - wall.first_row).ok()?).copied())
    }))
}
