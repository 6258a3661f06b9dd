//! Prediction of a vertex from the triangles that it completes, by class.
//!
//! Triangles often come in patterns: cut from quads, or from a scanner's grid. Where the longest edge of a triangle is
//! the diagonal of a quad, the parallelogram beyond it is nearly exact; beyond the other edges it is wrong by as much as
//! a whole edge. So each class has its own weights. Of the two kinds of classes the writer takes the better one.

use super::completed::CompletedTriangle;
use super::connectivity::Connectivity;
use super::points::{OuterProduct, Points, Vector4, add, cross, dot, larger, scale, sub};

/// Number of weights of a class. Most classes use fewer.
pub(super) const WEIGHTS: usize = 5;
/// Values of a clamped degree.
const DEGREES: usize = 3;
/// Ranges of the angle between two triangles, or values of the degree of the vertex there.
const ANGLES: usize = 4;
/// Number of classes of vertices that complete one triangle.
pub(super) const OF_ONE: usize = 3 * DEGREES;
/// Number of classes of vertices that complete two triangles with the same longest edges or the same outer degrees.
pub(super) const OF_ONE_PAIR: usize = ANGLES * DEGREES;
/// First class of vertices that complete more than two triangles.
pub(super) const FIRST_OF_MANY: usize = OF_ONE + 9 * OF_ONE_PAIR;
pub(super) const CLASSES: usize = FIRST_OF_MANY + DEGREES;

/// What classes depend on, apart from the number of completed triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Classes {
    /// Which edges are longest, how wide the angle is that is left for the vertex, and the degree of the vertex.
    Edges = 0,
    /// The same, but of two triangles the degree of the vertex between them.
    EdgesAndMiddle = 1,
    /// The degrees of the vertex and of the neighbours.
    Degrees = 2,
}

impl Classes {
    /// All of them, by their number in the header.
    pub(super) const ALL: [Self; 3] = [Self::Edges, Self::EdgesAndMiddle, Self::Degrees];
}

/// What a vertex is predicted from.
#[derive(Default)]
pub(super) struct Prediction {
    /// What the weights multiply: vectors from `base` to other vertices, then one across the edge within the surface.
    pub(super) offsets: [Vector4; WEIGHTS],
    /// The position that is expected if all weights are 0.
    pub(super) base: Vector4,
    /// Sum of the products that the neighbours keep.
    pub(super) products: OuterProduct,
    pub(super) plane: SurfacePlane,
    pub(super) class: usize,
    pub(super) neighbours: usize,
}

impl Prediction {
    /// Replaces this prediction by that of a vertex. Returns whether the vertex completes any triangle.
    #[inline(always)]
    pub(super) fn find(
        &mut self,
        triangles: &[CompletedTriangle],
        mesh: &Connectivity,
        points: &Points,
        vertex: u32,
        classes: Classes,
    ) -> bool {
        self.products = [[0.0; 4]; 2];
        let degree = clamped_degree(mesh, vertex);
        match triangles {
            [] => return false,
            [only] => self.find_from_one(only, mesh, points, degree, classes),
            [first, second] => self.find_from_two([first, second], mesh, points, degree, classes),
            [first, rest @ ..] => self.find_from_many(first, rest, points, degree),
        }
        true
    }

    #[inline(always)]
    fn find_from_one(
        &mut self,
        only: &CompletedTriangle,
        mesh: &Connectivity,
        points: &Points,
        degree: usize,
        classes: Classes,
    ) {
        let base = self.gather(points, only.a);
        let to_b = sub(self.gather(points, only.b), base);
        let to_beyond = sub(self.gather(points, only.beyond), base);
        self.plane = SurfacePlane::new(to_b, to_beyond);
        let (kind, across) = match classes {
            Classes::Degrees => (clamped_degree(mesh, only.a), self.plane.across(to_b)),
            _ => (longest(squared(to_b), squared(to_beyond), squared(sub(to_b, to_beyond))), [0.0; 4]),
        };
        self.base = base;
        self.offsets = [to_b, to_beyond, [0.0; 4], [0.0; 4], across];
        (self.class, self.neighbours) = (kind * DEGREES + degree, 3);
    }

