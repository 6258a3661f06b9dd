//! Positions of scanned surfaces, predicted with an estimated covariance.
//!
//! A vertex is predicted from its parallelograms and its neighbours, with weights that the writer fitted to the mesh.
//! The weights depend on the number of triangles that the vertex completes and on vertex degrees, which indicate how wide
//! an angle is. The prediction error is taken as a normal distribution in space, with the covariance of the errors at
//! the neighbours. So y is predicted again once x is known, and z once both are known. Along a smooth surface this has
//! the effect of a local frame, and along a scanner's rays it is better, without a rotation that must be undone
//! exactly.
//!
//! All computations are IEEE single precision in the order of the source, so that all machines decode the same.

use super::{
    completed::{CompletedTriangle, CompletedTriangles},
    connectivity::Connectivity,
    half_edge::NONE,
    points::{Points, Vector4, add, cross, dot, larger, nearest, outer_product, scale, sub},
    scan_models::ScanModels,
};
use crate::{
    codec::{
        rans::SymbolCoder,
        varint::{unzigzag, zigzag},
    },
    error::DecodeError,
};

/// Classes of vertices with their own weights: 3 with one completed triangle, 12 with two, 3 with more.
pub(super) const CLASSES: usize = 18;
/// Weights of a class: of the parallelogram, and of the middle neighbour.
pub(super) const WEIGHTS: usize = 2;
/// Scale of the stored weights.
const ONE: f32 = 64.0;

/// Weights of all classes in 1/64.
pub(super) type Weights = [[i8; WEIGHTS]; CLASSES];

/// Smallest variance that is assumed, in grid steps squared.
const MIN_VARIANCE: f32 = 0.1;
/// Weight of the mean error of the mesh, in neighbours.
const PRIOR: f32 = 2.0;
/// Adaptation rate of the mean error.
const ADAPTATION: f32 = 0.1;

/// The prediction of a vertex before its class's weights are applied.
struct Prediction {
    /// `None` if the vertex completes no triangle.
    class: Option<usize>,
    /// Mean of the neighbours.
    mean: Vector4,
    /// From the mean of the vertices beyond the neighbours to `mean`.
    outward: Vector4,
    /// From `mean` to the mean of the middle neighbours.
    middle: Vector4,
}

impl Prediction {
    #[inline(always)]
    fn new(completed: &CompletedTriangles, mesh: &Connectivity, points: &Points, vertex: u32) -> Self {
        let triangles = completed.triangles();
        let (mut neighbours, mut beyond, mut middle) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        for triangle in triangles {
            neighbours = add(neighbours, add(points.vector(triangle.a), points.vector(triangle.b)));
            beyond = add(beyond, points.vector(triangle.beyond));
        }
        for triangle in triangles.iter().skip(1) {
            middle = add(middle, points.vector(triangle.full));
        }
        let by_degree = (mesh.degree[vertex as usize].clamp(5, 7) - 5) as usize;
        let class = match triangles.len() {
            0 => None,
            1 => Some(by_degree),
            2 => Some(3 + 3 * (mesh.degree[triangles[1].full as usize].clamp(4, 7) - 4) as usize + by_degree),
            _ => Some(15 + by_degree),
        };
        let share = 1.0 / triangles.len().max(1) as f32;
        let mean = scale(neighbours, 0.5 * share);
        let middle = match triangles.len() {
            0 | 1 => [0.0; 4],
            n => sub(scale(middle, 1.0 / (n - 1) as f32), mean),
        };
        Self { class, mean, outward: sub(mean, scale(beyond, share)), middle }
    }

    #[inline]
    fn position(&self, weights: &[f32; WEIGHTS]) -> Vector4 {
        add(self.mean, add(scale(self.outward, weights[0]), scale(self.middle, weights[1])))
    }
}

