//! Positions on a grid, as the coders of geometry keep them.
//!
//! In: whole numbers. Out: the same as floating-point vectors, exact up to 16 bits. Next: `smooth`, `built`.

use crate::error::DecodeError;

/// x, y, z, and 1 for what has a place, 0 for a dummy.
pub(super) type Place = [f32; 4];

#[inline]
pub(super) fn add(a: Place, b: Place) -> Place {
    std::array::from_fn(|k| a[k] + b[k])
}

#[inline]
pub(super) fn sub(a: Place, b: Place) -> Place {
    std::array::from_fn(|k| a[k] - b[k])
}

#[inline]
pub(super) fn scale(a: Place, by: f32) -> Place {
    a.map(|v| v * by)
}

#[inline]
pub(super) fn cross(a: Place, b: Place) -> Place {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0], 0.0]
}

/// The whole number nearest to a coordinate, which is far below 2^22 of either sign; of two the even one.
#[inline]
pub(super) fn nearest(v: f32) -> i32 {
    // Numbers from 2^23 to 2^24 are whole, and their bits count them.
    const HIGH: f32 = 12_582_912.0;
    ((v + HIGH).to_bits() as i32).wrapping_sub(HIGH.to_bits() as i32)
}

/// A vertex's place, and what was left of it by [`super::smooth`]: side by side, as they are needed together.
#[derive(Debug, Clone, Copy)]
struct Spot {
    place: Place,
    left: Place,
}

/// Positions of a mesh's vertices, in the order of conquest.
#[derive(Debug)]
pub(super) struct Points {
    spots: Vec<Spot>,
    /// Values are below two to this.
    bits: u32,
}

impl Points {
    /// All unknown: a reader's.
    pub(super) fn unknown(vertices: usize, dummies: &[u32], bits: u32) -> Self {
        let mut spots = vec![Spot { place: [0.0, 0.0, 0.0, 1.0], left: [0.0; 4] }; vertices];
        dummies.iter().for_each(|dummy| spots[*dummy as usize].place = [0.0; 4]);
        Self { spots, bits }
    }

    pub(super) fn len(&self) -> usize {
        self.spots.len()
    }

    #[inline]
    pub(super) fn is_real(&self, vertex: u32) -> bool {
        self.spots[vertex as usize].place[3] != 0.0
    }

    #[inline]
    pub(super) fn at(&self, vertex: u32) -> Place {
        self.spots[vertex as usize].place
    }

    /// What was left of a vertex.
    #[inline]
    pub(super) fn left(&self, vertex: u32) -> Place {
        self.spots[vertex as usize].left
    }

    /// Says what was left.
    #[inline]
    pub(super) fn leave(&mut self, vertex: u32, left: Place) {
        self.spots[vertex as usize].left = left;
    }

    #[inline]
    pub(super) fn value(&self, vertex: u32, axis: usize) -> i32 {
        self.spots[vertex as usize].place[axis] as i32
    }

    /// The middle of the grid.
    pub(super) fn middle(&self) -> [i32; 3] {
        [1 << (self.bits - 1); 3]
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
