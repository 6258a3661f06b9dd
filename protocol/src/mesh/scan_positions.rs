//! Positions of meshes that are scans of something: neighbours say where a vertex will be, and how sure they are.
//!
//! In: a [`Connectivity`] and positions, or symbols. Out: symbols, or positions. Next: a person's eye.
//!
//! A vertex is predicted from the mean of its parallelograms and of its neighbours, with weights that the writer fitted to
//! the mesh (by how many triangles the vertex completes, and by degrees: they tell how wide an angle is). What is left is
//! taken for a normal distribution in space: its covariance is that of what was left at the neighbours. So the second
//! coordinate is predicted again once the first is known, and the third once both are: along a smooth surface that is what
//! a local frame would do, and along a scanner's rays it is better, without any rotation to be undone exactly.

use super::{
    completed::CompletedTriangles,
    connectivity::Connectivity,
    half_edge::NONE,
    points::{Points, Vector4, add, cross, larger, nearest, products, scale, sub},
};
use crate::{
    codec::{
        rans::{RAW, SymbolCoder, SymbolModel},
        varint::{unzigzag, zigzag},
    },
    error::DecodeError,
};

/// Classes of vertices that have weights of their own: 3 with one triangle, 12 with two, 3 with more.
pub(super) const CLASSES: usize = 18;
/// Weights of a class: of how far neighbours are from what is beyond them, and of the middle one of them.
pub(super) const WEIGHTS: usize = 2;
/// A weight of one.
pub(super) const UNIT: f32 = 64.0;

/// Weights in 1/64.
pub(super) type Weights = [[i8; WEIGHTS]; CLASSES];

/// The parallelogram's.
pub(super) const PLAIN: Weights = [[64, 0]; CLASSES];

/// Half-octaves of what is expected to be left.
const SCALES: usize = 36;
/// Tokens -7 to 7 have a symbol each, the last one stands for others.
const NEAR: i32 = 7;
const FAR: usize = 15;
/// Least variance that is believed in.
const LEAST: f32 = 0.1;
/// How much what is left on average counts against neighbours.
const PRIOR: f32 = 2.0;
/// How fast that average follows.
const FOLLOW: f32 = 0.1;

struct ScanModels {
    token: [[SymbolModel<16>; SCALES]; 3],
    far: SymbolModel<32>,
    seed: [SymbolModel<32>; 3],
}

impl ScanModels {
    fn new() -> Self {
        let make = || std::array::from_fn(|scale| SymbolModel::new(|symbol| expected(scale, symbol)));
        Self { token: [make(), make(), make()], far: SymbolModel::default(), seed: Default::default() }
    }

    /// Three coordinates' differences, expected to be about the roots of `variances`: tokens, then what is below them.
    #[inline]
    fn left<C: SymbolCoder>(&mut self, coder: &mut C, variances: [f32; 3], values: [i32; 3]) -> [i32; 3] {
        // The exponent of the variance counts half-octaves of its root.
        let scale = |variance: f32| ((variance.to_bits() >> 23) as i32 - 123).clamp(0, SCALES as i32 - 1) as usize;
        let scales = variances.map(scale);
        let shifts = scales.map(|scale| (scale as u32 / 2).saturating_sub(3));
        let tokens: [i32; 3] = std::array::from_fn(|axis| values[axis] >> shifts[axis]);
        let near = |token: i32| if (-NEAR..=NEAR).contains(&token) { (token + NEAR) as usize } else { FAR };
        let [x, y, z] = &mut self.token;
        let models = [&mut x[scales[0]], &mut y[scales[1]], &mut z[scales[2]]];
        let symbols = coder.three(models, tokens.map(near));
        let read = symbols.map(|symbol| symbol as i32 - NEAR);
        let tokens = if symbols.contains(&FAR) { self.far(coder, symbols, tokens) } else { read };
        if shifts == [0; 3] {
            return tokens;
        }
        let low = |axis: usize| values[axis] as u32 & ((1 << shifts[axis]) - 1);
        let [a, b, c] = shifts;
        if a + b + c <= RAW {
            let all = coder.raw(a + b + c, (low(0) << b | low(1)) << c | low(2));
            let lows = [all >> (b + c), all >> c & ((1 << b) - 1), all & ((1 << c) - 1)];
            return std::array::from_fn(|axis| tokens[axis].wrapping_shl(shifts[axis]) | lows[axis] as i32);
        }
        std::array::from_fn(|axis| tokens[axis].wrapping_shl(shifts[axis]) | coder.raw(shifts[axis], low(axis)) as i32)
    }

