// What shines at night: stars, the moon, lit windows. CPU twin: src/cpu/night.rs.

fn stars(dir: vec3<f32>) -> f32 {
    if frame.light.stars <= 0.0 {
        return 0.0;
    }
    let place = dir * STAR_CELLS;
    let cell = floor(place);
    let hash = scramble_cell(vec3<i32>(cell));
    if hash % STAR_RARITY != 0u {
        return 0.0;
    }
    let magnitude = f32(hash >> 16u) / 65535.0;
    let apart = place - cell - 0.5;
    return frame.light.stars * magnitude * magnitude * magnitude * exp(-STAR_SHARPNESS * dot(apart, apart));
}

// Radiance of the moon's disc, lit by the sun from its side.
fn moon(dir: vec3<f32>) -> f32 {
    let offset = (dir - frame.light.moon.xyz) / MOON_RADIUS;
    let from_middle = dot(offset, offset);
    if frame.light.moon.w <= 0.0 || from_middle >= 1.0 {
        return 0.0;
    }
    let surface = offset - frame.light.moon.xyz * sqrt(1.0 - from_middle);
    return frame.light.moon.w * clamp(dot(surface, frame.sun) / MOON_TERMINATOR, 0.0, 1.0);
}

// Light of lamps that a surface reflects. The street is as high as the surface's column begins, or as the part below its gap ends.
fn lamp_light(hit: RayHit, n: vec3<f32>, p: vec3<f32>) -> vec3<f32> {
    let corner = nodes[hit.node].corner_and_cell_m;
    let place = p - corner.xyz;
    let street = low_of(column_word(hit.node, place - n * (0.5 * corner.w)));
    let above_m = place.z - street * bitcast<f32>(nodes[hit.node].heights.x);
    let share = clamp((LAMP_TOP_M - above_m) / LAMP_FALL_M, 0.0, 1.0);
    let upright = abs(n.z);
    let open = min(hit.ao / (0.5 + 0.5 * upright), 1.0);
    let deep = clamp(LAMP_DEPTH * (1.0 - LAMP_BEGIN - open), 0.0, 1.0);
    let near = max(deep * deep * (3.0 - 2.0 * deep), LAMPS_IN_THE_OPEN * (1.0 - upright)) * max(n.z, LAMPS_ON_WALLS);
    return hit.albedo * frame.light.street.rgb * (near * share * share);
}

// Light from windows in a wall at `p` relative to the camera.
fn lit_windows(p: vec3<f32>, n: vec3<f32>, distance_m: f32) -> vec3<f32> {
    if abs(n.z) > MAX_WINDOW_SLOPE {
        return vec3<f32>(0.0);
    }
    let place = p * BAYS_PER_M + frame.bays.xyz;
    let faces_north = abs(n.y) > abs(n.x);
    let across = select(place.y, place.x, faces_north);
    let deep = select(place.x, place.y, faces_north);
    let footprint = max(distance_m * frame.bays.w * BAYS_PER_M, 1e-3);
    let glass = covered(across, GLASS_WEST, GLASS_EAST, footprint) * covered(place.z, GLASS_LOW, GLASS_HIGH, footprint);
    let side = select(0, 2, faces_north) | select(0, 1, n.x + n.y > 0.0);
    let depth = ((bay_of(deep) >> WINDOW_DEPTH_SHIFT) << 2u) | side;
    let hash = scramble_cell(vec3<i32>(bay_of(across), bay_of(place.z), depth));
    let chance = f32(hash & 0xffffu) / 65536.0;
    let lit = glass * select(0.0, mix(WINDOW_MIN, 1.0, f32(hash >> 16u) / 65536.0), chance < LIT_SHARE);
    let mean = LIT_SHARE * (0.5 + 0.5 * WINDOW_MIN) * (GLASS_EAST - GLASS_WEST) * (GLASS_HIGH - GLASS_LOW);
    let blur = clamp(2.0 * footprint - 0.5, 0.0, 1.0);
    return frame.light.window.rgb * (lit + (mean - lit) * blur);
}

fn bay_of(v: f32) -> i32 {
    return i32(floor(v)) & (BAY_COUNT - 1);
}

// Share of a footprint around `v` that lies between two places of a unit.
fn covered(v: f32, low: f32, high: f32, footprint: f32) -> f32 {
    let within = v - floor(v);
    let below_high = clamp((high - within) / footprint + 0.5, 0.0, 1.0);
    return below_high - clamp((low - within) / footprint + 0.5, 0.0, 1.0);
}

fn scramble_cell(cell: vec3<i32>) -> u32 {
    let c = bitcast<vec3<u32>>(cell);
    return scramble(scramble(scramble(c.x) + c.y) + c.z);
}

// A word whose bits depend on all bits of another.
fn scramble(word: u32) -> u32 {
    var h = (word ^ 61u) ^ (word >> 16u);
    h *= 9u;
    h ^= h >> 4u;
    h *= 0x27d4eb2du;
    return h ^ (h >> 15u);
}
