//! Positions on a grid, as the coders of geometry keep them.
//!
//! In: whole numbers. Out: the same as floating-point vectors, exact up to 16 bits. Next: `smooth`, `built`.

use crate::error::DecodeError;

/// x, y, z, and 1 for what has a place, 0 for a dummy.
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

#[inline]
pub(super) fn products([x, y, z, _]: Vector4) -> OuterProduct {
    [[x * x, x * y, x * z, 0.0], [y * y, y * z, z * z, 0.0]]
}

/// The whole number nearest to one, within 2^20 of either sign; of two the even one.
#[inline]
pub(super) fn nearest(v: f32) -> f32 {
    const MOST: f32 = 1_048_576.0;
    // Numbers from 2^23 to 2^24 are whole.
    const HIGH: f32 = 12_582_912.0;
    // Not `clamp`: what is no number becomes one.
    let v = if v > -MOST { v } else { -MOST };
    let v = if v < MOST { v } else { MOST };
    v + HIGH - HIGH
}

/// The larger one, or the second where one is no number.
#[inline]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// OuterProduct of a difference's coordinates: x by x, y and z; then y by y, y by z, z by z.
pub(super) type OuterProduct = [Vector4; 2];

/// A vertex's place, and products of what was left of it by [`super::smooth`]: side by side, as they are needed together.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
struct PointState {
    place: Vector4,
    left: OuterProduct,
}

/// Positions of a mesh's vertices, in the order of conquest.
#[derive(Debug)]
pub(super) struct Points {
    spots: Vec<PointState>,
    /// Whether there are no dummies.
    all_real: bool,
    /// Values are below two to this.
    bits: u32,
}

impl Points {
    /// All unknown: a reader's.
    pub(super) fn unknown(vertices: usize, dummies: &[u32], bits: u32) -> Self {
        let mut spots = vec![PointState { place: [0.0, 0.0, 0.0, 1.0], left: [[0.0; 4]; 2] }; vertices];
        dummies.iter().for_each(|dummy| spots[*dummy as usize].place = [0.0; 4]);
        Self { spots, all_real: dummies.is_empty(), bits }
    }

    pub(super) fn len(&self) -> usize {
        self.spots.len()
    }

    #[inline]
    pub(super) fn is_real(&self, vertex: u32) -> bool {
        self.all_real || self.spots[vertex as usize].place[3].to_bits() != 0
    }

    /// Whether all vertices have places.
    pub(super) fn all_real(&self) -> bool {
        self.all_real
    }

    #[inline]
    pub(super) fn at(&self, vertex: u32) -> Vector4 {
        self.spots[vertex as usize].place
    }

    /// OuterProduct of what was left of a vertex.
    #[inline]
    pub(super) fn left(&self, vertex: u32) -> OuterProduct {
        self.spots[vertex as usize].left
    }

    /// Says what was left.
    #[inline]
    pub(super) fn leave(&mut self, vertex: u32, left: OuterProduct) {
        self.spots[vertex as usize].left = left;
    }

    #[inline]
    pub(super) fn value(&self, vertex: u32, axis: usize) -> i32 {
        // From 2^23 on, bits count whole numbers: much faster than a cast that minds what is no number.
        const HIGH: f32 = 8_388_608.0;
        (self.spots[vertex as usize].place[axis] + HIGH).to_bits() as i32 - HIGH.to_bits() as i32
    }

    /// The middle of the grid.
    pub(super) fn middle(&self) -> [i32; 3] {
        [1 << (self.bits - 1); 3]
    }

    /// Gives a vertex its place in whole numbers, which must be on the grid.
    #[inline]
    pub(super) fn put_exact(&mut self, vertex: u32, place: Vector4) -> Result<(), DecodeError> {
        let end = (1u32 << self.bits) as f32;
        let [x, y, z, _] = place;
        let is_inside = |v: f32| v >= 0.0 && v < end;
        if !(is_inside(x) & is_inside(y) & is_inside(z)) {
            return Err(DecodeError::Invalid("a mesh's vertex lies off its grid"));
        }
        self.spots[vertex as usize].place = place;
        Ok(())
    }

    /// Gives a vertex its place, which must be on the grid.
    #[inline]
    pub(super) fn put(&mut self, vertex: u32, place: [i32; 3]) -> Result<(), DecodeError> {
        let [x, y, z] = place;
        if (x | y | z) >> self.bits != 0 {
            return Err(DecodeError::Invalid("a mesh's vertex lies off its grid"));
        }
        self.spots[vertex as usize].place = [x, y, z, 1].map(|v| v as f32);
        Ok(())
    }
}
