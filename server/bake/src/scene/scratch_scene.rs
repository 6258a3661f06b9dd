//! A city between reading and partition: materials in memory; triangles, textures and objects in scratch files.
//!
//! A city that is read with [`crate::read::read`], or passed in as a [`Scene`], keeps all of them in memory.

use crate::error::BakeError;
use crate::scene::object_facts::BlockObjectFacts;
use crate::scene::object_records::{ObjectRecords, RecordPlace, SourceRecord};
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;
use crate::scene::{Landmark, Material, ObjectKind, Scene, SceneObject, SceneTexture, SceneTriangle};
use insula_objects::FeatureKind;
use insula_scratch::record_list::RecordList;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Longer identifiers are cut in messages.
const MAX_CHARS: usize = 80;

/// Colour of triangles, with the texture by number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(crate) struct StoredMaterial {
    /// 8-bit sRGB.
    pub(crate) rgb: [u8; 3],
    /// Number in [`ScratchScene::textures`].
    pub(crate) texture: Option<u32>,
    /// Whether it is water or glass.
    pub(crate) is_reflective: bool,
}

impl StoredMaterial {
    /// A material that is neither water nor glass.
    pub(crate) fn matt(rgb: [u8; 3], texture: Option<u32>) -> Self {
        Self { rgb, texture, is_reflective: false }
    }
}

/// A [`SceneObject`] without its identifier.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredObject {
    pub(crate) kind: ObjectKind,
    pub(crate) base_z_m: f32,
    /// Lowest and highest corner relative to the origin.
    pub(crate) bounds_m: [[f32; 3]; 2],
    /// `None` for generated ground.
    pub(crate) identity: Option<ObjectIdentity>,
}

/// By what an object is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ObjectIdentity {
    /// What the source says of it.
    pub(crate) record: RecordPlace,
    /// Index of its source.
    pub(crate) source: u32,
    /// Hash of the source's identifier.
    pub(crate) id_hash: u64,
    /// That of its parent.
    pub(crate) parent_hash: Option<u64>,
}

/// Position and number of an object whose triangles are stored relative to an anchor of their own.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct ObjectPlacement {
    /// From the scene's origin to the anchor.
    pub(crate) offset_m: [f64; 3],
    /// Index into [`ScratchScene::objects`]; `None` for an object that is left out.
    pub(crate) object: Option<u32>,
}

/// A city that was read.
#[derive(Debug)]
pub(crate) struct ScratchScene {
    /// As in [`Scene`].
    pub(crate) origin: [f64; 3],
    /// As in [`Scene`].
    pub(crate) crs: Option<String>,
    /// Minimum and maximum of all corners, relative to the origin; `None` without triangles.
    pub(crate) bounds: Option<[[f64; 3]; 2]>,
    pub(crate) objects: RecordList<StoredObject>,
    /// What blocks need to know of the objects; empty until these are numbered.
    pub(crate) object_facts: RecordList<BlockObjectFacts>,
    /// As in [`Scene`].
    pub(crate) landmarks: Vec<Landmark>,
    /// Objects of landmarks that stand on the ground, which may be generated.
    pub(crate) standing: Vec<u32>,
    /// Objects without a shape of which others may be parts.
    pub(crate) parents: RecordList<ObjectIdentity>,
    pub(crate) records: ObjectRecords,
    pub(crate) materials: Vec<StoredMaterial>,
    pub(crate) textures: TextureStore,
    /// Number of triangles.
    pub(crate) triangles: u64,
    /// Identifiers of the objects, for reports and messages.
    pub(crate) names: RecordList<String>,
    /// By the object number of the stored triangles; empty if the triangles are relative to the origin already.
    pub(crate) placements: RecordList<ObjectPlacement>,
    pub(crate) stored: TriangleStore,
}

impl ScratchScene {
    /// Calls `visit` for every triangle in order, with corners relative to the origin and indices into `materials` and
    /// `objects`. Fails if the triangles cannot be read, or with the first error of `visit`.
    pub(crate) fn try_for_each(
        &self,
        mut visit: impl FnMut(&SceneTriangle) -> Result<(), BakeError>,
    ) -> Result<(), BakeError> {
        self.try_for_each_exact(|triangle, _| visit(triangle))
    }

