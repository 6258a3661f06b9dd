//! The ground of a node where the sources have no terrain: heights and occlusion on a coarse grid.
//!
//! Tiles store it beside the columns, because as columns it would cost about a sixth of a city's bytes
//! (`docs/decisions/0010-generated-ground.md`). Readers turn it into columns with [`BlockMap::stand_on_ground`].

use super::{
    BlockMap, COLUMNS, ColumnClip, MapColumn, NODE_CELLS, OuterTop, STEPS_PER_CELL, WallStrip, Z_CODE_MAX, Z_SHIFT_MAX,
    strip_rows,
};
use crate::codec::range::{BitCoder, BitModel, GroupFlag, NumberModel};
use crate::error::DecodeError;
use crate::octahedral;
use crate::texel::{AO_MAX, Texel};

/// Side of a square of the ground in columns.
pub const SQUARE_CELLS: usize = 8;
/// Squares along a node's side.
pub const SQUARES: usize = NODE_CELLS / SQUARE_CELLS;
/// Vertices along a node's side.
pub const VERTICES: usize = SQUARES + 1;
/// Colour of the ground, 8-bit sRGB. The surrounding plane has the same.
pub const GROUND_COLOUR: [u8; 3] = [190, 191, 186];

/// Columns whose bottom is at most this far above the ground, in metres, reach down to it. Higher ones hang above it.
const MAX_FOOT_M: f32 = 3.0;

/// Vertices lie in the open, so ground between them and a wall sees less of the sky than they do: by this at the foot.
const VERTEX_BIAS: f32 = 0.3;

/// Number of vertices.
pub const VERTEX_COUNT: usize = VERTICES * VERTICES;
/// [`NodeGround::heights`] of one cell.
pub const HEIGHTS_PER_CELL: u16 = 4;
/// Largest value of [`NodeGround::heights`]: the highest height code at the coarsest step.
pub const MAX_HEIGHT: u16 = (Z_CODE_MAX << Z_SHIFT_MAX) / (STEPS_PER_CELL / HEIGHTS_PER_CELL);
/// [`NodeGround::sky`] of the whole sky. Its few steps are not visible, because readers interpolate.
pub const SKY_MAX: u8 = 7;

/// The ground of a node on [`VERTICES`] x [`VERTICES`] vertices, row-major from the south-west corner.
///
/// The surface is the two triangles of the node's square south-east and north-west of its rising diagonal, each halved from
/// its right angle to the middle of its longest edge, again and again, wherever that middle is a corner of the surface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeGround {
    /// Quarters of a cell above the node's `z_base_cells`, 0 to [`MAX_HEIGHT`], of the corners; 0 elsewhere.
    pub heights: [u16; VERTEX_COUNT],
    /// Bit `i`: whether vertex `i` is a corner of the surface. Those of the node always are.
    pub corners: u128,
    /// Share of the sky that is visible from the vertices of squares with ground, 0 to [`SKY_MAX`]; 0 elsewhere.
    pub sky: [u8; VERTEX_COUNT],
    /// Bit `y * SQUARES + x`: whether that square has ground.
    pub squares: u64,
}

impl Default for NodeGround {
    fn default() -> Self {
        Self { heights: [0; VERTEX_COUNT], corners: NODE_CORNERS, sky: [0; VERTEX_COUNT], squares: 0 }
    }
}

/// [`NodeGround::corners`] of a surface of two triangles.
const NODE_CORNERS: u128 = 1 | 1 << SQUARES | 1 << (VERTEX_COUNT - VERTICES) | 1 << (VERTEX_COUNT - 1);

/// A vertex that may halve triangles.
#[derive(Debug, Clone, Copy)]
struct Middle {
    vertex: usize,
    /// The ends of the edge that it is the middle of.
    ends: [usize; 2],
    /// The right angles of the triangles at that edge; twice the same on the node's border. It is a corner of the surface
    /// only if they are.
    apexes: [usize; 2],
    /// 0 for the middle of the node, 1 for those of its sides, and so on.
    depth: usize,
}

/// Number of different [`Middle::depth`].
const DEPTHS: usize = 2 * SQUARES.ilog2() as usize;

