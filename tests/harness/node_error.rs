//! How far each level of a baked city lies from its source, in both directions.

use crate::baked::Baked;
use crate::compare::percentile;
use crate::rng::Rng;
use crate::truth::Truth;
use crate::view::{Camera, FrameSpec};
use anyhow::{Context, Result};
use glam::DVec3;
use insula_bake::columns::column_field::ColumnField;
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::{BlockMap, NODE_CELLS, TileId};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use rayon::prelude::*;

const FRAME: FrameSpec = FrameSpec { width_px: 200, height_px: 150, shading: Shading::Albedo, samples: 1 };
/// Directions from which the city is seen: degrees above the horizon, and their number around the city.
const VIEWS: [(f64, u32); 3] = [(15.0, 16), (40.0, 16), (75.0, 8)];

/// Distances of points of one surface from another one, in metres.
#[derive(Debug)]
pub struct Distances {
    /// Ascending.
    pub all_m: Vec<f64>,
    /// Share of the points that lie within the stated error of their node.
    pub within: f64,
    /// Share that lies within the nominal error.
    pub within_nominal: f64,
}

impl Distances {
    pub fn percentile(&self, share: f64) -> f64 {
        percentile(&self.all_m, share)
    }
}

#[derive(Debug)]
pub struct LevelError {
    pub level: u8,
    pub cell_m: f64,
    /// Half the diagonal of a voxel.
    pub nominal_m: f64,
    /// Median and largest stated error of the nodes.
    pub stated_m: [f64; 2],
    pub drawn_to_source: Distances,
    pub source_to_drawn: Distances,
    /// Distances of points that the ray-caster draws from the [`ColumnField`], which measures `source_to_drawn`, in cells: ascending.
    pub field_errors: Vec<f64>,
}

/// Measures all levels, the finest first, with `samples` points in each direction. Larger distances count as `most_m`.
pub fn measure(truth: &Truth, baked: &Baked, samples: usize, most_m: f64) -> Result<Vec<LevelError>> {
    let cameras = cameras(truth);
    let seen = seen_points(truth, samples)?;
    let level = |level: u8| {
        let ids = baked.ids(level);
        let cell_m = baked.manifest().cell_m_at(level);
        let nominal_m = voxel_error_m(cell_m);
        let distances = |points: &[DVec3], distance_m: &(dyn Fn(DVec3) -> f64 + Sync)| {
            let mut all_m: Vec<f64> = points.par_iter().map(|p| distance_m(*p).min(most_m)).collect();
            let stated_m = |p: DVec3| node_at(baked, level, p).and_then(|id| baked.error_m(id)).unwrap_or(nominal_m);
            let share = |count: usize| count as f64 / points.len().max(1) as f64;
            let within = share(points.iter().zip(&all_m).filter(|(p, m)| **m <= stated_m(**p)).count());
            let within_nominal = share(all_m.iter().filter(|m| **m <= nominal_m).count());
            all_m.sort_by(f64::total_cmp);
            Distances { all_m, within, within_nominal }
        };
        let list = baked.draw_list(&ids)?;
        let drawn = sample(&cameras, samples, |camera| Ok(list.scene(camera, &FRAME).render()))?;
        let maps: Vec<BlockMap> = ids.iter().map(|id| baked.map(*id)).collect::<Result<_>>()?;
        let field = ColumnField::new(&maps).context("a level without nodes")?;
        let origin = DVec3::from(baked.manifest().origin);
        let mut errors: Vec<f64> = ids.iter().filter_map(|id| baked.error_m(*id)).collect();
        errors.sort_by(f64::total_cmp);
        let mut field_errors: Vec<f64> =
            drawn.par_iter().map(|p| field.distance_m(*p - origin, most_m) / cell_m).collect();
        field_errors.sort_by(f64::total_cmp);
        Ok(LevelError {
            level,
            cell_m,
            nominal_m,
            stated_m: [percentile(&errors, 0.5), percentile(&errors, 1.0)],
            drawn_to_source: distances(&drawn, &|p| {
                truth.distance_to_surface(p - DVec3::from(truth.scene.origin), nominal_m, most_m)
            }),
            source_to_drawn: distances(&seen, &|p| field.distance_m(p - origin, most_m)),
            field_errors,
        })
    };
    (0..=baked.manifest().depth).rev().map(level).collect()
}

/// Random points of the source that are seen from outside, in world metres.
pub fn seen_points(truth: &Truth, count: usize) -> Result<Vec<DVec3>> {
    sample(&cameras(truth), count, |camera| Ok(truth.render(camera, &FRAME)))
}

/// The whole city from far away, in many directions.
fn cameras(truth: &Truth) -> Vec<Camera> {
    let [low, high] = truth.bounds().map(|corner| corner + DVec3::from(truth.scene.origin));
    let (centre, radius_m) = ((low + high) / 2.0, low.distance(high) / 2.0);
    let view = |up_deg: f64, around: f64| {
        let (up, around) = (up_deg.to_radians(), around * std::f64::consts::TAU);
        let away = DVec3::new(around.cos() * up.cos(), around.sin() * up.cos(), up.sin());
        Camera { fov_y_deg: 20.0, ..Camera::looking(centre + away * (radius_m * 6.0), centre) }
    };
    VIEWS.iter().flat_map(|&(up, n)| (0..n).map(move |k| view(up, (f64::from(k) + 0.3) / f64::from(n)))).collect()
}

/// Random points that the cameras see, in world metres.
fn sample(cameras: &[Camera], count: usize, draw: impl Fn(&Camera) -> Result<Pixels>) -> Result<Vec<DVec3>> {
    let mut points = Vec::new();
    for camera in cameras {
        let (pixels, axes) = (draw(camera)?, camera.axes(&FRAME));
        let hits = (0..pixels.distance.len()).filter(|i| pixels.distance[*i].is_finite());
        points.extend(hits.map(|i| {
            let ray = axes.ray(&FRAME, i as u32 % FRAME.width_px, i as u32 / FRAME.width_px);
            DVec3::from(camera.position) + ray * f64::from(pixels.distance[i])
        }));
    }
    let mut rng = Rng::new(7);
    let mut chosen = Vec::new();
    while chosen.len() < count && !points.is_empty() {
        chosen.push(points.swap_remove(rng.below(points.len())));
    }
    Ok(chosen)
}

/// The node of a level that contains a point in world metres; `None` outside of the root.
pub fn node_at(baked: &Baked, level: u8, p: DVec3) -> Option<TileId> {
    let side_m = baked.manifest().cell_m_at(level) * NODE_CELLS as f64;
    let place = (p - DVec3::from(baked.manifest().origin)) / side_m;
    TileId::new(level, place.x.floor() as u32, place.y.floor() as u32)
}
