//! A node as voxels: cubes of a cell's side, each full or empty (Vacca 2008, 3.1).
//!
//! Voxels are what people look at and what tests compare; tiles and ray-casters have columns.

use super::{BlockMap, MapColumn, NODE_CELLS, STEPS_PER_CELL, strip_rows};
use crate::texel::Texel;
use std::ops::Range;

/// Rows below the node's base: what stands is full there, however low it is.
pub const ROWS_BELOW: usize = 1;

/// Which voxels of a node are full, and what their faces show. Row [`ROWS_BELOW`] begins at the node's base; rows are those of wall strips.
#[derive(Debug, Clone, Default)]
pub struct Voxels {
    /// One for each column of the node.
    columns: Vec<FullRows>,
    rows: usize,
}

#[derive(Debug, Clone, Default)]
struct FullRows {
    /// Full rows from the bottom up, which do not meet.
    runs: Vec<Run>,
    /// What sides show, from row `first_row` on.
    sides: Vec<Texel>,
    first_row: usize,
}

/// Rows of a column without an empty one between them.
#[derive(Debug, Clone)]
struct Run {
    rows: Range<usize>,
    /// Seen from above, from below, and from the side where the column has no strip.
    top: Texel,
}

/// A face of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VoxelFace {
    West,
    East,
    South,
    North,
    Below,
    Above,
}

impl VoxelFace {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::West, Self::East, Self::South, Self::North, Self::Below, Self::Above];

    /// Steps to the voxel beyond it: east, north, up.
    pub const fn step(self) -> [i32; 3] {
        match self {
            Self::West => [-1, 0, 0],
            Self::East => [1, 0, 0],
            Self::South => [0, -1, 0],
            Self::North => [0, 1, 0],
            Self::Below => [0, 0, -1],
            Self::Above => [0, 0, 1],
        }
    }
}

impl Voxels {
    /// The voxels of a map with its ground.
    ///
    /// A voxel is full if its middle is in a solid of its column and its row of the wall strip is not open. A solid with no
    /// middle in it has the voxel of its own middle. What does not hang is solid to below the node's base.
    pub fn of(map: BlockMap) -> Self {
        let z_shift = map.z_shift;
        let ground = map.ground.clone();
        let surface = ground.as_ref().map(|ground| ground.surface());
        let has_ground = |i: usize| {
            let [x, y] = [i % NODE_CELLS, i / NODE_CELLS].map(|n| n as f32 + 0.5);
            surface.as_ref().is_some_and(|surface| surface.at(x, y).is_some())
        };
        let of_column = |(i, column): (usize, Option<MapColumn>)| {
            column.map_or_else(FullRows::default, |column| {
                // Above ground, a column reaches down to it, and what hangs has a gap.
                FullRows::of(column.suspended && !has_ground(i), column, z_shift)
            })
        };
        let columns: Vec<FullRows> = map.stand_on_ground().columns().into_iter().enumerate().map(of_column).collect();
        let rows = columns.iter().filter_map(|column| column.runs.last()).map(|run| run.rows.end).max().unwrap_or(0);
        Self { columns, rows }
    }

    /// Rows up to the highest full voxel.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Whether the voxel at `x` (east), `y` (north) and `row` (up) is full. Beyond the node, none is.
    pub fn is_full(&self, at: [i32; 3]) -> bool {
        self.run_at(at).is_some()
    }

    /// The full voxels that have an empty one beside them, and those faces: rows from the bottom up, in each of them from south-west to
    /// north-east. Nobody sees the lowest row from below.
    pub fn visible_faces(&self) -> impl Iterator<Item = ([usize; 3], VoxelFace, Texel)> {
        let side = NODE_CELLS;
        (0..self.rows * side * side).flat_map(move |i| {
            let at = [i % side, i / side % side, i / (side * side)];
            VoxelFace::ALL.into_iter().filter_map(move |face| Some((at, face, self.face(at, face)?)))
        })
    }

