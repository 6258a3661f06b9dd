//! What a feature's geometry becomes: areas, surfaces in space, strips or points.

use super::geometry::{Geometry, Polygon, Ring, extent_of};
use super::rings::{self, Nested};
use insula_dress::footprint::{HeightHints, LANE_M, has_height, length_m, usual_width_m};
use insula_dress::palette::area_vector;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::{FeatureKind, Footprint, PointOnGround, Shape, Strip, Surface};

/// A ring whose heights differ by less is level.
const LEVEL_M: f64 = 0.001;
/// A polygon that covers less than this share of the square of its extent on the map stands upright.
const WALL_SHARE: f64 = 1e-3;
const WIDTH_NAMES: [&str; 4] = ["width", "width_m", "est_width", "breedte"];
const LANE_NAMES: [&str; 1] = ["lanes"];
const WIDTH_RANGE_M: std::ops::RangeInclusive<f64> = 0.2..=200.0;
/// Names of attributes whose value is a class of OpenStreetMap.
const CLASS_NAMES: [&str; 5] = ["highway", "fclass", "class", "waterway", "railway"];

/// Features of more polygons are no plans on uneven ground.
const MAX_PARTS: usize = 256;
/// Problem of a feature with a height and several polygons that are not level.
const SLOPING_PLANS: &str = "polygons that are not level taken as surfaces, although the feature has a height";
/// Problems of features of several polygons, one of which lies within another.
const HOLE_AS_POLYGON: &str = "polygon within another of its feature that turns the other way, taken as a hole of it";
const PART_WITHIN: &str = "polygon within another of its feature, taken as a part of it";

/// Shape of a feature of a known kind. `height_field` is the name of the attribute that has the height, if the user gives it.
/// Each of `problems` is a part that is left out. Fails with the reason for skipping the feature.
pub(super) fn shape_of(
    geometry: Geometry,
    kind: Option<FeatureKind>,
    attributes: &Attributes,
    hints: HeightHints<'_>,
    problems: &mut Vec<&'static str>,
) -> Result<Shape, &'static str> {
    // Many programs write 0 where they know no height.
    let has_ground = geometry.has_z && geometry.positions().any(|position| position[2] != 0.0);
    let Geometry { mut polygons, meshes, lines, points, is_surface, .. } = geometry;
    let has_areas = !polygons.is_empty() || !meshes.is_empty();
    if has_areas && !lines.is_empty() {
        problems.push("line beside polygons left out");
    }
    if (has_areas || !lines.is_empty()) && !points.is_empty() {
        problems.push("point beside polygons or lines left out");
    }
    if has_areas {
        if is_surface || is_in_space(&polygons, attributes, hints, problems) {
            let polygons: Vec<Surface> =
                polygons.into_iter().filter_map(|polygon| surface(polygon, problems)).collect();
            if polygons.is_empty() && meshes.is_empty() {
                return Err("no ring with three points");
            }
            return Ok(Shape::Surfaces { polygons, meshes });
        }
        let Nested { holes, parts } = rings::unnest(&mut polygons);
        problems.extend(std::iter::repeat_n(HOLE_AS_POLYGON, holes).chain(std::iter::repeat_n(PART_WITHIN, parts)));
        let on_map = |ring: Ring| ring.into_iter().map(|[x, y, _]| [x, y]).collect();
        let footprint = |polygon: Polygon| {
            let ground = ground_of(polygon.first().into_iter().flatten(), has_ground);
            Footprint { rings: polygon.into_iter().map(on_map).collect(), ground, is_supported: false }
        };
        return Ok(Shape::Footprints(polygons.into_iter().map(footprint).collect()));
    }
    if !lines.is_empty() {
        let width_m = width_m(kind, attributes).ok_or("line without a width that is no road, railway or water")?;
        let strip = |line: Ring| {
            let heights = if has_ground { line.iter().map(|position| position[2]).collect() } else { Vec::new() };
            Strip { points: line.into_iter().map(|[x, y, _]| [x, y]).collect(), heights, width_m }
        };
        return Ok(Shape::Strips(lines.into_iter().map(strip).collect()));
    }
    if points.is_empty() {
        return Err("empty geometry");
    }
    let point = |[x, y, z]: [f64; 3]| PointOnGround { place: [x, y], ground: Some(z).filter(|_| has_ground) };
    Ok(Shape::Points(points.into_iter().map(point).collect()))
}

