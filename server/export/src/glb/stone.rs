//! Colours of landmarks' vertices: their stone, and their occlusion. Other programs have neither.

use glam::Vec3;
use insula_protocol::{Manifest, MeshTile};
use insula_shaders::{
    cpu::stone::stone_surface,
    stone::{Stone, StoneParameters},
};

/// Shares of the sky from here on count as open: upright surfaces see half of it.
const OPEN_SHARE: f32 = 0.5;

/// Distance of the vertices of a scan, in steps of its grid, about.
const SPACING_STEPS: f32 = 8.0;

/// The stones of a city.
pub(crate) struct Stones(Vec<Option<Stone>>);

impl Stones {
    /// Those of a manifest. One that this version does not know leaves its landmarks in the colour of their triangles.
    pub(crate) fn new(manifest: &Manifest) -> Self {
        let stone = |text: &String| serde_json::from_str::<StoneParameters>(text).ok()?.stone().ok();
        Self(manifest.stones.iter().map(stone).collect())
    }

    /// Linear colour of a corner of a tile without texture, 0 to 255. `linear` is that of its triangle, `p_m` its position in the
    /// tile's metres.
    pub(crate) fn colour(&self, tile: &MeshTile, corner: usize, p_m: [f64; 3], linear: [u8; 3]) -> [u8; 3] {
        let object = tile.objects.get(corner / 3);
        let Some(landmark) = tile.landmarks.iter().find(|landmark| Some(&landmark.object) == object) else {
            return linear;
        };
        let mut rgb = Vec3::from_array(linear.map(|v| f32::from(v) / 255.0));
        if let Some(stone) = landmark.stone.and_then(|stone| self.0.get(usize::from(stone)).copied().flatten()) {
            let p = Vec3::from_array(p_m.map(|v| v as f32)) - Vec3::from_array(landmark.anchor_m);
            // Vertices are samples of the pattern: what is finer than the distance between them is their mean.
            rgb = stone_surface(&stone, p, Vec3::X, 1.0, SPACING_STEPS * tile.mesh.grid.step as f32).matt_colour();
        }
        let open = tile.occlusion(corner).map_or(1.0, |share| (share / OPEN_SHARE).min(1.0));
        (rgb * open).to_array().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{
        mesh::{Attribute, AttributeKind},
        mesh_tile::{self, LandmarkObject, OCCLUSION_BITS},
    };

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
