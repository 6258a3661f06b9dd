//! The WGSL translates into the languages of all drivers that the client may meet, not only of this machine's.
//!
//! Whether a driver accepts the translation needs a machine with that driver.

use insula_shaders::wgsl;
use naga::back::pipeline_constants::process_overrides;
use naga::back::{PipelineConstants, glsl, hlsl, msl, spv};
use naga::proc::BoundsCheckPolicies;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

/// Calls all functions of stone.
const STONE_KERNEL: &str = "
@group(1) @binding(0) var<uniform> stones: array<Stone, 16>;
@group(1) @binding(1) var<storage, read_write> light: array<vec4<f32>>;
@compute @workgroup_size(64)
fn stone(@builtin(global_invocation_id) id: vec3<u32>) {
    let up = vec3<f32>(0.0, 0.0, 1.0);
    let surface = stone_surface(stones[id.x % 16u], vec3<f32>(id), up, 1.0, 0.01);
    let found = reflect_stone(surface, StoneSide(up, 1.0, vec3<f32>(0.0), false), -up);
    light[id.x] = vec4<f32>(found.sky + found.sun, 1.0);
}
";

/// One entry point of a module with its overrides set.
struct Program<'a> {
    module: &'a Module,
    info: &'a ModuleInfo,
    stage: ShaderStage,
    name: &'a str,
}

/// Runs `translate` on each entry point of each source, with each override on and off. Returns the number of programs.
fn translate_all(translate: impl Fn(&Program<'_>) -> Result<usize, String>) -> usize {
    let mut programs = 0;
    for (file, source) in [
        ("raycast", wgsl::raycast()),
        ("compose", wgsl::compose()),
        ("hit_counts", wgsl::hit_counts()),
        ("nearest", wgsl::nearest()),
        ("occlusion", wgsl::occlusion()),
        ("stone", wgsl::stone_samples(STONE_KERNEL)),
    ] {
        let module = naga::front::wgsl::parse_str(&source).expect(file);
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module).expect(file);
        for on in 0..1u32 << module.overrides.len() {
            let names = module.overrides.iter().filter_map(|(_, found)| found.name.clone());
            let overrides: PipelineConstants =
                names.enumerate().map(|(bit, name)| (name, f64::from(on >> bit & 1))).collect();
            for point in &module.entry_points {
                let (stage, name) = (point.stage, &point.name[..]);
                let (module, info) = process_overrides(&module, &info, Some((stage, name)), &overrides).expect(file);
                let length = translate(&Program { module: &module, info: &info, stage, name })
                    .unwrap_or_else(|error| panic!("{file}, {name}, {overrides:?}: {error}"));
                assert!(length > 100, "{file}, {name}: an empty translation");
                programs += 1;
            }
        }
    }
    programs
}

#[test]
fn translates_to_metal() {
    let options = msl::Options { lang_version: (2, 1), ..msl::Options::default() };
    let programs = translate_all(|program| {
        let entry_point = Some((program.stage, program.name.to_owned()));
        let pipeline = msl::PipelineOptions { entry_point, ..msl::PipelineOptions::default() };
        let mut writer = msl::Writer::new(String::new());
        writer.write(program.module, program.info, &options, &pipeline).map_err(|e| e.to_string())?;
        Ok(writer.finish().len())
    });
    // The ray-caster has three overrides, which make eight programs.
    assert!(programs >= 8 + 3, "{programs}");
}

#[test]
fn translates_to_direct3d() {
    let options = hlsl::Options::default();
    translate_all(|program| {
        let pipeline = hlsl::PipelineOptions { entry_point: Some((program.stage, program.name.to_owned())) };
        let mut out = String::new();
        hlsl::Writer::new(&mut out, &options, &pipeline)
            .write(program.module, program.info, None)
            .map_err(|e| e.to_string())?;
        Ok(out.len())
    });
}

#[test]
fn translates_to_opengl() {
    let options = glsl::Options::default();
    translate_all(|program| {
        let pipeline = glsl::PipelineOptions {
            shader_stage: program.stage,
            entry_point: program.name.to_owned(),
            multiview: None,
        };
        let mut out = String::new();
        let policies = BoundsCheckPolicies::default();
        glsl::Writer::new(&mut out, program.module, program.info, &options, &pipeline, policies)
            .and_then(|mut writer| writer.write())
            .map_err(|e| e.to_string())?;
        Ok(out.len())
    });
}

#[test]
fn translates_to_vulkan() {
    let options = spv::Options::default();
    translate_all(|program| {
        let pipeline = spv::PipelineOptions { shader_stage: program.stage, entry_point: program.name.to_owned() };
        let words = spv::write_vec(program.module, program.info, &options, Some(&pipeline));
        words.map(|words| words.len() * 4).map_err(|e| e.to_string())
    });
}
