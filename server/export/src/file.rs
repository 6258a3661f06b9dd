//! The entry of all exports of one file.

use crate::format::{Format, Projections};
use crate::selection::ObjectSelection;
use crate::source::ExportSource;
use crate::table::city::{City, Plan};
use crate::table::{self, AddedValues, ExportError, ExportReport, TableOptions};
use crate::{cityjson, raster};
use insula_protocol::Manifest;
use std::path::{Path, PathBuf};

/// Writes the selected part of a city as a file. If it fails, `out` is unchanged: the file is renamed when it is complete.
///
/// Tables have one row for each selected object, with its number, identifiers, kind, footprint, heights, area and attributes. A building
/// and its parts are one row unless the options keep parts; it is selected if one of them is. The footprint of an object includes its
/// parts, and it has their attributes where it has none of its own. Memory holds the objects around one place at a time.
pub fn export(
    source: &dyn ExportSource,
    format: Format,
    selection: &ObjectSelection,
    projections: &Projections<'_>,
    options: TableOptions,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    check(selection)?;
    let city = City::new(source);
    match format {
        Format::GeoTiff => raster::write(source, selection, projections, out),
        Format::CityJsonSeq => cityjson::write(&city, &Plan::of(&city, selection)?, out),
        _ => {
            let mut plan = Plan::of(&city, selection)?;
            if !options.keeps_parts {
                plan.select_wholes(&city)?;
            }
            table::write(&city, format, &plan, projections, (options, &AddedValues::default()), out)
        }
    }
}

/// Writes a table of the objects that have values which are none of the city's, with these as columns before the attributes. Fails as
/// [`export`].
pub fn export_values(
    source: &dyn ExportSource,
    format: Format,
    added: &AddedValues,
    projections: &Projections<'_>,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    let city = City::new(source);
    let objects = Some(added.values.keys().copied().collect());
    let mut plan = Plan::of(&city, &ObjectSelection { objects, ..ObjectSelection::default() })?;
    plan.select_wholes(&city)?;
    table::write(&city, format, &plan, projections, (TableOptions::default(), added), out)
}

/// The file that [`export`] writes beside the one of a format, with its text: who must be named. `None` if there is none.
pub fn sidecar(format: Format, manifest: &Manifest, out: &Path) -> Option<(PathBuf, String)> {
    (format == Format::Csv).then(|| table::sidecar(manifest, out)).flatten()
}

/// Fails on a selection in which no place can be.
fn check(selection: &ObjectSelection) -> Result<(), ExportError> {
    let wrong = |reason: &str| Err(ExportError::ObjectSelection(reason.to_owned()));
    if let Some([min, max]) = selection.bbox {
        let is_ordered = (0..2).all(|k| min[k] <= max[k] && min[k].is_finite() && max[k].is_finite());
        if !is_ordered {
            return wrong("the box must be west, south, east, north, in metres of the city's coordinate system");
        }
    }
    if let Some(area) = &selection.polygons {
        let polygons = area.polygons();
        let mut rings = polygons.iter().flatten();
        let is_valid = |ring: &Vec<[f64; 2]>| ring.len() >= 3 && ring.iter().flatten().all(|v| v.is_finite());
        if polygons.iter().any(Vec::is_empty) || polygons.is_empty() || !rings.all(is_valid) {
            return wrong("a polygon needs rings of three or more points");
        }
    }
    Ok(())
}
