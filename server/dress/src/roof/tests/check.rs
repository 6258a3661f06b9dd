//! Checks of a building's surface by its coordinates alone.

use crate::roof::{RoofShape, RoofSpec};
use glam::DVec3;
use insula_source::object::{Surface, SurfaceRole, ring_ranges};
use std::collections::HashMap;
use std::ops::Range;

fn bits(point: DVec3) -> [u64; 3] {
    point.to_array().map(|x| (x + 0.0).to_bits())
}

fn rings(surface: &Surface) -> Vec<Vec<DVec3>> {
    let ring = |ring: Range<usize>| surface.points[ring].iter().copied().map(DVec3::from).collect();
    ring_ranges(surface.points.len(), &surface.hole_starts).map(ring).collect()
}

fn edges(ring: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    (0..ring.len()).map(|i| (ring[i], ring[(i + 1) % ring.len()]))
}

/// Twice the area as a vector, relative to a point.
fn area_vector(surface: &Surface, origin: DVec3) -> DVec3 {
    let parts = |ring: &Vec<DVec3>| edges(ring).map(|(a, b)| (a - origin).cross(b - origin)).sum::<DVec3>();
    rings(surface).iter().map(parts).sum()
}

pub(super) fn footprint_area(plan: &[Vec<[f64; 2]>]) -> f64 {
    let origin = plan[0][0];
    let cross = |ring: &Vec<[f64; 2]>| -> f64 {
        let at = |i: usize| [ring[i % ring.len()][0] - origin[0], ring[i % ring.len()][1] - origin[1]];
        (0..ring.len()).map(|i| at(i)[0] * at(i + 1)[1] - at(i)[1] * at(i + 1)[0]).sum()
    };
    plan.iter().map(cross).sum::<f64>() / 2.0
}

/// What is wrong with the surface of a building; `Ok` with its volume. Faces may be off their planes by `planar_m`.
pub(super) fn check(
    plan: &[Vec<[f64; 2]>],
    spec: &RoofSpec,
    surfaces: &[Surface],
    planar_m: f64,
) -> Result<f64, String> {
    check_edges(surfaces)?;
    let origin = DVec3::from(surfaces[0].points[0]);
    let overhangs = spec.shape == RoofShape::Onion;
    let (mut volume, mut covered) = (0.0, 0.0);
    for surface in surfaces {
        check_face(surface, planar_m, overhangs)?;
        let area = area_vector(surface, origin);
        volume += (DVec3::from(surface.points[0]) - origin).dot(area) / 6.0;
        if surface.role == SurfaceRole::Roof {
            covered += area.z / 2.0;
        }
        let heights = surface.points.iter().map(|point| point[2]);
        let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), z| (low.min(z), high.max(z)));
        if low < spec.base_m - 1e-6 || high > spec.top_m + 1e-6 {
            return Err(format!("heights {low} to {high}"));
        }
        if surface.role == SurfaceRole::Ground && (low != spec.base_m || high != spec.base_m) {
            return Err(format!("floor at {low} to {high}"));
        }
    }
    let area = footprint_area(plan);
    if (covered - area).abs() > 1e-6 * area {
        return Err(format!("roof covers {covered} of {area}"));
    }
    let reached = surfaces.iter().flat_map(|s| &s.points).map(|point| point[2]).fold(f64::MIN, f64::max);
    if (reached - spec.top_m).abs() > 1e-5 * (spec.top_m - spec.eaves_m) {
        return Err(format!("top at {reached}"));
    }
    if volume > 0.0 { Ok(volume) } else { Err(format!("volume {volume}")) }
}