/// Fits the weights of all classes by least squares. Vertices far from their parallelogram count less.
pub(super) fn fit(mesh: &Connectivity, points: &Points) -> Weights {
    let mut sums = [[0f64; 5]; CLASSES];
    let mut completed = CompletedTriangles::default();
    for vertex in 0..points.len() as u32 {
        if !points.is_real(vertex) {
            continue;
        }
        completed.find(mesh, vertex, |other| points.is_real(other));
        let prediction = Prediction::new(&completed, mesh, points, vertex);
        let Some(class) = prediction.class else { continue };
        let dot = |a: Vector4, b: Vector4| (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum::<f64>();
        let target = sub(points.vector(vertex), prediction.mean);
        let error = sub(target, prediction.outward);
        let weight = 1.0 / (4.0 + dot(error, error)).sqrt();
        for (sum, (a, b)) in sums[class].iter_mut().zip([
            (prediction.outward, prediction.outward),
            (prediction.outward, prediction.middle),
            (prediction.middle, prediction.middle),
            (prediction.outward, target),
            (prediction.middle, target),
        ]) {
            *sum += weight * dot(a, b);
        }
    }
    // Normal equations of two unknowns, slightly regularised.
    sums.map(|[aa, ab, bb, at, bt]| {
        let (aa, bb) = (aa + 1e-3, bb + 1e-3);
        let determinant = aa * bb - ab * ab;
        let solved = [(at * bb - bt * ab) / determinant, (bt * aa - at * ab) / determinant];
        // The cast of NaN is 0.
        solved.map(|weight| (weight * f64::from(ONE)).round().clamp(-127.0, 127.0) as i8)
    })
}

/// Prediction of each coordinate from those before it, by a covariance.
struct Conditional {
    /// Variances of x, of y given x, and of z given both.
    variances: [f32; 3],
    /// Expected x, rounded.
    x: f32,
    start_y: f32,
    start_z: f32,
    /// Slopes of y over x, of z over x, and of z over y.
    y_x: f32,
    z_x: f32,
    z_y: f32,
}

impl Conditional {
    /// From the covariance, as an upper triangle, and the expected position.
    #[inline(always)]
    fn new([[xx, xy, xz, _], [yy, yz, zz, _]]: [Vector4; 2], expected: Vector4) -> Self {
        // A Cholesky-like decomposition with as few dependent divisions as possible.
        let inverse = 1.0 / xx;
        let (y_x, z_x) = (xy * inverse, xz * inverse);
        let minor = xx * yy - xy * xy;
        let minor = larger(minor, MIN_VARIANCE * xx);
        let mixed = xx * yz - xy * xz;
        let z_y = mixed / minor;
        let y_y = minor * inverse;
        let z_z = larger((xx * zz - xz * xz - mixed * z_y) * inverse, MIN_VARIANCE);
        let x = nearest(expected[0]);
        let rounding = x - expected[0];
        let z_x = z_x - z_y * y_x;
        let start_y = expected[1] + y_x * rounding;
        let start_z = expected[2] - z_y * expected[1] + z_x * rounding;
        Self { variances: [xx, y_y, z_z], x, start_y, start_z, y_x, z_x, z_y }
    }

    /// Expected y, given the error of x.
    #[inline(always)]
    fn y(&self, x_error: f32) -> f32 {
        nearest(self.start_y + self.y_x * x_error)
    }

    /// Expected z, given the error of x and y itself.
    #[inline(always)]
    fn z(&self, x_error: f32, y: f32) -> f32 {
        nearest(self.start_z + self.z_x * x_error + self.z_y * y)
    }
}

/// The plane of the triangle next to a vertex.
struct SurfacePlane {
    normal: Vector4,
    /// Squared length of `normal`, at least 1.
    squared_length: f32,
}

impl SurfacePlane {
    #[inline(always)]
    fn new(points: &Points, triangle: &CompletedTriangle) -> Self {
        let base = points.vector(triangle.a);
        let normal = cross(sub(points.vector(triangle.b), base), sub(points.vector(triangle.beyond), base));
        Self { normal, squared_length: larger(dot(normal, normal), 1.0) }
    }
}

struct ScanCoder<'a> {
    points: &'a mut Points,
    models: ScanModels,
    weights: [[f32; WEIGHTS]; CLASSES],
    /// Mean squared error along one direction within the surface, in grid steps.
    tangential: f32,
    /// Mean squared error across the surface, in grid steps.
    normal: f32,
    /// The vertex coded last, or [`NONE`].
    last: u32,
}

