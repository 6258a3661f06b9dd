//! Weights of the prediction of scanned surfaces: fitted by the writer, and coded before the positions.

use super::completed::CompletedTriangles;
use super::connectivity::Connectivity;
use super::points::{Points, Vector4, dot, sub};
use super::scan_prediction::{CLASSES, Classes, FIRST_OF_MANY, OF_ONE, OF_ONE_PAIR, Prediction, WEIGHTS};
use crate::codec::rans::{SymbolCoder, SymbolModel};
use crate::codec::varint::{unzigzag, zigzag};
use crate::error::{DecodeError, invalid_if};

/// Scale of coded weights.
const ONE: f32 = 128.0;
/// Largest coded weight of either sign.
const LARGEST: i32 = 512;
/// Number of fits; each gives the vertices that the last one predicted badly less influence.
const FITS: usize = 6;
/// Squared error that is assumed to be typical before the first fit.
const FIRST_SQUARE: f64 = 16.0;
/// What a weight must save, in bits.
const BITS_PER_WEIGHT: f64 = 8.0;

type ClassWeights = [i32; WEIGHTS];

/// Weights of all classes in 1/[`ONE`]. A class without its own has those of the class before it, or the mean of the
/// parallelograms.
#[derive(Debug, Clone)]
pub(super) struct Weights {
    pub(super) classes: Classes,
    own: [Option<ClassWeights>; CLASSES],
}

/// Weights of the class whose predecessor has other features: the mean of the parallelograms.
fn typical(class: usize) -> Option<ClassWeights> {
    match class {
        0 => Some([128, -128, 0, 0, 0]),
        FIRST_OF_MANY => Some([85, -128, 0, 0, 0]),
        OF_ONE..FIRST_OF_MANY if (class - OF_ONE).is_multiple_of(OF_ONE_PAIR) => Some([64, -64, 64, -64, 0]),
        _ => None,
    }
}

/// The weights that a class uses.
fn used(class: usize, classes: Classes) -> &'static [usize] {
    match (class, classes) {
        (..OF_ONE, Classes::Degrees) => &[0, 1, 4],
        (..OF_ONE | FIRST_OF_MANY.., _) => &[0, 1],
        (_, Classes::Degrees) => &[0, 1, 2, 3, 4],
        _ => &[0, 1, 2, 3],
    }
}

impl Weights {
    pub(super) fn new(classes: Classes) -> Self {
        Self { classes, own: [None; CLASSES] }
    }

    pub(super) fn code<C: SymbolCoder>(&self, coder: &mut C) -> Result<[[f32; WEIGHTS]; CLASSES], DecodeError> {
        let mut own_model = SymbolModel::new(|i| [1, 1][i]);
        let mut models: [SymbolModel<32>; 2] = Default::default();
        let mut all = [[0.0; WEIGHTS]; CLASSES];
        let mut weights = [0; WEIGHTS];
        for class in 0..CLASSES {
            weights = typical(class).unwrap_or(weights);
            let own = self.own[class];
            if coder.flag(&mut own_model, own.is_some()) {
                let own = own.unwrap_or_default();
                for &k in used(class, self.classes) {
                    let difference = zigzag(own[k].wrapping_sub(weights[k]));
                    let difference = unzigzag(coder.number(&mut models[k % 2], difference));
                    weights[k] = weights[k].wrapping_add(difference);
                    invalid_if(weights[k].unsigned_abs() > LARGEST as u32, "a mesh's weights are too large")?;
                }
            }
            all[class] = weights.map(|weight| weight as f32 / ONE);
        }
        Ok(all)
    }

    /// The weights that are shortest together with the errors, as far as their logarithms tell.
    pub(super) fn fit(mesh: &Connectivity, points: &Points, classes: Classes) -> Self {
        let mut fitted = [[0f32; WEIGHTS]; CLASSES];
        for class in 0..CLASSES {
            let weights = typical(class).unwrap_or_else(|| fitted[class - 1].map(|weight| (weight * ONE) as i32));
            fitted[class] = weights.map(|weight| weight as f32 / ONE);
        }
        let mut typical_squares = [FIRST_SQUARE; CLASSES];
        for _ in 0..FITS {
            let mut sums = typical_squares.map(NormalEquations::new);
            for_each(mesh, points, classes, |prediction, target| {
                sums[prediction.class].learn(prediction, target, &fitted[prediction.class]);
            });
            for class in 0..CLASSES {
                fitted[class] = sums[class].solve(used(class, classes), fitted[class]);
                typical_squares[class] = sums[class].typical_square();
            }
        }
        Self { classes, own: choose(mesh, points, classes, &fitted) }
    }
}

