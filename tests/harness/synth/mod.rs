//! Cities by rule: as many buildings as are asked for, the same ones on every machine, without a source file.
//!
//! Around the middle of the city all sizes are alike: a city of a thousand buildings is the middle of one of a million. So
//! the same cameras show what the size alone costs. `plan` says what stands where, `raster` and `columns` make a node of
//! what stands in it (of a million buildings none is held), `triangles` gives the same city as a mesh.

pub mod blocks;
pub mod columns;
pub mod mesh;
pub mod plan;
pub mod raster;
pub mod triangles;

use crate::view::Camera;
use anyhow::{Context, Result};
use glam::{DVec2, DVec3};
use insula_bake::{BakeOptions, GeneratedCity, Progress, bake_generated, scene::grid::CityGrid};
use insula_protocol::{Manifest, NODE_CELLS, TileId, blockmap::Quality, tile_id::MAX_LEVEL};
use plan::Plan;
use std::path::Path;

/// Raised whenever the same number of buildings would give another city.
const RULE: &str = "synth 1";
/// Highest point that any building may reach.
pub const HIGHEST_M: f64 = 190.0;

/// A plan on the quadtree's grid.
#[derive(Debug, Clone)]
pub struct City {
    pub plan: Plan,
    /// Where nodes lie; the middle of the root square is the middle of the city.
    pub grid: CityGrid,
}

impl City {
    /// Of exactly `buildings` buildings, with leaves of `cell_m`.
    pub fn new(buildings: u64, cell_m: f64) -> Result<Self> {
        let plan = Plan::new(buildings);
        let [low, high] = plan.bounds();
        let reach = low.abs().max(high.abs()).max_element();
        let leaf_m = cell_m * NODE_CELLS as f64;
        let depth =
            (1..=MAX_LEVEL).find(|d| leaf_m * f64::from(1u32 << (d - 1)) >= reach).context("too many levels")?;
        let half = leaf_m * f64::from(1u32 << (depth - 1));
        Ok(Self { plan, grid: CityGrid { corner: [-half, -half, 0.0], depth, cell_m } })
    }

    pub fn write(&self, out: &Path, threads: Option<usize>, progress: &dyn Progress) -> Result<Manifest> {
        let [low, high] = self.plan.bounds();
        let totals = self.plan.totals();
        let made = GeneratedCity {
            grid: self.grid,
            rule: format!("{RULE}, {} buildings", totals.buildings),
            bounds: [low.extend(0.0).into(), high.extend(HIGHEST_M).into()],
            ground_z_m: 0.0,
            objects: totals.buildings,
            triangles: totals.triangles,
        };
        let title = Some(format!("{} buildings by rule", totals.buildings));
        let quality = Quality::Lossless;
        let options = BakeOptions {
            out: out.to_owned(),
            cell_m: self.grid.cell_m,
            threads,
            title,
            quality,
            ..BakeOptions::default()
        };
        Ok(bake_generated(&made, &|id| self.node(id), &options, progress)?)
    }

    /// A node's columns; `None` where the city is not.
    pub fn node(&self, id: TileId) -> Option<insula_bake::columns::voxels::VoxelNode> {
        let corner = DVec2::from(self.grid.node_corner(id));
        let raster = raster::Raster::new(&self.plan, corner, self.grid.cell_m_at(id.level()))?;
        columns::node(id, &raster)
    }
}

/// Where the cameras of the benches stand: the same places in cities of every size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stand {
    /// In the middle of a street, along it.
    Street,
    /// Over the roofs, almost level.
    Roof,
    /// High over the middle, a third of the way down.
    Aerial,
}

impl Stand {
    pub const ALL: [Self; 3] = [Self::Street, Self::Roof, Self::Aerial];

    pub const fn word(self) -> &'static str {
        match self {
            Self::Street => "street",
            Self::Roof => "roof",
            Self::Aerial => "aerial",
        }
    }

    pub fn camera(self) -> Camera {
        let street = DVec2::new(plan::street(0, 0), plan::street(1, 0) + 30.0);
        let (position, ahead) = match self {
            Self::Street => (street.extend(1.7), DVec3::new(0.06, 1.0, 0.02)),
            Self::Roof => (street.extend(32.0), DVec3::new(0.55, 1.0, -0.08)),
            Self::Aerial => (DVec3::new(0.0, -150.0, 420.0), DVec3::new(0.15, 1.0, -0.7)),
        };
        Camera::looking(position, position + ahead)
    }
}
