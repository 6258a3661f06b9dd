// The sea beyond the city: the plane, or generated ground that lies on it, where the city ends in water.

// Whether a surface can be generated ground.
fn is_bare(albedo: vec3<f32>, n: vec3<f32>) -> bool {
    if frame.sea_albedo.w == 0.0 || n.z < BARE_NORMAL_Z {
        return false;
    }
    return all(abs(albedo - frame.light.plane.rgb) <= vec3<f32>(BARE_TOLERANCE));
}

// Whether the plane at a place, relative to the camera, is sea.
fn is_sea(place: vec3<f32>) -> bool {
    if frame.sea_albedo.w == 0.0 || (FOR_STUDY && frame.shading != SHADING_LIT) {
        return false;
    }
    let low = frame.shore.xy;
    let high = frame.shore.zw;
    let share = (place.xy - low) / (high - low) * f32(SHORE_PARTS);
    let parts = vec2<u32>(clamp(share, vec2<f32>(0.0), vec2<f32>(f32(SHORE_PARTS) - 1.0)));
    let above = (place.xy - low) * frame.sea_albedo.w;
    let below = (high - place.xy) * frame.sea_albedo.w;
    return is_beyond(0u, parts.y, above.x) || is_beyond(1u, parts.x, above.y)
        || is_beyond(2u, parts.y, below.x) || is_beyond(3u, parts.x, below.y);
}

// Whether a place so many cells inwards from a side is in its sea.
fn is_beyond(side: u32, part: u32, inwards: f32) -> bool {
    let byte = side * SHORE_PARTS + part;
    let cells = (frame.sea[byte / 16u][(byte / 4u) % 4u] >> ((byte % 4u) * 8u)) & 0xffu;
    return cells > 0u && inwards < f32(cells);
}

// Light of the sea `distance_m` away.
fn sea(dir: vec3<f32>, distance_m: f32) -> Radiance {
    let up = vec3<f32>(0.0, 0.0, 1.0);
    let light = mirrored(reflected(frame.sea_albedo.rgb, up, 1.0), up, 1.0, dir, distance_m);
    return apply_haze_fading(light, dir, distance_m, SEA_FADE);
}