    /// What a face of a voxel shows; `None` if the voxel is empty, or nothing empty is beyond the face.
    pub fn face(&self, at: [usize; 3], face: VoxelFace) -> Option<Texel> {
        let [x, y, row] = at.map(|n| n as i32);
        let [dx, dy, dz] = face.step();
        let run = self.run_at([x, y, row])?;
        if row + dz < 0 || self.is_full([x + dx, y + dy, row + dz]) {
            return None;
        }
        if matches!(face, VoxelFace::Above | VoxelFace::Below) {
            return Some(run.top);
        }
        let column = &self.columns[at[1] * NODE_CELLS + at[0]];
        let texel = at[2].checked_sub(column.first_row).and_then(|row| column.sides.get(row));
        Some(texel.filter(|texel| !texel.is_open()).copied().unwrap_or(run.top))
    }

    fn run_at(&self, [x, y, row]: [i32; 3]) -> Option<&Run> {
        let side = 0..NODE_CELLS as i32;
        if !side.contains(&x) || !side.contains(&y) || row < 0 {
            return None;
        }
        let runs = &self.columns.get(y as usize * NODE_CELLS + x as usize)?.runs;
        let row = row as usize;
        runs.get(runs.partition_point(|run| run.rows.end <= row)).filter(|run| run.rows.start <= row)
    }
}

impl FullRows {
    fn of(hangs: bool, column: MapColumn, z_shift: u8) -> Self {
        let codes = usize::from(STEPS_PER_CELL >> z_shift);
        let below = ROWS_BELOW * codes;
        let [bottom, top] = [column.z_min, column.z_max].map(|code| usize::from(code) + below);
        let bottom = if hangs { bottom } else { 0 };
        let outer = column.clip.filter(|clip| !clip.fills_middle()).map(|clip| clip.outer);
        let (solids, roof) = match (outer, column.gap) {
            (Some(None), _) => return Self::default(),
            (Some(Some(outer)), _) => (vec![[bottom, usize::from(outer.z) + below]], outer.roof),
            (None, Some(gap)) => {
                let [low, high] = gap.map(|code| usize::from(code) + below);
                (vec![[bottom, low], [high, top]], column.roof)
            }
            (None, None) => (vec![[bottom, top]], column.roof),
        };
        // Beyond its clip, a column shows no strip.
        let first_row = usize::from(strip_rows(column.z_min, column.z_max, z_shift).0) + ROWS_BELOW;
        let sides = column.strip.filter(|_| outer.is_none()).map(|strip| strip.texels).unwrap_or_default();
        let is_open =
            |row: usize| row.checked_sub(first_row).and_then(|row| sides.get(row)).is_some_and(|t| t.is_open());
        let mut runs: Vec<Run> = Vec::new();
        for rows in solids.into_iter().map(|solid| rows_of(solid, codes)) {
            for row in rows.filter(|row| !is_open(*row)) {
                match runs.last_mut() {
                    Some(run) if run.rows.end > row => {}
                    Some(run) if run.rows.end == row => run.rows.end += 1,
                    _ => runs.push(Run { rows: row..row + 1, top: roof }),
                }
            }
        }
        Self { runs, sides, first_row }
    }
}

