//! Positions of scanned surfaces, predicted with an estimated covariance.
//!
//! A vertex is predicted from its neighbours and the vertices beyond them, with the weights of its class
//! (`scan_prediction`), which the writer fitted to the mesh (`scan_weights`). The prediction error is taken as a normal
//! distribution in space, with the covariance of the errors at the neighbours, relative to the mean error of their
//! classes. So y is predicted again once x is known, and z once both are known. Along a smooth surface this has the
//! effect of a local frame, and along a scanner's rays it is better, without a rotation that must be undone exactly.
//!
//! All computations are IEEE single precision in the order of the source, so that all machines decode the same.

use super::completed::CompletedTriangles;
use super::connectivity::Connectivity;
use super::half_edge::NONE;
use super::points::{Points, Vector4, add, dot, larger, nearest, outer_product, scale, sub};
use super::scan_prediction::{CLASSES, Prediction, WEIGHTS};
use super::scan_weights::Weights;
use crate::codec::rans::{RAW, SymbolCoder, SymbolModel};
use crate::codec::varint::{unzigzag, zigzag};
use crate::error::{DecodeError, invalid_if};

/// Smallest variance that is assumed, in grid steps squared.
const MIN_VARIANCE: f32 = 0.1;

/// Weight of the mean error of the class, in neighbours.
const PRIOR: f32 = 3.0;
/// Part of the level of a class that does not depend on its errors.
const LEAST_LEVEL: f32 = 1.0;
/// Number of vertices of a class after which its mean error moves at the same rate.
const SETTLED: usize = 32;

/// By how much the mean error of a class moves towards the next error.
const RATES: [f32; SETTLED + 1] = {
    let mut rates = [0.0; SETTLED + 1];
    let mut i = 0;
    while i <= SETTLED {
        rates[i] = 1.0 / (i as f32 + 1.5);
        i += 1;
    }
    rates
};

/// Prediction of each coordinate from those before it, by a covariance.
struct Conditional {
    /// Variances of x, of y given x, and of z given both.
    variances: [f32; 3],
    x: Expected,
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
        let x = Expected::new(expected[0]);
        let rounding = x.nearest - expected[0];
        let z_x = z_x - z_y * y_x;
        let start_y = expected[1] + y_x * rounding;
        let start_z = expected[2] - z_y * expected[1] + z_x * rounding;
        Self { variances: [xx, y_y, z_z], x, start_y, start_z, y_x, z_x, z_y }
    }

    #[inline(always)]
    fn y(&self, x_error: f32) -> Expected {
        Expected::new(self.start_y + self.y_x * x_error)
    }

    /// Expected z, given the error of x and y itself.
    #[inline(always)]
    fn z(&self, x_error: f32, y: f32) -> Expected {
        Expected::new(self.start_z + self.z_x * x_error + self.z_y * y)
    }
}

/// A coordinate as far as it is known before its error.
struct Expected {
    nearest: f32,
    /// 1 if the expected value is not below the nearest whole number, otherwise -1. Errors are coded times this, because
    /// they are more often on this side.
    side: f32,
}

impl Expected {
    #[inline(always)]
    fn new(value: f32) -> Self {
        let nearest = nearest(value);
        Self { nearest, side: if value < nearest { -1.0 } else { 1.0 } }
    }

    /// The coordinate with this coded error.
    #[inline(always)]
    fn plus(&self, error: f32) -> f32 {
        error * self.side + self.nearest
    }

    /// The inverse of [`Expected::plus`].
    #[inline(always)]
    fn error(&self, coordinate: f32) -> i32 {
        ((coordinate - self.nearest) * self.side) as i32
    }
}

/// Weights and mean squared errors of one class of vertices.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct ClassState {
    weights: [f32; WEIGHTS],
    /// Along one direction within the surface, in grid steps.
    tangential: f32,
    /// Across the surface, in grid steps.
    normal: f32,
    /// Number of vertices, at most [`SETTLED`].
    count: u32,
}