/// Decides which classes get their own weights.
fn choose(
    mesh: &Connectivity,
    points: &Points,
    classes: Classes,
    fitted: &[[f32; WEIGHTS]; CLASSES],
) -> [Option<ClassWeights>; CLASSES] {
    // The classes from which each one could take over weights: itself and those before it, up to the first of a group.
    let mut first = 0;
    let mut groups = [0; CLASSES];
    for class in 0..CLASSES {
        first = if typical(class).is_some() { class } else { first };
        groups[class] = first;
    }
    // Estimated bits of the errors of a class with the weights of each class from its own back to the first, and with
    // the typical ones.
    let mut bits = vec![[0f64; OF_ONE_PAIR + 1]; CLASSES];
    for_each(mesh, points, classes, |prediction, target| {
        let (class, first) = (prediction.class, groups[prediction.class]);
        let bits = &mut bits[class];
        let cost = |weights: &[f32; WEIGHTS]| {
            let error = sub(target, prediction.position(weights));
            1.5 * rough_log2(f64::from(dot(error, error) + 2.0))
        };
        for (bits, weights) in bits.iter_mut().zip(&fitted[first..=class]) {
            *bits += cost(weights);
        }
        bits[OF_ONE_PAIR] += cost(&typical(first).unwrap_or_default().map(|weight| weight as f32 / ONE));
    });
    let mut own = [None; CLASSES];
    let mut last = OF_ONE_PAIR;
    for class in 0..CLASSES {
        let first = groups[class];
        last = if class == first { OF_ONE_PAIR } else { last };
        if bits[class][last] > bits[class][class - first] + BITS_PER_WEIGHT * used(class, classes).len() as f64 {
            last = class - first;
            own[class] = Some(fitted[class].map(|weight| (weight * ONE) as i32));
        }
    }
    own
}

/// Calls `f` with the prediction and the position of each vertex that completes a triangle.
fn for_each(mesh: &Connectivity, points: &Points, classes: Classes, mut f: impl FnMut(&Prediction, Vector4)) {
    let mut completed = CompletedTriangles::default();
    let mut prediction = Prediction::default();
    for vertex in 0..points.len() as u32 {
        if points.is_real(vertex) {
            completed.find(mesh, vertex, |other| points.is_real(other));
            if prediction.find(completed.triangles(), mesh, points, vertex, classes) {
                f(&prediction, points.vector(vertex));
            }
        }
    }
}

/// Sums for the least squares of one class.
#[derive(Debug, Clone)]
struct NormalEquations {
    matrix: [[f64; WEIGHTS]; WEIGHTS],
    target: [f64; WEIGHTS],
    /// A vertex with this squared error counts half.
    half: f64,
    /// Sum of the logarithms of the squared errors, and their number.
    logarithms: f64,
    count: f64,
}

impl NormalEquations {
    /// `typical_square` is the squared error of most vertices.
    fn new(typical_square: f64) -> Self {
        let half = 1.0 + 3.0 * typical_square;
        Self { matrix: Default::default(), target: Default::default(), half, logarithms: 0.0, count: 0.0 }
    }

    /// The geometric mean of the squared errors.
    fn typical_square(&self) -> f64 {
        if self.count > 0.0 { rough_exp2(self.logarithms / self.count) } else { FIRST_SQUARE }
    }

    /// Adds a vertex. What `weights` predict badly counts less.
    fn learn(&mut self, prediction: &Prediction, position: Vector4, weights: &[f32; WEIGHTS]) {
        let error = sub(position, prediction.position(weights));
        let square = f64::from(dot(error, error));
        let influence = 1.0 / (self.half + square);
        self.logarithms += rough_log2(square + 0.3);
        self.count += 1.0;
        let target = sub(position, prediction.base);
        for i in 0..WEIGHTS {
            let offset = prediction.offsets[i];
            for j in 0..=i {
                self.matrix[i][j] += influence * f64::from(dot(offset, prediction.offsets[j]));
            }
            self.target[i] += influence * f64::from(dot(offset, target));
        }
    }

    /// Solves for the `used` weights, drawn slightly towards `near`. The result is in multiples of 1/[`ONE`].
    fn solve(&self, used: &[usize], near: [f32; WEIGHTS]) -> [f32; WEIGHTS] {
        let count = used.len();
        let mut rows = [[0f64; WEIGHTS + 1]; WEIGHTS];
        for (row, &i) in rows.iter_mut().zip(used) {
            for (value, &j) in row.iter_mut().zip(used) {
                *value = self.matrix[i.max(j)][i.min(j)];
            }
        }
        for (k, &i) in used.iter().enumerate() {
            let more = 1e-2 + 1e-6 * rows[k][k];
            rows[k][k] += more;
            rows[k][WEIGHTS] = self.target[i] + more * f64::from(near[i]);
        }
        // Gaussian elimination. The matrix is positive definite, so no pivots are needed.
        for k in 0..count {
            let pivot = rows[k];
            for row in &mut rows[k + 1..count] {
                let factor = row[k] / pivot[k];
                row.iter_mut().zip(pivot).for_each(|(to, from)| *to -= factor * from);
            }
        }
        let mut solved = [0f64; WEIGHTS];
        for k in (0..count).rev() {
            let rest: f64 = (k + 1..count).map(|j| rows[k][j] * solved[j]).sum();
            solved[k] = (rows[k][WEIGHTS] - rest) / rows[k][k];
        }
        let mut weights = [0.0; WEIGHTS];
        for (&i, weight) in used.iter().zip(solved) {
            // The cast of NaN is 0.
            weights[i] = (weight * f64::from(ONE)).round().clamp(-512.0, 512.0) as i32 as f32 / ONE;
        }
        weights
    }
}

/// The binary logarithm of a positive number, linear between powers of two. Unlike that of the system's library, it is
/// the same on all machines, so that all encoders write the same bytes.
fn rough_log2(v: f64) -> f64 {
    (v.to_bits() as i64 - 1f64.to_bits() as i64) as f64 / (1u64 << 52) as f64
}

/// The inverse of [`rough_log2`].
fn rough_exp2(v: f64) -> f64 {
    f64::from_bits(((v * (1u64 << 52) as f64) as i64 + 1f64.to_bits() as i64) as u64)
}
