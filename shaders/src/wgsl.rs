//! The WGSL sources: files of `wgsl/`, concatenated behind generated constants.
//!
//! Rust declares every number that both languages use, and this module generates its WGSL declaration:
//!
//! - sizes, bit fields and limits of the shared arrays (`layout`, `pack`, `mesh`, the column flags of `insula-protocol`);
//! - tolerances, lifts and colours of the CPU ray-caster (`cpu`);
//! - workgroup sizes, binding numbers and vertex locations (`layout::binding`).
//!
//! The WGSL files declare only constants that Rust does not have (states, faces); a test refuses a constant that both
//! declare and a binding that is written as a number. Structs are compared by `tests/layout.rs`.

use crate::atmosphere::{LUMINANCE, MIE_G, PHASE_SCALE};
use crate::compose::{
    CONTACT_DEPTH_SLACK, CONTACT_GAIN, CONTACT_LEAST_PX, CONTACT_M, CONTACT_REACH, CONTACT_SHARE, CONTACT_SLACK,
    CONTACT_SOFT, CONTACT_TAPS, LINE_BEGIN, LINE_FAR_M, LINE_FULL,
};
use crate::cpu::landmark::MIN_FACING_NORMAL;
use crate::cpu::mesh::{
    BOX_SLACK, EDGE_SLACK, MESH_LIFT_M, MESH_LIFT_SHARE, MIN_COSINE, PLANE_SINE_SQUARED, TIE_M, TIE_SHARE, WIRE_LINE,
    WIRE_SURFACE,
};
use crate::cpu::mesh_surface::{INSIDE_AO, ROOF_NORMAL_Z, ROOF_WEIGHT_ON_WALL, UNKNOWN_AO};
use crate::cpu::night::{
    BAY_COUNT, BAYS_PER_M, GLASS_EAST, GLASS_HIGH, GLASS_LOW, GLASS_WEST, LAMP_BEGIN, LAMP_DEPTH, LAMP_FALL_M,
    LAMP_TOP_M, LAMPS_IN_THE_OPEN, LAMPS_ON_WALLS, LIT_SHARE, MAX_WINDOW_SLOPE, MOON_RADIUS, MOON_TERMINATOR,
    STAR_CELLS, STAR_RARITY, STAR_SHARPNESS, WINDOW_DEPTH_SHIFT, WINDOW_MIN,
};
use crate::cpu::noise::{
    MIN_FOOTPRINT, NOISE_ABS, NOISE_ABS_VARIANCE, NOISE_DENSITY, NOISE_DENSITY_BEND, NOISE_SCALE, NOISE_VARIANCE,
    OCTAVE_TURN,
};
use crate::cpu::ray::{MAX_STEPS, MIN_DIRECTION, SUN_LIFT_CELLS, SUN_LIFT_M};
use crate::cpu::sea::{BARE_NORMAL_Z, BARE_TOLERANCE, COAST_BLURS, SEA_FADE, SEA_TOLERANCE, WATER_NORMAL_Z};
use crate::cpu::shade::{
    DISC, DISC_INNER, DISC_OUTER, FACADE_DEPTH, FACADES_BY_GROUND, FACADES_BY_WALL, FACING_REFLECTANCE, FACING_WATER,
    FLAT_WATER, GROUND, GROUND_DEPTH, GROUND_FADE_M, HORIZON, LEVEL_SLOPE, MIN_GROUND_DESCENT, PANES, PLANE_CLEAR_M,
    PLANE_FADE, POWER_HIGH, POWER_LOW, TINT_EXPOSED, TINT_GAP, TINT_INCLINED, TINT_MESH, TINT_ROOF, TINT_SUSPENDED,
    WAVE_TILT, WAVES, WAVES_END_M, WAVES_PER_BAY, ZENITH, ZENITH_SHARE,
};
use crate::cpu::solid::MAX_STRIP_ROWS;
use crate::cpu::stone::{
    BED_FLATNESS, BEND_FREQUENCY, BENT_SLOPE, BROAD_LACUNARITY, CRINKLE, CRINKLE_FREQUENCY, FIBRE_LENGTH, FIBRE_WIDTH,
    FINE_LACUNARITY, FINE_WIDTH, GRAIN_BEND_FREQUENCY, GRAIN_FOOTPRINT, GRANITE_PERSISTENCE, LIMESTONE_GRAINS,
    MICA_FREQUENCY, MIN_WIDTH, PATINA_ALPHA, PATINA_CREASES, PATINA_F0, PATINA_HEIGHT, PATINA_NOISE, PATINA_OPEN,
    PATINA_TARNISH, PATINA_UPWARDS, PLACE_CONTRAST, PLACE_FREQUENCY, RAMP_RANGE, VEIN_FALL, VEIN_STRETCH,
    WIDTH_VARIATION,
};
use crate::cpu::translucency::{
    FAST_RINGS, FINE_RINGS, FIRST_RADIUS, FIRST_TEXELS, HEIGHT_SLACK, MIN_ENTRY_COSINE, MIN_STRETCH, RING_TURN,
    SAME_ANCHOR_M, SURFACE_STEP,
};
use crate::cpu::ward::{
    LOBE_FACTOR_0, LOBE_FACTOR_1, LOBE_FACTOR_2, LOBE_FACTOR_3, LOBE_GRAZING_0, LOBE_GRAZING_1, LOBE_GRAZING_2,
    LOBE_SLACK, MATT_VARIANCE, MIN_FACING, UNKNOWN_BELOW,
};
use crate::grid::Z_TOP;
use crate::layout::{
    ADDED_LEVEL, ATTRIBUTE_PLANE, BLOCK_CELLS, BLOCK_SHIFT, GOLDEN_TURN, GRID_LEVEL_MASK, GRID_LEVEL_SHIFT,
    GRID_LEVELS, GRID_MIXED, GRID_NODE_BIT, GRID_NODE_MASK, GRID_SHARE_MASK, GRID_SHARE_SHIFT, HIT_BLOCK_PX,
    HIT_COUNTS_THREADS, MAX_SAMPLES, MESH_FLAG, MESH_LEVEL, METER_READS, METER_THREADS, NO_NODE, NODE_BLOCKS,
    OBJECT_BITS, OCCLUSION_SPLIT, OCCLUSION_THREADS, OUTLINE_RGB, PAGE_WORDS, PALETTE_COLOURED, PALETTE_HIDDEN,
    PALETTE_OUTLINED, QUAD_TOP_BITS, QUAD_TOP_MAX, QUARTER_MAX, QUARTER_SHIFT, ROOF_PLANE, SHORE_PARTS, SHORE_ROWS,
    SKY_AZIMUTHS, SKY_CELLS, SKY_HEIGHTS, SLOT_SHIFT, STRIP_PLANE, SUMMARY_BYTE_SHIFT, SUMMARY_VEC4S, Shading,
    WALK_PLANE, WORKGROUP, binding,
};
use crate::light::SKY_LOW;
use crate::mesh::{
    HEAD_VEC4S, LANDMARK_COUNT_SHIFT, LANDMARK_OCCLUSION_BIT, LANDMARK_VEC4S, LEAF_OFFSET_STEPS, LEVELS_MASK,
    ORIGINS_PER_M, REFERENCE_COUNT_SHIFT, REFERENCE_MASK, TEXTURE_TILE_PX, TRAVERSAL_STACK,
};
use crate::pack::{
    AO_SHIFT, AZIMUTH_SHIFT, AZIMUTHS, CLIP_CONCAVE, CLIP_CORNER, CLIP_OFFSET_SHIFT, FLAGS_SHIFT, HEIGHT_BITS,
    HEIGHT_MASK, THIN_STEP,
};
use crate::stone::{BROAD_VEINS, FINE_VEINS, MAX_STONES, StoneKind};
use crate::tone::{
    AGX_GAMMA, AGX_IN, AGX_LOG2_RANGE, AGX_MIN_LOG2, AGX_OUT, AGX_POWER, AGX_SATURATION, EXPONENT_BIAS, MANTISSA_BITS,
    MAX_RADIANCE, METER_BINS, METER_BINS_PER_STOP, METER_CUT, METER_MIN_LOG2, NEUTRAL_DESATURATION, NEUTRAL_START,
    ROLL_OFF,
};
use crate::translucency::{COARSEST_PX, FINE_TAPS, MAX_MAPS, OCCUPIED as MAP_OCCUPIED};
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::{CLIP_STEPS_PER_CELL, STEPS_PER_CELL, flag};
use std::f32::consts::TAU;
use std::fmt;

