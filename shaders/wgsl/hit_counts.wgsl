// Counts the pixels of each node of the draw list. CPU twin: src/cpu/hit_counts.rs.
//
// A thread counts HIT_BLOCK_PX x HIT_BLOCK_PX pixels, most of which hit the same node: one atomic addition for each run
// of equal ones.

struct HitCountsSize {
    width_px: u32,
    height_px: u32,
}

@group(0) @binding(BINDING_COUNTS_SIZE) var<uniform> size: HitCountsSize;
@group(0) @binding(BINDING_COUNTS_HIT) var<storage, read> pixel_hit: array<u32>;
@group(0) @binding(BINDING_COUNTS) var<storage, read_write> node_pixels: array<atomic<u32>>;

fn add(node: u32, run: u32) {
    if run > 0u && node < arrayLength(&node_pixels) {
        atomicAdd(&node_pixels[node], run);
    }
}

@compute @workgroup_size(HIT_COUNTS_THREADS)
fn hit_counts(@builtin(global_invocation_id) id: vec3<u32>) {
    let across = (size.width_px + HIT_BLOCK_PX - 1u) / HIT_BLOCK_PX;
    let low = vec2<u32>(id.x % across, id.x / across) * HIT_BLOCK_PX;
    if low.y >= size.height_px {
        return;
    }
    let high = min(low + HIT_BLOCK_PX, vec2<u32>(size.width_px, size.height_px));
    var node = 0u;
    var run = 0u;
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let next = pixel_hit[y * size.width_px + x];
            if next != node {
                add(node, run);
                node = next;
                run = 0u;
            }
            run++;
        }
    }
    add(node, run);
}
