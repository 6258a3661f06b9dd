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

/// The whole number nearest to a coordinate, which is far below 2^20 of either sign; the same on every machine.
#[inline]
pub(super) fn nearest(v: f32) -> i32 {
    const HIGH: f32 = (1 << 20) as f32;
    (v + HIGH + 0.5) as i32 - (1 << 20)
}

/// Positions of a mesh's vertices, in the order of conquest.
#[derive(Debug)]
pub(super) struct Points {
    places: Vec<Place>,
    values: Vec<[i32; 3]>,
    /// Values are below two to this.
    bits: u32,
}

impl Points {
    /// All unknown: a reader's.
    pub(super) fn unknown(vertices: usize, dummies: &[u32], bits: u32) -> Self {
        let mut places = vec![[0.0, 0.0, 0.0, 1.0]; vertices];
        dummies.iter().for_each(|dummy| places[*dummy as usize] = [0.0; 4]);
        Self { places, values: vec![[0; 3]; vertices], bits }
    }

    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// All but dummies.
    pub(super) fn vertices(&self) -> impl Iterator<Item = u32> + use<> {
        let real: Vec<u32> = (0..self.len() as u32).filter(|vertex| self.is_real(*vertex)).collect();
        real.into_iter()
    }

    #[inline]
    pub(super) fn is_real(&self, vertex: u32) -> bool {
        self.places[vertex as usize][3] != 0.0
    }

    #[inline]
    pub(super) fn at(&self, vertex: u32) -> Place {
        self.places[vertex as usize]
    }

    #[inline]
    pub(super) fn value(&self, vertex: u32, axis: usize) -> i32 {
        self.values[vertex as usize][axis]
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
        self.values[vertex as usize] = place;
        self.places[vertex as usize] = [x as f32, y as f32, z as f32, 1.0];
        Ok(())
    }
}
