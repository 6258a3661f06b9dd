// Draws the ray-caster's pixels on a render target, scaled to the nearest pixel.
//
// In: the ray-caster's pixels. Out: a render target. Next: the overlay.

struct ComposeSize {
    frame_px: vec2<u32>,
    target_px: vec2<u32>,
}

@group(0) @binding(BINDING_COMPOSE_SIZE) var<uniform> size: ComposeSize;
@group(0) @binding(BINDING_COMPOSE_COLOUR) var<storage, read> pixel_colour: array<u32>;

// One triangle that covers the target.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let p = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(p * 2.0 - 1.0, 0.0, 1.0);
}

fn pixel(position: vec4<f32>) -> vec4<f32> {
    let at = min(vec2<u32>(position.xy) * size.frame_px / size.target_px, size.frame_px - 1u);
    return unpack4x8unorm(pixel_colour[at.y * size.frame_px.x + at.x]);
}

@fragment
fn compose_srgb(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return pixel(position);
}

// For sRGB targets, which encode linear values.
@fragment
fn compose_linear(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(linear_of_srgb(pixel(position).rgb), 1.0);
}
