// Makes translucency maps with the ray-caster. CPU twin: src/cpu/translucency_map.rs.
//
// Both words of each texel go to the buffers of colours and hits, and from there to the atlas, from which `translucency_level` makes
// the next coarser level.

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn translucency_map(@builtin(global_invocation_id) id: vec3<u32>) {
    let map = frame.translucency[frame.map_in_progress];
    let width = map.width_px;
    if id.x >= width || id.y >= width {
        return;
    }
    let words = texel_from_sun(map, id.xy);
    pixel_colour[id.y * width + id.x] = words.x;
    pixel_hit[id.y * width + id.x] = words.y;
}

// The level whose width is that of the dispatch, from the next finer one.
@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn translucency_level(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let map = frame.translucency[frame.map_in_progress];
    let half_width = groups.x * WORKGROUP_X;
    var width = map.width_px;
    var first = map.address;
    while width > 2u * half_width {
        first += 2u * width * width;
        width /= 2u;
    }
    var entered = 0.0;
    var height = 0.0;
    var normal = vec3<f32>(0.0);
    var weight = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let at = 2u * id.xy + vec2<u32>(k & 1u, k >> 1u);
        let place = first + at.y * width + at.x;
        let low = read_word(place);
        let high = read_word(place + width * width);
        if (high & MAP_OCCUPIED) != 0u {
            let share = map_entered(low) + 1e-3;
            entered += map_entered(low) * 0.25;
            height += map_height(low, map.radius_m) * share;
            normal += unpack_normal(high) * share;
            weight += share;
        }
    }
    let mean = texel_words(entered, height / max(weight, 1e-6), normal, map.radius_m);
    let words = select(vec2<u32>(0u), mean, weight > 0.0);
    pixel_colour[id.y * half_width + id.x] = words.x;
    pixel_hit[id.y * half_width + id.x] = words.y;
}

// Both segments share one loop, so that the walk's code exists only once.
fn texel_from_sun(map: TranslucencyMap, at: vec2<u32>) -> vec2<u32> {
    let axes = map_axes();
    let place = (vec2<f32>(at) + 0.5) * (2.0 / f32(map.width_px)) - 1.0;
    let start = map.centre + axes * vec3<f32>(place, 1.0) * map.radius_m;
    let origin = floor(start * ORIGINS_PER_M + 0.5) / ORIGINS_PER_M;
    let eye_m = max(length(map.centre) - map.radius_m, 0.0);
    threshold = threshold_of(at, 1u, vec2<u32>(0u));
    segment = RaySegment(origin, -axes[2], 2.0 * map.radius_m, eye_m, false);
    var seen = RayHit();
    var is_lit = true;
    loop {
        ray_hit = RayHit();
        ray_hit.distance_m = bitcast<f32>(infinity_bits());
        ray_hit.node = NO_NODE;
        if frame.levels != 0u {
            walk_grid();
        }
        if segment.to_sun {
            is_lit = !ray_hit.is_hit;
            break;
        }
        seen = ray_hit;
        let anchor = origin + segment.dir * seen.distance_m - seen.stone_point;
        if !seen.is_hit || seen.stone == 0u || distance(anchor, map.anchor) > SAME_ANCHOR_M {
            return vec2<u32>(0u);
        }
        is_lit = dot(seen.normal, axes[2]) > 0.0;
        if !is_lit || frame.shadow_m <= 0.0 {
            break;
        }
        segment = RaySegment(origin, axes[2], frame.shadow_m, eye_m, true);
    }
    let cosine = dot(seen.normal, axes[2]);
    let entered = select(0.0, entered_share(map.alpha, cosine), is_lit);
    let height_m = dot(origin - axes[2] * seen.distance_m - map.centre, axes[2]);
    return texel_words(entered, height_m, seen.normal, map.radius_m);
}

fn entered_share(alpha: f32, cosine: f32) -> f32 {
    return transmitted(alpha, clamp(cosine, MIN_FACING, 1.0)) / mean_transmitted(alpha);
}

fn texel_words(entered: f32, height_m: f32, normal: vec3<f32>, radius_m: f32) -> vec2<u32> {
    let height = u32(clamp(height_m / radius_m * 0.5 + 0.5, 0.0, 1.0) * 65535.0 + 0.5);
    let share = u32(clamp(entered, 0.0, 1.0) * 65535.0 + 0.5);
    return vec2<u32>(height | (share << 16u), pack_normal(normal) | MAP_OCCUPIED);
}

fn pack_normal(v: vec3<f32>) -> u32 {
    let n = v / max(abs(v.x) + abs(v.y) + abs(v.z), 1e-20);
    let turned = select(vec2<f32>(-1.0), vec2<f32>(1.0), n.xy >= vec2<f32>(0.0));
    let at = select((1.0 - abs(n.yx)) * turned, n.xy, n.z >= 0.0);
    let code = vec2<u32>(clamp(at * 0.5 + 0.5, vec2<f32>(0.0), vec2<f32>(1.0)) * 4095.0 + 0.5);
    return code.x | (code.y << 12u);
}
