// Light on a surface and from the sky. CPU twin: src/cpu/shade.rs.

// Linear RGB on its way to the eye. The sun's part is separate until it is known whether the sun is visible.
struct Radiance {
    sky: vec3<f32>,
    sun: vec3<f32>,
}

// The sky low above the horizon in the ray's direction: the light that haze adds. Computed once per pixel: where each
// lane reads for itself, reading the light costs more than computing with it.
var<private> airlight: vec3<f32>;

// A distance that no ray reaches, where Rust uses infinity.
const NO_GROUND_M: f32 = 1e30;

fn linear_of(texel: u32) -> vec3<f32> {
    return linear_of_srgb(unpack4x8unorm(texel).rgb);
}

fn encode_srgb(rgb: vec3<f32>) -> u32 {
    let s = srgb_of_linear(clamp(rgb, vec3<f32>(0.0), vec3<f32>(1.0)));
    let c = vec3<u32>(s * 255.0 + 0.5);
    return c.r | (c.g << 8u) | (c.b << 16u) | (255u << 24u);
}

fn unlit(sky: vec3<f32>) -> Radiance {
    return Radiance(sky, vec3<f32>(0.0));
}

fn shade(albedo: vec3<f32>, ao: f32, n: vec3<f32>, flags: u32, level: u32) -> Radiance {
    if !FOR_STUDY {
        return reflected(albedo, n, ao);
    }
    let debug = (0.35 + 0.65 * ao) * (0.7 + 0.3 * max(dot(n, frame.sun), 0.0));
    switch frame.shading {
        case SHADING_ALBEDO: { return unlit(albedo); }
        case SHADING_AO: { return unlit(vec3<f32>(ao)); }
        case SHADING_NORMAL: { return unlit(n * 0.5 + 0.5); }
        case SHADING_LOD, SHADING_BOUNDS: { return unlit(level_tint(level) * debug); }
        case SHADING_KIND: { return unlit(kind_tint(flags) * debug); }
        case SHADING_WIRE, SHADING_TRIANGLES: { return unlit(select(TINT_ROOF, albedo, (flags & MESH_FLAG) != 0u) * debug); }
        default: { return reflected(albedo, n, ao); }
    }
}

// The normal by which a surface with this albedo is lit: bare ground has less of a slope.
fn lit_normal(albedo: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    if frame.light.grade.x <= 0.0 || normal.z < BARE_NORMAL_Z || !is_bare(albedo)
        || (FOR_STUDY && frame.shading != SHADING_LIT) {
        return normal;
    }
    let kept = max(1.0 - LEVEL_SLOPE * normal.z / max(length(normal.xy), 1e-6), 0.0);
    let lit = vec3<f32>(normal.xy * kept, normal.z);
    return lit / length(lit);
}

// Light that a surface reflects.
fn reflected(albedo: vec3<f32>, n: vec3<f32>, ao: f32) -> Radiance {
    let up = frame.light.sky_up.rgb;
    let upright = abs(n.z);
    let open = min(ao / (0.5 + 0.5 * upright), 1.0);
    let ahead = dot(n.xy, frame.light.side);
    let wall = frame.light.sky_wall.rgb + frame.light.sky_wall_ahead.rgb * ahead
        + frame.light.sky_wall_axis.rgb * (ahead * ahead);
    let overhead = up * ZENITH_SHARE;
    let sky = mix(overhead + (wall - overhead) * open, up, upright) * ao;
    let returned = light_from_city(Surroundings(open, 0.5 - 0.5 * n.z, ahead, upright), ao);
    let sun = frame.light.sun.rgb * max(dot(n, frame.sun), 0.0);
    return Radiance(albedo * (sky + returned), albedo * sun * sun_share_by_sky(ao));
}

// Light of a surface of water or glass that is seen in direction `dir`: `light` below its reflection of sky, sun and city.
fn mirrored(light: Radiance, n: vec3<f32>, ao: f32, dir: vec3<f32>, distance_m: f32) -> Radiance {
    let cosine = clamp(-dot(dir, n), 0.0, 1.0);
    let upright = abs(n.z);
    var seen_at = cosine;
    if upright > 0.5 {
        seen_at = min(cosine + cosine * waves(dir, distance_m) + 0.03, 1.0);
    }
    let grazing = 1.0 - seen_at;
    let cube = grazing * grazing * grazing;
    let water = FACING_WATER + FLAT_WATER * cube * sqrt(grazing);
    let glass = FACING_REFLECTANCE + (1.0 - FACING_REFLECTANCE) * cube * grazing * grazing;
    let share = select(glass, water, upright > 0.5);
    let towards = dir + n * (cosine + seen_at);
    let open = min(ao / (0.5 + 0.5 * upright), 1.0);
    let around = reflected_light(towards, open);
    let seen = select(around.ground, around.above, towards.z > 0.0);
    let spread = PANES + (WAVES - PANES) * upright;
    let glint = exp(-from_sun(towards) / (spread * spread)) / (spread * spread);
    return Radiance(
        light.sky + (seen - light.sky) * share,
        light.sun * (1.0 - share) + frame.light.sun.rgb * (glint * share * sun_share_by_sky(ao)),
    );
}

