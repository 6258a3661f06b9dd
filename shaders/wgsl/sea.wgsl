// The sea beyond the city: the plane, or generated ground that lies on it, where the city ends in water.

// Whether a surface can be generated ground.
fn is_bare(albedo: vec3<f32>) -> bool {
    return all(abs(albedo - frame.light.plane.rgb) <= vec3<f32>(BARE_TOLERANCE));
}

// The albedo of a surface whose normal has this height: that of the sea, if it is a part of it.
fn with_sea_albedo(albedo: vec3<f32>, upright: f32, flags: u32) -> vec3<f32> {
    let is_water = (flags & REFLECTIVE) != 0u && upright > WATER_NORMAL_Z;
    if !is_water || frame.sea_albedo.w == 0.0 || (FOR_STUDY && frame.shading != SHADING_LIT) {
        return albedo;
    }
    let is_sea = all(abs(albedo - frame.sea_albedo.rgb) <= vec3<f32>(SEA_TOLERANCE));
    return select(albedo, frame.sea_albedo.rgb, is_sea);
}

// How much of the plane, or of bare ground, at a place, relative to the camera, is sea. `upright`: the height of its normal.
fn sea_share(place: vec3<f32>, upright: f32) -> f32 {
    if frame.sea_albedo.w == 0.0 || (FOR_STUDY && frame.shading != SHADING_LIT) {
        return 0.0;
    }
    let half_size = (frame.shore.zw - frame.shore.xy) * 0.5;
    let from_middle = (place.xy - frame.shore.xy - half_size) / half_size;
    let away = max(abs(from_middle.x), abs(from_middle.y));
    if away <= 1.0 {
        return select(0.0, 1.0, upright >= BARE_NORMAL_Z && is_within(place.xy, from_middle));
    }
    return sea_beyond(from_middle / away, away - 1.0);
}

// Whether bare ground within the ends of the map is sea.
fn is_within(place: vec2<f32>, from_middle: vec2<f32>) -> bool {
    let share = (from_middle * 0.5 + 0.5) * f32(SHORE_PARTS);
    let parts = vec2<u32>(clamp(share, vec2<f32>(0.0), vec2<f32>(f32(SHORE_PARTS) - 1.0)));
    let above = (place - frame.shore.xy) * frame.sea_albedo.w;
    let below = (frame.shore.zw - place) * frame.sea_albedo.w;
    return above.x < bare_cells(shore_byte(0u, parts.y)) || above.y < bare_cells(shore_byte(1u, parts.x))
        || below.x < bare_cells(shore_byte(2u, parts.y)) || below.y < bare_cells(shore_byte(3u, parts.x));
}

// The sea goes on away from the middle. `end`: where the line from there leaves the map; `away`: in half widths from it.
fn sea_beyond(end: vec2<f32>, away: f32) -> f32 {
    let is_aside = abs(end.x) >= abs(end.y);
    let across = select(end.y, end.x, is_aside);
    let along = select(end.x, end.y, is_aside);
    let side = select(1u, 0u, is_aside) + select(2u, 0u, across < 0.0);
    let parts = (along * 0.5 + 0.5) * f32(SHORE_PARTS);
    let sharp = select(0.0, 1.0, bare_cells(shore_byte(side, min(u32(parts), SHORE_PARTS - 1u))) > 0.0);
    let place = clamp(parts - 0.5, 0.0, f32(SHORE_PARTS) - 1.0);
    let part = u32(place);
    let first = f32(shore_byte(side, part) >> 4u) / 15.0;
    let next = f32(shore_byte(side, min(part + 1u, SHORE_PARTS - 1u)) >> 4u) / 15.0;
    let blurred = first + (next - first) * (place - floor(place));
    return sharp + (blurred - sharp) * min(away / COAST_BLURS, 1.0);
}

// The byte of a part of a side; sides are numbered west, south, east, north.
fn shore_byte(side: u32, part: u32) -> u32 {
    let byte = side * SHORE_PARTS + part;
    return (frame.sea[byte / 16u][(byte / 4u) % 4u] >> ((byte % 4u) * 8u)) & 0xffu;
}

// So many cells inwards from a part, bare ground is sea.
fn bare_cells(byte: u32) -> f32 {
    return f32(byte & 0xfu);
}

// Light of a place of which `share` is sea, and the rest `land`.
fn coast(land: Radiance, share: f32, dir: vec3<f32>, distance_m: f32) -> Radiance {
    let water = sea(dir, distance_m);
    return Radiance(mix(land.sky, water.sky, share), mix(land.sun, water.sun, share));
}

// Light of the sea `distance_m` away.
fn sea(dir: vec3<f32>, distance_m: f32) -> Radiance {
    let up = vec3<f32>(0.0, 0.0, 1.0);
    let light = mirrored(reflected(frame.sea_albedo.rgb, up, 1.0), up, 1.0, dir, distance_m);
    return apply_haze_fading(light, dir, distance_m, SEA_FADE);
}
