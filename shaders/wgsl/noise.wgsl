// Gradient noise and its sums, filtered by what a pixel covers. CPU twin: src/cpu/noise.rs.

fn perlin(p: vec3<f32>) -> vec4<f32> {
    let cell = floor(p);
    let at = bitcast<vec3<u32>>(vec3<i32>(cell));
    let f = p - cell;
    let west = scramble(at.x);
    let east = scramble(at.x + 1u);
    let columns = vec4<u32>(
        scramble(west + at.y),
        scramble(east + at.y),
        scramble(west + (at.y + 1u)),
        scramble(east + (at.y + 1u)),
    );
    let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let slope = f * f * (f * (f - 2.0) + 1.0) * 30.0;
    let low = noise_layer(columns, at.z, f, u);
    let high = noise_layer(columns, at.z + 1u, f - vec3<f32>(0.0, 0.0, 1.0), u);
    let sum = mix(low.sum, high.sum, u.z);
    let across = mix(low.slope, high.slope, u.z);
    let gradient = sum.xyz + slope * vec3<f32>(across, high.sum.w - low.sum.w);
    return vec4<f32>(gradient, sum.w) * NOISE_SCALE;
}

// Four corners at one height, blended: gradient and value, and how the value grows eastwards and northwards.
struct NoiseLayer {
    sum: vec4<f32>,
    slope: vec2<f32>,
}

fn noise_layer(columns: vec4<u32>, z: u32, f: vec3<f32>, u: vec3<f32>) -> NoiseLayer {
    let south_west = noise_corner(columns.x + z, f);
    let south_east = noise_corner(columns.y + z, f - vec3<f32>(1.0, 0.0, 0.0));
    let north_west = noise_corner(columns.z + z, f - vec3<f32>(0.0, 1.0, 0.0));
    let north_east = noise_corner(columns.w + z, f - vec3<f32>(1.0, 1.0, 0.0));
    let south = mix(south_west, south_east, u.x);
    let north = mix(north_west, north_east, u.x);
    let along = mix(south_east.w - south_west.w, north_east.w - north_west.w, u.y);
    return NoiseLayer(mix(south, north, u.y), vec2<f32>(along, north.w - south.w));
}

fn noise_corner(column: u32, offset: vec3<f32>) -> vec4<f32> {
    let gradient = gradient_of(scramble(column));
    return vec4<f32>(gradient, dot(gradient, offset));
}

fn gradient_of(hash: u32) -> vec3<f32> {
    return vec3<f32>(vec3<u32>(hash, hash >> 10u, hash >> 20u) & vec3<u32>(1023u)) / 511.5 - 1.0;
}

// Share of an octave that a footprint, in cells, leaves.
fn octave_share(footprint: f32) -> f32 {
    let x = clamp(0.75 / max(footprint, MIN_FOOTPRINT) - 1.0, 0.0, 1.0);
    return x * x * (3.0 - 2.0 * x);
}

fn next_octave(p: vec3<f32>, lacunarity: f32) -> vec3<f32> {
    return OCTAVE_TURN * p * lacunarity + 0.5;
}

struct NoiseSum {
    value: f32,
    // Variance that the footprint took from it.
    hidden: f32,
}

fn fbm(p: vec3<f32>, octaves: u32, persistence: f32, footprint: f32) -> NoiseSum {
    return sum_octaves(p, octaves, persistence, footprint, false);
}

fn turbulence(p: vec3<f32>, octaves: u32, persistence: f32, footprint: f32) -> NoiseSum {
    return sum_octaves(p, octaves, persistence, footprint, true);
}

fn sum_octaves(start: vec3<f32>, octaves: u32, persistence: f32, start_footprint: f32, is_folded: bool) -> NoiseSum {
    var p = start;
    var footprint = start_footprint;
    var amplitude = 1.0;
    var sum = 0.0;
    var hidden = 0.0;
    var total = 0.0;
    let variance = select(NOISE_VARIANCE, NOISE_ABS_VARIANCE, is_folded);
    for (var i = 0u; i < octaves; i++) {
        let share = octave_share(footprint);
        if share > 0.0 {
            let noise = perlin(p).w;
            sum += amplitude * share * select(noise, abs(noise) - NOISE_ABS, is_folded);
        }
        hidden += amplitude * amplitude * (1.0 - share * share) * variance;
        total += amplitude;
        amplitude *= persistence;
        footprint *= 2.0;
        p = next_octave(p, 2.0);
    }
    return NoiseSum(sum / max(total, 1e-6), hidden / max(total * total, 1e-6));
}