/// Codes all positions. Copies get the position of their original. Fails on positions outside the grid and on truncated
/// symbols.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    mesh: &Connectivity,
    points: &mut Points,
    weights: &Weights,
    originals: &[u32],
) -> Result<(), DecodeError> {
    let weights = weights.map(|class| class.map(|weight| f32::from(weight) / ONE));
    let mut scan = ScanCoder { points, models: ScanModels::new(), weights, tangential: 64.0, normal: 16.0, last: NONE };
    let mut completed = CompletedTriangles::default();
    for vertex in 0..scan.points.len() as u32 {
        if !scan.points.is_real(vertex) {
            continue;
        }
        let original = originals[vertex as usize];
        if original != vertex {
            scan.points.set_coordinates(vertex, scan.points.coordinates(original))?;
            scan.last = vertex;
            continue;
        }
        completed.find(mesh, vertex, |other| scan.points.is_real(other));
        let prediction = Prediction::new(&completed, mesh, scan.points, vertex);
        if let Some(class) = prediction.class {
            let expected = prediction.position(&scan.weights[class]);
            scan.code_predicted(coder, vertex, expected, completed.triangles())?;
            if vertex % 1024 == 0 && coder.overrun() {
                return Err(DecodeError::Invalid("a mesh's positions are truncated"));
            }
        } else {
            scan.code_first(coder, vertex)?;
        }
        scan.last = vertex;
    }
    Ok(())
}

impl ScanCoder<'_> {
    /// Codes the position of a vertex that completes no triangle, as the difference from the last vertex.
    fn code_first<C: SymbolCoder>(&mut self, coder: &mut C, vertex: u32) -> Result<(), DecodeError> {
        let last = if self.last == NONE { self.points.middle() } else { self.points.coordinates(self.last) };
        let mut position = [0; 3];
        for axis in 0..3 {
            let difference = zigzag(self.points.coordinate(vertex, axis).wrapping_sub(last[axis]));
            let difference = coder.number(&mut self.models.first[axis], difference);
            position[axis] = unzigzag(difference).wrapping_add(last[axis]);
        }
        self.points.set_coordinates(vertex, position)
    }

    #[inline(always)]
    fn code_predicted<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        vertex: u32,
        expected: Vector4,
        triangles: &[CompletedTriangle],
    ) -> Result<(), DecodeError> {
        let plane = SurfacePlane::new(self.points, &triangles[0]);
        let conditional = Conditional::new(self.covariance(triangles, &plane), expected);
        let mut errors = [0; 3];
        if C::WRITES {
            let [x, y, z, _] = self.points.vector(vertex);
            let x_error = x - conditional.x;
            errors = [x_error, y - conditional.y(x_error), z - conditional.z(x_error, y)].map(|v| v as i32);
        }
        let errors = self.models.code(coder, conditional.variances, errors).map(|v| v as f32);
        let x = errors[0] + conditional.x;
        let y = errors[1] + conditional.y(errors[0]);
        let z = errors[2] + conditional.z(errors[0], y);
        let position = [x, y, z, 1.0];
        self.points.set_vector(vertex, position)?;
        let residual = sub(position, expected);
        self.points.set_residual(vertex, outer_product(residual));
        self.adapt(residual, &plane);
        Ok(())
    }

    /// The covariance that the errors at the neighbours suggest, with the mean error of the mesh as prior.
    #[inline(always)]
    fn covariance(&self, triangles: &[CompletedTriangle], plane: &SurfacePlane) -> [Vector4; 2] {
        let mut sums = [[0f32; 4]; 2];
        let mut count = PRIOR;
        let mut learn = |other: u32| {
            let [x, y] = self.points.residual(other);
            sums = [add(sums[0], x), add(sums[1], y)];
            count += 1.0;
        };
        for (i, triangle) in triangles.iter().enumerate() {
            learn(triangle.beyond);
            learn(triangle.not_full());
            if i == 0 {
                learn(triangle.full);
            }
        }
        let share = 1.0 / count;
        let tilt = (self.normal - self.tangential) * (PRIOR * share) / plane.squared_length;
        let prior = self.tangential * PRIOR * share + MIN_VARIANCE;
        let [x, y] = outer_product(plane.normal);
        [
            add(add(scale(sums[0], share), [prior, 0.0, 0.0, 0.0]), scale(x, tilt)),
            add(add(scale(sums[1], share), [prior, 0.0, prior, 0.0]), scale(y, tilt)),
        ]
    }

    /// Moves the mean errors towards the last one.
    #[inline(always)]
    fn adapt(&mut self, residual: Vector4, plane: &SurfacePlane) {
        let squared = dot(residual, residual);
        let across = dot(residual, plane.normal);
        let across = across * across / plane.squared_length;
        self.normal += (across - self.normal) * ADAPTATION;
        self.tangential += ((squared - across) * 0.5 - self.tangential) * ADAPTATION;
        self.tangential = larger(self.tangential, 0.0);
    }
}
