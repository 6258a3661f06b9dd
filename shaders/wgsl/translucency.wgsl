// Light that a translucency map sends through a stone. CPU twin: src/cpu/translucency.rs.

// src/translucency/mod.rs documents the fields.
struct TranslucencyMap {
    centre: vec3<f32>,
    radius_m: f32,
    anchor: vec3<f32>,
    address: u32,
    transport: vec3<f32>,
    width_px: u32,
    depth_m: vec3<f32>,
    taps: u32,
    height_m: vec3<f32>,
    reach_m: f32,
    share: vec3<f32>,
    alpha: f32,
}

// Light that enters around a place of the map.
struct EntryTap {
    // Share of the sun's light.
    entered: f32,
    // Relative to the centre of the map.
    point: vec3<f32>,
    normal: vec3<f32>,
    is_surface: bool,
}

// The part of a ring that a tap stands for.
struct Sector {
    // Share of the ring.
    share: f32,
    // Squares of the tap's radius and of the ring's radii.
    square: f32,
    inner: f32,
    outer: f32,
    // Side of a texel of the tap's level.
    texel_m: f32,
}

// The axes of a map: to the right, up, and towards the sun.
fn map_axes() -> mat3x3<f32> {
    let right = vec3<f32>(-frame.light.side.y, frame.light.side.x, 0.0);
    return mat3x3<f32>(right, cross(frame.sun, right), frame.sun);
}

// Irradiance that a matt surface needs to send the light that leaves the stone at `p`, which is relative to the camera.
fn gathered(number: u32, p: vec3<f32>) -> vec3<f32> {
    let map = frame.translucency[number];
    let axes = map_axes();
    let point = p - map.centre;
    let texel_m = 2.0 * map.radius_m / f32(map.width_px);
    let first = entry_tap(number, axes, point, point, 0u);
    let facing = dot(first.normal, axes[2]);
    let plane = unit_or(first.normal + axes[2] * max(MIN_ENTRY_COSINE - facing, 0.0), axes[2]);
    let cosine = dot(plane, axes[2]);
    let along = unit_or(axes[0] - plane * dot(plane, axes[0]), axes[1]);
    let across = cross(plane, along);
    // Along the normal: at grazing light, heights along the sun's rays are known less well.
    let depth_below = dot(first.point - point, plane);
    let thickness_m = select(0.0, max(abs(depth_below) - HEIGHT_SLACK * texel_m, 0.0), first.is_surface);
    let depth_m = map.depth_m.y;
    let from_sources = FIRST_RADIUS * sqrt(depth_m * depth_m + thickness_m * thickness_m);
    let base = max(from_sources, FIRST_TEXELS * texel_m / sqrt(cosine));
    let is_fine = map.taps >= FINE_TAPS;
    let rings = select(FAST_RING_COUNT, FINE_RING_COUNT, is_fine);
    let taps = select(FAST_RING_TAPS, FINE_RING_TAPS, is_fine);
    let reach_m = sqrt((2.0 * thickness_m + map.reach_m) * map.reach_m);
    let growth = pow(max(reach_m / base, 1.1), 1.0 / f32(rings));
    let centre = select(point, point + plane * depth_below, first.is_surface);
    var sum = light_through(number, point, first, Sector(1.0, 0.0, 0.0, base * base, texel_m));
    var near = base;
    for (var ring = 0u; ring < rings; ring++) {
        let far = near * growth;
        let radius = sqrt(near * far);
        let side = sqrt(TAU * 0.5 * (far * far - near * near) / f32(taps) * cosine);
        let level = u32(log2(max(side / texel_m, 1.0)));
        let level_texel_m = texel_m * f32(1u << min(level, 16u));
        let sector = Sector(1.0 / f32(taps), near * far, near * near, far * far, level_texel_m);
        for (var k = 0u; k < taps; k++) {
            let turn = TAU * (f32(k) / f32(taps) + f32(ring) * RING_TURN);
            let place = centre + (along * cos(turn) + across * sin(turn)) * radius;
            sum += light_through(number, point, entry_tap(number, axes, point, place, level), sector);
        }
        near = far;
    }
    return sum * map.share * cosine;
}

fn unit_or(v: vec3<f32>, other: vec3<f32>) -> vec3<f32> {
    let square = dot(v, v);
    return select(other, v * inverseSqrt(square), square > 1e-12);
}

