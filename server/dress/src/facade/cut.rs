//! Cuts faces at the borders of zones.

use super::FacadeZone;
use super::walls::Wall;
use crate::world_triangle::WorldTriangle;
use glam::DVec3;

/// Corners nearer to a border are on it, so that rounded coordinates make no splinters.
const SNAP_M: f64 = 0.03;
/// Pieces with less area are left out.
const MIN_AREA_M2: f64 = 1e-9;

/// Appends the pieces of a face: those in zones with their material and texture coordinates, the others as they are.
/// `anchor` is the position that the wall and its zones are relative to.
pub(super) fn cut_face(
    face: &WorldTriangle,
    wall: &Wall,
    zones: &[FacadeZone],
    anchor: DVec3,
    material: u32,
    out: &mut Vec<WorldTriangle>,
) {
    let mut rest = vec![face.corners.map(DVec3::from_array).to_vec()];
    let (along_m, z_m) = (|p: DVec3| wall.along_m(p - anchor), |p: DVec3| p.z - anchor.z);
    for zone in zones {
        let mut outside = Vec::new();
        for polygon in rest {
            if !overlaps(&polygon, &along_m, zone.along_m) || !overlaps(&polygon, &z_m, zone.z_m) {
                outside.push(polygon);
                continue;
            }
            let borders: [&dyn Fn(DVec3) -> f64; 4] = [
                &|p| along_m(p) - zone.along_m[0],
                &|p| zone.along_m[1] - along_m(p),
                &|p| z_m(p) - zone.z_m[0],
                &|p| zone.z_m[1] - z_m(p),
            ];
            let mut inside = polygon;
            for border in borders {
                let [kept, cut_off] = split(&inside, border);
                inside = kept;
                outside.extend((!cut_off.is_empty()).then_some(cut_off));
            }
            let uv = |p: DVec3| zone.uv(along_m(p), z_m(p));
            push_fan(&inside, |corners| WorldTriangle { uv: corners.map(uv), material, ..*face }, out);
        }
        rest = outside;
    }
    rest.iter().for_each(|polygon| push_fan(polygon, |_| *face, out));
}

/// Whether a polygon has more than its border in a range.
fn overlaps(polygon: &[DVec3], of: &dyn Fn(DVec3) -> f64, [low, high]: [f64; 2]) -> bool {
    let values = polygon.iter().map(|p| of(*p));
    let (least, most) = values.fold((f64::MAX, f64::MIN), |(least, most), v| (least.min(v), most.max(v)));
    most > low + SNAP_M && least < high - SNAP_M
}

/// Splits a convex polygon into the parts where `distance_m` is positive and negative; either may be empty.
fn split(polygon: &[DVec3], distance_m: &dyn Fn(DVec3) -> f64) -> [Vec<DVec3>; 2] {
    let snapped = |p: DVec3| Some(distance_m(p)).filter(|d| d.abs() > SNAP_M).unwrap_or(0.0);
    let distances: Vec<f64> = polygon.iter().map(|p| snapped(*p)).collect();
    if distances.iter().all(|d| *d >= 0.0) {
        return [polygon.to_vec(), Vec::new()];
    }
    if distances.iter().all(|d| *d <= 0.0) {
        return [Vec::new(), polygon.to_vec()];
    }
    let (mut positive, mut negative) = (Vec::new(), Vec::new());
    for (i, (&p, &d)) in polygon.iter().zip(&distances).enumerate() {
        if d >= 0.0 {
            positive.push(p);
        }
        if d <= 0.0 {
            negative.push(p);
        }
        let next = (i + 1) % polygon.len();
        let (q, e) = (polygon[next], distances[next]);
        if d * e < 0.0 {
            let crossing = crossing((p, d), (q, e));
            positive.push(crossing);
            negative.push(crossing);
        }
    }
    [positive, negative]
}

/// Where an edge crosses a border; the same in both directions, so that neighbouring faces fit.
fn crossing(a: (DVec3, f64), b: (DVec3, f64)) -> DVec3 {
    let is_first = a.0.to_array().partial_cmp(&b.0.to_array()) == Some(std::cmp::Ordering::Less);
    let [(p, d), (q, e)] = if is_first { [a, b] } else { [b, a] };
    p + (q - p) * (d / (d - e))
}

/// Appends the triangles of a convex polygon; `face_of` takes their corners.
fn push_fan(polygon: &[DVec3], face_of: impl Fn([DVec3; 3]) -> WorldTriangle, out: &mut Vec<WorldTriangle>) {
    for k in 2..polygon.len() {
        let corners = [polygon[0], polygon[k - 1], polygon[k]];
        let [a, b, c] = corners;
        if (b - a).cross(c - a).length() >= 2.0 * MIN_AREA_M2 || polygon.len() == 3 {
            out.push(WorldTriangle { corners: corners.map(|p| p.to_array()), ..face_of(corners) });
        }
    }
}
