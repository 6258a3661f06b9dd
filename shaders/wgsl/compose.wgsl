// Draws the ray-caster's pixels on a render target, scaled to the nearest pixel.
//
// In: the ray-caster's pixels, the exposure. Out: a render target. Next: the overlay.

@group(0) @binding(BINDING_COMPOSE_SETTINGS) var<uniform> settings: ComposeUniform;
@group(0) @binding(BINDING_COMPOSE_COLOUR) var<storage, read> pixel_colour: array<u32>;
@group(0) @binding(BINDING_COMPOSE_EXPOSURE) var<storage, read> exposure: array<f32>;

// One triangle that covers the target.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let p = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(p * 2.0 - 1.0, 0.0, 1.0);
}

// In sRGB.
fn pixel(position: vec4<f32>) -> vec4<f32> {
    let at = min(vec2<u32>(position.xy) * settings.frame_px / settings.target_px, settings.frame_px - 1u);
    let word = pixel_colour[at.y * settings.frame_px.x + at.x];
    if settings.is_lit == 0u {
        return unpack4x8unorm(word);
    }
    // The target rounds to the nearest value.
    let noise = (gradient_noise(at) - 0.5) / 255.0;
    let light = decode_radiance(word) * exposure[0];
    if settings.grade.x > 0.0 {
        return vec4<f32>(srgb_of_linear(clamp(neutral(light), vec3<f32>(0.0), vec3<f32>(1.0))) + noise, 1.0);
    }
    return vec4<f32>(srgb_of_linear(tone_map(light)) + noise, 1.0);
}

@fragment
fn compose_srgb(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return pixel(position);
}

// For sRGB targets, which encode linear values.
@fragment
fn compose_linear(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(linear_of_srgb(clamp(pixel(position).rgb, vec3<f32>(0.0), vec3<f32>(1.0))), 1.0);
}