/// All vertices but the node's corners, from the largest triangles to the smallest.
fn middles() -> impl Iterator<Item = Middle> {
    (0..DEPTHS).flat_map(|depth| {
        let half = SQUARES >> (depth / 2 + 1);
        let is_of_diagonal = depth % 2 == 0;
        let is_odd = move |v: usize| v / half % 2 == 1;
        let all = (0..VERTEX_COUNT).map(|i| [i % VERTICES, i / VERTICES]);
        let of_depth = all.filter(move |[x, y]| {
            let is_on_grid = x.is_multiple_of(half) && y.is_multiple_of(half);
            is_on_grid && if is_of_diagonal { is_odd(*x) && is_odd(*y) } else { is_odd(*x) != is_odd(*y) }
        });
        of_depth.map(move |[x, y]| {
            let at = |x: usize, y: usize| y * VERTICES + x;
            let (ends, apexes) = if is_of_diagonal {
                let rising = [at(x - half, y - half), at(x + half, y + half)];
                let falling = [at(x + half, y - half), at(x - half, y + half)];
                let is_rising = (x / half / 2 + y / half / 2).is_multiple_of(2);
                if is_rising { (rising, falling) } else { (falling, rising) }
            } else if is_odd(x) {
                let (south, north) = (y.checked_sub(half), Some(y + half).filter(|y| *y < VERTICES));
                let apex = |y: Option<usize>, other: Option<usize>| y.or(other).map_or(0, |y| at(x, y));
                ([at(x - half, y), at(x + half, y)], [apex(south, north), apex(north, south)])
            } else {
                let (west, east) = (x.checked_sub(half), Some(x + half).filter(|x| *x < VERTICES));
                let apex = |x: Option<usize>, other: Option<usize>| x.or(other).map_or(0, |x| at(x, y));
                ([at(x, y - half), at(x, y + half)], [apex(west, east), apex(east, west)])
            };
            Middle { vertex: at(x, y), ends, apexes, depth }
        })
    })
}

/// The least set of vertices with those of `wanted` that can be the corners of a surface ([`NodeGround::corners`]).
pub fn close_corners(wanted: u128) -> u128 {
    let mut corners = wanted | NODE_CORNERS;
    let all: Vec<Middle> = middles().collect();
    for middle in all.iter().rev() {
        if corners >> middle.vertex & 1 == 1 {
            corners |= 1 << middle.apexes[0] | 1 << middle.apexes[1];
        }
    }
    corners
}

/// The corners of a surface that follows heights at all vertices within half a unit for each halving.
pub fn corners_of(heights: &[f32; VERTEX_COUNT]) -> u128 {
    let bends = middles().filter(|middle| {
        let [a, b] = middle.ends.map(|end| heights[end]);
        (heights[middle.vertex] - 0.5 * (a + b)).abs() > 0.5
    });
    close_corners(bends.map(|middle| 1 << middle.vertex).fold(0, |all: u128, bit: u128| all | bit))
}

fn has_square(squares: u64, x: usize, y: usize) -> bool {
    x < SQUARES && y < SQUARES && squares >> (y * SQUARES + x) & 1 == 1
}

/// Whether vertex `x`, `y` belongs to one of the `squares` (as in [`NodeGround::squares`]).
pub fn is_used_vertex(squares: u64, x: usize, y: usize) -> bool {
    let at = |dx: usize, dy: usize| x >= dx && y >= dy && has_square(squares, x - dx, y - dy);
    at(0, 0) || at(1, 0) || at(0, 1) || at(1, 1)
}

/// Whether the diagonal of a square leads from south-west to north-east; otherwise from south-east to north-west.
pub fn is_rising_diagonal(x: usize, y: usize) -> bool {
    (x + y).is_multiple_of(2)
}

/// A point of the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundPoint {
    /// Cells above the node's `z_base_cells`.
    pub z: f32,
    /// Rise in cells per cell, to the east and to the north.
    pub slope: [f32; 2],
    /// Ambient occlusion, 0 (enclosed) to [`AO_MAX`] (open sky).
    pub ao: u8,
}

impl NodeGround {
    /// Fails on values that are out of range.
    pub(super) fn check(&self) -> Result<(), DecodeError> {
        if self.heights.iter().any(|z| *z > MAX_HEIGHT) || self.sky.iter().any(|sky| *sky > SKY_MAX) {
            return Err(DecodeError::Invalid("a ground's heights or shares of the sky are out of range"));
        }
        if self.corners >> VERTEX_COUNT != 0 || close_corners(self.corners) != self.corners {
            return Err(DecodeError::Invalid("a ground's corners do not form triangles"));
        }
        Ok(())
    }

