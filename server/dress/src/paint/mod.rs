//! Pictures of the ground from above: land use, water, roads, paths and rails, painted in colours of materials.
//!
//! Shapes on the map, in metres, become texels in sRGB with alpha, on a grid that is anchored to the map, so that
//! neighbouring pictures fit texel by texel. Terrain has them as textures.
//!
//! The picture is painted in blocks of 256 x 256 texels with 16 samples each. A sample holds a
//! material instead of a colour. Shapes replace each other without blending, so there is no gap between areas with
//! a common border. The colour of a texel is the mean of its samples in linear light.

mod canvas;
mod class;
mod clip;
mod error;
mod junctions;
mod material;
mod painter;
mod palette;
mod pattern;
mod prepare;
mod reach;
mod resolve;
mod road_paint;
mod shape;
mod stroke;
mod surfacing;
mod tags;
#[cfg(test)]
mod tests;

pub use class::{AreaClass, LineClass};
pub use clip::{between, clip_segment};
pub use error::PaintError;
pub use painter::{GroundPainter, over};
pub use shape::{PaintArea, PaintLine, PaintShape, Sidewalks};
pub use tags::{LineLook, area_look, is_zebra, line_look};

/// Mixes the bits of a number (the finaliser of SplitMix64: Steele, Lea and Flood 2014, "Fast splittable pseudorandom
/// number generators").
pub fn mix_bits(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Noise of one lattice. It remembers the last cell, because most reads are of neighbours.
#[derive(Debug, Clone)]
struct ValueNoise {
    /// Cells per metre.
    frequency: f64,
    seed: u64,
    cell: [i64; 2],
    /// South-west, south-east, north-west, north-east.
    corners: [f32; 4],
}

impl ValueNoise {
    fn new(cell_m: f64, seed: u64) -> Self {
        let mut noise = Self { frequency: 1.0 / cell_m, seed, cell: [0, 0], corners: [0.0; 4] };
        noise.enter([0, 0]);
        noise
    }

    /// The value at a position in metres, from -1 to 1.
    fn at(&mut self, position: [f64; 2]) -> f32 {
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
