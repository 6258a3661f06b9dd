//! Landmarks for programs that have no stones: colours of their vertices by stone and occlusion, and a material for each stone.

use super::document::PbrMetallicRoughness;
use glam::Vec3;
use insula_protocol::{Manifest, MeshTile};
use insula_shaders::cpu::stone::stone_surface;
use insula_shaders::stone::{Stone, StoneParameters};

/// Shares of the sky from here on count as open: upright surfaces see half of it.
const OPEN_SHARE: f32 = 0.5;

/// Distance of the vertices of a scan, in steps of its grid, about.
const SPACING_STEPS: f32 = 8.0;

/// Stones that reflect more from straight ahead are metals (glTF 2.0, section 3.9.2).
const METAL_F0: f32 = 0.2;

pub(crate) struct Stones(Vec<Option<Stone>>);

impl Stones {
    /// Those of a manifest. One that this version does not know leaves its landmarks in the colour of their triangles.
    pub(crate) fn new(manifest: &Manifest) -> Self {
        let stone = |text: &String| serde_json::from_str::<StoneParameters>(text).ok()?.stone().ok();
        Self(manifest.stones.iter().map(stone).collect())
    }

    /// The stone of an object of a tile, as a number of the manifest; `None` without one that this version knows.
    pub(crate) fn of_object(&self, tile: &MeshTile, object: u32) -> Option<u8> {
        let landmark = tile.landmarks.iter().find(|landmark| landmark.object == object)?;
        landmark.stone.filter(|stone| self.get(*stone).is_some())
    }

    /// The material of a stone whose vertices have the colours of [`Self::colour`]; `None` if this version does not know it. Ward's
    /// roughness is that of slopes, glTF's is its root.
    pub(crate) fn material(&self, stone: u8) -> Option<PbrMetallicRoughness> {
        let stone = self.get(stone)?;
        let [along, across] = stone.alpha;
        Some(PbrMetallicRoughness {
            base_color_texture: None,
            metallic_factor: f32::from(u8::from(is_metal(stone))),
            roughness_factor: Some((along * across).sqrt().sqrt().min(1.0)),
        })
    }

    fn get(&self, stone: u8) -> Option<&Stone> {
        self.0.get(usize::from(stone))?.as_ref()
    }

    /// Linear colour of a corner of a tile without texture, 0 to 255. `linear` is that of its triangle, `p_m` its position in the
    /// tile's metres.
    pub(crate) fn colour(&self, tile: &MeshTile, corner: usize, p_m: [f64; 3], linear: [u8; 3]) -> [u8; 3] {
        let object = tile.objects.get(corner / 3);
        let Some(landmark) = tile.landmarks.iter().find(|landmark| Some(&landmark.object) == object) else {
            return linear;
        };
        let mut rgb = Vec3::from_array(linear.map(|v| f32::from(v) / 255.0));
        if let Some(stone) = landmark.stone.and_then(|stone| self.get(stone)) {
            let p = Vec3::from_array(p_m.map(|v| v as f32)) - Vec3::from_array(landmark.anchor_m);
            // Vertices are samples of the pattern: what is finer than the distance between them is their mean.
            let surface = stone_surface(stone, p, Vec3::X, 1.0, SPACING_STEPS * tile.mesh.grid.step as f32);
            // The colour of a metal is what it reflects.
            rgb = if is_metal(stone) { surface.albedo + surface.f0 } else { surface.matt_colour() };
        }
        let open = tile.occlusion(corner).map_or(1.0, |share| (share / OPEN_SHARE).min(1.0));
        (rgb * open).to_array().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
    }
}

fn is_metal(stone: &Stone) -> bool {
    Vec3::from(stone.f0).max_element() > METAL_F0
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::mesh::{Attribute, AttributeKind};
    use insula_protocol::mesh_tile::{self, LandmarkObject, OCCLUSION_BITS};

    #[test]
    fn stones_are_materials() {
        let stone = |text: &str| serde_json::from_str::<StoneParameters>(text).unwrap().stone().ok();
        let marble = stone(r#"{"preset":"carrara-marble","roughness":[0.09,0.09]}"#);
        let stones = Stones(vec![marble, None, stone(r#"{"preset":"bronze"}"#)]);
        let material = stones.material(0).unwrap();
        assert_eq!(material.metallic_factor, 0.0);
        assert!((material.roughness_factor.unwrap() - 0.3).abs() < 1e-6);
        assert_eq!(stones.material(2).unwrap().metallic_factor, 1.0);
        assert!(stones.material(1).is_none() && stones.material(3).is_none());
    }

    #[test]
    fn landmarks_have_their_stone_and_occlusion() {
        let mut tile = mesh_tile::cuboid([0.0; 3], [4.0; 3], [200, 90, 60], None);
        tile.objects = (0..12).map(|t| t / 6).collect();
        tile.landmarks = vec![LandmarkObject { object: 1, stone: Some(0), anchor_m: [0.0; 3] }];
        let red: StoneParameters = serde_json::from_str(r#"{"preset":"red-granite"}"#).unwrap();
        let stones = Stones(vec![red.stone().ok()]);
        let plain = [150, 30, 20];
        assert_eq!(stones.colour(&tile, 0, [1.0; 3], plain), plain, "another object");
        let open = stones.colour(&tile, 20, [1.0, 2.0, 3.0], plain);
        assert_ne!(open, plain);
        tile.mesh.attributes.push(Attribute {
            kind: AttributeKind::Other,
            components: 1,
            bits: OCCLUSION_BITS,
            range: [0.0, 1.0 / 31.0],
            values: vec![[4, 0, 0, 0]],
            corners: vec![0; 36],
        });
        let hidden = stones.colour(&tile, 20, [1.0, 2.0, 3.0], plain);
        assert!((0..3).all(|k| hidden[k] <= open[k]) && hidden[0] < open[0], "{open:?} {hidden:?}");
    }
}
