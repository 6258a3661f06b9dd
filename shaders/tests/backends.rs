//! The WGSL can be said in the languages of all drivers that the client may meet, not only in those of the machine at hand.
//!
//! It shows that each translation is possible, not that a driver takes it: that needs the machine.

use insula_shaders::{COMPOSE_WGSL, HIT_COUNTS_WGSL, NEAREST_WGSL, RAYCAST_WGSL};
use naga::{
    Module, ShaderStage,
    back::{PipelineConstants, glsl, hlsl, msl, pipeline_constants::process_overrides, spv},
    proc::BoundsCheckPolicies,
    valid::{Capabilities, ModuleInfo, ValidationFlags, Validator},
};

/// One program of a module, its switches set.
struct Program<'a> {
    module: &'a Module,
    info: &'a ModuleInfo,
    stage: ShaderStage,
    name: &'a str,
}

/// Tries `translate` on each program of each source, with each switch on and off; how many there were.
fn each(translate: impl Fn(&Program<'_>) -> Result<usize, String>) -> usize {
    let mut programs = 0;
    for (file, source) in [
        ("raycast", RAYCAST_WGSL),
        ("compose", COMPOSE_WGSL),
        ("hit_counts", HIT_COUNTS_WGSL),
        ("nearest", NEAREST_WGSL),
    ] {
        let module = naga::front::wgsl::parse_str(source).expect(file);
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module).expect(file);
        for on in 0..1u32 << module.overrides.len() {
            let names = module.overrides.iter().filter_map(|(_, switch)| switch.name.clone());
            let switches: PipelineConstants =
                names.enumerate().map(|(bit, name)| (name, f64::from(on >> bit & 1))).collect();
            for point in &module.entry_points {
                let (stage, name) = (point.stage, &point.name[..]);
                let (module, info) = process_overrides(&module, &info, Some((stage, name)), &switches).expect(file);
                let length = translate(&Program { module: &module, info: &info, stage, name })
                    .unwrap_or_else(|error| panic!("{file}, {name}, {switches:?}: {error}"));
                assert!(length > 100, "{file}, {name}: nothing came of it");
                programs += 1;
            }
        }
    }
    programs
}

#[test]
fn metal() {
    let options = msl::Options { lang_version: (2, 1), ..msl::Options::default() };
    let programs = each(|program| {
        let entry_point = Some((program.stage, program.name.to_owned()));
        let pipeline = msl::PipelineOptions { entry_point, ..msl::PipelineOptions::default() };
        let mut writer = msl::Writer::new(String::new());
        writer.write(program.module, program.info, &options, &pipeline).map_err(|e| e.to_string())?;
        Ok(writer.finish().len())
    });
    // Three switches of the ray-caster make eight of it.
    assert!(programs >= 8 + 3, "{programs}");
}

#[test]
fn direct3d() {
    let options = hlsl::Options::default();
    each(|program| {
        let pipeline = hlsl::PipelineOptions { entry_point: Some((program.stage, program.name.to_owned())) };
        let mut out = String::new();
        hlsl::Writer::new(&mut out, &options, &pipeline)
            .write(program.module, program.info, None)
            .map_err(|e| e.to_string())?;
        Ok(out.len())
    });
}

#[test]
fn opengl() {
    let options = glsl::Options::default();
    each(|program| {
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
fn vulkan() {
    let options = spv::Options::default();
    each(|program| {
        let pipeline = spv::PipelineOptions { shader_stage: program.stage, entry_point: program.name.to_owned() };
        let words = spv::write_vec(program.module, program.info, &options, Some(&pipeline));
        words.map(|words| words.len() * 4).map_err(|e| e.to_string())
    });
}