/// A file of `wgsl`, as `build.rs` copied it, or a list of them.
#[cfg(not(target_arch = "wasm32"))]
macro_rules! wgsl {
    ($file:literal) => {
        include_str!(concat!(env!("OUT_DIR"), "/", $file))
    };
    ($($file:literal),+ $(,)?) => {
        [$(wgsl!($file)),+]
    };
}
/// The name of a file: browsers get its text by [`load`].
#[cfg(target_arch = "wasm32")]
macro_rules! wgsl {
    ($file:literal) => {
        $file
    };
    ($($file:literal),+ $(,)?) => {
        [$($file),+]
    };
}

/// What [`load`] got.
#[cfg(target_arch = "wasm32")]
static LOADED: std::sync::OnceLock<String> = std::sync::OnceLock::new();

/// A text that is not that of this build's files.
#[cfg(target_arch = "wasm32")]
#[derive(Debug, thiserror::Error)]
#[error("the shaders lack {0}: they and the viewer are of different builds")]
pub struct ForeignShaders(&'static str);

/// Takes the files that `build.rs` joined for browsers. Fails if they are not of this build. Before it, all sources are empty.
#[cfg(target_arch = "wasm32")]
pub fn load(text: String) -> Result<(), ForeignShaders> {
    let others = [COMPOSE_UNIFORM, DEPTH, COMPOSE, CONTACT, METER, HIT_COUNTS];
    if let Some(name) = RAYCAST.into_iter().chain(others).find(|name| file_in(&text, name).is_none()) {
        return Err(ForeignShaders(name));
    }
    // A second text is the same.
    let _ = LOADED.set(text);
    Ok(())
}

/// Whether [`load`] succeeded.
#[cfg(target_arch = "wasm32")]
pub fn is_loaded() -> bool {
    LOADED.get().is_some()
}

/// A file among those that `build.rs` joined.
#[cfg(any(test, target_arch = "wasm32"))]
fn file_in<'a>(joined: &'a str, name: &str) -> Option<&'a str> {
    joined.split("//@ ").find_map(|part| part.strip_prefix(name)?.strip_prefix('\n')?.strip_suffix('\n'))
}