    /// The surface with the heights of all vertices.
    pub fn surface(&self) -> GroundSurface<'_> {
        let mut heights = self.heights.map(|z| f32::from(z) / f32::from(HEIGHTS_PER_CELL));
        for middle in middles().filter(|middle| self.corners >> middle.vertex & 1 == 0) {
            let [a, b] = middle.ends.map(|end| heights[end]);
            heights[middle.vertex] = 0.5 * (a + b);
        }
        GroundSurface { ground: self, heights }
    }
}

/// The ground of a node as a function of the position.
#[derive(Debug, Clone)]
pub struct GroundSurface<'a> {
    ground: &'a NodeGround,
    /// Heights of the vertices in cells above the node's `z_base_cells`.
    pub heights: [f32; VERTEX_COUNT],
}

impl GroundSurface<'_> {
    /// The ground at a point, in cells from the node's south-west corner; `None` where it has none.
    pub fn at(&self, x: f32, y: f32) -> Option<GroundPoint> {
        let [(sx, u), (sy, v)] = [x, y].map(|at| {
            let at = at / SQUARE_CELLS as f32;
            let square = (at.max(0.0) as usize).min(SQUARES - 1);
            (square, at - square as f32)
        });
        if !has_square(self.ground.squares, sx, sy) || ![u, v].iter().all(|share| (0.0..=1.0).contains(share)) {
            return None;
        }
        let corner = |dx: usize, dy: usize| (sy + dy) * VERTICES + sx + dx;
        let z = |dx, dy| self.heights[corner(dx, dy)];
        let (sw, se, nw, ne) = (z(0, 0), z(1, 0), z(0, 1), z(1, 1));
        // The rises over the whole square of the triangle that the point lies in, and its height.
        let (east, north, height) = if is_rising_diagonal(sx, sy) {
            let (east, north) = if u >= v { (se - sw, ne - se) } else { (ne - nw, nw - sw) };
            (east, north, sw + east * u + north * v)
        } else {
            let (east, north) = if u + v <= 1.0 { (se - sw, nw - sw) } else { (ne - nw, ne - se) };
            (east, north, if u + v <= 1.0 { sw } else { nw + se - ne } + east * u + north * v)
        };
        let sky = |dx, dy| f32::from(self.ground.sky[corner(dx, dy)]);
        let sky = (sky(0, 0) * (1.0 - u) + sky(1, 0) * u) * (1.0 - v) + (sky(0, 1) * (1.0 - u) + sky(1, 1) * u) * v;
        let share = sky / f32::from(SKY_MAX);
        let ao = (share * (1.0 - VERTEX_BIAS * (1.0 - share)) * f32::from(AO_MAX)).round() as u8;
        Some(GroundPoint { z: height, slope: [east, north].map(|rise| rise / SQUARE_CELLS as f32), ao })
    }
}

#[derive(Default)]
struct GroundModels {
    square: [BitModel; 3],
    first_height: NumberModel,
    is_corner: [BitModel; DEPTHS],
    height: [NumberModel; 2],
    sky: [NumberModel; 2],
}

/// Writes or reads the ground of a node. Fails on values that are out of range.
pub(super) fn code<C: BitCoder>(coder: &mut C, ground: &mut NodeGround) -> Result<(), DecodeError> {
    let mut models = GroundModels::default();
    code_squares(coder, &mut ground.squares, &mut models);
    code_heights(coder, ground, &mut models)?;
    code_sky(coder, ground, &mut models)
}

