//! Whole pictures.

mod hostile;
mod looks;
mod store;
mod texels;

use super::class::{AreaClass, LineClass};
use super::material::PaintMaterial;
use super::palette::PaintStyle;
use super::shape::Sidewalks;
use super::{GroundPainter, PaintArea, PaintError, PaintLine, PaintShape, over};

/// A corner far from the origin, as in a national system, which is not on the grid of blocks.
const CORNER: [f64; 2] = [25_496_117.25, 6_672_041.5];
const TEXEL_M: f64 = 0.25;

/// Numbers that look like chance (Marsaglia 2003, "Xorshift RNGs").
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, limit: f64) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64 * limit
    }
}

fn at(x_m: f64, y_m: f64) -> [f64; 2] {
    [CORNER[0] + x_m, CORNER[1] + y_m]
}

fn rectangle(low: [f64; 2], high: [f64; 2]) -> Vec<[f64; 2]> {
    vec![at(low[0], low[1]), at(high[0], low[1]), at(high[0], high[1]), at(low[0], high[1])]
}

fn area(class: AreaClass, rings: Vec<Vec<[f64; 2]>>) -> PaintShape {
    PaintShape::Area(PaintArea { rings, class, surfacing: None })
}

fn line(class: LineClass, points: &[[f64; 2]]) -> PaintLine {
    PaintLine::new(class, points.iter().map(|[x, y]| at(*x, *y)).collect())
}

fn paint(shapes: &[PaintShape], size: [usize; 2]) -> Vec<[u8; 4]> {
    GroundPainter::new(TEXEL_M).unwrap().paint(shapes, CORNER, size).unwrap()
}