const DEPTH: &str = wgsl!("shared/depth.wgsl");
const COMPOSE_UNIFORM: &str = wgsl!("shared/compose_uniform.wgsl");
const SRGB: &str = wgsl!("shared/srgb.wgsl");
const TONE: &str = wgsl!("shared/tone.wgsl");
const COMPOSE: &str = wgsl!("compose.wgsl");
const CONTACT: &str = wgsl!("contact.wgsl");
const METER: &str = wgsl!("meter.wgsl");
const HIT_COUNTS: &str = wgsl!("hit_counts.wgsl");

/// The ray-caster: entry point `raycast`, bindings in [`crate::layout::binding`], workgroups of [`WORKGROUP`].
pub fn raycast() -> String {
    source(&RAYCAST)
}

/// Files of the ray-caster.
const RAYCAST: [&str; 23] = wgsl![
    "shared/layout.wgsl", "shared/math.wgsl", "shared/srgb.wgsl", "shared/tone.wgsl", "shared/words.wgsl", "ray.wgsl",
    "raycast.wgsl", "walk.wgsl", "node.wgsl", "column.wgsl", "solid.wgsl", "objects.wgsl", "mesh.wgsl",
    "mesh_surface.wgsl", "landmark.wgsl", "shade.wgsl", "sea.wgsl", "night.wgsl", "noise.wgsl", "stone.wgsl",
    "ward.wgsl", "translucency.wgsl", "translucency_map.wgsl",
];