fn code_heights<C: BitCoder>(
    coder: &mut C,
    ground: &mut NodeGround,
    models: &mut GroundModels,
) -> Result<(), DecodeError> {
    let height = |z: i32| {
        let height = u16::try_from(z).ok().filter(|z| *z <= MAX_HEIGHT);
        height.ok_or(DecodeError::Invalid("a ground's height is out of range"))
    };
    let mut last = 0;
    for i in (0..VERTEX_COUNT).filter(|i| NODE_CORNERS >> i & 1 == 1) {
        last += coder.number(&mut models.first_height, i32::from(ground.heights[i]).wrapping_sub(last));
        ground.heights[i] = height(last)?;
    }
    let written = ground.corners;
    ground.corners = NODE_CORNERS;
    for Middle { vertex, ends, apexes, depth } in middles() {
        let may_be_corner = apexes.iter().all(|apex| ground.corners >> apex & 1 == 1);
        if may_be_corner && coder.bit(&mut models.is_corner[depth], written >> vertex & 1 == 1) {
            let [a, b] = ends.map(|end| i32::from(ground.heights[end]));
            let expected = (a + b) / 2;
            let model = &mut models.height[usize::from(depth > 1)];
            let z = coder.number(model, i32::from(ground.heights[vertex]).wrapping_sub(expected)) + expected;
            ground.heights[vertex] = height(z)?;
            ground.corners |= 1 << vertex;
        }
    }
    Ok(())
}

fn code_sky<C: BitCoder>(coder: &mut C, ground: &mut NodeGround, models: &mut GroundModels) -> Result<(), DecodeError> {
    let squares = ground.squares;
    let mut last = i32::from(SKY_MAX);
    for i in (0..VERTEX_COUNT).filter(|i| is_used_vertex(squares, i % VERTICES, i / VERTICES)) {
        let (x, y) = (i % VERTICES, i / VERTICES);
        let known = |dx: usize, dy: usize| {
            let is_known = x >= dx && y >= dy && is_used_vertex(squares, x - dx, y - dy);
            is_known.then(|| i32::from(ground.sky[i - dy * VERTICES - dx]))
        };
        let (near, is_mixed) = match (known(1, 0), known(0, 1)) {
            (Some(west), Some(south)) => ((west + south) / 2, west != south),
            (Some(near), None) | (None, Some(near)) => (near, false),
            _ => (last, false),
        };
        let model = &mut models.sky[usize::from(is_mixed)];
        last = coder.number(model, i32::from(ground.sky[i]).wrapping_sub(near)) + near;
        let share = u8::try_from(last).ok().filter(|sky| *sky <= SKY_MAX);
        ground.sky[i] = share.ok_or(DecodeError::Invalid("a ground's share of the sky is out of range"))?;
    }
    Ok(())
}

fn code_squares<C: BitCoder>(coder: &mut C, squares: &mut u64, models: &mut GroundModels) {
    let written = *squares;
    let bits = (0..SQUARES * SQUARES).map(|i| written >> i & 1 == 1);
    let group = if C::WRITES { GroupFlag::of(bits) } else { GroupFlag::Unset };
    let group = group.code(coder, &mut [BitModel::NEW; 2]);
    *squares = 0;
    for i in 0..SQUARES * SQUARES {
        let (x, y) = (i % SQUARES, i / SQUARES);
        let west = x > 0 && has_square(*squares, x - 1, y);
        let south = y > 0 && has_square(*squares, x, y - 1);
        let model = &mut models.square[usize::from(west) + usize::from(south)];
        *squares |= u64::from(group.bit(coder, model, written >> i & 1 == 1)) << i;
    }
}

impl BlockMap {
    /// The map with its ground as columns: in empty cells, beyond clips, below what hangs in the air, and down to it where
    /// columns end a little above it. A map without ground stays as it is, and so does one that would exceed
    /// [`MAX_TEXELS`](super::MAX_TEXELS).
    pub fn stand_on_ground(self) -> Self {
        let Some(ground) = &self.ground else { return self };
        let surface = ground.surface();
        let mut columns = self.columns();
        for (i, column) in columns.iter_mut().enumerate().take(COLUMNS) {
            let [x, y] = [i % NODE_CELLS, i / NODE_CELLS].map(|n| n as f32 + 0.5);
            if let Some(point) = surface.at(x, y) {
                *column = Some(match column.take() {
                    Some(column) => self.on_ground(column, point),
                    None => self.ground_column(point),
                });
            }
        }
        match Self::from_columns(self.id, self.cell_m, self.z_base_cells, self.z_shift, &columns) {
            // The ground is no object.
            Ok(map) => Self { objects: self.objects, ..map },
            Err(_) => self,
        }
    }

