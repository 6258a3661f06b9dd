//! Point clouds (LAS, LAZ and COPC) as rasters of the ground.
//!
//! The points are read twice: first to know how dense those on the ground are, then to get the height of each cell.
//!
//! | step | module |
//! |---|---|
//! | where points are in the file | `header`, `records`, `layout` |
//! | points one after the other | `points`, `packing` |
//! | the coordinate system | `coordinates` |
//! | the points on the ground, and their density | `survey` |
//! | the height of each cell | `grid` |
//! | the ground in files without classes | `ground_filter`, `extremes` |
//! | heights under roofs | `holes` |

mod coordinates;
mod extremes;
mod grid;
mod ground_filter;
mod header;
mod holes;
mod layout;
mod packing;
mod points;
mod records;
mod survey;
#[cfg(test)]
mod tests;

use super::error::RasterError;
use super::facts::{RasterFacts, RasterLimits, SampleKind, Window};
use super::source::Source;
use coordinates::Coordinates;
use grid::{Cell, Grid};
use header::Header;
use layout::Layout;
use points::{PointFilter, PointKind};
use records::Records;
use std::io::{Read, Seek, SeekFrom, Write};
use survey::Survey;
use tempfile::SpooledTempFile;

/// Cells take 20 bytes each while points are read.
const MAX_CELLS: u64 = 1 << 26;
/// Holes that are wider are not filled.
const MAX_HOLE_M: f64 = 60.0;
/// Holes of this many cells are filled however large the cells are.
const MIN_HOLE_CELLS: f64 = 2.0;
/// The ground of clouds without classes is sought among the lowest points of cells of this size or more.
const MIN_ESTIMATED_STEP_M: f64 = 1.0;
/// Larger rasters are in a temporary file, since a city can have thousands of clouds.
const MAX_BYTES_IN_MEMORY: usize = 1 << 24;
const COARSE: &str = "its cells are larger than its points are apart, as it reaches too far for more: split it";
const ESTIMATED: &str = "less than 1% of its points are classified as ground: it was estimated from the lowest ones";

/// The ground of a point cloud, which was read whole.
pub(super) struct PointCloud {
    /// Heights by row, of 32 bits.
    heights: SpooledTempFile,
    width: u32,
    is_estimated: bool,
    is_coarse: bool,
}

pub(super) fn is_point_cloud(start: &[u8]) -> bool {
    start.starts_with(header::SIGNATURE)
}

impl PointCloud {
    /// Reads the whole file twice, to get the height of the ground in each cell.
    ///
    /// Fails if the file is damaged, or has no points that could be on the ground.
    pub(super) fn open(mut source: Source, limits: RasterLimits) -> Result<(Self, RasterFacts), RasterError> {
        let header = Header::read(&mut source)?;
        let records = Records::read(&mut source, &header)?;
        let layout = Layout::read(&mut source, &header, records.packing.as_deref())?;
        let [low, high] = header.bounds;
        let coordinates = Coordinates::new(&records, header.has_wkt, (low[1] + high[1]) / 2.0)?;
        let mut reading = Reading { source, header, layout, max_chunk_bytes: limits.max_chunk_bytes };
        let max_cells = MAX_CELLS.min(limits.max_whole_pixels);
        let (kind, grid) = reading.grid(&coordinates, max_cells)?;
        let mut heights = reading.heights(kind, &grid, coordinates.height_factor)?;
        let is_estimated = kind == PointKind::LastReturn;
        if is_estimated {
            ground_filter::keep_ground(&mut heights, grid.size, grid.step_m, coordinates.height_unit_m);
        }
        let max_gap = (MAX_HOLE_M / grid.step_m).max(MIN_HOLE_CELLS) as usize;
        let heights = holes::fill(heights, grid.size, max_gap);
        let mut facts = RasterFacts::new(grid.size, SampleKind::F32);
        facts.place = Some(grid.place()?);
        facts.crs = coordinates.crs;
        let (width, is_coarse) = (grid.size.width, grid.is_coarse);
        Ok((Self { heights: stored(&heights)?, width, is_estimated, is_coarse }, facts))
    }

    /// Heights of a window with `len` cells, by row; NaN where there are none.
    pub(super) fn read_heights(&mut self, window: Window, len: usize) -> Result<Vec<f32>, RasterError> {
        let mut heights = Vec::with_capacity(len);
        let mut bytes = vec![0; window.width as usize * 4];
        for row in window.y..window.y + window.height {
            let first = u64::from(row) * u64::from(self.width) + u64::from(window.x);
            self.heights.seek(SeekFrom::Start(first * 4))?;
            self.heights.read_exact(&mut bytes)?;
            heights.extend(bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
        }
        Ok(heights)
    }

    /// What a user should know about the heights.
    pub(super) fn warning(&self) -> Option<String> {
        let warnings = [self.is_estimated.then_some(ESTIMATED), self.is_coarse.then_some(COARSE)];
        warnings.into_iter().flatten().map(str::to_owned).reduce(|first, second| format!("{first}; {second}"))
    }
}

/// A file whose points are read.
struct Reading {
    source: Source,
    header: Header,
    layout: Layout,
    max_chunk_bytes: u64,
}

impl Reading {
    /// Reads all points. Returns the kind that represents the ground best, and the grid for its density.
    fn grid(&mut self, coordinates: &Coordinates, max_cells: u64) -> Result<(PointKind, Grid), RasterError> {
        let Self { source, header, layout, max_chunk_bytes } = self;
        let mut survey = Survey::new(header);
        let filter = PointFilter::new(header, None);
        points::for_each(source, layout, &filter, *max_chunk_bytes, &mut |point| {
            survey.add(point, header.scaling.position(point.numbers));
        })?;
        let best = survey.best();
        let (kind, points) = best.ok_or_else(|| RasterError::unsupported("no points that could be on the ground"))?;
        let [east_m, north_m] = coordinates.unit_m;
        let mut distance_m = (survey.area(points) * east_m * north_m / points.points as f64).sqrt();
        if kind == PointKind::LastReturn {
            distance_m = distance_m.max(MIN_ESTIMATED_STEP_M);
        }
        Ok((kind, Grid::new(points, &header.scaling, distance_m, coordinates.unit_m, max_cells)?))
    }

    /// Reads the points of a kind: their mean height in each cell, or the lowest one if they may be above the ground.
    /// Heights are multiplied with a factor.
    fn heights(&mut self, kind: PointKind, grid: &Grid, factor: f64) -> Result<Vec<f32>, RasterError> {
        let Self { source, header, layout, max_chunk_bytes } = self;
        let mut cells = vec![Cell::default(); grid.cells()];
        let filter = PointFilter::new(header, Some(kind));
        points::for_each(source, layout, &filter, *max_chunk_bytes, &mut |point| {
            cells[grid.index(header.scaling.position(point.numbers))].add(point.numbers[2]);
        })?;
        let number = |cell: &Cell| if kind == PointKind::LastReturn { cell.lowest() } else { cell.mean() };
        let height = |number| (header.scaling.coordinate(2, number) * factor) as f32;
        Ok(cells.iter().map(|cell| number(cell).map_or(f32::NAN, height)).collect())
    }
}

/// Heights in memory, or in a temporary file if there are many.
fn stored(heights: &[f32]) -> Result<SpooledTempFile, RasterError> {
    let mut file = SpooledTempFile::new(MAX_BYTES_IN_MEMORY);
    for part in heights.chunks(1 << 16) {
        let bytes: Vec<u8> = part.iter().flat_map(|height| height.to_le_bytes()).collect();
        file.write_all(&bytes)?;
    }
    Ok(file)
}
