//! A V-BlockMap from a node's columns: heights become codes, linear light becomes sRGB texels (Vacca 2008, 3.3).
//!
//! In: [`VoxelNode`]. Out: [`BlockMap`]. Next: `protocol` encodes it, `write` stores it.
//!
//! Heights are counted in steps from a base of whole cells. A column stores its bottom and top, at most one exact gap,
//! and an exposed column a strip of wall texels, one per cell of height. Other gaps become open texels.

use crate::columns::code_gaps::{CodeGap, exact_gap, gaps_between};
use crate::columns::srgb::srgb_from_linear;
use crate::columns::voxels::{VoxelAppearance, VoxelClip, VoxelColumn, VoxelGround, VoxelNode, VoxelPlane};
use crate::scene::grid::CityGrid;
use insula_protocol::blockmap::ground::{self, HEIGHTS_PER_CELL, MAX_HEIGHT, SKY_MAX, VERTICES, is_used_vertex};
use insula_protocol::blockmap::objects::lower_tops;
use insula_protocol::blockmap::{
    CLIP_STEPS_PER_CELL, ColumnClip, ColumnObjects, CornerWall, MAX_TEXELS, MapColumn, NodeGround, OuterTop,
    STEPS_PER_CELL, ThinShare, WallStrip, Z_CODE_MAX, Z_SHIFT_MAX, flag, strip_rows,
};
use insula_protocol::texel::AO_MAX;
use insula_protocol::{BlockMap, DecodeError, NODE_CELLS, Texel, octahedral};
use std::ops::Range;

/// Conversion of metres to the height codes of one node.
struct HeightCodes {
    cell_m: f64,
    base_cells: i32,
    base_m: f64,
    step_m: f64,
    shift: u8,
    is_leaf: bool,
    /// Whether the node has generated ground.
    has_ground: bool,
}

/// The height codes that a column occupies.
struct CodeRange {
    z_min: u16,
    z_max: u16,
    /// The gap that is stored exactly.
    gap: Option<[u16; 2]>,
    /// All others.
    other_gaps: Vec<CodeGap>,
    /// Whether the run above the exact gap, or the only one, is a thin object.
    is_thin: bool,
    /// Open rows within the exact gap. Readers replace that gap by the one above generated ground.
    replaced_rows: Range<u16>,
}

impl CodeRange {
    /// The range of a column without gaps.
    fn whole(z_min: u16, z_max: u16) -> Self {
        Self { z_min, z_max, gap: None, other_gaps: Vec::new(), is_thin: false, replaced_rows: 0..0 }
    }
}

impl HeightCodes {
    /// The finest step at which the node's heights fit into 12 bits. Columns that are too tall even for the coarsest
    /// step are cut off at the top.
    fn new(node: &VoxelNode, grid: &CityGrid) -> Self {
        let (level, cell_m) = (node.id.level(), grid.cell_m_at(node.id.level()));
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for solid in node.columns.iter().flatten().flat_map(|column| &column.solids) {
            low = low.min(solid.bottom_m);
            high = high.max(solid.top_m);
        }
        if let Some(ground) = &node.ground {
            let (lowest, highest) = ground
                .heights_m
                .iter()
                .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), z| (low.min(*z), high.max(*z)));
            // The columns of the ground reach below its surface.
            low = low.min(lowest - 2.0 * cell_m as f32);
            high = high.max(highest);
        }
        let (low, high) = if low <= high { (f64::from(low), f64::from(high)) } else { (0.0, 0.0) };
        // The cast saturates: heights beyond 2^31 cells do not exist on Earth.
        let base_cells = (low / cell_m).floor() as i32;
        let base_m = f64::from(base_cells) * cell_m;
        let step_m = |shift: u8| cell_m / f64::from(STEPS_PER_CELL) * f64::from(1u16 << shift);
        let fits = |shift: &u8| (high - base_m) / step_m(*shift) < f64::from(Z_CODE_MAX);
        let shift = (0..=Z_SHIFT_MAX).find(fits).unwrap_or(Z_SHIFT_MAX);
        let (is_leaf, has_ground) = (level >= grid.depth, node.ground.is_some());
        Self { cell_m, base_cells, base_m, step_m: step_m(shift), shift, is_leaf, has_ground }
    }

    fn encode(&self, z_m: f32) -> u16 {
        ((f64::from(z_m) - self.base_m) / self.step_m).round().clamp(0.0, f64::from(Z_CODE_MAX)) as u16
    }
}

