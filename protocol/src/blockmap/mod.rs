//! A V-BlockMap: a node's picture of its buildings as columns (Vacca 2008, 3.1 to 3.3; design 6).
//!
//! In: columns from the bake. Out: [`BlockMap`], and its bytes (`encode`, `decode`). Next: `insula-shaders` packs it for
//! ray-casting.
//!
//! Heights are whole codes of `cell / 16 * 2^z_shift` above `z_base_cells`. A wall strip's texels lie on the grid of whole
//! cells above that base, so that the rows of neighbouring columns, and of neighbouring nodes, are level.

mod appearance;
mod decode;
mod encode;
mod geometry;
mod walk;
mod walls;

pub use appearance::Loss;
pub use encode::Quality;

use crate::{TileId, error::DecodeError, texel::Texel};

/// Columns along a node's side.
pub const NODE_CELLS: usize = 64;
/// Columns of a node, row-major from the south-west corner: `y * NODE_CELLS + x`.
pub const COLUMNS: usize = NODE_CELLS * NODE_CELLS;
/// Height codes per cell at `z_shift` 0.
pub const STEPS_PER_CELL: u16 = 16;
/// Largest height code: heights are 12 bits.
pub const Z_CODE_MAX: u16 = 4095;
/// Largest `z_shift`; one code is then a whole cell.
pub const Z_SHIFT_MAX: u8 = 4;
/// Most strip texels in one node.
pub const MAX_TEXELS: usize = 1 << 20;

/// Bits of a column's flags; the same bits lie in GPU memory.
pub mod flag {
    /// There is a column.
    pub const OCCUPIED: u8 = 1;
    /// It has a wall strip: more than its top can be seen.
    pub const EXPOSED: u8 = 2;
    /// Its top is the plane through the cell's centre at `z_max`, square to the roof normal.
    pub const INCLINED: u8 = 4;
    /// It is two solids with a gap between them.
    pub const GAP: u8 = 8;
    /// Some of its strip's texels are not opaque.
    pub const HOLES: u8 = 16;
    /// Its bottom is in the air (type 2 of Vacca 3.1.1); for debug views only.
    pub const SUSPENDED: u8 = 32;
    /// A vertical plane cuts it: its solids end there, and what lies beyond is lower ([`super::ColumnClip`]).
    pub const CLIPPED: u8 = 64;
    /// All that the format knows.
    pub const ALL: u8 = 127;
}

/// Wall strip of an exposed column: what its sides show.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WallStrip {
    /// Bottom to top, [`strip_rows`] of them.
    pub texels: Vec<Texel>,
    /// Direction of the wall's horizontal normal, 256 to a full turn, 0 east, 64 north.
    pub azimuth: u8,
}

/// [`ColumnClip::offset`] of a plane one cell from the cell's centre.
pub const CLIP_STEPS_PER_CELL: i32 = 128;

/// What lies in a clipped column's cell beyond its wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OuterTop {
    /// Code of its top, between the column's `z_min` and `z_max`; its bottom is the column's.
    pub z: u16,
    /// What is seen from above.
    pub roof: Texel,
}

/// The second wall of a column that stands at a corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CornerWall {
    /// Direction of its horizontal normal, like [`WallStrip::azimuth`].
    pub azimuth: u8,
    /// Distance of its plane from the cell's centre, like [`ColumnClip::offset`].
    pub offset: i8,
    /// Whether the column fills the inner side of either plane; else only what is on the inner side of both.
    pub concave: bool,
}

/// Where a wall stands inside its cell: the column fills the part on the inner side of a vertical plane that is square to
/// the strip's azimuth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ColumnClip {
    /// Distance of the plane from the cell's centre along the azimuth, in cells / [`CLIP_STEPS_PER_CELL`].
    pub offset: i8,
    /// Where another wall meets the first.
    pub corner: Option<CornerWall>,
    /// `None` where the other side is empty.
    pub outer: Option<OuterTop>,
}

/// One column as the bake makes it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MapColumn {
    /// Code of the bottom, below `z_max`.
    pub z_min: u16,
    /// Code of the top (at the cell's centre if inclined), at most [`Z_CODE_MAX`].
    pub z_max: u16,
    /// Whether the top is a slope.
    pub inclined: bool,
    /// Whether the bottom is in the air.
    pub suspended: bool,
    /// Bottom and top of the gap, `z_min < gap[0] < gap[1] < z_max`; only exposed columns have one.
    pub gap: Option<[u16; 2]>,
    /// What is seen from above (and, at the bottom and in the gap, from below).
    pub roof: Texel,
    /// [`crate::octahedral`] code of the top's normal.
    pub roof_normal: u16,
    /// Present if exposed.
    pub strip: Option<WallStrip>,
    /// Only exposed columns are clipped.
    pub clip: Option<ColumnClip>,
}

