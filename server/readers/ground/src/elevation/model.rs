//! One raster with its place in the world: heights of the ground, or a picture of it.

use super::lattice::{Lattice, MapGrid, RasterPoint};
use super::missing::{MissingHeights, OddZeros};
use super::pixel_finder::PixelFinder;
use crate::raster::{GeoPlace, HEIGHTS_M, Raster, RasterError, RasterSize, Window};
use insula_place::placement::{FirstShape, Placement, World};
use insula_source::error::InputError;
use insula_source::input::LocalFile;
use insula_source::object::CrsReference;
use std::cell::RefCell;
use std::ops::RangeInclusive;

/// Colours with less alpha are none.
const OPAQUE: u8 = 128;
/// WindowPixels over which a model fades into coarser ones at its border.
const FADE_PX: f64 = 12.0;
/// A smaller copy of the raster is read if its pixels are at most this many steps of the wanted grid.
const MAX_PIXEL_STEPS: f64 = 1.25;
/// Pixels of a raster are on a grid if they are so near to it.
const ALIGNED_M: f64 = 1e-3;
/// Points along each side of a raster by which its bounds are known.
const BORDER_STEPS: u32 = 16;

/// An opened raster.
pub(super) struct PlacedRaster {
    pub(super) label: String,
    /// Number of its report.
    pub(super) source: usize,
    /// It shows the land around the city.
    pub(super) is_surroundings: bool,
    /// Heights outside of it are missing.
    pub(super) heights_m: RangeInclusive<f64>,
    missing: RefCell<MissingHeights>,
    zeros: RefCell<OddZeros>,
    /// How its system was guessed.
    pub(super) guess: Option<String>,
    raster: RefCell<Raster>,
    place: GeoPlace,
    crs: Option<CrsReference>,
    /// Known once the world has a coordinate system.
    pub(super) placed: Option<RasterPlacement>,
    /// Its own and that of its mask. They are copies, if they were packed.
    _files: Vec<LocalFile>,
}

/// A raster's place in the world.
pub(super) struct RasterPlacement {
    pub(super) placement: Placement,
    /// Lowest and highest corner on the map.
    pub(super) bounds: [[f64; 2]; 2],
    /// Metres from pixel to pixel.
    pub(super) pixel_m: f64,
    /// Position of the first pixel's middle, if columns and rows run along the axes of the map at equal distances.
    pub(super) aligned: Option<[f64; 2]>,
}

/// A height, and how much it counts against coarser models: from 0 at the model's border to 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct WeightedHeight {
    pub(super) height_m: f32,
    pub(super) weight: f32,
}

impl PlacedRaster {
    pub(super) fn new(
        label: &str,
        source: usize,
        raster: Raster,
        place: GeoPlace,
        crs: Option<CrsReference>,
        files: Vec<LocalFile>,
    ) -> Self {
        Self {
            label: label.to_owned(),
            source,
            is_surroundings: false,
            heights_m: HEIGHTS_M,
            missing: RefCell::default(),
            zeros: RefCell::default(),
            guess: None,
            raster: RefCell::new(raster),
            place,
            crs,
            placed: None,
            _files: files,
        }
    }

    /// Finds the raster's place in the world, which gets the raster's system if it has none. Fails if the system is not
    /// known, or if the raster has no place in the world.
    pub(super) fn settle(&mut self, world: &mut World) -> Result<(), InputError> {
        if self.placed.is_some() {
            return Ok(());
        }
        let RasterSize { width, height } = self.raster.borrow().facts().size;
        let middle = self.place.position(f64::from(width) / 2.0, f64::from(height) / 2.0);
        let pixel = [0, 1].map(|axis| self.place.column[axis].abs() + self.place.row[axis].abs());
        let first = FirstShape::at(middle, Some(pixel));
        if self.crs.is_none() {
            let (reference, text) = world.guess(&first);
            (self.crs, self.guess) = (reference, Some(text));
        }
        let mut placement = match &self.crs {
            Some(crs) => world.place(&self.label, crs)?,
            None => Placement::Unknown,
        };
        placement.settle(world, &self.label, first)?;
        let finder = PixelFinder { place: self.place, placement: &placement };
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for i in 0..=BORDER_STEPS {
            for j in 0..=BORDER_STEPS {
                let at = |side: u32, step: u32| f64::from(side - 1) * f64::from(step) / f64::from(BORDER_STEPS);
                let Some(world) = finder.world([at(width, i), at(height, j)], 0.0) else { continue };
                for axis in 0..2 {
                    low[axis] = low[axis].min(world[axis]);
                    high[axis] = high[axis].max(world[axis]);
                }
            }
        }
        let steps = finder.derivatives([f64::from(width) / 2.0, f64::from(height) / 2.0]);
        let pixel_m =
            steps.map_or(0.0, |steps| steps.iter().map(|[x, y]| libm::hypot(*x, *y)).fold(f64::MAX, f64::min));
        if !(pixel_m > 0.0 && low[0] <= high[0]) {
            let what = "it lies where the city's coordinate system is not defined";
            return Err(InputError::misplaced(&self.label, what));
        }
        let aligned = finder.world([0.0; 2], 0.0).map(|[x, y, _]| [x, y]).filter(|first| {
            let last = [width, height].map(|side| f64::from(side.saturating_sub(1)));
            let is_at = |pixel: [f64; 2]| {
                let expected = [first[0] + pixel[0] * pixel_m, first[1] - pixel[1] * pixel_m];
                let found = finder.world(pixel, 0.0);
                found.is_some_and(|found| (0..2).all(|axis| (found[axis] - expected[axis]).abs() < ALIGNED_M))
            };
            [[last[0], 0.0], [0.0, last[1]], last].into_iter().all(is_at)
        });
        self.placed = Some(RasterPlacement { placement, bounds: [low, high], pixel_m, aligned });
        Ok(())
    }

