//! V-BlockMaps: the buildings of one node as columns with roofs and wall strips (Vacca 2008, 3.1 to 3.3).
//!
//! Heights are integer codes of `cell / 16 * 2^z_shift` above `z_base_cells`. The texels of a wall strip lie on the
//! grid of whole cells above that base, so that the rows of neighbouring columns and nodes are level.
//!
//! The bytes are written and read by one walk over the values ([`BlockMap::walk`]), with lossless shapes and colours of
//! a chosen [`Quality`].

mod appearance;
mod bottoms;
mod decode;
mod encode;
mod facades;
pub mod ground;
mod neighbours;
pub mod objects;
mod reflective;
mod texel_coder;
mod thin;
mod tops;
pub mod voxels;
mod walk;
mod walls;

use crate::TileId;
use crate::error::{DecodeError, check_limit, invalid_if};
use crate::texel::Texel;
pub use encode::Quality;
pub use ground::NodeGround;
pub use objects::{ColumnObjects, NO_OBJECT};
pub use texel_coder::QuantisationSteps;
pub use thin::ThinShare;

/// Columns along a node's side.
pub const NODE_CELLS: usize = 64;
/// Columns of a node, row-major from the south-west corner: `y * NODE_CELLS + x`.
pub const COLUMNS: usize = NODE_CELLS * NODE_CELLS;
/// Height codes per cell at `z_shift` 0.
pub const STEPS_PER_CELL: u16 = 16;
/// Largest height code (12 bits).
pub const Z_CODE_MAX: u16 = 4095;
/// Largest `z_shift`. One code is then a whole cell.
pub const Z_SHIFT_MAX: u8 = 4;
/// Maximum number of strip texels in a node.
pub const MAX_TEXELS: usize = 1 << 20;

/// World error in metres of columns with side `cell_m`: half the diagonal of a cubic voxel (Vacca 2008, 3.6.2).
pub fn voxel_error_m(cell_m: f64) -> f64 {
    const HALF_UNIT_DIAGONAL: f64 = 0.866_025_403_784_438_6;
    HALF_UNIT_DIAGONAL * cell_m
}

/// Bits of a column's flags. GPU memory has the same bits.
pub mod flag {
    /// The column exists.
    pub const OCCUPIED: u8 = 1;
    /// It has a wall strip, because more than its top is visible.
    pub const EXPOSED: u8 = 2;
    /// Its top is the plane through the cell's centre at `z_max`, perpendicular to the roof normal.
    pub const INCLINED: u8 = 4;
    /// It is two solids with a gap between them.
    pub const GAP: u8 = 8;
    /// Some of its strip's texels are open, or it is thin ([`super::ThinShare`]).
    pub const HOLES: u8 = 16;
    /// Its bottom is above the ground (type 2 of Vacca 3.1.1). For debug views only.
    pub const SUSPENDED: u8 = 32;
    /// A vertical plane cuts it ([`super::ColumnClip`]). What lies beyond the plane is lower.
    pub const CLIPPED: u8 = 64;
    /// Its surface is water or glass. It has a section of its own.
    pub const REFLECTIVE: u8 = 128;
}

/// The wall strip of an exposed column: what its sides show.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WallStrip {
    /// One texel per row ([`strip_rows`]), bottom to top.
    pub texels: Vec<Texel>,
    /// Direction of the wall's horizontal normal in 1/256 turns, 0 east, 64 north.
    pub azimuth: u8,
}

/// Least z of an inclined top's normal: a steeper top could not be seen from above, and the bake never writes it. Readers treat it
/// as if it had this slope.
pub const MIN_NORMAL_Z: f32 = 0.1;

/// [`ColumnClip::offset`] of a plane at one cell from the cell's centre.
pub const CLIP_STEPS_PER_CELL: i32 = 128;

/// The top of what lies beyond the wall in a clipped column's cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OuterTop {
    /// Height code between the column's `z_min` and `z_max`, both excluded. The bottom is the column's.
    pub z: u16,
    /// Its colour from above.
    pub roof: Texel,
}

/// The second wall of a clipped column at a corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CornerWall {
    /// Direction of the horizontal normal, as in [`WallStrip::azimuth`].
    pub azimuth: u8,
    /// Distance of the plane from the cell's centre, as in [`ColumnClip::offset`].
    pub offset: i8,
    /// Whether the column fills the union of the inner sides of both planes, not the intersection.
    pub concave: bool,
}