    #[inline(always)]
    fn find_from_two(
        &mut self,
        [first, second]: [&CompletedTriangle; 2],
        mesh: &Connectivity,
        points: &Points,
        degree: usize,
        classes: Classes,
    ) {
        let (middle, other) = (second.full, second.not_full());
        let is_after = middle == first.a;
        let outer = if is_after { first.b } else { first.a };
        let base = self.gather(points, middle);
        let u = sub(self.gather(points, outer), base);
        let x = sub(self.gather(points, first.beyond), base);
        let v = sub(self.gather(points, other), base);
        let y = sub(self.gather(points, second.beyond), base);
        // The edge of the first triangle runs from its corner `a` to `b`.
        self.plane = if is_after { SurfacePlane::new(u, x) } else { SurfacePlane::new(x, u) };
        let gap = sub(u, v);
        let (kind, across) = match classes {
            Classes::Degrees => {
                let pair = clamped_degree(mesh, outer) * DEGREES + clamped_degree(mesh, other);
                let of_middle = (mesh.degree[middle as usize].clamp(4, 7) - 4) as usize;
                let across = self.plane.across(gap);
                (pair * ANGLES + of_middle, if is_after { across } else { scale(across, -1.0) })
            }
            _ => {
                let (uu, vv) = (squared(u), squared(v));
                let pair =
                    longest(uu, squared(x), squared(sub(u, x))) * 3 + longest(vv, squared(y), squared(sub(v, y)));
                (pair * ANGLES + angle(squared(gap), uu + vv), [0.0; 4])
            }
        };
        let degree = if classes == Classes::EdgesAndMiddle { clamped_degree(mesh, middle) } else { degree };
        self.base = base;
        self.offsets = [u, x, v, y, across];
        (self.class, self.neighbours) = (OF_ONE + kind * DEGREES + degree, 5);
    }

    #[inline(never)]
    fn find_from_many(
        &mut self,
        first: &CompletedTriangle,
        rest: &[CompletedTriangle],
        points: &Points,
        degree: usize,
    ) {
        let a = self.gather(points, first.a);
        let b = self.gather(points, first.b);
        let mut beyond = self.gather(points, first.beyond);
        self.plane = SurfacePlane::new(sub(b, a), sub(beyond, a));
        let is_after = rest.first().is_some_and(|second| second.full == first.a);
        let (mut middles, mut last) = ([0.0; 4], [0.0; 4]);
        for triangle in rest {
            middles = add(middles, points.vector(triangle.full));
            beyond = add(beyond, self.gather(points, triangle.beyond));
            last = self.gather(points, triangle.not_full());
        }
        let count = rest.len() as f32;
        let base = scale(middles, 1.0 / count);
        let ends = scale(add(if is_after { b } else { a }, last), 0.5);
        let beyond = scale(beyond, 1.0 / (count + 1.0));
        self.base = base;
        self.offsets = [sub(ends, base), sub(beyond, base), [0.0; 4], [0.0; 4], [0.0; 4]];
        (self.class, self.neighbours) = (FIRST_OF_MANY + degree, 3 + 2 * rest.len());
    }

    /// The position of a neighbour, whose products are added.
    #[inline(always)]
    fn gather(&mut self, points: &Points, vertex: u32) -> Vector4 {
        let (position, [x, y]) = points.state(vertex);
        self.products = [add(self.products[0], x), add(self.products[1], y)];
        position
    }

    #[inline(always)]
    pub(super) fn position(&self, weights: &[f32; WEIGHTS]) -> Vector4 {
        let [a, b, c, d, e] = self.offsets;
        let [p, q, r, s, t] = *weights;
        let sides = add(add(scale(a, p), scale(b, q)), add(scale(c, r), scale(d, s)));
        add(add(self.base, scale(e, t)), sides)
    }
}

#[inline(always)]
fn squared(v: Vector4) -> f32 {
    dot(v, v)
}

/// Which edge of a triangle is longest: the one next to the vertex, the other one at the base, or the opposite one.
#[inline(always)]
fn longest(shared: f32, other: f32, opposite: f32) -> usize {
    let is_other = other > opposite;
    if shared > if is_other { other } else { opposite } { 0 } else { 2 - usize::from(is_other) }
}

/// The range of the angle between two sides, from the square of what lies between their ends and the sum of their
/// squares.
#[inline(always)]
fn angle(gap: f32, sides: f32) -> usize {
    usize::from(gap > 0.6 * sides) + usize::from(gap > 1.3 * sides) + usize::from(gap > 1.75 * sides)
}

/// The degree of a vertex, less 5, in [`DEGREES`] steps.
#[inline(always)]
fn clamped_degree(mesh: &Connectivity, vertex: u32) -> usize {
    (mesh.degree[vertex as usize].clamp(5, 7) - 5) as usize
}

/// The plane of the triangle next to a vertex.
#[derive(Default)]
pub(super) struct SurfacePlane {
    pub(super) normal: Vector4,
    /// 1 over the squared length of `normal`, which counts as at least 1.
    pub(super) inverse: f32,
}

impl SurfacePlane {
    #[inline(always)]
    fn new(edge: Vector4, to_beyond: Vector4) -> Self {
        let normal = cross(edge, to_beyond);
        Self { normal, inverse: 1.0 / larger(dot(normal, normal), 1.0) }
    }

    /// An edge, turned by a right angle within the plane.
    #[inline(always)]
    fn across(&self, edge: Vector4) -> Vector4 {
        scale(cross(edge, self.normal), self.inverse.sqrt())
    }
}
