//! Value noise: random values at the points of a square lattice on the map, smooth between them.

/// Mixes the bits of a number (the finaliser of SplitMix64: Steele, Lea and Flood 2014, "Fast splittable pseudorandom
/// number generators").
pub fn mix_bits(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Noise of one lattice. It remembers the last cell, because most reads are of neighbours.
#[derive(Debug, Clone)]
pub(super) struct ValueNoise {
    /// Cells per metre.
    frequency: f64,
    seed: u64,
    cell: [i64; 2],
    /// South-west, south-east, north-west, north-east.
    corners: [f32; 4],
}

impl ValueNoise {
    pub(super) fn new(cell_m: f64, seed: u64) -> Self {
        let mut noise = Self { frequency: 1.0 / cell_m, seed, cell: [0, 0], corners: [0.0; 4] };
        noise.enter([0, 0]);
        noise
    }

    /// The value at a position in metres, from -1 to 1.
    pub(super) fn at(&mut self, position: [f64; 2]) -> f32 {
        let scaled = position.map(|v| v * self.frequency);
        // Positions are below 2^40 cells from the origin: painters check it.
        let cell = scaled.map(|v| v.floor() as i64);
        if cell != self.cell {
            self.enter(cell);
        }
        let [x, y] = scaled.map(|v| {
            let t = (v - v.floor()) as f32;
            t * t * (3.0 - 2.0 * t)
        });
        let [sw, se, nw, ne] = self.corners;
        let (south, north) = (sw + (se - sw) * x, nw + (ne - nw) * x);
        south + (north - south) * y
    }

    fn enter(&mut self, cell: [i64; 2]) {
        let [x, y] = cell;
        let value = |dx: i64, dy: i64| {
            let column = mix_bits(self.seed ^ x.wrapping_add(dx).cast_unsigned());
            let bits = mix_bits(column ^ y.wrapping_add(dy).cast_unsigned().wrapping_mul(0x9e37_79b9_7f4a_7c15));
            (bits >> 40) as f32 / (1u32 << 23) as f32 - 1.0
        };
        self.corners = [value(0, 0), value(1, 0), value(0, 1), value(1, 1)];
        self.cell = cell;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_and_uses_its_range() {
        let mut noise = ValueNoise::new(4.0, 7);
        let (mut low, mut high, mut sum) = (f32::MAX, f32::MIN, 0.0);
        let mut last = noise.at([25_496_000.0, 6_672_000.0]);
        for i in 0..40_000 {
            let value = noise.at([25_496_000.0 + 0.25 * f64::from(i), 6_672_000.0 + 0.05 * f64::from(i)]);
            assert!((value - last).abs() < 0.25, "{i}: {last} {value}");
            (low, high, sum, last) = (low.min(value), high.max(value), sum + value, value);
        }
        assert!((-1.0..-0.8).contains(&low) && (0.8..=1.0).contains(&high), "{low} {high}");
        assert!((sum / 40_000.0).abs() < 0.05, "{sum}");
    }

    #[test]
    fn noise_depends_on_the_place_only() {
        let (mut forwards, mut backwards) = (ValueNoise::new(3.0, 1), ValueNoise::new(3.0, 1));
        let positions: Vec<[f64; 2]> =
            (0..500).map(|i| [f64::from(i) * 0.7 - 100.0, f64::from(i % 37) - 9.0]).collect();
        let one: Vec<f32> = positions.iter().map(|p| forwards.at(*p)).collect();
        let mut other: Vec<f32> = positions.iter().rev().map(|p| backwards.at(*p)).collect();
        other.reverse();
        assert_eq!(one, other);
        assert_ne!(one, positions.iter().map(|p| ValueNoise::new(3.0, 2).at(*p)).collect::<Vec<_>>());
    }
}
