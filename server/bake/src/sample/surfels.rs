//! Surfels: points spread over the surfaces, about half a cell apart, each of which stands for an area of its triangle.
//! They carry colour, normal and occlusion to the voxels.
//!
//! Testing every surfel against every sky direction would be slow. The directions are therefore split into
//! [`SKY_SUBSETS`] subsets. A surfel is tested against one of them only, its neighbours on the triangle against the
//! others, and the surfels of such a group share the mean of their results ([`share_sky`]).

use super::crossings::Crossings;
use super::floor::Floor;
use super::local_block::{LocalBlock, LocalTriangle, MIN_TOP_NORMAL_Z};
use super::rasterise::rasterise;
use glam::Vec3;
use insula_protocol::{NODE_CELLS, TileId};

/// Number of subsets of the sky directions, and of surfels in a group.
pub(super) const SKY_SUBSETS: usize = 4;
/// Most surfels along the longest edge of a sliver, or along an axis of a broad triangle.
const MAX_SURFELS: f32 = 65536.0;
/// Most rows of surfels over the longest edge of a sliver.
const MAX_SLIVER_ROWS: f32 = 4.0;

/// A top is hidden by another one that lies at least and at most this far above it, in cells.
const COVER_CELLS: [f32; 2] = [0.005, 1.0];

/// Maximum number of points at which the distance of a leaf's columns from the source is measured.
const MAX_POINTS: usize = 1500;
/// Points that are visible from less than one in this many directions are left out: floors are visible through seams of shells.
const LEAST_SEEN: u32 = 10;

/// One point of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surfel {
    /// Metres in the block's coordinates.
    pub(super) position: Vec3,
    /// Index into the block's triangles.
    pub(super) triangle: u32,
    /// Area of the triangle that it stands for.
    pub(super) area_m2: f32,
    /// Subset of the sky directions that it is tested against.
    pub(super) sky_subset: u8,
    /// Number of its group within the triangle.
    group: u32,
    /// Sum of the cosines of the sky directions from which the front (the normal's side) and the back are visible.
    pub(super) sky_cosines: [f32; 2],
    /// Number of directions, of any kind, from which the front and the back are visible.
    pub(super) sightings: [u16; 2],
}

impl Surfel {
    pub(super) fn is_visible(&self) -> bool {
        self.sightings != [0; 2]
    }

    /// The side that is visible from more directions: 0 is the front, 1 the back.
    pub(super) fn visible_side(&self) -> usize {
        usize::from(self.sightings[1] > self.sightings[0])
    }
}

/// Places surfels on all triangles over the block's cells, triangle by triangle. Those of a triangle are sorted by
/// their sky subset.
pub(super) fn place(block: &LocalBlock, floor: &Floor) -> Vec<Surfel> {
    let mut surfels = Vec::new();
    let spacing_m = block.cell_m * 0.5;
    for (index, triangle) in (0..).zip(&block.triangles) {
        if is_hidden_floor(block, floor, triangle) {
            continue;
        }
        let first = surfels.len();
        let shortest_height_m = 2.0 * triangle.area_m2 / longest_edge(triangle).length_m;
        let mut placer = SurfelPlacer { block, triangle, index, spacing_m, surfels: &mut surfels };
        if shortest_height_m < 2.0 * spacing_m {
            placer.place_on_sliver();
        } else {
            placer.place_on_grid();
        }
        surfels[first..].sort_by_key(|surfel| surfel.sky_subset);
    }
    surfels
}

/// Drops the surfels of tops that lie closely under other tops: land use under a road. The column shows the upper one only, and
/// their visibility would be wrong: seen nearly edge-on, the texels of a map are larger than the upper surface.
pub(super) fn drop_covered(block: &LocalBlock, crossings: &Crossings, surfels: &mut Vec<Surfel>) {
    let starts = crossings.starts();
    surfels.retain(|surfel| {
        let p = surfel.position;
        let line = crossings.line_at(p.x, p.y).filter(|_| is_top(&block.triangles[surfel.triangle as usize]));
        let on_line = line.map_or(0..0, |line| starts[line] as usize..starts[line + 1] as usize);
        !crossings.list[on_line].iter().any(|crossing| {
            let upper = &block.triangles[crossing.triangle as usize];
            crossing.triangle != surfel.triangle && is_top(upper) && covers(upper, p, block.cell_m)
        })
    });
}

fn is_top(triangle: &LocalTriangle) -> bool {
    triangle.normal.z > MIN_TOP_NORMAL_Z
}