    fn codes_per_cell(&self) -> f32 {
        f32::from(STEPS_PER_CELL >> self.z_shift)
    }

    /// A column of nothing but ground.
    fn ground_column(&self, point: GroundPoint) -> MapColumn {
        let code = |z: f32| (z * self.codes_per_cell()).round().clamp(0.0, f32::from(Z_CODE_MAX)) as u16;
        let z_max = code(point.z).max(1);
        let [east, north] = point.slope;
        let rise = (east.abs() + north.abs()) / 2.0;
        MapColumn {
            z_min: code(point.z - rise - 1.0).min(z_max - 1),
            z_max,
            inclined: rise > 0.0,
            roof: Texel::new(GROUND_COLOUR, point.ao),
            roof_normal: octahedral::encode([-east, -north, 1.0]),
            ..MapColumn::default()
        }
    }

    /// A column of the tile with the ground around and below it.
    fn on_ground(&self, mut column: MapColumn, point: GroundPoint) -> MapColumn {
        let ground = self.ground_column(point);
        // In a parent, ground at a shore reaches over the water beside it, at about its height.
        let margin = if column.reflective { self.codes_per_cell() as u16 } else { 0 };
        if column.z_max + margin <= ground.z_max {
            return ground;
        }
        if column.thin.is_some() {
            match self.thin_on_ground(column, &ground) {
                Ok(thin) => return thin,
                Err(rest) => column = rest,
            }
        }
        let foot = column.z_min;
        let above = f32::from(foot) - f32::from(ground.z_max);
        if foot > ground.z_min {
            let is_above = column.suspended && above > 1.0 || above > self.max_foot();
            self.lower(&mut column, ground.z_min);
            if is_above {
                self.hang(&mut column, [ground.z_max, foot]);
            }
        }
        if let Some(clip) = &mut column.clip {
            fill_beyond(clip, &ground, [column.z_min, column.z_max]);
        }
        column
    }

    /// Columns that end at most this far above the ground are continued to it, in height codes.
    pub(super) fn max_foot(&self) -> f32 {
        (MAX_FOOT_M / self.z_step_m()).max(self.codes_per_cell())
    }

    /// Extends a column down to `z_min`. Its wall continues as it is at its bottom.
    pub(super) fn lower(&self, column: &mut MapColumn, z_min: u16) {
        let (old, _) = strip_rows(column.z_min, column.z_max, self.z_shift);
        let (new, _) = strip_rows(z_min, column.z_max, self.z_shift);
        if let Some(strip) = &mut column.strip {
            let lowest = strip.texels.iter().find(|texel| !texel.is_open()).copied();
            let added = lowest.unwrap_or(column.roof);
            strip.texels.splice(0..0, (new..old).map(|_| added));
        }
        column.z_min = z_min;
    }

    /// Opens a gap in a column that was extended to the ground.
    fn hang(&self, column: &mut MapColumn, gap: [u16; 2]) {
        // Two gaps cannot be shown: the upper one closes.
        column.gap = Some(gap);
        if column.strip.is_none() {
            let rows = strip_rows(column.z_min, column.z_max, self.z_shift).1;
            column.strip = Some(WallStrip { texels: vec![column.roof; usize::from(rows)], azimuth: 0 });
        }
    }
}

