//! Generated cities with any number of buildings, the same on every machine.
//!
//! A smaller city is the middle of a larger one, so the same cameras show what size alone costs. `streets`, `blocks` and `plan` place the buildings,
//! [`Raster`] and `columns` make the columns of a node without holding the whole city, and `triangles` makes a mesh of the same
//! city.

pub mod blocks;
pub mod columns;
pub mod mesh;
pub mod plan;
pub mod streets;
pub mod triangles;

use crate::view::Camera;
use anyhow::{Context, Result};
use blocks::Part;
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
        let raster = Raster::new(&self.plan, corner, self.grid.cell_m_at(id.level()))?;
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

/// Samples along the side of a cell.
pub const SUB: usize = 4;
/// Cells along the side of the raster: the node and one cell around it.
pub const CELLS: usize = NODE_CELLS + 2;
const SIDE: usize = CELLS * SUB;
/// How far parts may extend beyond their block.
const REACH_M: f64 = 4.0;
const STREET: [u8; 3] = [88, 88, 90];

/// One vertical line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub top_m: f32,
    /// Index of the highest part, or [`GROUND`], or [`OUTSIDE`].
    pub part: u32,
    /// Height of the surface under a part that does not reach the ground; otherwise NaN.
    pub under_m: f32,
    pub ground: [u8; 3],
}

pub const GROUND: u32 = u32::MAX;
/// There is no ground.
pub const OUTSIDE: u32 = u32::MAX - 1;

/// The samples of a node and one cell around it.
#[derive(Debug, Clone)]
pub struct Raster {
    pub cell_m: f64,
    low: DVec2,
    pub parts: Vec<Part>,
    samples: Vec<Sample>,
}

impl Raster {
    /// The raster of the node with this south-west corner; `None` outside the city.
    pub fn new(plan: &Plan, corner: DVec2, cell_m: f64) -> Option<Self> {
        let [ground_low, ground_high] = plan.bounds();
        let side_m = cell_m * NODE_CELLS as f64;
        if corner.cmpge(ground_high).any() || (corner + side_m).cmple(ground_low).any() {
            return None;
        }
        let low = corner - cell_m;
        let nothing = Sample { top_m: f32::NEG_INFINITY, part: OUTSIDE, under_m: f32::NAN, ground: STREET };
        let mut raster = Self { cell_m, low, parts: Vec::new(), samples: vec![nothing; SIDE * SIDE] };
        raster.pave(ground_low, ground_high, STREET);
        let high = low + cell_m * CELLS as f64;
        for at in plan.blocks_in(low - REACH_M, high + REACH_M) {
            let Some(block) = plan.block(at) else { continue };
            raster.pave(block.low, block.high, block.ground);
            // Parts above the ground are drawn last.
            for hanging in [false, true] {
                block.parts().filter(|part| (part.bottom_m > 0.0) == hanging).for_each(|part| raster.draw(part));
            }
        }
        Some(raster)
    }

    /// The samples of a cell, row by row. `x` and `y` go from -1 to `NODE_CELLS`.
    pub fn cell(&self, x: i32, y: i32) -> [Sample; SUB * SUB] {
        let (x, y) = ((x + 1) as usize * SUB, (y + 1) as usize * SUB);
        std::array::from_fn(|k| self.samples[(y + k / SUB) * SIDE + x + k % SUB])
    }

    pub fn centre(&self, x: i32, y: i32) -> DVec2 {
        self.low + (DVec2::new(f64::from(x), f64::from(y)) + 1.5) * self.cell_m
    }

    fn step_m(&self) -> f64 {
        self.cell_m / SUB as f64
    }

    /// Samples between two coordinates.
    fn range(&self, from: f64, to: f64, axis: usize) -> std::ops::Range<usize> {
        let place = |v: f64| (((v - self.low[axis]) / self.step_m() - 0.5).ceil().max(0.0) as usize).min(SIDE);
        place(from)..place(to)
    }

    fn pave(&mut self, low: DVec2, high: DVec2, rgb: [u8; 3]) {
        for y in self.range(low.y, high.y, 1) {
            for x in self.range(low.x, high.x, 0) {
                let sample = &mut self.samples[y * SIDE + x];
                sample.ground = rgb;
                if sample.part == OUTSIDE {
                    (sample.part, sample.top_m) = (GROUND, 0.0);
                }
            }
        }
    }

    fn draw(&mut self, part: &Part) {
        let reach = part.reach();
        let (low, high) = (part.centre - reach, part.centre + reach);
        let (step_m, index) = (self.step_m(), self.parts.len() as u32);
        let (columns, mut seen) = (self.range(low.x, high.x, 0), false);
        for y in self.range(low.y, high.y, 1) {
            for x in columns.clone() {
                let p = self.low + (DVec2::new(x as f64, y as f64) + 0.5) * step_m;
                let local = part.local(p);
                if local.abs().cmpgt(part.half).any() {
                    continue;
                }
                let sample = &mut self.samples[y * SIDE + x];
                let top_m = part.top_at(local) as f32;
                if top_m <= sample.top_m || sample.part == OUTSIDE {
                    continue;
                }
                let hangs = part.bottom_m as f32 > sample.top_m;
                sample.under_m = if hangs { sample.top_m } else { f32::NAN };
                (sample.top_m, sample.part, seen) = (top_m, index, true);
            }
        }
        if seen {
            self.parts.push(*part);
        }
    }
}
