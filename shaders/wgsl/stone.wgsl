// Colour and gloss of a stone at a point. CPU twin: src/cpu/stone.rs.

// src/stone/definition.rs documents the fields, tests/twin_stone.rs compares their offsets.
struct Stone {
    base: vec3<f32>,
    kind: u32,
    vein: vec3<f32>,
    cells_per_m: f32,
    grain: vec3<f32>,
    octaves: u32,
    f0: vec3<f32>,
    refraction: f32,
    alpha: vec2<f32>,
    vein_width: f32,
    veins: u32,
    blend: vec2<f32>,
    variation: f32,
    bend: f32,
    scattering: vec3<f32>,
    scattering_scale: f32,
    absorption: vec3<f32>,
    unused: f32,
}

struct StoneSurface {
    albedo: vec3<f32>,
    f0: vec3<f32>,
    // Roughness along `tangent` and across it.
    alpha: vec2<f32>,
    tangent: vec3<f32>,
}

// `p_m` is in metres from the object's origin, `footprint_m` the side of what the pixel covers.
fn stone_surface(stone: Stone, p_m: vec3<f32>, normal: vec3<f32>, ao: f32, footprint_m: f32) -> StoneSurface {
    let footprint = footprint_m * stone.cells_per_m;
    let straight = p_m * stone.cells_per_m;
    let p = next_octave(straight, 1.0);
    var surface = StoneSurface(stone.base, stone.f0, stone.alpha, tangent_of(normal));
    switch stone.kind {
        case STONE_MARBLE: { surface.albedo = marble(stone, p, footprint); }
        case STONE_GRANITE: { surface.albedo = granite(stone, p, footprint); }
        case STONE_BRONZE: {
            let exposure = PATINA_UPWARDS * normal.z + PATINA_OPEN * (ao - 0.6);
            surface = bronze(stone, surface, straight, exposure, footprint);
        }
        case STONE_LIMESTONE: { surface.albedo = limestone(stone, straight, footprint); }
        case STONE_WOOD: { surface.albedo = limestone(stone, wood_place(straight), footprint); }
        default: {}
    }
    return surface;
}

fn tangent_of(normal: vec3<f32>) -> vec3<f32> {
    let size = length(normal.xy);
    if size > 1e-3 {
        return vec3<f32>(-normal.y / size, normal.x / size, 0.0);
    }
    return vec3<f32>(1.0, 0.0, 0.0);
}

fn faded_noise(p: vec3<f32>, footprint: f32) -> vec4<f32> {
    let share = octave_share(footprint);
    if share > 0.0 {
        return perlin(p) * share;
    }
    return vec4<f32>(0.0);
}

fn marble(stone: Stone, straight: vec3<f32>, footprint: f32) -> vec3<f32> {
    let p = straight * vec3<f32>(VEIN_STRETCH, 1.0, 1.0);
    let slow = faded_noise(next_octave(p, BEND_FREQUENCY), footprint * BEND_FREQUENCY);
    let quick = faded_noise(next_octave(p, CRINKLE_FREQUENCY), footprint * CRINKLE_FREQUENCY);
    let places = fbm(next_octave(p, PLACE_FREQUENCY), 2u, 0.6, footprint * PLACE_FREQUENCY);
    let bent = p + (slow.xyz + quick.xyz * CRINKLE) * stone.bend;
    let width = stone.vein_width * max(1.0 + WIDTH_VARIATION * slow.w, MIN_WIDTH);
    let broad = veins(stone, bent, width, footprint, BROAD_LACUNARITY);
    let fine_start = next_octave(bent, FINE_LACUNARITY);
    let fine = veins(stone, fine_start, width * FINE_WIDTH, footprint * FINE_LACUNARITY, FINE_LACUNARITY);
    let is_used = (vec2<u32>(stone.veins) & vec2<u32>(BROAD_VEINS, FINE_VEINS)) != vec2<u32>(0u);
    let blend = select(vec2<f32>(0.0), stone.blend, is_used);
    let tone = max(1.0 + stone.variation * (broad.cloud + 2.0 * places.value), 0.0);
    let ground = stone.base * tone;
    let veined = mix(ground, stone.vein, broad.share * blend.x * ramp(0.0, places, PLACE_CONTRAST));
    return mix(veined, stone.grain, fine.share * blend.y * ramp(0.0, places, -PLACE_CONTRAST));
}

