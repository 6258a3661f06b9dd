//! Space carving by brute force (Vacca 2008, 3.4.1): what cannot be seen from any of many directions is full.
//!
//! It shares no code with the bake. Its directions cover the whole sphere, it knows nothing of columns, floors or objects, and
//! each point is tested by itself.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// The points of a cube that cannot be seen from outside.
pub struct Carving {
    /// Middle of the points, and a distance within which all of them are.
    pub middle: DVec3,
    pub radius_m: f64,
    /// Side of a texel of the depth maps.
    pub texel_m: f64,
}

impl Carving {
    /// For each point whether it is hidden from all `views` directions. `triangles` hide what is behind them, whichever side they show.
    pub fn hidden(&self, triangles: &[[DVec3; 3]], points: &[DVec3], views: usize) -> Vec<bool> {
        let mut is_hidden = vec![true; points.len()];
        let mut left: Vec<u32> = (0..points.len() as u32).collect();
        // Each batch of maps is drawn at the same time, and its points are not tested again.
        let all: Vec<DVec3> = (0..views).map(|i| direction(i, views)).collect();
        for batch in all.chunks(16) {
            let maps: Vec<DepthMap> = batch.par_iter().map(|view| DepthMap::draw(self, triangles, *view)).collect();
            left = left
                .into_par_iter()
                .filter(|i| maps.iter().all(|map| map.is_hidden(points[*i as usize] - self.middle)))
                .collect();
        }
        is_hidden.fill(false);
        left.iter().for_each(|i| is_hidden[*i as usize] = true);
        is_hidden
    }
}

/// One of `count` directions that are spread evenly over the sphere, in an order in which the first ones are, too.
fn direction(i: usize, count: usize) -> DVec3 {
    // The golden section of any number of directions is prime to it, or nearly so: odd steps visit powers of two once.
    let i = i * ((count as f64 * 0.618) as usize | 1) % count;
    let z = 1.0 - (2 * i + 1) as f64 / count as f64;
    let turn = DVec2::from_angle(i as f64 * PI * (3.0 - 5.0f64.sqrt()));
    (turn * (1.0 - z * z).sqrt()).extend(z)
}

/// Distances of the nearest surfaces from a viewer far away.
struct DepthMap {
    right: DVec3,
    up: DVec3,
    /// Direction of the viewer.
    towards: DVec3,
    side: usize,
    texel_m: f64,
    /// Metres from the middle towards the viewer of what is nearest to it; negative infinity where nothing is.
    nearest: Vec<f32>,
}

impl DepthMap {
    fn draw(carving: &Carving, triangles: &[[DVec3; 3]], towards: DVec3) -> Self {
        let right = towards.any_orthonormal_vector();
        let side = 2 * ((carving.radius_m / carving.texel_m).ceil() as usize + 2);
        let nearest = vec![f32::NEG_INFINITY; side * side];
        let mut map = Self { right, up: towards.cross(right), towards, side, texel_m: carving.texel_m, nearest };
        for corners in triangles {
            map.draw_triangle(corners.map(|corner| map.place(corner - carving.middle)));
        }
        map
    }

    /// Texels from the map's corner, and metres towards the viewer.
    fn place(&self, p: DVec3) -> DVec3 {
        let half = self.side as f64 / 2.0;
        DVec3::new(p.dot(self.right) / self.texel_m + half, p.dot(self.up) / self.texel_m + half, p.dot(self.towards))
    }

    /// Draws a triangle at the middles of all texels that it contains.
    fn draw_triangle(&mut self, [a, b, c]: [DVec3; 3]) {
        let area = (b - a).truncate().perp_dot((c - a).truncate());
        if area == 0.0 {
            return;
        }
        let clamp = |v: f64| v.clamp(0.0, self.side as f64) as usize;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let columns = clamp((low.x - 0.5).ceil())..clamp((high.x + 0.5).floor());
        for y in clamp((low.y - 0.5).ceil())..clamp((high.y + 0.5).floor()) {
            for x in columns.clone() {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let share = |q: DVec3, r: DVec3| (q.truncate() - p).perp_dot(r.truncate() - p) / area;
                let weights = [share(b, c), share(c, a), share(a, b)];
                // No texel is between two triangles.
                if weights.iter().all(|weight| *weight >= -1e-9) {
                    let depth = (a.z * weights[0] + b.z * weights[1] + c.z * weights[2]) as f32;
                    let texel = &mut self.nearest[y * self.side + x];
                    *texel = texel.max(depth);
                }
            }
        }
    }

    /// Whether a point is behind one of the four texels around it. So no point is seen through what is between texels.
    fn is_hidden(&self, p: DVec3) -> bool {
        let place = self.place(p);
        let [x, y] = [place.x, place.y].map(|v| (v - 0.5).floor() as usize);
        let texels = [0, 1].map(|dy| [0, 1].map(|dx| self.nearest.get((y + dy) * self.side + x + dx)));
        texels.as_flattened().iter().flatten().any(|nearest| f64::from(**nearest) >= place.z)
    }
}
