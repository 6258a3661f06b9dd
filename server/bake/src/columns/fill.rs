//! Appearance for voxels that no surfel reached: it spreads from the nearest voxels that have some.
//!
//! Rows of a wall take the nearest row of the same wall. Then up to [`PASSES`] passes over the node copy means of the
//! eight neighbouring columns, so that appearance travels one cell per pass. What is still unknown takes the column's
//! own wall or roof, or else [`GREY`]. Afterwards every appearance of the node is known.
//!
//! Objects spread in the same way: from the same column, else from the nearest neighbour at the same height.

use crate::columns::voxels::{VoxelAppearance, VoxelColumn, VoxelNode, VoxelOuterTop};
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::NO_OBJECT;

/// Used where no neighbour within [`PASSES`] cells is known.
const GREY: VoxelAppearance = VoxelAppearance { rgb: [0.4; 3], ao: 0.5, is_known: true };
/// Largest distance, in cells, that appearance spreads from other columns.
const PASSES: usize = 8;
/// Tops of neighbours count as equally high if they differ by less, in metres.
const SIMILAR_TOP_M: f32 = 2.0;

/// Appearances found around one column.
struct FoundAppearance {
    column: usize,
    roof: VoxelAppearance,
    outer: VoxelAppearance,
    wall: Vec<VoxelAppearance>,
}

/// Makes every appearance of the node known.
pub(crate) fn fill_unknown(node: &mut VoxelNode) {
    fill_objects(node);
    for column in node.columns.iter_mut().flatten() {
        fill_rows(&mut column.wall);
    }
    for _ in 0..PASSES {
        let incomplete: Vec<usize> =
            (0..node.columns.len()).filter(|i| is_incomplete(node.columns[*i].as_ref())).collect();
        if incomplete.is_empty() {
            return;
        }
        // All columns are read before any is changed, so that the order of columns does not matter.
        let found: Vec<FoundAppearance> = incomplete.into_iter().map(|i| find_around(node, i)).collect();
        for found in found {
            if let Some(column) = node.columns[found.column].as_mut() {
                apply(column, &found);
            }
        }
    }
    node.columns.iter_mut().flatten().for_each(fill_from_self);
}

/// Gives roofs and walls without an object that of the column's other parts, else of a neighbour at the same height.
fn fill_objects(node: &mut VoxelNode) {
    for column in node.columns.iter_mut().flatten() {
        let objects = &mut column.objects;
        objects.roof = known_or(objects.roof, objects.wall);
        objects.wall = known_or(objects.wall, objects.roof);
    }
    for _ in 0..PASSES {
        let nameless = |column: &VoxelColumn| column.objects.roof == NO_OBJECT;
        let list: Vec<usize> =
            (0..node.columns.len()).filter(|i| node.columns[*i].as_ref().is_some_and(nameless)).collect();
        let found: Vec<(usize, u32)> = list.into_iter().map(|i| (i, object_around(node, i))).collect();
        if found.iter().all(|(_, object)| *object == NO_OBJECT) {
            break;
        }
        for (i, object) in found {
            if let Some(column) = node.columns[i].as_mut() {
                column.objects.roof = object;
                column.objects.wall = known_or(column.objects.wall, object);
            }
        }
    }
    for column in node.columns.iter_mut().flatten() {
        column.objects.lower = known_or(column.objects.lower, column.objects.roof);
    }
}

fn known_or(object: u32, other: u32) -> u32 {
    if object == NO_OBJECT { other } else { object }
}

/// The object of the neighbouring roof whose height is the most similar.
fn object_around(node: &VoxelNode, i: usize) -> u32 {
    let top_m = |column: &VoxelColumn| column.solids.last().map_or(0.0, |run| run.top_m);
    let Some(own_m) = node.columns[i].as_ref().map(top_m) else { return NO_OBJECT };
    let known = neighbours(node, i).filter(|column| column.objects.roof != NO_OBJECT);
    let nearest = known.min_by(|a, b| (top_m(a) - own_m).abs().total_cmp(&(top_m(b) - own_m).abs()));
    nearest
        .filter(|column| (top_m(column) - own_m).abs() < SIMILAR_TOP_M)
        .map_or(NO_OBJECT, |column| column.objects.roof)
}

fn is_unknown(appearance: &VoxelAppearance) -> bool {
    !appearance.is_known
}

/// The appearance beyond the column's clip, if it is unknown.
fn unknown_outer(column: &mut VoxelColumn) -> Option<&mut VoxelAppearance> {
    let outer = column.clip.as_mut()?.outer.as_mut()?;
    Some(&mut outer.appearance).filter(|appearance| is_unknown(appearance))
}

fn is_incomplete(column: Option<&VoxelColumn>) -> bool {
    column.is_some_and(|column| {
        let outer = column.clip.and_then(|clip| clip.outer);
        is_unknown(&column.roof)
            || outer.is_some_and(|outer| is_unknown(&outer.appearance))
            || column.wall.iter().any(is_unknown)
    })
}

