//! Prediction of a vertex from the triangles that it completes, by class.
//!
//! Triangles often come in patterns: cut from quads, or from a scanner's grid. Where the longest edge of a triangle is
//! the diagonal of a quad, the parallelogram beyond it is nearly exact; beyond the other edges it is wrong by as much as
//! a whole edge. So each class has its own weights. Of the two kinds of classes the writer takes the better one.

use super::{
    completed::CompletedTriangle,
    connectivity::Connectivity,
    points::{OuterProduct, Points, Vector4, add, cross, dot, larger, scale, sub},
};

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
/// Number of classes.
pub(super) const CLASSES: usize = FIRST_OF_MANY + DEGREES;

/// What classes depend on, apart from the number of completed triangles and the degree of the vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Classes {
    /// Which edges are longest, and how wide the angle is that is left for the vertex.
    Edges,
    /// The degrees of the neighbours.
    Degrees,
}

/// What a vertex is predicted from.
pub(super) struct Prediction {
    pub(super) class: usize,
    /// The position that is expected if all weights are 0.
    pub(super) base: Vector4,
    /// What the weights multiply: vectors from `base` to other vertices, then one across the edge within the surface.
    pub(super) offsets: [Vector4; WEIGHTS],
    /// Sum of the products that the neighbours keep.
    pub(super) products: OuterProduct,
    /// Number of neighbours.
    pub(super) neighbours: usize,
    pub(super) plane: SurfacePlane,
}

impl Prediction {
    /// The prediction of a vertex, unless it completes no triangle.
    #[inline(always)]
    pub(super) fn new(
        triangles: &[CompletedTriangle],
        mesh: &Connectivity,
        points: &Points,
        vertex: u32,
        classes: Classes,
    ) -> Option<Self> {
        let degree = clamped_degree(mesh, vertex);
        match triangles {
            [] => None,
            [only] => Some(Self::from_one(only, mesh, points, degree, classes)),
            [first, second] => Some(Self::from_two(first, second, mesh, points, degree, classes)),
            [first, rest @ ..] => Some(Self::from_many(first, rest, points, degree)),
        }
    }

    #[inline(always)]
    fn from_one(
        only: &CompletedTriangle,
        mesh: &Connectivity,
        points: &Points,
        degree: usize,
        classes: Classes,
    ) -> Self {
        let mut products = [[0.0; 4]; 2];
        let [base, b, beyond] = [only.a, only.b, only.beyond].map(|vertex| gather(points, vertex, &mut products));
        let (to_b, to_beyond) = (sub(b, base), sub(beyond, base));
        let plane = SurfacePlane::new(to_b, to_beyond);
        let (kind, across) = match classes {
            Classes::Edges => (longest(squared(to_b), squared(to_beyond), squared(sub(b, beyond))), [0.0; 4]),
            Classes::Degrees => (clamped_degree(mesh, only.a), plane.across(to_b)),
        };
        let offsets = [to_b, to_beyond, [0.0; 4], [0.0; 4], across];
        Self { class: kind * DEGREES + degree, base, offsets, products, neighbours: 3, plane }
    }

    #[inline(always)]
    fn from_two(
        first: &CompletedTriangle,
        second: &CompletedTriangle,
        mesh: &Connectivity,
        points: &Points,
        degree: usize,
        classes: Classes,
    ) -> Self {
        let (middle, other) = (second.full, second.not_full());
        let is_after = middle == first.a;
        let outer = if is_after { first.b } else { first.a };
        let mut products = [[0.0; 4]; 2];
        let vertices = [middle, outer, first.beyond, other, second.beyond];
        let [base, u, x, v, y] = vertices.map(|vertex| gather(points, vertex, &mut products));
        let [u, x, v, y] = [u, x, v, y].map(|point| sub(point, base));
        // The edge of the first triangle runs from its corner `a` to `b`.
        let plane = SurfacePlane::new(if is_after { u } else { scale(u, -1.0) }, if is_after { x } else { sub(x, u) });
        let gap = sub(u, v);
        let (kind, across) = match classes {
            Classes::Edges => {
                let (uu, vv) = (squared(u), squared(v));
                let pair =
                    longest(uu, squared(x), squared(sub(u, x))) * 3 + longest(vv, squared(y), squared(sub(v, y)));
                (pair * ANGLES + angle(squared(gap), uu + vv), [0.0; 4])
            }
            Classes::Degrees => {
                let pair = clamped_degree(mesh, outer) * DEGREES + clamped_degree(mesh, other);
                let of_middle = (mesh.degree[middle as usize].clamp(4, 7) - 4) as usize;
                (pair * ANGLES + of_middle, plane.across(if is_after { gap } else { scale(gap, -1.0) }))
            }
        };
        let class = OF_ONE + kind * DEGREES + degree;
        Self { class, base, offsets: [u, x, v, y, across], products, neighbours: 5, plane }
    }

    #[inline(never)]
    fn from_many(first: &CompletedTriangle, rest: &[CompletedTriangle], points: &Points, degree: usize) -> Self {
        let mut products = [[0.0; 4]; 2];
        let [a, b, mut beyond] = [first.a, first.b, first.beyond].map(|vertex| gather(points, vertex, &mut products));
        let plane = SurfacePlane::new(sub(b, a), sub(beyond, a));
        let is_after = rest.first().is_some_and(|second| second.full == first.a);
        let (mut middles, mut last) = ([0.0; 4], [0.0; 4]);
        for triangle in rest {
            middles = add(middles, points.vector(triangle.full));
            beyond = add(beyond, gather(points, triangle.beyond, &mut products));
            last = gather(points, triangle.not_full(), &mut products);
        }
        let count = rest.len() as f32;
        let base = scale(middles, 1.0 / count);
        let ends = scale(add(if is_after { b } else { a }, last), 0.5);
        let beyond = scale(beyond, 1.0 / (count + 1.0));
        let offsets = [sub(ends, base), sub(beyond, base), [0.0; 4], [0.0; 4], [0.0; 4]];
        Self { class: FIRST_OF_MANY + degree, base, offsets, products, neighbours: 3 + 2 * rest.len(), plane }
    }

    #[inline(always)]
    pub(super) fn position(&self, weights: &[f32; WEIGHTS]) -> Vector4 {
        let [a, b, c, d, e] = self.offsets;
        let [p, q, r, s, t] = *weights;
        let sides = add(add(scale(a, p), scale(b, q)), add(scale(c, r), scale(d, s)));
        add(add(self.base, scale(e, t)), sides)
    }
}

/// The position of a neighbour, whose product is added.
#[inline(always)]
fn gather(points: &Points, vertex: u32, products: &mut OuterProduct) -> Vector4 {
    let (position, [x, y]) = points.state(vertex);
    *products = [add(products[0], x), add(products[1], y)];
    position
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
