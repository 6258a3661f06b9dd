//! What viewers show of a proposal: triangles on the ground of a city, and the objects that are hidden.

use super::change::{AddedShape, NOTHING_REMOVED, name_of};
use super::{Proposal, ProposalError, ProposedChange};
use insula_analysis::proposal::Addition;
use insula_bake::read::{
    AddedContent, AddedInput, BuildingHeight, GroundPlans, PrismMaterials, ProposalOptions, RemovedObject, Triangulator,
};
use insula_export::leaves::is_land;
use insula_export::selection::{ObjectSelection, Polygon, SelectedArea};
use insula_export::source::ExportSource;
use insula_objects::{BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectBounds};
use insula_protocol::object_tile::block_of_object;
use insula_protocol::text::printable;
use std::collections::BTreeSet;

/// Parts of parts are removed with them, so deep at most.
const MAX_PART_DEPTH: usize = 8;

/// What viewers show.
#[derive(Debug, Clone, Default)]
pub struct ProposedObjects {
    /// Models and blocks in the order of the file.
    pub added: Vec<ProposedObject>,
    /// Numbers of the objects that are removed, with their parts.
    pub removed: Vec<u32>,
}

/// A model or a block.
#[derive(Debug, Clone)]
pub struct ProposedObject {
    /// Name of its file.
    pub name: String,
    /// World metres.
    pub triangles: Vec<[[f64; 3]; 3]>,
}

impl ProposedChange {
    /// What viewers show of the change. Fails if a building that is removed is not there, or if the city cannot be read.
    pub fn objects(&self, proposal: &Proposal, source: &dyn ExportSource) -> Result<ProposedObjects, ProposalError> {
        let (removed, missing) = self.removed_objects(proposal, source)?;
        if let Some(id) = missing.first() {
            return Err(proposal.wrong(&format!("there is no building {id} in the city")));
        }
        let (lifts, notes) = self.lifts_of(proposal, source, &removed)?;
        let mut added = Vec::with_capacity(self.added.len());
        for (shape, by_m) in self.added.iter().zip(lifts) {
            added.push(ProposedObject { name: name_of(&shape.file), triangles: shape.triangles(proposal, by_m)? });
        }
        self.say(&notes);
        Ok(ProposedObjects { added, removed })
    }

    /// What a bake of the city's inputs makes of the change. Buildings that are to be removed and are not there are a warning. Fails if the
    /// city cannot be read.
    pub fn for_bake(&self, proposal: &Proposal, source: &dyn ExportSource) -> Result<ProposalOptions, ProposalError> {
        let (numbers, missing) = self.removed_objects(proposal, source)?;
        let (lifts, notes) = self.lifts_of(proposal, source, &numbers)?;
        for id in &missing {
            eprintln!("{}", printable(&format!("warning: {}", proposal.wrong(&format!("there is no building {id}")))));
        }
        let mut added = Vec::with_capacity(self.added.len());
        for (shape, by_m) in self.added.iter().zip(lifts) {
            let content = match (&shape.addition, shape.origin) {
                (Addition::Block { .. }, _) => AddedContent::Block(shape.triangles(proposal, by_m)?),
                (Addition::Model(_), Some([lon, lat, height_m])) => {
                    AddedContent::PlacedModel { origin: [lon, lat, height_m + by_m], heading_deg: shape.heading_deg }
                }
                (Addition::Model(_), None) => AddedContent::Model { base_m: by_m },
            };
            added.push(AddedInput { file: shape.file.clone(), content });
        }
        let mut removed = Vec::with_capacity(numbers.len());
        let mut block: Option<(u32, Option<ObjectBlock>)> = None;
        for id in numbers {
            let number = block_of_object(id);
            if block.as_ref().is_none_or(|(known, _)| *known != number) {
                let read = source.objects(number).map_err(|error| proposal.wrong(&error.to_string()))?;
                block = Some((number, read));
            }
            // Objects without a shape are in no tile.
            let Some(block) = block.as_ref().and_then(|(_, block)| block.as_ref()) else { continue };
            let (Some(identifier), Some(bounds)) = (block.identifier(id), block.bounds(id)) else { continue };
            let bounds_m = on_map(bounds, source.manifest().origin);
            removed.push(RemovedObject { identifier: identifier.to_owned(), bounds_m });
        }
        self.say(&notes);
        let (title, files) = (proposal.name().to_owned(), proposal.files());
        Ok(ProposalOptions { title, added, removed, missing, files })
    }

