// How a ray enters a node: part of the GPU's twin of src/cpu/raycast.rs; one module with raycast.wgsl, which has the bindings.
//
// In: a node whose square a ray crosses, from where to where. Out: `ray`, and between which places it may meet something.
// Next: raycast.wgsl walks its blocks.

fn shift_of(slot_and_shift: u32) -> u32 {
    return slot_and_shift & ((1u << SLOT_SHIFT) - 1u);
}

// Makes `ray`; gives where it is between the node's lowest and highest point (the first larger if nowhere).
fn enter_node(index: u32, t_in: f32, t_out: f32) -> vec2<f32> {
    let place = nodes[index].place;
    let z = nodes[index].z;
    let scale = vec3<f32>(1.0 / place.w, 1.0 / place.w, 1.0 / bitcast<f32>(z.x));
    let o = (leg.origin - place.xyz) * scale;
    let d_xy = nonzero(leg.dir.xy * scale.xy);
    var dz = leg.dir.z * scale.z;
    dz = select(dz, 1e-12, abs(dz) < 1e-12);
    let a = (bitcast<f32>(z.y) - 1.0 - o.z) / dz;
    let b = (bitcast<f32>(z.z) + 1.0 - o.z) / dz;
    let pages = nodes[index].pages;
    ray = NodeRay(index, o, vec3<f32>(d_xy, dz), 1.0 / d_xy, pages_of(pages), shift_of(z.w), (z.w >> SLOT_SHIFT) * SUMMARY_FOURS, place.w);
    let span = vec2<f32>(most(t_in, least(a, b)), least(t_out, most(a, b)));
    let heights = vec2<f32>(bitcast<f32>(z.y), bitcast<f32>(z.z));
    let highest = highest_on(pages, heights, o.xy + d_xy * span.x, o.xy + d_xy * span.y);
    return select(span, vec2<f32>(1.0, 0.0), least(z_at(span.x), z_at(span.y)) > highest);
}

// First words of a node's planes.
fn pages_of(pages: vec4<u32>) -> vec4<u32> {
    return (pages & vec4<u32>((1u << QUARTER_SHIFT) - 1u)) * PAGE_WORDS;
}

// The highest point, and a little more, of the quarters of a node that a ray crosses between two places in it.
fn highest_on(pages: vec4<u32>, z: vec2<f32>, a: vec2<f32>, b: vec2<f32>) -> f32 {
    let half = vec2<f32>(f32(NODE_CELLS) / 2.0);
    let apart = (a >= half) != (b >= half);
    let below = min(quarter_below(pages, a >= half), quarter_below(pages, b >= half));
    // From a quarter to the opposite one the ray crosses a third.
    return z.y + 1.0 - select(f32(below), 0.0, all(apart)) * (z.y - z.x) * (1.0 / 255.0);
}

fn quarter_below(pages: vec4<u32>, far: vec2<bool>) -> u32 {
    let row = select(pages.xy, pages.zw, far.y);
    return select(row.x, row.y, far.x) >> QUARTER_SHIFT;
}
