//! What viewers show of a proposal: triangles on the ground of a city, and the objects that are hidden.

use super::{Proposal, ProposalError, ProposedChange, change::NOTHING_REMOVED};
use insula_analysis::proposal::Addition;
use insula_bake::read::{BuildingHeight, GroundPlans, PrismMaterials, Triangulator};
use insula_export::{
    leaves::is_land,
    selection::{ObjectSelection, Polygon, SelectedArea},
    source::ExportSource,
};
use insula_objects::{BLOCK_OBJECTS, FeatureKind, ObjectBounds};
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
        let removed = self.removed_objects(proposal, source)?;
        if self.added.is_empty() && removed.is_empty() {
            return Err(proposal.wrong(NOTHING_REMOVED));
        }
        let (additions, notes) = self.additions_in(proposal, source)?;
        let mut added = Vec::with_capacity(self.added.len());
        for (shape, addition) in self.added.iter().zip(additions) {
            let triangles = match addition {
                Addition::Model(triangles) => triangles,
                Addition::Block { outline, top_m } => block(&outline, [top_m - shape.height_m, top_m])
                    .map_err(|reason| proposal.wrong(&format!("{}: {reason}", shape.name)))?,
            };
            added.push(ProposedObject { name: shape.name.clone(), triangles });
        }
        self.say(&notes);
        Ok(ProposedObjects { added, removed })
    }

    /// The buildings with the identifiers and those that pass the filters, what stands with its middle in the areas, and the parts of all
    /// these. Land stays.
    fn removed_objects(&self, proposal: &Proposal, source: &dyn ExportSource) -> Result<Vec<u32>, ProposalError> {
        if !proposal.removes() {
            return Ok(Vec::new());
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
        if let Some(id) = missing.first() {
            return Err(proposal.wrong(&format!("there is no building {id} in the city")));
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
        Ok(removed.into_iter().collect())
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
