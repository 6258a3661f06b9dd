//! Objects to a scene: materials shared, the origin chosen, stray objects removed.
//!
//! In: faces of one object at a time, in f64. Out: [`Scene`]. Next: `partition`.

use std::collections::HashMap;
use std::sync::Arc;

use super::report::SourceReport;
use crate::scene::{Material, Object, ObjectKind, Scene, Texture, Triangle};

/// Coordinates beyond this are no place on Earth in metres of any projected system.
pub(crate) const ABSURD_M: f64 = 1e9;
/// An object this far from the city's middle is a stray: it would take the whole city's precision.
const STRAY_M: f64 = 200_000.0;

/// A triangle before the origin is known.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Face {
    /// World positions.
    pub(crate) corners: [[f64; 3]; 3],
    /// v up.
    pub(crate) uv: [[f32; 2]; 3],
    /// From [`SceneBuilder::material`].
    pub(crate) material: u32,
}

struct Draft {
    id: String,
    kind: ObjectKind,
    source: usize,
    /// The triangles' corners are kept relative to this, so that f32 is exact enough before the origin is known.
    anchor: [f64; 3],
    min: [f64; 3],
    max: [f64; 3],
    triangles: usize,
}

/// Collects a scene.
#[derive(Default)]
pub(crate) struct SceneBuilder {
    drafts: Vec<Draft>,
    triangles: Vec<Triangle>,
    materials: Vec<Material>,
    by_look: HashMap<([u8; 3], usize), u32>,
}

/// Whether a position can be one.
pub(crate) fn is_sane(p: [f64; 3]) -> bool {
    p.iter().all(|c| c.abs() <= ABSURD_M)
}

impl SceneBuilder {
    /// The index of the material that looks so.
    pub(crate) fn material(&mut self, rgb: [u8; 3], texture: Option<&Arc<Texture>>) -> u32 {
        // The scene's materials keep the texture alive, so its address names it.
        let key = (rgb, texture.map_or(0, |texture| Arc::as_ptr(texture) as usize));
        let next = self.materials.len() as u32;
        let index = *self.by_look.entry(key).or_insert(next);
        if index == next {
            self.materials.push(Material { rgb, texture: texture.cloned() });
        }
        index
    }

    /// Adds one object and counts it. Every corner must be sane; an object without faces is not added.
    pub(crate) fn add(&mut self, source: usize, id: &str, kind: ObjectKind, faces: &[Face], report: &mut SourceReport) {
        let Some(first) = faces.first() else { return };
        let anchor = first.corners[0];
        let (mut min, mut max) = (anchor, anchor);
        self.triangles.reserve(faces.len());
        for face in faces {
            for corner in &face.corners {
                for axis in 0..3 {
                    min[axis] = min[axis].min(corner[axis]);
                    max[axis] = max[axis].max(corner[axis]);
                }
            }
            let face = if kind == ObjectKind::Terrain { upward(face) } else { *face };
            let corners = face.corners.map(|corner| std::array::from_fn(|axis| (corner[axis] - anchor[axis]) as f32));
            self.triangles.push(Triangle { corners, uv: face.uv, material: face.material, object: 0 });
        }
        self.drafts.push(Draft { id: id.to_owned(), kind, source, anchor, min, max, triangles: faces.len() });
        report.objects += 1;
        report.triangles += faces.len() as u64;
        if kind == ObjectKind::Terrain {
            report.terrain_triangles += faces.len() as u64;
        }
    }

    /// The scene. Its origin is a whole metre: the middle of the bounds in x and y, their bottom in z. So the corners
    /// of a city of 16 km are exact to half a millimetre. `sources` are corrected for the strays that are taken out.
    pub(crate) fn finish(mut self, sources: &mut [SourceReport]) -> Scene {
        let strays = self.strays();
        let kept = || self.drafts.iter().zip(&strays).filter(|(_, stray)| stray.is_none()).map(|(draft, _)| draft);
        let low: [f64; 3] = std::array::from_fn(|axis| kept().map(|draft| draft.min[axis]).fold(f64::MAX, f64::min));
        let high: [f64; 3] = std::array::from_fn(|axis| kept().map(|draft| draft.max[axis]).fold(f64::MIN, f64::max));
        let mut scene = Scene { materials: self.materials, ..Scene::default() };
        if low[0] <= high[0] {
            scene.origin = [((low[0] + high[0]) / 2.0).floor(), ((low[1] + high[1]) / 2.0).floor(), low[2].floor()];
        }
        let (mut read, mut written) = (0, 0);
        for (draft, stray) in self.drafts.into_iter().zip(strays) {
            let range = read..read + draft.triangles;
            read = range.end;
            if let Some(distance_m) = stray {
                take_out(&draft, distance_m, &mut sources[draft.source]);
                continue;
            }
            let mut base_z_m = f32::INFINITY;
            for i in range {
                let mut triangle = self.triangles[i];
                triangle.object = scene.objects.len() as u32;
                for corner in &mut triangle.corners {
                    for axis in 0..3 {
                        corner[axis] = (f64::from(corner[axis]) + (draft.anchor[axis] - scene.origin[axis])) as f32;
                    }
                    base_z_m = base_z_m.min(corner[2]);
                }
                // In place: what is written never overtakes what is read.
                self.triangles[written] = triangle;
                written += 1;
            }
            scene.objects.push(Object { id: draft.id, kind: draft.kind, base_z_m });
        }
        self.triangles.truncate(written);
        scene.triangles = self.triangles;
        scene
    }

