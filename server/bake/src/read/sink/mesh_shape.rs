//! Meshes whose numbers suggest that another axis points up, or that they are in another unit. Their formats tell neither.

use glam::DVec3;
use insula_source::object::{FeatureKind, Shape, SourceObject};
use insula_source::problems::{GLTF_UP, MESH_UNIT, MESH_UP};
use insula_source::report::SourceReport;

/// What stands upright is at least this wide and high, and in its depth less than this share of both: a wall is no model.
const LEAST_SIDE_M: f64 = 50.0;
const FLAT_SHARE: f64 = 0.1;
/// More roofs and floors than walls face along the axis that points up.
const AREA_RATIO: f64 = 2.0;
/// Models around an origin of their own are hardly wider.
const WIDEST_M: f64 = 20_000.0;
/// Objects are hardly higher, but for terrain, which is much wider than high.
const HIGHEST_M: f64 = 1000.0;
const LEAST_SLOPE: f64 = 0.2;

/// Fewer objects are no town. Those past the most are not compared.
const TOWN_OBJECTS: std::ops::RangeInclusive<usize> = 3..=4096;
/// The feet of the objects of a town differ by less, and their places by more times the usual size of an object.
const SAME_FOOT_M: f64 = 1.0;
const PLACES_RATIO: f64 = 5.0;

/// What is known of the objects of a mesh.
#[derive(Debug)]
pub(super) struct MeshShape {
    /// Whether the format tells the axis and the unit.
    is_gltf: bool,
    /// Lowest and highest corner of the first objects.
    objects: Vec<[DVec3; 2]>,
    low: DVec3,
    high: DVec3,
    /// Area that faces along each axis, either way.
    area: DVec3,
    /// Height and name of the first object that is too high.
    tower: Option<(f64, String)>,
}

impl Default for MeshShape {
    fn default() -> Self {
        let (low, high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        Self { is_gltf: false, objects: Vec::new(), low, high, area: DVec3::ZERO, tower: None }
    }
}

impl MeshShape {
    /// Of a glTF, which is turned upright before.
    pub(super) fn of_gltf() -> Self {
        Self { is_gltf: true, ..Self::default() }
    }

    /// Takes note of an object, whose positions `turn` makes those of the city.
    pub(super) fn add(&mut self, object: &SourceObject, turn: impl Fn([f64; 3]) -> [f64; 3]) {
        let Shape::Surfaces { polygons, meshes } = &object.shape else { return };
        let mut own = Self::default();
        for surface in polygons {
            let end = surface.hole_starts.first().map_or(surface.points.len(), |start| *start as usize);
            own.add_face(surface.points.iter().take(end).map(|point| DVec3::from(turn(*point))));
        }
        for mesh in meshes {
            for triangle in &mesh.triangles {
                let corners = triangle.iter().filter_map(|index| mesh.positions.get(*index as usize));
                own.add_face(corners.map(|corner| DVec3::from(turn(*corner))));
            }
        }
        let size = own.high - own.low;
        if size.is_finite() && self.objects.len() < *TOWN_OBJECTS.end() {
            self.objects.push([own.low, own.high]);
        }
        let is_tower = size.z > HIGHEST_M && size.z > LEAST_SLOPE * size.x.max(size.y);
        if is_tower && object.kind != FeatureKind::Relief && self.tower.is_none() {
            self.tower = Some((size.z, object.id.clone()));
        }
        (self.low, self.high) = (self.low.min(own.low), self.high.max(own.high));
        self.area += own.area;
    }

    fn add_face(&mut self, mut corners: impl Iterator<Item = DVec3>) {
        let Some(first) = corners.next() else { return };
        (self.low, self.high) = (self.low.min(first), self.high.max(first));
        let (mut last, mut area) = (first, DVec3::ZERO);
        for corner in corners {
            area += (last - first).cross(corner - first) * 0.5;
            (self.low, self.high) = (self.low.min(corner), self.high.max(corner));
            last = corner;
        }
        self.area += area.abs();
    }

