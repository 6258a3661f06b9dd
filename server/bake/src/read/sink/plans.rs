//! Buildings of level of detail 0: their plans are extruded if attributes tell the height. Flat areas whose heights are not known.

use super::SceneSink;
use insula_dress::footprint::{BuildingHeight, has_height};
use insula_source::object::{FeatureKind, Footprint, Shape, SourceObject, Surface, SurfaceRole, ring_ranges};
use insula_source::units::FOOT_M;
use std::ops::Range;

/// Problem of a building that stays a plan.
const FLAT: &str = "building of level of detail 0 without a height, drawn flat";

/// Two plans of a building at heights that differ by less are parts of its ground.
const LEAST_STEP: f64 = 0.5;
/// Share of the larger of two boxes that both have in common, for one to be above the other.
const LEAST_COMMON: f64 = 0.8;

impl SceneSink<'_, '_, '_> {
    /// The plans of a building of level of detail 0 that has a height; `None` for all other objects. The outline of a roof, which is
    /// at its height, is one only if there is no other.
    pub(super) fn plans_of(&mut self, object: &SourceObject) -> Option<Vec<Footprint>> {
        let Shape::Surfaces { polygons, meshes } = &object.shape else { return None };
        let is_building = matches!(object.kind, FeatureKind::Building | FeatureKind::BuildingPart);
        let is_plan = is_building && object.lod.is_some_and(|lod| lod < 1.0) && meshes.is_empty();
        if !is_plan {
            return None;
        }
        let hints = self.height_hints();
        if !has_height(&object.attributes, hints) {
            self.report.problem(FLAT, || object.id.clone());
            return None;
        }
        // Many programs write 0 where they know no height.
        let has_ground = polygons.iter().flat_map(|surface| &surface.points).any(|point| point[2] != 0.0);
        let (roofs, plans): (Vec<&Surface>, Vec<&Surface>) =
            polygons.iter().partition(|surface| surface.role == SurfaceRole::Roof);
        let (plans, below) = if plans.is_empty() {
            let height = BuildingHeight::of(&object.attributes, hints, |_, _| {});
            let unit_m = if hints.is_map_in_feet { FOOT_M } else { 1.0 };
            (roofs, height.top_m / unit_m)
        } else {
            (plans, 0.0)
        };
        let is_lowest = |surface: &&&Surface| !plans.iter().any(|other| covers(other, surface));
        let footprint = |surface: &&Surface| {
            let ground = lowest(surface).filter(|_| has_ground).map(|z| z - below);
            Footprint { rings: rings(surface), ground, is_supported: false }
        };
        Some(plans.iter().filter(is_lowest).map(footprint).collect())
    }
}

/// The areas of a flat object whose heights are exactly 0 everywhere; `None` of all other objects. Its source knows none, as that of roads
/// and land use of PLATEAU: they lie on the ground. What has colours of its own stays as it is.
pub(super) fn areas_without_heights(object: &SourceObject) -> Option<Vec<Footprint>> {
    let Shape::Surfaces { polygons, meshes } = &object.shape else { return None };
    let is_flat = matches!(object.kind, FeatureKind::Road | FeatureKind::Rail | FeatureKind::LandUse);
    let is_plain = meshes.is_empty() && polygons.iter().all(|surface| surface.material.is_none());
    let is_at_zero = || polygons.iter().flat_map(|surface| &surface.points).all(|point| point[2] == 0.0);
    if !(is_flat && is_plain && !polygons.is_empty() && is_at_zero()) {
        return None;
    }
    let footprint = |surface: &Surface| Footprint { rings: rings(surface), ground: None, is_supported: false };
    Some(polygons.iter().map(footprint).collect())
}

/// Whether a polygon lies below another one with about the same box on the map: the ground of a building, and the outline of its roof
/// that does not say what it is.
fn covers(lower: &Surface, upper: &Surface) -> bool {
    let (Some(low), Some(high)) = (lowest(lower), lowest(upper)) else { return false };
    if high - low < LEAST_STEP {
        return false;
    }
    let ([a, b], [c, d]) = (bounds(lower), bounds(upper));
    let area = |low: [f64; 2], high: [f64; 2]| (high[0] - low[0]).max(0.0) * (high[1] - low[1]).max(0.0);
    let common = area([0, 1].map(|i| a[i].max(c[i])), [0, 1].map(|i| b[i].min(d[i])));
    common > LEAST_COMMON * area(a, b).max(area(c, d))
}

/// South-west and north-east corner.
fn bounds(surface: &Surface) -> [[f64; 2]; 2] {
    let along = |axis: usize| surface.points.iter().map(move |point| point[axis]);
    [
        [0, 1].map(|axis| along(axis).fold(f64::INFINITY, f64::min)),
        [0, 1].map(|axis| along(axis).fold(f64::NEG_INFINITY, f64::max)),
    ]
}

fn lowest(surface: &Surface) -> Option<f64> {
    surface.points.iter().map(|point| point[2]).reduce(f64::min)
}

fn rings(surface: &Surface) -> Vec<Vec<[f64; 2]>> {
    let on_map =
        |ring: Range<usize>| surface.points.get(ring).unwrap_or_default().iter().map(|[x, y, _]| [*x, *y]).collect();
    ring_ranges(surface.points.len(), &surface.hole_starts).map(on_map).collect()
}
