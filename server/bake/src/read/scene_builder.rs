//! Builds a city from objects: shares equal materials, chooses the origin and leaves out objects that are too far away.

use std::collections::HashMap;

use super::report::SourceReport;
use crate::scene::scratch_scene::{ObjectPlacement, ScratchScene, StoredMaterial, StoredObject};
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;
use crate::scene::{ObjectKind, SceneTriangle};

/// No projected system has positions on Earth with larger coordinates.
pub(crate) const MAX_COORDINATE_M: f64 = 1e9;
/// An object further than this from the city's median position is left out: it would reduce the precision of the whole
/// city.
const MAX_DISTANCE_M: f64 = 200_000.0;

/// A triangle in world coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WorldTriangle {
    /// World positions in metres.
    pub(crate) corners: [[f64; 3]; 3],
    /// Texture coordinates, v up.
    pub(crate) uv: [[f32; 2]; 3],
    /// Number returned by [`SceneBuilder::material`].
    pub(crate) material: u32,
}

struct PendingObject {
    id: String,
    kind: ObjectKind,
    source: usize,
    /// The stored corners are relative to this, because f32 is exact enough only near the object until the origin is
    /// known.
    anchor: [f64; 3],
    /// Minimum of the corners relative to the anchor.
    min: [f32; 3],
    /// Maximum of the corners relative to the anchor.
    max: [f32; 3],
    triangles: u64,
}

impl PendingObject {
    /// Minimum along an axis, in world coordinates.
    fn low(&self, axis: usize) -> f64 {
        self.anchor[axis] + f64::from(self.min[axis])
    }

    /// Maximum along an axis, in world coordinates.
    fn high(&self, axis: usize) -> f64 {
        self.anchor[axis] + f64::from(self.max[axis])
    }
}

/// Collects the objects of a city.
pub(crate) struct SceneBuilder {
    pending: Vec<PendingObject>,
    triangles: TriangleStore,
    materials: Vec<StoredMaterial>,
    material_numbers: HashMap<StoredMaterial, u32>,
}

/// Whether a position is finite and within [`MAX_COORDINATE_M`].
pub(crate) fn is_valid_position(p: [f64; 3]) -> bool {
    p.iter().all(|c| c.abs() <= MAX_COORDINATE_M)
}

impl SceneBuilder {
    pub(crate) fn new(triangles: TriangleStore) -> Self {
        Self { pending: Vec::new(), triangles, materials: Vec::new(), material_numbers: HashMap::new() }
    }

    /// Number of the material with this colour and texture.
    pub(crate) fn material(&mut self, rgb: [u8; 3], texture: Option<u32>) -> u32 {
        let material = StoredMaterial { rgb, texture };
        let next = self.materials.len() as u32;
        let index = *self.material_numbers.entry(material).or_insert(next);
        if index == next {
            self.materials.push(material);
        }
        index
    }

    /// Adds an object and counts it in the report. Every corner must be valid (see [`is_valid_position`]). An object
    /// without triangles is not added.
    pub(crate) fn add(
        &mut self,
        source: usize,
        id: &str,
        kind: ObjectKind,
        faces: &[WorldTriangle],
        report: &mut SourceReport,
    ) {
        let Some(first) = faces.first() else { return };
        let anchor = first.corners[0];
        let object = self.pending.len() as u32;
        let (mut min, mut max) = ([0.0f32; 3], [0.0f32; 3]);
        for face in faces {
            let face = if kind == ObjectKind::Terrain { facing_up(face) } else { *face };
            let corners = face.corners.map(|corner| std::array::from_fn(|axis| (corner[axis] - anchor[axis]) as f32));
            for corner in &corners {
                for axis in 0..3 {
                    min[axis] = min[axis].min(corner[axis]);
                    max[axis] = max[axis].max(corner[axis]);
                }
            }
            self.triangles.push(SceneTriangle { corners, uv: face.uv, material: face.material, object });
        }
        let triangles = faces.len() as u64;
        self.pending.push(PendingObject { id: id.to_owned(), kind, source, anchor, min, max, triangles });
        report.objects += 1;
        report.triangles += triangles;
        if kind == ObjectKind::Terrain {
            report.terrain_triangles += triangles;
        }
    }