// How far waves tilt the water that is seen, relative to the cosine at which it is seen.
fn waves(dir: vec3<f32>, distance_m: f32) -> f32 {
    let near = 1.0 - distance_m / WAVES_END_M;
    if near <= 0.0 {
        return 0.0;
    }
    let place = (dir * (distance_m * BAYS_PER_M) + frame.bays.xyz) * WAVES_PER_BAY;
    let footprint = distance_m * frame.bays.w * (BAYS_PER_M * WAVES_PER_BAY);
    return fbm(place, 3u, 0.6, footprint).value * (WAVE_TILT * near);
}

// Light that a mirror reflects from below and from above the horizon.
struct ReflectedLight {
    ground: vec3<f32>,
    above: vec3<f32>,
}

// `open`: the openness of the mirror's surroundings.
fn reflected_light(towards: vec3<f32>, open: f32) -> ReflectedLight {
    let city = frame.light.facade_sky.rgb + frame.light.facade_sun.rgb * (0.25 * open);
    let ground = frame.light.ground_sky.rgb + frame.light.ground_sun.rgb * open;
    return ReflectedLight(ground, city + (sky(towards) - city) * open);
}

// What a surface is turned to.
struct Surroundings {
    open: f32,
    below: f32,
    ahead: f32,
    upright: f32,
}

// Light that ground and facades return to a surface.
fn light_from_city(around: Surroundings, ao: f32) -> vec3<f32> {
    let reach = frame.light.sun_tan * around.open;
    let deep = 1.0 - around.open + 1e-6;
    let ground = frame.light.ground_sun.rgb * (reach / (reach + GROUND_DEPTH * deep)) + frame.light.ground_sky.rgb;
    let far = reach * sqrt(reach);
    let sunlit = far / (far + FACADE_DEPTH * deep * deep) * (0.5 - 0.5 * around.ahead);
    let facades = frame.light.facade_sun.rgb * sunlit + frame.light.facade_sky.rgb + ground * frame.light.facade_ground;
    let share = mix(FACADES_BY_WALL, FACADES_BY_GROUND, around.upright);
    return ground * around.below + facades * (share * max(1.0 - ao - around.below, 0.0));
}

// Without shadow rays: a surface that sees little sky sees little sun.
fn sun_share_by_sky(ao: f32) -> f32 {
    return select(min(2.0 * ao + 0.25, 1.0), 1.0, frame.shadow_m > 0.0);
}

fn apply_haze(light: Radiance, dir: vec3<f32>, distance_m: f32) -> Radiance {
    if FOR_STUDY && frame.shading != SHADING_LIT {
        return light;
    }
    return apply_haze_fading(light, dir, distance_m, 1.0);
}

// The same of what fades beyond the city's ends as land does times `fade`.
fn apply_haze_fading(light: Radiance, dir: vec3<f32>, distance_m: f32, fade: f32) -> Radiance {
    let transmitted = exp(frame.light.haze.rgb * -distance_m - fog_depth(dir * distance_m, distance_m, fade));
    return Radiance(airlight + (light.sky - airlight) * transmitted, light.sun * transmitted);
}

// Optical depth of the fog before a place. It hides what is far, and the land beyond the city's ends, or what fades as that times
// `fade`.
fn fog_depth(place: vec3<f32>, distance_m: f32, fade: f32) -> f32 {
    let far = max(distance_m - frame.fog.x, 0.0) * frame.fog.y;
    let past = max(max(frame.city.xy - place.xy, place.xy - frame.city.zw), vec2<f32>(0.0)) * (frame.fog.z * fade);
    let away = length(past);
    return far * sqrt(sqrt(far)) + away * sqrt(away);
}

fn level_tint(level: u32) -> vec3<f32> {
    let phase = f32(level * 5u % 8u) * 0.7853982;
    let strength = select(0.4, 0.2, level >= MESH_LEVEL);
    return 0.95 + strength * (cos(vec3<f32>(phase, phase - 2.094, phase + 2.094)) - 1.0);
}

