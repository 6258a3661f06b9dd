// Occlusion of a mesh's vertices: depth maps of a direction and its opposite, then a test of each vertex. CPU twin: the
// crate `insula-occlusion`, files prepared.rs, visibility.rs and sums.rs.
//
// Products of an axis (15 bits) and a place (up to 27 bits) need more than 32 bits. A place is split after its lower
// OCCLUSION_SPLIT bits; both products are exact, and so is the sum after the lower one is shifted.

struct OcclusionUniform {
    right: vec3<i32>,
    vertices: u32,
    down: vec3<i32>,
    middle: i32,
    towards: vec3<i32>,
    subtexel_bits: u32,
    map_shift: u32,
    depth_shift: u32,
    cosine_shift: u32,
    cosine_bits: u32,
    texel_steps: f32,
    clip_scale: f32,
    depth_scale: f32,
    sum_words: u32,
    bias_texels: f32,
    bias_per_slope: f32,
    max_bias_slope: f32,
    max_slope: f32,
}

@group(0) @binding(BINDING_OCCLUSION_VIEW) var<uniform> view: OcclusionUniform;
@group(0) @binding(BINDING_OCCLUSION_PLACES) var<storage, read> places: array<i32>;
@group(0) @binding(BINDING_OCCLUSION_NORMALS) var<storage, read> normals: array<i32>;
// Not of the type for depths, which OpenGL only samples.
@group(0) @binding(BINDING_OCCLUSION_NEAR) var near_map: texture_2d<f32>;
@group(0) @binding(BINDING_OCCLUSION_FAR) var far_map: texture_2d<f32>;
@group(0) @binding(BINDING_OCCLUSION_SUMS) var<storage, read_write> sums: array<i32>;

fn dot_whole(a: vec3<i32>, b: vec3<i32>) -> i32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// The product, divided by 2^OCCLUSION_SPLIT and rounded down.
fn split_product(axis: vec3<i32>, place: vec3<i32>) -> i32 {
    let high = place >> vec3<u32>(OCCLUSION_SPLIT);
    let low = place & vec3<i32>((1i << OCCLUSION_SPLIT) - 1i);
    return dot_whole(axis, high) + (dot_whole(axis, low) >> OCCLUSION_SPLIT);
}

fn project(place: vec3<i32>) -> vec3<i32> {
    return vec3<i32>(
        (split_product(view.right, place) >> view.map_shift) + view.middle,
        (split_product(view.down, place) >> view.map_shift) + view.middle,
        split_product(view.towards, place) >> view.depth_shift,
    );
}

@vertex
fn occluder(@location(LOCATION_PLACE) place: vec3<i32>) -> @builtin(position) vec4<f32> {
    let at = project(place);
    let clip = vec2<f32>(at.xy) * view.clip_scale - 1.0;
    return vec4<f32>(clip.x, -clip.y, f32(at.z) * view.depth_scale + 0.5, 1.0);
}

// From a step of a map to the centre of its texel, in texels.
fn to_centre(at: vec2<i32>) -> vec2<f32> {
    let texel = 1i << view.subtexel_bits;
    return vec2<f32>(texel / 2i - (at & vec2<i32>(texel - 1i))) / f32(texel);
}

// Whether a vertex is seen, as `sees` of the CPU twin.
fn sees(normal: vec3<i32>, at: vec3<i32>, facing: i32) -> bool {
    let texel = at.xy >> vec2<u32>(view.subtexel_bits);
    let depth = select(textureLoad(far_map, texel, 0).x, textureLoad(near_map, texel, 0).x, facing > 0);
    // Nothing was drawn there.
    if depth == select(1.0, 0.0, facing > 0) {
        return true;
    }
    let along = vec2<f32>(f32(dot_whole(view.right, normal)), f32(dot_whole(view.down, normal)));
    let slant = sqrt(along.x * along.x + along.y * along.y);
    let cosine = max(abs(f32(facing)), slant / view.max_slope);
    let behind = (depth - 0.5) / view.depth_scale - f32(at.z);
    let in_front = select(-behind, behind, facing > 0);
    let centre = to_centre(at.xy);
    let plane = -(along.x * centre.x + along.y * centre.y);
    let bias = view.bias_texels * cosine + view.bias_per_slope * min(slant, view.max_bias_slope * cosine);
    return in_front * cosine <= view.texel_steps * (plane + bias);
}

@compute @workgroup_size(OCCLUSION_THREADS)
fn accumulate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let vertex = (group.y * groups.x + group.x) * OCCLUSION_THREADS + thread;
    if vertex >= view.vertices {
        return;
    }
    let first = vertex * 3u;
    let normal = vec3<i32>(normals[first], normals[first + 1u], normals[first + 2u]);
    let facing = dot_whole(view.towards, normal);
    let cosine = abs(facing) >> view.cosine_shift;
    let sum = vertex * view.sum_words;
    sums[sum + 1u] += cosine;
    if sees(normal, project(vec3<i32>(places[first], places[first + 1u], places[first + 2u])), facing) {
        sums[sum] += cosine;
        if view.sum_words > 2u {
            let weighted = (view.towards * cosine * sign(facing)) >> vec3<u32>(view.cosine_bits);
            sums[sum + 2u] += weighted.x;
            sums[sum + 3u] += weighted.y;
            sums[sum + 4u] += weighted.z;
        }
    }
}
