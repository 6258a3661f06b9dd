//! Heights as GeoTIFF 1.1 (OGC 19-008r4): the top of the columns at the middle of each leaf cell, in world metres.
//!
//! Where a column is cut by a wall and the middle of its cell lies beyond the wall, the height is that of the top there. Land above
//! the leaves' level repeats its coarser cells. Cells without a column and cells that are not selected are [`NODATA`].

mod heights;
#[cfg(test)]
mod tests;
mod tiff;

use crate::{
    format::Projections,
    selection::ObjectSelection,
    table::{ExportError, ExportReport, city::City, output::OutputFile, walk::visit_end_nodes},
};
use heights::NodeHeights;
use insula_protocol::NODE_CELLS;
use std::path::Path;
use tiff::{TILE, TiffSetup, TiffWriter};

/// Value of cells without a height.
pub(crate) const NODATA: f32 = -9999.0;
/// Most cells along a side: what readers of TIFF expect.
const MAX_SIDE: u32 = 1 << 30;

/// The cells of a raster, from the city's corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Extent {
    /// South-west cell.
    min: [u32; 2],
    size: [u32; 2],
}

/// Writes the heights of the selected area. Fails if the area has no cells, tiles cannot be read, or the file cannot be written.
pub(crate) fn write(
    city: &City<'_>,
    selection: &ObjectSelection,
    projections: &Projections<'_>,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    let mut report = ExportReport::new(city.source);
    let manifest = city.manifest;
    let extent = Extent::of(city, selection)?;
    let (output, file) = OutputFile::create(out)?;
    let corner = |k: usize, cells: u32| manifest.origin[k] + f64::from(cells) * manifest.cell_m;
    let datum = manifest.heights.as_ref().and_then(|heights| heights.datum.strip_prefix("EPSG:")?.parse().ok());
    let setup = TiffSetup {
        size: extent.size,
        north_west: [corner(0, extent.min[0]), corner(1, extent.min[1] + extent.size[1])],
        cell_m: manifest.cell_m,
        nodata: NODATA,
        epsg: projections.epsg,
        vertical_epsg: datum,
        title: &manifest.title,
        attribution: &report.attribution,
    };
    let mut writer = TiffWriter::new(file, &setup).map_err(ExportError::write(out))?;
    for tile_y in 0..extent.size[1].div_ceil(TILE) {
        for tile_x in 0..extent.size[0].div_ceil(TILE) {
            let tile = read_tile(city, selection, extent, [tile_x * TILE, tile_y * TILE])?;
            writer.add_tile(&tile).map_err(ExportError::write(out))?;
        }
    }
    let file = writer.finish(&setup).map_err(ExportError::write(out))?;
    report.bytes = output.commit(file)?;
    report.files.push(out.to_owned());
    if projections.epsg.is_none() {
        report.warnings.push("the city's coordinate system is not known: readers will ask for it".to_owned());
    }
    Ok(report)
}

impl Extent {
    /// The cells that the selected part of the city touches.
    fn of(city: &City<'_>, selection: &ObjectSelection) -> Result<Self, ExportError> {
        let manifest = city.manifest;
        let all = manifest.bounds.map(|[x, y, _]| [x, y]);
        let area = selection.area().unwrap_or(all);
        let end = f64::from(NODE_CELLS as u32) * f64::from(1u32 << manifest.depth);
        let cell = |world: f64, k: usize| (world - manifest.origin[k]) / manifest.cell_m;
        // A border on the line between two cells belongs to one of them.
        let first = [0, 1].map(|k| (cell(area[0][k].max(all[0][k]), k) + 1e-6).floor().clamp(0.0, end));
        let last = [0, 1].map(|k| (cell(area[1][k].min(all[1][k]), k) - 1e-6).ceil().clamp(0.0, end));
        if (0..2).any(|k| last[k] <= first[k]) {
            return Err(ExportError::ObjectSelection("it has no part of the city".to_owned()));
        }
        let size = [0, 1].map(|k| (last[k] - first[k]) as u32);
        if size.iter().any(|side| *side > MAX_SIDE) {
            let reason = format!("{} x {} cells; choose a smaller box", size[0], size[1]);
            return Err(ExportError::TooLarge { format: "GeoTIFF", reason });
        }
        Ok(Self { min: first.map(|v| v as u32), size })
    }
}

/// The heights of a tile, row by row from the north. `first` is its north-west cell, counted from that of the raster.
fn read_tile(
    city: &City<'_>,
    selection: &ObjectSelection,
    extent: Extent,
    first: [u32; 2],
) -> Result<Vec<f32>, ExportError> {
    let manifest = city.manifest;
    let side = TILE as usize;
    let mut tile = vec![NODATA; side * side];
    let size = [0, 1].map(|k| TILE.min(extent.size[k] - first[k]));
    // From the city's corner, to the north.
    let west = extent.min[0] + first[0];
    let north = extent.min[1] + extent.size[1] - first[1];
    let south = north - size[1];
    let middle = |cell: u32, k: usize| manifest.origin[k] + (f64::from(cell) + 0.5) * manifest.cell_m;
    let area = [[middle(west, 0), middle(south, 1)], [middle(west + size[0] - 1, 0), middle(north - 1, 1)]];
    visit_end_nodes(city.source, area, &mut |node| {
        let Some(map) = city.source.columns(node.id)? else { return Ok(()) };
        let heights = NodeHeights::of(manifest, map, selection);
        let below = manifest.depth.saturating_sub(node.id.level());
        let corner = [node.id.x(), node.id.y()].map(|v| (v << below) * NODE_CELLS as u32);
        let end = corner.map(|v| v + ((NODE_CELLS as u32) << below));
        for y in south.max(corner[1])..north.min(end[1]) {
            for x in west.max(corner[0])..(west + size[0]).min(end[0]) {
                let place = [middle(x, 0), middle(y, 1)];
                if selection.contains_point(place) {
                    let cell = [(x - corner[0]) >> below, (y - corner[1]) >> below].map(|v| v as usize);
                    tile[(north - 1 - y) as usize * side + (x - west) as usize] = heights.at(cell);
                }
            }
        }
        Ok(())
    })?;
    Ok(tile)
}
