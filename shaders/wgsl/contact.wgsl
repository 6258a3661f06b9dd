// Shade where surfaces meet, of one pixel of each block of two by two. CPU twin: src/compose.rs.
//
// In: the ray-caster's distances. Out: the shade. Next: compose.wgsl.

@group(0) @binding(BINDING_COMPOSE_SHADE) var<storage, read_write> block_shade: array<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn contact(@builtin(global_invocation_id) id: vec3<u32>) {
    let blocks = (settings.frame_px + 1u) / 2u;
    if id.x < blocks.x && id.y < blocks.y {
        block_shade[id.y * blocks.x + id.x] = shade_of(vec2<i32>(id.xy));
    }
}

fn shade_of(block: vec2<i32>) -> f32 {
    let at = min(block * 2, last_pixel());
    let own = inverse_depth(at);
    let height_px = f32(settings.frame_px.y);
    let focal = 0.5 * height_px / settings.tan.y;
    let around_px = min(CONTACT_M * focal * own, height_px * CONTACT_SHARE);
    let fade = min(around_px / CONTACT_LEAST_PX - 1.0, 1.0);
    if fade <= 0.0 || distance_at(at) >= LONGEST_M {
        return 0.0;
    }
    // The tangent plane in inverse depth.
    let slope = vec2<f32>(slope_along(at, own, vec2<i32>(1, 0)), slope_along(at, own, vec2<i32>(0, 1)));
    let from_middle = ndc_of(at) * settings.tan * focal;
    let plane_m = 1.0 / length(vec3<f32>(slope * focal, own - dot(slope, from_middle)));
    let depth_m = 1.0 / own;
    let m_per_px = 1.0 / (own * focal);
    let around_m = around_px * m_per_px;
    let phase = (block.x & 1) + 2 * (block.y & 1);
    let sign = f32(1 - (phase & 2));
    var turn = select(vec2<f32>(sign, 0.0), vec2<f32>(0.0, sign), (phase & 1) == 1);
    var sum = 0.0;
    for (var tap = 0u; tap < CONTACT_TAPS; tap++) {
        let share = (f32(tap) + 0.2 + 0.2 * f32(phase)) / f32(CONTACT_TAPS);
        let place = clamp(at + vec2<i32>(round(turn * (around_px * share))), vec2<i32>(0), last_pixel());
        turn = vec2<f32>(turn.x * GOLDEN_COS - turn.y * GOLDEN_SIN, turn.x * GOLDEN_SIN + turn.y * GOLDEN_COS);
        let step = vec2<f32>(place - at);
        let depth = 1.0 / max(inverse_depth(place), 1e-9);
        let above_m = plane_m * (1.0 - max(own + dot(slope, step), 0.0) * depth);
        let squared = dot(step, step) * m_per_px * m_per_px + (depth - depth_m) * (depth - depth_m);
        let near = max(1.0 - squared / (around_m * around_m * CONTACT_REACH), 0.0);
        let risen = max(above_m - CONTACT_DEPTH_SLACK * depth_m - CONTACT_SLACK * around_m, 0.0);
        sum += risen * around_m / (squared + CONTACT_SOFT * around_m * around_m) * near * near;
    }
    return min(sum * CONTACT_GAIN / f32(CONTACT_TAPS), 1.0) * fade;
}

// The flatter one of the slopes to both sides.
fn slope_along(at: vec2<i32>, own: f32, step: vec2<i32>) -> f32 {
    let before = own - inverse_depth(at - step);
    let after = inverse_depth(at + step) - own;
    return select(after, before, abs(before) < abs(after));
}
