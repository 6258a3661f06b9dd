//! The shapes of a V-BlockMap's columns, without their appearance: 8 bytes a column, and 14 more for one with a gap or a wall.

use super::{SolidInterval, exits_of};
use glam::{DVec2, DVec3, Vec3Swizzles};
use insula_protocol::blockmap::{CLIP_STEPS_PER_CELL, COLUMNS, ColumnClip, flag};
use insula_protocol::{BlockMap, NODE_CELLS};
use insula_shaders::pack::slope_codes;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The last column along an axis.
const LAST_CELL: f64 = (NODE_CELLS - 1) as f64;
/// Most columns that a way crosses: each row and each line once.
const MAX_CELLS: usize = 2 * NODE_CELLS + 2;

/// A column. Heights in codes.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Column {
    z_min: u16,
    z_max: u16,
    roof_normal: u16,
    flags: u8,
    /// Of the wall that clips it.
    azimuth: u8,
}

/// What few columns have.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct ColumnDetail {
    column: u16,
    /// Empty without a gap.
    gap: [u16; 2],
    clip: Option<PackedClip>,
}

/// A [`ColumnClip`] without colours.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct PackedClip {
    offset: i8,
    /// Azimuth and offset of a corner's second plane, and whether the column fills the inner side of either.
    corner: Option<(u8, i8, bool)>,
    /// Top of what lies beyond; 0 for nothing.
    outer_z: u16,
}

/// The solids of a resident V-BlockMap.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ColumnSolids {
    columns: Box<[Column]>,
    /// In the order of their columns.
    details: Box<[ColumnDetail]>,
    cell_m: f64,
    z_step_m: f64,
    z_base_m: f64,
    z_shift: u32,
}

impl ColumnSolids {
    /// The solids of a decoded map, whose decoder has checked its lengths.
    pub fn new(map: &BlockMap) -> Self {
        let (mut gaps, mut clips) = (map.gaps.iter(), map.clips.iter());
        let mut details = Vec::new();
        let mut columns = vec![Column::default(); COLUMNS];
        for (i, column) in columns.iter_mut().enumerate() {
            let flags = map.flags[i];
            let (z_min, z_max, roof_normal) = (map.z_min[i], map.z_max[i], map.roof_normal[i]);
            *column = Column { z_min, z_max, roof_normal, flags, azimuth: map.wall_azimuth[i] };
            let clip = (flags & flag::CLIPPED != 0).then(|| clips.next()).flatten().map(PackedClip::new);
            let gap = (flags & flag::GAP != 0).then(|| gaps.next()).flatten();
            if clip.is_some() || gap.is_some() {
                details.push(ColumnDetail { column: i as u16, gap: gap.copied().unwrap_or_default(), clip });
            }
        }
        Self {
            columns: columns.into(),
            details: details.into(),
            cell_m: f64::from(map.cell_m),
            z_step_m: f64::from(map.z_step_m()),
            z_base_m: map.z_base_m(),
            z_shift: u32::from(map.z_shift),
        }
    }

    /// The solids at `p`, metres from the south-west corner, as heights above the city's height zero.
    pub fn intervals_at(&self, p: DVec2) -> Vec<SolidInterval> {
        let cells = p / self.cell_m;
        let cell = cells.floor().clamp(DVec2::ZERO, DVec2::splat(LAST_CELL));
        let height = |code: f64| self.z_base_m + code * self.z_step_m;
        let spans = self.spans_in(index_of(cell), cells - cell - 0.5).into_iter().flatten();
        spans.map(|[bottom, top]| SolidInterval { bottom: height(bottom), top: height(top) }).collect()
    }

    /// Bottom and top of a column's solids in height codes, at a place in cells from its centre.
    fn spans_in(&self, i: usize, from_centre: DVec2) -> [Option<[f64; 2]>; 2] {
        let column = self.columns[i];
        if column.flags & flag::OCCUPIED == 0 {
            return [None; 2];
        }
        let span = |bottom: f64, top: f64| Some([bottom, top]).filter(|[bottom, top]| bottom < top);
        let z_min = f64::from(column.z_min);
        let detail = self.detail(i);
        if let Some(clip) = detail.and_then(|detail| detail.clip)
            && !clip.is_within(column.azimuth, from_centre)
        {
            return [span(z_min, f64::from(clip.outer_z)), None];
        }
        let top = f64::from(column.z_max) + self.slope_of(column).dot(from_centre);
        match detail.map(|detail| detail.gap).filter(|[low, high]| low < high) {
            Some([low, high]) => [span(z_min, f64::from(low)), span(f64::from(high), top)],
            None => [span(z_min, top), None],
        }
    }

    fn detail(&self, i: usize) -> Option<ColumnDetail> {
        let at = self.details.binary_search_by_key(&(i as u16), |detail| detail.column).ok()?;
        Some(self.details[at])
    }

    /// Slope of a column's top, in height codes per cell.
    fn slope_of(&self, column: Column) -> DVec2 {
        if column.flags & flag::INCLINED == 0 {
            return DVec2::ZERO;
        }
        DVec2::from(slope_codes(column.roof_normal, self.z_shift).map(f64::from))
    }

