// Shared by metering and composition: src/layout.rs documents its fields.
struct ComposeUniform {
    frame_px: vec2<u32>,
    target_px: vec2<u32>,
    is_lit: u32,
    exposure: f32,
    key: f32,
    padding: f32,
    grade: vec4<f32>,
    edges: vec4<f32>,
    plane: vec4<f32>,
    tan: vec2<f32>,
    unused: vec2<u32>,
}
