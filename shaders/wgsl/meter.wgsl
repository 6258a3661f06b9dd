// The exposure of a lit frame: by the mean logarithm of its pixels' luminance, of graded frames by that of the city. CPU twin:
// src/tone.rs.
//
// In: the ray-caster's pixels and hits. Out: the exposure. Next: compose.wgsl.

@group(0) @binding(BINDING_COMPOSE_SETTINGS) var<uniform> settings: ComposeUniform;
@group(0) @binding(BINDING_COMPOSE_COLOUR) var<storage, read> pixel_colour: array<u32>;
@group(0) @binding(BINDING_COMPOSE_EXPOSURE) var<storage, read_write> exposure: array<f32>;
@group(0) @binding(BINDING_COMPOSE_HIT) var<storage, read> pixel_hit: array<u32>;

var<workgroup> bins: array<atomic<u32>, METER_BINS>;

// One workgroup reads an even choice of the pixels.
@compute @workgroup_size(METER_THREADS)
fn meter(@builtin(local_invocation_index) thread: u32) {
    let pixels = settings.frame_px.x * settings.frame_px.y;
    let reads = min(pixels, METER_THREADS * METER_READS);
    for (var i = thread; i < reads; i += METER_THREADS) {
        // In floating point: the product of a large frame's numbers does not fit 32 bits.
        let at = min(u32(f32(i) / f32(reads) * f32(pixels)), pixels - 1u);
        if settings.grade.x > 0.0 && pixel_hit[at] == NO_NODE {
            continue;
        }
        let bright = max(dot(decode_radiance(pixel_colour[at]), LUMINANCE), 1e-6);
        let bin = clamp((log2(bright) - METER_MIN_LOG2) * METER_BINS_PER_STOP, 0.0, f32(METER_BINS - 1u));
        atomicAdd(&bins[u32(bin)], 1u);
    }
    workgroupBarrier();
    if thread == 0u {
        exposure[0] = select(found_exposure(), settings.exposure, settings.exposure > 0.0);
    }
}

fn found_exposure() -> f32 {
    var total = 0u;
    for (var i = 0u; i < METER_BINS; i++) {
        total += atomicLoad(&bins[i]);
    }
    let grade = settings.grade;
    let mean = select(grade.y, mean_of(total), total > 0u);
    if grade.x <= 0.0 {
        return settings.key * exp2(-mean);
    }
    return grade.x * exp2(clamp((grade.y - mean) * grade.z, 0.0, grade.w));
}

// Mean log2 of the luminances in the bins.
fn mean_of(total: u32) -> f32 {
    let cut = u32(f32(total) * METER_CUT);
    var passed = 0u;
    var low = 0u;
    var high = 0u;
    for (var i = 0u; i < METER_BINS; i++) {
        low = select(low, i, passed <= cut);
        high = select(high, i, passed < total - cut);
        passed += atomicLoad(&bins[i]);
    }
    high = max(low, high);
    var sum = 0.0;
    for (var i = 0u; i < METER_BINS; i++) {
        sum += f32(clamp(i, low, high)) * f32(atomicLoad(&bins[i]));
    }
    return METER_MIN_LOG2 + (sum / f32(max(total, 1u)) + 0.5) / METER_BINS_PER_STOP;
}
