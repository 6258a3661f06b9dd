//! Objects to a city: materials shared, the origin chosen, stray objects left out.
//!
//! In: faces of one object at a time, in f64. Out: [`ScratchScene`]. Next: `partition`.

use std::collections::HashMap;

use super::report::SourceReport;
use crate::scene::scratch_scene::{
    ObjectPlacement, ScratchScene, StoredMaterial, StoredObject, TextureStore, TriangleStore,
};
use crate::scene::{ObjectKind, SceneTriangle};

/// Coordinates beyond this are no place on Earth in metres of any projected system.
pub(crate) const ABSURD_M: f64 = 1e9;
/// An object this far from the city's middle is a stray: it would take the whole city's precision.
const STRAY_M: f64 = 200_000.0;

/// A triangle before the origin is known.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WorldTriangle {
    /// World positions.
    pub(crate) corners: [[f64; 3]; 3],
    /// v up.
    pub(crate) uv: [[f32; 2]; 3],
    /// From [`SceneBuilder::material`].
    pub(crate) material: u32,
}

struct PendingObject {
    id: String,
    kind: ObjectKind,
    source: usize,
    /// The triangles' corners are kept relative to this, so that f32 is exact enough before the origin is known.
    anchor: [f64; 3],
    /// Bounds of the corners, relative to the anchor.
    min: [f32; 3],
    max: [f32; 3],
    triangles: u64,
}

impl PendingObject {
    /// One end of its bounds along an axis, in world coordinates.
    fn low(&self, axis: usize) -> f64 {
        self.anchor[axis] + f64::from(self.min[axis])
    }

    fn high(&self, axis: usize) -> f64 {
        self.anchor[axis] + f64::from(self.max[axis])
    }
}

/// Collects a city, triangles in memory or in a file.
pub(crate) struct SceneBuilder {
    drafts: Vec<PendingObject>,
    triangles: TriangleStore,
    paints: Vec<StoredMaterial>,
    by_look: HashMap<StoredMaterial, u32>,
}

/// Whether a position can be one.
pub(crate) fn is_sane(p: [f64; 3]) -> bool {
    p.iter().all(|c| c.abs() <= ABSURD_M)
}

impl SceneBuilder {
    pub(crate) fn new(triangles: TriangleStore) -> Self {
        Self { drafts: Vec::new(), triangles, paints: Vec::new(), by_look: HashMap::new() }
    }

    /// The index of the material that looks so.
    pub(crate) fn material(&mut self, rgb: [u8; 3], picture: Option<u32>) -> u32 {
        let paint = StoredMaterial { rgb, picture };
        let next = self.paints.len() as u32;
        let index = *self.by_look.entry(paint).or_insert(next);
        if index == next {
            self.paints.push(paint);
        }
        index
    }

    /// Adds one object and counts it. Every corner must be sane; an object without faces is not added.
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
        let object = self.drafts.len() as u32;
        let (mut min, mut max) = ([0.0f32; 3], [0.0f32; 3]);
        for face in faces {
            let face = if kind == ObjectKind::Terrain { upward(face) } else { *face };
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
        self.drafts.push(PendingObject { id: id.to_owned(), kind, source, anchor, min, max, triangles });
        report.objects += 1;
        report.triangles += triangles;
        if kind == ObjectKind::Terrain {
            report.terrain_triangles += triangles;
        }
    }

