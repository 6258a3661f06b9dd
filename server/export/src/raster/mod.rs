//! Heights as GeoTIFF 1.1 (OGC 19-008r4): the top of the columns at the middle of each leaf cell, in world metres.
//!
//! Where a column is cut by a wall and the middle of its cell lies beyond the wall, the height is that of the top there. Land above
//! the leaves' level repeats its coarser cells. Cells without a column and cells that are not selected are [`NODATA`].

#[cfg(test)]
mod tests;
mod tiff;

use crate::format::Projections;
use crate::selection::ObjectSelection;
use crate::source::ExportSource;
use crate::table::{ExportError, ExportReport, OutputFile, visit_end_nodes};
use insula_protocol::blockmap::{COLUMNS, ColumnClip, NO_OBJECT, flag};
use insula_protocol::{BlockMap, Manifest, NODE_CELLS};
use std::path::Path;
use tiff::{TILE, TiffSetup, TiffWriter};

/// Value of cells without a value.
pub const NODATA: f32 = -9999.0;
/// Most cells along a side: what readers of TIFF expect.
const MAX_SIDE: u32 = 1 << 30;

/// The cells of a raster, counted from the city's corner in cells of the leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellExtent {
    /// South-west cell.
    pub min: [u32; 2],
    /// Columns and rows.
    pub size: [u32; 2],
}

/// Writes the heights of the selected area. Fails if the area has no cells, tiles cannot be read, or the file cannot be written.
pub(crate) fn write(
    source: &dyn ExportSource,
    selection: &ObjectSelection,
    projections: &Projections<'_>,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    let manifest = source.manifest();
    let extent = CellExtent::of(manifest, selection.area())?;
    let datum = manifest.heights.as_ref().and_then(|heights| heights.datum.strip_prefix("EPSG:")?.parse().ok());
    let mut read = |part: CellExtent| {
        let mut tile = vec![NODATA; part.size.map(|side| side as usize).iter().product()];
        visit_tops(source, part, &mut |cell, top| {
            let place = part.middle(manifest, cell);
            let is_selected = selection.objects.as_ref().is_none_or(|all| all.contains(top.object));
            if is_selected && selection.contains_point(place) {
                tile[part.index(cell)] = top.height;
            }
        })?;
        Ok(tile)
    };
    write_raster(source, extent, projections, datum, &manifest.title, out, &mut read)
}