    /// As [`Self::try_for_each`], with the corners also as they are before they are rounded: relative to the origin, too.
    pub(crate) fn try_for_each_exact(
        &self,
        mut visit: impl FnMut(&SceneTriangle, &[[f64; 3]; 3]) -> Result<(), BakeError>,
    ) -> Result<(), BakeError> {
        let (has_placements, mut placements) = (!self.placements.is_empty(), self.placements.cursor());
        self.stored.try_for_each(|mut triangle| {
            let mut exact = triangle.corners.map(|corner| corner.map(f64::from));
            if has_placements {
                let ObjectPlacement { offset_m, object } = *placements.get(triangle.object as usize)?;
                let Some(object) = object else { return Ok(()) };
                triangle.object = object;
                for (corner, rounded) in exact.iter_mut().zip(&mut triangle.corners) {
                    *corner = std::array::from_fn(|axis| corner[axis] + offset_m[axis]);
                    *rounded = corner.map(|v| v as f32);
                }
            }
            visit(&triangle, &exact)
        })
    }

    /// Keeps for blocks what they need to know of the objects, which have these numbers. Fails if a list cannot be read.
    pub(crate) fn keep_object_facts(&mut self, numbers: &RecordList<u32>) -> Result<(), BakeError> {
        let mut facts = RecordList::new(&self.objects.scratch());
        let mut numbers = numbers.cursor();
        self.objects.try_for_each(|i, object| {
            let StoredObject { kind, base_z_m, .. } = *object;
            facts.push(BlockObjectFacts { kind, base_z_m, number: *numbers.get(i)? });
            Ok::<_, BakeError>(())
        })?;
        self.object_facts = facts;
        Ok(())
    }

    /// An object's identifier on one line, for a message, else its number.
    pub(crate) fn describe(&self, object: u32) -> String {
        let id = self.names.get(object as usize).unwrap_or_default();
        let line: String = id.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MAX_CHARS).collect();
        if line.is_empty() { format!("number {object}") } else { line }
    }

    /// Frees the triangles, whose copies in the partition's buckets are used from then on.
    pub(crate) fn drop_triangles(&mut self) {
        self.placements = RecordList::default();
        if let TriangleStore::File(file) = std::mem::replace(&mut self.stored, TriangleStore::Memory(Vec::new())) {
            file.remove();
        }
    }

    /// The whole city in memory. Fails if triangles or textures cannot be read.
    pub(crate) fn into_scene(self) -> Result<Scene, BakeError> {
        let mut triangles = Vec::with_capacity(self.triangles as usize);
        self.try_for_each(|triangle| {
            triangles.push(*triangle);
            Ok(())
        })?;
        let objects = self.objects.in_memory().iter().zip(self.names.in_memory());
        let objects =
            objects.map(|(object, id)| SceneObject { id: id.clone(), kind: object.kind, base_z_m: object.base_z_m });
        let materials = self.materials.iter().map(|material| self.load_material(*material));
        let materials = materials.collect::<Result<_, _>>()?;
        let objects = objects.collect();
        let (origin, crs, landmarks) = (self.origin, self.crs, self.landmarks);
        Ok(Scene { origin, triangles, objects, materials, crs, landmarks, numbers: Vec::new() })
    }

    /// The material with its texture. Fails if the texture cannot be read.
    pub(crate) fn load_material(&self, material: StoredMaterial) -> Result<Material, BakeError> {
        let texture = material.texture.map(|number| self.textures.get(number)).transpose()?;
        Ok(Material { rgb: material.rgb, texture, is_reflective: material.is_reflective })
    }

    /// Fails if a triangle has an index out of range or a coordinate that is not finite. Readers never make such
    /// triangles.
    pub(crate) fn from_scene(scene: Scene) -> Result<Self, BakeError> {
        let bounds = checked_bounds(&scene)?;
        let (objects, records) = identified_objects(&scene);
        let mut textures = TextureStore::in_memory();
        let mut known: Vec<Arc<SceneTexture>> = Vec::new();
        let mut number_of = |texture: Arc<SceneTexture>| {
            let number = known.iter().position(|other| Arc::ptr_eq(other, &texture));
            number.map_or_else(
                || {
                    known.push(Arc::clone(&texture));
                    textures.add(texture)
                },
                |number| number as u32,
            )
        };
        let stored = |m: Material| StoredMaterial {
            rgb: m.rgb,
            texture: m.texture.map(&mut number_of),
            is_reflective: m.is_reflective,
        };
        let materials = scene.materials.into_iter().map(stored).collect();
        let names = scene.objects.iter().map(|object| object.id.clone()).collect::<Vec<String>>().into();
        Ok(Self {
            origin: scene.origin,
            crs: scene.crs,
            bounds,
            objects: objects.into(),
            object_facts: RecordList::default(),
            landmarks: scene.landmarks,
            standing: Vec::new(),
            parents: RecordList::default(),
            records,
            materials,
            textures,
            triangles: scene.triangles.len() as u64,
            names,
            placements: RecordList::default(),
            stored: TriangleStore::Memory(scene.triangles),
        })
    }
}

