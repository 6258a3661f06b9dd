//! Buildings of level of detail 0: their plans are extruded if attributes tell the height.

use super::SceneSink;
use insula_dress::footprint::{has_height, is_height};
use insula_source::object::{FeatureKind, Footprint, Shape, SourceObject, Surface, SurfaceRole};
use insula_source::problems::UNIT_GUESSED;

/// Problem of a building that stays a plan.
const FLAT: &str = "building of level of detail 0 without a height, drawn flat";

impl SceneSink<'_, '_, '_> {
    /// The plans of a building of level of detail 0 that has a height; `None` for all other objects. Outlines of roofs, which are at
    /// the height of the roof, are none.
    pub(super) fn plans_of(&mut self, object: &SourceObject) -> Option<Vec<Footprint>> {
        let Shape::Surfaces { polygons, meshes } = &object.shape else { return None };
        let is_building = matches!(object.kind, FeatureKind::Building | FeatureKind::BuildingPart);
        let is_plan = is_building && object.lod.is_some_and(|lod| lod < 1.0) && meshes.is_empty();
        if !is_plan || polygons.iter().any(|surface| surface.role == SurfaceRole::Roof) {
            return None;
        }
        if !has_height(&object.attributes, self.height_hints()) {
            self.report.problem(FLAT, || object.id.clone());
            return None;
        }
        let units = object.attributes.iter().filter_map(|(name, unit)| Some((name.strip_suffix(".uom")?, unit)));
        for (name, unit) in units.filter(|(name, _)| is_height(name)) {
            self.report.problem(UNIT_GUESSED, || format!("{}: {name} in {unit}, taken as metres", object.id));
        }
        // Many programs write 0 where they know no height.
        let has_ground = polygons.iter().flat_map(|surface| &surface.points).any(|point| point[2] != 0.0);
        let footprint = |surface: &Surface| {
            let ends = surface.hole_starts.iter().map(|start| *start as usize).chain([surface.points.len()]);
            let mut start = 0;
            let rings = ends.map(|end| {
                let ring = surface.points.get(start..end).unwrap_or_default();
                start = end;
                ring.iter().map(|[x, y, _]| [*x, *y]).collect()
            });
            let rings = rings.collect();
            let lowest = surface.points.iter().map(|point| point[2]).reduce(f64::min);
            Footprint { rings, ground: lowest.filter(|_| has_ground), is_supported: false }
        };
        Some(polygons.iter().map(footprint).collect())
    }
}