/// The rows whose middles are between two height codes; if there is none, that of the middle between them.
fn rows_of([low, high]: [usize; 2], codes: usize) -> Range<usize> {
    // Twice the code of the middle of a row is odd rows of `codes`.
    let [start, end] = [low, high].map(|code| (2 * code).saturating_sub(codes).div_ceil(2 * codes));
    if start < end {
        return start..end;
    }
    let middle = (low + high) / 2 / codes;
    middle..middle + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TileId;
    use crate::blockmap::{COLUMNS, ColumnClip, NodeGround, OuterTop, WallStrip};
    use crate::texel::AO_MAX;

    fn texel(grey: u8) -> Texel {
        Texel::new([grey; 3], AO_MAX)
    }

    /// A hanging column with a strip of grey 9 and a roof of grey 1.
    fn hanging(z_min: u16, z_max: u16, z_shift: u8) -> MapColumn {
        let texels = vec![texel(9); usize::from(strip_rows(z_min, z_max, z_shift).1)];
        let strip = Some(WallStrip { texels, azimuth: 0 });
        MapColumn { z_min, z_max, suspended: true, roof: texel(1), strip, ..MapColumn::default() }
    }

    fn map(column: MapColumn, z_shift: u8) -> BlockMap {
        let mut columns = vec![None; COLUMNS];
        columns[0] = Some(column);
        BlockMap::from_columns(TileId::ROOT, 1.0, 0, z_shift, &columns).unwrap()
    }

    fn full_rows(column: MapColumn, z_shift: u8) -> Vec<i32> {
        let voxels = Voxels::of(map(column, z_shift));
        let above_base = |row: &i32| voxels.is_full([0, 0, row + ROWS_BELOW as i32]);
        (-2..10).filter(above_base).collect()
    }

    #[test]
    fn a_voxel_is_full_if_its_middle_is() {
        assert_eq!(full_rows(hanging(8, 25, 0), 0), [0, 1], "middles at 8 and 24");
        assert_eq!(full_rows(hanging(9, 24, 0), 0), [1], "no middle in it: the voxel of its own");
        assert_eq!(full_rows(hanging(3, 5, 3), 3), [1], "two codes a cell, middles at 1, 3 and 5");
        assert_eq!(full_rows(hanging(2, 4, 4), 4), [2, 3], "one code a cell");
        assert_eq!(full_rows(MapColumn { suspended: false, ..hanging(40, 60, 0) }, 0), [-1, 0, 1, 2, 3]);
        assert_eq!(full_rows(MapColumn { suspended: false, ..hanging(2, 3, 0) }, 0), [-1], "low ground is not thin");
        assert_eq!(full_rows(MapColumn { gap: Some([16, 48]), ..hanging(0, 80, 0) }, 0), [0, 3, 4]);
        let mut open = hanging(0, 80, 0);
        open.strip.as_mut().unwrap().texels[2] = Texel::OPEN;
        assert_eq!(full_rows(open, 0), [0, 1, 3, 4]);
        let clip = |outer| Some(ColumnClip { offset: -1, outer, ..ColumnClip::default() });
        assert_eq!(full_rows(MapColumn { clip: clip(None), ..hanging(0, 80, 0) }, 0), [0; 0]);
        let outer = Some(OuterTop { z: 30, roof: texel(5) });
        assert_eq!(full_rows(MapColumn { clip: clip(outer), ..hanging(0, 80, 0) }, 0), [0, 1]);
    }

    #[test]
    fn faces_are_those_beside_empty_voxels() {
        let mut column = hanging(16, 48, 0);
        column.strip.as_mut().unwrap().texels[1] = texel(8);
        let voxels = Voxels::of(map(column, 0));
        let faces: Vec<_> = voxels.visible_faces().collect();
        assert_eq!((voxels.rows(), faces.len()), (4, 10), "four sides of two voxels, a top and an underside");
        let grey = |row, face| voxels.face([0, 0, row], face).map(|texel| texel.rgb()[0]);
        assert_eq!([2, 3].map(|row| grey(row, VoxelFace::East)), [Some(9), Some(8)]);
        assert_eq!([2, 3].map(|row| grey(row, VoxelFace::Above)), [None, Some(1)]);
        assert_eq!([2, 3].map(|row| grey(row, VoxelFace::Below)), [Some(1), None]);
        assert_eq!(voxels.face([1, 0, 2], VoxelFace::West), None, "there is no voxel");
        // Above ground, the column stays in the air, and nobody sees the ground from below.
        let mut standing = map(hanging(64, 96, 0), 0);
        standing.ground = Some(Box::new(NodeGround { squares: 1, ..NodeGround::default() }));
        let voxels = Voxels::of(standing);
        let full = (0..8).filter(|row| voxels.is_full([0, 0, *row])).collect::<Vec<_>>();
        assert_eq!(full, [0, 5, 6]);
        assert!(voxels.is_full([7, 7, 0]) && !voxels.is_full([8, 7, 0]) && !voxels.is_full([-1, 0, 0]));
        assert!(voxels.visible_faces().all(|(at, face, _)| at[2] > 0 || face != VoxelFace::Below));
    }
}