    /// As [`Self::lifts_in`]. Fails, in addition, if nothing is changed.
    fn lifts_of(
        &self,
        proposal: &Proposal,
        source: &dyn ExportSource,
        removed: &[u32],
    ) -> Result<(Vec<f64>, Vec<String>), ProposalError> {
        match self.added.is_empty() && removed.is_empty() {
            true => Err(proposal.wrong(NOTHING_REMOVED)),
            false => self.lifts_in(proposal, source),
        }
    }

    /// The buildings with the identifiers and those that pass the filters, what stands with its middle in the areas, and the parts of all
    /// these. Land stays. And the identifiers that no building has.
    fn removed_objects(
        &self,
        proposal: &Proposal,
        source: &dyn ExportSource,
    ) -> Result<(Vec<u32>, Vec<String>), ProposalError> {
        if !proposal.removes() {
            return Ok((Vec::new(), Vec::new()));
        }
        let polygons = Some(SelectedArea::new(self.areas.clone()));
        let areas = ObjectSelection { polygons, ..ObjectSelection::default() };
        let origin = source.manifest().origin;
        let (mut removed, mut parts) = (BTreeSet::new(), Vec::new());
        let mut missing: BTreeSet<&str> = self.ids.iter().map(String::as_str).collect();
        for number in 0..source.schema().objects.div_ceil(BLOCK_OBJECTS as u32) {
            let Some(block) = source.objects(number).map_err(|error| proposal.wrong(&error.to_string()))? else {
                continue;
            };
            for &id in block.ids() {
                let Some(kind) = block.kind(id) else { continue };
                let is_building = matches!(kind, FeatureKind::Building | FeatureKind::BuildingPart);
                let is_named = is_building && block.identifier(id).is_some_and(|name| self.ids.contains(name));
                if let Some(name) = block.identifier(id).filter(|_| is_named) {
                    missing.remove(name);
                }
                let is_in_area = !is_land(kind) && areas.contains(id, block.bounds(id).map(|b| on_map(b, origin)));
                if is_named || is_building && self.numbers.contains(id) || is_in_area {
                    removed.insert(id);
                }
                parts.extend(block.parent(id).map(|parent| (id, parent)));
            }
        }
        for _ in 0..MAX_PART_DEPTH {
            let before = removed.len();
            for (part, whole) in &parts {
                if removed.contains(whole) {
                    removed.insert(*part);
                }
            }
            if removed.len() == before {
                break;
            }
        }
        Ok((removed.into_iter().collect(), missing.into_iter().map(str::to_owned).collect()))
    }
}

impl AddedShape {
    /// The triangles, some metres higher. Fails if an outline has no area.
    fn triangles(&self, proposal: &Proposal, by_m: f64) -> Result<Vec<[[f64; 3]; 3]>, ProposalError> {
        match self.raised(by_m) {
            Addition::Model(triangles) => Ok(triangles),
            Addition::Block { outline, top_m } => block(&outline, [top_m - self.height_m, top_m])
                .map_err(|reason| proposal.wrong(&format!("{}: {reason}", name_of(&self.file)))),
        }
    }
}

/// Lower and upper corner on the map of what has these bounds, in world metres.
fn on_map(bounds: ObjectBounds, origin: [f64; 3]) -> [[f64; 2]; 2] {
    [bounds.min, bounds.max].map(|corner| [0, 1].map(|k| origin[k] + f64::from(corner[k]) / 10.0))
}

/// The triangles of a block from its base to its top. Fails with the reason if its outline has no area.
fn block(outline: &Polygon, [base_m, top_m]: [f64; 2]) -> Result<Vec<[[f64; 3]; 3]>, &'static str> {
    let height = BuildingHeight { base_m, top_m, is_without_roof: false };
    let materials = PrismMaterials { roof: 0, wall: 0, floor: 0 };
    let (mut triangulator, mut faces) = (Triangulator::new(), Vec::new());
    for plan in &GroundPlans::new(outline, Some, |_| ())?.plans {
        plan.extrude(&height, materials, &mut triangulator, &mut faces)?;
    }
    Ok(faces.iter().map(|face| face.corners).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_closed_between_its_base_and_its_top() {
        let ring = vec![[5.0, 5.0], [15.0, 5.0], [15.0, 9.0], [5.0, 9.0], [5.0, 5.0]];
        let triangles = block(&vec![ring], [50.0, 62.0]).unwrap();
        // Two for each of four walls, for the roof and for the floor.
        assert_eq!(triangles.len(), 12);
        // The volume of a closed surface that is seen from outside.
        let volume_m3: f64 = triangles
            .iter()
            .map(|[a, b, c]| {
                let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
                (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6.0
            })
            .sum();
        assert!((volume_m3 - 480.0).abs() < 1e-6, "{volume_m3}");
        assert!(block(&vec![vec![[0.0; 2], [9.0, 0.0], [0.0; 2]]], [0.0, 1.0]).is_err());
    }
}
