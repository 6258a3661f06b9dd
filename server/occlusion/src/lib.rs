//! Ambient occlusion.

mod cpu;
mod depth_map;
mod directions;
mod prepared;
mod settings;

pub use prepared::REACH_RADII;
pub use settings::{
    MAP_PX, MAX_COORDINATE, MAX_COUNT, OccludedMesh, Occlusion, OcclusionError, OcclusionSettings, VIEWS,
};

/// Occlusion on the CPU.
pub fn cpu(
    mesh: OccludedMesh<'_>,
    occluders: &[[[f64; 3]; 3]],
    settings: OcclusionSettings,
    watch: &(dyn Fn(u32) -> bool + Sync),
) -> Result<Occlusion, OcclusionError> {
    let scene = prepared::PreparedScene::new(mesh, occluders, settings)?;
    cpu::run(&scene, &directions::view_pairs(settings.pairs()), settings.bent_normals, watch)
}
