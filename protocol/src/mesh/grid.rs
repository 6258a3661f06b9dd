//! Positions as whole numbers.
//!
//! In: positions in metres. Out: a [`PositionGrid`] and numbers on it. Next: the codec.

/// A cube of `2^bits` points a side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionGrid {
    /// Its lowest corner, in metres.
    pub min: [f64; 3],
    /// Between two points, in metres.
    pub step: f64,
    /// 8 to 16.
    pub bits: u8,
}

impl PositionGrid {
    /// The smallest cube with all `positions`, which must be finite; the longest side of their box is its side.
    pub fn around(positions: &[[f64; 3]], bits: u8) -> Self {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for position in positions {
            for k in 0..3 {
                min[k] = min[k].min(position[k]);
                max[k] = max[k].max(position[k]);
            }
        }
        let side = (0..3).map(|k| max[k] - min[k]).fold(0.0, f64::max);
        let step = side / f64::from((1u32 << bits) - 1);
        let usable = step > 0.0 && step.is_finite();
        Self { min: if positions.is_empty() { [0.0; 3] } else { min }, step: if usable { step } else { 1.0 }, bits }
    }

    /// The point nearest to a position.
    pub fn nearest(&self, position: [f64; 3]) -> [u32; 3] {
        let most = f64::from((1u32 << self.bits) - 1);
        std::array::from_fn(|k| ((position[k] - self.min[k]) / self.step + 0.5).floor().clamp(0.0, most) as u32)
    }

    /// Where a point is.
    pub fn place(&self, point: [u32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.min[k] + f64::from(point[k]) * self.step)
    }

    /// Whether its numbers need no more than four bytes each.
    pub(super) fn is_narrow(&self) -> bool {
        self.min.iter().chain([&self.step]).all(|v| f64::from(*v as f32) == *v)
    }
}
