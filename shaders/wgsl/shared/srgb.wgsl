// The transfer function of sRGB (IEC 61966-2-1).

fn linear_of_srgb(srgb: vec3<f32>) -> vec3<f32> {
    let x = (srgb + 0.055) / 1.055;
    let high = (POWER_HIGH.z * x + POWER_HIGH.y) * x + POWER_HIGH.x;
    let power = ((high * x + POWER_LOW.z) * x + POWER_LOW.y) * x + POWER_LOW.x;
    return select(power, srgb / 12.92, srgb <= vec3<f32>(0.04045));
}

fn srgb_of_linear(rgb: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(rgb, vec3<f32>(1.0 / 2.4)) - 0.055, rgb * 12.92, rgb <= vec3<f32>(0.0031308));
}
