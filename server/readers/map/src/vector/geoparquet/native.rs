//! Geometries as nested lists of positions, which are structs of `x`, `y` and perhaps `z`.

use super::metadata::NestedKind;
use crate::vector::geometry::{Geometry, MALFORMED, Polygon, Ring, UNKNOWN_TYPE};
use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use arrow_array::{Array, ArrayRef, StructArray};

/// Reads the geometry of a row. Fails with the reason for skipping the feature.
pub(crate) fn read(
    array: &dyn Array,
    row: usize,
    kind: NestedKind,
    geometry: &mut Geometry,
) -> Result<(), &'static str> {
    match kind {
        NestedKind::Point => {
            let positions = array.as_struct_opt().ok_or(UNKNOWN_TYPE)?;
            line(positions, row..row + 1)?.into_iter().for_each(|point| geometry.push_point(point));
        }
        NestedKind::MultiPoint => {
            line_of_list(array, row)?.into_iter().for_each(|point| geometry.push_point(point));
        }
        NestedKind::Line => geometry.push_line(line_of_list(array, row)?),
        NestedKind::MultiLine => rings(array, row)?.into_iter().for_each(|line| geometry.push_line(line)),
        NestedKind::Polygon => geometry.push_polygon(rings(array, row)?),
        NestedKind::MultiPolygon => {
            let (items, polygons) = items(array, row)?;
            for polygon in polygons {
                geometry.push_polygon(rings(items, polygon)?);
            }
        }
    }
    geometry.settle_heights();
    Ok(())
}

/// The values of a list, and which of them are the items of a row.
fn items(array: &dyn Array, row: usize) -> Result<(&ArrayRef, std::ops::Range<usize>), &'static str> {
    let list = array.as_list_opt::<i32>().ok_or(UNKNOWN_TYPE)?;
    let at = |index: usize| list.value_offsets().get(index).and_then(|offset| usize::try_from(*offset).ok());
    let (start, end) = (at(row).ok_or(MALFORMED)?, at(row + 1).ok_or(MALFORMED)?);
    if start > end || end > list.values().len() {
        return Err(MALFORMED);
    }
    Ok((list.values(), start..end))
}

fn rings(array: &dyn Array, row: usize) -> Result<Polygon, &'static str> {
    let (items, lines) = items(array, row)?;
    lines.map(|line| line_of_list(items, line)).collect()
}

fn line_of_list(array: &dyn Array, row: usize) -> Result<Ring, &'static str> {
    let (items, positions) = items(array, row)?;
    line(items.as_struct_opt().ok_or(UNKNOWN_TYPE)?, positions)
}

fn line(positions: &StructArray, range: std::ops::Range<usize>) -> Result<Ring, &'static str> {
    let axis = |name: &str| positions.column_by_name(name).and_then(|values| values.as_primitive_opt::<Float64Type>());
    let (x, y, z) = (axis("x").ok_or(UNKNOWN_TYPE)?, axis("y").ok_or(UNKNOWN_TYPE)?, axis("z"));
    if range.end > positions.len() {
        return Err(MALFORMED);
    }
    let height = |row: usize| z.filter(|z| z.is_valid(row)).map_or(f64::NAN, |z| z.value(row));
    Ok(range.map(|row| [x.value(row), y.value(row), height(row)]).collect())
}