    /// Whether the objects stand side by side on the plane of x and z, as a town does whose y axis points up. `foot` is the lower end
    /// of an object along that axis.
    fn stands_on_y(&self, foot: impl Fn(&[DVec3; 2]) -> f64) -> bool {
        if !TOWN_OBJECTS.contains(&self.objects.len()) {
            return false;
        }
        let sorted = |value: &dyn Fn(&[DVec3; 2]) -> f64| {
            let mut values: Vec<f64> = self.objects.iter().map(value).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        // Without those that are unlike the others.
        let spread = |value: &dyn Fn(&[DVec3; 2]) -> f64| {
            let (values, cut) = (sorted(value), self.objects.len() / 10);
            values[values.len() - 1 - cut] - values[cut]
        };
        let size = self.high - self.low;
        let height_m = sorted(&|[low, high]| high.z - low.z)[self.objects.len() / 2];
        // Storeys of a tower are above each other, and stand at one place of the map.
        let is_wide = size.x.min(size.z) > LEAST_SIDE_M.max(size.y) && spread(&|[low, _]| low.x) > SAME_FOOT_M;
        is_wide && spread(&foot) < SAME_FOOT_M && spread(&|[low, _]| low.z) > PLACES_RATIO * height_m
    }

    /// Names what is suspicious. `is_turned` if the user says that y points up.
    pub(super) fn note_in(&self, is_turned: bool, report: &mut SourceReport) {
        if self.is_gltf {
            if self.stands_on_y(|[_, high]| -high.y) {
                let advice = "its objects stand side by side there; y points up in a glTF: export it so";
                report.problem(GLTF_UP, || format!("{} objects: {advice}", self.objects.len()));
            }
            return;
        }
        let DVec3 { x, y, z } = self.high - self.low;
        let narrower = x.min(z);
        let is_flat = narrower > LEAST_SIDE_M && y < FLAT_SHARE * narrower && self.area.y > AREA_RATIO * self.area.z;
        if !is_turned && (is_flat || self.stands_on_y(|[low, _]| low.y)) {
            report.problem(MESH_UP, || {
                format!("{x:.0} m from west to east, {y:.0} m deep and {z:.0} m high; if y points up, give --obj-up y")
            });
        }
        let (width, farthest) = (x.max(y), self.low.abs().max(self.high.abs()));
        // Coordinates of a map are far from its origin.
        let is_local = farthest.x.max(farthest.y) <= 2.0 * width;
        let advice = "are its units millimetres? scale it, or give a \"scale\" in its .place.json file";
        if width > WIDEST_M && is_local {
            report.problem(MESH_UNIT, || format!("{width:.0} m wide, taken as metres; {advice}"));
        } else if let Some((height, id)) = &self.tower {
            report.problem(MESH_UNIT, || format!("{id} is {height:.0} m high, taken as metres; {advice}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::attributes::Attributes;
    use insula_source::object::Surface;
    use insula_source::report::SourceFormat;

    /// A box of a size, with its lowest corner at a place.
    fn object([x, y, z]: [f64; 3], place: [f64; 3]) -> SourceObject {
        let corner = |number: usize| {
            [0, 1, 2].map(|axis| place[axis] + if (number >> axis) & 1 == 1 { [x, y, z][axis] } else { 0.0 })
        };
        let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let surface = |face: [usize; 4]| Surface { points: face.map(corner).to_vec(), ..Surface::default() };
        let shape = Shape::Surfaces { polygons: faces.map(surface).to_vec(), meshes: Vec::new() };
        SourceObject {
            id: "a".to_owned(),
            parent: None,
            kind: FeatureKind::Building,
            source_type: String::new(),
            lod: None,
            attributes: Attributes::default(),
            shape,
        }
    }

    fn problems(mut mesh: MeshShape, objects: &[SourceObject], is_turned: bool) -> Vec<String> {
        objects.iter().for_each(|object| mesh.add(object, |position| position));
        let mut report = SourceReport::new("a.obj", SourceFormat::Obj, 1);
        mesh.note_in(is_turned, &mut report);
        report.problems.into_keys().collect()
    }

    /// The kinds of problems of a box.
    fn noted(size: [f64; 3], is_turned: bool) -> Vec<String> {
        problems(MeshShape::default(), &[object(size, [0.0; 3])], is_turned)
    }

    #[test]
    fn towns_that_lie_on_their_side_are_named() {
        // Houses of 8 to 12 m on a grid.
        let houses: Vec<[f64; 3]> =
            (0..25).map(|i| [30.0 * f64::from(i % 5), 30.0 * f64::from(i / 5), 8.0 + f64::from(i % 5)]).collect();
        let town = |of: &dyn Fn(&[f64; 3]) -> SourceObject| houses.iter().map(of).collect::<Vec<_>>();
        let upright = town(&|[x, y, height]| object([12.0, 9.0, *height], [*x, *y, 0.0]));
        let y_up = town(&|[x, z, height]| object([12.0, *height, 9.0], [*x, 0.0, -z]));
        // A glTF with z up, as it is after its reader has turned it.
        let turned = town(&|[x, z, height]| object([12.0, *height, 9.0], [*x, -height, *z]));
        let tower: Vec<SourceObject> =
            (0..40).map(|floor| object([60.0, 60.0, 0.3], [0.0, 0.0, 3.0 * f64::from(floor)])).collect();
        let of_obj = |objects: &[SourceObject], is_turned| problems(MeshShape::default(), objects, is_turned);
        assert_eq!((of_obj(&y_up, false), of_obj(&y_up, true)), (vec![MESH_UP.to_owned()], vec![]));
        assert_eq!((of_obj(&upright, false), of_obj(&tower, false)), (vec![], vec![]));
        assert_eq!(problems(MeshShape::of_gltf(), &turned, false), [GLTF_UP]);
        assert_eq!(problems(MeshShape::of_gltf(), &upright, false), [""; 0]);
    }

    #[test]
    fn axes_and_units_that_are_unlikely_are_named() {
        assert_eq!(noted([500.0, 30.0, 400.0], false), [MESH_UP]);
        assert_eq!(noted([500.0, 30.0, 400.0], true), [""; 0]);
        assert_eq!(noted([500.0, 400.0, 30.0], false), [""; 0]);
        // A slab is as deep as its rooms.
        assert_eq!(noted([80.0, 14.0, 60.0], false), [""; 0]);
        assert_eq!(noted([40_000.0, 30_000.0, 900.0], false), [MESH_UNIT]);
        assert_eq!(noted([9000.0, 12_000.0, 8000.0], false), [MESH_UNIT]);
    }
}
