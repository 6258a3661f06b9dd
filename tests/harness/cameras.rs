//! Twelve cameras per city, the same in every run: four in the air, four on roofs, four in streets. Nothing is above them, and
//! those on roofs and in streets are two metres above the surface.

use crate::rng::Rng;
use crate::truth::Truth;
use crate::view::{Camera, FrameSpec};
use glam::{DVec2, DVec3};
use insula_bake::scene::ObjectKind;
use insula_shaders::layout::Shading;
use serde::Serialize;

/// Height of the eye above the roof or street.
const EYE_M: f64 = 2.0;
const EACH: usize = 4;
/// Positions that are tried for one camera.
const TRIES: usize = 400;
/// Coarse frame that rates a view.
const JUDGE: FrameSpec = FrameSpec { width_px: 24, height_px: 14, shading: Shading::Albedo, samples: 1 };

/// Where a camera is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum StationKind {
    /// Above the city, looking down.
    Aerial,
    Roof,
    Street,
}

#[derive(Debug, Clone, Copy)]
pub struct Station {
    pub kind: StationKind,
    pub camera: Camera,
}

struct City<'a> {
    truth: &'a Truth,
    low: DVec3,
    high: DVec3,
    has_terrain: bool,
}

/// The cameras of a city. Fewer than twelve only if it has no suitable roof or street.
pub fn stations(truth: &Truth) -> Vec<Station> {
    let [low, high] = truth.bounds();
    let has_terrain = truth.scene.objects.iter().any(|object| object.kind == ObjectKind::Terrain);
    let city = City { truth, low, high, has_terrain };
    let mut stations: Vec<Station> = (0..EACH).filter_map(|k| city.aerial(k)).collect();
    for kind in [StationKind::Roof, StationKind::Street] {
        let mut rng = Rng::new(kind as u64);
        stations.extend((0..EACH).filter_map(|_| city.standing(&mut rng, kind)));
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
        Some(Station { kind: StationKind::Aerial, camera: self.camera(position, middle) })
    }

    /// The best view of up to eight suitable positions.
    fn standing(&self, rng: &mut Rng, kind: StationKind) -> Option<Station> {
        let mut best: Option<(f64, Camera)> = None;
        let mut fit = 0;
        for _ in 0..TRIES {
            let size = self.high - self.low;
            let at = self.low + size * DVec3::new(rng.range(0.1, 0.9), rng.range(0.1, 0.9), 0.0);
            let Some(position) = self.eye_at(at, kind) else { continue };
            for k in 0..8 {
                let angle = (f64::from(k) + rng.unit()) / 8.0 * std::f64::consts::TAU;
                let dip = if kind == StationKind::Roof { -0.08 } else { 0.08 };
                let target = position + DVec3::new(angle.cos(), angle.sin(), dip) * 100.0;
                let camera = self.camera(position, target);
                let rating = self.rating(&camera);
                if best.as_ref().is_none_or(|(most, _)| rating > *most) {
                    best = Some((rating, camera));
                }
            }
            fit += 1;
            if fit == 8 {
                break;
            }
        }
        best.map(|(_, camera)| Station { kind, camera })
    }

    /// The eye above `at`, if that is a position of this kind in the open.
    fn eye_at(&self, at: DVec3, kind: StationKind) -> Option<DVec3> {
        let ground = self.ground_near(at)?;
        let from = at.with_z(self.high.z + 100.0);
        let below = self.truth.cast(from, DVec3::NEG_Z);
        let on_building = below.filter(|hit| self.object_kind(hit.triangle) == ObjectKind::Building);
        let floor = match (kind, on_building, below) {
            (StationKind::Roof, Some(hit), _) => from.z - hit.distance_m,
            (StationKind::Street, None, Some(hit)) => from.z - hit.distance_m,
            // Beside the terrain there is no street; without terrain, the ground is everywhere.
            (StationKind::Street, None, None) if !self.has_terrain => ground,
            _ => return None,
        };
        let room_m = if kind == StationKind::Street { 4.0 } else { 1.0 };
        let eye = at.with_z(floor + EYE_M);
        let clear = !self.truth.anything_near(eye, room_m, [floor + 1.0, self.high.z + 100.0]);
        (clear && (kind == StationKind::Street || floor > ground + 5.0)).then_some(eye)
    }

    fn object_kind(&self, triangle: u32) -> ObjectKind {
        let object = self.truth.scene.triangles[triangle as usize].object;
        self.truth.scene.objects.get(object as usize).map(|o| o.kind).unwrap_or_default()
    }

    /// Height of the terrain at `at`; without terrain, of the lowest corner within 60 m.
    fn ground_near(&self, at: DVec3) -> Option<f64> {
        let from = at.with_z(self.high.z + 100.0);
        if let Some(hit) = self.truth.cast(from, DVec3::NEG_Z)
            && self.object_kind(hit.triangle) == ObjectKind::Terrain
        {
            return Some(from.z - hit.distance_m);
        }
        let corners = self.truth.scene.triangles.iter().flat_map(|t| t.corners);
        let near = corners
            .filter(|c| DVec2::new(f64::from(c[0]), f64::from(c[1])).distance_squared(at.truncate()) < 60.0 * 60.0);
        near.map(|c| f64::from(c[2])).min_by(f64::total_cmp)
    }

    /// Rates a view: high if it shows distant buildings and outlines against the sky, low if something close fills it.
    fn rating(&self, camera: &Camera) -> f64 {
        let seen = self.truth.render(camera, &JUDGE);
        let count = |range: std::ops::Range<f32>| seen.distance.iter().filter(|d| range.contains(d)).count() as f64;
        let (far, middle, near) = (count(60.0..2000.0), count(12.0..60.0), count(0.0..8.0));
        let width = JUDGE.width_px as usize;
        let outline = |i: usize| seen.distance[i].is_finite() != seen.distance[i + width].is_finite();
        let outlines = (0..seen.distance.len() - width).filter(|i| outline(*i)).count() as f64;
        2.0 * far + middle - 2.0 * near + 4.0 * outlines
    }
}
