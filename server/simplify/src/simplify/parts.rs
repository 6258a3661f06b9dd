//! Connected parts of a surface that may be removed as a whole.

use super::collapsible_mesh::CollapsibleMesh;
use glam::DVec3;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, NONE};

/// A connected part that may be removed.
pub(super) struct RemovablePart {
    pub(super) triangles: Vec<u32>,
    /// Area times squared half diagonal, comparable with the cost of a collapse.
    pub(super) cost: f64,
    /// Half the diagonal of the bounding box: the error of removing the part.
    pub(super) half_diagonal: f64,
}

/// The connected parts that may be removed, the cheapest last. Parts with a vertex of `is_kept` stay, and so does the
/// one with the largest area.
pub(super) fn find_removable_parts(
    pieces: &HalfEdgeMesh,
    mesh: &CollapsibleMesh,
    is_kept: &[bool],
) -> Vec<RemovablePart> {
    let mut parts = Vec::new();
    if pieces.report.pieces < 2 {
        return parts;
    }
    let mut seen = vec![false; pieces.triangles()];
    let mut largest = (0.0, None);
    for seed in 0..pieces.triangles() as u32 {
        if std::mem::replace(&mut seen[seed as usize], true) {
            continue;
        }
        let triangles = connected_triangles(pieces, seed, &mut seen);
        let mut corners = triangles.iter().flat_map(|t| 3 * t..3 * t + 3);
        if corners.any(|h| is_kept[pieces.origin[h as usize] as usize]) {
            continue;
        }
        let (mut min, mut max, mut area) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
        for &t in &triangles {
            let corners = mesh.corners(t);
            corners.iter().for_each(|p| (min, max) = (min.min(*p), max.max(*p)));
            area += (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() * 0.5;
        }
        if area > largest.0 {
            largest = (area, Some(parts.len()));
        }
        let half_diagonal = (max - min).length() * 0.5;
        parts.push(RemovablePart { triangles, cost: area * half_diagonal * half_diagonal, half_diagonal });
    }
    if let Some(largest) = largest.1 {
        parts.swap_remove(largest);
    }
    parts.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    parts
}

/// All triangles connected to `seed`, which is marked as `seen` already.
fn connected_triangles(pieces: &HalfEdgeMesh, seed: u32, seen: &mut [bool]) -> Vec<u32> {
    let mut triangles = vec![seed];
    let mut at = 0;
    while let Some(&t) = triangles.get(at) {
        at += 1;
        for h in 3 * t..3 * t + 3 {
            let twin = pieces.twin[h as usize];
            if twin != NONE && !std::mem::replace(&mut seen[twin as usize / 3], true) {
                triangles.push(twin / 3);
            }
        }
    }
    triangles
}
