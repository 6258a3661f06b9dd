//! Parents from their children (design 4): four columns become one.
//!
//! In: up to four children's maps. Out: the parent's [`VoxelNode`]. Next: `parametrise`.
//!
//! The parent is made as a leaf is: 16 lines through each of its cells, here through the children's columns, and what at
//! least half of them agree on.

use crate::{
    columns::{
        clip::{Clip, Plane, Wall, merge_with_walls},
        merge::{LINES, Line, Merged, line_at},
        voxels::{Look, Solid, VoxelClip, VoxelColumn, VoxelNode},
    },
    sample::{mend, solids::open_side, texture::linear},
    scene::grid::CityGrid,
};
use glam::{Vec2, Vec3};
use insula_protocol::{
    BlockMap, NODE_CELLS, Texel, TileId,
    blockmap::{CLIP_STEPS_PER_CELL, COLUMNS, MapColumn},
    octahedral,
    texel::AO_MAX,
};

/// How far, in cells, a grounded column reaches under the lowest top around.
const SKIRT: f32 = 0.25;

/// A child's column in metres.
struct Fine {
    merged: Merged,
    grounded: bool,
    normal: Vec3,
    roof: Look,
    /// Beyond the wall inside its cell.
    outer: Option<Look>,
    /// Azimuth, row of the first look in the child's cells above height zero, looks.
    wall: Option<(Vec2, i32, Vec<Look>)>,
}

/// The parent's columns from its children's, given in quadrant order.
pub fn parent(grid: &CityGrid, id: TileId, children: [Option<&BlockMap>; 4]) -> VoxelNode {
    let cell_m = grid.cell_m_at(id.level()) as f32;
    let fine: [Vec<Option<Fine>>; 4] = children.map(|map| map.map_or_else(Vec::new, fine_columns));
    let mut merged: Vec<Merged> = (0..COLUMNS).map(|i| merge_four(&four(&fine, i), cell_m)).collect();
    let grounded: Vec<bool> = (0..COLUMNS).map(|i| four(&fine, i).into_iter().flatten().any(|f| f.grounded)).collect();
    sink(&mut merged, &grounded, cell_m);
    let mut node = VoxelNode::empty(id);
    for i in 0..COLUMNS {
        if !merged[i].solids.is_empty() {
            node.columns[i] = Some(column(&merged, i, &four(&fine, i), grounded[i], cell_m));
        }
    }
    mend::fill(&mut node);
    node
}

/// The four child columns under the parent's column `i`, in quadrant order.
fn four(fine: &[Vec<Option<Fine>>; 4], i: usize) -> [Option<&Fine>; 4] {
    let (x, y) = (i % NODE_CELLS * 2, i / NODE_CELLS * 2);
    std::array::from_fn(|q| {
        let (x, y) = (x + (q & 1), y + (q >> 1));
        let child = (x / NODE_CELLS) | ((y / NODE_CELLS) << 1);
        fine[child].get(y % NODE_CELLS * NODE_CELLS + x % NODE_CELLS)?.as_ref()
    })
}

fn fine_columns(map: &BlockMap) -> Vec<Option<Fine>> {
    let step_m = map.z_step_m();
    let base_m = map.z_base_m() as f32;
    let metres = |code: u16| base_m + f32::from(code) * step_m;
    map.columns().iter().map(|column| Some(fine_column(column.as_ref()?, map, metres))).collect()
}

fn fine_column(column: &MapColumn, map: &BlockMap, metres: impl Fn(u16) -> f32) -> Fine {
    let solids = match column.gap {
        Some([low, high]) => vec![
            Solid { bottom_m: metres(column.z_min), top_m: metres(low) },
            Solid { bottom_m: metres(high), top_m: metres(column.z_max) },
        ],
        None => vec![Solid { bottom_m: metres(column.z_min), top_m: metres(column.z_max) }],
    };
    let normal = Vec3::from_array(octahedral::decode(column.roof_normal));
    let slope = if column.inclined { [-normal.x / normal.z.max(0.1), -normal.y / normal.z.max(0.1)] } else { [0.0; 2] };
    let wall = column.strip.as_ref().map(|strip| {
        let first = insula_protocol::blockmap::strip_rows(column.z_min, column.z_max, map.z_shift).0;
        let looks = strip.texels.iter().map(|t| look(*t)).collect();
        (direction(strip.azimuth), map.z_base_cells + i32::from(first), looks)
    });
    let plane = |normal: Vec2, offset: i8| Plane {
        normal,
        offset_m: f32::from(offset) / CLIP_STEPS_PER_CELL as f32 * map.cell_m,
    };
    let clip = column.clip.zip(wall.as_ref()).map(|(clip, (normal, ..))| Clip {
        plane: plane(*normal, clip.offset),
        corner: clip.corner.map(|c| (plane(direction(c.azimuth), c.offset), c.concave)),
        outer_top_m: clip.outer.map(|outer| metres(outer.z)),
    });
    Fine {
        merged: Merged { solids, slope, inclined: column.inclined, clip },
        grounded: !column.suspended,
        normal,
        roof: look(column.roof),
        outer: column.clip.and_then(|clip| clip.outer).map(|outer| look(outer.roof)),
        wall,
    }
}

