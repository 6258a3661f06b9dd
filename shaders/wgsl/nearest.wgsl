// Draws the number of the nearest triangle into each texel of a map, for the bake's visibility.

struct NumberedCorner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) number: u32,
}

@vertex
fn corner(@location(LOCATION_PLACE) place: vec3<f32>, @location(LOCATION_NUMBER) number: u32) -> NumberedCorner {
    return NumberedCorner(vec4<f32>(place, 1.0), number);
}

@fragment
fn number(in: NumberedCorner) -> @location(0) u32 {
    return in.number;
}
