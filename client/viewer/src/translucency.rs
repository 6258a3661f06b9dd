//! Which landmarks of a frame have translucency maps.
//!
//! The meshes of a draw list decide which maps are in the frame's uniform, each with a key of what it shows. The ray-casters make a
//! map when its key changes, and keep it while the sun and the meshes around the landmark stay.

use crate::camera::View;
use glam::{DVec2, DVec3};
use insula_protocol::TileId;
use insula_shaders::layout::{FrameUniform, PAGE_WORDS, Shading};
use insula_shaders::mesh::LandmarkBounds;
use insula_shaders::stone::Stone;
use insula_shaders::translucency::{
    FAST_TAPS, FINE_TAPS, MAP_WORDS, MAX_MAP_PX, MAX_MAPS, MIN_MAP_PX, MapPlace, TranslucencyMap,
};
use std::collections::BTreeMap;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};

/// Pages that an atlas has for translucency maps, behind those of the cache.
pub const MAP_PAGES: u32 = MAX_MAPS as u32 * MAP_WORDS / PAGE_WORDS as u32;
/// Light that goes less far than this many pixels is not seen to go through a stone.
const MIN_REACH_PX: f64 = 0.7;
/// Nodes within this distance of a landmark may shadow it.
const SHADOW_M: f64 = 200.0;
/// Anchors of one landmark in several tiles differ by rounding only.
const ANCHORS_PER_M: f64 = 64.0;

/// How much light that comes through stones is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Translucency {
    Off,
    /// Maps of 256 texels a side and 9 taps.
    Fast,
    /// Maps of 512 texels a side, and 21 taps in frames of several rays a pixel.
    #[default]
    Fine,
}

impl Translucency {
    /// All, with their words on command lines.
    pub const ALL: [(&str, Self); 3] = [("off", Self::Off), ("fast", Self::Fast), ("fine", Self::Fine)];

    /// Width of maps, and taps in frames of `samples` rays along a pixel's side.
    fn quality(self, samples: u32) -> Option<[u32; 2]> {
        match self {
            Self::Off => None,
            Self::Fast => Some([MIN_MAP_PX, FAST_TAPS]),
            Self::Fine => Some([MAX_MAP_PX, if samples > 1 { FINE_TAPS } else { FAST_TAPS }]),
        }
    }
}

/// A tile of the draw list, and the area that it covers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawnTile {
    pub(crate) id: TileId,
    /// The node that it is drawn from.
    pub(crate) source: TileId,
    pub(crate) mesh_lod: Option<u8>,
    /// Centre of the area on the map, in world metres.
    pub(crate) centre: DVec2,
    /// Half of the area's diagonal.
    pub(crate) half_m: f64,
}

/// A landmark of the draw list, in the coordinates of the world.
#[derive(Debug, Clone, Copy)]
struct DrawnLandmark {
    stone: u32,
    anchor: DVec3,
    low: DVec3,
    high: DVec3,
}

#[derive(Debug, Default)]
pub(crate) struct DrawnLandmarks {
    landmarks: BTreeMap<[i64; 3], DrawnLandmark>,
}

impl DrawnLandmarks {
    /// Adds those of a mesh whose coordinates begin at `origin`.
    pub(crate) fn add(&mut self, landmarks: &[LandmarkBounds], origin: DVec3) {
        for bounds in landmarks.iter().filter(|bounds| bounds.stone > 0) {
            let at = |v: [f32; 3]| origin + DVec3::from(v.map(f64::from));
            let [anchor, low, high] = [bounds.anchor_m, bounds.low_m, bounds.high_m].map(at);
            let key = (anchor * ANCHORS_PER_M).round().to_array().map(|v| v as i64);
            let landmark =
                self.landmarks.entry(key).or_insert(DrawnLandmark { stone: bounds.stone, anchor, low, high });
            (landmark.low, landmark.high) = (landmark.low.min(low), landmark.high.max(high));
        }
    }

    /// Writes the maps of those landmarks in which light is seen to go farthest. The maps lie behind `atlas_pages` of the atlas.
    /// `drawn` are all tiles of the draw list.
    pub(crate) fn write(
        &self,
        frame: &mut FrameUniform,
        view: &View,
        translucency: Translucency,
        atlas_pages: u32,
        drawn: &[DrawnTile],
    ) {
        let Some([width_px, taps]) = translucency.quality(frame.samples) else { return };
        let is_day = frame.sun[2] > 0.0 && frame.light.sun[0] > 0.0;
        if !is_day || frame.shading != Shading::Lit as u32 {
            return;
        }
        let address = |number: usize| atlas_pages * PAGE_WORDS as u32 + number as u32 * MAP_WORDS;
        let eye = view.camera.position;
        let mut candidates: Vec<(f64, TranslucencyMap, &DrawnLandmark)> = Vec::new();
        for landmark in self.landmarks.values() {
            let (centre, radius_m) = landmark.sphere();
            let stone: Option<&Stone> = frame.stones.get(landmark.stone as usize - 1);
            let place = MapPlace {
                centre: (centre - eye).as_vec3(),
                radius_m: radius_m as f32,
                anchor: (landmark.anchor - eye).as_vec3(),
            };
            let map = stone.and_then(|stone| TranslucencyMap::new(stone, &place, width_px, taps, 0));
            let distance_m = (centre.distance(eye) - radius_m).max(0.1);
            if let Some(map) = map {
                let reach_px = f64::from(map.reach_m) * view.focal_px() / distance_m;
                if reach_px >= MIN_REACH_PX {
                    candidates.push((reach_px, map, landmark));
                }
            }
        }
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (number, (_, map, landmark)) in candidates.into_iter().take(MAX_MAPS).enumerate() {
            frame.translucency[number] = TranslucencyMap { address: address(number), ..map };
            frame.map_keys[number] = landmark.key(frame, &map, drawn);
            frame.translucent = 1;
        }
    }
}

