// Light on what a ray meets: the GPU's twin of src/cpu/shade.rs; one module with raycast.wgsl, which has `frame` and the flags.
//
// In: texel, normal, flags, level, the frame's light. Out: light at the eye, then linear light of the screen.
// Next: raycast.wgsl gathers it.

struct Light {
    sun: vec4<f32>,
    sky_up: vec4<f32>,
    sky_wall: vec4<f32>,
    sky_side: vec4<f32>,
    bounce: vec4<f32>,
    zenith: vec4<f32>,
    horizon_sun: vec4<f32>,
    horizon_away: vec4<f32>,
    glow: vec4<f32>,
    haze: vec4<f32>,
    side: vec2<f32>,
    disc: f32,
    pad: f32,
}

// Light on its way to the eye: the sun's is apart until it is known whether the sun is seen.
struct Lit {
    sky: vec3<f32>,
    sun: vec3<f32>,
}

// What the air adds in the ray's direction.
struct Air {
    horizon: vec3<f32>,
    glow: vec3<f32>,
}

// Made once a ray: to read the light costs more than to work with it where every lane reads for itself.
var<private> air: Air;

const LIT: u32 = 0u;
const HORIZON: vec3<f32> = vec3<f32>(0.72, 0.80, 0.88);
const ZENITH: vec3<f32> = vec3<f32>(0.20, 0.38, 0.68);
const GROUND: vec3<f32> = vec3<f32>(0.36, 0.37, 0.35);
const GROUND_ALBEDO: vec3<f32> = vec3<f32>(0.24, 0.235, 0.225);
const GROUND_FADE_M: f32 = 3000.0;
const SKY_FALL: f32 = 4.5;
const GLOW: f32 = 0.0576;
const DISC_INNER: f32 = 1.7e-5;
const DISC_OUTER: f32 = 3.2e-5;
const DISC: f32 = 40.0;
const LUMINANCE: vec3<f32> = vec3<f32>(0.2126, 0.7152, 0.0722);
// A distance that no ray reaches: infinity is no constant of WGSL.
const NEVER_M: f32 = 1e30;

fn linear_of(texel: u32) -> vec3<f32> {
    let v = unpack4x8unorm(texel).rgb;
    return select(pow((v + 0.055) / 1.055, vec3<f32>(2.4)), v / 12.92, v <= vec3<f32>(0.04045));
}

fn encode_srgb(rgb: vec3<f32>) -> u32 {
    let v = clamp(rgb, vec3<f32>(0.0), vec3<f32>(1.0));
    let s = select(1.055 * pow(v, vec3<f32>(1.0 / 2.4)) - 0.055, v * 12.92, v <= vec3<f32>(0.0031308));
    let c = vec3<u32>(s * 255.0 + 0.5);
    return c.r | (c.g << 8u) | (c.b << 16u) | (255u << 24u);
}

fn plain(sky: vec3<f32>) -> Lit {
    return Lit(sky, vec3<f32>(0.0));
}

fn shade(albedo: vec3<f32>, ao: f32, n: vec3<f32>, flags: u32, level: u32) -> Lit {
    if !FOR_STUDY {
        return received(albedo, n, ao);
    }
    let debug = (0.35 + 0.65 * ao) * (0.7 + 0.3 * max(dot(n, frame.sun), 0.0));
    switch frame.shading {
        case 1u: { return plain(albedo); }
        case 2u: { return plain(vec3<f32>(ao)); }
        case 3u: { return plain(n * 0.5 + 0.5); }
        case 4u: { return plain(level_tint(level) * debug); }
        case 5u: { return plain(kind_tint(flags) * debug); }
        default: { return received(albedo, n, ao); }
    }
}

