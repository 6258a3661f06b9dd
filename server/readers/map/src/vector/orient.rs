//! Turns surfaces to the outside: formats disagree about the direction of rings, and many files about their format.

use insula_source::object::{Surface, TriangleMesh};

/// A body is closed if its area vectors add up to less than this share of its area.
const CLOSED_SHARE: f64 = 0.02;
/// An open shell is turned if it looks down by more than this share of its area.
const DOWN_SHARE: f64 = 0.1;

/// Sums over surfaces.
#[derive(Default)]
struct ShellSums {
    /// Sum of area vectors, and of their lengths.
    area: [f64; 3],
    total_area: f64,
    /// Six times the volume that is enclosed if the surfaces look outwards.
    volume: f64,
}

impl ShellSums {
    /// Adds a planar piece at `origin` with twice its area as a vector.
    fn add(&mut self, origin: [f64; 3], area: [f64; 3]) {
        self.area = [self.area[0] + area[0], self.area[1] + area[1], self.area[2] + area[2]];
        self.total_area += dot(area, area).sqrt();
        self.volume += dot(origin, area);
    }

    fn looks_inward(&self) -> bool {
        let is_closed = dot(self.area, self.area).sqrt() <= CLOSED_SHARE * self.total_area;
        if is_closed { self.volume < 0.0 } else { self.area[2] < -DOWN_SHARE * self.total_area }
    }
}

/// Turns all surfaces if they enclose a body and look inwards, or are an open shell that looks down as a whole. Each of a
/// degree and a metre may be the unit of an axis: that changes no sign.
pub(super) fn turn_outward(polygons: &mut [Surface], meshes: &mut [TriangleMesh]) {
    let first = polygons.iter().find_map(|surface| surface.points.first());
    let Some(base) = first.or_else(|| meshes.iter().find_map(|mesh| mesh.positions.first())).copied() else { return };
    let mut sums = ShellSums::default();
    for surface in &*polygons {
        if let Some(start) = surface.points.first() {
            sums.add(minus(*start, base), area_vector(surface));
        }
    }
    for mesh in &*meshes {
        for triangle in &mesh.triangles {
            let corners = triangle.map(|index| mesh.positions.get(index as usize).copied());
            if let [Some(a), Some(b), Some(c)] = corners {
                sums.add(minus(a, base), cross(minus(b, a), minus(c, a)));
            }
        }
    }
    if sums.looks_inward() {
        polygons.iter_mut().for_each(turn);
        meshes.iter_mut().flat_map(|mesh| &mut mesh.triangles).for_each(|triangle| triangle.swap(1, 2));
    }
}

/// Reverses the direction of all rings.
fn turn(surface: &mut Surface) {
    let mut start = 0;
    for end in ends(surface) {
        if let Some(ring) = surface.points.get_mut(start..end) {
            ring.reverse();
        }
        start = end;
    }
}

/// End of each ring in the surface's points.
fn ends(surface: &Surface) -> Vec<usize> {
    surface.hole_starts.iter().map(|start| *start as usize).chain([surface.points.len()]).collect()
}

/// Twice the area of the surface, as a vector that points to where it looks; holes count against it.
fn area_vector(surface: &Surface) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut start = 0;
    for (index, end) in ends(surface).into_iter().enumerate() {
        let mut area = surface.points.get(start..end).map_or([0.0; 3], ring_area_vector);
        if index > 0 && dot(area, sum) > 0.0 {
            area = area.map(|value| -value);
        }
        sum = [sum[0] + area[0], sum[1] + area[1], sum[2] + area[2]];
        start = end;
    }
    sum
}

/// Twice the area of a ring, as a vector.
pub(super) fn ring_area_vector(ring: &[[f64; 3]]) -> [f64; 3] {
    let Some(first) = ring.first() else { return [0.0; 3] };
    ring.windows(2).fold([0.0; 3], |sum, pair| {
        let area = cross(minus(pair[0], *first), minus(pair[1], *first));
        [sum[0] + area[0], sum[1] + area[1], sum[2] + area[2]]
    })
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(inward: bool) -> Vec<Surface> {
        let quads: [[[f64; 3]; 4]; 6] = [
            [[0., 0., 0.], [0., 1., 0.], [1., 1., 0.], [1., 0., 0.]],
            [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]],
            [[0., 0., 0.], [1., 0., 0.], [1., 0., 1.], [0., 0., 1.]],
            [[0., 1., 0.], [0., 1., 1.], [1., 1., 1.], [1., 1., 0.]],
            [[0., 0., 0.], [0., 0., 1.], [0., 1., 1.], [0., 1., 0.]],
            [[1., 0., 0.], [1., 1., 0.], [1., 1., 1.], [1., 0., 1.]],
        ];
        let surface = |quad: [[f64; 3]; 4]| {
            let mut points = quad.map(|[x, y, z]| [x + 1e5, y + 5e6, z]).to_vec();
            if inward {
                points.reverse();
            }
            Surface { points, ..Surface::default() }
        };
        quads.map(surface).to_vec()
    }

    #[test]
    fn closed_bodies_look_outward() {
        let mut outward = cube(false);
        turn_outward(&mut outward, &mut []);
        assert_eq!(outward, cube(false));
        let mut inward = cube(true);
        turn_outward(&mut inward, &mut []);
        assert_eq!(inward, cube(false));
    }

    #[test]
    fn open_shells_look_up_and_walls_stay() {
        let mut roof = vec![cube(true).remove(1)];
        turn_outward(&mut roof, &mut []);
        assert_eq!(roof, [cube(false).remove(1)]);
        let wall = vec![cube(true).remove(2)];
        let mut same = wall.clone();
        turn_outward(&mut same, &mut []);
        assert_eq!(same, wall);
        let mut mesh = TriangleMesh {
            positions: vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]],
            triangles: vec![[0, 2, 1], [0, 7, 1]],
            ..TriangleMesh::default()
        };
        turn_outward(&mut [], std::slice::from_mut(&mut mesh));
        assert_eq!(mesh.triangles[0], [0, 1, 2]);
    }
}