fn direction(azimuth: u8) -> Vec2 {
    Vec2::from_angle(f32::from(azimuth) / 256.0 * std::f32::consts::TAU)
}

fn look(texel: Texel) -> Look {
    let alpha = f32::from(texel.alpha()) / f32::from(insula_protocol::texel::ALPHA_MAX);
    Look { rgb: linear(texel.rgb()).to_array(), ao: f32::from(texel.ao()) / f32::from(AO_MAX), alpha }
}

fn merge_four(four: &[Option<&Fine>; 4], cell_m: f32) -> Merged {
    // Thin ground columns at four heights have nothing in common: all that stand on the ground reach equally deep.
    let lowest = four
        .iter()
        .flatten()
        .filter(|f| f.grounded)
        .filter_map(|f| Some(f.merged.solids.first()?.bottom_m))
        .fold(f32::INFINITY, f32::min);
    let lines: Vec<Line> = (0..LINES * LINES)
        .map(|i| {
            let at = line_at(i, cell_m);
            let q = usize::from(at.x > 0.0) | usize::from(at.y > 0.0) << 1;
            let Some(fine) = four[q] else { return Line { at, runs: Vec::new() } };
            let mut runs = fine.merged.runs_at(at - centre(q, cell_m));
            if let (true, Some(first)) = (fine.grounded, runs.first_mut()) {
                first.bottom_m = lowest;
            }
            Line { at, runs }
        })
        .collect();
    let walls: Vec<Wall> =
        (0..4).filter_map(|q| Some((four[q]?, q))).flat_map(|(f, q)| walls_of(f, q, cell_m)).collect();
    merge_with_walls(&lines, Vec::new, &walls, cell_m)
}

/// Centre of the child in quadrant `q`, from the parent's.
fn centre(q: usize, cell_m: f32) -> Vec2 {
    (Vec2::new((q & 1) as f32, (q >> 1) as f32) - 0.5) * (0.5 * cell_m)
}

/// Where a child's walls stand: inside its cell, or else on its border.
fn walls_of(fine: &Fine, q: usize, cell_m: f32) -> Vec<Wall> {
    let Some((normal, _, looks)) = fine.wall.as_ref() else { return Vec::new() };
    let border = Plane { normal: *normal, offset_m: 0.25 * cell_m * normal.abs().max_element() };
    let planes = match fine.merged.clip {
        None => vec![border],
        Some(Clip { plane, corner: None, .. }) => vec![plane],
        Some(Clip { plane, corner: Some((second, _)), .. }) => vec![plane, second],
    };
    let area_m2 = looks.len() as f32 * 0.25 * cell_m * cell_m / planes.len() as f32;
    let wall =
        |plane: Plane| Wall { normal: plane.normal, at: centre(q, cell_m) + plane.normal * plane.offset_m, area_m2 };
    planes.into_iter().map(wall).collect()
}

/// Lets grounded columns that end above the lowest top around reach under it: there would be a gap between the two.
fn sink(merged: &mut [Merged], grounded: &[bool], cell_m: f32) {
    let lows: Vec<f32> = merged.iter().map(|m| m.solids.first().map_or(f32::INFINITY, |s| s.top_m)).collect();
    let n = NODE_CELLS as i32;
    for i in (0..COLUMNS).filter(|i| grounded[*i]) {
        let (x, y) = (i as i32 % n, i as i32 / n);
        let mut lowest = lows[i];
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
            let (x, y) = (x + dx, y + dy);
            if (0..n).contains(&x) && (0..n).contains(&y) {
                lowest = lowest.min(lows[(y * n + x) as usize]);
            }
        }
        if let Some(first) = merged[i].solids.first_mut().filter(|first| lowest < first.bottom_m) {
            first.bottom_m = lowest - SKIRT * cell_m;
        }
    }
}