fn kind_tint(flags: u32) -> vec3<f32> {
    var base = TINT_ROOF;
    if (flags & MESH_FLAG) != 0u {
        base = TINT_MESH;
    } else if (flags & (GAP | HOLES)) != 0u {
        base = TINT_GAP;
    } else if (flags & SUSPENDED) != 0u {
        base = TINT_SUSPENDED;
    } else if (flags & EXPOSED) != 0u {
        base = TINT_EXPOSED;
    }
    return select(base, mix(base, TINT_INCLINED, 0.4), (flags & INCLINED) != 0u);
}

// The sky, or the plane where there is no column.
fn background(dir: vec3<f32>) -> Radiance {
    let ground_m = ground_distance(dir);
    if FOR_STUDY && frame.shading != SHADING_LIT {
        let sky = mix(HORIZON, ZENITH, sqrt(max(dir.z, 0.0)));
        let near = select(0.0, GROUND_FADE_M / (ground_m + GROUND_FADE_M), ground_m < NO_GROUND_M);
        return unlit(mix(sky, GROUND, near));
    }
    if ground_m < NO_GROUND_M {
        let hazy_m = ground_m + max(ground_m - PLANE_CLEAR_M, 0.0) * PLANE_FADE;
        let land = apply_haze(reflected(frame.light.plane.rgb, vec3<f32>(0.0, 0.0, 1.0), 1.0), dir, hazy_m);
        let share = sea_share(dir * ground_m, 1.0);
        if share > 0.0 {
            return coast(land, share, dir, ground_m);
        }
        return land;
    }
    return unlit(sky(dir) + celestial_light(dir));
}

// Metres to the plane; NO_GROUND_M if the ray misses it.
fn ground_distance(dir: vec3<f32>) -> f32 {
    if frame.ground == 0u || dir.z > -MIN_GROUND_DESCENT || frame.ground_z_m >= 0.0 {
        return NO_GROUND_M;
    }
    return frame.ground_z_m / dir.z;
}

// Light that the air scatters from a direction above the horizon.
fn sky(dir: vec3<f32>) -> vec3<f32> {
    let height = sqrt(max((dir.z - SKY_LOW) / (1.0 - SKY_LOW), 0.0)) * f32(SKY_HEIGHTS - 1u);
    let row = min(u32(height), SKY_HEIGHTS - 2u);
    let column = sky_column(dir);
    let above = height - f32(row);
    let low = sky_at(row, column);
    let high = sky_at(row + 1u, column);
    return mix(low.smooth_part, high.smooth_part, above) + mix(low.forward, high.forward, above) * phase(dir);
}

// Light of the sun's disc, the moon and the stars.
fn celestial_light(dir: vec3<f32>) -> vec3<f32> {
    let edge = clamp((DISC_OUTER - from_sun(dir)) / (DISC_OUTER - DISC_INNER), 0.0, 1.0);
    return frame.light.sun.rgb * (DISC * frame.light.disc * edge) + stars(dir) + moon(dir);
}

fn low_sky(dir: vec3<f32>) -> vec3<f32> {
    let low = sky_at(0u, sky_column(dir));
    let level = vec3<f32>(dir.xy / max(length(dir.xy), 1e-4), SKY_LOW);
    return low.smooth_part + low.forward * phase(level);
}

// Column of the sky's tables in direction `dir`, with the part towards the next one.
fn sky_column(dir: vec3<f32>) -> f32 {
    let along = dot(dir.xy, frame.light.side) / max(length(dir.xy), 1e-4);
    return (0.5 + 0.5 * clamp(along, -1.0, 1.0)) * f32(SKY_AZIMUTHS - 1u);
}

struct SkyLight {
    smooth_part: vec3<f32>,
    forward: vec3<f32>,
}

fn sky_at(row: u32, column: f32) -> SkyLight {
    let left = min(u32(column), SKY_AZIMUTHS - 2u);
    let right = column - f32(left);
    let cell = row * SKY_AZIMUTHS + left;
    return SkyLight(
        mix(frame.light.sky[cell].rgb, frame.light.sky[cell + 1u].rgb, right),
        mix(frame.light.glow[cell].rgb, frame.light.glow[cell + 1u].rgb, right),
    );
}

// The phase function of Henyey and Greenstein for the angle between `dir` and the sun.
fn phase(dir: vec3<f32>) -> f32 {
    let near = 1.0 / ((1.0 - MIE_G) * (1.0 - MIE_G) + MIE_G * from_sun(dir));
    return PHASE_SCALE * near * sqrt(near);
}

// Squared distance from the sun on the unit sphere.
fn from_sun(dir: vec3<f32>) -> f32 {
    let apart = dir - frame.sun;
    return dot(apart, apart);
}
