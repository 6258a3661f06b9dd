//! Whole pictures.

mod hostile;
mod looks;
mod store;
mod texels;

use super::class::{AreaClass, LineClass};
use super::material::PaintMaterial;
use super::palette::PaintStyle;
use super::shape::Sidewalks;
use super::{GroundPainter, PaintArea, PaintError, PaintLine, PaintShape, over, *};

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
    let positions: Vec<[f64; 2]> = (0..500).map(|i| [f64::from(i) * 0.7 - 100.0, f64::from(i % 37) - 9.0]).collect();
    let one: Vec<f32> = positions.iter().map(|p| forwards.at(*p)).collect();
    let mut other: Vec<f32> = positions.iter().rev().map(|p| backwards.at(*p)).collect();
    other.reverse();
    assert_eq!(one, other);
    assert_ne!(one, positions.iter().map(|p| ValueNoise::new(3.0, 2).at(*p)).collect::<Vec<_>>());
}