struct VeinSum {
    share: f32,
    cloud: f32,
}

fn veins(stone: Stone, start: vec3<f32>, width: f32, start_footprint: f32, lacunarity: f32) -> VeinSum {
    var p = start;
    var footprint = start_footprint;
    var amplitude = 1.0;
    var share = 0.0;
    var cloud = 0.0;
    let mean = vein_mean(width, 0.0);
    for (var i = 0u; i < stone.octaves; i++) {
        let left = octave_share(footprint);
        var vein = mean;
        if left > 0.0 {
            let noise = perlin(p);
            let spread = length(noise.xyz) * footprint * (1.0 + BENT_SLOPE * stone.bend);
            vein += left * (vein_profile(noise.w, spread, width) - vein_mean(width, spread));
            cloud += noise.w * left * amplitude;
        }
        share += (1.0 - share) * vein * amplitude;
        amplitude /= VEIN_FALL;
        p = next_octave(p, lacunarity);
        footprint *= lacunarity;
    }
    return VeinSum(share, cloud);
}

fn vein_mean(width: f32, spread: f32) -> f32 {
    let density = NOISE_DENSITY / (1.0 - NOISE_DENSITY_BEND / (24.0 * NOISE_DENSITY) * spread * spread);
    return width * (density * 16.0 / 15.0 + NOISE_DENSITY_BEND * width * width * 8.0 / 105.0);
}

fn vein_profile(noise: f32, spread: f32, width: f32) -> f32 {
    let half_spread = 0.5 * max(spread / width, 0.02);
    let middle = noise / width;
    return (vein_integral(middle + half_spread) - vein_integral(middle - half_spread)) / (2.0 * half_spread);
}

fn vein_integral(at: f32) -> f32 {
    let u = clamp(at, -1.0, 1.0);
    let square = u * u;
    return u * (1.0 + square * (square * 0.2 - 2.0 / 3.0));
}

fn granite(stone: Stone, p: vec3<f32>, footprint: f32) -> vec3<f32> {
    let bend = faded_noise(next_octave(p, GRAIN_BEND_FREQUENCY), footprint * GRAIN_BEND_FREQUENCY);
    let bent = p + bend.xyz * stone.bend;
    let large = grains(bent, footprint, stone.blend.x);
    let mica = grains(next_octave(bent, MICA_FREQUENCY), footprint * MICA_FREQUENCY, stone.blend.y);
    let specks = fbm(p, stone.octaves, GRANITE_PERSISTENCE, footprint);
    let tone = max(1.0 + stone.variation * (large.y + 2.0 * specks.value), 0.0);
    let ground = mix(stone.base, stone.vein, large.x) * tone;
    return mix(ground, stone.grain, mica.x);
}

