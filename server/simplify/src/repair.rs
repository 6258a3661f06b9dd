//! Repairs scans as far as that is safe: equal vertices, triangles without area or given twice, inverted orientation, tiny holes.
//!
//! What cannot be repaired is counted, so that the report can name it.

use crate::model::TriangleModel;
use glam::DVec3;
use std::collections::HashMap;

/// A hole of more edges stays open.
const MAX_HOLE_EDGES: usize = 16;
/// A hole that is longer around than this share of the mesh's diagonal stays open.
const MAX_HOLE_SHARE: f64 = 0.1;
/// The volume of a part tells its orientation if at most this share of its edges is open.
const MAX_OPEN_SHARE: f64 = 0.1;
/// The volume of a closed part is at least this share of that of its bounding box's cube; less tells nothing.
const MIN_VOLUME_SHARE: f64 = 1e-6;

/// Counts of repairs, and of faults that remain.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Repairs {
    pub merged_vertices: usize,
    pub dropped_triangles: usize,
    /// Triangles whose orientation was inverted.
    pub turned_triangles: usize,
    pub filled_holes: usize,
    /// Edges of one triangle that remain.
    pub open_edges: usize,
    /// Edges of more than two triangles.
    pub branching_edges: usize,
}

/// A mesh of positions alone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlainMesh {
    pub positions: Vec<[f64; 3]>,
    /// Indices into `positions`, which exist.
    pub triangles: Vec<[u32; 3]>,
}

/// An edge with the lower vertex first, and a triangle that has it.
type EdgeUse = ([u32; 2], u32);

