//! Polygons from triangles: triangles of one plane that share edges become one surface.
//!
//! A group of triangles whose border is not one outer ring with holes, or that touches itself at a vertex, stays as triangles.

use glam::DVec3;
use std::collections::{HashMap, HashSet};

/// Whole coordinates.
pub(super) type Point = [i32; 3];

/// Surfaces over shared vertices.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Surfaces {
    pub(super) vertices: Vec<Point>,
    /// Rings of vertices, without a repetition of the first one: the outer ring counter-clockwise as seen from outside, and holes
    /// clockwise.
    pub(super) polygons: Vec<Vec<Vec<usize>>>,
}

impl Surfaces {
    /// Merges triangles. Vertices within `tolerance` units of each other become one; triangles are in one plane if their vertices
    /// are within twice that of it.
    pub(super) fn of(triangles: &[[Point; 3]], tolerance: f64) -> Self {
        let mut weld = Weld::new(tolerance);
        let mut known = HashSet::new();
        let mut welded: Vec<[usize; 3]> = Vec::new();
        for triangle in triangles {
            let corners = triangle.map(|point| weld.vertex(point));
            let [a, b, c] = corners;
            let has_area = a != b && b != c && c != a && cross_of(&weld.vertices, corners).length() > 0.0;
            let least = corners.iter().enumerate().min_by_key(|(_, v)| **v).map_or(0, |(i, _)| i);
            if has_area && known.insert([corners[least], corners[(least + 1) % 3], corners[(least + 2) % 3]]) {
                welded.push(corners);
            }
        }
        let polygons = Groups { vertices: &weld.vertices, triangles: &welded, tolerance: 2.0 * tolerance }.polygons();
        Self { vertices: weld.vertices, polygons }.without_unused_vertices()
    }

    /// Inner vertices of planes are no longer used. The others are numbered in the order of their use.
    fn without_unused_vertices(mut self) -> Self {
        let mut numbers: HashMap<usize, usize> = HashMap::new();
        let mut vertices = Vec::new();
        for vertex in self.polygons.iter_mut().flatten().flatten() {
            let old = *vertex;
            *vertex = *numbers.entry(old).or_insert_with(|| {
                vertices.push(self.vertices[old]);
                vertices.len() - 1
            });
        }
        Self { vertices, ..self }
    }
}

/// Gives positions that are near each other the same vertex.
struct Weld {
    tolerance: f64,
    vertices: Vec<Point>,
    cells: HashMap<Point, Vec<usize>>,
}

impl Weld {
    fn new(tolerance: f64) -> Self {
        Self { tolerance: tolerance.max(1.0), vertices: Vec::new(), cells: HashMap::new() }
    }

    fn vertex(&mut self, point: Point) -> usize {
        let side = self.tolerance.ceil() as i32;
        let cell = point.map(|v| v.div_euclid(side));
        let around = (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
        let near =
            around.filter_map(|step| self.cells.get(&[0, 1, 2].map(|k| cell[k] + step[k]))).flatten().find(|vertex| {
                let other = self.vertices[**vertex];
                (0..3).all(|k| f64::from(other[k].abs_diff(point[k])) <= self.tolerance)
            });
        if let Some(&vertex) = near {
            return vertex;
        }
        self.vertices.push(point);
        self.cells.entry(cell).or_default().push(self.vertices.len() - 1);
        self.vertices.len() - 1
    }
}

fn position(point: Point) -> DVec3 {
    point.map(f64::from).into()
}

/// Of a triangle: its normal, as long as twice its area.
fn cross_of(vertices: &[Point], corners: [usize; 3]) -> DVec3 {
    let [a, b, c] = corners.map(|v| position(vertices[v]));
    (b - a).cross(c - a)
}

/// Groups triangles by plane.
struct Groups<'a> {
    vertices: &'a [Point],
    triangles: &'a [[usize; 3]],
    tolerance: f64,
}

