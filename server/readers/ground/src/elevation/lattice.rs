//! Places among the pixels of a raster for a regular grid on the map: exact at every 16th point, linear between.
//!
//! Within 16 steps of a metre or 30 m, a map's curvature is less than a millimetre or a centimetre.

use super::pixel_finder::PixelFinder;

/// Steps between exact points.
const SPACING: usize = 16;

/// A regular grid on the map: x east, y north.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapGrid {
    /// World position of the first point, the south-western one.
    pub(super) corner: [f64; 2],
    pub(super) step_m: f64,
    pub(super) size: [usize; 2],
}

/// How a grid's point lies in a raster.
#[derive(Debug, Clone, Copy)]
pub(super) struct RasterPoint {
    pub(super) pixel: [f64; 2],
    /// World height of a raster's 0, and of its 1 above that.
    pub(super) offset_m: f64,
    pub(super) scale: f64,
}

/// The exact points of a grid.
pub(super) struct Lattice {
    columns: usize,
    nodes: Vec<Option<RasterPoint>>,
}

impl MapGrid {
    pub(super) fn position(&self, x: usize, y: usize) -> [f64; 2] {
        [self.corner[0] + x as f64 * self.step_m, self.corner[1] + y as f64 * self.step_m]
    }
}

impl Lattice {
    /// `start` is a place in the raster from which pixels are sought.
    pub(super) fn new(grid: &MapGrid, finder: PixelFinder<'_>, start: [f64; 2]) -> Self {
        let [columns, rows] = grid.size.map(|n| n.div_ceil(SPACING) + 1);
        let mut nodes = Vec::with_capacity(columns * rows);
        let mut last = start;
        for row in 0..rows {
            for column in 0..columns {
                let world = grid.position(column * SPACING, row * SPACING);
                let pixel = finder.pixel(world, last).or_else(|| finder.pixel(world, start));
                last = pixel.unwrap_or(start);
                nodes.push(pixel.and_then(|pixel| {
                    let [zero, one] = [finder.world(pixel, 0.0)?[2], finder.world(pixel, 1.0)?[2]];
                    Some(RasterPoint { pixel, offset_m: zero, scale: one - zero })
                }));
            }
        }
        Self { columns, nodes }
    }

    /// The point in column `x` and row `y` of the grid; `None` where the raster's system is not defined.
    pub(super) fn point(&self, x: usize, y: usize) -> Option<RasterPoint> {
        let at = |column: usize, row: usize| self.nodes[row * self.columns + column];
        let ([column, row], [fx, fy]) = ([x / SPACING, y / SPACING], [x % SPACING, y % SPACING]);
        let west = mix(at(column, row)?, at(column, row + 1)?, fy);
        let east = mix(at(column + 1, row)?, at(column + 1, row + 1)?, fy);
        Some(mix(west, east, fx))
    }

    /// Lowest and highest place among the pixels of all points; `None` without any.
    pub(super) fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let mut pixels = self.nodes.iter().flatten().map(|node| node.pixel);
        let first = pixels.next()?;
        Some(pixels.fold([first, first], |[low, high], pixel| {
            [[0, 1].map(|axis| low[axis].min(pixel[axis])), [0, 1].map(|axis| high[axis].max(pixel[axis]))]
        }))
    }
}

fn mix(a: RasterPoint, b: RasterPoint, steps: usize) -> RasterPoint {
    let share = steps as f64 / SPACING as f64;
    let mix = |a: f64, b: f64| a + (b - a) * share;
    RasterPoint {
        pixel: [0, 1].map(|axis| mix(a.pixel[axis], b.pixel[axis])),
        offset_m: mix(a.offset_m, b.offset_m),
        scale: mix(a.scale, b.scale),
    }
}
