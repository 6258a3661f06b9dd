//! The footprints of a city's buildings, small enough to have those of two cities in memory: about 120 bytes each.

use crate::rings::twice_area;
use crate::selection::ObjectSelection;
use crate::table::ExportError;
use crate::table::city::{City, Plan};
use crate::table::gather::{Footprint, visit_footprints};
use crate::table::grid::{MapGrid, MapPoint};
use roaring::RoaringBitmap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;

/// Most points of the footprints of a city: 2 GiB.
const MAX_POINTS: usize = 1 << 28;

/// A building on the map.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BuildingShape {
    /// Number of the object.
    pub(super) object: u32,
    /// Of its identifier; 0 without one.
    pub(super) name: u64,
    /// Lowest and highest corner, in units of the map.
    pub(super) bounds: [[i32; 2]; 2],
    /// In square units of the map.
    pub(super) area: f64,
    /// Heights of the lowest and the highest point in world metres.
    pub(super) z_m: [f64; 2],
    rings: Range<u32>,
}

impl BuildingShape {
    pub(super) fn height_m(&self) -> f64 {
        self.z_m[1] - self.z_m[0]
    }
}

/// The buildings of a city. Outer rings are counter-clockwise, holes clockwise.
#[derive(Debug, Default)]
pub(super) struct BuildingShapes {
    pub(super) all: Vec<BuildingShape>,
    points: Vec<MapPoint>,
    /// Where each ring ends among the points.
    ends: Vec<u32>,
    /// Buildings that are not on the map.
    pub(super) beyond: u64,
}

impl BuildingShapes {
    /// Reads the buildings of an area, each with its parts, onto a map. `on_map` gives the place there of one in the city's world metres.
    /// Fails if the city cannot be read, or has too many.
    pub(super) fn read(
        city: &City<'_>,
        area: Option<[[f64; 2]; 2]>,
        grid: &MapGrid,
        on_map: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
    ) -> Result<Self, ExportError> {
        let mut plan = Plan::of(city, &ObjectSelection { bbox: area, ..ObjectSelection::default() })?;
        plan.select_wholes(city)?;
        let mut buildings = RoaringBitmap::new();
        for object in &plan.selected {
            if city.info(object)?.is_some_and(|info| info.kind.is_of_building()) {
                buildings.insert(object);
            }
        }
        plan.selected = buildings;
        let mut shapes = Self::default();
        visit_footprints(city, &plan, &mut |object, footprint| {
            if footprint.polygons.is_empty() {
                return Ok(());
            }
            let rings = footprint.polygons.iter().flatten();
            let rings: Option<Vec<Vec<MapPoint>>> = rings.map(|ring| on_grid(ring, grid, on_map)).collect();
            let Some(rings) = rings else {
                shapes.beyond += 1;
                return Ok(());
            };
            let identifier = city.identifier(object)?;
            shapes.add(object, &identifier, footprint.z_m, &rings);
            if shapes.points.len() > MAX_POINTS {
                let reason = "too many buildings; choose a smaller area".to_owned();
                return Err(ExportError::TooLarge { format: "a comparison", reason });
            }
            Ok(())
        })?;
        Ok(shapes)
    }

    /// Adds a building. Rings do not repeat their first points.
    pub(super) fn add(&mut self, object: u32, identifier: &str, z_m: [f64; 2], rings: &[Vec<MapPoint>]) {
        let first = self.ends.len() as u32;
        let mut twice = 0.0;
        let mut bounds = [[i32::MAX; 2], [i32::MIN; 2]];
        for ring in rings {
            twice += twice_area(ring) as f64;
            for point in ring {
                let place = [point.x, point.y];
                bounds = [[0, 1].map(|k| bounds[0][k].min(place[k])), [0, 1].map(|k| bounds[1][k].max(place[k]))];
            }
            self.points.extend_from_slice(ring);
            self.ends.push(self.points.len() as u32);
        }
        let rings = first..self.ends.len() as u32;
        self.all.push(BuildingShape { object, name: name_of(identifier), bounds, area: 0.5 * twice, z_m, rings });
    }

    pub(super) fn rings(&self, shape: &BuildingShape) -> impl Iterator<Item = &[MapPoint]> {
        shape.rings.clone().map(move |ring| {
            let ring = ring as usize;
            let from = ring.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
            &self.points[from..self.ends[ring] as usize]
        })
    }

    /// Where a building is, in world metres of the map.
    pub(super) fn footprint(&self, shape: &BuildingShape, grid: &MapGrid) -> Footprint {
        let mut polygons: Vec<Vec<Vec<[f64; 2]>>> = Vec::new();
        for ring in self.rings(shape) {
            let closed = ring.iter().chain(ring.first()).map(|point| grid.world(*point)).collect();
            match polygons.last_mut().filter(|_| twice_area(ring) < 0) {
                Some(polygon) => polygon.push(closed),
                None => polygons.push(vec![closed]),
            }
        }
        Footprint { polygons, z_m: shape.z_m, area_m2: shape.area * grid.unit_area_m2() }
    }
}

/// A closed ring on the map, without its last point; `None` if it has no place there.
fn on_grid(ring: &[[f64; 2]], grid: &MapGrid, on_map: &dyn Fn([f64; 2]) -> Option<[f64; 2]>) -> Option<Vec<MapPoint>> {
    let open = ring.get(..ring.len().saturating_sub(1)).unwrap_or_default();
    open.iter().map(|place| on_map(*place).map(|place| grid.point(place))).collect()
}

/// Equal for equal identifiers.
fn name_of(identifier: &str) -> u64 {
    if identifier.is_empty() {
        return 0;
    }
    let mut hasher = DefaultHasher::new();
    identifier.hash(&mut hasher);
    hasher.finish().max(1)
}