impl DrawnLandmark {
    /// Centre and radius of a sphere around it.
    fn sphere(&self) -> (DVec3, f64) {
        ((self.low + self.high) * 0.5, self.low.distance(self.high) * 0.5 + 0.01)
    }

    /// A number that changes when the map would: not 0.
    fn key(&self, frame: &FrameUniform, map: &TranslucencyMap, drawn: &[DrawnTile]) -> u32 {
        let mut hasher = DefaultHasher::new();
        let (centre, radius_m) = self.sphere();
        [self.anchor, self.low, self.high].map(|v| v.to_array().map(f64::to_bits)).hash(&mut hasher);
        (map.width_px, map.alpha.to_bits(), frame.sun.map(f32::to_bits), frame.shadow_m > 0.0).hash(&mut hasher);
        for tile in drawn {
            if tile.centre.distance(centre.truncate()) <= radius_m + tile.half_m + SHADOW_M {
                (tile.id, tile.source, tile.mesh_lod).hash(&mut hasher);
            }
        }
        (hasher.finish() as u32).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const BOUNDS: LandmarkBounds =
        LandmarkBounds { stone: 1, anchor_m: [10.0, 12.0, 3.0], low_m: [9.0, 11.0, 3.0], high_m: [11.0, 13.0, 6.0] };

    fn frame(sun: DVec3) -> FrameUniform {
        let mut frame = FrameUniform { samples: 3, sun: sun.as_vec3().to_array(), ..FrameUniform::zeroed() };
        frame.light.sun = [1.0; 4];
        // Real marble would need a smaller landmark.
        frame.stones[0] = Stone { scattering_scale: 4.0, ..Stone::preset("carrara-marble").unwrap() };
        frame
    }

    fn view(distance_m: f64) -> View {
        let mut view = crate::select::tests::view([1010.0 - distance_m, 2012.0, 8.0], [1010.0, 2012.0, 5.0]);
        view.camera.position = DVec3::new(1010.0 - distance_m, 2012.0, 8.0);
        view
    }

    fn written(landmarks: &DrawnLandmarks, distance_m: f64, sun: DVec3, lod: u8) -> FrameUniform {
        let mut frame = frame(sun);
        let (id, centre) = (TileId::ROOT, DVec2::new(1010.0, 2000.0));
        let tile = DrawnTile { id, source: id, mesh_lod: Some(lod), centre, half_m: 50.0 };
        landmarks.write(&mut frame, &view(distance_m), Translucency::Fine, 100, &[tile]);
        frame
    }

    #[test]
    fn near_landmarks_have_a_map_and_far_ones_do_not() {
        let sun = DVec3::new(0.5, 0.5, 0.7);
        let mut landmarks = DrawnLandmarks::default();
        landmarks.add(&[BOUNDS], DVec3::new(1000.0, 2000.0, 0.0));
        // The same landmark in the next tile.
        let next = LandmarkBounds {
            anchor_m: [-54.0, 12.0, 3.0],
            low_m: [-53.0, 11.0, 3.0],
            high_m: [-52.0, 13.0, 5.0],
            ..BOUNDS
        };
        landmarks.add(&[next], DVec3::new(1064.0, 2000.0, 0.0));
        let near = written(&landmarks, 6.0, sun, 0);
        assert_eq!((near.translucent, near.translucency[1].width_px, near.map_keys[1]), (1, 0, 0));
        let map = near.translucency[0];
        assert_eq!((map.address, map.taps, map.width_px), (100 * PAGE_WORDS as u32, FINE_TAPS, MAX_MAP_PX));
        // 9 to 12 along x: 3 m, 2 m and 3 m.
        assert!((map.radius_m - 22f32.sqrt() / 2.0 - 0.01).abs() < 1e-4, "{}", map.radius_m);
        assert_eq!(written(&landmarks, 600.0, sun, 0).translucent, 0);
    }

    #[test]
    fn keys_change_with_the_sun_and_with_what_is_drawn_but_not_with_the_camera() {
        let sun = DVec3::new(0.5, 0.5, 0.7);
        let mut landmarks = DrawnLandmarks::default();
        landmarks.add(&[BOUNDS], DVec3::new(1000.0, 2000.0, 0.0));
        let key = |distance_m, sun, lod| written(&landmarks, distance_m, sun, lod).map_keys[0];
        let first = key(6.0, sun, 0);
        assert!(first != 0 && first == key(7.0, sun, 0));
        assert_ne!(first, key(6.0, DVec3::new(0.5, 0.4, 0.7), 0));
        assert_ne!(first, key(6.0, sun, 1));
        assert_eq!(key(6.0, DVec3::new(0.5, 0.5, -0.1), 0), 0);
    }
}