/// The ray-caster and `kernel`: an entry point that calls its functions of stone, `stone_surface` and `reflect_stone`, for tests.
#[cfg(not(target_arch = "wasm32"))]
pub fn stone_samples(kernel: &str) -> String {
    source(&[&RAYCAST[..], &[kernel]].concat())
}

/// Draws the ray-caster's pixels on a render target: entry points `corner`, `compose_srgb` and `compose_linear`.
pub fn compose() -> String {
    source(&[COMPOSE_UNIFORM, DEPTH, SRGB, TONE, COMPOSE])
}

/// Shade where surfaces meet, from the ray-caster's distances: entry point `contact`, workgroups of [`WORKGROUP`].
pub fn contact() -> String {
    source(&[COMPOSE_UNIFORM, DEPTH, CONTACT])
}

/// Measures the exposure of the ray-caster's pixels: entry point `meter`.
pub fn meter() -> String {
    source(&[COMPOSE_UNIFORM, TONE, METER])
}

/// Counts each node's pixels: entry point `hit_counts`.
pub fn hit_counts() -> String {
    source(&[HIT_COUNTS])
}

/// Draws the number of the nearest triangle, for the bake: entry points `corner` and `number`.
#[cfg(not(target_arch = "wasm32"))]
pub fn nearest() -> String {
    source(&[wgsl!("nearest.wgsl")])
}

/// Draws depth maps of a mesh and tests its vertices: entry points `occluder` and `accumulate`.
#[cfg(not(target_arch = "wasm32"))]
pub fn occlusion() -> String {
    source(&[wgsl!("occlusion.wgsl")])
}

#[cfg(not(target_arch = "wasm32"))]
fn source(files: &[&str]) -> String {
    [&[constants().as_str()], files].concat().join("\n")
}

#[cfg(target_arch = "wasm32")]
fn source(names: &[&str]) -> String {
    let joined = LOADED.get().map_or("", String::as_str);
    let files: Vec<&str> = names.iter().filter_map(|name| file_in(joined, name)).collect();
    [&[constants().as_str()], &files[..]].concat().join("\n")
}

/// A value of a type of WGSL.
enum Literal {
    U32(u32),
    I32(i32),
    F32(f32),
    Vec3([f32; 3]),
    Mat3([[f32; 3]; 3]),
}

impl fmt::Display for Literal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::U32(value) => write!(f, "{value}u"),
            Self::I32(value) => write!(f, "{value}i"),
            Self::F32(value) => write!(f, "{value:?}f"),
            Self::Vec3([x, y, z]) => write!(f, "vec3<f32>({x:?}f, {y:?}f, {z:?}f)"),
            Self::Mat3(axes) => {
                let [x, y, z] = axes.map(Self::Vec3);
                write!(f, "mat3x3<f32>({x}, {y}, {z})")
            }
        }
    }
}

/// A value as a [`Literal`] of its type.
macro_rules! literal {
    (u32 $value:expr) => {
        Literal::U32($value as u32)
    };
    (i32 $value:expr) => {
        Literal::I32($value as i32)
    };
    (f32 $value:expr) => {
        Literal::F32($value as f32)
    };
    (mat3 $value:expr) => {
        Literal::Mat3($value.to_cols_array_2d())
    };
    (vec3 $value:expr) => {
        Literal::Vec3($value.to_array())
    };
}

/// A declaration for each `type NAME = value`; the value is Rust's constant of that name if there is none.
macro_rules! declare {
    ($($type:ident { $($name:ident $(= $value:expr)?),+ $(,)? })+) => {
        declarations(&[$($((stringify!($name), declare!(@ $type $name $($value)?))),+),+])
    };
    (@ $type:ident $name:ident) => {
        literal!($type $name)
    };
    (@ $type:ident $name:ident $value:expr) => {
        literal!($type $value)
    };
}