    #[cold]
    fn far<C: SymbolCoder>(&mut self, coder: &mut C, symbols: [usize; 3], tokens: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| {
            if symbols[axis] != FAR {
                return symbols[axis] as i32 - NEAR;
            }
            let token = tokens[axis];
            let beyond = token.unsigned_abs().wrapping_sub(NEAR as u32 + 1) << 1 | u32::from(token < 0);
            let beyond = coder.number(&mut self.far, beyond);
            // What was read may be anything; it is checked against the grid with all else.
            let distance = ((beyond >> 1) as i32).wrapping_add(NEAR + 1);
            if beyond & 1 == 1 { distance.wrapping_neg() } else { distance }
        })
    }
}

/// How often a token is expected before any was seen: bell-shaped, with long tails.
fn expected(scale: usize, symbol: usize) -> u32 {
    // 16 times the variance, in tokens.
    let variance = if scale < 6 { 1 << scale } else { 64 << (scale % 2) };
    let away = if symbol == FAR { 12 } else { (symbol as u32).abs_diff(NEAR as u32) };
    let width = variance + 16 * away * away;
    30 + 1_000_000 / width * variance / width * variance
}

/// What the triangles around a vertex say.
struct Prediction {
    class: Option<usize>,
    /// Mean of the neighbours.
    mean: Vector4,
    /// From what is beyond them to that mean.
    out: Vector4,
    /// From that mean to the neighbour in the middle.
    middle: Vector4,
}

impl Prediction {
    #[inline(always)]
    fn new(around: &CompletedTriangles, mesh: &Connectivity, points: &Points, vertex: u32) -> Self {
        let wings = around.wings();
        let (mut near, mut far, mut middle) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        for wing in wings {
            near = add(near, add(points.at(wing.a), points.at(wing.b)));
            far = add(far, points.at(wing.x));
        }
        for wing in wings.iter().skip(1) {
            middle = add(middle, points.at(wing.full));
        }
        let wide = (mesh.degree[vertex as usize].clamp(5, 7) - 5) as usize;
        let class = match wings.len() {
            0 => None,
            1 => Some(wide),
            2 => Some(3 + 3 * (mesh.degree[wings[1].full as usize].clamp(4, 7) - 4) as usize + wide),
            _ => Some(15 + wide),
        };
        let share = 1.0 / wings.len().max(1) as f32;
        let mean = scale(near, 0.5 * share);
        let middle = match wings.len() {
            0 | 1 => [0.0; 4],
            n => sub(scale(middle, 1.0 / (n - 1) as f32), mean),
        };
        Self { class, mean, out: sub(mean, scale(far, share)), middle }
    }

    #[inline]
    fn place(&self, weights: &[f32; WEIGHTS]) -> Vector4 {
        add(self.mean, add(scale(self.out, weights[0]), scale(self.middle, weights[1])))
    }
}

