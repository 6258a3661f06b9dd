//! Vertex positions on the grid, in the form that the position coders compute with.
//!
//! Coordinates are kept as f32 vectors of four lanes, which hold whole numbers of up to 16 bits exactly.

use crate::error::{DecodeError, invalid_if};

/// x, y, z, and a fourth lane: for a position 1, or 0 for a dummy vertex.
pub(super) type Vector4 = [f32; 4];

#[inline]
pub(super) fn add(a: Vector4, b: Vector4) -> Vector4 {
    std::array::from_fn(|k| a[k] + b[k])
}

#[inline]
pub(super) fn sub(a: Vector4, b: Vector4) -> Vector4 {
    std::array::from_fn(|k| a[k] - b[k])
}

#[inline]
pub(super) fn scale(a: Vector4, by: f32) -> Vector4 {
    a.map(|v| v * by)
}

#[inline]
pub(super) fn cross(a: Vector4, b: Vector4) -> Vector4 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0], 0.0]
}

/// The dot product of the first three lanes.
#[inline]
pub(super) fn dot(a: Vector4, b: Vector4) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The outer product of a vector with itself: xx, xy, xz; then yy, yz, zz.
pub(super) type OuterProduct = [Vector4; 2];

#[inline]
pub(super) fn outer_product([x, y, z, _]: Vector4) -> OuterProduct {
    [[x * x, x * y, x * z, 0.0], [y * y, y * z, z * z, 0.0]]
}

/// Rounds to the nearest whole number, ties to even. The result is clamped to 2^20 of either sign, also for NaN.
#[inline]
pub(super) fn nearest(v: f32) -> f32 {
    const LIMIT: f32 = 1_048_576.0;
    // f32 numbers from 2^23 to 2^24 are whole.
    const WHOLE: f32 = 12_582_912.0;
    // Not `clamp`, which keeps NaN.
    let v = if v > -LIMIT { v } else { -LIMIT };
    let v = if v < LIMIT { v } else { LIMIT };
    v + WHOLE - WHOLE
}

/// The larger number, or `b` if either is NaN.
#[inline]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// State of one vertex. Both fields are needed together, so they share a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
struct PointState {
    position: Vector4,
    /// Outer product of the prediction error; set by `scan_positions`.
    residual: OuterProduct,
}

/// Positions of all vertices in traversal order.
#[derive(Debug)]
pub(super) struct Points {
    states: Vec<PointState>,
    has_dummies: bool,
    bits: u32,
}

impl Points {
    /// All vertices at the origin.
    pub(super) fn new(vertices: usize, dummies: &[u32], bits: u32) -> Self {
        let mut states = vec![PointState { position: [0.0, 0.0, 0.0, 1.0], residual: [[0.0; 4]; 2] }; vertices];
        dummies.iter().for_each(|dummy| states[*dummy as usize].position = [0.0; 4]);
        Self { states, has_dummies: !dummies.is_empty(), bits }
    }

    pub(super) fn len(&self) -> usize {
        self.states.len()
    }

    /// Whether a vertex is not a dummy.
    #[inline]
    pub(super) fn is_real(&self, vertex: u32) -> bool {
        !self.has_dummies || self.states[vertex as usize].position[3].to_bits() != 0
    }

    pub(super) fn has_dummies(&self) -> bool {
        self.has_dummies
    }

    #[inline]
    pub(super) fn vector(&self, vertex: u32) -> Vector4 {
        self.states[vertex as usize].position
    }

    /// The position, and the outer product of the prediction error.
    #[inline(always)]
    pub(super) fn state(&self, vertex: u32) -> (Vector4, OuterProduct) {
        let state = &self.states[vertex as usize];
        (state.position, state.residual)
    }

    #[inline]
    pub(super) fn set_residual(&mut self, vertex: u32, residual: OuterProduct) {
        self.states[vertex as usize].residual = residual;
    }

    #[inline]
    pub(super) fn coordinate(&self, vertex: u32, axis: usize) -> i32 {
        // From 2^23 on, the bits of an f32 count whole numbers. This is faster than a cast, which must handle NaN.
        const WHOLE: f32 = 8_388_608.0;
        (self.states[vertex as usize].position[axis] + WHOLE).to_bits() as i32 - WHOLE.to_bits() as i32
    }

    #[inline]
    pub(super) fn coordinates(&self, vertex: u32) -> [i32; 3] {
        std::array::from_fn(|axis| self.coordinate(vertex, axis))
    }

    pub(super) fn middle(&self) -> [i32; 3] {
        [1 << (self.bits - 1); 3]
    }

    /// Sets a position of whole numbers. Fails if it is not on the grid.
    #[inline]
    pub(super) fn set_vector(&mut self, vertex: u32, position: Vector4) -> Result<(), DecodeError> {
        let end = (1u32 << self.bits) as f32;
        let [x, y, z, _] = position;
        let is_inside = |v: f32| v >= 0.0 && v < end;
        invalid_if(!(is_inside(x) & is_inside(y) & is_inside(z)), "a mesh's vertex lies outside its grid")?;
        self.states[vertex as usize].position = position;
        Ok(())
    }

    /// Sets a position. Fails if it is not on the grid.
    #[inline]
    pub(super) fn set_coordinates(&mut self, vertex: u32, position: [i32; 3]) -> Result<(), DecodeError> {
        let [x, y, z] = position;
        invalid_if((x | y | z) >> self.bits != 0, "a mesh's vertex lies outside its grid")?;
        self.states[vertex as usize].position = [x, y, z, 1].map(|v| v as f32);
        Ok(())
    }
}
