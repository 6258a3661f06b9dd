//! Points on the surfaces, half a cell apart, where colour, normal and occlusion are taken (design 5, step 1).
//!
//! In: [`LocalBlock`]. Out: [`SurfaceSample`]s. Next: `visibility` counts from where they are seen, `attributes` gives them to voxels.

use crate::sample::{
    local_block::{LocalBlock, LocalTriangle},
    rasterise::scan,
};
use glam::Vec3;

/// A candidate looks at every so many-th sky direction for its occlusion; its neighbours look at the others.
pub(super) const TURNS: usize = 4;

/// One point of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceSample {
    pub(super) p: Vec3,
    /// Into the block's triangles.
    pub(super) triangle: u32,
    /// Area that it stands for.
    pub(super) area_m2: f32,
    /// Which of [`TURNS`] shares of the directions it looks at; neighbours differ.
    pub(super) turn: u8,
    /// Which of the triangle's groups of [`TURNS`] neighbours it is in.
    group: u32,
    /// Cosines of the sky directions from which the front (the normal's side) and the back are seen.
    pub(super) sky: [f32; 2],
    /// Directions of any kind from which the front and the back are seen.
    pub(super) sightings: [u16; 2],
}

/// All candidates that lie over the block's cells, triangle by triangle, each triangle's by their turns.
pub(super) fn find(block: &LocalBlock) -> Vec<SurfaceSample> {
    let mut found = Vec::new();
    let spacing = block.cell_m * 0.5;
    for (index, triangle) in block.triangles.iter().enumerate() {
        if is_floor(block, triangle) {
            continue;
        }
        let before = found.len();
        let shortest = 2.0 * triangle.area_m2 / longest_edge(triangle).1;
        if shortest < 2.0 * spacing {
            slice(block, triangle, index as u32, spacing, &mut found);
        } else {
            raster(block, triangle, index as u32, spacing, &mut found);
        }
        found[before..].sort_by_key(|candidate| candidate.turn);
    }
    found
}

/// Gives the candidates of a group the mean of what they saw of the sky: alone, each has looked at a share of it only.
pub(super) fn share_sky(candidates: &mut [SurfaceSample]) {
    let mut order: Vec<u32> = Vec::new();
    for sheet in candidates.chunk_by_mut(|a, b| a.triangle == b.triangle) {
        order.clear();
        order.extend(0..sheet.len() as u32);
        order.sort_unstable_by_key(|i| (sheet[*i as usize].group, *i));
        let mut rest = &order[..];
        while let Some(first) = rest.first() {
            let group = sheet[*first as usize].group;
            let end = rest.iter().take_while(|i| sheet[**i as usize].group == group).count();
            let (members, after) = rest.split_at(end);
            let mean = [0, 1].map(|k| members.iter().map(|i| sheet[*i as usize].sky[k]).sum::<f32>() / end as f32);
            members.iter().for_each(|i| sheet[*i as usize].sky = mean);
            rest = after;
        }
    }
}

/// Whether nobody can see it: it lies at a closed shell's foot and faces down.
fn is_floor(block: &LocalBlock, triangle: &LocalTriangle) -> bool {
    let top = triangle.corners.iter().fold(f32::MIN, |m, c| m.max(c.z));
    triangle.closed && triangle.normal.z < -0.99 && top < triangle.base_z_m + 0.01 * block.cell_m
}

fn push(
    block: &LocalBlock,
    found: &mut Vec<SurfaceSample>,
    p: Vec3,
    triangle: u32,
    area_m2: f32,
    place: [usize; 2],
    group: [usize; 2],
) {
    let [width, height] = block.extent_m();
    // A wall on the block's rim may belong to the cell on its other side: half a cell more, dropped later if it does not.
    let rim = block.cell_m * 0.5;
    if p.x >= -rim && p.y >= -rim && p.x < width + rim && p.y < height + rim {
        let turn = ((place[0] & 1) | ((place[1] & 1) << 1)) as u8;
        let group = (group[0] as u16 as u32) << 16 | group[1] as u16 as u32;
        found.push(SurfaceSample { p, triangle, area_m2, turn, group, sky: [0.0; 2], sightings: [0; 2] });
    }
}

