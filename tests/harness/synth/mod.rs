//! Generated cities with any number of buildings, the same on every machine.
//!
//! A smaller city is the middle of a larger one, so the same cameras show what size alone costs. `streets`, `blocks` and `plan` place the buildings,
//! `raster` and `columns` make the columns of a node without holding the whole city, and `triangles` makes a mesh of the same
//! city.

pub mod blocks;
pub mod columns;
pub mod mesh;
pub mod plan;
pub mod raster;
pub mod streets;
pub mod triangles;

use crate::view::Camera;
use anyhow::{Context, Result};
use glam::{DVec2, DVec3};
use insula_bake::scene::grid::CityGrid;
use insula_bake::{BakeOptions, GeneratedCity, Progress, bake_generated};
use insula_protocol::blockmap::Quality;
use insula_protocol::tile_id::MAX_LEVEL;
use insula_protocol::{Manifest, NODE_CELLS, TileId};
use plan::Plan;
use std::path::Path;

pub const MAX_HEIGHT_M: f64 = 190.0;

/// A plan and its quadtree.
#[derive(Debug, Clone)]
pub struct City {
    pub plan: Plan,
    /// The centre of the root is the centre of the city.
    pub grid: CityGrid,
}

impl City {
    /// A city of exactly `buildings` buildings with leaf cells of `cell_m`.
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
        let generated = GeneratedCity {
            grid: self.grid,
            bounds: [low.extend(0.0).into(), high.extend(MAX_HEIGHT_M).into()],
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
        Ok(bake_generated(&generated, &|id| self.node(id), &options, progress)?)
    }

    /// The columns of a node; `None` outside the city.
    pub fn node(&self, id: TileId) -> Option<insula_bake::columns::voxels::VoxelNode> {
        let corner = DVec2::from(self.grid.node_corner(id));
        let raster = raster::Raster::new(&self.plan, corner, self.grid.cell_m_at(id.level()))?;
        columns::node(id, &raster)
    }
}

/// Cameras of the measurements: the same in cities of every size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Viewpoint {
    /// In the middle of a street, along it.
    Street,
    /// Above the roofs, almost level.
    Roof,
    /// High above the centre, looking down at an angle.
    Aerial,
}

impl Viewpoint {
    pub const ALL: [Self; 3] = [Self::Street, Self::Roof, Self::Aerial];

    pub const fn word(self) -> &'static str {
        match self {
            Self::Street => "street",
            Self::Roof => "roof",
            Self::Aerial => "aerial",
        }
    }

    pub fn camera(self) -> Camera {
        let street = DVec2::new(streets::street(0, 0), streets::street(1, 0) + 30.0);
        let (position, ahead) = match self {
            Self::Street => (street.extend(1.7), DVec3::new(0.06, 1.0, 0.02)),
            Self::Roof => (street.extend(32.0), DVec3::new(0.55, 1.0, -0.08)),
            Self::Aerial => (DVec3::new(0.0, -150.0, 420.0), DVec3::new(0.15, 1.0, -0.7)),
        };
        Camera::looking(position, position + ahead)
    }
}
