//! Measures potentially visible sets: whether they are complete, how tight they are, and their bytes.
//!
//! `cargo run --release -p insula-measure --bin visibility -- CITY`: random eyes in random cells of a baked city cast random rays at the
//! leaves' columns. A ray that hits a leaf which the set of its cell lacks is a miss.

use anyhow::{Context, Result, ensure};
use clap::Parser;
use insula_archive::BakedCity;
use insula_protocol::blockmap::flag;
use insula_protocol::visibility_tile::{LAYERS, block_of_leaf};
use insula_protocol::{BlockMap, NODE_CELLS, TileId, TileKind, VisibilityTile};
use insula_shaders::layout::Shading;
use insula_tests::draw_list::{CityArea, DrawList};
use insula_tests::rng::Rng;
use insula_tests::view::{Camera, FrameSpec};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Measures potentially visible sets
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the baked city, with sets
    city: PathBuf,
    /// Number of random cells
    #[arg(long, default_value_t = 100)]
    cells: usize,
    /// Rays of each cell; each eye has 64
    #[arg(long, default_value_t = 10_240)]
    rays: usize,
    /// Highest layer of the eyes, 0 to 2
    #[arg(long, default_value_t = LAYERS - 1)]
    layer: usize,
}

/// Width and height of an eye's frame.
const FRAME_PX: u32 = 8;

fn main() -> Result<()> {
    let args = Args::parse();
    let city = BakedCity::open(&args.city)?;
    let archive = city.archive(TileKind::Visibility).context("the city has no sets")?;
    let share = archive.file_bytes() as f64 / (city.file_bytes() - archive.file_bytes()) as f64;
    let tiles: Vec<u32> = archive.lengths().map(|(_, length)| length).collect::<Result<_, _>>()?;
    println!(
        "{}: {} tiles of {} to {} bytes, {} kB, {:.2} % of the city",
        args.city.display(),
        tiles.len(),
        tiles.iter().min().unwrap_or(&0),
        tiles.iter().max().unwrap_or(&0),
        archive.file_bytes() / 1000,
        share * 100.0
    );
    let mut totals = Totals::default();
    let mut random = Rng::new(7);
    let depth = city.manifest().depth;
    let leaves: Vec<TileId> = city.blockmaps().lengths().map(|(id, _)| id).filter(|id| id.level() == depth).collect();
    for _ in 0..args.cells {
        let leaf = leaves[random.below(leaves.len())];
        totals.add_cell(&city, leaf, &args, &mut random)?;
    }
    println!(
        "eyes up to layer {}: {} rays, {} hits, {} misses; sets {} leaves, seen {}, {:.2} times",
        args.layer,
        totals.rays,
        totals.hits,
        totals.misses,
        totals.in_sets,
        totals.seen,
        totals.in_sets as f64 / totals.seen.max(1) as f64
    );
    ensure!(totals.misses == 0, "sets are incomplete");
    Ok(())
}

#[derive(Debug, Default)]
struct Totals {
    rays: u64,
    hits: u64,
    misses: u64,
    in_sets: usize,
    seen: usize,
}