// What leaves at the point of the light that enters in the sector of a tap.
fn light_through(number: u32, point: vec3<f32>, tap: EntryTap, sector: Sector) -> vec3<f32> {
    if tap.entered <= 0.0 {
        return vec3<f32>(0.0);
    }
    let offset = point - tap.point;
    let exact = dot(offset, tap.normal);
    let slack = HEIGHT_SLACK * sector.texel_m;
    let height = exact - clamp(exact, -slack, slack);
    let flat = max(dot(offset, offset) - exact * exact, 0.0);
    let ratio = clamp(flat / max(sector.square, 1e-20), MIN_STRETCH, 1.0 / MIN_STRETCH);
    let stretch = select(1.0, ratio, sector.square > 0.0);
    let rest = max(flat - sector.square * stretch, 0.0);
    let inner = sector.inner * stretch + rest;
    let outer = sector.outer * stretch + rest;
    let depth = frame.translucency[number].depth_m;
    let source = frame.translucency[number].height_m;
    let real = light_of_source(number, height + depth, inner, outer) * depth;
    let virtual_part = light_of_source(number, height - source, inner, outer) * source;
    return (real + virtual_part) * (tap.entered * sector.share / stretch);
}

// Integral of the light of a source at height `z` between two squares of radii, by colour.
fn light_of_source(number: u32, z: vec3<f32>, inner: f32, outer: f32) -> vec3<f32> {
    return decay(number, inner + z * z) - decay(number, outer + z * z);
}

fn decay(number: u32, square: vec3<f32>) -> vec3<f32> {
    let depth = frame.translucency[number].depth_m;
    let length = sqrt(max(square, depth * depth));
    return exp(-frame.translucency[number].transport * length) / length;
}

// The texels of a level around the place of `at`, of the surface that is nearest to the point's height.
fn entry_tap(number: u32, axes: mat3x3<f32>, point: vec3<f32>, at: vec3<f32>, level: u32) -> EntryTap {
    let radius_m = frame.translucency[number].radius_m;
    var width = frame.translucency[number].width_px;
    var first = frame.translucency[number].address;
    for (var k = 0u; k < level; k++) {
        if width > COARSEST_PX {
            first += 2u * width * width;
            width /= 2u;
        }
    }
    let side_m = 2.0 * radius_m;
    let place = vec2<f32>(dot(at, axes[0]), dot(at, axes[1]));
    let texel = (place / side_m + 0.5) * f32(width) - 0.5;
    let corner = floor(texel);
    let part = texel - corner;
    let own = dot(point, axes[2]);
    var words: array<vec2<u32>, 4>;
    var nearest = 0.0;
    var apart = bitcast<f32>(infinity_bits());
    for (var k = 0u; k < 4u; k++) {
        words[k] = map_texel(first, width, corner + vec2<f32>(f32(k & 1u), f32(k >> 1u)));
        let height = map_height(words[k].x, radius_m);
        if (words[k].y & MAP_OCCUPIED) != 0u && abs(height - own) < apart {
            nearest = height;
            apart = abs(height - own);
        }
    }
    var entered = 0.0;
    var height = 0.0;
    var normal = vec3<f32>(0.0);
    var weight = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let step = vec2<f32>(f32(k & 1u), f32(k >> 1u));
        let weights = 1.0 - step + (step * 2.0 - 1.0) * part;
        let share = weights.x * weights.y;
        let z = map_height(words[k].x, radius_m);
        if (words[k].y & MAP_OCCUPIED) != 0u && abs(z - nearest) <= SURFACE_STEP * side_m / f32(width) {
            entered += map_entered(words[k].x) * share;
            height += z * share;
            normal += unpack_normal(words[k].y) * share;
            weight += share;
        }
    }
    let seen = axes * vec3<f32>(place, height / max(weight, 1e-6));
    return EntryTap(entered, seen, unit_or(normal, axes[2]), weight > 0.0);
}

fn map_texel(first: u32, width: u32, at: vec2<f32>) -> vec2<u32> {
    let last = f32(width) - 1.0;
    if any(at < vec2<f32>(0.0)) || any(at > vec2<f32>(last)) {
        return vec2<u32>(0u);
    }
    let place = first + u32(at.y) * width + u32(at.x);
    return vec2<u32>(read_word(place), read_word(place + width * width));
}

// Height of a texel towards the sun, from the centre of a map.
fn map_height(word: u32, radius_m: f32) -> f32 {
    return (f32(word & 0xffffu) * (2.0 / 65535.0) - 1.0) * radius_m;
}

// Share of the sun's light that enters at a texel.
fn map_entered(word: u32) -> f32 {
    return f32(word >> 16u) / 65535.0;
}

// 1 + number of the map of the landmark whose stone pattern begins at `anchor`; 0 without one.
fn map_of(anchor: vec3<f32>) -> u32 {
    for (var k = 0u; k < MAX_MAPS; k++) {
        if frame.translucency[k].width_px != 0u && distance(anchor, frame.translucency[k].anchor) <= SAME_ANCHOR_M {
            return k + 1u;
        }
    }
    return 0u;
}