/// Sets the unknown appearances of a column to what was found around it.
fn apply(column: &mut VoxelColumn, found: &FoundAppearance) {
    if let Some(outer) = unknown_outer(column) {
        *outer = found.outer;
    }
    if is_unknown(&column.roof) {
        column.roof = found.roof;
    }
    for (own, appearance) in column.wall.iter_mut().zip(&found.wall) {
        if is_unknown(own) {
            *own = *appearance;
        }
    }
    fill_rows(&mut column.wall);
}

/// Sets the unknown appearances of a column to those of its own wall or roof, or else to [`GREY`].
fn fill_from_self(column: &mut VoxelColumn) {
    if is_unknown(&column.roof) {
        let wall = column.wall.last().copied().filter(|wall| wall.is_known);
        column.roof = wall.unwrap_or(GREY);
    }
    let roof = column.roof;
    if let Some(outer) = unknown_outer(column) {
        *outer = roof;
    }
    column.wall.iter_mut().filter(|wall| is_unknown(wall)).for_each(|wall| *wall = roof);
}

/// Sets each unknown row to the nearest known one; the lower of two that are equally near.
fn fill_rows(rows: &mut [VoxelAppearance]) {
    let known: Vec<usize> = (0..rows.len()).filter(|i| rows[*i].is_known).collect();
    if known.is_empty() || known.len() == rows.len() {
        return;
    }
    for i in (0..rows.len()).filter(|i| known.binary_search(i).is_err()).collect::<Vec<_>>() {
        let after = known.partition_point(|row| *row < i);
        let neighbours = [after.checked_sub(1), (after < known.len()).then_some(after)];
        let nearest = neighbours.into_iter().flatten().map(|k| known[k]).min_by_key(|row| row.abs_diff(i));
        if let Some(nearest) = nearest {
            rows[i] = rows[nearest];
        }
    }
}

fn find_around(node: &VoxelNode, i: usize) -> FoundAppearance {
    let own = node.columns[i].as_ref();
    let mean_at_height = |top: Option<VoxelOuterTop>| {
        top.map_or(VoxelAppearance::default(), |top| mean_of_tops_around(node, i, top.top_m))
    };
    FoundAppearance {
        column: i,
        roof: mean_at_height(own.and_then(|column| tops(column).next())),
        outer: mean_at_height(own.and_then(|column| column.clip?.outer)),
        wall: wall_around(node, i),
    }
}

/// The up to eight columns around column `i`.
fn neighbours(node: &VoxelNode, i: usize) -> impl Iterator<Item = &VoxelColumn> {
    let (x, y) = ((i % NODE_CELLS) as i32, (i / NODE_CELLS) as i32);
    let steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
    steps.into_iter().filter_map(move |(dx, dy)| {
        let (x, y) = (usize::try_from(x + dx).ok()?, usize::try_from(y + dy).ok()?);
        if x >= NODE_CELLS { None } else { node.columns.get(y * NODE_CELLS + x)?.as_ref() }
    })
}

/// The column's roof, and the top beyond its clip.
fn tops(column: &VoxelColumn) -> impl Iterator<Item = VoxelOuterTop> {
    let roof = VoxelOuterTop { top_m: column.solids.last().map_or(0.0, |run| run.top_m), appearance: column.roof };
    [Some(roof), column.clip.and_then(|clip| clip.outer)].into_iter().flatten()
}

/// Mean of the neighbours' tops at about the height `z_m`; of all their roofs if none is known there.
fn mean_of_tops_around(node: &VoxelNode, i: usize, z_m: f32) -> VoxelAppearance {
    let similar = neighbours(node, i).flat_map(tops).filter(|top| (top.top_m - z_m).abs() < SIMILAR_TOP_M);
    let mean = mean_of_known(similar.map(|top| top.appearance));
    if mean.is_known { mean } else { mean_of_known(neighbours(node, i).map(|column| column.roof)) }
}

/// The column's wall, its unknown rows as means of the neighbours' rows at the same height.
fn wall_around(node: &VoxelNode, i: usize) -> Vec<VoxelAppearance> {
    let Some(own) = node.columns[i].as_ref() else { return Vec::new() };
    let row_of =
        |column: &VoxelColumn, row: i32| column.wall.get(usize::try_from(row - column.first_row).ok()?).copied();
    (0..own.wall.len())
        .map(|k| {
            let row = own.first_row + k as i32;
            if own.wall[k].is_known {
                own.wall[k]
            } else {
                mean_of_known(neighbours(node, i).filter_map(|column| row_of(column, row)))
            }
        })
        .collect()
}

/// Unweighted mean of the known appearances; unknown if there is none.
pub(crate) fn mean_of_known(appearances: impl Iterator<Item = VoxelAppearance>) -> VoxelAppearance {
    let (mut sum, mut n) = (VoxelAppearance::default(), 0.0);
    for appearance in appearances.filter(|appearance| appearance.is_known) {
        sum.rgb = [0, 1, 2].map(|k| sum.rgb[k] + appearance.rgb[k]);
        sum.ao += appearance.ao;
        n += 1.0;
    }
    if n == 0.0 { sum } else { VoxelAppearance { rgb: sum.rgb.map(|v| v / n), ao: sum.ao / n, is_known: true } }
}
