//! Geometry tables: flat coordinates, ends of rings or lines, and nested parts.

use crate::vector::geometry::{Geometry, MALFORMED, MAX_DEPTH, Polygon, Ring, TOO_DEEP, UNKNOWN_TYPE, is_same_place};
use ::flatgeobuf::{Geometry as Table, GeometryType};
use insula_source::arc::divide_arcs;

/// Reads a geometry, in which missing heights are not a number. `header_type` is that of the whole file; `Unknown` if each geometry
/// has its own. `positions_left` is the number of positions that may still be read. Fails with the reason for skipping the feature.
pub(crate) fn read(
    table: &Table<'_>,
    header_type: GeometryType,
    geometry: &mut Geometry,
    positions_left: &mut usize,
    depth: u32,
) -> Result<(), &'static str> {
    if depth > MAX_DEPTH {
        return Err(TOO_DEEP);
    }
    geometry.has_z |= table.z().is_some_and(|z| !z.is_empty());
    let kind = if header_type == GeometryType::Unknown { table.type_() } else { header_type };
    match kind {
        GeometryType::Point | GeometryType::MultiPoint => {
            line(table, positions_left)?.into_iter().for_each(|point| geometry.push_point(point));
        }
        GeometryType::LineString => geometry.push_line(line(table, positions_left)?),
        GeometryType::CircularString => geometry.push_line(divide_arcs(&line(table, positions_left)?)),
        GeometryType::MultiLineString => {
            rings(table, positions_left)?.into_iter().for_each(|line| geometry.push_line(line));
        }
        GeometryType::Polygon | GeometryType::Triangle => geometry.push_polygon(rings(table, positions_left)?),
        GeometryType::CompoundCurve => geometry.push_line(curve(table, positions_left, depth)?),
        GeometryType::CurvePolygon => geometry.push_polygon(curve_polygon(table, positions_left, depth)?),
        GeometryType::TIN => {
            geometry.is_surface = true;
            if table.parts().is_some() {
                return parts(table, GeometryType::Triangle, geometry, positions_left, depth);
            }
            rings(table, positions_left)?.into_iter().for_each(|ring| geometry.push_polygon(vec![ring]));
        }
        GeometryType::MultiPolygon | GeometryType::PolyhedralSurface => {
            geometry.is_surface |= kind == GeometryType::PolyhedralSurface;
            return parts(table, GeometryType::Polygon, geometry, positions_left, depth);
        }
        GeometryType::GeometryCollection | GeometryType::MultiCurve | GeometryType::MultiSurface => {
            return parts(table, GeometryType::Unknown, geometry, positions_left, depth);
        }
        _ => return Err(UNKNOWN_TYPE),
    }
    Ok(())
}

fn parts(
    table: &Table<'_>,
    part_type: GeometryType,
    geometry: &mut Geometry,
    positions_left: &mut usize,
    depth: u32,
) -> Result<(), &'static str> {
    // An empty geometry has no parts; a single part may stand in the table itself.
    let Some(parts) = table.parts() else {
        if table.xy().is_none_or(|xy| xy.is_empty()) {
            return Ok(());
        }
        let inline = if part_type == GeometryType::Unknown { return Err(MALFORMED) } else { part_type };
        return read(table, inline, geometry, positions_left, depth + 1);
    };
    for part in parts {
        read(&part, part_type, geometry, positions_left, depth + 1)?;
    }
    Ok(())
}

/// All positions of a table.
fn line(table: &Table<'_>, positions_left: &mut usize) -> Result<Ring, &'static str> {
    let Some(xy) = table.xy() else { return Ok(Ring::new()) };
    let count = xy.len() / 2;
    *positions_left = positions_left.checked_sub(count).ok_or(MALFORMED)?;
    let heights = match table.z() {
        Some(z) if z.len() < count => return Err(MALFORMED),
        z => z,
    };
    let height = |i: usize| heights.as_ref().map_or(f64::NAN, |z| z.get(i));
    Ok((0..count).map(|i| [xy.get(2 * i), xy.get(2 * i + 1), height(i)]).collect())
}

/// The positions of a table, divided at its ends.
fn rings(table: &Table<'_>, positions_left: &mut usize) -> Result<Polygon, &'static str> {
    let line = line(table, positions_left)?;
    let Some(ends) = table.ends().filter(|ends| ends.len() > 1) else { return Ok(vec![line]) };
    let mut start = 0;
    let mut rings = Polygon::new();
    for end in ends {
        let end = end as usize;
        rings.push(line.get(start..end).ok_or(MALFORMED)?.to_vec());
        start = end;
    }
    Ok(rings)
}

/// A line, an arc, or a curve composed of such.
fn curve(table: &Table<'_>, positions_left: &mut usize, depth: u32) -> Result<Ring, &'static str> {
    if depth > MAX_DEPTH {
        return Err(TOO_DEEP);
    }
    match table.type_() {
        GeometryType::CircularString => Ok(divide_arcs(&line(table, positions_left)?)),
        GeometryType::CompoundCurve => {
            let mut whole = Ring::new();
            for part in table.parts().into_iter().flatten() {
                let part = curve(&part, positions_left, depth + 1)?;
                let shared = usize::from(is_same_place(whole.last(), part.first()));
                whole.extend(part.into_iter().skip(shared));
            }
            Ok(whole)
        }
        _ => line(table, positions_left),
    }
}

fn curve_polygon(table: &Table<'_>, positions_left: &mut usize, depth: u32) -> Result<Polygon, &'static str> {
    table.parts().into_iter().flatten().map(|part| curve(&part, positions_left, depth + 1)).collect()
}
