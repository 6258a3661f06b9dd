//! Heights on a regular grid.

use super::diamond::{Corners, Place, halves, middle};
use std::convert::Infallible;

/// Largest number of samples along a side, so that sums of places fit.
pub(super) const MAX_SIDE: u32 = 1 << 28;

/// Where heights come from, for example a file that is larger than memory.
pub trait HeightSource {
    type Error;

    /// Number of samples along x and y.
    fn size(&self) -> [u32; 2];

    /// Heights in metres of the columns and rows from `min` to `max`, both included, row by row. Values that are not
    /// finite are places without data.
    fn read(&self, min: Place, max: Place) -> Result<Vec<f32>, Self::Error>;
}

/// Samples of a rectangle of the grid, in rows.
#[derive(Debug, Clone)]
pub struct HeightField {
    /// Place of the first sample.
    min: Place,
    size: [u32; 2],
    /// In metres; `NaN` without data.
    heights_m: Vec<f32>,
    has_gaps: bool,
}

/// How much of a triangle has data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataCover {
    Full,
    /// Some of the smallest triangles in it have data at all corners.
    Mixed,
    Empty,
}

impl HeightField {
    /// A field with `size` samples along x and y. Heights that are not finite are places without data. `None` if the
    /// number of heights does not fit or if a side reaches beyond column or row 2^28.
    pub fn new(size: [u32; 2], heights_m: Vec<f32>) -> Option<Self> {
        Self::part([0, 0], size, heights_m)
    }

    /// A rectangle of a larger grid.
    fn part(min: Place, size: [u32; 2], mut heights_m: Vec<f32>) -> Option<Self> {
        let is_in_range = (0..2).all(|axis| u64::from(min[axis]) + u64::from(size[axis]) <= u64::from(MAX_SIDE));
        if !is_in_range || heights_m.len() != size[0] as usize * size[1] as usize {
            return None;
        }
        let mut has_gaps = false;
        for height in heights_m.iter_mut().filter(|height| !height.is_finite()) {
            *height = f32::NAN;
            has_gaps = true;
        }
        Some(Self { min, size, heights_m, has_gaps })
    }

    /// The samples of a source from `min` to `max`. A source that gives too few or too many heights has none there.
    pub(super) fn from_source<S: HeightSource>(source: &S, min: Place, max: Place) -> Result<Self, S::Error> {
        let size = [0, 1].map(|axis| max[axis] - min[axis] + 1);
        let heights_m = source.read(min, max)?;
        let empty = Self { min, size: [0, 0], heights_m: Vec::new(), has_gaps: false };
        Ok(Self::part(min, size, heights_m).unwrap_or(empty))
    }

    /// Number of samples along x and y.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    pub(super) fn len(&self) -> usize {
        self.heights_m.len()
    }

    /// Lowest and highest place, both included.
    pub(super) fn ends(&self) -> [Place; 2] {
        [self.min, [0, 1].map(|axis| (self.min[axis] + self.size[axis]).saturating_sub(1))]
    }

    pub(super) fn index(&self, [x, y]: Place) -> Option<usize> {
        let [x, y] = [x.wrapping_sub(self.min[0]), y.wrapping_sub(self.min[1])];
        (x < self.size[0] && y < self.size[1]).then(|| y as usize * self.size[0] as usize + x as usize)
    }

    pub(super) fn place(&self, index: usize) -> Place {
        let width = self.size[0] as usize;
        [self.min[0] + (index % width) as u32, self.min[1] + (index / width) as u32]
    }

    /// Height in metres; `NaN` outside and without data.
    pub(super) fn height(&self, place: Place) -> f32 {
        self.index(place).map_or(f32::NAN, |i| self.heights_m[i])
    }

    /// Lowest and highest height in metres; `[0, 0]` without any.
    pub(super) fn height_range(&self) -> [f32; 2] {
        let low = self.heights_m.iter().copied().fold(f32::NAN, f32::min);
        let high = self.heights_m.iter().copied().fold(f32::NAN, f32::max);
        if low.is_nan() { [0.0; 2] } else { [low, high] }
    }

    /// Heights of one row from column `from` to `to`, both included; they must lie in the field.
    pub(super) fn row(&self, y: u32, from: u32, to: u32) -> &[f32] {
        let start = (y - self.min[1]) as usize * self.size[0] as usize;
        &self.heights_m[start + (from - self.min[0]) as usize..=start + (to - self.min[0]) as usize]
    }

    /// How much of a triangle has data.
    pub(super) fn cover(&self, corners: &Corners) -> DataCover {
        let is_inside = corners.iter().all(|p| self.index(*p).is_some());
        let is_full = is_inside
            && (!self.has_gaps
                || spans(corners).all(|[y, from, to]| !self.row(y, from, to).iter().any(|z| z.is_nan())));
        match is_full {
            true => DataCover::Full,
            false if self.has_ground(*corners) => DataCover::Mixed,
            false => DataCover::Empty,
        }
    }

    /// Whether no part of a triangle lies in the field, except for edges.
    pub(super) fn is_outside(&self, corners: &Corners) -> bool {
        let [min, max] = self.ends();
        (0..2).any(|axis| {
            let along = corners.map(|p| p[axis]);
            along.iter().all(|v| *v >= max[axis]) || along.iter().all(|v| *v <= min[axis])
        })
    }

    /// Whether one of the smallest triangles in a triangle has data at all corners.
    fn has_ground(&self, corners: Corners) -> bool {
        if self.is_outside(&corners) {
            return false;
        }
        match middle(&corners) {
            Some(middle) => halves(corners, middle).into_iter().any(|half| self.has_ground(half)),
            None => corners.iter().all(|p| !self.height(*p).is_nan()),
        }
    }
}

impl HeightSource for HeightField {
    type Error = Infallible;

    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn read(&self, min: Place, max: Place) -> Result<Vec<f32>, Infallible> {
        if self.index(min).is_none() || self.index(max).is_none() {
            return Ok(Vec::new());
        }
        Ok((min[1]..=max[1]).flat_map(|y| self.row(y, min[0], max[0])).copied().collect())
    }
}

/// Rows of a triangle: row, first and last column. Edges rise by 0, 1 or all steps per column, so ends are places.
pub(super) fn spans(corners: &Corners) -> impl Iterator<Item = [u32; 3]> {
    let corners = corners.map(|p| p.map(i64::from));
    let [low, high] =
        [corners.iter().map(|p| p[1]).min(), corners.iter().map(|p| p[1]).max()].map(Option::unwrap_or_default);
    (low..=high).map(move |y| {
        let mut ends = [i64::MAX, i64::MIN];
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if (a[1].min(b[1])..=a[1].max(b[1])).contains(&y) {
                let slope = if a[1] == b[1] { 0 } else { (b[0] - a[0]) / (b[1] - a[1]) };
                let x = a[0] + slope * (y - a[1]);
                ends = [ends[0].min(x), ends[1].max(x)];
            }
        }
        [y, ends[0], ends[1]].map(|v| v as u32)
    })
}