/// First row and number of rows of a strip: the texels that `z_min..z_max` touches.
///
/// `z_min < z_max <= Z_CODE_MAX` and `z_shift <= Z_SHIFT_MAX`; a row is `16 >> z_shift` codes.
pub const fn strip_rows(z_min: u16, z_max: u16, z_shift: u8) -> (u16, u16) {
    // Codes a row are a power of two.
    let digits = STEPS_PER_CELL.trailing_zeros() - z_shift as u32;
    let first = z_min >> digits;
    (first, ((z_max - 1) >> digits) + 1 - first)
}

/// A node's columns, as arrays of [`COLUMNS`] entries; where there is no column, all are zero.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockMap {
    /// Which node.
    pub id: TileId,
    /// Side of a column in metres.
    pub cell_m: f32,
    /// Height of code 0, in cells above the city's origin.
    pub z_base_cells: i32,
    /// A height code is `cell_m / 16 * 2^z_shift` metres.
    pub z_shift: u8,
    /// Bits of [`flag`].
    pub flags: Vec<u8>,
    /// Bottoms.
    pub z_min: Vec<u16>,
    /// Tops.
    pub z_max: Vec<u16>,
    /// Colours from above.
    pub roof: Vec<Texel>,
    /// Normals of the tops.
    pub roof_normal: Vec<u16>,
    /// Azimuths of the walls (zero where not exposed).
    pub wall_azimuth: Vec<u8>,
    /// Gaps of the columns that have one, in column order.
    pub gaps: Vec<[u16; 2]>,
    /// Planes of the columns that are clipped, in column order.
    pub clips: Vec<ColumnClip>,
    /// Strips of the exposed columns one after the other, in column order.
    pub strips: Vec<Texel>,
}

impl BlockMap {
    /// A node without columns.
    pub fn empty(id: TileId, cell_m: f32, z_base_cells: i32, z_shift: u8) -> Self {
        Self {
            id,
            cell_m,
            z_base_cells,
            z_shift,
            flags: vec![0; COLUMNS],
            z_min: vec![0; COLUMNS],
            z_max: vec![0; COLUMNS],
            roof: vec![Texel::default(); COLUMNS],
            roof_normal: vec![0; COLUMNS],
            wall_azimuth: vec![0; COLUMNS],
            gaps: Vec::new(),
            clips: Vec::new(),
            strips: Vec::new(),
        }
    }

    /// Adds the columns in order. Errors: a column that breaks what [`MapColumn`] promises, or too many texels.
    pub fn from_columns(
        id: TileId,
        cell_m: f32,
        z_base_cells: i32,
        z_shift: u8,
        columns: &[Option<MapColumn>],
    ) -> Result<Self, DecodeError> {
        let mut map = Self::empty(id, cell_m, z_base_cells, z_shift);
        if columns.len() != COLUMNS || z_shift > Z_SHIFT_MAX || !(cell_m.is_finite() && cell_m > 0.0) {
            return Err(DecodeError::Invalid("not a node's columns"));
        }
        for (i, column) in columns.iter().enumerate() {
            if let Some(column) = column {
                map.put(i, column)?;
            }
        }
        map.check()?;
        Ok(map)
    }

    fn put(&mut self, i: usize, column: &MapColumn) -> Result<(), DecodeError> {
        let mut flags = flag::OCCUPIED;
        if column.inclined {
            flags |= flag::INCLINED;
        }
        if column.suspended {
            flags |= flag::SUSPENDED;
        }
        if let Some(gap) = column.gap {
            flags |= flag::GAP;
            self.gaps.push(gap);
        }
        if let Some(clip) = column.clip {
            flags |= flag::CLIPPED;
            self.clips.push(clip);
        }
        if let Some(strip) = &column.strip {
            flags |= flag::EXPOSED;
            if strip.texels.iter().any(|t| t.alpha() < crate::texel::ALPHA_MAX) {
                flags |= flag::HOLES;
            }
            self.wall_azimuth[i] = strip.azimuth;
            if column.z_min >= column.z_max
                || strip.texels.len() != usize::from(strip_rows(column.z_min, column.z_max, self.z_shift).1)
            {
                return Err(DecodeError::Invalid("a strip is not as long as its column is high"));
            }
            self.strips.extend_from_slice(&strip.texels);
        }
        self.flags[i] = flags;
        self.z_min[i] = column.z_min;
        self.z_max[i] = column.z_max;
        self.roof[i] = column.roof;
        self.roof_normal[i] = column.roof_normal;
        Ok(())
    }

