// From radiance to the screen. CPU twin: src/tone.rs.

fn encode_radiance(radiance: vec3<f32>) -> u32 {
    let rgb = clamp(radiance, vec3<f32>(0.0), vec3<f32>(MAX_RADIANCE));
    let bits = bitcast<u32>(max(max(rgb.r, rgb.g), rgb.b)) + (1u << (23u - MANTISSA_BITS));
    let exponent = max(i32(bits >> 23u) - 127, -1 - EXPONENT_BIAS);
    let scale = bitcast<f32>(u32(126 + i32(MANTISSA_BITS) - exponent) << 23u);
    let mantissa = min(vec3<u32>(rgb * scale + 0.5), vec3<u32>((1u << MANTISSA_BITS) - 1u));
    return mantissa.r | (mantissa.g << 9u) | (mantissa.b << 18u) | (u32(exponent + 1 + EXPONENT_BIAS) << 27u);
}

fn decode_radiance(word: u32) -> vec3<f32> {
    let scale = bitcast<f32>((127u + (word >> 27u) - u32(EXPONENT_BIAS) - MANTISSA_BITS) << 23u);
    return vec3<f32>((vec3<u32>(word) >> vec3<u32>(0u, 9u, 18u)) & vec3<u32>((1u << MANTISSA_BITS) - 1u)) * scale;
}

// PBR Neutral, for graded pictures. Linear sRGB, 0 to 1. What a longer exposure adds fades towards bright places.
fn neutral(light: vec3<f32>, longer: f32) -> vec3<f32> {
    let most = max(max(light.r, light.g), light.b);
    let bright = most / (longer * ROLL_OFF);
    let share = (1.0 + (longer - 1.0) / (1.0 + bright * bright)) / longer;
    let rgb = light * share;
    let peak = most * share;
    if peak <= NEUTRAL_START {
        return rgb;
    }
    let range = 1.0 - NEUTRAL_START;
    let shown = 1.0 - range * range / (peak + range - NEUTRAL_START);
    let kept = 1.0 / (NEUTRAL_DESATURATION * (peak - shown) + 1.0);
    return vec3<f32>(shown) + (rgb * (shown / peak) - shown) * kept;
}

// AgX. Linear sRGB, 0 to 1.
fn tone_map(rgb: vec3<f32>) -> vec3<f32> {
    let log = (log2(max(AGX_IN * rgb, vec3<f32>(1e-10))) - AGX_MIN_LOG2) / AGX_LOG2_RANGE;
    let x = clamp(log, vec3<f32>(0.0), vec3<f32>(1.0));
    let polynomial = (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232;
    let curve = pow(max(polynomial, vec3<f32>(0.0)), vec3<f32>(AGX_POWER));
    let grey = vec3<f32>(dot(curve, LUMINANCE));
    let saturated = max(grey + (curve - grey) * AGX_SATURATION, vec3<f32>(0.0));
    return pow(clamp(AGX_OUT * saturated, vec3<f32>(0.0), vec3<f32>(1.0)), vec3<f32>(AGX_GAMMA));
}

// From 0 to 1, as different as possible in pixels next to each other.
fn gradient_noise(pixel: vec2<u32>) -> f32 {
    return fract(52.982918 * fract(dot(vec2<f32>(0.06711056, 0.00583715), vec2<f32>(pixel))));
}