fn received(albedo: vec3<f32>, n: vec3<f32>, ao: f32) -> Lit {
    let sun = frame.light.sun.rgb * max(dot(n, frame.sun), 0.0);
    let wall = frame.light.sky_wall.rgb + frame.light.sky_side.rgb * dot(n.xy, frame.light.side);
    let sky = mix(wall, frame.light.sky_up.rgb, abs(n.z)) * ao;
    let bounced = frame.light.bounce.rgb * ((1.0 - ao) * (0.65 - 0.35 * n.z));
    return Lit(albedo * (sky + bounced), albedo * sun * sun_by_sky(ao));
}

fn sun_by_sky(ao: f32) -> f32 {
    return select(min(2.0 * ao + 0.25, 1.0), 1.0, frame.shadow_m > 0.0);
}

fn through_haze(lit: Lit, d: f32) -> Lit {
    if FOR_STUDY && frame.shading != LIT {
        return lit;
    }
    let left = exp(frame.light.haze.rgb * -d);
    let far = air.horizon + air.glow * (1.0 - left);
    return Lit(far + (lit.sky - far) * left, lit.sun * left);
}

fn develop(rgb: vec3<f32>) -> vec3<f32> {
    if FOR_STUDY && frame.shading != LIT {
        return rgb;
    }
    return tone(rgb);
}

fn tone(rgb: vec3<f32>) -> vec3<f32> {
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
    var base = vec3<f32>(0.55);
    if (flags & MESH_FLAG) != 0u {
        base = vec3<f32>(0.50, 0.30, 0.80);
    } else if (flags & (GAP | HOLES)) != 0u {
        base = vec3<f32>(0.85, 0.15, 0.12);
    } else if (flags & SUSPENDED) != 0u {
        base = vec3<f32>(0.15, 0.35, 0.90);
    } else if (flags & EXPOSED) != 0u {
        base = vec3<f32>(0.90, 0.50, 0.12);
    }
    return select(base, mix(base, vec3<f32>(0.20, 0.75, 0.25), 0.4), (flags & INCLINED) != 0u);
}

fn background(dir: vec3<f32>) -> Lit {
    let ground_m = ground_distance(dir);
    if FOR_STUDY && frame.shading != LIT {
        let sky = mix(HORIZON, ZENITH, sqrt(max(dir.z, 0.0)));
        return plain(mix(sky, GROUND, select(0.0, GROUND_FADE_M / (ground_m + GROUND_FADE_M), ground_m < NEVER_M)));
    }
    if ground_m < NEVER_M {
        let hazy_m = ground_m * (1.0 + 4.0 * ground_m * frame.light.haze.g);
        return through_haze(received(GROUND_ALBEDO, vec3<f32>(0.0, 0.0, 1.0), 1.0), hazy_m);
    }
    return plain(sky_light(dir));
}

fn ground_distance(dir: vec3<f32>) -> f32 {
    if frame.ground == 0u || dir.z > -1e-5 || frame.ground_z_m >= 0.0 {
        return NEVER_M;
    }
    return frame.ground_z_m / dir.z;
}

fn sky_light(dir: vec3<f32>) -> vec3<f32> {
    let clear = mix(frame.light.zenith.rgb, air.horizon, exp(-SKY_FALL * max(dir.z, 0.0)));
    let edge = clamp((DISC_OUTER - from_sun(dir)) / (DISC_OUTER - DISC_INNER), 0.0, 1.0);
    return clear + air.glow + frame.light.sun.rgb * (DISC * frame.light.disc * edge);
}

fn horizon(dir: vec3<f32>) -> vec3<f32> {
    let along = dot(dir.xy, frame.light.side) / max(length(dir.xy), 1e-4);
    let sunward = 0.5 + 0.5 * along;
    return mix(frame.light.horizon_away.rgb, frame.light.horizon_sun.rgb, sunward * sunward);
}

fn glow(dir: vec3<f32>) -> vec3<f32> {
    let near = GLOW / (GLOW + 0.76 * from_sun(dir));
    return frame.light.glow.rgb * (near * sqrt(near));
}

fn from_sun(dir: vec3<f32>) -> f32 {
    let apart = dir - frame.sun;
    return dot(apart, apart);
}