/// Writes a raster of float32 values whose cells are those of the city's leaves. `read` gives the values of a part of `extent`, row by row
/// from the south; [`NODATA`] is no value. `vertical_epsg` is the vertical system of values that are heights. Fails with the error of
/// `read`, and if the file cannot be written.
pub fn write_raster(
    source: &dyn ExportSource,
    extent: CellExtent,
    projections: &Projections<'_>,
    vertical_epsg: Option<u32>,
    title: &str,
    out: &Path,
    read: &mut dyn FnMut(CellExtent) -> Result<Vec<f32>, ExportError>,
) -> Result<ExportReport, ExportError> {
    let mut report = ExportReport::new(source);
    let manifest = source.manifest();
    let (output, file) = OutputFile::create(out)?;
    let corner = |k: usize, cells: u32| manifest.origin[k] + f64::from(cells) * manifest.cell_m;
    let setup = TiffSetup {
        size: extent.size,
        north_west: [corner(0, extent.min[0]), corner(1, extent.min[1] + extent.size[1])],
        cell_m: manifest.cell_m,
        nodata: NODATA,
        epsg: projections.epsg,
        vertical_epsg,
        title,
        attribution: &report.attribution,
    };
    let mut writer = TiffWriter::new(file, &setup).map_err(ExportError::write(out))?;
    for tile_y in 0..extent.size[1].div_ceil(TILE) {
        for tile_x in 0..extent.size[0].div_ceil(TILE) {
            // Tiles begin in the north-west.
            let first = [tile_x * TILE, tile_y * TILE];
            let size = [0, 1].map(|k| TILE.min(extent.size[k] - first[k]));
            let south = extent.min[1] + extent.size[1] - first[1] - size[1];
            let values = read(CellExtent { min: [extent.min[0] + first[0], south], size })?;
            writer.add_tile(&as_tile(&values, size)).map_err(ExportError::write(out))?;
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

/// A whole tile, row by row from the north, of values row by row from the south.
fn as_tile(values: &[f32], [width, _]: [u32; 2]) -> Vec<f32> {
    let side = TILE as usize;
    let mut tile = vec![NODATA; side * side];
    let rows = values.chunks_exact(width.max(1) as usize).rev();
    for (to, from) in tile.chunks_exact_mut(side).zip(rows) {
        to[..from.len()].copy_from_slice(from);
    }
    tile
}

impl CellExtent {
    /// The cells of the city that an area touches, in world metres; `None` is the whole city. Fails if there are none, or too many along
    /// a side.
    pub fn of(manifest: &Manifest, area: Option<[[f64; 2]; 2]>) -> Result<Self, ExportError> {
        let all = manifest.bounds.map(|[x, y, _]| [x, y]);
        let area = area.unwrap_or(all);
        let end = f64::from(NODE_CELLS as u32) * f64::from(1u32 << manifest.depth);
        let cell = |world: f64, k: usize| (world - manifest.origin[k]) / manifest.cell_m;
        // A border on the line between two cells belongs to one of them.
        let first = [0, 1].map(|k| (cell(area[0][k].max(all[0][k]), k) + 1e-6).floor().clamp(0.0, end));
        let last = [0, 1].map(|k| (cell(area[1][k].min(all[1][k]), k) - 1e-6).ceil().clamp(0.0, end));
        if (0..2).any(|k| last[k] <= first[k]) {
            return Err(ExportError::ObjectSelection(
                "no part of the city lies in the area: write west, south, east, north, and longitude before latitude"
                    .to_owned(),
            ));
        }
        let size = [0, 1].map(|k| (last[k] - first[k]) as u32);
        if size.iter().any(|side| *side > MAX_SIDE) {
            let reason = format!("{} x {} cells; choose a smaller box", size[0], size[1]);
            return Err(ExportError::TooLarge { format: "GeoTIFF", reason });
        }
        Ok(Self { min: first.map(|v| v as u32), size })
    }

    /// Index of a cell in an array of the raster's cells, row by row from the south. Requires a cell of the raster.
    #[must_use]
    pub fn index(&self, cell: [u32; 2]) -> usize {
        let [x, y] = [0, 1].map(|k| (cell[k] - self.min[k]) as usize);
        y * self.size[0] as usize + x
    }

    /// Middle of a cell in world metres.
    #[must_use]
    pub fn middle(&self, manifest: &Manifest, cell: [u32; 2]) -> [f64; 2] {
        [0, 1].map(|k| manifest.origin[k] + (f64::from(cell[k]) + 0.5) * manifest.cell_m)
    }

    /// Number of cells.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.size.map(u64::from).iter().product()
    }

    /// Whether there is no cell.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Passes the top of each cell of `part` that has one to `put`. Fails if tiles cannot be read.
pub fn visit_tops(
    source: &dyn ExportSource,
    part: CellExtent,
    put: &mut dyn FnMut([u32; 2], CellTop),
) -> Result<(), ExportError> {
    let manifest = source.manifest();
    let end = [0, 1].map(|k| part.min[k] + part.size[k]);
    let area = [part.middle(manifest, part.min), part.middle(manifest, end.map(|v| v.saturating_sub(1)))];
    visit_end_nodes(source, area, &mut |node| {
        let Some(map) = source.columns(node.id)? else { return Ok(()) };
        let tops = node_tops(manifest, map);
        let below = manifest.depth.saturating_sub(node.id.level());
        let corner = [node.id.x(), node.id.y()].map(|v| (v << below) * NODE_CELLS as u32);
        let node_end = corner.map(|v| v + ((NODE_CELLS as u32) << below));
        for y in part.min[1].max(corner[1])..end[1].min(node_end[1]) {
            for x in part.min[0].max(corner[0])..end[0].min(node_end[0]) {
                let cell = [(x - corner[0]) >> below, (y - corner[1]) >> below].map(|v| v as usize);
                if let Some(Some(top)) = tops.get(cell[1] * NODE_CELLS + cell[0]) {
                    put([x, y], *top);
                }
            }
        }
        Ok(())
    })
}

/// What lies at the middle of a cell, seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellTop {
    /// World metres.
    pub height: f32,
    /// [`NO_OBJECT`] where there is none, as on generated ground.
    pub object: u32,
    /// Direction of the normal of the wall below the top in 1/256 turns, 0 east, 64 north; `None` without a wall.
    pub wall: Option<u8>,
    /// Octahedral code of the normal of a slope; `None` of a level top.
    pub normal: Option<u16>,
    /// Whether it is generated ground, where the source has nothing.
    pub is_generated: bool,
}

/// The tops of the columns, row-major from the south-west. Where a wall cuts a column and the middle of its cell lies beyond the wall,
/// the top there.
fn node_tops(manifest: &Manifest, map: BlockMap) -> Vec<Option<CellTop>> {
    // The objects of columns do not change by the ground below them. Where it adds a column, there is no object.
    let objects = map.objects.clone();
    let given: Vec<bool> = map.flags.iter().map(|flags| flags & flag::OCCUPIED != 0).collect();
    let map = map.stand_on_ground();
    let base = manifest.origin[2] + map.z_base_m();
    let step = f64::from(map.z_step_m());
    let mut clips = map.clips.iter();
    let mut tops = vec![None; COLUMNS];
    for (cell, top) in tops.iter_mut().enumerate() {
        let flags = map.flags[cell];
        if flags & flag::OCCUPIED == 0 {
            continue;
        }
        let clip = if flags & flag::CLIPPED != 0 { clips.next() } else { None };
        let outer = clip.filter(|clip| !is_inside(clip)).and_then(|clip| clip.outer);
        let (code, object) = match outer {
            Some(outer) => (outer.z, objects.as_ref().map(|objects| objects.lower[cell])),
            None => (map.z_max[cell], objects.as_ref().map(|objects| objects.roof[cell])),
        };
        let wall = (outer.is_none() && flags & flag::EXPOSED != 0).then(|| map.wall_azimuth[cell]);
        let is_slope = outer.is_none() && flags & flag::INCLINED != 0;
        let normal = is_slope.then(|| map.roof_normal[cell]);
        let height = (base + f64::from(code) * step) as f32;
        let (object, is_generated) = (object.unwrap_or(NO_OBJECT), !given[cell]);
        *top = Some(CellTop { height, object, wall, normal, is_generated });
    }
    tops
}

/// Whether the middle of a cell is on the inner side of the wall: not beyond its planes.
fn is_inside(clip: &ColumnClip) -> bool {
    let first = clip.offset >= 0;
    match clip.corner {
        None => first,
        Some(corner) if corner.concave => first || corner.offset >= 0,
        Some(corner) => first && corner.offset >= 0,
    }
}