/// Whether a feature can be a single face of a body, and which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Facing {
    /// A level polygon with heights: a floor, a flat roof or a plan.
    Level,
    /// A polygon that stands upright.
    Wall,
    Other,
}

/// Whether a feature can be a single face of a body.
pub(super) fn facing(geometry: &Geometry) -> Facing {
    let [polygon] = geometry.polygons.as_slice() else { return Facing::Other };
    if !geometry.has_z || geometry.is_surface {
        return Facing::Other;
    }
    if polygon.iter().all(is_level) {
        return Facing::Level;
    }
    if is_upright(polygon) { Facing::Wall } else { Facing::Other }
}

/// Whether a polygon covers nearly nothing on the map.
fn is_upright(polygon: &Polygon) -> bool {
    let Some(ring) = polygon.first() else { return false };
    let [west, south, east, north] = extent_of(ring);
    let square = (east - west).powi(2) + (north - south).powi(2);
    2.0 * area_vector(ring).z.abs() < WALL_SHARE * square
}

/// Whether all positions of a ring are at one height.
fn is_level(ring: &Ring) -> bool {
    let low = ring.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min);
    let high = ring.iter().map(|p| p[2]).fold(f64::NEG_INFINITY, f64::max);
    high - low < LEVEL_M
}

/// Height of the lowest of positions, if their heights tell the ground.
fn ground_of<'p>(positions: impl Iterator<Item = &'p [f64; 3]>, has_ground: bool) -> Option<f64> {
    positions.map(|position| position[2]).reduce(f64::min).filter(|_| has_ground)
}

/// Whether polygons are surfaces in space: a ring of one is not level. Those of a building with a height are its plan on uneven
/// ground, if none is upright and they lie apart from each other. Faces of a roof touch.
fn is_in_space(
    polygons: &[Polygon],
    attributes: &Attributes,
    hints: HeightHints<'_>,
    problems: &mut Vec<&'static str>,
) -> bool {
    if polygons.iter().flatten().all(is_level) {
        return false;
    }
    if !has_height(attributes, hints) {
        return true;
    }
    if polygons.len() == 1 {
        return false;
    }
    if polygons.iter().any(is_upright) {
        return true;
    }
    let extents: Vec<[f64; 4]> = polygons.iter().filter_map(|polygon| polygon.first()).map(extent_of).collect();
    let are_apart = |[w, s, e, n]: [f64; 4], [ow, os, oe, on]: [f64; 4]| w > oe || ow > e || s > on || os > n;
    let is_alone =
        |(index, extent): (usize, &[f64; 4])| extents[..index].iter().all(|other| are_apart(*extent, *other));
    if polygons.len() <= MAX_PARTS && extents.iter().enumerate().all(is_alone) {
        return false;
    }
    problems.push(SLOPING_PLANS);
    true
}

/// The polygon without the repeated last positions of its rings; `None` if the outer ring is no ring.
fn surface(polygon: Polygon, problems: &mut Vec<&'static str>) -> Option<Surface> {
    let mut surface = Surface::default();
    for (index, mut ring) in polygon.into_iter().enumerate() {
        if ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
        if ring.len() < 3 {
            problems.push("ring has fewer than three points");
            if index == 0 {
                return None;
            }
            continue;
        }
        if index > 0 {
            surface.hole_starts.push(u32::try_from(surface.points.len()).ok()?);
        }
        surface.points.append(&mut ring);
    }
    Some(surface)
}

/// Width of a line; `None` if it is of no kind with a usual width and names none.
fn width_m(kind: Option<FeatureKind>, attributes: &Attributes) -> Option<f64> {
    let number = |names: &[&str]| names.iter().find_map(|name| length(attributes.named(name)?));
    let given = number(&WIDTH_NAMES).or_else(|| number(&LANE_NAMES).map(|lanes| lanes * LANE_M));
    if let Some(given) = given.filter(|width_m| WIDTH_RANGE_M.contains(width_m)) {
        return Some(given);
    }
    let usual = match kind? {
        FeatureKind::Road | FeatureKind::Bridge | FeatureKind::Tunnel => 6.0,
        FeatureKind::Rail => 3.0,
        FeatureKind::Water => 4.0,
        _ => return None,
    };
    let class = CLASS_NAMES.iter().filter_map(|name| attributes.named(name)?.as_str());
    Some(class.filter_map(usual_width_m).next().unwrap_or(usual))
}

/// A number of metres, also as `3.5 m`.
fn length(value: &AttributeValue) -> Option<f64> {
    value.as_str().map_or_else(|| value.as_f64(), length_m)
}