/// Puts ground beyond a clip, unless something higher stands there.
fn fill_beyond(clip: &mut ColumnClip, ground: &MapColumn, [z_min, z_max]: [u16; 2]) {
    let is_covered = clip.outer.is_some_and(|outer| outer.z > ground.z_max);
    if !is_covered && z_min < ground.z_max && ground.z_max < z_max {
        clip.outer = Some(OuterTop { z: ground.z_max, roof: ground.roof });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TileId;
    use crate::blockmap::{ColumnObjects, NO_OBJECT, Quality};

    /// Ground that rises by a metre to the east in every square, without its north-eastern square.
    fn slope() -> NodeGround {
        let mut ground = NodeGround { squares: u64::MAX >> 1, ..NodeGround::default() };
        ground.heights = at_corners(ground.corners, |x, _| 10 + 4 * x);
        for i in (0..VERTEX_COUNT).filter(|i| is_used_vertex(ground.squares, i % VERTICES, i / VERTICES)) {
            ground.sky[i] = 7 - (i / VERTICES / 2) as u8;
        }
        ground
    }

    fn at_corners(corners: u128, height: impl Fn(u16, u16) -> u16) -> [u16; VERTEX_COUNT] {
        std::array::from_fn(|i| {
            let is_corner = corners >> i & 1 == 1;
            if is_corner { height((i % VERTICES) as u16, (i / VERTICES) as u16) } else { 0 }
        })
    }

    /// Ground with a bump at one vertex.
    fn bump() -> NodeGround {
        let corners = close_corners(1 << (3 * VERTICES + 5));
        let heights = at_corners(corners, |x, y| 250 + x * x * 31 % 97 + y);
        NodeGround { squares: u64::MAX, corners, heights, ..NodeGround::default() }
    }

    fn map_on(ground: NodeGround, columns: &[(usize, MapColumn)]) -> BlockMap {
        let mut all = vec![None; COLUMNS];
        for (i, column) in columns {
            all[*i] = Some(column.clone());
        }
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &all).unwrap();
        BlockMap { ground: Some(Box::new(ground)), ..map }
    }

    fn wall(z_min: u16, z_max: u16) -> MapColumn {
        let rows = strip_rows(z_min, z_max, 0).1;
        let texels = (0..rows).map(|row| Texel::new([row as u8; 3], 40)).collect();
        MapColumn {
            z_min,
            z_max,
            roof: Texel::new([200; 3], 63),
            strip: Some(WallStrip { texels, azimuth: 64 }),
            ..MapColumn::default()
        }
    }

    #[test]
    fn ground_is_no_object_and_columns_keep_theirs() {
        let mut map = map_on(bump(), &[(70, MapColumn { z_max: 200, ..MapColumn::default() })]);
        let mut objects = ColumnObjects::default();
        objects.roof[70] = 5;
        map.objects = Some(Box::new(objects));
        let on_ground = map.stand_on_ground().objects.unwrap();
        assert_eq!((on_ground.roof[70], on_ground.roof[71]), (5, NO_OBJECT));
    }

    #[test]
    fn ground_round_trips_and_is_small() {
        for ground in [slope(), bump()] {
            let map = map_on(ground, &[]);
            assert_eq!(BlockMap::decode(TileId::ROOT, &map.encode().unwrap()).unwrap(), map);
        }
        let map = map_on(slope(), &[(70, wall(50, 90))]);
        let with = map.encode().unwrap();
        assert_eq!(BlockMap::decode(TileId::ROOT, &with).unwrap(), map);
        let without = BlockMap { ground: None, ..map.clone() }.encode().unwrap();
        assert!(with.len() - without.len() < 50, "{} bytes", with.len() - without.len());
        let lossy = BlockMap::decode(TileId::ROOT, &map.encode_at(Quality::Decibels(36.0)).unwrap()).unwrap();
        assert_eq!(map.ground, lossy.ground);
    }

    #[test]
    fn empty_cells_become_slopes_and_squares_without_ground_stay_empty() {
        let map = map_on(slope(), &[]).stand_on_ground();
        let columns = map.columns();
        assert_eq!(columns.iter().flatten().count(), COLUMNS - SQUARE_CELLS * SQUARE_CELLS);
        assert!(columns[COLUMNS - 1].is_none());
        let column = columns[3].as_ref().unwrap();
        assert_eq!((column.z_max, column.inclined, column.roof.rgb()), (40 + 7, true, GROUND_COLOUR));
        let normal = octahedral::decode(column.roof_normal);
        assert!((normal[0] / normal[2] + 1.0 / 8.0).abs() < 0.02, "{normal:?}");
        assert!((0..20 * NODE_CELLS).all(|i| {
            let x = (i % NODE_CELLS) as f32 + 0.5;
            (f32::from(map.z_max[i]) - 40.0 - 2.0 * x).abs() <= 0.5
        }));
    }

    #[test]
    fn triangles_meet_at_the_vertices() {
        let ground = bump();
        assert!(ground.corners.count_ones() > 10 && ground.corners.count_ones() < 40);
        let surface = ground.surface();
        for (x, y) in (0..SQUARES).flat_map(|y| (0..SQUARES).map(move |x| (x, y))) {
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let near = |v: usize, d: usize| (v * SQUARE_CELLS) as f32 + if d == 0 { 0.5 } else { 7.5 };
                let point = surface.at(near(x, dx), near(y, dy)).unwrap();
                let away = [dx, dy].map(|d| if d == 0 { -0.5 } else { 0.5 });
                let at_vertex = point.z + point.slope[0] * away[0] + point.slope[1] * away[1];
                let i = (y + dy) * VERTICES + x + dx;
                assert!((at_vertex - surface.heights[i]).abs() < 0.01, "square {x}, {y}, corner {dx}, {dy}");
                if ground.corners >> i & 1 == 1 {
                    assert_eq!(surface.heights[i], f32::from(ground.heights[i]) / 4.0);
                }
            }
        }
    }

    #[test]
    fn corners_depend_on_each_other() {
        let all: Vec<Middle> = middles().collect();
        assert_eq!(all.len(), VERTEX_COUNT - 4);
        for (k, middle) in all.iter().enumerate() {
            let is_known = |i: usize| NODE_CORNERS >> i & 1 == 1 || all[..k].iter().any(|other| other.vertex == i);
            assert!(middle.ends.into_iter().chain(middle.apexes).all(is_known), "{middle:?}");
            let closed = close_corners(1 << middle.vertex);
            assert_eq!(close_corners(closed), closed);
        }
        assert_eq!(close_corners(0), NODE_CORNERS);
        assert_eq!(close_corners(u128::MAX >> (128 - VERTEX_COUNT)).count_ones() as usize, VERTEX_COUNT);
        let open = NodeGround { corners: NODE_CORNERS | 1 << 1, squares: 1, ..NodeGround::default() };
        assert!(open.check().is_err());
        let plane: [f32; VERTEX_COUNT] = std::array::from_fn(|i| (i % VERTICES + 2 * (i / VERTICES)) as f32);
        assert_eq!(corners_of(&plane), NODE_CORNERS);
        let roof: [f32; VERTEX_COUNT] = std::array::from_fn(|i| (i % VERTICES).abs_diff(4) as f32);
        assert_eq!(corners_of(&roof) >> 4 & 1, 1);
    }

    #[test]
    fn columns_reach_down_to_the_ground_or_hang_above_it() {
        let heights = at_corners(NODE_CORNERS, |_, _| 25);
        let flat = NodeGround { squares: u64::MAX, heights, sky: [5; VERTEX_COUNT], ..NodeGround::default() };
        let clip = ColumnClip { offset: 0, corner: None, outer: None };
        let columns = [
            (0, wall(110, 300)),
            (1, MapColumn { suspended: true, ..wall(200, 300) }),
            (2, MapColumn { clip: Some(clip), ..wall(40, 300) }),
            (3, MapColumn { clip: Some(clip), ..wall(200, 300) }),
            (4, wall(40, 90)),
            (5, MapColumn { strip: None, ..wall(300, 400) }),
            (6, MapColumn { reflective: true, ..wall(40, 90) }),
            (7, MapColumn { reflective: true, ..wall(40, 84) }),
        ];
        let map = map_on(flat, &columns).stand_on_ground();
        let columns = map.columns();
        let column = |i: usize| columns[i].as_ref().unwrap();
        assert_eq!((column(0).z_min, column(0).gap), (84, None));
        let texels = &column(0).strip.as_ref().unwrap().texels;
        assert_eq!((texels[0].rgb(), texels[1].rgb(), texels[2].rgb()), ([0; 3], [0; 3], [1; 3]));
        assert_eq!((column(1).z_min, column(1).gap), (84, Some([100, 200])));
        let outer = |i: usize| column(i).clip.unwrap().outer.unwrap();
        assert_eq!((column(2).z_min, outer(2).z, outer(2).roof.rgb()), (40, 100, GROUND_COLOUR));
        assert_eq!((column(3).gap, outer(3).z), (Some([100, 200]), 100));
        assert_eq!((column(4).z_max, column(4).roof.rgb(), column(4).roof.ao()), (100, GROUND_COLOUR, 41));
        assert_eq!(column(5).gap, Some([100, 300]));
        assert!(column(5).strip.is_some());
        assert_eq!((column(6).z_max, column(6).reflective), (90, true), "water a little below the ground");
        assert_eq!((column(7).z_max, column(7).reflective), (100, false));
    }
}