    /// Per object: how far it lies from the middle object if that is too far.
    fn strays(&self) -> Vec<Option<f64>> {
        let middle: [f64; 3] = std::array::from_fn(|axis| {
            let mut values: Vec<f64> = self.drafts.iter().map(|draft| draft.anchor[axis]).collect();
            let half = values.len() / 2;
            if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
        });
        let distance = |draft: &Draft| {
            (0..3).map(|axis| (draft.max[axis] - middle[axis]).max(middle[axis] - draft.min[axis])).fold(0.0, f64::max)
        };
        self.drafts.iter().map(|draft| Some(distance(draft)).filter(|&distance_m| distance_m > STRAY_M)).collect()
    }
}

/// Terrain is one-sided: a triangle that faces down was written the wrong way round.
fn upward(face: &Face) -> Face {
    let [a, b, c] = face.corners;
    let z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if z >= 0.0 {
        return *face;
    }
    Face { corners: [a, c, b], uv: [face.uv[0], face.uv[2], face.uv[1]], material: face.material }
}

fn take_out(draft: &Draft, distance_m: f64, report: &mut SourceReport) {
    report.objects -= 1;
    report.triangles -= draft.triangles as u64;
    if draft.kind == ObjectKind::Terrain {
        report.terrain_triangles -= draft.triangles as u64;
    }
    report.skip("far from the city", || format!("{}: {:.0} km away", draft.id, distance_m / 1000.0));
}

#[cfg(test)]
mod tests {
    use super::super::report::Format;
    use super::*;

    fn face_at(p: [f64; 3]) -> Face {
        let corners = [p, [p[0] + 1.0, p[1], p[2]], [p[0], p[1] + 1.0, p[2] + 2.0]];
        Face { corners, uv: [[0.0; 2]; 3], material: 0 }
    }

    fn report() -> Vec<SourceReport> {
        vec![SourceReport::new("a", Format::Obj, 0)]
    }

    #[test]
    fn corners_survive_large_coordinates_to_less_than_a_millimetre() {
        let (mut builder, mut sources) = (SceneBuilder::default(), report());
        let places = [[6_240_000.123, 457_604.591, 2.463], [6_256_000.789, 457_604.501, 37.481]];
        for place in places {
            builder.add(0, "a", ObjectKind::Building, &[face_at(place)], &mut sources[0]);
        }
        let scene = builder.finish(&mut sources);
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
        let (mut builder, mut sources) = (SceneBuilder::default(), report());
        for (id, x) in [("a", 500_000.0), ("stray", 0.0), ("b", 500_010.0)] {
            builder.add(0, id, ObjectKind::Terrain, &[face_at([x, 0.0, 0.0])], &mut sources[0]);
        }
        let scene = builder.finish(&mut sources);
        let ids: Vec<_> = scene.objects.iter().map(|object| object.id.as_str()).collect();
        assert_eq!(ids, ["a", "b"]);
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.triangles[1].object, 1);
        assert_eq!((sources[0].objects, sources[0].triangles, sources[0].terrain_triangles), (2, 2, 2));
        assert_eq!(sources[0].skipped["far from the city"].first, ["stray: 500 km away"]);
    }

    #[test]
    fn equal_looks_share_a_material_and_terrain_faces_up() {
        let (mut builder, mut sources) = (SceneBuilder::default(), report());
        let texture = Arc::new(Texture { width: 1, height: 1, rgb: vec![[1, 2, 3]] });
        let plain = builder.material([9; 3], None);
        assert_ne!(plain, builder.material([9; 3], Some(&texture)));
        assert_eq!(plain, builder.material([9; 3], None));
        let mut face = face_at([0.0; 3]);
        face.corners.swap(1, 2);
        builder.add(0, "t", ObjectKind::Terrain, &[face], &mut sources[0]);
        let scene = builder.finish(&mut sources);
        let [a, b, c] = scene.triangles[0].corners;
        assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0);
        assert_eq!(scene.materials.len(), 2);
    }
}