struct ScanCoder<'a> {
    points: &'a mut Points,
    models: ScanModels,
    states: [ClassState; CLASSES],
    /// The class of the last vertex with as many neighbours.
    last_class: [usize; 16],
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
    let state = |weights| ClassState { weights, tangential: 64.0, normal: 16.0, count: 0 };
    let states = weights.code(coder)?.map(state);
    let mut scan = ScanCoder { points, models: ScanModels::new(), states, last_class: [0; 16], last: NONE };
    let mut completed = CompletedTriangles::default();
    let mut prediction = Prediction::default();
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
        if prediction.find(completed.triangles(), mesh, scan.points, vertex, weights.classes) {
            scan.code_predicted(coder, vertex, &prediction)?;
            invalid_if(vertex % 1024 == 0 && coder.overrun(), "a mesh's positions are truncated")?;
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
        prediction: &Prediction,
    ) -> Result<(), DecodeError> {
        let class = prediction.class;
        let mut state = self.states[class];
        let last_class = &mut self.last_class[prediction.neighbours % 16];
        if state.count == 0 {
            let ClassState { tangential, normal, .. } = self.states[*last_class];
            state = ClassState { tangential, normal, ..state };
        }
        *last_class = class;
        let expected = prediction.position(&state.weights);
        let level = (state.tangential + state.tangential + state.normal) * (1.0 / 3.0) + LEAST_LEVEL;
        let conditional = Conditional::new(covariance(prediction, &state, level), expected);
        let mut errors = [0; 3];
        if C::WRITES {
            let [x, y, z, _] = self.points.vector(vertex);
            let x_error = x - conditional.x.nearest;
            errors = [conditional.x.error(x), conditional.y(x_error).error(y), conditional.z(x_error, y).error(z)];
        }
        let errors = self.models.code(coder, conditional.variances, errors).map(|v| v as f32);
        let x = conditional.x.plus(errors[0]);
        let x_error = errors[0] * conditional.x.side;
        let y = conditional.y(x_error).plus(errors[1]);
        let z = conditional.z(x_error, y).plus(errors[2]);
        let position = [x, y, z, 1.0];
        self.points.set_vector(vertex, position)?;
        let residual = sub(position, expected);
        let inverse = 1.0 / level;
        self.points.set_residual(vertex, outer_product(residual).map(|products| scale(products, inverse)));
        let across = dot(residual, prediction.plane.normal);
        let across = across * across * prediction.plane.inverse;
        let along = (dot(residual, residual) - across) * 0.5;
        let rate = RATES[state.count as usize % (SETTLED + 1)];
        state.normal += (across - state.normal) * rate;
        state.tangential = larger(state.tangential + (along - state.tangential) * rate, 0.0);
        state.count = (state.count + 1).min(SETTLED as u32);
        self.states[class] = state;
        Ok(())
    }
}

/// The covariance that the errors at the neighbours suggest, with the mean error of the class as prior.
#[inline(always)]
fn covariance(prediction: &Prediction, state: &ClassState, level: f32) -> [Vector4; 2] {
    let share = 1.0 / (prediction.neighbours as f32 + PRIOR);
    let tilt = (state.normal - state.tangential) * (PRIOR * share) * prediction.plane.inverse;
    let prior = state.tangential * (PRIOR * share) + MIN_VARIANCE;
    let share = share * level;
    let [x, y] = outer_product(prediction.plane.normal);
    [
        add(add(scale(prediction.products[0], share), [prior, 0.0, 0.0, 0.0]), scale(x, tilt)),
        add(add(scale(prediction.products[1], share), [prior, 0.0, prior, 0.0]), scale(y, tilt)),
    ]
}

/// Number of half-octaves of the standard deviation that are distinguished.
const SCALES: usize = 36;
/// Tokens from `-NEAR` to `NEAR` have a symbol each.
const NEAR: i32 = 7;
/// Symbol of all other tokens.
const FAR: usize = 15;

/// Models of prediction errors whose expected size is known as a variance, and of the first vertex of a piece.
///
/// An error is shifted right so that its standard deviation is two or three steps. The rest is coded as a symbol, by
/// the half-octave of the variance, and the bits that were shifted out are coded raw.
pub(super) struct ScanModels {
    /// By axis and scale.
    token: [[SymbolModel<16>; SCALES]; 3],
    far_token: SymbolModel<32>,
    /// By axis: difference of a piece's first vertex from the last coded vertex.
    pub(super) first: [SymbolModel<32>; 3],
}

