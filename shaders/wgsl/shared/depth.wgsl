// Inverse depths of a frame's pixels. CPU twin: src/compose.rs.

@group(0) @binding(BINDING_COMPOSE_SETTINGS) var<uniform> settings: ComposeUniform;
@group(0) @binding(BINDING_COMPOSE_DISTANCE) var<storage, read> pixel_distance_m: array<f32>;

// Distances of pixels that show no node are infinite.
const LONGEST_M: f32 = 1e30;

fn last_pixel() -> vec2<i32> {
    return vec2<i32>(settings.frame_px) - 1;
}

fn distance_at(at: vec2<i32>) -> f32 {
    return pixel_distance_m[u32(at.y) * settings.frame_px.x + u32(at.x)];
}

// The middle of a pixel: -1 to 1 to the right and down.
fn ndc_of(at: vec2<i32>) -> vec2<f32> {
    return (vec2<f32>(at) + 0.5) / vec2<f32>(settings.frame_px) * 2.0 - 1.0;
}

// Of the pixel nearest to `place`. What lies below the plane counts as being on it.
fn inverse_depth(place: vec2<i32>) -> f32 {
    let at = clamp(place, vec2<i32>(0), last_pixel());
    let ndc = ndc_of(at);
    let of_plane = max(dot(settings.plane.xyz, vec3<f32>(1.0, ndc.x, -ndc.y)), 0.0);
    let distance_m = distance_at(at);
    if distance_m < LONGEST_M {
        let across = ndc * settings.tan;
        return max(sqrt(1.0 + dot(across, across)) / distance_m, of_plane);
    }
    return of_plane;
}