/// Where a wall stands inside its cell. The column fills the inner side of a vertical plane that is perpendicular to
/// the strip's azimuth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ColumnClip {
    /// Distance of the plane from the cell's centre along the azimuth, in cells / [`CLIP_STEPS_PER_CELL`].
    pub offset: i8,
    /// The second wall, if the column stands at a corner.
    pub corner: Option<CornerWall>,
    /// What lies beyond the plane; `None` if that is empty.
    pub outer: Option<OuterTop>,
}

impl ColumnClip {
    /// Whether the middle of the cell is on the inner side.
    pub fn fills_middle(&self) -> bool {
        let is_inside = self.offset >= 0;
        match self.corner {
            Some(corner) if corner.concave => is_inside || corner.offset >= 0,
            Some(corner) => is_inside && corner.offset >= 0,
            None => is_inside,
        }
    }
}

/// One column.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MapColumn {
    /// Height code of the bottom, below `z_max`.
    pub z_min: u16,
    /// Height code of the top (at the cell's centre if inclined), at most [`Z_CODE_MAX`].
    pub z_max: u16,
    /// Whether the top is a slope.
    pub inclined: bool,
    /// Whether the bottom is above the ground.
    pub suspended: bool,
    /// Bottom and top of the gap, `z_min < gap[0] < gap[1] < z_max`. Only exposed columns have one.
    pub gap: Option<[u16; 2]>,
    /// Colour from above, and from below at the bottom and in the gap.
    pub roof: Texel,
    /// [`crate::octahedral`] code of the top's normal.
    pub roof_normal: u16,
    /// Present if the column is exposed.
    pub strip: Option<WallStrip>,
    /// Only exposed columns are clipped.
    pub clip: Option<ColumnClip>,
    /// Whether most of its surface is water or glass.
    pub reflective: bool,
    /// How much of it a thin object covers. Only exposed columns with neither a clip nor a slope may be thin.
    pub thin: Option<ThinShare>,
}

/// First row and number of rows of a strip: the rows of texels that `z_min..z_max` touches.
///
/// Requires `z_min < z_max <= Z_CODE_MAX` and `z_shift <= Z_SHIFT_MAX`. A row is `16 >> z_shift` height codes.
pub const fn strip_rows(z_min: u16, z_max: u16, z_shift: u8) -> (u16, u16) {
    // The codes per row are a power of two.
    let digits = STEPS_PER_CELL.trailing_zeros() - z_shift as u32;
    let first = z_min >> digits;
    (first, ((z_max - 1) >> digits) + 1 - first)
}