fn check_edges(surfaces: &[Surface]) -> Result<(), String> {
    let mut count: HashMap<([u64; 3], [u64; 3]), u32> = HashMap::new();
    for ring in surfaces.iter().flat_map(rings) {
        if ring.len() < 3 {
            return Err("ring of two points".to_owned());
        }
        for (a, b) in edges(&ring) {
            if bits(a) == bits(b) {
                return Err(format!("edge without length at {a:?}"));
            }
            *count.entry((bits(a), bits(b))).or_default() += 1;
        }
    }
    for ((a, b), times) in &count {
        if *times != 1 || count.get(&(*b, *a)) != Some(&1) {
            let back = count.get(&(*b, *a)).copied().unwrap_or(0);
            return Err(format!(
                "edge {:?} {:?}: {times} and {back} back",
                a.map(f64::from_bits),
                b.map(f64::from_bits)
            ));
        }
    }
    Ok(())
}

/// Checks that a face is planar, does not cross itself, and looks to where its role says.
fn check_face(surface: &Surface, planar_m: f64, overhangs: bool) -> Result<(), String> {
    let origin = DVec3::from(surface.points[0]);
    let area = area_vector(surface, origin);
    let size = area.length();
    let role = surface.role;
    if size <= 0.0 || !size.is_finite() {
        return Err(format!("{role:?} without area: {:?}", surface.points));
    }
    let normal = area / size;
    let along = || surface.points.iter().map(|point| DVec3::from(*point) - origin);
    let extent = along().map(DVec3::length).fold(0.0, f64::max);
    // Slivers have no certain plane.
    if size > 1e-3 * extent {
        let worst = along().map(|along| along.dot(normal).abs()).fold(0.0, f64::max);
        if worst > planar_m {
            return Err(format!("{role:?} bent by {worst}: {:?}", surface.points));
        }
        let looks_right = match role {
            SurfaceRole::Ground => normal.z < -0.999,
            SurfaceRole::Wall => normal.z.abs() < 1e-3,
            _ => normal.z > 0.0 || overhangs,
        };
        if !looks_right {
            return Err(format!("{role:?} looks to {normal:?}: {:?}", surface.points));
        }
    }
    check_simple(surface, normal)
}

/// Checks that no two edges of a face cross, by pairs.
fn check_simple(surface: &Surface, normal: DVec3) -> Result<(), String> {
    let u = normal.cross(if normal.z.abs() > 0.7 { DVec3::X } else { DVec3::Z }).normalize();
    let v = normal.cross(u);
    let origin = DVec3::from(surface.points[0]);
    let flat = |point: DVec3| [u, v].map(|axis| (point - origin).dot(axis));
    let all: Vec<([f64; 2], [f64; 2])> = rings(surface)
        .iter()
        .flat_map(|ring| edges(ring).map(|(a, b)| (flat(a), flat(b))).collect::<Vec<_>>())
        .collect();
    let side = |(a, b): ([f64; 2], [f64; 2]), p: [f64; 2]| {
        let (x, y) = (b[0] - a[0], b[1] - a[1]);
        (x * (p[1] - a[1]) - y * (p[0] - a[0])) / x.hypot(y)
    };
    let margin = 2e-5;
    let crosses = |s: f64, t: f64| s > margin && t < -margin || s < -margin && t > margin;
    for (i, &a) in all.iter().enumerate() {
        for &b in &all[i + 1..] {
            if crosses(side(a, b.0), side(a, b.1)) && crosses(side(b, a.0), side(b, a.1)) {
                return Err(format!("{:?} crosses itself at {a:?} {b:?}", surface.role));
            }
        }
    }
    Ok(())
}

/// Checks that no point of the surface is inside of an edge, by pairs.
pub(super) fn check_no_t_junction(surfaces: &[Surface], touch_m: f64) -> Result<(), String> {
    let all: Vec<Vec<DVec3>> = surfaces.iter().flat_map(rings).collect();
    for point in all.iter().flatten().copied() {
        for (a, b) in all.iter().flat_map(|ring| edges(ring)) {
            if bits(a) == bits(point) || bits(b) == bits(point) {
                continue;
            }
            let along = b - a;
            let share = (point - a).dot(along) / along.length_squared();
            if share > 0.0 && share < 1.0 && (point - a).cross(along).length() < touch_m * along.length() {
                return Err(format!("{point:?} inside of {a:?} {b:?}"));
            }
        }
    }
    Ok(())
}
