// Structs that Rust and WGSL share: src/layout.rs documents their fields, tests/layout.rs compares their offsets.

struct Light {
    sun: vec4<f32>,
    sky_up: vec4<f32>,
    sky_wall: vec4<f32>,
    sky_wall_ahead: vec4<f32>,
    sky_wall_axis: vec4<f32>,
    ground_sun: vec4<f32>,
    ground_sky: vec4<f32>,
    facade_sun: vec4<f32>,
    facade_sky: vec4<f32>,
    haze: vec4<f32>,
    street: vec4<f32>,
    window: vec4<f32>,
    moon: vec4<f32>,
    side: vec2<f32>,
    disc: f32,
    zero: f32,
    sun_tan: f32,
    facade_ground: f32,
    key: f32,
    stars: f32,
    sky: array<vec4<f32>, SKY_CELLS>,
    glow: array<vec4<f32>, SKY_CELLS>,
}

struct FrameUniform {
    forward: vec3<f32>,
    width_px: u32,
    right: vec3<f32>,
    height_px: u32,
    up: vec3<f32>,
    samples: u32,
    sun: vec3<f32>,
    shading: u32,
    eye: vec2<f32>,
    eye_cell: vec2<i32>,
    side_m: f32,
    levels: u32,
    z_eye: f32,
    z_scale: f32,
    level_scale: f32,
    ground_z_m: f32,
    ground: u32,
    shadow_m: f32,
    exposure: f32,
    sun_radius: f32,
    objects: u32,
    landmarks: u32,
    bays: vec4<f32>,
    light: Light,
    windows: array<vec4<i32>, GRID_LEVELS>,
    stones: array<Stone, MAX_STONES>,
    translucency: array<TranslucencyMap, MAX_MAPS>,
    translucent: u32,
    map_in_progress: u32,
    map_keys: vec2<u32>,
}

// In rows of four words: a row is read at once.
struct DrawNode {
    // South-west corner at height code 0; side of a column.
    corner_and_cell_m: vec4<f32>,
    // Bits of z_step_m, z_lo and z_hi; slot_and_shift.
    heights: vec4<u32>,
    pages: vec4<u32>,
    level: u32,
    mesh: u32,
    mesh_z_m: f32,
    leaf_offset: u32,
    // Page of the objects' plane, and first word of the palette.
    objects: vec4<u32>,
}