    /// The city. Its origin is the centre of the bounds in x and y and their bottom in z, in whole metres, so that
    /// corners of a city of 16 km are exact to half a millimetre. Removes objects that are left out from the reports in
    /// `sources`.
    pub(crate) fn finish(self, textures: TextureStore, sources: &mut [SourceReport]) -> ScratchScene {
        let too_far = self.find_too_far();
        let kept = || self.pending.iter().zip(&too_far).filter(|(_, far)| far.is_none()).map(|(object, _)| object);
        let low: [f64; 3] = std::array::from_fn(|axis| kept().map(|object| object.low(axis)).fold(f64::MAX, f64::min));
        let high: [f64; 3] =
            std::array::from_fn(|axis| kept().map(|object| object.high(axis)).fold(f64::MIN, f64::max));
        let mut city = ScratchScene {
            origin: [0.0; 3],
            crs: None,
            bounds: None,
            objects: Vec::with_capacity(self.pending.len()),
            materials: self.materials,
            textures,
            triangles: 0,
            names: Vec::new(),
            placements: Vec::with_capacity(self.pending.len()),
            stored: self.triangles,
        };
        if low[0] > high[0] {
            return city;
        }
        city.origin = [((low[0] + high[0]) / 2.0).floor(), ((low[1] + high[1]) / 2.0).floor(), low[2].floor()];
        let in_memory = matches!(city.stored, TriangleStore::Memory(_));
        let (mut min, mut max) = ([f64::MAX; 3], [f64::MIN; 3]);
        for (object, far) in self.pending.into_iter().zip(too_far) {
            let offset_m: [f64; 3] = std::array::from_fn(|axis| object.anchor[axis] - city.origin[axis]);
            if let Some(distance_m) = far {
                remove_from_report(&object, distance_m, &mut sources[object.source]);
                city.placements.push(ObjectPlacement { offset_m, object: None });
                continue;
            }
            // Rounded in the same way as the corners, so that the bounds are exact.
            let placed = |v: f32, axis: usize| (f64::from(v) + offset_m[axis]) as f32;
            for axis in 0..3 {
                min[axis] = min[axis].min(placed(object.min[axis], axis).into());
                max[axis] = max[axis].max(placed(object.max[axis], axis).into());
            }
            city.placements.push(ObjectPlacement { offset_m, object: Some(city.objects.len() as u32) });
            city.objects.push(StoredObject { kind: object.kind, base_z_m: placed(object.min[2], 2) });
            city.triangles += object.triangles;
            if in_memory {
                city.names.push(object.id);
            }
        }
        city.bounds = Some([min, max]);
        city
    }

    /// For each object its distance from the median object in metres, if that is too far.
    fn find_too_far(&self) -> Vec<Option<f64>> {
        let middle: [f64; 3] = std::array::from_fn(|axis| {
            let mut values: Vec<f64> = self.pending.iter().map(|object| object.anchor[axis]).collect();
            let half = values.len() / 2;
            if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
        });
        let distance = |object: &PendingObject| {
            (0..3)
                .map(|axis| (object.high(axis) - middle[axis]).max(middle[axis] - object.low(axis)))
                .fold(0.0, f64::max)
        };
        self.pending
            .iter()
            .map(|object| Some(distance(object)).filter(|&distance_m| distance_m > MAX_DISTANCE_M))
            .collect()
    }
}

/// Turns a triangle that faces down. Terrain is one-sided, so it must face up.
fn facing_up(face: &WorldTriangle) -> WorldTriangle {
    let [a, b, c] = face.corners;
    let z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if z >= 0.0 {
        return *face;
    }
    WorldTriangle { corners: [a, c, b], uv: [face.uv[0], face.uv[2], face.uv[1]], material: face.material }
}

