//! Objects of elements whose nodes are known.

use super::classes::{Class, Form};
use super::collect::MemberWays;
use super::cover::bounds;
use super::element::{ElementId, Position, Tags, UNITS_PER_DEGREE, degrees};
use super::nesting::Polygon;
use super::nodes::NodeStore;
use super::relations::{MemberWay, Relation, Relations};
use super::rings::{OUTSIDE, TOO_FEW, polygons};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::{Footprint, PointOnGround, Shape, SourceObject, Strip};

/// Distance of the trees of a row.
const TREE_DISTANCE_M: f64 = 8.0;
/// More trees of one row are not planted.
const MAX_TREES: usize = 10_000;
/// Length of a degree of latitude.
const DEGREE_M: f64 = 111_200.0;
/// Longer values are cut in the names of types.
const MAX_TYPE_BYTES: usize = 64;

pub(super) fn attributes(tags: Tags<'_>) -> Attributes {
    let mut attributes = Attributes::default();
    for (key, value) in tags.iter() {
        let value = AttributeValue::from_untyped(&String::from_utf8_lossy(value));
        attributes.push(&String::from_utf8_lossy(key), value);
    }
    attributes
}

pub(super) fn object(
    id: ElementId,
    class: Class,
    tags: Tags<'_>,
    parent: Option<ElementId>,
    shape: Shape,
) -> SourceObject {
    let value = tags.get(class.key).unwrap_or_default();
    SourceObject {
        id: id.to_string(),
        parent: parent.map(|parent| parent.to_string()),
        kind: class.kind,
        source_type: format!("{}={}", class.key, &value[..value.floor_char_boundary(MAX_TYPE_BYTES)]),
        lod: None,
        attributes: attributes(tags),
        shape,
    }
}

/// Whether some of the bounds of positions is within west, south, east and north in degrees.
pub(super) fn is_in_bbox<'p>(bbox_deg: Option<[f64; 4]>, positions: impl IntoIterator<Item = &'p Position>) -> bool {
    let Some([west, south, east, north]) = bbox_deg else { return true };
    let Some(bounds) = bounds(positions) else { return true };
    let [w, s, e, n] = bounds.map(|value| f64::from(value) / UNITS_PER_DEGREE);
    w <= east && west <= e && s <= north && south <= n
}

/// The area of a closed way. Fails with the reason if it has none.
pub(super) fn area_of_way(refs: &[i64], nodes: &NodeStore) -> Result<Polygon, &'static str> {
    let ring: Option<Vec<Position>> = nodes.positions(refs).collect();
    let mut ring = ring.ok_or(OUTSIDE)?;
    ring.dedup();
    if ring.len() < 4 { Err(TOO_FEW) } else { Ok(vec![ring]) }
}

/// The areas of a multipolygon. Fails with the reason if it has none. `left` counts the nodes of multipolygons that may
/// still be assembled: many of a hostile file may be made of the same large ways.
pub(super) fn areas_of_relation(
    relation: &Relation,
    relations: &Relations,
    members: &MemberWays,
    nodes: &NodeStore,
    left: &mut u64,
) -> Result<Vec<Polygon>, &'static str> {
    if members.is_too_large() {
        return Err("multipolygon too large");
    }
    let mut ids: Vec<i64> = relations.members(relation).iter().map(|MemberWay { id, .. }| *id).collect();
    ids.sort_unstable();
    // A way that is named twice is one.
    ids.dedup();
    if ids.is_empty() {
        return Err("multipolygon without ways");
    }
    let ways: Option<Vec<&[i64]>> = ids.iter().map(|id| members.get(*id)).collect();
    let ways = ways.ok_or(OUTSIDE)?;
    let count: usize = ways.iter().map(|way| way.len()).sum();
    *left = left.checked_sub(count as u64).ok_or("too many multipolygons of the same ways")?;
    polygons(ways.into_iter(), nodes)
}

/// Polygons as the areas of an object, which stands on others if it `is_supported`.
pub(super) fn footprints(polygons: Vec<Polygon>, is_supported: bool) -> Shape {
    let ring = |ring: Vec<Position>| ring.into_iter().map(degrees).collect();
    let footprint =
        |polygon: Polygon| Footprint { rings: polygon.into_iter().map(ring).collect(), ground: None, is_supported };
    Shape::Footprints(polygons.into_iter().map(footprint).collect())
}

/// The pieces of a way that the file has, and whether others are missing. Fails with the reason if there are none.
pub(super) fn pieces_of_way(refs: &[i64], nodes: &NodeStore) -> Result<(Vec<Vec<Position>>, bool), &'static str> {
    let mut pieces: Vec<Vec<Position>> = vec![Vec::new()];
    let mut is_missing = false;
    for position in nodes.positions(refs) {
        match (position, pieces.last_mut()) {
            (Some(position), Some(piece)) if piece.last() != Some(&position) => piece.push(position),
            (None, _) => {
                is_missing = true;
                pieces.push(Vec::new());
            }
            _ => {}
        }
    }
    pieces.retain(|piece| piece.len() > 1);
    match (pieces.is_empty(), is_missing) {
        (false, _) => Ok((pieces, is_missing)),
        (true, true) => Err(OUTSIDE),
        (true, false) => Err("line has fewer than two points"),
    }
}

pub(super) fn lines(pieces: Vec<Vec<Position>>, form: Form) -> Shape {
    let pieces = pieces.into_iter().map(|piece| piece.into_iter().map(degrees).collect());
    match form {
        Form::Line { width_m } => {
            Shape::Strips(pieces.map(|points| Strip { points, width_m, ..Strip::default() }).collect())
        }
        Form::Area | Form::TreeRow => {
            let mut trees = Vec::new();
            pieces.for_each(|piece: Vec<[f64; 2]>| plant(&piece, &mut trees));
            Shape::Points(trees.into_iter().map(PointOnGround::from).collect())
        }
    }
}

/// Adds points of even distance along a line, the first one at its start.
fn plant(line: &[[f64; 2]], trees: &mut Vec<[f64; 2]>) {
    let mut left_m = 0.0;
    for pair in line.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let step = [b[0] - a[0], b[1] - a[1]];
        let length_m = DEGREE_M * libm::hypot(step[0] * libm::cos(a[1].to_radians()), step[1]);
        while left_m <= length_m && trees.len() < MAX_TREES {
            let share = if length_m > 0.0 { left_m / length_m } else { 0.0 };
            trees.push([a[0] + share * step[0], a[1] + share * step[1]]);
            left_m += TREE_DISTANCE_M;
        }
        left_m -= length_m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trees_stand_evenly_around_bends() {
        let east = |metres: f64| metres / DEGREE_M;
        let mut trees = Vec::new();
        plant(&[[0.0, 0.0], [east(12.0), 0.0], [east(12.0), east(13.0)]], &mut trees);
        let metres: Vec<[i64; 2]> =
            trees.iter().map(|tree| tree.map(|v| (v * DEGREE_M * 100.0).round() as i64)).collect();
        assert_eq!(metres, [[0, 0], [800, 0], [1200, 400], [1200, 1200]]);
        plant(&[[-180.0, 0.0], [180.0, 0.0]], &mut trees);
        assert_eq!(trees.len(), MAX_TREES);
    }
}