fn declarations(constants: &[(&str, Literal)]) -> String {
    constants.iter().map(|(name, value)| format!("const {name} = {value};\n")).collect()
}

fn constants() -> String {
    [binding_constants(), shading_constants(), landmark_constants(), other_constants()].concat()
}

/// Declarations of bindings and locations.
fn binding_constants() -> String {
    macro_rules! numbers {
        ($prefix:literal $($name:ident)+) => {
            declarations(&[$((concat!($prefix, stringify!($name)), literal!(u32 binding::$name))),+])
        };
    }
    let bindings = numbers! { "BINDING_"
        FRAME GRID NODES SUMMARIES ATLAS COLOUR DISTANCE HIT ATLAS_VEC4S
        COMPOSE_SETTINGS COMPOSE_COLOUR COMPOSE_EXPOSURE COMPOSE_HIT COMPOSE_DISTANCE COMPOSE_SHADE
        COUNTS_SIZE COUNTS_HIT COUNTS
        OCCLUSION_VIEW OCCLUSION_PLACES OCCLUSION_NORMALS OCCLUSION_NEAR OCCLUSION_FAR OCCLUSION_SUMS
    };
    bindings + &numbers! { "" LOCATION_PLACE LOCATION_NUMBER }
}

fn shading_constants() -> String {
    let all = Shading::ALL.into_iter().chain([Shading::Objects]);
    all.map(|shading| format!("const SHADING_{} = {}u;\n", shading.word().to_uppercase(), shading as u32)).collect()
}

/// Declarations of constants of landmarks, stone and translucency.
fn landmark_constants() -> String {
    declare! {
        // Landmarks.
        u32 { HEAD_VEC4S, LANDMARK_VEC4S, LANDMARK_COUNT_SHIFT, LEVELS_MASK, LANDMARK_OCCLUSION_BIT, MAX_STONES }
        // Stone.
        f32 { NOISE_SCALE, NOISE_VARIANCE, NOISE_ABS, NOISE_ABS_VARIANCE, NOISE_DENSITY, NOISE_DENSITY_BEND, MIN_FOOTPRINT }
        mat3 { OCTAVE_TURN }
        u32 {
            STONE_MARBLE = StoneKind::Marble,
            STONE_GRANITE = StoneKind::Granite,
            STONE_BRONZE = StoneKind::Bronze,
            STONE_LIMESTONE = StoneKind::Limestone,
            STONE_WOOD = StoneKind::Wood,
            BROAD_VEINS,
            FINE_VEINS,
        }
        f32 { FINE_WIDTH, BROAD_LACUNARITY, FINE_LACUNARITY, VEIN_FALL, BEND_FREQUENCY, WIDTH_VARIATION, MIN_WIDTH }
        f32 { CRINKLE_FREQUENCY, CRINKLE, VEIN_STRETCH, BENT_SLOPE, PLACE_FREQUENCY, PLACE_CONTRAST }
        f32 { GRANITE_PERSISTENCE, MICA_FREQUENCY, GRAIN_BEND_FREQUENCY, GRAIN_FOOTPRINT, BED_FLATNESS, LIMESTONE_GRAINS, FIBRE_LENGTH, FIBRE_WIDTH }
        f32 { PATINA_UPWARDS, PATINA_OPEN, RAMP_RANGE, PATINA_NOISE, PATINA_TARNISH, PATINA_CREASES, PATINA_HEIGHT, PATINA_ALPHA, PATINA_F0 }
        vec3 { LOBE_FACTOR_0, LOBE_FACTOR_1, LOBE_FACTOR_2, LOBE_FACTOR_3, LOBE_GRAZING_0, LOBE_GRAZING_1, LOBE_GRAZING_2 }
        f32 { LOBE_SLACK, MATT_VARIANCE, MIN_FACING, UNKNOWN_BELOW, MIN_FACING_NORMAL }
        // Translucency.
        u32 {
            MAX_MAPS,
            COARSEST_PX,
            MAP_OCCUPIED,
            FINE_TAPS,
            FINE_RING_COUNT = FINE_RINGS[0],
            FINE_RING_TAPS = FINE_RINGS[1],
            FAST_RING_COUNT = FAST_RINGS[0],
            FAST_RING_TAPS = FAST_RINGS[1],
        }
        f32 { FIRST_RADIUS, FIRST_TEXELS, HEIGHT_SLACK, MIN_ENTRY_COSINE, MIN_STRETCH, RING_TURN, SURFACE_STEP, SAME_ANCHOR_M }
    }
}