    /// Names of the first tiles that could not be read, and the number of all.
    pub(super) fn bad_tiles(&self) -> (Vec<String>, usize) {
        let raster = self.raster.borrow();
        let (names, count) = raster.bad_tiles();
        (names.to_vec(), count)
    }

    /// Heights of a grid; `None` where the raster has none. Fails if it cannot be read.
    pub(super) fn heights(&self, grid: &MapGrid) -> Result<Vec<Option<WeightedHeight>>, RasterError> {
        self.sample(
            grid,
            |raster, window, level| self.read_heights(raster, window, level),
            |pixels, point| {
                let (height, weight) =
                    pixels.blend(point.pixel, |height| height.is_finite().then(|| [f64::from(*height)]))?;
                let height_m = (point.offset_m + point.scale * height[0]) as f32;
                Some(WeightedHeight { height_m, weight })
            },
        )
    }

    /// Pixels that a grid over a rectangle reads, and the bytes of the file that has them; `None` without a place, and of formats whose pixels
    /// take bytes each.
    pub(super) fn pixels_under(&self, [low, high]: [[f64; 2]; 2], step_m: f64) -> Option<[u64; 2]> {
        let placed = self.placed.as_ref()?;
        let raster = self.raster.borrow();
        let bytes = raster.packed_bytes()?;
        let size = raster.facts().levels.get(self.level_for(&raster, placed, step_m))?;
        let share = |axis: usize| {
            let [from, to] = [placed.bounds[0][axis], placed.bounds[1][axis]];
            ((to.min(high[axis]) - from.max(low[axis])) / (to - from)).clamp(0.0, 1.0)
        };
        Some([(share(0) * share(1) * size.pixels() as f64) as u64, bytes])
    }

    /// Heights of a window; those out of range are missing, and noted.
    fn read_heights(&self, raster: &mut Raster, window: Window, level: usize) -> Result<Vec<f32>, RasterError> {
        let mut heights = raster.read_heights(window, level)?;
        let unit_m = self.placed.as_ref().map_or(1.0, |placed| placed.placement.height_unit_m());
        let width = raster.facts().levels.get(level).map_or(0, |size| u64::from(size.width));
        for (index, height) in heights.iter_mut().enumerate().filter(|(_, height)| height.is_finite()) {
            let (x, y) = (index as u32 % window.width, index as u32 / window.width);
            let pixel = u64::from(window.y + y) * width + u64::from(window.x + x);
            if self.heights_m.contains(&(f64::from(*height) * unit_m)) {
                self.zeros.borrow_mut().add(*height, level, pixel);
            } else {
                self.missing.borrow_mut().add(*height, level, pixel);
                *height = f32::NAN;
            }
        }
        Ok(heights)
    }

    /// Which heights were taken as missing so far.
    pub(super) fn missing(&self) -> Vec<String> {
        self.missing.borrow().texts()
    }

    /// Heights of 0 that may be missing ones.
    pub(super) fn odd_zeros(&self) -> Option<String> {
        self.zeros.borrow().text().filter(|_| !self.is_surroundings)
    }

    /// Colours of a grid as 8-bit sRGB; `None` where the raster has none. Fails if it cannot be read.
    pub(super) fn colours(&self, grid: &MapGrid) -> Result<Vec<Option<[u8; 3]>>, RasterError> {
        self.sample(grid, Raster::read_colours, |pixels, point| {
            let opaque = |rgba: &[u8; 4]| (rgba[3] >= OPAQUE).then(|| [rgba[0], rgba[1], rgba[2]].map(f64::from));
            let (rgb, _) = pixels.blend(point.pixel, opaque)?;
            Some(rgb.map(|value| value.round() as u8))
        })
    }

