//! Every voxel that can be seen gets a colour (design 5, steps 3 and 5).
//!
//! In: a [`VoxelNode`] whose unseen looks have no coverage. Out: the same with all of them filled. Next: `parametrise`.

use crate::columns::voxels::{VoxelAppearance, VoxelColumn, VoxelNode};
use insula_protocol::NODE_CELLS;

/// What nothing around has a colour for.
const GREY: VoxelAppearance = VoxelAppearance { rgb: [0.4; 3], ao: 0.5, alpha: 1.0 };
/// Passes over the node: colours come from at most so many cells away, then [`GREY`].
const PASSES: usize = 8;

/// Fills looks without coverage from the nearest that have some: a wall from its own rows, then from its neighbours' rows
/// of the same height; a roof from its neighbours, then from its wall. Used by `lod` as well.
pub(crate) fn fill(node: &mut VoxelNode) {
    for column in node.columns.iter_mut().flatten() {
        fill_rows(&mut column.wall);
    }
    for _ in 0..PASSES {
        let wanting: Vec<usize> = (0..node.columns.len()).filter(|i| wants(node.columns[*i].as_ref())).collect();
        if wanting.is_empty() {
            return;
        }
        let found: Vec<(usize, [VoxelAppearance; 2], Vec<VoxelAppearance>)> =
            wanting.into_iter().map(|i| (i, roofs_around(node, i), wall_around(node, i))).collect();
        for (i, [roof, lower], wall) in found {
            let Some(column) = node.columns[i].as_mut() else { continue };
            if let Some((_, look)) = outer(column).filter(|(_, look)| look.alpha == 0.0) {
                *look = lower;
            }
            if column.roof.alpha == 0.0 {
                column.roof = roof;
            }
            for (own, look) in column.wall.iter_mut().zip(wall) {
                if own.alpha == 0.0 {
                    *own = look;
                }
            }
            fill_rows(&mut column.wall);
        }
    }
    for column in node.columns.iter_mut().flatten() {
        let wall = column.wall.last().copied().filter(|l| l.alpha > 0.0);
        if column.roof.alpha == 0.0 {
            column.roof = wall.unwrap_or(GREY);
        }
        let roof = column.roof;
        if let Some((_, look)) = outer(column).filter(|(_, look)| look.alpha == 0.0) {
            *look = roof;
        }
        column.wall.iter_mut().filter(|l| l.alpha == 0.0).for_each(|l| *l = roof);
    }
}

/// What lies beyond a wall inside the column's cell.
fn outer(column: &mut VoxelColumn) -> Option<&mut (f32, VoxelAppearance)> {
    column.clip.as_mut()?.outer.as_mut()
}

fn wants(column: Option<&VoxelColumn>) -> bool {
    let empty = |look: &VoxelAppearance| look.alpha == 0.0;
    column.is_some_and(|c| {
        let outer = c.clip.and_then(|clip| clip.outer);
        empty(&c.roof) || outer.is_some_and(|(_, look)| empty(&look)) || c.wall.iter().any(empty)
    })
}

/// Each empty row from the nearest filled one, the lower of two as near.
fn fill_rows(rows: &mut [VoxelAppearance]) {
    let filled: Vec<usize> = (0..rows.len()).filter(|i| rows[*i].alpha > 0.0).collect();
    if filled.is_empty() || filled.len() == rows.len() {
        return;
    }
    for i in (0..rows.len()).filter(|i| filled.binary_search(i).is_err()).collect::<Vec<_>>() {
        let after = filled.partition_point(|f| *f < i);
        let candidates = [after.checked_sub(1), (after < filled.len()).then_some(after)];
        let nearest = candidates.into_iter().flatten().map(|k| filled[k]).min_by_key(|f| f.abs_diff(i));
        if let Some(nearest) = nearest {
            rows[i] = rows[nearest];
        }
    }
}

fn around(node: &VoxelNode, i: usize) -> impl Iterator<Item = &VoxelColumn> {
    let (x, y) = ((i % NODE_CELLS) as i32, (i / NODE_CELLS) as i32);
    let steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
    steps.into_iter().filter_map(move |(dx, dy)| {
        let (x, y) = (usize::try_from(x + dx).ok()?, usize::try_from(y + dy).ok()?);
        if x >= NODE_CELLS { None } else { node.columns.get(y * NODE_CELLS + x)?.as_ref() }
    })
}

fn mean(looks: impl Iterator<Item = VoxelAppearance>) -> VoxelAppearance {
    let (mut sum, mut n) = (VoxelAppearance::default(), 0.0);
    for look in looks.filter(|l| l.alpha > 0.0) {
        sum.rgb = [0, 1, 2].map(|k| sum.rgb[k] + look.rgb[k]);
        sum.ao += look.ao;
        n += 1.0;
    }
    if n == 0.0 { sum } else { VoxelAppearance { rgb: sum.rgb.map(|v| v / n), ao: sum.ao / n, alpha: 1.0 } }
}

/// For the column's top, and for what lies beyond its wall: the looks of the tops around that are about as high; of all if
/// none is.
fn roofs_around(node: &VoxelNode, i: usize) -> [VoxelAppearance; 2] {
    let tops = |c: &VoxelColumn| {
        let own = (c.solids.last().map_or(0.0, |s| s.top_m), c.roof);
        [Some(own), c.clip.and_then(|clip| clip.outer)].into_iter().flatten()
    };
    let at = |z: f32| {
        let near = mean(around(node, i).flat_map(tops).filter(|(top, _)| (top - z).abs() < 2.0).map(|(_, look)| look));
        if near.alpha > 0.0 { near } else { mean(around(node, i).map(|c| c.roof)) }
    };
    let own = node.columns[i].as_ref();
    let [roof, lower] = [own.and_then(|c| tops(c).next()), own.and_then(|c| c.clip?.outer)];
    [roof, lower].map(|top| top.map_or(VoxelAppearance::default(), |(z, _)| at(z)))
}

fn wall_around(node: &VoxelNode, i: usize) -> Vec<VoxelAppearance> {
    let Some(own) = node.columns[i].as_ref() else { return Vec::new() };
    let row_of = |c: &VoxelColumn, row: i32| c.wall.get(usize::try_from(row - c.first_row).ok()?).copied();
    (0..own.wall.len())
        .map(|k| {
            let row = own.first_row + k as i32;
            if own.wall[k].alpha > 0.0 { own.wall[k] } else { mean(around(node, i).filter_map(|c| row_of(c, row))) }
        })
        .collect()
}
