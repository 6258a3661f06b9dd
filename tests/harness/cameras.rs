//! Twelve cameras a city, always the same: four from the air, four at the height of roofs, four in the street. All stand in
//! the open: nothing above them, two metres over what is below.

use crate::{
    rng::Rng,
    truth::Truth,
    view::{Camera, FrameSpec},
};
use glam::{DVec2, DVec3};
use insula_bake::scene::ObjectKind;
use insula_shaders::layout::Shading;
use serde::Serialize;

/// Height of an eye above what it stands on.
const EYE_M: f64 = 2.0;
const EACH: usize = 4;
/// Places that are tried for one camera.
const TRIES: usize = 400;
/// Coarse frame that judges a view.
const JUDGE: FrameSpec = FrameSpec { width_px: 24, height_px: 14, shading: Shading::Albedo, samples: 1 };

/// Where a camera stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Stand {
    /// Over the city, looking down at an angle.
    Aerial,
    Roof,
    Street,
}

/// A camera and where it stands.
#[derive(Debug, Clone, Copy)]
pub struct Station {
    pub stand: Stand,
    pub camera: Camera,
}

struct City<'a> {
    truth: &'a Truth,
    low: DVec3,
    high: DVec3,
    has_terrain: bool,
}

/// The city's cameras. Fewer than twelve only if it has no roof, or no street, to stand on.
pub fn of(truth: &Truth) -> Vec<Station> {
    let [low, high] = truth.bounds();
    let has_terrain = truth.scene.objects.iter().any(|object| object.kind == ObjectKind::Terrain);
    let city = City { truth, low, high, has_terrain };
    let mut stations: Vec<Station> = (0..EACH).filter_map(|k| city.aerial(k)).collect();
    for stand in [Stand::Roof, Stand::Street] {
        let mut rng = Rng::new(stand as u64);
        stations.extend((0..EACH).filter_map(|_| city.standing(&mut rng, stand)));
    }
    stations
}

impl City<'_> {
    fn camera(&self, position: DVec3, target: DVec3) -> Camera {
        let origin = DVec3::from(self.truth.scene.origin);
        Camera::looking(origin + position, origin + target)
    }

    fn aerial(&self, k: usize) -> Option<Station> {
        let size = self.high - self.low;
        let ground = self.ground_near((self.low + self.high) / 2.0).unwrap_or(self.low.z);
        let middle = ((self.low + self.high) / 2.0).with_z(ground);
        let angle = (0.125 + k as f64 / EACH as f64) * std::f64::consts::TAU;
        let away = DVec2::new(angle.cos(), angle.sin()) * size.truncate() * 0.4;
        let up_m = (size.truncate().min_element() * 0.25).clamp(80.0, 350.0);
        let position = middle + away.extend(up_m);
        Some(Station { stand: Stand::Aerial, camera: self.camera(position, middle) })
    }

    /// The best view of some places that are fit to stand on.
    fn standing(&self, rng: &mut Rng, stand: Stand) -> Option<Station> {
        let mut best: Option<(f64, Camera)> = None;
        let mut fit = 0;
        for _ in 0..TRIES {
            let size = self.high - self.low;
            let at = self.low + size * DVec3::new(rng.range(0.1, 0.9), rng.range(0.1, 0.9), 0.0);
            let Some(position) = self.place(at, stand) else { continue };
            for k in 0..8 {
                let angle = (f64::from(k) + rng.unit()) / 8.0 * std::f64::consts::TAU;
                let dip = if stand == Stand::Roof { -0.08 } else { 0.08 };
                let target = position + DVec3::new(angle.cos(), angle.sin(), dip) * 100.0;
                let camera = self.camera(position, target);
                let worth = self.worth(&camera);
                if best.as_ref().is_none_or(|(most, _)| worth > *most) {
                    best = Some((worth, camera));
                }
            }
            fit += 1;
            if fit == 8 {
                break;
            }
        }
        best.map(|(_, camera)| Station { stand, camera })
    }

    /// Where an eye would be at `at`, if that is a place of this kind: in the open, with room around.
    fn place(&self, at: DVec3, stand: Stand) -> Option<DVec3> {
        let ground = self.ground_near(at)?;
        let from = at.with_z(self.high.z + 100.0);
        let below = self.truth.cast(from, DVec3::NEG_Z);
        let on_building = below.filter(|hit| self.kind(hit.triangle) == ObjectKind::Building);
        let floor = match (stand, on_building, below) {
            (Stand::Roof, Some(hit), _) => from.z - hit.distance_m,
            (Stand::Street, None, Some(hit)) => from.z - hit.distance_m,
            // Beside the terrain there is no street; where the source has none, there is all around.
            (Stand::Street, None, None) if !self.has_terrain => ground,
            _ => return None,
        };
        let room_m = if stand == Stand::Street { 4.0 } else { 1.0 };
        let eye = at.with_z(floor + EYE_M);
        let clear = !self.truth.anything_near(eye, room_m, [floor + 1.0, self.high.z + 100.0]);
        (clear && (stand == Stand::Street || floor > ground + 5.0)).then_some(eye)
    }

    fn kind(&self, triangle: u32) -> ObjectKind {
        let object = self.truth.scene.triangles[triangle as usize].object;
        self.truth.scene.objects.get(object as usize).map(|o| o.kind).unwrap_or_default()
    }

    /// Height of the ground: of the terrain below, else of the lowest corner within sixty metres.
    fn ground_near(&self, at: DVec3) -> Option<f64> {
        let from = at.with_z(self.high.z + 100.0);
        if let Some(hit) = self.truth.cast(from, DVec3::NEG_Z)
            && self.kind(hit.triangle) == ObjectKind::Terrain
        {
            return Some(from.z - hit.distance_m);
        }
        let corners = self.truth.scene.triangles.iter().flat_map(|t| t.corners);
        let near = corners
            .filter(|c| DVec2::new(f64::from(c[0]), f64::from(c[1])).distance_squared(at.truncate()) < 60.0 * 60.0);
        near.map(|c| f64::from(c[2])).min_by(f64::total_cmp)
    }

    /// A view across the city: much of it further away than the next wall, little of it right before the eye, and some of
    /// its outline before the sky.
    fn worth(&self, camera: &Camera) -> f64 {
        let seen = self.truth.render(camera, &JUDGE);
        let count = |range: std::ops::Range<f32>| seen.distance.iter().filter(|d| range.contains(d)).count() as f64;
        let (far, middle, near) = (count(60.0..2000.0), count(12.0..60.0), count(0.0..8.0));
        let width = JUDGE.width_px as usize;
        let outline = |i: usize| seen.distance[i].is_finite() != seen.distance[i + width].is_finite();
        let outlines = (0..seen.distance.len() - width).filter(|i| outline(*i)).count() as f64;
        2.0 * far + middle - 2.0 * near + 4.0 * outlines
    }
}