    /// Metres of one height code.
    pub fn z_step_m(&self) -> f32 {
        self.cell_m / f32::from(STEPS_PER_CELL) * f32::from(1u16 << self.z_shift)
    }

    /// Height of code 0 in metres above the city's origin.
    pub fn z_base_m(&self) -> f64 {
        f64::from(self.z_base_cells) * f64::from(self.cell_m)
    }

    /// The columns as the bake made them: the inverse of [`BlockMap::from_columns`].
    pub fn columns(&self) -> Vec<Option<MapColumn>> {
        let (mut gaps, mut clips, mut strips) = (self.gaps.iter(), self.clips.iter(), &self.strips[..]);
        (0..COLUMNS)
            .map(|i| {
                let flags = self.flags[i];
                if flags & flag::OCCUPIED == 0 {
                    return None;
                }
                let gap = if flags & flag::GAP != 0 { gaps.next().copied() } else { None };
                let clip = if flags & flag::CLIPPED != 0 { clips.next().copied() } else { None };
                let strip = (flags & flag::EXPOSED != 0).then(|| {
                    let rows = usize::from(strip_rows(self.z_min[i], self.z_max[i], self.z_shift).1);
                    let (head, tail) = strips.split_at(rows.min(strips.len()));
                    strips = tail;
                    WallStrip { texels: head.to_vec(), azimuth: self.wall_azimuth[i] }
                });
                Some(MapColumn {
                    z_min: self.z_min[i],
                    z_max: self.z_max[i],
                    inclined: flags & flag::INCLINED != 0,
                    suspended: flags & flag::SUSPENDED != 0,
                    gap,
                    roof: self.roof[i],
                    roof_normal: self.roof_normal[i],
                    strip,
                    clip,
                })
            })
            .collect()
    }

    /// What every decoded map keeps: heights in order and in range, gaps inside, strips as long as the walls.
    pub(crate) fn check(&self) -> Result<(), DecodeError> {
        let mut texels = 0usize;
        let (mut gaps, mut clips) = (self.gaps.iter(), self.clips.iter());
        // Most columns are nothing but occupied, with their heights in order.
        let heights = self.z_min.iter().zip(&self.z_max);
        for (flags, (&z_min, &z_max)) in self.flags.iter().zip(heights).filter(|(flags, _)| **flags != 0) {
            if flags & !flag::ALL != 0 || flags & flag::OCCUPIED == 0 {
                return Err(DecodeError::Invalid("unknown column flags"));
            }
            if z_min >= z_max || z_max > Z_CODE_MAX {
                return Err(DecodeError::Invalid("a column's heights are turned around or out of range"));
            }
            if flags & (flag::GAP | flag::CLIPPED | flag::EXPOSED | flag::HOLES) == 0 {
                continue;
            }
            if flags & flag::GAP != 0 {
                let gap = gaps.next().ok_or(DecodeError::Invalid("a gap is missing"))?;
                if flags & flag::EXPOSED == 0 || !(z_min < gap[0] && gap[0] < gap[1] && gap[1] < z_max) {
                    return Err(DecodeError::Invalid("a gap does not lie inside its column"));
                }
            }
            if flags & flag::CLIPPED != 0 {
                let clip = clips.next().ok_or(DecodeError::Invalid("a clipping plane is missing"))?;
                let lower = clip.outer.is_none_or(|outer| z_min < outer.z && outer.z < z_max);
                if flags & flag::EXPOSED == 0 || !lower {
                    return Err(DecodeError::Invalid("what lies beyond a wall is not lower than the wall"));
                }
            }
            if flags & flag::EXPOSED != 0 {
                texels += usize::from(strip_rows(z_min, z_max, self.z_shift).1);
            } else if flags & flag::HOLES != 0 {
                return Err(DecodeError::Invalid("holes without a strip"));
            }
        }
        if gaps.next().is_some() || clips.next().is_some() || texels != self.strips.len() {
            return Err(DecodeError::Invalid("gaps, planes or strips do not match the columns"));
        }
        if texels > MAX_TEXELS {
            let (found, limit) = (texels as u64, MAX_TEXELS as u64);
            return Err(DecodeError::Limit { what: "the number of strip texels", found, limit });
        }
        Ok(())
    }
}
