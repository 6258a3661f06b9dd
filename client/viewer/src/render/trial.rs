//! A small city in memory that shows how fast a ray-caster is before any tile is there.
//!
//! Streets between blocks of houses, seen over the roofs: about a third of the frame is sky.

use crate::cache::Upload;
use crate::camera::{Camera, View};
use crate::frame::{FrameData, MOVING_SAMPLES, RenderSettings, frame_uniform};
use crate::select::occlusion_feedback::OcclusionQuery;
use glam::DVec3;
use insula_protocol::blockmap::{COLUMNS, MapColumn, WallStrip, strip_rows, voxel_error_m};
use insula_protocol::texel::{AO_MAX, Texel};
use insula_protocol::{BlockMap, DecodeError, NODE_CELLS, TileId, octahedral};
use insula_shaders::grid::{GridBuilder, GridFrame};
use insula_shaders::layout::{DrawNode, PLANES};
use insula_shaders::pack::PackedNode;
use insula_shaders::stone::{MAX_STONES, Stone};

/// Nodes along a side of the city, all with the same columns.
const NODES_PER_SIDE: u32 = 1 << LEVEL;
const LEVEL: u8 = 3;
/// Cells from a street to the next.
const BLOCK_CELLS: usize = 16;
const STREET_CELLS: usize = 5;
/// Height codes of the street, and of a metre: columns have a side of 1 m.
const STREET_CODES: u16 = 16;
const CODES_PER_M: u16 = 16;

/// The city of a trial.
#[derive(Debug, Clone)]
pub struct TrialCity {
    packed: PackedNode,
}

impl TrialCity {
    /// The city. Fails if its columns are no valid node, which a test excludes.
    pub fn new() -> Result<Self, DecodeError> {
        let columns: Vec<Option<MapColumn>> =
            (0..COLUMNS).map(|i| Some(column(i % NODE_CELLS, i / NODE_CELLS))).collect();
        let mut packed = PackedNode::new(&BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns)?);
        let pages: Vec<u32> = (0..packed.pages.len() as u32).collect();
        packed.relocate(&pages);
        Ok(Self { packed })
    }

    /// Number of cache pages that it takes.
    pub fn pages(&self) -> u32 {
        self.packed.pages.len() as u32
    }

    /// Writes it into the first pages and the first slot of an atlas in which nothing is yet.
    pub fn upload(&self, atlas: &mut impl Upload) {
        for (page, words) in (0u32..).zip(&self.packed.pages) {
            atlas.write_page(page, words);
        }
        atlas.write_summary(0, &self.packed.summary);
    }

    /// A frame of it, with as many rays as a window draws while the camera moves.
    pub fn frame(&self, size_px: [u32; 2]) -> FrameData {
        let side_m = NODE_CELLS as f64;
        let eye = DVec3::new(20.0, 14.0, 45.0);
        let camera = Camera::from_angles(eye, 0.7, -0.15, 60f64.to_radians());
        let view = View::of(camera, size_px);
        let settings = RenderSettings { samples: MOVING_SAMPLES, ..RenderSettings::default() };
        let mut frame = frame_uniform(&view, &settings, 0.0, &[Stone::NONE; MAX_STONES]);
        let places = (0..NODES_PER_SIDE * NODES_PER_SIDE).map(|i| [i % NODES_PER_SIDE, i / NODES_PER_SIDE]);
        let ids: Vec<TileId> = places.clone().filter_map(|[x, y]| TileId::new(LEVEL, x, y)).collect();
        let nodes: Vec<DrawNode> =
            places.map(|[x, y]| self.node(DVec3::new(f64::from(x), f64::from(y), 0.0) * side_m - eye)).collect();
        let root_side_m = side_m * f64::from(NODES_PER_SIDE);
        let root_distance_m = voxel_error_m(f64::from(NODES_PER_SIDE)) * view.focal_px();
        let area = GridFrame { root_corner: -eye, root_side_m, root_distance_m };
        let mut builder = GridBuilder::default();
        let grid = builder.build(&area, &ids, &nodes);
        grid.head.write(&mut frame);
        let query = OcclusionQuery { nodes: Vec::new(), view, generation: 0 };
        FrameData { frame, grid: grid.entries.clone(), nodes, query, error_px: 0.0 }
    }

    /// A node whose south-west corner is at a place relative to the eye.
    fn node(&self, corner: DVec3) -> DrawNode {
        let packed = &self.packed;
        let planes = std::array::from_fn::<_, PLANES, _>(|plane| plane as u32);
        DrawNode {
            corner: corner.as_vec3().to_array(),
            cell_m: packed.cell_m,
            z_step_m: packed.z_step_m,
            z_lo: packed.z_range[0],
            z_hi: packed.z_range[1],
            slot_and_shift: DrawNode::slot_and_shift(0, packed.z_shift),
            pages: DrawNode::pages_and_quarters(planes, packed.below),
            level: u32::from(LEVEL),
            ..bytemuck::Zeroable::zeroed()
        }
    }
}

/// The column of a cell: street, or a house of its block.
fn column(x: usize, y: usize) -> MapColumn {
    let up = octahedral::encode([0.0, 0.0, 1.0]);
    let (east, north) = (x % BLOCK_CELLS, y % BLOCK_CELLS);
    if east < STREET_CELLS || north < STREET_CELLS {
        let roof = Texel::new([120, 118, 115], AO_MAX / 2);
        return MapColumn { z_min: 0, z_max: STREET_CODES, roof, roof_normal: up, ..MapColumn::default() };
    }
    // Houses of 6 to 30 m.
    let house = (x / BLOCK_CELLS) * 7 + (y / BLOCK_CELLS) * 11;
    let z_max = STREET_CODES + CODES_PER_M * (6 + (house * 5 % 25) as u16);
    let side = |at: usize| at == STREET_CELLS || at == BLOCK_CELLS - 1;
    let strip = (side(east) || side(north)).then(|| {
        let shade = |row: u16| Texel::new([if row.is_multiple_of(3) { 90 } else { 190 }, 160, 140], AO_MAX / 2);
        let azimuth = match (east, north) {
            (STREET_CELLS, _) => 128,
            (_, STREET_CELLS) => 192,
            (east, _) if east == BLOCK_CELLS - 1 => 0,
            _ => 64,
        };
        WallStrip { texels: (0..strip_rows(0, z_max, 0).1).map(shade).collect(), azimuth }
    });
    let roof = Texel::new([150, (90 + house) as u8, 80], AO_MAX);
    MapColumn { z_min: 0, z_max, roof, roof_normal: up, strip, ..MapColumn::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::CpuAdapter;

    #[test]
    fn the_city_is_valid_and_fills_most_of_the_frame() {
        let city = TrialCity::new().unwrap();
        let mut cpu = CpuAdapter::new(city.pages());
        city.upload(&mut cpu);
        let data = city.frame([160, 90]);
        let pixels = cpu.draw(&data);
        let hit = pixels.distance.iter().filter(|metres| metres.is_finite()).count();
        let share = hit as f64 / pixels.distance.len() as f64;
        assert!((0.4..0.9).contains(&share), "{share} of the frame shows the city");
        let nodes: std::collections::BTreeSet<u32> = pixels.hit.iter().copied().collect();
        assert!(nodes.len() > 10, "rays meet {} nodes only", nodes.len());
        assert!(cpu.count(&data).fetches > 0);
    }
}
