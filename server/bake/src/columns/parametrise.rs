//! From voxels to a V-BlockMap (Vacca 2008, 3.3; design 6): heights become codes, light becomes sRGB bytes.
//!
//! In: [`VoxelNode`]. Out: [`BlockMap`]. Next: `protocol` encodes it, `write` keeps it.

use crate::{
    columns::voxels::{Look, Solid, VoxelClip, VoxelColumn, VoxelNode, VoxelPlane},
    sample::texture::srgb,
    scene::grid::CityGrid,
};
use insula_protocol::{
    BlockMap, DecodeError, Texel,
    blockmap::{
        CLIP_STEPS_PER_CELL, ColumnClip, CornerWall, MAX_TEXELS, MapColumn, OuterTop, STEPS_PER_CELL, WallStrip,
        Z_CODE_MAX, Z_SHIFT_MAX, strip_rows,
    },
    octahedral,
    texel::{ALPHA_MAX, AO_MAX},
};

/// Turns metres into the codes of one node.
struct Codes {
    cell_m: f64,
    base_cells: i32,
    base_m: f64,
    step_m: f64,
    shift: u8,
}

impl Codes {
    /// The finest step at which the node's heights fit 12 bits; taller still is cut off at the top.
    fn new(node: &VoxelNode, cell_m: f64) -> Self {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for solid in node.columns.iter().flatten().flat_map(|c| &c.solids) {
            low = low.min(solid.bottom_m);
            high = high.max(solid.top_m);
        }
        let (low, high) = if low <= high { (f64::from(low), f64::from(high)) } else { (0.0, 0.0) };
        // The cast saturates: heights beyond 2^31 cells do not exist on Earth.
        let base_cells = (low / cell_m).floor() as i32;
        let base_m = f64::from(base_cells) * cell_m;
        let step = |shift: u8| cell_m / f64::from(STEPS_PER_CELL) * f64::from(1u16 << shift);
        let fits = |shift: &u8| (high - base_m) / step(*shift) < f64::from(Z_CODE_MAX);
        let shift = (0..=Z_SHIFT_MAX).find(fits).unwrap_or(Z_SHIFT_MAX);
        Self { cell_m, base_cells, base_m, step_m: step(shift), shift }
    }

    fn code(&self, z_m: f32) -> u16 {
        ((f64::from(z_m) - self.base_m) / self.step_m).round().clamp(0.0, f64::from(Z_CODE_MAX)) as u16
    }
}

/// The node's V-BlockMap. Errors: only if more strips are wanted than [`MAX_TEXELS`] even after the rest went without.
pub fn parametrise(grid: &CityGrid, node: &VoxelNode) -> Result<BlockMap, DecodeError> {
    let cell_m = grid.cell_m_at(node.id.level());
    let codes = Codes::new(node, cell_m);
    let mut texels = 0;
    let columns: Vec<Option<MapColumn>> = node
        .columns
        .iter()
        .map(|column| {
            let mut column = code_column(column.as_ref()?, &codes);
            texels += column.strip.as_ref().map_or(0, |s| s.texels.len());
            if texels > MAX_TEXELS {
                // Towers everywhere at a tiny cell: the rest show their roof colour on their sides.
                column.strip = None;
                column.gap = None;
                column.clip = None;
            }
            Some(column)
        })
        .collect();
    let mut map = BlockMap::from_columns(node.id, cell_m as f32, codes.base_cells, codes.shift, &columns)?;
    map.snap_hidden_bottoms();
    Ok(map)
}

fn code_column(column: &VoxelColumn, codes: &Codes) -> MapColumn {
    let bottom = column.solids.first().map_or(0.0, |s| s.bottom_m);
    let top = column.solids.last().map_or(0.0, |s| s.top_m);
    let z_max = codes.code(top).max(1);
    let z_min = codes.code(bottom).min(z_max - 1);
    let gap = column
        .exposed
        .then(|| widest_gap(&column.solids))
        .flatten()
        .map(|[low, high]| [codes.code(low).max(z_min + 1), codes.code(high).min(z_max.saturating_sub(1))]);
    let gap = gap.filter(|[low, high]| low < high);
    MapColumn {
        z_min,
        z_max,
        inclined: column.inclined,
        suspended: column.suspended,
        gap,
        roof: texel(&column.roof, ALPHA_MAX),
        roof_normal: octahedral::encode(column.normal),
        strip: column.exposed.then(|| strip(column, codes, z_min, z_max, gap)),
        clip: column.clip.filter(|_| column.exposed).map(|c| clip(&c, codes, z_min, z_max)),
    }
}

fn clip(clip: &VoxelClip, codes: &Codes, z_min: u16, z_max: u16) -> ColumnClip {
    let offset = |plane: &VoxelPlane| {
        let steps = (f64::from(plane.offset_m) / codes.cell_m * f64::from(CLIP_STEPS_PER_CELL)).round();
        steps.clamp(-128.0, 127.0) as i8
    };
    let corner = clip.corner.map(|(second, concave)| CornerWall {
        azimuth: azimuth(second.normal),
        offset: offset(&second),
        concave,
    });
    let outer = clip.outer.map(|(top_m, look)| (codes.code(top_m).min(z_max - 1), look));
    let outer = outer.filter(|(z, _)| *z > z_min).map(|(z, look)| OuterTop { z, roof: texel(&look, ALPHA_MAX) });
    ColumnClip { offset: offset(&clip.plane), corner, outer }
}

/// 256 to a full turn.
fn azimuth([x, y]: [f32; 2]) -> u8 {
    let turn = (y.atan2(x) / std::f32::consts::TAU).rem_euclid(1.0);
    ((turn * 256.0).round() as u32 % 256) as u8
}