impl PlainMesh {
    /// Lowest and highest corner; `None` without vertices.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let points = self.positions.iter().map(|p| DVec3::from_array(*p));
        points.map(|p| [p, p]).reduce(|[low, high], [p, _]| [low.min(p), high.max(p)])
    }

    /// Repairs what can be repaired.
    pub fn repair(&mut self) -> Repairs {
        let mut repairs = Repairs::default();
        self.merge_vertices(&mut repairs);
        self.drop_triangles(&mut repairs);
        let edges = self.edge_uses();
        self.turn(&edges, &mut repairs);
        self.fill_holes(&edges, &mut repairs);
        let edges = self.edge_uses();
        for uses in edges.chunk_by(|a, b| a.0 == b.0) {
            repairs.open_edges += usize::from(uses.len() == 1);
            repairs.branching_edges += usize::from(uses.len() > 2);
        }
        repairs
    }

    fn merge_vertices(&mut self, repairs: &mut Repairs) {
        let (positions, triangles) = (std::mem::take(&mut self.positions), std::mem::take(&mut self.triangles));
        let mut model = TriangleModel { positions, triangles, layers: Vec::new() };
        repairs.merged_vertices = model.weld();
        (self.positions, self.triangles) = (model.positions, model.triangles);
    }

    fn drop_triangles(&mut self, repairs: &mut Repairs) {
        let before = self.triangles.len();
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        let mut order: Vec<([u32; 3], u32)> = (0..)
            .zip(&self.triangles)
            .map(|(t, corners)| {
                let mut corners = *corners;
                corners.sort_unstable();
                (corners, t)
            })
            .collect();
        order.sort_unstable();
        order.dedup_by_key(|(corners, _)| *corners);
        let mut kept: Vec<u32> = order.into_iter().map(|(_, t)| t).collect();
        kept.sort_unstable();
        self.triangles = kept.into_iter().map(|t| self.triangles[t as usize]).collect();
        repairs.dropped_triangles = before - self.triangles.len();
    }

    /// All edges of all triangles, sorted.
    fn edge_uses(&self) -> Vec<EdgeUse> {
        let mut uses: Vec<EdgeUse> = Vec::with_capacity(3 * self.triangles.len());
        for (t, [a, b, c]) in (0..).zip(&self.triangles) {
            uses.extend([(*a, *b), (*b, *c), (*c, *a)].map(|(from, to)| ([from.min(to), from.max(to)], t)));
        }
        uses.sort_unstable();
        uses
    }

    /// Whether a triangle runs along an edge from its lower to its higher vertex.
    fn runs_up(&self, triangle: u32, edge: [u32; 2]) -> bool {
        let [a, b, c] = self.triangles[triangle as usize];
        [[a, b], [b, c], [c, a]].contains(&edge)
    }

    /// Gives the triangles of each connected part one orientation, outwards where the part's volume tells it.
    fn turn(&mut self, edges: &[EdgeUse], repairs: &mut Repairs) {
        let mut neighbours: Vec<[u32; 3]> = vec![[u32::MAX; 3]; self.triangles.len()];
        let mut add = |of: u32, edge_use: u32| {
            let free = neighbours[of as usize].iter_mut().find(|slot| **slot == u32::MAX);
            if let Some(slot) = free {
                *slot = edge_use;
            }
        };
        for (at, pair) in edges.windows(2).enumerate() {
            let is_pair = pair[0].0 == pair[1].0;
            let is_alone =
                (at == 0 || edges[at - 1].0 != pair[0].0) && edges.get(at + 2).is_none_or(|e| e.0 != pair[0].0);
            if is_pair && is_alone {
                add(pair[0].1, at as u32);
                add(pair[1].1, at as u32);
            }
        }
        let mut is_seen = vec![false; self.triangles.len()];
        for first in 0..self.triangles.len() as u32 {
            if std::mem::replace(&mut is_seen[first as usize], true) {
                continue;
            }
            let (mut part, mut at, mut open) = (vec![(first, false)], 0, 0);
            while let Some(&(t, is_turned)) = part.get(at) {
                at += 1;
                for edge_use in neighbours[t as usize] {
                    let Some([(edge, a), (_, b)]) = edges.get(edge_use as usize..).and_then(|rest| rest.first_chunk())
                    else {
                        open += 1;
                        continue;
                    };
                    let other = if *a == t { *b } else { *a };
                    if !std::mem::replace(&mut is_seen[other as usize], true) {
                        // Neighbours with one orientation pass their edge in opposite directions.
                        let differs = self.runs_up(t, *edge) == self.runs_up(other, *edge);
                        part.push((other, is_turned != differs));
                    }
                }
            }
            self.turn_part(&part, open, repairs);
        }
    }

    /// `part`: its triangles, and whether each has to be turned to be oriented as the first.
    fn turn_part(&mut self, part: &[(u32, bool)], open: usize, repairs: &mut Repairs) {
        let corner = |t: u32| self.triangles[t as usize].map(|v| DVec3::from_array(self.positions[v as usize]));
        let origin = corner(part[0].0)[0];
        let (mut volume, mut low, mut high) = (0.0, origin, origin);
        for (t, is_turned) in part {
            let corners = corner(*t);
            let [a, b, c] = corners.map(|p| p - origin);
            let sixfold = a.dot(b.cross(c));
            volume += if *is_turned { -sixfold } else { sixfold } / 6.0;
            (low, high) = corners.iter().fold((low, high), |(low, high), p| (low.min(*p), high.max(*p)));
        }
        let turned = part.iter().filter(|(_, is_turned)| *is_turned).count();
        let is_known = (open as f64) <= MAX_OPEN_SHARE * part.len() as f64
            && volume.abs() > MIN_VOLUME_SHARE * (high - low).max_element().powi(3);
        // Otherwise as most triangles are.
        let turn_all = if is_known { volume < 0.0 } else { 2 * turned > part.len() };
        for (t, is_turned) in part {
            if *is_turned != turn_all {
                self.triangles[*t as usize].swap(1, 2);
                repairs.turned_triangles += 1;
            }
        }
    }

    /// Fills holes of few edges with a fan around their middle.
    fn fill_holes(&mut self, edges: &[EdgeUse], repairs: &mut Repairs) {
        let Some([low, high]) = self.bounds() else { return };
        let max_length = MAX_HOLE_SHARE * (high - low).length();
        // From each open edge's end to its start: a hole runs against its triangles.
        let mut next: HashMap<u32, u32> = HashMap::new();
        let mut branching: Vec<u32> = Vec::new();
        for uses in edges.chunk_by(|a, b| a.0 == b.0) {
            let [(edge, t)] = uses else { continue };
            let [from, to] = if self.runs_up(*t, *edge) { [edge[1], edge[0]] } else { *edge };
            if next.insert(from, to).is_some() {
                branching.push(from);
            }
        }
        for vertex in &branching {
            next.remove(vertex);
        }
        let mut starts: Vec<u32> = next.keys().copied().collect();
        starts.sort_unstable();
        for start in starts {
            let mut hole = Vec::new();
            let mut at = start;
            while let Some(to) = next.remove(&at) {
                hole.push(at);
                at = to;
            }
            if at == start && (3..=MAX_HOLE_EDGES).contains(&hole.len()) {
                self.fill(&hole, max_length, repairs);
            }
        }
    }

    fn fill(&mut self, hole: &[u32], max_length: f64, repairs: &mut Repairs) {
        let point = |k: usize| DVec3::from_array(self.positions[hole[k % hole.len()] as usize]);
        let length: f64 = (0..hole.len()).map(|k| point(k).distance(point(k + 1))).sum();
        if length > max_length {
            return;
        }
        repairs.filled_holes += 1;
        if let [a, b, c] = hole {
            self.triangles.push([*a, *b, *c]);
            return;
        }
        let middle = (0..hole.len()).map(point).sum::<DVec3>() / hole.len() as f64;
        self.positions.push(middle.to_array());
        let centre = self.positions.len() as u32 - 1;
        self.triangles.extend((0..hole.len()).map(|k| [hole[k], hole[(k + 1) % hole.len()], centre]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sphere of `2 n * n` quads, with its own vertices for each triangle.
    fn sphere(n: u32) -> PlainMesh {
        let point = |i: u32, j: u32| {
            let (theta, phi) = (
                f64::from(i) * std::f64::consts::PI / f64::from(n),
                f64::from(j % (2 * n)) * std::f64::consts::PI / f64::from(n),
            );
            // The poles are single points.
            let ring = if i == 0 || i == n { 0.0 } else { theta.sin() };
            [ring * phi.cos() + 5.0, ring * phi.sin(), theta.cos()]
        };
        let mut mesh = PlainMesh::default();
        for (i, j) in (0..n).flat_map(|i| (0..2 * n).map(move |j| (i, j))) {
            let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
            for corners in [[a, b, c], [a, c, d]] {
                let first = mesh.positions.len() as u32;
                mesh.positions.extend(corners);
                mesh.triangles.push([first, first + 1, first + 2]);
            }
        }
        mesh
    }

    fn volume(mesh: &PlainMesh) -> f64 {
        let corner = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
        mesh.triangles.iter().map(|[a, b, c]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0).sum()
    }

    #[test]
    fn equal_vertices_are_merged_and_degenerate_triangles_dropped() {
        let mut mesh = sphere(12);
        mesh.triangles.push(mesh.triangles[40]);
        let repairs = mesh.repair();
        assert_eq!(mesh.positions.len(), 2 + 11 * 24);
        // At each pole, a ring of triangles without area; and the one that was there twice.
        assert_eq!(repairs.dropped_triangles, 2 * 24 + 1);
        assert_eq!(
            (repairs.open_edges, repairs.branching_edges, repairs.turned_triangles, repairs.filled_holes),
            (0, 0, 0, 0)
        );
        assert!(volume(&mesh) > 3.9);
    }

    #[test]
    fn orientation_becomes_outward() {
        let mut inverted = sphere(12);
        inverted.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let all = inverted.repair().turned_triangles;
        assert_eq!(all, inverted.triangles.len());
        let mut mixed = sphere(12);
        mixed.triangles.iter_mut().step_by(3).for_each(|t| t.swap(0, 1));
        assert!(mixed.repair().turned_triangles > 100);
        for mesh in [&inverted, &mixed] {
            assert!(
                (volume(mesh)
                    - volume(&{
                        let mut right = sphere(12);
                        right.repair();
                        right
                    }))
                .abs()
                    < 1e-9
            );
        }
    }

    #[test]
    fn tiny_holes_are_filled_and_large_ones_counted() {
        let mut mesh = sphere(40);
        mesh.repair();
        let whole = volume(&mesh);
        // A triangle, and a cap around a pole.
        let is_in_cap = |t: &[u32; 3]| t.iter().any(|v| mesh.positions[*v as usize][2] > 0.9);
        let mut triangles: Vec<[u32; 3]> = mesh.triangles.iter().filter(|t| !is_in_cap(t)).copied().collect();
        let at = triangles.len() / 2;
        triangles.remove(at);
        mesh.triangles = triangles;
        let repairs = mesh.repair();
        assert_eq!(repairs.filled_holes, 1);
        assert_eq!(repairs.open_edges, 80);
        assert_eq!(repairs.turned_triangles, 0);
        assert!(volume(&mesh) < whole);
    }
}
