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
        self.project_all(scene, pair);
        self.map.clear();
        self.draw_all(scene);
        self.test_all(scene, pair);
    }

    #[inline(never)]
    fn project_all(&mut self, scene: &PreparedScene, pair: ViewPair) {
        for (place, projected) in scene.places.iter().zip(&mut self.projected) {
            *projected = project(*place, pair, scene.frame);
        }
    }

    #[inline(never)]
    fn draw_all(&mut self, scene: &PreparedScene) {
        for [a, b, c] in &scene.triangles {
            let [a, b, c] = [&self.projected[*a as usize], &self.projected[*b as usize], &self.projected[*c as usize]];
            self.map.draw(*a, *b, *c);
        }
    }

    #[inline(never)]
    fn test_all(&mut self, scene: &PreparedScene, pair: ViewPair) {
        for (i, normal) in scene.normals.iter().enumerate() {
            let (facing, is_visible) = test(*normal, self.projected[i], pair, scene.frame, &self.map);
            let cosine = facing.unsigned_abs() >> (2 * UNIT_SHIFT - 16);
            let sum = &mut self.sums[i];
            sum.all += cosine;
            sum.visible += if is_visible { cosine } else { 0 };
            if let Some(bent) = self.bent.get_mut(i).filter(|_| is_visible) {
                (0..3).for_each(|k| bent[k] += facing.signum() * pair.axes[2][k]);
            }
        }
    }
}

#[inline(always)]
fn test(normal: [i32; 3], [x, y, depth]: Projected, pair: ViewPair, frame: MapFrame, map: &DepthMap) -> (i32, bool) {
    let prm = params();
    let texel = frame.texel_steps();
    let [right, down, towards] = pair.axes;
    let facing = dot32(towards, normal);
    let (across_x, across_y) = (dot32(right, normal) as f32, dot32(down, normal) as f32);
    let across = (across_x * across_x + across_y * across_y).sqrt();
    let cosine = (facing.unsigned_abs() as f32).max(across / prm[0]);
    let [near, far] = map.depths(x >> SUBTEXEL_BITS, y >> SUBTEXEL_BITS);
    let over = if facing > 0 { near - depth as f32 } else { depth as f32 - far };
    let to_centre = |v: i32| (128 - (v & 255)) as f32 * (texel / 256.0);
    let plane = -(across_x * to_centre(x) + across_y * to_centre(y));
    (facing, over * cosine <= plane + texel * (prm[1] * cosine + prm[2] * across))
}

/// Scalar product of unit vectors.
#[inline(always)]
fn dot32(a: [i32; 3], b: [i32; 3]) -> i32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn project(place: [i32; 3], pair: ViewPair, frame: MapFrame) -> Projected {
    let (shift, middle) = (frame.product_shift(), frame.middle());
    let [right, down, towards] = pair.axes;
    [
        (dot(right, place) >> shift) as i32 + middle,
        (dot(down, place) >> shift) as i32 + middle,
        (dot(towards, place) >> UNIT_SHIFT) as i32,
    ]
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