/// The node's V-BlockMap.
///
/// Columns past the limit of [`MAX_TEXELS`] strip texels lose their strips, gaps and clips.
///
/// # Errors
///
/// Fails if the result exceeds a limit of the format all the same.
pub fn parametrise(grid: &CityGrid, node: &VoxelNode) -> Result<BlockMap, DecodeError> {
    let codes = HeightCodes::new(node, grid);
    let ground = node.ground.as_ref().map(|ground| Box::new(encode_ground(ground, &codes)));
    let rounded = ground.as_deref().filter(|_| !codes.is_leaf).map(NodeGround::surface);
    let mut texels = 0;
    let columns: Vec<Option<MapColumn>> = node
        .columns
        .iter()
        .enumerate()
        .map(|(i, column)| {
            let mut column = encode_column(column.as_ref()?, &codes);
            let at = |n: usize| n as f32 + 0.5;
            if let Some(point) = rounded.as_ref().and_then(|ground| ground.at(at(i % NODE_CELLS), at(i / NODE_CELLS))) {
                raise_above_ground(&mut column, point.z, codes.shift);
            }
            texels += column.strip.as_ref().map_or(0, |strip| strip.texels.len());
            if texels > MAX_TEXELS {
                // Happens with towers everywhere at a tiny cell. Without a strip the sides show the roof's colour.
                column.strip = None;
                column.gap = None;
                column.clip = None;
                column.thin = None;
            }
            Some(column)
        })
        .collect();
    let mut map = BlockMap::from_columns(node.id, codes.cell_m as f32, codes.base_cells, codes.shift, &columns)?;
    map.snap_hidden_bottoms();
    map.objects = encode_objects(node, &map);
    map.ground = ground;
    Ok(map)
}

/// The objects of the parts that the map has; `None` if they have none.
fn encode_objects(node: &VoxelNode, map: &BlockMap) -> Option<Box<ColumnObjects>> {
    let mut objects = Box::<ColumnObjects>::default();
    let lower_tops = lower_tops(map);
    for (i, column) in node.columns.iter().enumerate() {
        let Some(column) = column else { continue };
        objects.roof[i] = column.objects.roof;
        if map.flags[i] & flag::EXPOSED != 0 {
            objects.wall[i] = column.objects.wall;
        }
        if lower_tops[i].is_some() {
            objects.lower[i] = column.objects.lower;
        }
    }
    (!objects.distinct().is_empty()).then_some(objects)
}

fn encode_ground(ground: &VoxelGround, codes: &HeightCodes) -> NodeGround {
    let height = |z_m: f32| (f64::from(z_m) - codes.base_m) / codes.cell_m * f64::from(HEIGHTS_PER_CELL);
    let exact = ground.heights_m.map(|z_m| height(z_m) as f32);
    let corners = ground.corners.map_or_else(|| ground::corners_of(&exact), ground::close_corners);
    let mut encoded = NodeGround { squares: ground.squares, corners, ..NodeGround::default() };
    for (i, height) in exact.into_iter().enumerate() {
        if corners >> i & 1 == 1 {
            encoded.heights[i] = height.round().clamp(0.0, f32::from(MAX_HEIGHT)) as u16;
        }
        if is_used_vertex(ground.squares, i % VERTICES, i / VERTICES) {
            encoded.sky[i] = (ground.sky[i].clamp(0.0, 1.0) * f32::from(SKY_MAX)).round() as u8;
        }
    }
    encoded
}

/// Raises a column that ground at `ground_z` cells would just hide. In parents the ground's heights are rounded by much, and roads
/// and parks lie only a little above it.
fn raise_above_ground(column: &mut MapColumn, ground_z: f32, shift: u8) {
    let codes_per_cell = STEPS_PER_CELL >> shift;
    let ground = (ground_z * f32::from(codes_per_cell)).round().max(1.0) as u16;
    if column.z_max > ground || ground - column.z_max > codes_per_cell / 2 || ground >= Z_CODE_MAX {
        return;
    }
    column.z_max = ground + 1;
    if let Some(strip) = &mut column.strip {
        let rows = usize::from(strip_rows(column.z_min, column.z_max, shift).1);
        let last = strip.texels.last().copied().unwrap_or(column.roof);
        strip.texels.resize(rows, last);
    }
}