fn remove_from_report(object: &PendingObject, distance_m: f64, report: &mut SourceReport) {
    report.objects -= 1;
    report.triangles -= object.triangles;
    if object.kind == ObjectKind::Terrain {
        report.terrain_triangles -= object.triangles;
    }
    report.skip("far from the city", || format!("{}: {:.0} km away", object.id, distance_m / 1000.0));
}

#[cfg(test)]
mod tests {
    use super::super::report::SourceFormat;
    use super::*;
    use crate::scene::SceneTexture;
    use std::sync::Arc;

    fn face_at(p: [f64; 3]) -> WorldTriangle {
        let corners = [p, [p[0] + 1.0, p[1], p[2]], [p[0], p[1] + 1.0, p[2] + 2.0]];
        WorldTriangle { corners, uv: [[0.0; 2]; 3], material: 0 }
    }

    fn builder() -> SceneBuilder {
        SceneBuilder::new(TriangleStore::Memory(Vec::new()))
    }

    fn report() -> Vec<SourceReport> {
        vec![SourceReport::new("a", SourceFormat::Obj, 0)]
    }

    #[test]
    fn large_coordinates_keep_a_precision_of_a_millimetre() {
        let (mut builder, mut sources) = (builder(), report());
        let places = [[6_240_000.123, 457_604.591, 2.463], [6_256_000.789, 457_604.501, 37.481]];
        for place in places {
            builder.add(0, "a", ObjectKind::Building, &[face_at(place)], &mut sources[0]);
        }
        let scene = builder.finish(TextureStore::in_memory(), &mut sources).into_scene().unwrap();
        assert_eq!(scene.origin, [6_248_000.0, 457_605.0, 2.0]);
        for (triangle, place) in scene.triangles.iter().zip(places) {
            for axis in 0..3 {
                let world = scene.origin[axis] + f64::from(triangle.corners[0][axis]);
                assert!((world - place[axis]).abs() < 1e-3, "{world} is not {}", place[axis]);
            }
        }
        assert_eq!([scene.triangles[0].object, scene.triangles[1].object], [0, 1]);
        assert!((scene.objects[1].base_z_m - 35.481).abs() < 1e-3);
    }

    #[test]
    fn objects_far_from_the_city_are_left_out_and_reported() {
        let (mut builder, mut sources) = (builder(), report());
        for (id, x) in [("a", 500_000.0), ("remote", 0.0), ("b", 500_010.0)] {
            builder.add(0, id, ObjectKind::Terrain, &[face_at([x, 0.0, 0.0])], &mut sources[0]);
        }
        let scene = builder.finish(TextureStore::in_memory(), &mut sources).into_scene().unwrap();
        let ids: Vec<_> = scene.objects.iter().map(|object| object.id.as_str()).collect();
        assert_eq!(ids, ["a", "b"]);
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.triangles[1].object, 1);
        assert_eq!((sources[0].objects, sources[0].triangles, sources[0].terrain_triangles), (2, 2, 2));
        assert_eq!(sources[0].skipped["far from the city"].first, ["remote: 500 km away"]);
    }

    #[test]
    fn equal_materials_are_shared_and_terrain_faces_up() {
        let (mut builder, mut sources) = (builder(), report());
        let mut textures = TextureStore::in_memory();
        let texture = textures.add(Arc::new(SceneTexture { width: 1, height: 1, rgb: vec![[1, 2, 3]] }));
        let plain = builder.material([9; 3], None);
        assert_ne!(plain, builder.material([9; 3], Some(texture)));
        assert_eq!(plain, builder.material([9; 3], None));
        let mut face = face_at([0.0; 3]);
        face.corners.swap(1, 2);
        builder.add(0, "t", ObjectKind::Terrain, &[face], &mut sources[0]);
        let scene = builder.finish(textures, &mut sources).into_scene().unwrap();
        let [a, b, c] = scene.triangles[0].corners;
        assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0);
        assert_eq!(scene.materials.len(), 2);
    }
}
