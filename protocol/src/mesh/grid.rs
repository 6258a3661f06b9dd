//! Quantisation of positions to a cubic grid.

/// A cube of `2^bits` points per side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionGrid {
    /// Position of point (0, 0, 0) in metres.
    pub min: [f64; 3],
    /// Distance between neighbouring points in metres.
    pub step: f64,
    /// 8 to 16.
    pub bits: u8,
}

impl PositionGrid {
    /// The smallest grid that contains all `positions` (metres, finite). Its side is the longest side of their box.
    pub fn enclosing(positions: &[[f64; 3]], bits: u8) -> Self {
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

    /// The grid point nearest to a position in metres.
    pub fn nearest(&self, position: [f64; 3]) -> [u32; 3] {
        let last = f64::from((1u32 << self.bits) - 1);
        std::array::from_fn(|k| ((position[k] - self.min[k]) / self.step + 0.5).floor().clamp(0.0, last) as u32)
    }

    pub(super) fn position_m(&self, point: [u32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.min[k] + f64::from(point[k]) * self.step)
    }

    /// Whether `min` and `step` are exact as f32.
    pub(super) fn fits_f32(&self) -> bool {
        self.min.iter().chain([&self.step]).all(|v| f64::from(*v as f32) == *v)
    }
}