fn encode_column(column: &VoxelColumn, codes: &HeightCodes) -> MapColumn {
    let bottom_m = column.solids.first().map_or(0.0, |run| run.bottom_m);
    let top_m = column.solids.last().map_or(0.0, |run| run.top_m);
    let z_max = codes.encode(top_m).max(1);
    let z_min = codes.encode(bottom_m).min(z_max - 1);
    let range = if column.exposed { code_range(column, codes, z_min, z_max) } else { CodeRange::whole(z_min, z_max) };
    MapColumn {
        z_min,
        z_max,
        inclined: column.inclined,
        suspended: column.suspended,
        gap: range.gap,
        roof: encode_texel(&column.roof),
        roof_normal: octahedral::encode(column.normal),
        strip: column.exposed.then(|| encode_strip(column, codes, &range)),
        clip: column.clip.filter(|_| column.exposed).map(|clip| encode_clip(&clip, codes, &range)),
        reflective: column.reflective,
        thin: column.thin.filter(|_| range.is_thin).map(|shares| ThinShare::new(shares.side, shares.top)),
    }
}

fn encode_clip(clip: &VoxelClip, codes: &HeightCodes, range: &CodeRange) -> ColumnClip {
    let offset = |plane: &VoxelPlane| {
        let steps = (f64::from(plane.offset_m) / codes.cell_m * f64::from(CLIP_STEPS_PER_CELL)).round();
        steps.clamp(-128.0, 127.0) as i8
    };
    let corner = clip.corner.map(|corner| CornerWall {
        azimuth: encode_azimuth(corner.plane.normal),
        offset: offset(&corner.plane),
        concave: corner.concave,
    });
    let outer = clip.outer.and_then(|outer| {
        let z = codes.encode(outer.top_m).min(range.z_max - 1);
        (z > range.z_min).then(|| OuterTop { z, roof: encode_texel(&outer.appearance) })
    });
    ColumnClip { offset: offset(&clip.plane), corner, outer }
}

/// Direction in 256ths of a turn, counter-clockwise from east.
fn encode_azimuth([x, y]: [f32; 2]) -> u8 {
    let turn = (libm::atan2f(y, x) / std::f32::consts::TAU).rem_euclid(1.0);
    ((turn * 256.0).round() as u32 % 256) as u8
}

/// The range of a column with a wall strip: its widest gap is exact, or that of which rows would show the least.
fn code_range(column: &VoxelColumn, codes: &HeightCodes, z_min: u16, z_max: u16) -> CodeRange {
    if column.solids.len() < 2 {
        return CodeRange { is_thin: column.thin.is_some(), ..CodeRange::whole(z_min, z_max) };
    }
    let solids = column.solids.iter().map(|run| [codes.encode(run.bottom_m), codes.encode(run.top_m)]);
    let mut solids: Vec<[u16; 2]> = solids.collect();
    // Each end has at least one code.
    let last = solids.len() - 1;
    solids[0] = [z_min, solids[0][1].max(z_min + 1)];
    solids[last] = [solids[last][0].min(z_max - 1), z_max];
    // A leaf may be seen from near, so its rows leave no run out.
    let (codes_per_row, leaves_runs_out) = (STEPS_PER_CELL >> codes.shift, !codes.is_leaf);
    let top = solids[last - 1][1];
    if column.thin.is_some() && top + 1 < z_max {
        // What is thin begins above a gap, if only of one code.
        let other_gaps = gaps_between(&solids[..last], codes_per_row, leaves_runs_out);
        let gap = Some([top, solids[last][0].max(top + 1)]);
        return CodeRange { z_min, z_max, gap, other_gaps, is_thin: true, replaced_rows: 0..0 };
    }
    let mut other_gaps = gaps_between(&solids, codes_per_row, leaves_runs_out);
    let gap = exact_gap(&other_gaps).map(|i| other_gaps.remove(i).codes);
    let hangs = column.suspended && codes.has_ground;
    let replaced = gap.filter(|_| hangs).map(|[low, high]| low.div_ceil(codes_per_row)..high / codes_per_row);
    CodeRange { z_min, z_max, gap, other_gaps, is_thin: false, replaced_rows: replaced.unwrap_or(0..0) }
}