/// Weights that leave least, by least squares over all vertices; far ones count less.
pub(super) fn fit(mesh: &Connectivity, points: &Points) -> Weights {
    let mut sums = [[0f64; 5]; CLASSES];
    let mut around = CompletedTriangles::default();
    for vertex in 0..points.len() as u32 {
        if !points.is_real(vertex) {
            continue;
        }
        around.look(mesh, vertex, |other| points.is_real(other));
        let guess = Prediction::new(&around, mesh, points, vertex);
        let Some(class) = guess.class else { continue };
        let dot = |a: Vector4, b: Vector4| (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum::<f64>();
        let left = sub(points.at(vertex), guess.mean);
        let off = sub(left, guess.out);
        let weight = 1.0 / (4.0 + dot(off, off)).sqrt();
        for (sum, (a, b)) in sums[class].iter_mut().zip([
            (guess.out, guess.out),
            (guess.out, guess.middle),
            (guess.middle, guess.middle),
            (guess.out, left),
            (guess.middle, left),
        ]) {
            *sum += weight * dot(a, b);
        }
    }
    sums.map(|[aa, ab, bb, al, bl]| {
        let (aa, bb) = (aa + 1e-3, bb + 1e-3);
        let determinant = aa * bb - ab * ab;
        let solved = [(al * bb - bl * ab) / determinant, (bl * aa - al * ab) / determinant];
        // A cast of what is out of range, or not a number, is a number in range.
        solved.map(|weight| (weight * f64::from(UNIT)).round().clamp(-127.0, 127.0) as i8)
    })
}

/// Writes or reads all positions.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    mesh: &Connectivity,
    points: &mut Points,
    weights: &Weights,
    first: &[u32],
) -> Result<(), DecodeError> {
    let mut models = ScanModels::new();
    let weights = weights.map(|class| class.map(|weight| f32::from(weight) / UNIT));
    let (mut flat, mut steep) = (64f32, 16f32);
    let mut around = CompletedTriangles::default();
    let mut last = NONE;
    for vertex in 0..points.len() as u32 {
        if !points.is_real(vertex) {
            continue;
        }
        let original = first[vertex as usize];
        if original != vertex {
            points.put(vertex, std::array::from_fn(|axis| points.value(original, axis)))?;
            last = vertex;
            continue;
        }
        around.look(mesh, vertex, |other| points.is_real(other));
        let guess = Prediction::new(&around, mesh, points, vertex);
        let Some(class) = guess.class else {
            let last_place =
                if last == NONE { points.middle() } else { std::array::from_fn(|axis| points.value(last, axis)) };
            let mut place = [0; 3];
            for axis in 0..3 {
                let value = points.value(vertex, axis).wrapping_sub(last_place[axis]);
                let value = zigzag(value);
                let value = coder.number(&mut models.seed[axis], value);
                place[axis] = unzigzag(value).wrapping_add(last_place[axis]);
            }
            points.put(vertex, place)?;
            last = vertex;
            continue;
        };
        let wanted = guess.place(&weights[class]);
        let mut sums = [[0f32; 4]; 2];
        let mut count = PRIOR;
        let mut learn = |other: u32| {
            let [x, y] = points.left(other);
            sums = [add(sums[0], x), add(sums[1], y)];
            count += 1.0;
        };
        for (i, wing) in around.wings().iter().enumerate() {
            learn(wing.x);
            learn(if wing.full == wing.a { wing.b } else { wing.a });
            if i == 0 {
                learn(wing.full);
            }
        }
        let share = 1.0 / count;
        let wing = around.wings()[0];
        let base = points.at(wing.a);
        let normal = cross(sub(points.at(wing.b), base), sub(points.at(wing.x), base));
        let area = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
        let area = larger(area, 1.0);
        let tilt = (steep - flat) * (PRIOR * share) / area;
        let prior = flat * PRIOR * share + LEAST;
        let [x, y] = products(normal);
        let [even_x, even_y] = [[prior, 0.0, 0.0, 0.0], [prior, 0.0, prior, 0.0]];
        let [xx, xy, xz, _] = add(add(scale(sums[0], share), even_x), scale(x, tilt));
        let [yy, yz, zz, _] = add(add(scale(sums[1], share), even_y), scale(y, tilt));
        // The covariance taken apart: what each coordinate says of those after it. As few divisions as can be after another.
        let inverse = 1.0 / xx;
        let (y_x, z_x) = (xy * inverse, xz * inverse);
        let below = xx * yy - xy * xy;
        let below = larger(below, LEAST * xx);
        let beside = xx * yz - xy * xz;
        let z_y = beside / below;
        let y_y = below * inverse;
        let z_z = larger((xx * zz - xz * xz - beside * z_y) * inverse, LEAST);
        // What is expected of each coordinate, given what the ones before it turned out to be beyond the first expectation.
        let expected_x = nearest(wanted[0]);
        let off = expected_x - wanted[0];
        let z_x = z_x - z_y * y_x;
        let (start_y, start_z) = (wanted[1] + y_x * off, wanted[2] - z_y * wanted[1] + z_x * off);
        let second = |x: f32| nearest(start_y + y_x * x);
        let third = |x: f32, y: f32| nearest(start_z + z_x * x + z_y * y);
        let mut values = [0; 3];
        if C::WRITES {
            let [x, y, z, _] = points.at(vertex);
            let beyond = x - expected_x;
            values = [beyond, y - second(beyond), z - third(beyond, y)].map(|v| v as i32);
        }
        let values = models.left(coder, [xx, y_y, z_z], values).map(|v| v as f32);
        let x = values[0] + expected_x;
        let y = values[1] + second(values[0]);
        let z = values[2] + third(values[0], y);
        let place = [x, y, z, 1.0];
        points.put_exact(vertex, place)?;
        last = vertex;
        let rest = sub(place, wanted);
        points.leave(vertex, products(rest));
        let squared = rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2];
        let along = rest[0] * normal[0] + rest[1] * normal[1] + rest[2] * normal[2];
        let along = along * along / area;
        steep += (along - steep) * FOLLOW;
        flat += ((squared - along) * 0.5 - flat) * FOLLOW;
        flat = larger(flat, 0.0);
        if vertex % 1024 == 0 && coder.overrun() {
            return Err(DecodeError::Invalid("a mesh's positions are cut off"));
        }
    }
    Ok(())
}