fn other_constants() -> String {
    declare! {
        u32 { WORKGROUP_X = WORKGROUP[0], WORKGROUP_Y = WORKGROUP[1], HIT_COUNTS_THREADS, HIT_BLOCK_PX, OCCLUSION_SPLIT, OCCLUSION_THREADS }
        // Frame, grid, nodes and summaries.
        u32 { MAX_SAMPLES, MAX_STEPS, NO_NODE, GRID_LEVELS, GRID_MIXED, GRID_NODE_BIT, GRID_LEVEL_SHIFT, GRID_LEVEL_MASK }
        u32 { GRID_SHARE_SHIFT, GRID_SHARE_MASK, GRID_NODE_MASK, SLOT_SHIFT, QUARTER_SHIFT }
        u32 { SUMMARY_VEC4S, SUMMARY_BYTE_SHIFT, QUAD_TOP_BITS, QUAD_TOP_MASK = QUAD_TOP_MAX, BLOCK_SHIFT }
        i32 { NODE_CELLS, NODE_BLOCKS, BLOCK_CELLS }
        f32 { Z_TOP, QUARTER_MAX, QUAD_TOP_MAX }
        // Words of the atlas.
        u32 { PAGE_WORDS, WALK_PLANE, ROOF_PLANE, ATTRIBUTE_PLANE, STRIP_PLANE, FLAGS_SHIFT, HEIGHT_BITS, HEIGHT_MASK }
        u32 { OBJECT_BITS, PALETTE_COLOURED, PALETTE_HIDDEN, PALETTE_OUTLINED }
        u32 { AZIMUTH_SHIFT, AZIMUTHS, CLIP_OFFSET_SHIFT, CLIP_CORNER, CLIP_CONCAVE, STEPS_PER_CELL, THIN_STEP }
        u32 { OPAQUE = insula_protocol::texel::OPAQUE, AO_SHIFT, MESH_FLAG, MESH_LEVEL, ADDED_LEVEL }
        u32 {
            OCCUPIED = flag::OCCUPIED,
            EXPOSED = flag::EXPOSED,
            INCLINED = flag::INCLINED,
            GAP = flag::GAP,
            HOLES = flag::HOLES,
            SUSPENDED = flag::SUSPENDED,
            CLIPPED = flag::CLIPPED,
            REFLECTIVE = flag::REFLECTIVE,
        }
        i32 { MAX_STRIP_ROWS }
        f32 { AO_MAX = insula_protocol::texel::AO_MAX, CLIP_STEPS_PER_CELL, MIN_NORMAL_Z = insula_protocol::blockmap::MIN_NORMAL_Z, TAU }
        // Rays.
        f32 { MIN_DIRECTION, SUN_LIFT_CELLS, SUN_LIFT_M }
        // Meshes.
        u32 { REFERENCE_COUNT_SHIFT, REFERENCE_MASK, TRAVERSAL_STACK, TEXTURE_TILE_PX }
        f32 { LEAF_OFFSET_STEPS, EDGE_SLACK, BOX_SLACK, TIE_M, TIE_SHARE, PLANE_SINE_SQUARED, MESH_LIFT_M, MESH_LIFT_SHARE, MIN_COSINE, ORIGINS_PER_M }
        f32 { INSIDE_AO, UNKNOWN_AO, ROOF_WEIGHT_ON_WALL, ROOF_NORMAL_Z }
        // Light.
        vec3 { HORIZON, ZENITH, GROUND, LUMINANCE, POWER_LOW, POWER_HIGH }
        vec3 { TINT_ROOF, TINT_MESH, TINT_GAP, TINT_SUSPENDED, TINT_EXPOSED, TINT_INCLINED, WIRE_SURFACE, WIRE_LINE }
        vec3 { OUTLINE_RGB = glam::Vec3::from(OUTLINE_RGB) }
        f32 { GROUND_FADE_M, MIN_GROUND_DESCENT, DISC_INNER, DISC_OUTER, DISC, MIE_G, PHASE_SCALE, SKY_LOW }
        f32 { FACADES_BY_WALL, FACADES_BY_GROUND, GROUND_DEPTH, FACADE_DEPTH, ZENITH_SHARE, GOLDEN_COS = GOLDEN_TURN.x, GOLDEN_SIN = GOLDEN_TURN.y }
        u32 { SKY_HEIGHTS, SKY_AZIMUTHS, SKY_CELLS, STAR_RARITY }
        u32 { SHORE_PARTS, SHORE_ROWS }
        f32 { BARE_TOLERANCE, BARE_NORMAL_Z, LEVEL_SLOPE, SEA_FADE, COAST_BLURS, SEA_TOLERANCE, WATER_NORMAL_Z }
        f32 { PLANE_CLEAR_M, PLANE_FADE, LAMP_BEGIN, LAMP_DEPTH, LAMP_TOP_M, LAMP_FALL_M, LAMPS_IN_THE_OPEN, LAMPS_ON_WALLS, FACING_REFLECTANCE, FACING_WATER, FLAT_WATER }
        f32 { WAVES, PANES, WAVE_TILT, WAVES_PER_BAY, WAVES_END_M }
        f32 { STAR_CELLS, STAR_SHARPNESS, MOON_RADIUS, MOON_TERMINATOR }
        f32 { BAYS_PER_M, GLASS_WEST, GLASS_EAST, GLASS_LOW, GLASS_HIGH, LIT_SHARE, MAX_WINDOW_SLOPE, WINDOW_MIN }
        i32 { BAY_COUNT }
        u32 { WINDOW_DEPTH_SHIFT }
        // Lines and shade of composition.
        f32 { LINE_BEGIN, LINE_FULL, LINE_FAR_M, CONTACT_M, CONTACT_SHARE, CONTACT_LEAST_PX, CONTACT_DEPTH_SLACK, CONTACT_SLACK }
        f32 { CONTACT_SOFT, CONTACT_REACH, CONTACT_GAIN }
        u32 { CONTACT_TAPS }
        // Exposure and tone.
        u32 { MANTISSA_BITS, METER_BINS, METER_THREADS, METER_READS }
        i32 { EXPONENT_BIAS }
        f32 { MAX_RADIANCE, METER_BINS_PER_STOP, METER_MIN_LOG2, METER_CUT }
        f32 { NEUTRAL_START, NEUTRAL_DESATURATION, ROLL_OFF }
        f32 { AGX_MIN_LOG2, AGX_LOG2_RANGE, AGX_POWER, AGX_SATURATION, AGX_GAMMA }
        mat3 { AGX_IN, AGX_OUT }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::fs;
    use std::path::Path;

    /// Text of all files with extension `ext` in a folder of the crate and below, each with its name.
    fn files(folder: &str, ext: &str) -> Vec<(String, String)> {
        let mut open = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
        let mut files = Vec::new();
        while let Some(path) = open.pop() {
            if path.is_dir() {
                open.extend(fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
            } else if path.extension().is_some_and(|found| found == ext) {
                files.push((path.display().to_string(), fs::read_to_string(path).unwrap()));
            }
        }
        assert!(!files.is_empty(), "no *.{ext} in {folder}");
        files
    }

    /// Names in `const NAME` at the beginnings of lines.
    fn declared(text: &str) -> BTreeSet<String> {
        let rest = text
            .lines()
            .filter_map(|line| line.trim_start().split_once("const ").filter(|(before, _)| before.len() < 12));
        let name = |rest: &str| rest.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap().to_owned();
        rest.map(|(_, rest)| name(rest))
            .filter(|name| name.len() > 1 && !name.contains(|c: char| c.is_lowercase()))
            .collect()
    }

    #[test]
    fn no_constant_is_declared_in_rust_and_in_wgsl() {
        let rust: BTreeSet<String> = files("src", "rs").iter().flat_map(|(_, text)| declared(text)).collect();
        let generated = declared(&constants());
        assert!(rust.len() > 80 && generated.len() > 100, "{} {}", rust.len(), generated.len());
        for (name, text) in files("wgsl", "wgsl") {
            for constant in declared(&text) {
                assert!(!rust.contains(&constant) && !generated.contains(&constant), "{name} repeats {constant}");
            }
        }
    }

    #[test]
    fn bindings_and_workgroup_sizes_are_generated() {
        let mut bindings = 0;
        for (name, text) in files("wgsl", "wgsl") {
            for line in text.lines() {
                for attribute in ["@binding(", "@workgroup_size("] {
                    let Some((_, value)) = line.split_once(attribute) else { continue };
                    assert!(!value.starts_with(|c: char| c.is_ascii_digit()), "{name} has a number in {line}");
                    bindings += 1;
                }
            }
        }
        assert_eq!(bindings, 9 + 3 + 4 + 4 + 3 + 3 + 6 + 3, "bindings and workgroup sizes");
    }

    #[test]
    fn every_generated_constant_is_used() {
        let text: String = files("wgsl", "wgsl").into_iter().map(|(_, text)| text).collect();
        let words: BTreeSet<&str> = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').collect();
        for constant in declared(&constants()) {
            assert!(words.contains(constant.as_str()), "no WGSL uses {constant}");
        }
    }

    #[test]
    fn literals_keep_type_and_value() {
        let text = constants();
        for declaration in ["const PAGE_WORDS = 4096u;", "const NODE_CELLS = 64i;", "const MIN_DIRECTION = 1e-12f;"] {
            assert!(text.contains(declaration), "{declaration}");
        }
    }

    /// What compilers make of a source, without names and places in it.
    fn program(source: &str) -> String {
        let module = format!("{:?}", naga::front::wgsl::parse_str(source).unwrap());
        let unnamed: String = module.split('"').step_by(2).collect();
        let is_span = |part: &str| part.starts_with(" start:");
        let after_span = |part: &str| {
            if is_span(part) { part.split_once('}').map_or("", |(_, rest)| rest) } else { part }.to_owned()
        };
        unnamed.split("Span {").map(after_span).collect()
    }

    /// Browsers get the WGSL without what compilers ignore (`build.rs`).
    #[test]
    fn files_for_browsers_make_the_same_programs() {
        let joined = include_str!(concat!(env!("OUT_DIR"), "/browser.wgsl"));
        let names: Vec<&str> = joined.lines().filter_map(|line| line.strip_prefix("//@ ")).collect();
        assert!(names.len() > 20 && !names.contains(&"nearest.wgsl"), "{names:?}");
        for source in [raycast(), compose(), contact(), meter(), hit_counts()] {
            let mut small = source.clone();
            for name in &names {
                let whole = fs::read_to_string(Path::new(env!("OUT_DIR")).join(name)).unwrap();
                small = small.replace(&whole, file_in(joined, name).unwrap());
            }
            assert!(small.len() < source.len(), "{} of {} bytes", small.len(), source.len());
            assert!(!small.contains("//"), "a file is not for browsers");
            assert!(program(&source) == program(&small));
        }
        for unknown in ["compose", "sea", "", "sea.wgsl\n"] {
            assert_eq!(file_in(joined, unknown), None, "{unknown:?}");
        }
    }
}
