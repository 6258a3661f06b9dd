//! Rings of a footprint: repaired, extruded to a closed prism, or covered with a level surface.

use super::height::BuildingHeight;
use crate::polygon::{Areas, CROSSING, MAX_CORNERS, PolygonFault, Rings, Triangulator, area_m2, clean, crosses_itself};
use crate::world_triangle::WorldTriangle;
use insula_source::problems::FEW_CORNERS;

/// Corners nearer than this are welded.
const WELD_M: f64 = 1e-3;
/// Smaller rings are treated as drawing errors.
pub(super) const MIN_AREA_M2: f64 = 0.01;

const NO_RING_AREA: &str = "ring without area";

/// Numbers of the materials of a prism.
#[derive(Debug, Clone, Copy)]
pub struct PrismMaterials {
    pub roof: u32,
    pub wall: u32,
    pub floor: u32,
}

/// Rings in metres without repeated corners, which neither touch nor cross each other. The outer ring turns counter-clockwise, holes
/// clockwise.
pub struct GroundPlan {
    pub rings: Rings,
}

/// The plans of an area.
pub struct GroundPlans {
    /// Several where holes divide the area.
    pub plans: Vec<GroundPlan>,
    /// Area of the rings, and of the plans.
    pub areas: Areas,
}

impl GroundPlans {
    /// Repairs rings in source coordinates, the outer one first, and passes every repair to `note`. `place` makes world
    /// coordinates of them. Fails with the reason if the outer ring is unusable.
    pub fn new(
        rings: &[Vec<[f64; 2]>],
        mut place: impl FnMut([f64; 2]) -> Option<[f64; 2]>,
        mut note: impl FnMut(&'static str),
    ) -> Result<Self, &'static str> {
        if rings.iter().map(Vec::len).sum::<usize>() > MAX_CORNERS {
            return Err("polygon too large");
        }
        let (outer, holes) = rings.split_first().ok_or("polygon without rings")?;
        let mut rings = vec![repair_ring(outer, &mut place, 1.0, &mut note)?];
        for hole in holes {
            match repair_ring(hole, &mut place, -1.0, &mut note) {
                Ok(hole) => rings.push(hole),
                Err(_) => note("hole filled, its ring is no ring"),
            }
        }
        let is_crossing = rings.iter().any(|ring| crosses_itself(ring));
        let cleaned = if is_crossing || rings.len() > 1 { clean(&rings) } else { None };
        let signed_m2 = rings.iter().map(|ring| area_m2(ring)).sum::<f64>();
        let Some(polygons) = cleaned else {
            if rings.first().is_none_or(|outer| area_m2(outer) < MIN_AREA_M2) {
                return Err(NO_RING_AREA);
            }
            let areas = Areas { rings_m2: signed_m2, triangles_m2: signed_m2 };
            return Ok(Self { plans: vec![GroundPlan { rings }], areas });
        };
        if polygons.is_empty() {
            return Err(NO_RING_AREA);
        }
        let triangles_m2 = polygons.iter().flatten().map(|ring| area_m2(ring)).sum();
        let areas = Areas { rings_m2: signed_m2, triangles_m2 };
        let plans = polygons.into_iter().map(|rings| GroundPlan { rings }).collect();
        if !is_crossing {
            note("hole that touches another ring, cut out");
            return Ok(Self { plans, areas });
        }
        note(if areas.difference().is_some() { CROSSING } else { "ring that touches itself, divided" });
        // Lobes that turn the other way are negative in the area of their ring, which is not that of what it encloses.
        Ok(Self { plans, areas: Areas { rings_m2: triangles_m2, triangles_m2 } })
    }
}

impl GroundPlan {
    /// Appends the prism's triangles. Returns the areas of its rings and of its roof. Fails with the reason if there is nothing to
    /// extrude.
    pub fn extrude(
        &self,
        height: &BuildingHeight,
        materials: PrismMaterials,
        triangulator: &mut Triangulator,
        faces: &mut Vec<WorldTriangle>,
    ) -> Result<Areas, &'static str> {
        let PrismMaterials { roof, wall, floor } = materials;
        let at = |[x, y]: [f64; 2], z: f64| [x, y, z];
        let face = |corners, material, is_facade| WorldTriangle { corners, uv: [[0.0; 2]; 3], material, is_facade };
        let mut tops = Vec::new();
        let areas = self.cover(height.top_m, roof, triangulator, &mut tops)?;
        for top in tops {
            let [a, b, c] = top.corners.map(|[x, y, _]| [x, y, height.base_m]);
            faces.extend([top, face([a, c, b], floor, false)]);
        }
        for ring in &self.rings {
            for (i, &from) in ring.iter().enumerate() {
                let to = ring[(i + 1) % ring.len()];
                let [a, b] = [at(from, height.base_m), at(to, height.base_m)];
                let [c, d] = [at(to, height.top_m), at(from, height.top_m)];
                faces.extend([face([a, b, c], wall, true), face([a, c, d], wall, true)]);
            }
        }
        Ok(areas)
    }

    /// Appends the triangles of a level surface. Returns their area and that of the rings. Fails with the reason if there is nothing
    /// to cover.
    pub fn cover(
        &self,
        z_m: f64,
        material: u32,
        triangulator: &mut Triangulator,
        faces: &mut Vec<WorldTriangle>,
    ) -> Result<Areas, &'static str> {
        let points: Vec<[f64; 3]> = self.rings.iter().flatten().map(|[x, y]| [*x, *y, z_m]).collect();
        let mut starts = Vec::new();
        for ring in &self.rings[..self.rings.len() - 1] {
            starts.push(starts.last().copied().unwrap_or(0) + ring.len() as u32);
        }
        let triangles = triangulator.triangulate(&points, &starts).map_err(PolygonFault::reason)?;
        faces.extend(triangles.list.iter().map(|triangle| WorldTriangle {
            corners: triangle.map(|i| points[i as usize]),
            uv: [[0.0; 2]; 3],
            material,
            is_facade: false,
        }));
        Ok(triangles.areas)
    }
}

/// Converts a ring to metres and turns it so that its area has the sign of `turn`. Fails with the reason if it is
/// unusable.
fn repair_ring(
    positions: &[[f64; 2]],
    place: &mut impl FnMut([f64; 2]) -> Option<[f64; 2]>,
    turn: f64,
    note: &mut impl FnMut(&'static str),
) -> Result<Vec<[f64; 2]>, &'static str> {
    let mut ring: Vec<[f64; 2]> = Vec::with_capacity(positions.len());
    for position in positions {
        let corner = place(*position).ok_or("coordinate not a number or out of range")?;
        if ring.last().is_none_or(|last| !is_near(*last, corner)) {
            ring.push(corner);
        }
    }
    let closed = ring.len() > 1 && is_near(ring[0], ring[ring.len() - 1]);
    if closed {
        ring.pop();
    }
    if ring.len() < 3 {
        return Err(FEW_CORNERS);
    }
    if !closed {
        note("ring not closed, closed");
    }
    let area_m2 = area_m2(&ring);
    // The lobes of one that crosses itself may be as large as each other.
    if area_m2.abs() < MIN_AREA_M2 && !crosses_itself(&ring) {
        return Err(NO_RING_AREA);
    }
    if area_m2 * turn < 0.0 {
        ring.reverse();
    }
    Ok(ring)
}

fn is_near(a: [f64; 2], b: [f64; 2]) -> bool {
    (a[0] - b[0]).abs() < WELD_M && (a[1] - b[1]).abs() < WELD_M
}
