//! What follows from a whole scene, before its triangles are sorted: of a plain bake, and of one in steps.

use super::hashed::city_grid;
use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::ground::{GroundOption, GroundReport};
use crate::progress::Progress;
use crate::read::FarModels;
use crate::scene::grid::CityGrid;
use crate::scene::scratch_scene::ScratchScene;
use crate::write::city::SceneFacts;

/// A city's facts, ground and place of the quadtree.
pub(super) struct CityFrame {
    pub(super) facts: SceneFacts,
    pub(super) ground: Option<GroundReport>,
    pub(super) grid: CityGrid,
    /// Height of the plane above the grid's height zero, if generated ground ends at it.
    pub(super) plane_m: Option<f32>,
}

impl CityFrame {
    /// `land` is around the city. `add_ground` adds generated ground to the city, if it is wanted. Fails if that fails, if there are no
    /// triangles, or if the city is too wide for the cell size.
    pub(super) fn new(
        city: &mut ScratchScene,
        land: Option<&FarModels>,
        config: &BakeConfig,
        progress: &dyn Progress,
        add_ground: impl FnOnce(&mut ScratchScene) -> Result<Option<GroundReport>, BakeError>,
    ) -> Result<Self, BakeError> {
        let cell_m = config.options.cell_m;
        let Some(bounds) = city.bounds else {
            return Err(BakeError::Empty { triangles: 0, cell_m });
        };
        let mut facts = SceneFacts::new(city, bounds)?;
        // Where the land goes on, there are no gaps to fill.
        let has_ground = land.is_none() && config.options.ground == GroundOption::Auto;
        let ground = if has_ground { add_ground(city)? } else { None };
        facts.set_ground(ground.as_ref());
        facts.include_land(land.map(|land| land.z_range_m[0]));
        let bounds = city.bounds.unwrap_or(bounds);
        let covering = city_grid(city, bounds, land, cell_m)?;
        let base = config.base.as_ref().filter(|_| land.is_none());
        let grid = match base.map(|base| base.grid(city.origin, bounds)) {
            Some(Some(of_base)) => of_base,
            Some(None) => {
                progress.warn("the city reaches beyond that of --version-of, so they have no tiles in common; bake the larger one first");
                covering
            }
            None => covering,
        };
        let above_zero = |ground: &GroundReport| (ground.plane_z_m - city.origin[2] - grid.corner[2]) as f32;
        let plane_m = ground.as_ref().filter(|ground| !ground.around_terrain).map(above_zero);
        Ok(Self { facts, ground, grid, plane_m })
    }
}
