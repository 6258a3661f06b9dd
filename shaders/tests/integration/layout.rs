//! The WGSL is valid without optional capabilities, and its structs have the layout of Rust's.

use insula_shaders::layout::{ComposeUniform, DrawNode, FrameUniform, Light, OcclusionUniform, WORKGROUP};
use insula_shaders::stone::Stone;
use insula_shaders::wgsl;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use std::mem::offset_of;

fn module(source: &str) -> naga::Module {
    let module = naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    module
}

/// Span and member offsets of a struct in WGSL.
fn wgsl_layout(module: &naga::Module, name: &str) -> (usize, Vec<(String, usize)>) {
    let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).expect(name);
    let naga::TypeInner::Struct { members, span } = &found.1.inner else { panic!("{name} is not a struct") };
    let members = members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize)).collect();
    (*span as usize, members)
}

macro_rules! assert_layout {
    ($module:expr, $type:ident: $($field:ident)*) => {
        let (span, members) = wgsl_layout($module, stringify!($type));
        let rust = vec![$((stringify!($field).to_owned(), offset_of!($type, $field))),*];
        assert_eq!(members, rust, stringify!($type));
        assert_eq!(span, size_of::<$type>(), stringify!($type));
    };
}

#[test]
fn structs_have_the_same_layout() {
    let module = module(&wgsl::raycast());
    assert_layout!(&module, FrameUniform:
        forward width_px right height_px up samples sun shading eye eye_cell side_m levels z_eye z_scale level_scale
        ground_z_m ground shadow_m exposure sun_radius objects landmarks bays fog city edges shore sea sea_albedo light
        windows stones translucency translucent map_in_progress map_keys additions padding
    );
    assert_layout!(&module, Stone:
        base kind vein cells_per_m grain octaves f0 refraction alpha vein_width veins blend variation bend scattering
        scattering_scale absorption unused
    );
    assert_eq!(size_of::<Stone>(), 128);
    assert_layout!(&module, Light:
        sun sky_up sky_wall sky_wall_ahead sky_wall_axis ground_sun ground_sky facade_sun facade_sky haze street window
        moon side disc zero sun_tan facade_ground key stars plane grade sky glow
    );
}

#[test]
fn structs_of_columns_and_the_frame_have_the_same_layout() {
    let module = module(&wgsl::compose());
    assert_layout!(&module, ComposeUniform:
        frame_px target_px is_lit exposure key padding grade edges plane tan unused
    );
    let module = self::module(&wgsl::raycast());
    // WGSL reads it in rows of four words: `heights` is z_step_m to slot_and_shift.
    let (span, members) = wgsl_layout(&module, "DrawNode");
    let rust = [
        ("corner_and_cell_m", offset_of!(DrawNode, corner)),
        ("heights", offset_of!(DrawNode, z_step_m)),
        ("pages", offset_of!(DrawNode, pages)),
        ("level", offset_of!(DrawNode, level)),
        ("mesh", offset_of!(DrawNode, mesh)),
        ("mesh_z_m", offset_of!(DrawNode, mesh_z_m)),
        ("leaf_offset", offset_of!(DrawNode, leaf_offset)),
        ("objects", offset_of!(DrawNode, object_page)),
    ];
    assert_eq!(members, rust.map(|(name, at)| (name.to_owned(), at)));
    assert_eq!(
        (span, offset_of!(DrawNode, cell_m), offset_of!(DrawNode, slot_and_shift)),
        (size_of::<DrawNode>(), 12, 28)
    );
    assert_eq!((offset_of!(DrawNode, z_lo), offset_of!(DrawNode, z_hi)), (20, 24));
}

#[test]
fn occlusion_has_the_same_uniform() {
    let module = module(&wgsl::occlusion());
    assert_layout!(&module, OcclusionUniform:
        right vertices down middle towards subtexel_bits map_shift depth_shift cosine_shift cosine_bits texel_steps
        clip_scale depth_scale sum_words bias_texels bias_per_slope max_bias_slope max_slope
    );
    let names: Vec<_> = module.entry_points.iter().map(|e| e.name.clone()).collect();
    assert_eq!(names, ["occluder", "accumulate"]);
}

#[test]
fn entry_points_are_valid() {
    let raycast = module(&wgsl::raycast());
    let entry = &raycast.entry_points[0];
    assert_eq!((entry.name.as_str(), entry.workgroup_size), ("raycast", [WORKGROUP[0], WORKGROUP[1], 1]));
    let names: Vec<_> = module(&wgsl::compose()).entry_points.iter().map(|e| e.name.clone()).collect();
    assert_eq!(names, ["corner", "compose_srgb", "compose_linear"]);
    assert_eq!(module(&wgsl::meter()).entry_points[0].name, "meter");
    assert_eq!(module(&wgsl::hit_counts()).entry_points[0].name, "hit_counts");
    let names: Vec<_> = module(&wgsl::nearest()).entry_points.iter().map(|e| e.name.clone()).collect();
    assert_eq!(names, ["corner", "number"]);
}