    /// Where the way from `start` along `way` first meets a column, from `span[0]` to `span[1]` of it.
    pub(crate) fn first_hit(&self, start: DVec3, way: DVec3, [mut t, end]: [f64; 2]) -> Option<f64> {
        let mut cell = ((start + way * t).xy() / self.cell_m).floor().clamp(DVec2::ZERO, DVec2::splat(LAST_CELL));
        for _ in 0..MAX_CELLS {
            let square = [cell * self.cell_m, (cell + 1.0) * self.cell_m];
            let exits = exits_of(square, start.xy(), way.xy());
            let axis = usize::from(exits.y < exits.x);
            let exit = exits[axis].clamp(t, end);
            if let Some(hit) = self.hit_in_cell(cell, start, way, [t, exit]) {
                return Some(hit);
            }
            if exit >= end {
                return None;
            }
            t = exit;
            cell[axis] += way[axis].signum();
            if cell.min_element() < 0.0 || cell.max_element() > LAST_CELL {
                return None;
            }
        }
        None
    }

    fn hit_in_cell(&self, cell: DVec2, start: DVec3, way: DVec3, [t, exit]: [f64; 2]) -> Option<f64> {
        let i = index_of(cell);
        if self.columns[i].flags & flag::OCCUPIED == 0 {
            return None;
        }
        let place = |t: f64| {
            let p = start + way * t;
            CellPlace { from_centre: p.xy() / self.cell_m - cell - 0.5, z: (p.z - self.z_base_m) / self.z_step_m }
        };
        let way_at = |share: f64| t + (exit - t) * share;
        // Between two crossings, the way is in a solid as a whole or not at all.
        let mut shares = self.crossings(i, place(t), place(exit));
        shares.extend([0.0, 1.0]);
        shares.sort_by(f64::total_cmp);
        let is_solid = |share: f64| {
            let CellPlace { from_centre, z } = place(way_at(share));
            self.spans_in(i, from_centre).into_iter().flatten().any(|[bottom, top]| bottom < z && z < top)
        };
        let pieces = shares.windows(2).filter(|piece| piece[0] < piece[1]);
        pieces.into_iter().find(|piece| is_solid((piece[0] + piece[1]) * 0.5)).map(|piece| way_at(piece[0]))
    }

    /// Shares of the way between two places of a cell at which it crosses a surface of the column, or a plane that holds one.
    fn crossings(&self, i: usize, a: CellPlace, b: CellPlace) -> Vec<f64> {
        let column = self.columns[i];
        let slope = self.slope_of(column);
        let heights = |place: CellPlace| {
            let top = f64::from(column.z_max) + slope.dot(place.from_centre);
            [place.z - top, place.z - f64::from(column.z_min)]
        };
        let mut values: Vec<[f64; 2]> = heights(a).into_iter().zip(heights(b)).map(<[f64; 2]>::from).collect();
        if let Some(detail) = self.detail(i) {
            let clip = detail.clip;
            let codes = detail.gap.into_iter().chain(clip.map(|clip| clip.outer_z)).map(f64::from);
            values.extend(codes.map(|code| [a.z - code, b.z - code]));
            let planes = clip.into_iter().flat_map(|clip| clip.planes(column.azimuth));
            values.extend(planes.map(|plane| [plane.beyond(a.from_centre), plane.beyond(b.from_centre)]));
        }
        values.into_iter().filter(|[a, b]| (*a > 0.0) != (*b > 0.0)).map(|[a, b]| a / (a - b)).collect()
    }
}

/// A place in a cell: x and y in cells from its centre, z in height codes.
#[derive(Clone, Copy)]
struct CellPlace {
    from_centre: DVec2,
    z: f64,
}

/// A vertical plane, in cells from the cell's centre.
#[derive(Clone, Copy)]
struct ClipPlane {
    normal: DVec2,
    offset: f64,
}

impl ClipPlane {
    fn new(azimuth: u8, offset: i8) -> Self {
        let normal = DVec2::from_angle(f64::from(azimuth) * (TAU / 256.0));
        Self { normal, offset: f64::from(offset) / f64::from(CLIP_STEPS_PER_CELL) }
    }

    /// Distance from the plane, above 0 outside of the wall.
    fn beyond(&self, from_centre: DVec2) -> f64 {
        self.normal.dot(from_centre) - self.offset
    }
}

impl PackedClip {
    fn new(clip: &ColumnClip) -> Self {
        let corner = clip.corner.map(|corner| (corner.azimuth, corner.offset, corner.concave));
        Self { offset: clip.offset, corner, outer_z: clip.outer.map_or(0, |outer| outer.z) }
    }

    fn planes(self, azimuth: u8) -> impl Iterator<Item = ClipPlane> {
        let second = self.corner.map(|(azimuth, offset, _)| ClipPlane::new(azimuth, offset));
        std::iter::once(ClipPlane::new(azimuth, self.offset)).chain(second)
    }

    /// Whether a place is on the column's side of the planes.
    fn is_within(self, azimuth: u8, from_centre: DVec2) -> bool {
        let mut planes = self.planes(azimuth);
        let is_inner = |plane: ClipPlane| plane.beyond(from_centre) <= 0.0;
        match self.corner {
            Some((.., true)) => planes.any(is_inner),
            _ => planes.all(is_inner),
        }
    }
}

fn index_of(cell: DVec2) -> usize {
    cell.y as usize * NODE_CELLS + cell.x as usize
}