/// Whether a top that the line nearest to `p` crosses lies closely above. It may end just beside `p`, where another one goes on.
fn covers(upper: &LocalTriangle, p: Vec3, cell_m: f32) -> bool {
    let above_m = upper.normal.dot(upper.corners[0] - p) / upper.normal.z;
    above_m > COVER_CELLS[0] * cell_m && above_m < COVER_CELLS[1] * cell_m
}

/// Gives all surfels of a group the mean of their sky cosines.
pub(super) fn share_sky(surfels: &mut [Surfel]) {
    let mut order: Vec<u32> = Vec::new();
    for of_triangle in surfels.chunk_by_mut(|a, b| a.triangle == b.triangle) {
        order.clear();
        order.extend(0..of_triangle.len() as u32);
        order.sort_unstable_by_key(|i| (of_triangle[*i as usize].group, *i));
        let mut rest = &order[..];
        while let Some(first) = rest.first() {
            let group = of_triangle[*first as usize].group;
            let end = rest.iter().take_while(|i| of_triangle[**i as usize].group == group).count();
            let (members, after) = rest.split_at(end);
            let mean = [0, 1].map(|side| {
                members.iter().map(|i| of_triangle[*i as usize].sky_cosines[side]).sum::<f32>() / end as f32
            });
            members.iter().for_each(|i| of_triangle[*i as usize].sky_cosines = mean);
            rest = after;
        }
    }
}

/// Points spread over what is visible of a leaf, dense where it is visible from many directions: metres from the root's corner and
/// above the grid's height zero. `directions` is the number of those above the horizon. Undersides are left out: those of buildings are visible from below the horizon only,
/// where no viewer is.
pub(super) fn visible_points(block: &LocalBlock, surfels: &[Surfel], leaf: TileId, directions: u32) -> Vec<[f32; 3]> {
    let side_m = NODE_CELLS as f32 * block.cell_m;
    let place = [leaf.x(), leaf.y()];
    let low: [f32; 2] = std::array::from_fn(|axis| (place[axis] - block.first_leaf[axis]) as f32 * side_m);
    let weight = |surfel: &Surfel| {
        let within = |axis: usize| surfel.position[axis] >= low[axis] && surfel.position[axis] < low[axis] + side_m;
        let normal_z = block.triangles[surfel.triangle as usize].normal.z;
        let is_underside = normal_z.abs() > 0.99 && surfel.visible_side() == usize::from(normal_z > 0.0);
        let count = u32::from(surfel.sightings[surfel.visible_side()]);
        let is_seen = within(0) && within(1) && !is_underside && count * LEAST_SEEN >= directions;
        if is_seen { surfel.area_m2 * count as f32 } else { 0.0 }
    };
    let step = surfels.iter().map(weight).sum::<f32>() / MAX_POINTS as f32;
    let mut sum = 0.0;
    let mut points = Vec::new();
    for (surfel, weight) in surfels.iter().map(|surfel| (surfel, weight(surfel))).filter(|(_, weight)| *weight > 0.0) {
        sum += weight;
        if sum >= (points.len() as f32 + 0.5) * step {
            let place = |axis: usize| surfel.position[axis] + block.first_leaf[axis] as f32 * side_m;
            points.push([place(0), place(1), surfel.position.z]);
        }
    }
    points
}

/// Whether the triangle is the floor of a closed shell that stands on the ground, which no viewer can see.
fn is_hidden_floor(block: &LocalBlock, floor: &Floor, triangle: &LocalTriangle) -> bool {
    triangle.is_closed
        && triangle.normal.z < -0.99
        && triangle.highest_m() < triangle.object_bottom_m + 0.01 * block.cell_m
        && !floor.is_below(triangle)
}

struct LongestEdge {
    /// Corner that the edge starts from.
    start: usize,
    length_m: f32,
}

fn longest_edge(triangle: &LocalTriangle) -> LongestEdge {
    let edge = |start: usize| LongestEdge {
        start,
        length_m: triangle.corners[start].distance(triangle.corners[(start + 1) % 3]),
    };
    (0..3).map(edge).fold(LongestEdge { start: 0, length_m: 0.0 }, |a, b| if b.length_m > a.length_m { b } else { a })
}

/// Places the surfels of one triangle.
struct SurfelPlacer<'a> {
    block: &'a LocalBlock,
    triangle: &'a LocalTriangle,
    /// Index of the triangle in the block.
    index: u32,
    spacing_m: f32,
    surfels: &'a mut Vec<Surfel>,
}