    /// What `value` makes of the pixels around each point of a grid.
    fn sample<P, V: Copy>(
        &self,
        grid: &MapGrid,
        read: impl Fn(&mut Raster, Window, usize) -> Result<Vec<P>, RasterError>,
        value: impl Fn(&WindowPixels<'_, P>, RasterPoint) -> Option<V>,
    ) -> Result<Vec<Option<V>>, RasterError> {
        let len = grid.size[0] * grid.size[1];
        let Some(placed) = &self.placed else { return Ok(vec![None; len]) };
        let mut raster = self.raster.borrow_mut();
        let level = self.level_for(&raster, placed, grid.step_m);
        let (size, place) = (raster.facts().levels[level], raster.facts().place_of_level(level).unwrap_or(self.place));
        let finder = PixelFinder { place, placement: &placed.placement };
        let lattice = Lattice::new(grid, finder, [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0]);
        let Some(window) = lattice.bounds().and_then(|bounds| window_around(bounds, size)) else {
            return Ok(vec![None; len]);
        };
        let values = read(&mut raster, window, level)?;
        let pixels = WindowPixels { window, size, values: &values };
        let points = (0..grid.size[1]).flat_map(|y| (0..grid.size[0]).map(move |x| [x, y]));
        Ok(points.map(|[x, y]| value(&pixels, lattice.point(x, y)?)).collect())
    }

    /// The smallest copy of the raster that is fine enough for a grid.
    fn level_for(&self, raster: &Raster, placed: &RasterPlacement, step_m: f64) -> usize {
        let facts = raster.facts();
        let pixel_m = |size: &RasterSize| placed.pixel_m * f64::from(facts.size.width) / f64::from(size.width.max(1));
        let is_fine = |size: &RasterSize| pixel_m(size) <= step_m * MAX_PIXEL_STEPS;
        facts.levels.iter().rposition(is_fine).unwrap_or(0)
    }
}

struct WindowPixels<'p, P> {
    window: Window,
    size: RasterSize,
    values: &'p [P],
}

impl<P> WindowPixels<'_, P> {
    /// The value at a place among the pixels, bilinear of those around it that have one, and its weight against coarser
    /// rasters. `None` outside, or if most of the pixels around have no value.
    fn blend<const N: usize>(
        &self,
        [x, y]: [f64; 2],
        value: impl Fn(&P) -> Option<[f64; N]>,
    ) -> Option<([f64; N], f32)> {
        let last = [self.size.width, self.size.height].map(|side| f64::from(side) - 1.0);
        let is_inside = x >= -0.5 && y >= -0.5 && x <= last[0] + 0.5 && y <= last[1] + 0.5;
        if !is_inside {
            return None;
        }
        let [cx, cy] = [x.clamp(0.0, last[0]), y.clamp(0.0, last[1])];
        let [fx, fy] = [cx - cx.floor(), cy - cy.floor()];
        let (x0, y0) = (cx.floor() as u32, cy.floor() as u32);
        let corners = [
            (x0, y0, (1.0 - fx) * (1.0 - fy)),
            (x0 + 1, y0, fx * (1.0 - fy)),
            (x0, y0 + 1, (1.0 - fx) * fy),
            (x0 + 1, y0 + 1, fx * fy),
        ];
        let (mut sums, mut weights) = ([0.0; N], 0.0);
        for (column, row, weight) in corners.into_iter().filter(|(.., weight)| *weight > 0.0) {
            if let Some(numbers) = self.at(column, row).and_then(&value) {
                sums.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += number * weight);
                weights += weight;
            }
        }
        let to_border = (x + 0.5).min(y + 0.5).min(last[0] + 0.5 - x).min(last[1] + 0.5 - y);
        (weights >= 0.5).then(|| (sums.map(|sum| sum / weights), (to_border / FADE_PX).clamp(0.0, 1.0) as f32))
    }

    fn at(&self, column: u32, row: u32) -> Option<&P> {
        let Window { x, y, width, height } = self.window;
        let (column, row) = (column.wrapping_sub(x), row.wrapping_sub(y));
        let is_inside = column < width && row < height;
        is_inside.then(|| self.values.get(row as usize * width as usize + column as usize))?
    }
}

/// The window with all pixels that places between two corners need; `None` outside of the raster.
fn window_around([low, high]: [[f64; 2]; 2], size: RasterSize) -> Option<Window> {
    let range = |axis: usize, side: u32| {
        let first = (low[axis].floor() - 1.0).max(0.0);
        let last = (high[axis].ceil() + 1.0).min(f64::from(side) - 1.0);
        (first <= last).then(|| (first as u32, (last - first) as u32 + 1))
    };
    let ((x, width), (y, height)) = (range(0, size.width)?, range(1, size.height)?);
    Some(Window { x, y, width, height })
}