fn column(merged: &[Merged], i: usize, four: &[Option<&Fine>; 4], grounded: bool, cell_m: f32) -> VoxelColumn {
    let own = &merged[i];
    let top = own.solids.last().map_or(0.0, |s| s.top_m);
    let exposed = exposed(merged, i, four, grounded, cell_m);
    let (first, last) = (own.solids[0], own.solids[own.solids.len() - 1]);
    let solids = if exposed { own.solids.clone() } else { vec![Solid { bottom_m: first.bottom_m, top_m: last.top_m }] };
    // The roof is what lies at the column's top; a lower terrace beside it does not tint it.
    let at_top = |f: &&Fine| f.merged.solids.last().is_some_and(|s| (s.top_m - top).abs() < cell_m);
    let near: Vec<&Fine> = four.iter().flatten().copied().filter(at_top).collect();
    let all: Vec<&Fine> = four.iter().flatten().copied().collect();
    let tops = if near.is_empty() { &all } else { &near };
    let [sx, sy] = own.slope;
    let mean_normal = tops.iter().map(|f| f.normal).sum::<Vec3>().normalize_or(Vec3::Z);
    let normal = if own.inclined { Vec3::new(-sx, -sy, 1.0).normalize_or(Vec3::Z) } else { mean_normal };
    let first_row = (first.bottom_m / cell_m).floor() as i32;
    let rows = if exposed { ((last.top_m / cell_m).ceil() as i32 - first_row).clamp(1, 4096) } else { 0 };
    let walls = all.iter().filter_map(|f| f.wall.as_ref());
    let mut clip = own.clip.map(VoxelClip::from);
    if let Some((top_m, look)) = clip.as_mut().and_then(|clip| clip.outer.as_mut()) {
        *look = lower(&all, *top_m, cell_m);
    }
    let mean_wall = walls.map(|(n, _, looks)| *n * looks.len() as f32).sum::<Vec2>().to_array();
    VoxelColumn {
        clip,
        solids,
        inclined: own.inclined,
        suspended: !grounded,
        normal: normal.to_array(),
        roof: mean(tops.iter().map(|f| f.roof)),
        exposed,
        wall_normal: clip.map_or(mean_wall, |clip| clip.plane.normal),
        first_row,
        wall: (first_row..first_row + rows).map(|row| wall_row(&all, row)).collect(),
    }
}

/// Mean look of the children's tops, and of what lies beyond their walls, that are about as high.
fn lower(children: &[&Fine], z_m: f32, cell_m: f32) -> Look {
    let tops = children.iter().flat_map(|f| {
        let roof = f.merged.solids.last().map(|s| (s.top_m, f.roof));
        [roof, f.merged.clip.and_then(|clip| clip.outer_top_m).zip(f.outer)].into_iter().flatten()
    });
    mean(tops.filter(|(top, _)| (top - z_m).abs() < cell_m).map(|(_, look)| look))
}

/// As in a leaf; on the node's rim, where the neighbour is not known, as the children had it.
fn exposed(merged: &[Merged], i: usize, four: &[Option<&Fine>; 4], grounded: bool, cell_m: f32) -> bool {
    let n = NODE_CELLS as i32;
    let (x, y) = (i as i32 % n, i as i32 / n);
    let rim = x == 0 || y == 0 || x == n - 1 || y == n - 1;
    let hangs = !grounded && merged[i].is_slab(cell_m);
    if merged[i].clip.is_some()
        || merged[i].solids.len() > 1
        || hangs
        || rim && four.iter().flatten().any(|f| f.wall.is_some())
    {
        return true;
    }
    [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().any(|(dx, dy)| {
        let (nx, ny) = (x + dx, y + dy);
        if !(0..n).contains(&nx) || !(0..n).contains(&ny) {
            return false;
        }
        let other = Some(&merged[(ny * n + nx) as usize]);
        open_side(&merged[i], other, Vec2::new(dx as f32, dy as f32) * (0.5 * cell_m)) > cell_m
    })
}

/// Two rows of each child that has a wall there.
fn wall_row(children: &[&Fine], row: i32) -> Look {
    mean(children.iter().filter_map(|f| f.wall.as_ref()).flat_map(|(_, first, looks)| {
        [row * 2, row * 2 + 1].into_iter().filter_map(move |r| looks.get(usize::try_from(r - first).ok()?).copied())
    }))
}

fn mean(looks: impl Iterator<Item = Look>) -> Look {
    let (mut rgb, mut ao, mut weight) = ([0.0; 3], 0.0, 0.0);
    for look in looks {
        rgb = [0, 1, 2].map(|k| rgb[k] + look.rgb[k] * look.alpha);
        ao += look.ao * look.alpha;
        weight += look.alpha;
    }
    if weight <= 0.0 { Look::default() } else { Look { rgb: rgb.map(|v| v / weight), ao: ao / weight, alpha: 1.0 } }
}
