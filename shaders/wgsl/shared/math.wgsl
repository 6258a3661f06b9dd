// Arithmetic that several stages share. CPU twin: src/cpu/fast_math.rs.

// WGSL's own `min` and `max` define the result for a NaN, which costs two more instructions on devices that do not.
fn fast_min(a: f32, b: f32) -> f32 {
    return select(b, a, a < b);
}

fn fast_max(a: f32, b: f32) -> f32 {
    return select(b, a, a > b);
}

// No component is zero, so that the distance to every boundary is a finite number.
fn nonzero(v: vec2<f32>) -> vec2<f32> {
    return select(v, vec2<f32>(MIN_DIRECTION), abs(v) < vec2<f32>(MIN_DIRECTION));
}

// 1 along the axes on which the ray's coordinate grows, else 0.
fn ahead_of(d: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(0.0), vec2<f32>(1.0), d > vec2<f32>(0.0));
}