fn encode_strip(column: &VoxelColumn, codes: &HeightCodes, range: &CodeRange) -> WallStrip {
    let (first, rows) = strip_rows(range.z_min, range.z_max, codes.shift);
    let texels = (first..first + rows)
        .map(|row| {
            // Other rows inside the exact gap are never read. Opaque, they compress together with their neighbours.
            let is_open =
                range.replaced_rows.contains(&row) || range.other_gaps.iter().any(|gap| gap.open_rows.contains(&row));
            let at = codes.base_cells + i32::from(row) - column.first_row;
            let last = column.wall.len() as i32 - 1;
            if is_open {
                Texel::OPEN
            } else if last < 0 {
                encode_texel(&column.roof)
            } else {
                encode_texel(&column.wall[at.clamp(0, last) as usize])
            }
        })
        .collect();
    WallStrip { texels, azimuth: encode_azimuth(column.wall_normal) }
}

fn encode_texel(appearance: &VoxelAppearance) -> Texel {
    let ao = (appearance.ao.clamp(0.0, 1.0) * f32::from(AO_MAX)).round() as u8;
    Texel::new(srgb_from_linear(appearance.rgb), ao)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::voxels::{SolidRun, VoxelObjects, VoxelOuterTop};
    use insula_protocol::TileId;

    fn grid() -> CityGrid {
        CityGrid { corner: [0.0; 3], depth: 1, cell_m: 1.0 }
    }

    fn column(solids: &[[f32; 2]], exposed: bool) -> VoxelColumn {
        let solids: Vec<SolidRun> = solids.iter().map(|s| SolidRun { bottom_m: s[0], top_m: s[1] }).collect();
        let first_row = solids[0].bottom_m.floor() as i32;
        let rows = solids.last().unwrap().top_m.ceil() as i32 - first_row;
        let wall = (0..rows).map(|r| VoxelAppearance { rgb: [r as f32 / 64.0; 3], ao: 1.0, is_known: true }).collect();
        VoxelColumn {
            solids,
            inclined: false,
            suspended: false,
            normal: [0.0, 0.0, 1.0],
            roof: VoxelAppearance { rgb: [1.0; 3], ao: 0.5, is_known: true },
            exposed,
            wall_normal: [0.0, -1.0],
            first_row,
            wall: if exposed { wall } else { Vec::new() },
            clip: None,
            reflective: false,
            objects: VoxelObjects::default(),
            thin: None,
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
    fn encodes_the_four_kinds_of_columns() {
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
        let open: Vec<usize> = (0..texels.len()).filter(|row| texels[*row].is_open()).collect();
        assert_eq!((texels.len(), &open[..]), (13, &[6, 7][..]), "the narrower gap becomes open texels");
        let wall = &columns[1].as_ref().unwrap().strip.as_ref().unwrap().texels;
        assert!(wall.windows(2).all(|w| w[0].rgb()[0] < w[1].rgb()[0]), "rows run from the bottom up");
    }

    #[test]
    fn both_gaps_of_a_deck_above_another_stay_open_on_generated_ground() {
        let mut node = VoxelNode::empty(TileId::new(1, 0, 0).unwrap());
        node.columns[0] = Some(VoxelColumn { suspended: true, ..column(&[[6.0, 7.0], [12.0, 13.0]], true) });
        node.ground = VoxelGround::new([0.0; VERTICES * VERTICES], [1.0; VERTICES * VERTICES], u64::MAX, None);
        let map = parametrise(&grid(), &node).unwrap();
        assert_eq!(map.gaps.len(), 1);
        let column = map.stand_on_ground().columns()[0].clone().unwrap();
        let open = column.strip.unwrap().texels.iter().filter(|texel| texel.is_open()).count();
        assert_eq!((column.gap.map(|[low, high]| high - low), open), (Some(6 * STEPS_PER_CELL), 5));
    }

    #[test]
    fn encodes_a_wall_inside_its_cell() {
        let clipped = |outer| {
            let plane = VoxelPlane { normal: [0.0, -1.0], offset_m: -0.25 };
            let clip = VoxelClip { plane, corner: None, outer };
            map(vec![VoxelColumn { clip: Some(clip), ..column(&[[7.0, 20.0]], true) }]).clips[0]
        };
        let outer_at = |top_m| Some(VoxelOuterTop { top_m, appearance: VoxelAppearance::default() });
        assert_eq!(clipped(None), ColumnClip { offset: -32, corner: None, outer: None });
        assert_eq!(clipped(outer_at(9.0)).outer.unwrap().z, 32);
        assert_eq!(clipped(outer_at(7.0)).outer, None, "a top that is not above the bottom is dropped");
    }

    #[test]
    fn tall_nodes_use_coarser_height_steps() {
        let map = map(vec![column(&[[0.0, 800.0]], true)]);
        assert_eq!(map.z_shift, 2);
        assert_eq!(map.z_max[0], 3200);
    }
}