fn grains(p: vec3<f32>, footprint: f32, share: f32) -> vec2<f32> {
    let left = octave_share(footprint * GRAIN_FOOTPRINT);
    let mean = vec2<f32>(share, 0.0);
    if left <= 0.0 {
        return mean;
    }
    let corner = floor(p);
    let f = p - corner;
    let cell = vec3<i32>(corner);
    var sharp = vec3<f32>(mean, 1.0) * 1e-9;
    var soft = sharp;
    for (var i = 0; i < 9; i++) {
        let column = vec2<i32>(i % 3 - 1, i / 3 - 1);
        let at = bitcast<vec2<u32>>(cell.xy + column);
        let hash_of_column = scramble(scramble(at.x) + at.y);
        for (var k = -1; k <= 1; k++) {
            let hash = scramble(hash_of_column + bitcast<u32>(cell.z + k));
            let point = vec3<f32>(vec3<u32>(hash, hash >> 10u, hash >> 20u) & vec3<u32>(1023u));
            let offset = vec3<f32>(vec3<i32>(column, k)) - f + point / 1023.0;
            let near = 1.0 - dot(offset, offset);
            if near > 0.0 {
                let of_cell = scramble(hash ^ 0x5bd1e995u);
                let is_of_share = f32(of_cell & 0xffffu) < share * 65536.0;
                let value = vec3<f32>(select(0.0, 1.0, is_of_share), f32(of_cell >> 16u) / 65535.0 - 0.5, 1.0);
                let square = near * near;
                let eighth = square * square * square * square;
                let weight = eighth * eighth;
                soft += value * weight;
                sharp += value * (weight * weight * weight * weight);
            }
        }
    }
    let found = mix(sharp / sharp.z, soft / soft.z, min(8.0 * footprint, 1.0));
    return mix(mean, found.xy, left);
}

fn bronze(stone: Stone, bare: StoneSurface, straight: vec3<f32>, exposure: f32, footprint: f32) -> StoneSurface {
    let p = next_octave(straight * vec3<f32>(1.0, 1.0, PATINA_HEIGHT), 1.0);
    let patches = fbm(p, stone.octaves, 0.65, footprint);
    let patina = ramp(stone.blend.x - 0.5 + exposure, patches, PATINA_NOISE * stone.variation);
    let creases = turbulence(next_octave(p, 2.7), min(stone.octaves, 3u), 0.75, footprint * 2.7);
    let thin = clamp(stone.blend.y * (1.0 + PATINA_CREASES * creases.value), 0.0, 1.0);
    let tarnish = clamp(1.0 - PATINA_TARNISH * creases.value, 0.0, 1.3);
    let green = mix(stone.vein, stone.grain, thin);
    return StoneSurface(
        mix(bare.albedo, green, patina),
        mix(bare.f0 * tarnish, vec3<f32>(PATINA_F0), patina),
        mix(bare.alpha, vec2<f32>(PATINA_ALPHA), patina),
        bare.tangent,
    );
}

fn ramp(at: f32, noise: NoiseSum, strength: f32) -> f32 {
    let middle = 0.5 + (at + noise.value * strength) / (2.0 * RAMP_RANGE);
    let half_range = max(sqrt(6.0 * noise.hidden) * abs(strength) / (2.0 * RAMP_RANGE), 0.1);
    let sides = ramp_integral(middle + half_range) + ramp_integral(middle - half_range);
    return (sides - 2.0 * ramp_integral(middle)) / (half_range * half_range);
}

fn ramp_integral(at: f32) -> f32 {
    let u = clamp(at, 0.0, 1.0);
    let above = max(at - 1.0, 0.0);
    return u * u * u / 6.0 + 0.5 * above * (above + 1.0);
}

fn wood_place(straight: vec3<f32>) -> vec3<f32> {
    let around = (straight.x - straight.y) * FIBRE_WIDTH;
    return vec3<f32>(straight.z * FIBRE_LENGTH, around, length(straight.xy));
}

fn limestone(stone: Stone, straight: vec3<f32>, footprint: f32) -> vec3<f32> {
    let slow = faded_noise(next_octave(straight, 0.2), footprint * 0.2);
    let flat = straight * vec3<f32>(BED_FLATNESS, BED_FLATNESS, 1.0) + vec3<f32>(0.0, 0.0, slow.w * stone.bend);
    let beds = fbm(flat + 0.37, 3u, 0.7, footprint);
    let grains = fbm(next_octave(straight, LIMESTONE_GRAINS), stone.octaves, 0.85, footprint * LIMESTONE_GRAINS);
    let ground = stone.base * (1.0 + stone.variation * slow.w);
    let bedded = mix(ground, stone.vein, stone.blend.x * ramp(0.0, beds, 1.0));
    return mix(bedded, stone.grain, stone.blend.y * ramp(-0.08, grains, 1.5));
}
