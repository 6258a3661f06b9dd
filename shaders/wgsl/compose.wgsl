// Draws the ray-caster's pixels on a render target, scaled to the nearest pixel.
//
// In: the ray-caster's pixels, distances, their shade, the exposure. Out: a render target. Next: the overlay.

@group(0) @binding(BINDING_COMPOSE_COLOUR) var<storage, read> pixel_colour: array<u32>;
@group(0) @binding(BINDING_COMPOSE_EXPOSURE) var<storage, read> exposure: array<f32>;
@group(0) @binding(BINDING_COMPOSE_SHADE) var<storage, read> block_shade: array<f32>;

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
    let light = decode_radiance(word) * (exposure[0] * edge_factor(vec2<i32>(at)));
    if settings.grade.x > 0.0 {
        let longer = select(exposure[0] / settings.grade.x, 1.0, settings.exposure > 0.0);
        return vec4<f32>(srgb_of_linear(clamp(neutral(light, longer), vec3<f32>(0.0), vec3<f32>(1.0))) + noise, 1.0);
    }
    return vec4<f32>(srgb_of_linear(tone_map(light)) + noise, 1.0);
}

// Factor for the lines at silhouettes and the shade where surfaces meet.
fn edge_factor(at: vec2<i32>) -> f32 {
    var factor = 1.0;
    if settings.edges.x > 0.0 && distance_at(at) < LONGEST_M {
        factor -= settings.edges.x * line(at);
    }
    if settings.edges.y > 0.0 {
        factor *= 1.0 - settings.edges.y * mean_around(at);
    }
    return factor;
}

// How much of a line a pixel has. Around a hole of one pixel is none.
fn line(at: vec2<i32>) -> f32 {
    let own = inverse_depth(at);
    let least = LINE_BEGIN * own;
    let across = nearer(at, own, vec2<i32>(1, 0));
    let down = nearer(at, own, vec2<i32>(0, 1));
    if max(across, down) <= least {
        return 0.0;
    }
    let most = max(min(across, nearer(at, own, vec2<i32>(2, 0))), min(down, nearer(at, own, vec2<i32>(0, 2))));
    let t = clamp((most - least) / (own * (LINE_FULL - LINE_BEGIN)), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t) * clamp(1.0 - 1.0 / (own * LINE_FAR_M), 0.0, 1.0);
}

// How much nearer a pixel is than the mean of two others on opposite sides, in inverse depth.
fn nearer(at: vec2<i32>, own: f32, step: vec2<i32>) -> f32 {
    return own - 0.5 * (inverse_depth(at - step) + inverse_depth(at + step));
}

// Mean shade of the four blocks around a pixel, which have the taps of all phases.
fn mean_around(at: vec2<i32>) -> f32 {
    let first = (at - 1) >> vec2<u32>(1u);
    var sum = 0.0;
    for (var i = 0; i < 4; i++) {
        sum += shade_at(first + vec2<i32>(i & 1, i >> 1u));
    }
    return 0.25 * sum;
}

fn shade_at(block: vec2<i32>) -> f32 {
    let blocks = vec2<i32>((settings.frame_px + 1u) / 2u);
    let at = clamp(block, vec2<i32>(0), blocks - 1);
    return block_shade[u32(at.y * blocks.x + at.x)];
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