impl ScanModels {
    pub(super) fn new() -> Self {
        let shapes = SHAPES.map(|shape| SymbolModel::new(|symbol| typical_count(shape, symbol)));
        let of_axis: [_; SCALES] =
            std::array::from_fn(|scale| shapes[if scale < 6 { scale } else { 6 + scale % 2 }].clone());
        Self {
            token: [of_axis.clone(), of_axis.clone(), of_axis],
            far_token: SymbolModel::default(),
            first: Default::default(),
        }
    }

    /// Codes the errors of three coordinates with these variances.
    #[inline]
    pub(super) fn code<C: SymbolCoder>(&mut self, coder: &mut C, variances: [f32; 3], errors: [i32; 3]) -> [i32; 3] {
        // The exponent of the variance counts half-octaves of the standard deviation.
        let scale = |variance: f32| ((variance.to_bits() >> 23) as i32 - 123).clamp(0, SCALES as i32 - 1) as usize;
        let scales = variances.map(scale);
        let shifts = scales.map(|scale| (scale as u32 / 2).saturating_sub(3));
        let tokens: [i32; 3] = std::array::from_fn(|axis| errors[axis] >> shifts[axis]);
        let to_symbol = |token: i32| if (-NEAR..=NEAR).contains(&token) { (token + NEAR) as usize } else { FAR };
        let [x, y, z] = &mut self.token;
        let models = [&mut x[scales[0]], &mut y[scales[1]], &mut z[scales[2]]];
        let symbols = coder.three(models, tokens.map(to_symbol));
        let near = symbols.map(|symbol| symbol as i32 - NEAR);
        let tokens = if symbols.contains(&FAR) { self.code_far(coder, symbols, tokens) } else { near };
        if shifts == [0; 3] {
            return tokens;
        }
        let low = |axis: usize| errors[axis] as u32 & ((1 << shifts[axis]) - 1);
        let [a, b, c] = shifts;
        if a + b + c <= RAW {
            let all = coder.raw(a + b + c, (low(0) << b | low(1)) << c | low(2));
            let lows = [all >> (b + c), all >> c & ((1 << b) - 1), all & ((1 << c) - 1)];
            return std::array::from_fn(|axis| tokens[axis].wrapping_shl(shifts[axis]) | lows[axis] as i32);
        }
        std::array::from_fn(|axis| tokens[axis].wrapping_shl(shifts[axis]) | coder.raw(shifts[axis], low(axis)) as i32)
    }

    /// Codes the tokens whose symbol is [`FAR`] as numbers.
    #[cold]
    fn code_far<C: SymbolCoder>(&mut self, coder: &mut C, symbols: [usize; 3], tokens: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| {
            if symbols[axis] != FAR {
                return symbols[axis] as i32 - NEAR;
            }
            let token = tokens[axis];
            let excess = token.unsigned_abs().wrapping_sub(NEAR as u32 + 1) << 1 | u32::from(token < 0);
            let excess = coder.number(&mut self.far_token, excess);
            // A reader may get any number here. The position is checked against the grid later.
            let magnitude = ((excess >> 1) as i32).wrapping_add(NEAR + 1);
            if excess & 1 == 1 { magnitude.wrapping_neg() } else { magnitude }
        })
    }
}

/// Initial frequencies: of the tokens -1 and 1, from each token to the next one, and of [`FAR`]. Token 0 has 1000.
/// For the scales 0 to 5, and for larger even and odd ones. Read off the errors of about thirty meshes.
const SHAPES: [[u32; 4]; 8] = [
    [20, 100, 100, 1],
    [25, 140, 100, 1],
    [70, 290, 100, 1],
    [150, 400, 130, 2],
    [330, 590, 270, 6],
    [420, 650, 410, 13],
    [550, 550, 560, 55],
    [600, 600, 670, 200],
];

/// Initial frequency of a symbol: a geometric distribution.
fn typical_count([below, above, step, far]: [u32; 4], symbol: usize) -> u32 {
    if symbol == FAR {
        return 1000 * far;
    }
    let middle = NEAR as usize;
    let mut count = 1_000_000;
    for distance in 0..symbol.abs_diff(middle) {
        let first = if symbol < middle { below } else { above };
        count = count / 1000 * if distance == 0 { first } else { step };
    }
    count + 100
}