fn longest_edge(triangle: &LocalTriangle) -> (usize, f32) {
    let length = |i: usize| triangle.corners[i].distance(triangle.corners[(i + 1) % 3]);
    (0..3).map(|i| (i, length(i))).fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a })
}

/// A sliver: cut across its longest edge into pieces of equal length, and those along their height.
fn slice(block: &LocalBlock, triangle: &LocalTriangle, index: u32, spacing: f32, found: &mut Vec<SurfaceSample>) {
    let (edge, length) = longest_edge(triangle);
    let (a, b) = (triangle.corners[edge], triangle.corners[(edge + 1) % 3]);
    let apex = triangle.corners[(edge + 2) % 3];
    let n = (length / spacing).ceil().clamp(1.0, 65536.0) as u32;
    let height = 2.0 * triangle.area_m2 / length;
    let levels = (height / spacing).ceil().clamp(1.0, 4.0) as u32;
    for level in 0..levels {
        // Trapezoid between two lines parallel to the edge; f is the share of the way to the apex.
        let (f0, f1) = (level as f32 / levels as f32, (level + 1) as f32 / levels as f32);
        let share = (1.0 - f0) * (1.0 - f0) - (1.0 - f1) * (1.0 - f1);
        let f = f0 + (f1 - f0) * if level + 1 == levels { 1.0 / 3.0 } else { 0.5 };
        let pieces = ((n as f32 * (1.0 - f0)).ceil() as u32).max(1);
        for i in 0..pieces {
            let along = (i as f32 + 0.5) / pieces as f32;
            let p = a.lerp(b, along).lerp(apex, f);
            let place = [i as usize, level as usize + (i as usize >> 1)];
            let group = [i as usize / TURNS, level as usize];
            push(block, found, p, index, triangle.area_m2 * share / pieces as f32, place, group);
        }
    }
}

/// A broad triangle: the points of the world's grid on the plane of its two smaller axes.
fn raster(block: &LocalBlock, triangle: &LocalTriangle, index: u32, spacing: f32, found: &mut Vec<SurfaceSample>) {
    let n = triangle.normal.abs();
    let main = if n.z >= n.x && n.z >= n.y {
        2
    } else if n.x >= n.y {
        0
    } else {
        1
    };
    // Upwards first: so do the maps of `visibility`.
    let (u, v) = [(2, 1), (2, 0), (0, 1)][main];
    let low = triangle.corners.iter().fold(Vec3::MAX, |m, c| m.min(*c));
    let high = triangle.corners.iter().fold(Vec3::MIN, |m, c| m.max(*c));
    // Only the block's part of what may be a large triangle.
    let [width, height] = block.extent_m();
    let floor = Vec3::new(-block.cell_m, -block.cell_m, f32::MIN).max(low);
    let ceiling = Vec3::new(width + block.cell_m, height + block.cell_m, f32::MAX).min(high);
    if floor.cmpgt(ceiling).any() {
        return;
    }
    let start = (floor / spacing).floor() * spacing;
    let size = [u, v].map(|axis| ((ceiling[axis] - start[axis]) / spacing).ceil().clamp(0.0, 65536.0) as usize + 1);
    let corners = triangle.corners.map(|c| [c[u] - start[u], c[v] - start[v]]);
    let origin = triangle.corners[0];
    let area_m2 = spacing * spacing / n[main];
    scan(corners, spacing, size, |row, first, end| {
        for column in first..end {
            let mut p = Vec3::ZERO;
            p[u] = start[u] + (column as f32 + 0.5) * spacing;
            p[v] = start[v] + (row as f32 + 0.5) * spacing;
            let slope = triangle.normal[u] * (p[u] - origin[u]) + triangle.normal[v] * (p[v] - origin[v]);
            p[main] = origin[main] - slope / triangle.normal[main];
            push(block, found, p, index, area_m2, [column, row], [column / 2, row / 2]);
        }
    });
}
