// Light on what a ray meets: the GPU's twin of src/cpu/shade.rs; one module with raycast.wgsl, which has `frame` and the flags.
//
// In: texel, normal, flags, level. Out: linear light. Next: raycast.wgsl gathers it.

const SUN: vec3<f32> = vec3<f32>(1.08, 0.98, 0.84);
const SKY: vec3<f32> = vec3<f32>(0.46, 0.54, 0.66);
const BOUNCE: vec3<f32> = vec3<f32>(0.26, 0.24, 0.22);
const HORIZON: vec3<f32> = vec3<f32>(0.72, 0.80, 0.88);
const ZENITH: vec3<f32> = vec3<f32>(0.20, 0.38, 0.68);
const GROUND: vec3<f32> = vec3<f32>(0.36, 0.37, 0.35);
const EXPOSURE: f32 = 1.25;
const GROUND_FADE_M: f32 = 3000.0;

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

fn shade(texel: u32, n: vec3<f32>, flags: u32, level: u32) -> vec3<f32> {
    let albedo = linear_of(texel);
    let ao = f32(texel >> 26u) / 63.0;
    let facing = max(dot(n, frame.sun), 0.0);
    let debug = (0.35 + 0.65 * ao) * (0.7 + 0.3 * facing);
    switch frame.shading {
        case 1u: { return albedo; }
        case 2u: { return vec3<f32>(ao); }
        case 3u: { return n * 0.5 + 0.5; }
        case 4u: { return level_tint(level) * debug; }
        case 5u: { return kind_tint(flags) * debug; }
        default: {
            let bounced = (1.0 - ao) * (0.65 - 0.35 * n.z);
            let sky = SKY * ao + BOUNCE * bounced;
            let sun = SUN * facing * min(2.0 * ao + 0.25, 1.0);
            return tone(albedo * (sky + sun));
        }
    }
}

fn tone(rgb: vec3<f32>) -> vec3<f32> {
    return 1.0 - exp(-EXPOSURE * rgb);
}

fn level_tint(level: u32) -> vec3<f32> {
    let phase = f32(level * 5u % 8u) * 0.7853982;
    return 0.55 + 0.4 * cos(vec3<f32>(phase, phase - 2.094, phase + 2.094));
}

fn kind_tint(flags: u32) -> vec3<f32> {
    var base = vec3<f32>(0.55);
    if (flags & (GAP | HOLES)) != 0u {
        base = vec3<f32>(0.85, 0.15, 0.12);
    } else if (flags & SUSPENDED) != 0u {
        base = vec3<f32>(0.15, 0.35, 0.90);
    } else if (flags & EXPOSED) != 0u {
        base = vec3<f32>(0.90, 0.50, 0.12);
    }
    return select(base, mix(base, vec3<f32>(0.20, 0.75, 0.25), 0.4), (flags & INCLINED) != 0u);
}

fn background(dir: vec3<f32>) -> vec3<f32> {
    let sky = mix(HORIZON, ZENITH, sqrt(max(dir.z, 0.0)));
    if frame.ground == 0u || dir.z > -1e-5 || frame.ground_z_m >= 0.0 {
        return sky;
    }
    let d = frame.ground_z_m / dir.z;
    return mix(GROUND, HORIZON, d / (d + GROUND_FADE_M));
}