/// The objects of a scene with their identifiers, which are all that is known of them.
fn identified_objects(scene: &Scene) -> (Vec<StoredObject>, ObjectRecords) {
    let mut records = ObjectRecords::Memory(Vec::new());
    let mut bounds_m = vec![[[f32::MAX; 3], [f32::MIN; 3]]; scene.objects.len()];
    for triangle in &scene.triangles {
        let [low, high] = &mut bounds_m[triangle.object as usize];
        for corner in triangle.corners {
            *low = std::array::from_fn(|axis| low[axis].min(corner[axis]));
            *high = std::array::from_fn(|axis| high[axis].max(corner[axis]));
        }
    }
    let stored = scene.objects.iter().zip(bounds_m).map(|(object, bounds_m)| {
        let kind = match object.kind {
            ObjectKind::Building => FeatureKind::Building,
            ObjectKind::Terrain => FeatureKind::Relief,
            ObjectKind::GeneratedGround => FeatureKind::Generic,
        };
        let record = SourceRecord { identifier: object.id.clone(), kind, attributes: Vec::new() };
        let id_hash = hash_of_id(&object.id);
        let identity = (object.kind != ObjectKind::GeneratedGround).then(|| ObjectIdentity {
            record: records.push(record),
            source: 0,
            id_hash,
            parent_hash: None,
        });
        StoredObject { kind: object.kind, base_z_m: object.base_z_m, bounds_m, identity }
    });
    (stored.collect(), records)
}

/// Number by which identifiers are compared. Two different ones have the same number once in 10^10 cities.
pub(crate) fn hash_of_id(id: &str) -> u64 {
    let hash = blake3::hash(id.as_bytes());
    u64::from_le_bytes(std::array::from_fn(|i| hash.as_bytes()[i]))
}

fn checked_bounds(scene: &Scene) -> Result<Option<[[f64; 3]; 2]>, BakeError> {
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (triangle, t) in scene.triangles.iter().enumerate() {
        let invalid = |what| Err(BakeError::Scene { triangle, what });
        if t.material as usize >= scene.materials.len() || t.object as usize >= scene.objects.len() {
            return invalid("its material or object does not exist");
        }
        if !t.corners.iter().flatten().chain(t.uv.iter().flatten()).all(|v| v.is_finite()) {
            return invalid("a coordinate is not finite");
        }
        for corner in t.corners {
            for axis in 0..3 {
                min[axis] = min[axis].min(f64::from(corner[axis]));
                max[axis] = max[axis].max(f64::from(corner[axis]));
            }
        }
    }
    Ok((!scene.triangles.is_empty()).then_some([min, max]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_scene_has_bounds_and_names_and_an_invalid_one_is_an_error() {
        let corners = [[2.0, 0.5, -1.0], [5.0, 0.0, 1.0], [0.0, -3.0, f32::MIN_POSITIVE]];
        let scene = || Scene {
            triangles: vec![SceneTriangle {
                corners,
                uv: [[0.25, 2.0], [1.0, 0.0], [-7.5, 2.0]],
                material: 0,
                object: 0,
            }],
            objects: vec![SceneObject { id: "a".into(), kind: ObjectKind::Building, base_z_m: -1.0 }],
            materials: vec![Material { rgb: [9, 8, 7], texture: None, is_reflective: false }],
            ..Scene::default()
        };
        let city = ScratchScene::from_scene(scene()).unwrap();
        assert_eq!(city.bounds, Some([[0.0, -3.0, -1.0], [5.0, 0.5, 1.0]]));
        assert_eq!(ScratchScene::from_scene(Scene::default()).unwrap().bounds, None);
        let named = ScratchScene { names: ["a", "two\nlines", ""].map(str::to_owned).to_vec().into(), ..city };
        assert_eq!([0, 1, 2, 3].map(|i| named.describe(i)), ["a", "two lines", "number 2", "number 3"]);
        let make_invalid: [fn(&mut SceneTriangle); 4] =
            [|t| t.material = 1, |t| t.object = 1, |t| t.corners[1][2] = f32::NAN, |t| t.uv[2][0] = f32::INFINITY];
        for make_invalid in make_invalid {
            let mut scene = scene();
            make_invalid(&mut scene.triangles[0]);
            assert!(matches!(ScratchScene::from_scene(scene), Err(BakeError::Scene { triangle: 0, .. })));
        }
    }
}