impl SurfelPlacer<'_> {
    /// Adds a surfel unless it lies outside of the block. `step` is its column and row on the triangle, `group` those
    /// of its group.
    fn add(&mut self, position: Vec3, area_m2: f32, step: [usize; 2], group: [usize; 2]) {
        let [width_m, height_m] = self.block.extent_m();
        // A wall on the block's border may belong to the cell on its other side. Surfels up to half a cell outside are
        // kept here and dropped later if they belong to no cell of the block.
        let margin_m = self.block.cell_m * 0.5;
        if position.x >= -margin_m
            && position.y >= -margin_m
            && position.x < width_m + margin_m
            && position.y < height_m + margin_m
        {
            let sky_subset = ((step[0] & 1) | ((step[1] & 1) << 1)) as u8;
            let group = (group[0] as u16 as u32) << 16 | group[1] as u16 as u32;
            self.surfels.push(Surfel {
                position,
                triangle: self.index,
                area_m2,
                sky_subset,
                group,
                sky_cosines: [0.0; 2],
                sightings: [0; 2],
            });
        }
    }

    /// Places rows of surfels parallel to the longest edge of a narrow triangle.
    fn place_on_sliver(&mut self) {
        let triangle = self.triangle;
        let LongestEdge { start, length_m } = longest_edge(triangle);
        let (a, b) = (triangle.corners[start], triangle.corners[(start + 1) % 3]);
        let apex = triangle.corners[(start + 2) % 3];
        let pieces_at_edge = (length_m / self.spacing_m).ceil().clamp(1.0, MAX_SURFELS) as u32;
        let height_m = 2.0 * triangle.area_m2 / length_m;
        let rows = (height_m / self.spacing_m).ceil().clamp(1.0, MAX_SLIVER_ROWS) as u32;
        for row in 0..rows {
            // A row is the trapezoid from f0 to f1 of the way to the apex; the last one is a triangle.
            let (f0, f1) = (row as f32 / rows as f32, (row + 1) as f32 / rows as f32);
            let area_share = (1.0 - f0) * (1.0 - f0) - (1.0 - f1) * (1.0 - f1);
            let f = f0 + (f1 - f0) * if row + 1 == rows { 1.0 / 3.0 } else { 0.5 };
            let pieces = ((pieces_at_edge as f32 * (1.0 - f0)).ceil() as u32).max(1);
            for i in 0..pieces {
                let along = (i as f32 + 0.5) / pieces as f32;
                let position = a.lerp(b, along).lerp(apex, f);
                let step = [i as usize, row as usize + (i as usize >> 1)];
                let group = [i as usize / SKY_SUBSETS, row as usize];
                self.add(position, triangle.area_m2 * area_share / pieces as f32, step, group);
            }
        }
    }

    /// Projects the points of a world-aligned grid onto a broad triangle, along the axis nearest to its normal.
    fn place_on_grid(&mut self) {
        let (triangle, spacing) = (self.triangle, self.spacing_m);
        let n = triangle.normal.abs();
        let main = if n.z >= n.x && n.z >= n.y {
            2
        } else if n.x >= n.y {
            0
        } else {
            1
        };
        // Columns run upwards, as they do in visibility maps.
        let (u, v) = [(2, 1), (2, 0), (0, 1)][main];
        let [low, high] = triangle.bounds();
        // A large triangle is restricted to the block's surroundings.
        let [width_m, height_m] = self.block.extent_m();
        let cell_m = self.block.cell_m;
        let floor = Vec3::new(-cell_m, -cell_m, f32::MIN).max(low);
        let ceiling = Vec3::new(width_m + cell_m, height_m + cell_m, f32::MAX).min(high);
        if floor.cmpgt(ceiling).any() {
            return;
        }
        let start = (floor / spacing).floor() * spacing;
        let size =
            [u, v].map(|axis| ((ceiling[axis] - start[axis]) / spacing).ceil().clamp(0.0, MAX_SURFELS) as usize + 1);
        let corners = triangle.corners.map(|c| [c[u] - start[u], c[v] - start[v]]);
        let origin = triangle.corners[0];
        let area_m2 = spacing * spacing / n[main];
        rasterise(corners, spacing, size, |row, first, end| {
            for column in first..end {
                let mut p = Vec3::ZERO;
                p[u] = start[u] + (column as f32 + 0.5) * spacing;
                p[v] = start[v] + (row as f32 + 0.5) * spacing;
                let rise = triangle.normal[u] * (p[u] - origin[u]) + triangle.normal[v] * (p[v] - origin[v]);
                p[main] = origin[main] - rise / triangle.normal[main];
                self.add(p, area_m2, [column, row], [column / 2, row / 2]);
            }
        });
    }
}