/// A node's columns as arrays of [`COLUMNS`] entries. Entries without a column are zero.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockMap {
    pub id: TileId,
    /// Side of a column in metres.
    pub cell_m: f32,
    /// Height of code 0, in cells above the city's origin.
    pub z_base_cells: i32,
    /// A height code is `cell_m / 16 * 2^z_shift` metres.
    pub z_shift: u8,
    /// Bits of [`flag`].
    pub flags: Vec<u8>,
    /// Height codes of the bottoms.
    pub z_min: Vec<u16>,
    /// Height codes of the tops.
    pub z_max: Vec<u16>,
    /// Colours from above.
    pub roof: Vec<Texel>,
    pub roof_normal: Vec<u16>,
    /// Azimuths of the walls; 0 for columns that are not exposed.
    pub wall_azimuth: Vec<u8>,
    /// Gaps of the columns that have one, in column order.
    pub gaps: Vec<[u16; 2]>,
    /// Planes of the clipped columns, in column order.
    pub clips: Vec<ColumnClip>,
    /// Strips of the exposed columns, concatenated in column order.
    pub strips: Vec<Texel>,
    /// The thin columns, by their numbers, ascending.
    pub thin: Vec<(u16, ThinShare)>,
    /// Ground that is stored beside the columns; see [`BlockMap::stand_on_ground`].
    pub ground: Option<Box<NodeGround>>,
    /// The objects that the columns show; `None` if no column has any.
    pub objects: Option<Box<ColumnObjects>>,
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
            thin: Vec::new(),
            ground: None,
            objects: None,
        }
    }

    /// Builds a map without ground from [`COLUMNS`] columns in order. Fails on a column that breaks the rules of [`MapColumn`], and on
    /// more than [`MAX_TEXELS`] strip texels.
    pub fn from_columns(
        id: TileId,
        cell_m: f32,
        z_base_cells: i32,
        z_shift: u8,
        columns: &[Option<MapColumn>],
    ) -> Result<Self, DecodeError> {
        let mut map = Self::empty(id, cell_m, z_base_cells, z_shift);
        if columns.len() != COLUMNS || z_shift > Z_SHIFT_MAX || !(cell_m.is_finite() && cell_m > 0.0) {
            return Err(DecodeError::Invalid(
                "a V-BlockMap needs 4096 columns, a positive cell size and a z_shift of at most 4",
            ));
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
        if column.reflective {
            flags |= flag::REFLECTIVE;
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
            if column.thin.is_some() || strip.texels.iter().any(|t| t.is_open()) {
                flags |= flag::HOLES;
            }
            self.wall_azimuth[i] = strip.azimuth;
            if column.z_min >= column.z_max
                || strip.texels.len() != usize::from(strip_rows(column.z_min, column.z_max, self.z_shift).1)
            {
                return Err(DecodeError::Invalid("a wall strip's length differs from its column's rows"));
            }
            self.strips.extend_from_slice(&strip.texels);
        }
        self.thin.extend(column.thin.map(|share| (i as u16, share)));
        self.flags[i] = flags;
        self.z_min[i] = column.z_min;
        self.z_max[i] = column.z_max;
        self.roof[i] = column.roof;
        self.roof_normal[i] = column.roof_normal;
        Ok(())
    }

    /// Height of one code in metres.
    pub fn z_step_m(&self) -> f32 {
        self.cell_m / f32::from(STEPS_PER_CELL) * f32::from(1u16 << self.z_shift)
    }

    /// Height of code 0 in metres above the city's origin.
    pub fn z_base_m(&self) -> f64 {
        f64::from(self.z_base_cells) * f64::from(self.cell_m)
    }

    /// The inverse of [`BlockMap::from_columns`]. The ground is not among the columns.
    pub fn columns(&self) -> Vec<Option<MapColumn>> {
        let (mut gaps, mut clips, mut strips) = (self.gaps.iter(), self.clips.iter(), &self.strips[..]);
        let mut thin = self.thin.iter().peekable();
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
                    reflective: flags & flag::REFLECTIVE != 0,
                    thin: thin.next_if(|(column, _)| usize::from(*column) == i).map(|(_, share)| *share),
                })
            })
            .collect()
    }

    /// Checks the rules of [`MapColumn`]. Fails on the first violation.
    pub(crate) fn check(&self) -> Result<(), DecodeError> {
        self.ground.as_ref().map_or(Ok(()), |ground| ground.check())?;
        self.objects.as_ref().map_or(Ok(()), |objects| objects.check())?;
        thin::check(self)?;
        let mut texels = 0usize;
        let (mut gaps, mut clips) = (self.gaps.iter(), self.clips.iter());
        let heights = self.z_min.iter().zip(&self.z_max);
        for (flags, (&z_min, &z_max)) in self.flags.iter().zip(heights).filter(|(flags, _)| **flags != 0) {
            invalid_if(flags & flag::OCCUPIED == 0, "a column has flags without being occupied")?;
            invalid_if(z_min >= z_max || z_max > Z_CODE_MAX, "a column's heights are inverted or out of range")?;
            // The common case.
            if flags & (flag::GAP | flag::CLIPPED | flag::EXPOSED | flag::HOLES) == 0 {
                continue;
            }
            if flags & flag::GAP != 0 {
                let gap = gaps.next().ok_or(DecodeError::Invalid("a column's gap is missing"))?;
                if flags & flag::EXPOSED == 0 || !(z_min < gap[0] && gap[0] < gap[1] && gap[1] < z_max) {
                    return Err(DecodeError::Invalid("a gap lies outside its column, or its column is not exposed"));
                }
            }
            if flags & flag::CLIPPED != 0 {
                let clip = clips.next().ok_or(DecodeError::Invalid("a column's clipping plane is missing"))?;
                let is_lower = clip.outer.is_none_or(|outer| z_min < outer.z && outer.z < z_max);
                if flags & flag::EXPOSED == 0 || !is_lower {
                    return Err(DecodeError::Invalid(
                        "a clipped column is not exposed, or its outer top is not between its heights",
                    ));
                }
            }
            if flags & flag::EXPOSED != 0 {
                texels += usize::from(strip_rows(z_min, z_max, self.z_shift).1);
            } else if flags & flag::HOLES != 0 {
                return Err(DecodeError::Invalid("a column has holes but no wall strip"));
            }
        }
        if gaps.next().is_some() || clips.next().is_some() || texels != self.strips.len() {
            return Err(DecodeError::Invalid("the numbers of gaps, planes or strip texels do not match the columns"));
        }
        check_texel_limit(texels)
    }
}

/// Fails if a node has too many strip texels.
fn check_texel_limit(texels: usize) -> Result<(), DecodeError> {
    check_limit("the number of strip texels", texels, MAX_TEXELS)
}
