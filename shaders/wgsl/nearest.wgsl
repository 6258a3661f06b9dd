// Which triangle is nearest in each texel of a map: the GPU's way of what server/bake/src/sample/visibility.rs draws.
//
// In: corners in clip space with their triangle's number. Out: numbers. Next: read-back.

struct Corner {
    @builtin(position) place: vec4<f32>,
    @location(0) @interpolate(flat) number: u32,
}

@vertex
fn corner(@location(0) place: vec3<f32>, @location(1) number: u32) -> Corner {
    return Corner(vec4<f32>(place, 1.0), number);
}

@fragment
fn number(in: Corner) -> @location(0) u32 {
    return in.number;
}
