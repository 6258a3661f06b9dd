// In: the ray-caster's pixels. Out: a render target. Next: the overlay.

struct Size {
    picture_px: vec2<u32>,
    target_px: vec2<u32>,
}

@group(0) @binding(0) var<uniform> size: Size;
@group(0) @binding(1) var<storage, read> colour: array<u32>;

// One triangle that covers the target.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let p = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(p * 2.0 - 1.0, 0.0, 1.0);
}

fn pixel(position: vec4<f32>) -> vec4<f32> {
    let at = min(vec2<u32>(position.xy) * size.picture_px / size.target_px, size.picture_px - 1u);
    return unpack4x8unorm(colour[at.y * size.picture_px.x + at.x]);
}

@fragment
fn compose_srgb(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return pixel(position);
}

// An sRGB target encodes what it is given: hand it linear light.
@fragment
fn compose_linear(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let c = pixel(position);
    let low = c.rgb / 12.92;
    let high = pow((c.rgb + 0.055) / 1.055, vec3<f32>(2.4));
    return vec4<f32>(select(high, low, c.rgb <= vec3<f32>(0.04045)), 1.0);
}
