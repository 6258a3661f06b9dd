// How a ray enters a node. CPU twin: src/cpu/node.rs.

// Sets `node_ray`, and returns the interval of the ray between the node's lowest and highest point. Empty if the first
// value is larger.
fn enter_node(index: u32, t_in: f32, t_out: f32) -> vec2<f32> {
    let corner_and_cell_m = nodes[index].corner_and_cell_m;
    let heights = nodes[index].heights;
    let cell_m = corner_and_cell_m.w;
    let scale = vec3<f32>(1.0 / cell_m, 1.0 / cell_m, 1.0 / bitcast<f32>(heights.x));
    let o = (segment.origin - corner_and_cell_m.xyz) * scale;
    let d_xy = nonzero(segment.dir.xy * scale.xy);
    var dz = segment.dir.z * scale.z;
    dz = select(dz, MIN_DIRECTION, abs(dz) < MIN_DIRECTION);
    let z_lo = bitcast<f32>(heights.y);
    let z_hi = bitcast<f32>(heights.z);
    let a = (z_lo - 1.0 - o.z) / dz;
    let b = (z_hi + 1.0 - o.z) / dz;
    let pages = nodes[index].pages;
    let summary = (heights.w >> SLOT_SHIFT) * SUMMARY_VEC4S;
    let z_shift = z_shift_of(heights.w);
    node_ray = NodeRay(index, o, vec3<f32>(d_xy, dz), 1.0 / d_xy, planes_of(pages), z_shift, summary, cell_m);
    let span = vec2<f32>(fast_max(t_in, fast_min(a, b)), fast_min(t_out, fast_max(a, b)));
    let highest = highest_on(pages, z_lo, z_hi, o.xy + d_xy * span.x, o.xy + d_xy * span.y);
    return select(span, vec2<f32>(1.0, 0.0), fast_min(z_at(span.x), z_at(span.y)) > highest);
}

fn z_shift_of(slot_and_shift: u32) -> u32 {
    return slot_and_shift & ((1u << SLOT_SHIFT) - 1u);
}

// First words of a node's planes.
fn planes_of(pages: vec4<u32>) -> vec4<u32> {
    return (pages & vec4<u32>((1u << QUARTER_SHIFT) - 1u)) * PAGE_WORDS;
}

// Highest point, with a margin of one code, of the quarters of a node that a ray crosses between two places in it.
fn highest_on(pages: vec4<u32>, z_lo: f32, z_hi: f32, a: vec2<f32>, b: vec2<f32>) -> f32 {
    let half = vec2<f32>(f32(NODE_CELLS) / 2.0);
    let apart = (a >= half) != (b >= half);
    let below = min(quarter_below(pages, a >= half), quarter_below(pages, b >= half));
    // From a quarter to the opposite one the ray crosses a third.
    return z_hi + 1.0 - select(f32(below), 0.0, all(apart)) * (z_hi - z_lo) * (1.0 / QUARTER_MAX);
}

fn quarter_below(pages: vec4<u32>, far: vec2<bool>) -> u32 {
    let row = select(pages.xy, pages.zw, far.y);
    return select(row.x, row.y, far.x) >> QUARTER_SHIFT;
}

// The word of the column at a place, which is relative to the node's corner.
fn column_word(index: u32, place: vec3<f32>) -> u32 {
    let at = place.xy / nodes[index].corner_and_cell_m.w + halves(nodes[index].leaf_offset) / LEAF_OFFSET_STEPS;
    let cell = clamp(vec2<i32>(floor(at)), vec2<i32>(0), vec2<i32>(NODE_CELLS - 1));
    return read_word(planes_of(nodes[index].pages)[WALK_PLANE] + u32(cell.y * NODE_CELLS + cell.x));
}
