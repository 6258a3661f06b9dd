//! What must be known of a scene before it is baked.
//!
//! In: the scene. Out: that it is sound, its bounds, its hash. Next: the grid, and the decision whether to resume.

use std::{collections::HashMap, sync::Arc};

use crate::{
    config::short_hex,
    error::BakeError,
    scene::{ObjectKind, Scene},
};

/// Bounds of all corners in the scene's coordinates, `[min, max]`; checks on the way what readers promise.
pub(super) fn bounds(scene: &Scene, cell_m: f64) -> Result<[[f64; 3]; 2], BakeError> {
    if scene.triangles.is_empty() {
        return Err(BakeError::Empty { triangles: 0, cell_m });
    }
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (triangle, t) in scene.triangles.iter().enumerate() {
        let wrong = |what| Err(BakeError::Scene { triangle, what });
        if t.material as usize >= scene.materials.len() || t.object as usize >= scene.objects.len() {
            return wrong("its material or object does not exist");
        }
        if !t.corners.iter().flatten().chain(t.uv.iter().flatten()).all(|v| v.is_finite()) {
            return wrong("a coordinate is not finite");
        }
        for corner in t.corners {
            for axis in 0..3 {
                min[axis] = min[axis].min(f64::from(corner[axis]));
                max[axis] = max[axis].max(f64::from(corner[axis]));
            }
        }
    }
    Ok([min, max])
}

/// Hash of all that decides how the scene looks; identifiers and the coordinate system's name do not.
pub(super) fn hash(scene: &Scene) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut words = |words: &[u32]| {
        for word in words {
            hasher.update(&word.to_le_bytes());
        }
    };
    words(&[scene.triangles.len() as u32, scene.objects.len() as u32, scene.materials.len() as u32]);
    for axis in scene.origin {
        words(&[axis.to_bits() as u32, (axis.to_bits() >> 32) as u32]);
    }
    for object in &scene.objects {
        words(&[u32::from(object.kind == ObjectKind::Terrain), object.base_z_m.to_bits()]);
    }
    for t in &scene.triangles {
        let mut bytes = [0u8; 68];
        let floats = t.corners.iter().flatten().chain(t.uv.iter().flatten()).map(|v| v.to_bits());
        for (slot, word) in bytes.chunks_exact_mut(4).zip(floats.chain([t.material, t.object])) {
            slot.copy_from_slice(&word.to_le_bytes());
        }
        hasher.update(&bytes);
    }
    hash_materials(scene, &mut hasher);
    short_hex(&hasher.finalize())
}

/// A picture that many materials share is hashed once, then named by its place.
fn hash_materials(scene: &Scene, hasher: &mut blake3::Hasher) {
    let mut seen = HashMap::new();
    for material in &scene.materials {
        hasher.update(&material.rgb);
        let Some(texture) = &material.texture else {
            hasher.update(&u32::MAX.to_le_bytes());
            continue;
        };
        let next = seen.len() as u32;
        let place = *seen.entry(Arc::as_ptr(texture)).or_insert(next);
        hasher.update(&place.to_le_bytes());
        if place == next {
            hasher.update(&texture.width.to_le_bytes());
            hasher.update(&texture.height.to_le_bytes());
            hasher.update(texture.rgb.as_flattened());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Object, Texture, Triangle};

    fn scene() -> Scene {
        let texture = Arc::new(Texture { width: 1, height: 1, rgb: vec![[1, 2, 3]] });
        let material = Material { rgb: [9, 8, 7], texture: Some(texture) };
        let corners = [[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [0.0, -3.0, 2.0]];
        Scene {
            triangles: vec![Triangle { corners, uv: [[0.0; 2]; 3], material: 1, object: 0 }],
            objects: vec![Object { id: "a".into(), kind: ObjectKind::Building, base_z_m: 1.0 }],
            materials: vec![material.clone(), material],
            ..Scene::default()
        }
    }

    #[test]
    fn a_sound_scene_has_bounds_and_an_unsound_one_an_error() {
        assert_eq!(bounds(&scene(), 1.0).unwrap(), [[0.0, -3.0, 1.0], [5.0, 0.0, 2.0]]);
        assert!(matches!(bounds(&Scene::default(), 1.0), Err(BakeError::Empty { .. })));
        let wrong: [fn(&mut Triangle); 4] =
            [|t| t.material = 2, |t| t.object = 1, |t| t.corners[1][2] = f32::NAN, |t| t.uv[2][0] = f32::INFINITY];
        for spoil in wrong {
            let mut scene = scene();
            spoil(&mut scene.triangles[0]);
            assert!(matches!(bounds(&scene, 1.0), Err(BakeError::Scene { triangle: 0, .. })));
        }
    }

    #[test]
    fn the_hash_sees_looks_and_only_looks() {
        let base = hash(&scene());
        assert_eq!(hash(&scene()), base);
        let changes: [fn(&mut Scene); 6] = [
            |s| s.triangles[0].corners[0][0] = 0.5,
            |s| s.triangles[0].uv[1][1] = 0.5,
            |s| s.materials[0].rgb = [0; 3],
            |s| s.materials[1].texture = None,
            |s| s.objects[0].kind = ObjectKind::Terrain,
            |s| s.origin[2] = 1.0,
        ];
        for change in changes {
            let mut scene = scene();
            change(&mut scene);
            assert_ne!(hash(&scene), base);
        }
        let mut renamed = scene();
        renamed.objects[0].id = "b".into();
        assert_eq!(hash(&renamed), base);
        // The same pictures in two places of memory are another order of places, which is no other city.
        let mut apart = scene();
        let copy = apart.materials[1].texture.as_deref().cloned().map(Arc::new);
        apart.materials[1].texture = copy;
        assert_ne!(hash(&apart), base, "a copy costs a bake anew, never a wrong resume");
    }
}