impl Groups<'_> {
    fn polygons(&self) -> Vec<Vec<Vec<usize>>> {
        let neighbours = self.neighbours();
        let areas: Vec<f64> = self.triangles.iter().map(|corners| cross_of(self.vertices, *corners).length()).collect();
        // The largest triangle defines the plane best.
        let mut order: Vec<usize> = (0..self.triangles.len()).collect();
        order.sort_by(|a, b| areas[*b].total_cmp(&areas[*a]).then(a.cmp(b)));
        let mut is_taken = vec![false; self.triangles.len()];
        let mut polygons = Vec::new();
        for seed in order {
            if is_taken[seed] {
                continue;
            }
            let normal = cross_of(self.vertices, self.triangles[seed]) / areas[seed];
            let group = self.group(seed, normal, &neighbours, &mut is_taken);
            match self.rings(&group, normal) {
                Some(rings) => polygons.push(rings),
                None => polygons.extend(group.iter().map(|triangle| vec![self.triangles[*triangle].to_vec()])),
            }
        }
        polygons
    }

    /// For each edge of each triangle, the triangle on its other side. Edges of more than two triangles have none.
    fn neighbours(&self) -> Vec<[Option<usize>; 3]> {
        let mut of_edge: HashMap<(usize, usize), Option<usize>> = HashMap::new();
        for (index, corners) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                let edge = (corners[k], corners[(k + 1) % 3]);
                of_edge.entry(edge).and_modify(|known| *known = None).or_insert(Some(index));
            }
        }
        let across = |corners: &[usize; 3], k: usize| {
            let edge = (corners[k], corners[(k + 1) % 3]);
            of_edge.get(&edge).copied().flatten()?;
            of_edge.get(&(edge.1, edge.0)).copied().flatten()
        };
        self.triangles.iter().map(|corners| [0, 1, 2].map(|k| across(corners, k))).collect()
    }

    /// The triangles in the plane of `seed` that are connected with it.
    fn group(
        &self,
        seed: usize,
        normal: DVec3,
        neighbours: &[[Option<usize>; 3]],
        is_taken: &mut [bool],
    ) -> Vec<usize> {
        let origin = position(self.vertices[self.triangles[seed][0]]);
        let is_in_plane =
            |vertex: &usize| normal.dot(position(self.vertices[*vertex]) - origin).abs() <= self.tolerance;
        let belongs = |triangle: usize| {
            let corners = self.triangles[triangle];
            corners.iter().all(is_in_plane) && cross_of(self.vertices, corners).dot(normal) > 0.0
        };
        is_taken[seed] = true;
        let mut group = vec![seed];
        let mut next = 0;
        while let Some(&triangle) = group.get(next) {
            next += 1;
            for neighbour in neighbours[triangle].into_iter().flatten() {
                if !is_taken[neighbour] && belongs(neighbour) {
                    is_taken[neighbour] = true;
                    group.push(neighbour);
                }
            }
        }
        group
    }

    /// The border of a group: the outer ring, then holes. `None` if it is not simple.
    fn rings(&self, group: &[usize], normal: DVec3) -> Option<Vec<Vec<usize>>> {
        if let [only] = group {
            return Some(vec![self.triangles[*only].to_vec()]);
        }
        let edges_of = |triangle: &usize| {
            let [a, b, c] = self.triangles[*triangle];
            [(a, b), (b, c), (c, a)]
        };
        let edges: HashSet<(usize, usize)> = group.iter().flat_map(edges_of).collect();
        let mut next = HashMap::new();
        // In the order of the triangles, so that equal input gives equal rings.
        let border: Vec<(usize, usize)> =
            group.iter().flat_map(edges_of).filter(|(from, to)| !edges.contains(&(*to, *from))).collect();
        for (from, to) in &border {
            if next.insert(*from, *to).is_some() {
                return None;
            }
        }
        let mut rings: Vec<Vec<usize>> = Vec::new();
        for (first, _) in border {
            let mut ring = Vec::new();
            let mut vertex = first;
            while let Some(to) = next.remove(&vertex) {
                ring.push(vertex);
                vertex = to;
            }
            if !ring.is_empty() && vertex != first {
                return None;
            }
            if !ring.is_empty() {
                rings.push(ring);
            }
        }
        let (mut outer, holes): (Vec<_>, Vec<_>) =
            rings.into_iter().partition(|ring| self.signed_area(ring, normal) > 0.0);
        let outer = outer.pop().filter(|_| outer.is_empty())?;
        Some(std::iter::once(outer).chain(holes).collect())
    }

    /// Area as seen against the normal, positive if counter-clockwise.
    fn signed_area(&self, ring: &[usize], normal: DVec3) -> f64 {
        let first = ring.first().copied().unwrap_or_default();
        ring.windows(2).map(|pair| 0.5 * cross_of(self.vertices, [first, pair[0], pair[1]]).dot(normal)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The triangles of a box, two for each face, seen from outside.
    fn cuboid([x, y, z]: [i32; 3]) -> Vec<[Point; 3]> {
        let corner =
            |i: usize| [if i & 1 == 1 { x } else { 0 }, if i & 2 == 2 { y } else { 0 }, if i & 4 == 4 { z } else { 0 }];
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|face| face.map(corner)).collect()
    }

    #[test]
    fn a_box_has_six_surfaces() {
        let surfaces = Surfaces::of(&cuboid([9000, 8000, 5000]), 2.0);
        assert_eq!((surfaces.vertices.len(), surfaces.polygons.len()), (8, 6));
        assert!(surfaces.polygons.iter().all(|rings| rings.len() == 1 && rings[0].len() == 4));
    }

    #[test]
    fn near_vertices_are_one_and_doubled_triangles_are_dropped() {
        let mut triangles = cuboid([9000, 8000, 5000]);
        triangles
            .iter_mut()
            .flatten()
            .filter(|point| point[0] == 9000)
            .enumerate()
            .for_each(|(i, p)| p[1] += i as i32 % 2);
        triangles.extend_from_within(..3);
        triangles.push([[0; 3], [1, 0, 0], [0, 1, 0]]);
        let surfaces = Surfaces::of(&triangles, 2.0);
        assert_eq!((surfaces.vertices.len(), surfaces.polygons.len()), (8, 6));
    }

    #[test]
    fn a_frame_has_a_hole_and_a_plane_that_touches_itself_stays_triangles() {
        let square = |x: i32, y: i32| {
            let at = |dx: i32, dy: i32| [(x + dx) * 1000, (y + dy) * 1000, 0];
            [[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]
        };
        let frame: Vec<_> = (0..9).filter(|i| *i != 4).flat_map(|i| square(i % 3, i / 3)).collect();
        let surfaces = Surfaces::of(&frame, 2.0);
        assert_eq!(
            surfaces.polygons.iter().map(|rings| rings.iter().map(Vec::len).collect::<Vec<_>>()).collect::<Vec<_>>(),
            [[12, 4]]
        );
        // The last squares touch at a corner.
        let corner: Vec<_> = (0..8).filter(|i| *i != 4).flat_map(|i| square(i % 3, i / 3)).collect();
        let surfaces = Surfaces::of(&corner, 2.0);
        assert_eq!(surfaces.polygons.iter().map(Vec::len).sum::<usize>(), surfaces.polygons.len());
    }

    #[test]
    fn a_gable_has_two_roof_surfaces() {
        let roof = |flip: i32| {
            let at = |x: i32, y: i32, z: i32| [5000 + flip * x, y, z];
            let (a, b, c, d) = (at(5000, 0, 0), at(5000, 9000, 0), at(0, 9000, 4000), at(0, 0, 4000));
            if flip > 0 { vec![[a, b, c], [a, c, d]] } else { vec![[a, c, b], [a, d, c]] }
        };
        let surfaces = Surfaces::of(&[roof(1), roof(-1)].concat(), 2.0);
        assert_eq!((surfaces.vertices.len(), surfaces.polygons.len()), (6, 2));
    }
}