/// The gap that is kept exactly; others become transparent texels.
fn widest_gap(solids: &[Solid]) -> Option<[f32; 2]> {
    solids
        .windows(2)
        .map(|pair| [pair[0].top_m, pair[1].bottom_m])
        .max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))
}

fn strip(column: &VoxelColumn, codes: &Codes, z_min: u16, z_max: u16, gap: Option<[u16; 2]>) -> WallStrip {
    let (first, rows) = strip_rows(z_min, z_max, codes.shift);
    let codes_per_row = STEPS_PER_CELL >> codes.shift;
    let full: Vec<[u16; 2]> = column.solids.iter().map(|s| [codes.code(s.bottom_m), codes.code(s.top_m)]).collect();
    let texels = (first..first + rows)
        .map(|row| {
            let (low, high) = (row * codes_per_row, (row + 1) * codes_per_row);
            let touched = |[a, b]: &[u16; 2]| *a < high && *b > low;
            // Rows of the exact gap are never read; opaque, they pack with their neighbours.
            let in_gap = gap.is_some_and(|g| g[0] <= low && g[1] >= high);
            let alpha = if in_gap || full.iter().any(touched) { ALPHA_MAX } else { 0 };
            let at = codes.base_cells + i32::from(row) - column.first_row;
            let last = column.wall.len() as i32 - 1;
            if alpha == 0 {
                Texel::TRANSPARENT
            } else if last < 0 {
                texel(&column.roof, alpha)
            } else {
                texel(&column.wall[at.clamp(0, last) as usize], alpha)
            }
        })
        .collect();
    WallStrip { texels, azimuth: azimuth(column.wall_normal) }
}

fn texel(look: &Look, alpha: u8) -> Texel {
    Texel::new(srgb(look.rgb), (look.ao.clamp(0.0, 1.0) * f32::from(AO_MAX)).round() as u8, alpha)
}

#[cfg(test)]
mod tests {
    use crate::columns::parametrise::*;
    use insula_protocol::{TileId, blockmap::flag};

    fn grid() -> CityGrid {
        CityGrid { corner: [0.0; 3], depth: 1, cell_m: 1.0 }
    }

    fn column(solids: &[[f32; 2]], exposed: bool) -> VoxelColumn {
        let solids: Vec<Solid> = solids.iter().map(|s| Solid { bottom_m: s[0], top_m: s[1] }).collect();
        let first_row = solids[0].bottom_m.floor() as i32;
        let rows = solids.last().unwrap().top_m.ceil() as i32 - first_row;
        let wall = (0..rows).map(|r| Look { rgb: [r as f32 / 64.0; 3], ao: 1.0, alpha: 1.0 }).collect();
        VoxelColumn {
            solids,
            inclined: false,
            suspended: false,
            normal: [0.0, 0.0, 1.0],
            roof: Look { rgb: [1.0; 3], ao: 0.5, alpha: 1.0 },
            exposed,
            wall_normal: [0.0, -1.0],
            first_row,
            wall: if exposed { wall } else { Vec::new() },
            clip: None,
        }
    }

    fn map(columns: Vec<VoxelColumn>) -> BlockMap {
        let mut node = VoxelNode::empty(TileId::new(1, 0, 0).unwrap());
        for (i, column) in columns.into_iter().enumerate() {
            node.columns[i] = Some(column);
        }
        parametrise(&grid(), &node).unwrap()
    }

    #[test]
    fn the_four_kinds_of_columns() {
        let map = map(vec![
            column(&[[7.5, 9.25]], false),
            column(&[[7.5, 20.0]], true),
            column(&[[12.0, 20.0]], true),
            column(&[[7.5, 8.0], [12.0, 13.0], [15.0, 20.0]], true),
        ]);
        assert_eq!(map.z_base_cells, 7);
        assert_eq!((map.z_min[0], map.z_max[0], map.flags[0]), (8, 36, flag::OCCUPIED));
        assert_eq!(map.flags[1], flag::OCCUPIED | flag::EXPOSED);
        assert_eq!(map.wall_azimuth[1], 192);
        assert_eq!(map.flags[3], flag::OCCUPIED | flag::EXPOSED | flag::GAP | flag::HOLES);
        assert_eq!(map.gaps, [[16, 80]], "the widest gap is exact");
        let columns = map.columns();
        let texels = &columns[3].as_ref().unwrap().strip.as_ref().unwrap().texels;
        let alphas: Vec<u8> = texels.iter().map(|t| t.alpha()).collect();
        assert_eq!(alphas, [3, 3, 3, 3, 3, 3, 0, 0, 3, 3, 3, 3, 3], "the narrower one is transparent texels");
        let wall = &columns[1].as_ref().unwrap().strip.as_ref().unwrap().texels;
        assert!(wall.windows(2).all(|w| w[0].rgb()[0] < w[1].rgb()[0]), "rows run from the bottom up");
    }

    #[test]
    fn a_wall_inside_its_cell() {
        let clipped = |outer| {
            let plane = VoxelPlane { normal: [0.0, -1.0], offset_m: -0.25 };
            let clip = VoxelClip { plane, corner: None, outer };
            map(vec![VoxelColumn { clip: Some(clip), ..column(&[[7.0, 20.0]], true) }]).clips[0]
        };
        assert_eq!(clipped(None), ColumnClip { offset: -32, corner: None, outer: None });
        assert_eq!(clipped(Some((9.0, Look::default()))).outer.unwrap().z, 32);
        assert_eq!(clipped(Some((7.0, Look::default()))).outer, None, "no higher than the bottom is nothing");
    }

    #[test]
    fn tall_nodes_take_coarser_steps() {
        let map = map(vec![column(&[[0.0, 800.0]], true)]);
        assert_eq!(map.z_shift, 2);
        assert_eq!(map.z_max[0], 3200);
    }
}
