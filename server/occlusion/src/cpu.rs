//! Occlusion on the CPU: all cores draw and test maps.

use crate::depth_map::{DepthMap, Projected};
use crate::prepared::PreparedScene;
use crate::sums::OcclusionSums;
use crate::{COSINE_SHIFT, OcclusionError, ViewPair, project, sees};
use rayon::prelude::*;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU32};

/// Fewer threads work where all of them would take more memory. One always does.
const MAX_WORK_BYTES: usize = 2 << 30;

struct Worker {
    projected: Vec<Projected>,
    map: DepthMap,
    sums: OcclusionSums,
}

impl Worker {
    fn new(scene: &PreparedScene, has_bent: bool) -> Self {
        Self {
            projected: vec![[0; 3]; scene.places.len()],
            map: DepthMap::new(scene.frame.size_px),
            sums: OcclusionSums::new(scene.normals.len(), has_bent),
        }
    }

    /// Memory of a worker, at most.
    fn bytes(scene: &PreparedScene) -> usize {
        let sum = size_of::<crate::sums::VertexSum>() + size_of::<[i32; 3]>();
        DepthMap::bytes(scene.frame.size_px) + scene.places.len() * size_of::<Projected>() + scene.normals.len() * sum
    }

    fn add(&mut self, scene: &PreparedScene, pair: ViewPair) {
        for (place, projected) in scene.places.iter().zip(&mut self.projected) {
            *projected = project(*place, pair, scene.frame);
        }
        self.map.clear();
        for [a, b, c] in &scene.triangles {
            let corner = |vertex: u32| self.projected[vertex as usize];
            self.map.draw(corner(*a), corner(*b), corner(*c));
        }
        for (vertex, normal) in scene.normals.iter().enumerate() {
            let (facing, is_visible) = sees(*normal, self.projected[vertex], pair, scene.frame, &self.map);
            self.sums.add(vertex, facing, facing.unsigned_abs() >> COSINE_SHIFT, is_visible, pair);
        }
    }
}

/// Sums over all pairs. `watch` gets the number of views that are done, and stops the work by `false`.
pub(crate) fn sums(
    scene: &PreparedScene,
    pairs: &[ViewPair],
    has_bent: bool,
    watch: &(dyn Fn(u32) -> bool + Sync),
) -> Result<OcclusionSums, OcclusionError> {
    let most = MAX_WORK_BYTES / Worker::bytes(scene).max(1);
    let workers = rayon::current_num_threads().min(most).min(pairs.len()).max(1);
    let (next, done, stop) = (AtomicU32::new(0), AtomicU32::new(0), AtomicBool::new(false));
    let work = |_| {
        let mut worker = Worker::new(scene, has_bent);
        while let Some(pair) = pairs.get(next.fetch_add(1, Relaxed) as usize).filter(|_| !stop.load(Relaxed)) {
            worker.add(scene, *pair);
            if !watch(done.fetch_add(2, Relaxed) + 2) {
                stop.store(true, Relaxed);
            }
        }
        worker.sums
    };
    let sums = (0..workers).into_par_iter().map(work).reduce_with(OcclusionSums::merge);
    if stop.load(Relaxed) { Err(OcclusionError::Cancelled) } else { Ok(sums.unwrap_or_default()) }
}
