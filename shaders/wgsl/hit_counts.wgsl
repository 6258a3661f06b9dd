// How many pixels each node of a cut got: the GPU's twin of src/cpu/hit_counts.rs.
//
// In: the hits of raycast.wgsl. Out: a count a node. Next: read back, a frame late.
//
// A thread counts 8 x 8 pixels, most of which hit the same node: one atomic addition for each run of equal ones.

struct Size {
    width_px: u32,
    height_px: u32,
}

@group(0) @binding(0) var<uniform> size: Size;
@group(0) @binding(1) var<storage, read> hit: array<u32>;
@group(0) @binding(2) var<storage, read_write> pixels: array<atomic<u32>>;

const SIDE: u32 = 8u;

fn add(node: u32, run: u32) {
    if run > 0u && node < arrayLength(&pixels) {
        atomicAdd(&pixels[node], run);
    }
}

@compute @workgroup_size(64)
fn hit_counts(@builtin(global_invocation_id) id: vec3<u32>) {
    let across = (size.width_px + SIDE - 1u) / SIDE;
    let low = vec2<u32>(id.x % across, id.x / across) * SIDE;
    if low.y >= size.height_px {
        return;
    }
    let high = min(low + SIDE, vec2<u32>(size.width_px, size.height_px));
    var node = 0u;
    var run = 0u;
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let here = hit[y * size.width_px + x];
            if here != node {
                add(node, run);
                node = here;
                run = 0u;
            }
            run++;
        }
    }
    add(node, run);
}
