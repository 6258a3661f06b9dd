//! What the page needs to lay figures of its own on the city: heights of surfaces, and which points are seen.

use super::viewer::CityViewer;
use glam::DVec3;
use wasm_bindgen::prelude::*;

/// How far above the city's box its highest surface is searched from.
const ABOVE_M: f64 = 1.0;

#[wasm_bindgen]
impl CityViewer {
    /// Heights in world metres of the highest surfaces at `places` (x, y, x, y, ...), as far as tiles are there: the ground plane
    /// elsewhere.
    #[wasm_bindgen(js_name = surfaceHeights)]
    pub fn surface_heights(&self, places: &[f64]) -> Vec<f64> {
        let (solids, manifest) = (self.solids(), self.streamer.tree().manifest());
        let top_m = manifest.bounds[1][2] + ABOVE_M;
        let height = |place: DVec3| solids.ground_below(place).unwrap_or(manifest.ground_z_m);
        let at =
            |x: f64, y: f64| if x.is_finite() && y.is_finite() { height(DVec3::new(x, y, top_m)) } else { f64::NAN };
        places.chunks_exact(2).map(|place| at(place[0], place[1])).collect()
    }

    /// For each of `points` (x, y, z, x, y, z, ...) 1 if nothing of the city is between the camera and it, else 0.
    #[wasm_bindgen(js_name = seenPoints)]
    pub fn seen_points(&self, points: &[f64]) -> Vec<u8> {
        let points = points.chunks_exact(3).map(DVec3::from_slice);
        points.map(|point| u8::from(point.is_finite() && self.sees(point))).collect()
    }
}
