//! Occlusion on a GPU: the same whole numbers, by the shaders of `insula-shaders`.

use crate::prepared::{MapFrame, PreparedScene, SUBTEXEL_BITS};
use crate::sums::{COSINE_BITS, OcclusionSums, VertexSum};
use crate::{
    BIAS_PER_SLOPE, BIAS_TEXELS, COSINE_SHIFT, MAX_BIAS_SLOPE, MAX_SLOPE, OcclusionError, UNIT_SHIFT, ViewPair,
};
use insula_shaders::gpu::GpuError;
use insula_shaders::gpu::occlusion::{OcclusionMaps, OcclusionScene};
use insula_shaders::layout::{OCCLUSION_SPLIT, OcclusionUniform};

/// Pairs between two reports of progress.
const PAIRS_AT_ONCE: usize = 8;
/// Part of a map's range of depths that a step of the grid takes. The mesh takes the middle half.
const DEPTH_SCALE: f32 = 1.0 / (1 << 22) as f32;

/// Sums over all pairs. `watch` is that of the CPU.
pub(crate) fn sums(
    scene: &PreparedScene,
    pairs: &[ViewPair],
    has_bent: bool,
    watch: &(dyn Fn(u32) -> bool + Sync),
) -> Result<OcclusionSums, OcclusionError> {
    if scene.normals.is_empty() || scene.triangles.is_empty() {
        return Ok(OcclusionSums::new(scene.normals.len(), has_bent));
    }
    let failed = |error: GpuError| OcclusionError::Gpu(error.to_string());
    let sum_words = if has_bent { 5 } else { 2 };
    let maps = OcclusionMaps::open(OcclusionScene {
        places: &scene.places,
        triangles: &scene.triangles,
        normals: &scene.normals,
        size_px: scene.frame.size_px,
        sum_words,
    });
    let maps = maps.map_err(failed)?;
    let mut done = 0;
    for some in pairs.chunks(PAIRS_AT_ONCE) {
        for pair in some {
            maps.add(&uniform(*pair, scene.frame, scene.normals.len() as u32, sum_words));
        }
        maps.wait().map_err(failed)?;
        done += 2 * some.len() as u32;
        if !watch(done) {
            return Err(OcclusionError::Cancelled);
        }
    }
    let words = maps.read().map_err(failed)?;
    let mut sums = OcclusionSums::new(0, false);
    for words in words.chunks_exact(sum_words as usize) {
        sums.shares.push(VertexSum { visible: words[0], all: words[1] });
        if let [_, _, x, y, z] = *words {
            sums.bent.push([x, y, z].map(u32::cast_signed));
        }
    }
    Ok(sums)
}

fn uniform(pair: ViewPair, frame: MapFrame, vertices: u32, sum_words: u32) -> OcclusionUniform {
    let [right, down, towards] = pair.axes;
    OcclusionUniform {
        right,
        vertices,
        down,
        middle: frame.middle(),
        towards,
        subtexel_bits: SUBTEXEL_BITS,
        map_shift: frame.product_shift() - OCCLUSION_SPLIT,
        depth_shift: UNIT_SHIFT - OCCLUSION_SPLIT,
        cosine_shift: COSINE_SHIFT,
        cosine_bits: COSINE_BITS,
        texel_steps: frame.texel_steps(),
        clip_scale: 1.0 / frame.middle() as f32,
        depth_scale: DEPTH_SCALE,
        sum_words,
        bias_texels: BIAS_TEXELS,
        bias_per_slope: BIAS_PER_SLOPE,
        max_bias_slope: MAX_BIAS_SLOPE,
        max_slope: MAX_SLOPE,
    }
}
