//! Occlusion on the CPU: maps are drawn and tested on all cores.

use crate::{
    depth_map::{DepthMap, Projected},
    directions::{UNIT, UNIT_SHIFT, ViewPair, dot},
    prepared::{MapFrame, PreparedScene, SUBTEXEL_BITS},
    settings::{Occlusion, OcclusionError},
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

/// Memory of all threads together, unless one needs more.
const MAX_WORK_BYTES: usize = 2 << 30;
/// Largest slope of the surface in a map for which the depth of a texel's centre is corrected. Beyond it, the cosine and with it the weight is small.
pub(crate) const MAX_SLOPE: f32 = 8.0;
pub(crate) const BIAS_TEXELS: f32 = 1.0;
pub(crate) const BIAS_PER_SLOPE: f32 = 0.25;

/// Sums over the directions that a vertex faces. They are whole numbers, so that their order does not matter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct VertexSum {
    /// Cosines of the visible directions; 2^16 is 1.
    pub(crate) visible: u32,
    /// Cosines of all.
    pub(crate) all: u32,
}

struct Worker {
    projected: Vec<Projected>,
    map: DepthMap,
    sums: Vec<VertexSum>,
    bent: Vec<[i32; 3]>,
}

fn params() -> [f32; 3] {
    use std::sync::OnceLock;
    static P: OnceLock<[f32; 3]> = OnceLock::new();
    *P.get_or_init(|| {
        let v = std::env::var("AO_P").unwrap_or_default();
        let mut n = v.split(',').filter_map(|w| w.parse().ok());
        [n.next().unwrap_or(MAX_SLOPE), n.next().unwrap_or(BIAS_TEXELS), n.next().unwrap_or(BIAS_PER_SLOPE)]
    })
}

impl Worker {
    fn new(scene: &PreparedScene, has_bent: bool) -> Self {
        Self {
            projected: vec![[0; 3]; scene.places.len()],
            map: DepthMap::new(scene.frame.size_px),
            sums: vec![VertexSum::default(); scene.normals.len()],
            bent: vec![[0; 3]; if has_bent { scene.normals.len() } else { 0 }],
        }
    }

    fn bytes(scene: &PreparedScene) -> usize {
        DepthMap::bytes(scene.frame.size_px) + scene.places.len() * 12 + scene.normals.len() * (8 + 12)
    }

    fn add(&mut self, scene: &PreparedScene, pair: ViewPair) {
        for (place, projected) in scene.places.iter().zip(&mut self.projected) {
            *projected = project(*place, pair, scene.frame);
        }
        self.map.clear();
        for triangle in &scene.triangles {
            self.map.draw(triangle.map(|vertex| self.projected[vertex as usize]));
        }
        let texel = scene.frame.texel_steps();
        let prm = params();
        for (i, normal) in scene.normals.iter().enumerate() {
            let [x, y, depth] = self.projected[i];
            let facing = pair.axes.map(|axis| dot(axis, *normal) as i32);
            let cosine = facing[2].unsigned_abs() >> (2 * UNIT_SHIFT - 16);
            let [near, far] = self.map.depths(x >> SUBTEXEL_BITS, y >> SUBTEXEL_BITS);
            let slope = [facing[0], facing[1]].map(|n| -(n as f32) / facing[2] as f32);
            let steep = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
            let lim = if steep > prm[0] { prm[0] / steep } else { 1.0 };
            let to_centre = [x, y].map(|v| (128 - (v & 255)) as f32 / 256.0 * texel);
            let plane = depth as f32 + lim * (slope[0] * to_centre[0] + slope[1] * to_centre[1]);
            let bias = texel * (prm[1] + prm[2] * steep.min(prm[0]));
            let visible = if facing[2] > 0 { near <= plane + bias } else { far >= plane - bias };
            let sum = &mut self.sums[i];
            sum.all += cosine;
            if visible {
                sum.visible += cosine;
                if let Some(bent) = self.bent.get_mut(i) {
                    let sign = facing[2].signum();
                    (0..3).for_each(|k| bent[k] += sign * pair.axes[2][k]);
                }
            }
        }
    }
}

#[inline]
fn project(place: [i32; 3], pair: ViewPair, frame: MapFrame) -> Projected {
    let [x, y, z] = pair.axes.map(|axis| dot(axis, place));
    let (shift, middle) = (frame.product_shift(), frame.middle());
    [(x >> shift) as i32 + middle, (y >> shift) as i32 + middle, (z >> UNIT_SHIFT) as i32]
}

/// Occlusion of a scene.
pub(crate) fn run(
    scene: &PreparedScene,
    pairs: &[ViewPair],
    has_bent: bool,
    watch: &(dyn Fn(u32) -> bool + Sync),
) -> Result<Occlusion, OcclusionError> {
    let workers = rayon::current_num_threads().min(MAX_WORK_BYTES / Worker::bytes(scene)).clamp(1, pairs.len().max(1));
    let (next, done, stop) = (AtomicU32::new(0), AtomicU32::new(0), AtomicBool::new(false));
    let work = |_| {
        let mut worker = Worker::new(scene, has_bent);
        while let Some(pair) = pairs.get(next.fetch_add(1, Relaxed) as usize).filter(|_| !stop.load(Relaxed)) {
            worker.add(scene, *pair);
            if !watch(done.fetch_add(2, Relaxed) + 2) {
                stop.store(true, Relaxed);
            }
        }
        (worker.sums, worker.bent)
    };
    let merge = |(mut sums, mut bent): (Vec<VertexSum>, Vec<[i32; 3]>), (more, more_bent): (Vec<VertexSum>, Vec<[i32; 3]>)| {
        for (sum, more) in sums.iter_mut().zip(more) {
            sum.visible += more.visible;
            sum.all += more.all;
        }
        for (bent, more) in bent.iter_mut().zip(more_bent) {
            (0..3).for_each(|k| bent[k] += more[k]);
        }
        (sums, bent)
    };
    let found = (0..workers).into_par_iter().map(work).reduce_with(merge);
    let (sums, bent) = found.unwrap_or_default();
    if stop.load(Relaxed) {
        return Err(OcclusionError::Cancelled);
    }
    let share = |sum: &VertexSum| if sum.all == 0 { 1.0 } else { (f64::from(sum.visible) / f64::from(sum.all)) as f32 };
    let _ = (bent, UNIT);
    Ok(Occlusion { share: sums.iter().map(share).collect(), bent_normals: None })
}