    /// The city. Its origin is a whole metre: the middle of the bounds in x and y, their bottom in z. So the corners
    /// of a city of 16 km are exact to half a millimetre. `sources` are corrected for the strays that are left out.
    pub(crate) fn finish(self, pictures: TextureStore, sources: &mut [SourceReport]) -> ScratchScene {
        let strays = self.strays();
        let kept = || self.drafts.iter().zip(&strays).filter(|(_, stray)| stray.is_none()).map(|(draft, _)| draft);
        let low: [f64; 3] = std::array::from_fn(|axis| kept().map(|draft| draft.low(axis)).fold(f64::MAX, f64::min));
        let high: [f64; 3] = std::array::from_fn(|axis| kept().map(|draft| draft.high(axis)).fold(f64::MIN, f64::max));
        let mut city = ScratchScene {
            origin: [0.0; 3],
            crs: None,
            bounds: None,
            objects: Vec::with_capacity(self.drafts.len()),
            paints: self.paints,
            pictures,
            triangles: 0,
            names: Vec::new(),
            placings: Vec::with_capacity(self.drafts.len()),
            stored: self.triangles,
        };
        if low[0] > high[0] {
            return city;
        }
        city.origin = [((low[0] + high[0]) / 2.0).floor(), ((low[1] + high[1]) / 2.0).floor(), low[2].floor()];
        let in_memory = matches!(city.stored, TriangleStore::Memory(_));
        let (mut min, mut max) = ([f64::MAX; 3], [f64::MIN; 3]);
        for (draft, stray) in self.drafts.into_iter().zip(strays) {
            let offset_m: [f64; 3] = std::array::from_fn(|axis| draft.anchor[axis] - city.origin[axis]);
            if let Some(distance_m) = stray {
                take_out(&draft, distance_m, &mut sources[draft.source]);
                city.placings.push(ObjectPlacement { offset_m, object: None });
                continue;
            }
            // Rounded as the corners will be: the bounds are exactly theirs.
            let placed = |v: f32, axis: usize| (f64::from(v) + offset_m[axis]) as f32;
            for axis in 0..3 {
                min[axis] = min[axis].min(placed(draft.min[axis], axis).into());
                max[axis] = max[axis].max(placed(draft.max[axis], axis).into());
            }
            city.placings.push(ObjectPlacement { offset_m, object: Some(city.objects.len() as u32) });
            city.objects.push(StoredObject { kind: draft.kind, base_z_m: placed(draft.min[2], 2) });
            city.triangles += draft.triangles;
            if in_memory {
                city.names.push(draft.id);
            }
        }
        city.bounds = Some([min, max]);
        city
    }

    /// Per object: how far it lies from the middle object if that is too far.
    fn strays(&self) -> Vec<Option<f64>> {
        let middle: [f64; 3] = std::array::from_fn(|axis| {
            let mut values: Vec<f64> = self.drafts.iter().map(|draft| draft.anchor[axis]).collect();
            let half = values.len() / 2;
            if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
        });
        let distance = |draft: &PendingObject| {
            (0..3).map(|axis| (draft.high(axis) - middle[axis]).max(middle[axis] - draft.low(axis))).fold(0.0, f64::max)
        };
        self.drafts.iter().map(|draft| Some(distance(draft)).filter(|&distance_m| distance_m > STRAY_M)).collect()
    }
}

/// Terrain is one-sided: a triangle that faces down was written the wrong way round.
fn upward(face: &WorldTriangle) -> WorldTriangle {
    let [a, b, c] = face.corners;
    let z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if z >= 0.0 {
        return *face;
    }
    WorldTriangle { corners: [a, c, b], uv: [face.uv[0], face.uv[2], face.uv[1]], material: face.material }
}

fn take_out(draft: &PendingObject, distance_m: f64, report: &mut SourceReport) {
    report.objects -= 1;
    report.triangles -= draft.triangles;
    if draft.kind == ObjectKind::Terrain {
        report.terrain_triangles -= draft.triangles;
    }
    report.skip("far from the city", || format!("{}: {:.0} km away", draft.id, distance_m / 1000.0));
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
    fn corners_survive_large_coordinates_to_less_than_a_millimetre() {
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
    fn strays_are_taken_out_and_reported() {
        let (mut builder, mut sources) = (builder(), report());
        for (id, x) in [("a", 500_000.0), ("stray", 0.0), ("b", 500_010.0)] {
            builder.add(0, id, ObjectKind::Terrain, &[face_at([x, 0.0, 0.0])], &mut sources[0]);
        }
        let scene = builder.finish(TextureStore::in_memory(), &mut sources).into_scene().unwrap();
        let ids: Vec<_> = scene.objects.iter().map(|object| object.id.as_str()).collect();
        assert_eq!(ids, ["a", "b"]);
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.triangles[1].object, 1);
        assert_eq!((sources[0].objects, sources[0].triangles, sources[0].terrain_triangles), (2, 2, 2));
        assert_eq!(sources[0].skipped["far from the city"].first, ["stray: 500 km away"]);
    }

    #[test]
    fn equal_looks_share_a_material_and_terrain_faces_up() {
        let (mut builder, mut sources) = (builder(), report());
        let mut pictures = TextureStore::in_memory();
        let picture = pictures.add(Arc::new(SceneTexture { width: 1, height: 1, rgb: vec![[1, 2, 3]] }));
        let plain = builder.material([9; 3], None);
        assert_ne!(plain, builder.material([9; 3], Some(picture)));
        assert_eq!(plain, builder.material([9; 3], None));
        let mut face = face_at([0.0; 3]);
        face.corners.swap(1, 2);
        builder.add(0, "t", ObjectKind::Terrain, &[face], &mut sources[0]);
        let scene = builder.finish(pictures, &mut sources).into_scene().unwrap();
        let [a, b, c] = scene.triangles[0].corners;
        assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0);
        assert_eq!(scene.materials.len(), 2);
    }
}