impl Totals {
    fn add_cell(&mut self, city: &BakedCity, leaf: TileId, args: &Args, random: &mut Rng) -> Result<()> {
        let block = block_of_leaf(leaf);
        let bytes = city.tile(TileKind::Visibility, block)?.context("a block has no sets")?;
        let tile = VisibilityTile::decode(block, &bytes)?;
        let index = tile.cell_index(leaf.x(), leaf.y()).context("a cell is missing")?;
        let cell = tile.cells[index].as_ref().context("a leaf has no cell")?;
        let manifest = city.manifest();
        let (list, maps) = around(city, leaf, u32::from(tile.reach))?;
        let Some(own) = maps.get(&leaf) else { return Ok(()) };
        let top_m = f64::from(cell.ground) / 2.0 + f64::from(tile.layers_dm[args.layer]) / 10.0;
        let mut seen = BTreeSet::new();
        let mut rays = 0;
        // Cells in buildings may have few places for eyes.
        for _ in 0..20 * args.rays / (FRAME_PX * FRAME_PX) as usize {
            if rays >= args.rays {
                break;
            }
            let Some(eye) = random_eye(own, top_m, random) else { continue };
            rays += (FRAME_PX * FRAME_PX) as usize;
            let corner = manifest.node_corner(leaf);
            let position = [corner[0] + eye[0], corner[1] + eye[1], manifest.origin[2] + eye[2]];
            let set = tile.set_at(leaf.x(), leaf.y(), eye[2]).context("an eye is in no layer")?;
            let angle = random.unit() * std::f64::consts::TAU;
            let pitch = (random.unit() - 0.4) * 1.2;
            let target = [position[0] + angle.cos(), position[1] + angle.sin(), position[2] + pitch];
            let camera = Camera { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 60.0 };
            let spec = FrameSpec { width_px: FRAME_PX, height_px: FRAME_PX, shading: Shading::Objects, samples: 1 };
            let pixels = list.scene(&camera, &spec).render();
            for hit in pixels.hit.iter().filter_map(|hit| list.id(*hit)) {
                self.hits += 1;
                if !set.may_see(hit) {
                    self.misses += 1;
                    println!("miss: {hit} from {position:?} in the cell of {leaf}");
                }
                seen.insert(hit);
            }
        }
        self.rays += rays as u64;
        if rays > 0 {
            // Of the set, leaves that exist.
            // The first scale.
            let side = 2 * usize::from(tile.reach) + 1;
            let at = |first: u32, place: usize| (first + place as u32).checked_sub(u32::from(tile.reach));
            let exists = |i: &usize| {
                let (x, y) = (at(leaf.x(), i % side), at(leaf.y(), i / side));
                let id = x.zip(y).and_then(|(x, y)| TileId::new(leaf.level(), x, y));
                cell.seen[*i] as usize <= args.layer && id.is_some_and(|id| maps.contains_key(&id))
            };
            self.in_sets += (0..side * side).filter(exists).count();
            self.seen += seen.iter().filter(|id| id.level() == leaf.level()).count();
        }
        Ok(())
    }
}

/// The leaves within `reach` of one, as they are drawn.
fn around(city: &BakedCity, leaf: TileId, reach: u32) -> Result<(DrawList, BTreeMap<TileId, BlockMap>)> {
    let manifest = city.manifest();
    let mut list = DrawList::new(CityArea { origin: manifest.origin, root_side_m: manifest.root_side_m });
    let mut maps = BTreeMap::new();
    for y in leaf.y().saturating_sub(reach)..=leaf.y() + reach {
        for x in leaf.x().saturating_sub(reach)..=leaf.x() + reach {
            let Some(id) = TileId::new(leaf.level(), x, y) else { continue };
            let Some(bytes) = city.tile(TileKind::BlockMap, id)? else { continue };
            let map = BlockMap::decode(id, &bytes)?.stand_on_ground();
            list.add(&map);
            maps.insert(id, map);
        }
    }
    Ok((list, maps))
}

/// A place above a column: metres from the node's corner, and above the city's origin.
fn random_eye(map: &BlockMap, top_m: f64, random: &mut Rng) -> Option<[f64; 3]> {
    let cell_m = f64::from(map.cell_m);
    let [x, y] = [random.unit(), random.unit()].map(|v| v * NODE_CELLS as f64);
    let i = y as usize * NODE_CELLS + x as usize;
    let is_occupied = map.flags[i] & flag::OCCUPIED != 0;
    // Slopes rise by less than a few cells within a column.
    let rise_m = if map.flags[i] & flag::INCLINED != 0 { 0.5 * cell_m } else { 0.05 };
    let low_m = map.z_base_m() + f64::from(map.z_max[i]) * f64::from(map.z_step_m()) + rise_m;
    let low_m = if is_occupied { low_m } else { top_m - 3.0 };
    (low_m < top_m).then(|| [x * cell_m, y * cell_m, low_m + random.unit() * (top_m - low_m)])
}
