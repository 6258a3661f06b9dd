// Light on a surface and from the sky. CPU twin: src/cpu/shade.rs.

// Linear RGB on its way to the eye. The sun's part is separate until it is known whether the sun is visible.
struct Radiance {
    sky: vec3<f32>,
    sun: vec3<f32>,
}

// Light that the air adds in the ray's direction.
struct Airlight {
    horizon: vec3<f32>,
    glow: vec3<f32>,
}

// Computed once per ray: where each lane reads for itself, reading the light costs more than computing with it.
var<private> airlight: Airlight;

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
        case SHADING_LOD: { return unlit(level_tint(level) * debug); }
        case SHADING_KIND: { return unlit(kind_tint(flags) * debug); }
        default: { return reflected(albedo, n, ao); }
    }
}

// Light that a surface reflects.
fn reflected(albedo: vec3<f32>, n: vec3<f32>, ao: f32) -> Radiance {
    let sun = frame.light.sun.rgb * max(dot(n, frame.sun), 0.0);
    let wall = frame.light.sky_wall.rgb + frame.light.sky_side.rgb * dot(n.xy, frame.light.side);
    let sky = mix(wall, frame.light.sky_up.rgb, abs(n.z)) * ao;
    let bounced = frame.light.bounce.rgb * ((1.0 - ao) * (0.65 - 0.35 * n.z));
    return Radiance(albedo * (sky + bounced), albedo * sun * sun_share_by_sky(ao));
}

// Without shadow rays: a surface that sees little sky sees little sun.
fn sun_share_by_sky(ao: f32) -> f32 {
    return select(min(2.0 * ao + 0.25, 1.0), 1.0, frame.shadow_m > 0.0);
}

fn apply_haze(light: Radiance, distance_m: f32) -> Radiance {
    if FOR_STUDY && frame.shading != SHADING_LIT {
        return light;
    }
    let transmitted = exp(frame.light.haze.rgb * -distance_m);
    let far = airlight.horizon + airlight.glow * (1.0 - transmitted);
    return Radiance(far + (light.sky - far) * transmitted, light.sun * transmitted);
}

fn to_display(rgb: vec3<f32>) -> vec3<f32> {
    if FOR_STUDY && frame.shading != SHADING_LIT {
        return rgb;
    }
    return tone_map(rgb);
}

fn tone_map(rgb: vec3<f32>) -> vec3<f32> {
    let bright = dot(rgb, LUMINANCE);
    let v = max(mix(rgb, vec3<f32>(bright), 0.04 + 0.35 * bright / (bright + 6.0)), vec3<f32>(0.0));
    let curve = v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14);
    return min(curve, vec3<f32>(1.0));
}

fn level_tint(level: u32) -> vec3<f32> {
    let phase = f32(level * 5u % 8u) * 0.7853982;
    return 0.55 + 0.4 * cos(vec3<f32>(phase, phase - 2.094, phase + 2.094));
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
        let hazy_m = ground_m * (1.0 + 4.0 * ground_m * frame.light.haze.g);
        return apply_haze(reflected(GROUND_ALBEDO, vec3<f32>(0.0, 0.0, 1.0), 1.0), hazy_m);
    }
    return unlit(sky(dir));
}

// Metres to the plane; NO_GROUND_M if the ray misses it.
fn ground_distance(dir: vec3<f32>) -> f32 {
    if frame.ground == 0u || dir.z > -MIN_GROUND_DESCENT || frame.ground_z_m >= 0.0 {
        return NO_GROUND_M;
    }
    return frame.ground_z_m / dir.z;
}

fn sky(dir: vec3<f32>) -> vec3<f32> {
    let clear = mix(frame.light.zenith.rgb, airlight.horizon, exp(-SKY_FALL * max(dir.z, 0.0)));
    let edge = clamp((DISC_OUTER - from_sun(dir)) / (DISC_OUTER - DISC_INNER), 0.0, 1.0);
    return clear + airlight.glow + frame.light.sun.rgb * (DISC * frame.light.disc * edge);
}

fn horizon(dir: vec3<f32>) -> vec3<f32> {
    let along = dot(dir.xy, frame.light.side) / max(length(dir.xy), 1e-4);
    let sunward = 0.5 + 0.5 * along;
    return mix(frame.light.horizon_away.rgb, frame.light.horizon_sun.rgb, sunward * sunward);
}

// The sky around the sun, by the phase function of Henyey and Greenstein.
fn glow(dir: vec3<f32>) -> vec3<f32> {
    let near = GLOW / (GLOW + GLOW_G * from_sun(dir));
    return frame.light.glow.rgb * (near * sqrt(near));
}

// Squared distance from the sun on the unit sphere.
fn from_sun(dir: vec3<f32>) -> f32 {
    let apart = dir - frame.sun;
    return dot(apart, apart);
}
