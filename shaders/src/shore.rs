//! The ends of a city in water: where the sea goes on beyond what the source describes.
//!
//! A manifest tells it, if the bake knows what is sea. Else it is found in the V-BlockMap of the whole city. By fields of
//! [`FrameUniform`], rays that meet the plane, or generated ground, beyond the city see the sea.

use crate::layout::{FrameUniform, ROOF_PLANE, WALK_PLANE};
use crate::pack::{FLAGS_SHIFT, PackedNode};
use crate::srgb::linear_of;
use glam::{DVec2, Vec3};
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::flag;
use insula_protocol::blockmap::ground::GROUND_COLOUR;
use insula_protocol::sea::{PARTS, SeaEnds, SeaSides};
use insula_protocol::texel::Texel;

/// Largest number of steps inwards: it has four bits.
const MOST_STEPS: u16 = 15;
/// Far from the map, coasts are blurred by this many parts (standard deviation).
const BLUR_PARTS: f32 = 5.0;
const ALL_PARTS: usize = 4 * PARTS;

/// What counts as an end in the sea.
#[derive(Debug, Clone, Copy)]
struct Rules {
    /// Land beside the sea that the source does not describe may be this many cells of the coarsest V-BlockMap wide.
    bare_cells: usize,
    /// The sea is at least this many cells wide from the side inwards: a pond or river ends with the map.
    sea_cells: usize,
    /// Shorter ends of the sea are harbours or river mouths.
    sea_parts: usize,
    /// Shorter ends of land in the sea are piers, which end, too, or corners of a map that is not parallel to the city's axes.
    land_parts: usize,
}

/// Of water that may be no sea, in cells of the coarsest V-BlockMap.
const GUESSED: Rules = Rules { bare_cells: 12, sea_cells: 3, sea_parts: 4, land_parts: 6 };
/// Of what is known to be sea: a narrow arm or a basin, too. A strip of a single part would be a canal to the horizon.
const KNOWN: Rules = Rules { bare_cells: 5, sea_cells: 1, sea_parts: 2, land_parts: 4 };

/// Where a city ends in water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shore {
    /// West, south, east and north end of what the source describes, in cells of the city's coarsest V-BlockMap.
    ends: [f64; 4],
    /// Length of a step inwards, in these cells.
    step: f64,
    /// Parts of the west, south, east and north end, from west to east or from south to north: steps inwards from the end in which bare
    /// ground is sea; 0 for land.
    sides: SeaSides,
    /// How much of what lies far beyond each part is sea, 0 to 15.
    shares: SeaSides,
    /// Colour of most of the water, linear.
    albedo: Vec3,
}

/// The top of a cell, as seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cell {
    /// Nothing, or generated ground.
    Bare,
    Water,
    Other,
}

/// Where a map of cells ends in water.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellEnds {
    /// West, south, east and north end of the cells that are not bare.
    pub ends: [usize; 4],
    /// Length of a step, in cells.
    pub step: usize,
    /// Steps inwards from the ends in which bare ground is sea; 0 for land.
    pub sides: SeaSides,
}

impl CellEnds {
    /// Of a square map of a city, row by row from the south-west, whose water is all sea; `side` is its number of cells along a side, a
    /// multiple of [`NODE_CELLS`]. `None` if none of its ends is sea.
    pub fn of_sea(cells: &[Cell], side: usize) -> Option<Self> {
        Self::new(cells, side, KNOWN)
    }

    fn new(cells: &[Cell], side: usize, rules: Rules) -> Option<Self> {
        let described = || (0..cells.len()).filter(|i| cells[*i] != Cell::Bare).map(|i| [i % side, i / side]);
        let [west, south] = [0, 1].map(|axis| described().map(|place| place[axis]).min().unwrap_or(0));
        let [east, north] = [0, 1].map(|axis| described().map(|place| place[axis] + 1).max().unwrap_or(0));
        let ends = [west, south, east, north];
        let mut inwards = [0, 1, 2, 3].map(|end| sea_along(cells, side, ends, end, rules));
        leave_out_short_runs(&mut inwards, rules);
        let most = inwards.as_flattened().iter().copied().max().unwrap_or(0);
        let step = most.div_ceil(MOST_STEPS);
        // None is longer than so many steps.
        let sides = inwards.map(|end| end.map(|cells| if step > 0 { cells.div_ceil(step) as u8 } else { 0 }));
        (step > 0).then_some(Self { ends, step: step.into(), sides })
    }
}

impl Shore {
    /// The shore of the city whose coarsest V-BlockMap is `root`; `None` if none of its ends is sea.
    pub fn of(root: &PackedNode) -> Option<Self> {
        let (mut cells, mut water) = (Vec::with_capacity(NODE_CELLS * NODE_CELLS), Vec::new());
        for i in 0..NODE_CELLS * NODE_CELLS {
            let flags = root.pages.get(WALK_PLANE)?.get(i)? >> FLAGS_SHIFT;
            let roof = Texel(*root.pages.get(ROOF_PLANE)?.get(i)?);
            let has = |bit: u8| flags & u32::from(bit) != 0;
            cells.push(if has(flag::REFLECTIVE) {
                water.push(linear_of(roof.0));
                Cell::Water
            } else if !has(flag::OCCUPIED) || roof.rgb() == GROUND_COLOUR {
                Cell::Bare
            } else {
                Cell::Other
            });
        }
        // Cells at coasts have the colours of land, too.
        let albedo = median(&water)?;
        let CellEnds { ends, step, sides } = CellEnds::new(&cells, NODE_CELLS, GUESSED)?;
        let ends = ends.map(|end| end as f64);
        Some(Self { ends, step: step as f64, sides, shares: blurred(&sides), albedo })
    }

    /// The shore that a manifest tells, for a coarsest V-BlockMap with its south-west corner at `corner`, in metres of the world, and cells
    /// of `cell_m`. `None` if its sides are damaged.
    pub fn known(sea: &SeaEnds, corner: DVec2, cell_m: f64) -> Option<Self> {
        let sides = sea.sides()?;
        let [[west, south], [east, north]] = sea.ends.map(|end| ((DVec2::from(end) - corner) / cell_m).to_array());
        let albedo = linear_of(Texel::new(sea.rgb, 0).0);
        let ends = [west, south, east, north];
        Some(Self { ends, step: sea.step_m / cell_m, sides, shares: blurred(&sides), albedo })
    }

    /// Tells a frame of it. `corner` is the south-west corner of the V-BlockMap in metres from the camera, `side_m` its side.
    pub fn write(&self, frame: &mut FrameUniform, corner: DVec2, side_m: f64) {
        let cell_m = side_m / NODE_CELLS as f64;
        let [west, south, east, north] = self.ends;
        let (low, high) = (corner + DVec2::new(west, south) * cell_m, corner + DVec2::new(east, north) * cell_m);
        frame.shore = [low.x, low.y, high.x, high.y].map(|v| v as f32);
        let parts = self.sides.as_flattened().iter().zip(self.shares.as_flattened());
        for (part, (steps, share)) in parts.enumerate() {
            let word = &mut frame.sea.as_flattened_mut()[part / 4];
            *word = *word & !(0xff << (part % 4 * 8)) | u32::from(share << 4 | steps) << (part % 4 * 8);
        }
        frame.sea_albedo = self.albedo.extend((1.0 / (self.step * cell_m)) as f32).to_array();
    }
}

/// The median of each channel.
fn median(colours: &[Vec3]) -> Option<Vec3> {
    let middle = |channel: usize| {
        let mut values: Vec<f32> = colours.iter().map(|colour| colour[channel]).collect();
        let middle = values.len() / 2;
        (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
    };
    Some(Vec3::new(middle(0)?, middle(1)?, middle(2)?))
}

/// Side and part on the way around the map, from the north-west corner by the south.
fn stored_at(part: usize) -> [usize; 2] {
    let (side, along) = (part / PARTS, part % PARTS);
    [side, if side == 0 || side == 3 { PARTS - 1 - along } else { along }]
}

/// Makes land of short ends of the sea, and sea of short ends of land between them.
fn leave_out_short_runs(sides: &mut [[u16; PARTS]; 4], rules: Rules) {
    let mut ring: [u16; ALL_PARTS] = std::array::from_fn(|part| {
        let [side, along] = stored_at(part);
        sides[side][along]
    });
    let is_first = |part: &usize| (ring[*part] > 0) != (ring[(*part + ALL_PARTS - 1) % ALL_PARTS] > 0);
    let Some(first) = (0..ALL_PARTS).find(is_first) else { return };
    ring.rotate_left(first);
    for (filled, least) in [(1, rules.land_parts), (0, rules.sea_parts)] {
        for run in ring.chunk_by_mut(|a, b| (*a > 0) == (*b > 0)) {
            if run.len() < least && (run[0] > 0) != (filled > 0) {
                run.fill(filled);
            }
        }
    }
    ring.rotate_right(first);
    for (part, cells) in ring.into_iter().enumerate() {
        let [side, along] = stored_at(part);
        sides[side][along] = cells;
    }
}

/// How much of the sea is near to each part on the way around the map, 0 to 15.
fn blurred(sides: &SeaSides) -> SeaSides {
    let is_sea: [bool; ALL_PARTS] = std::array::from_fn(|part| {
        let [side, along] = stored_at(part);
        sides[side][along] > 0
    });
    let weight = |steps: usize| (-0.5 * (steps as f32 / BLUR_PARTS).powi(2)).exp();
    let reach = 3 * BLUR_PARTS as usize;
    let mut shares = [[0; PARTS]; 4];
    for part in 0..ALL_PARTS {
        let [mut sea, mut all] = [0.0, 0.0];
        for step in 0..=2 * reach {
            let w = weight(step.abs_diff(reach));
            all += w;
            sea += if is_sea[(part + ALL_PARTS + step - reach) % ALL_PARTS] { w } else { 0.0 };
        }
        let [side, along] = stored_at(part);
        shares[side][along] = (sea / all * 15.0).round() as u8;
    }
    shares
}

/// The parts of an end (west, south, east, north): cells inwards in which bare ground is sea.
fn sea_along(
    cells: &[Cell],
    side: usize,
    [west, south, east, north]: [usize; 4],
    end: usize,
    rules: Rules,
) -> [u16; PARTS] {
    let (low, high) = if end.is_multiple_of(2) { (south, north) } else { (west, east) };
    let most_bare = rules.bare_cells * side / NODE_CELLS;
    let part_of = |part: usize| {
        let along = low + (high - low) * (2 * part + 1) / (2 * PARTS);
        let inwards = |k: usize| {
            let place = match end {
                0 => (west + k < east).then(|| [west + k, along]),
                1 => (south + k < north).then(|| [along, south + k]),
                2 => (west + k < east).then(|| [east - 1 - k, along]),
                _ => (south + k < north).then(|| [along, north - 1 - k]),
            };
            place.map(|[x, y]| cells[y * side + x])
        };
        let first = (0..=most_bare).find(|k| inwards(*k).is_some_and(|cell| cell != Cell::Bare))?;
        // Where the map ends within a cell, its colour is that of water and bare ground.
        let first = first + usize::from(inwards(first) == Some(Cell::Other));
        (first..first + rules.sea_cells).all(|k| inwards(k) == Some(Cell::Water)).then_some(first as u16 + 1)
    };
    std::array::from_fn(|part| part_of(part).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use insula_protocol::blockmap::MapColumn;
    use insula_protocol::texel::AO_MAX;
    use insula_protocol::{BlockMap, TileId};

    /// A city that is described from cell 8 to 40 on both axes, within bare ground: sea in the south and east, houses elsewhere.
    fn coast(at: impl Fn(usize, usize) -> Option<(bool, [u8; 3])>) -> PackedNode {
        let columns: Vec<Option<MapColumn>> = (0..NODE_CELLS * NODE_CELLS)
            .map(|i| {
                let (reflective, rgb) = at(i % NODE_CELLS, i / NODE_CELLS)?;
                let roof = Texel::new(rgb, AO_MAX);
                Some(MapColumn { z_min: 0, z_max: 4, reflective, roof, ..MapColumn::default() })
            })
            .collect();
        PackedNode::new(&BlockMap::from_columns(TileId::ROOT, 10.0, 0, 0, &columns).unwrap())
    }

    fn town(x: usize, y: usize, is_water: impl Fn(usize, usize) -> bool) -> Option<(bool, [u8; 3])> {
        match (8..40).contains(&x) && (8..40).contains(&y) {
            true if is_water(x, y) => Some((true, [60, 120, 150])),
            true => Some((false, [230, 220, 210])),
            false => (x < 48 && y < 48).then_some((false, GROUND_COLOUR)),
        }
    }

    #[test]
    fn the_sea_goes_on_where_a_city_ends_in_it() {
        // At the eastern end, cells are water in part only.
        let root = coast(|x, y| town(x, y, |x, y| y < 16 || (36..39).contains(&x)));
        let shore = Shore::of(&root).unwrap();
        assert_eq!(shore.ends, [8.0, 8.0, 40.0, 40.0]);
        let [west, south, east, north] = shore.sides;
        assert_eq!(south, [1; 64]);
        assert_eq!(east, std::array::from_fn(|part| if part < 16 { 1 } else { 2 }));
        // A quarter of the western side, and the water in the east from below: a corner of land ends there.
        assert_eq!(west, std::array::from_fn(|part| u8::from(part < 16)));
        assert_eq!(north, std::array::from_fn(|part| u8::from(part >= 56)));
        let mut frame = FrameUniform::zeroed();
        shore.write(&mut frame, DVec2::new(-100.0, -200.0), 640.0);
        assert_eq!(frame.shore, [-20.0, -120.0, 300.0, 200.0]);
        let byte = |side: usize, part: usize| frame.sea[side * 4 + part / 16][part / 4 % 4] >> (part % 4 * 8) & 0xff;
        // In the middle of the sea, and of the land; half of each at the coast in the west.
        assert_eq!((byte(1, 32), byte(2, 8), byte(2, 40)), (0xf1, 0xf1, 0xf2));
        assert_eq!(byte(0, 48), 0);
        assert_eq!((byte(0, 15), byte(0, 16)), (0x81, 0x70));
        // Around a corner, the sea goes on.
        assert_eq!((byte(0, 0), byte(1, 0)), (0xf1, 0xf1));
        let blue = linear_of(Texel::new([60, 120, 150], 0).0);
        assert!((Vec3::from_slice(&frame.sea_albedo) - blue).length() < 1e-6);
        assert_eq!(frame.sea_albedo[3], 0.1);
    }

    #[test]
    fn piers_at_the_end_of_the_map_end_there() {
        let coast_with_pier = |width: usize| coast(|x, y| town(x, y, |x, y| y < 16 && !(20..20 + width).contains(&x)));
        let shore = Shore::of(&coast_with_pier(1)).unwrap();
        assert_eq!(shore.sides[1], [1; 64]);
        let shore = Shore::of(&coast_with_pier(8)).unwrap();
        assert_eq!(shore.sides[1], std::array::from_fn(|part| u8::from(!(24..40).contains(&part))));
    }

    /// Of a map of four cells along a side for each of the coarsest V-BlockMap.
    fn known_ends(cell: impl Fn(usize, usize) -> Cell) -> Option<CellEnds> {
        let side = 4 * NODE_CELLS;
        let cells: Vec<Cell> = (0..side * side).map(|i| cell(i % side, i / side)).collect();
        CellEnds::of_sea(&cells, side)
    }

    #[test]
    fn narrow_arms_of_what_is_known_as_sea_go_on() {
        // A basin as wide as three cells of the coarsest V-BlockMap and two deep, and a canal of one of the finer cells.
        let town = |x: usize, y: usize| match (34..160).contains(&x) && (34..160).contains(&y) {
            true if y < 42 && (84..96).contains(&x) || y < 100 && x == 121 => Cell::Water,
            true => Cell::Other,
            false => Cell::Bare,
        };
        let CellEnds { ends, step, sides } = known_ends(town).unwrap();
        assert_eq!((ends, step), ([34, 34, 160, 160], 1));
        assert_eq!(sides[1], std::array::from_fn(|part| u8::from((25..31).contains(&part))));
        assert_eq!([sides[0], sides[2], sides[3]], [[0; PARTS]; 3]);
        assert_eq!(known_ends(|x, _| if x < 99 { Cell::Other } else { Cell::Bare }), None);
    }

    #[test]
    fn wide_land_that_nobody_describes_beside_the_sea_takes_longer_steps() {
        // One house far out in the south-west.
        let sea = known_ends(|x, y| match (x, y) {
            (0, 0) => Cell::Other,
            (20..160, 20..100) => Cell::Water,
            _ => Cell::Bare,
        });
        let CellEnds { ends, step, sides } = sea.unwrap();
        assert_eq!((ends, step), ([0, 0, 160, 100], 2));
        let from = |first: usize, steps: u8| std::array::from_fn(|part| if part < first { 0 } else { steps });
        assert_eq!(sides, [from(13, 11), from(8, 11), from(13, 1), from(8, 1)]);
    }

    #[test]
    fn a_manifest_tells_the_shore() {
        let sides = std::array::from_fn(|side| [if side == 2 { 3 } else { 0 }; PARTS]);
        let sea = SeaEnds {
            ends: [[1010.0, 2020.0], [1330.0, 2340.0]],
            step_m: 2.5,
            sides: SeaEnds::text_of(&sides),
            rgb: [74, 129, 152],
        };
        let corner = DVec2::new(1000.0, 2000.0);
        let shore = Shore::known(&sea, corner, 10.0).unwrap();
        assert_eq!(shore.sides, sides);
        let mut frame = FrameUniform::zeroed();
        shore.write(&mut frame, DVec2::new(-100.0, -200.0), 640.0);
        assert_eq!(frame.shore, [-90.0, -180.0, 230.0, 140.0]);
        assert_eq!(frame.sea_albedo[3], 0.4);
        let blue = linear_of(Texel::new([74, 129, 152], 0).0);
        assert!((Vec3::from_slice(&frame.sea_albedo) - blue).length() < 1e-6);
        assert_eq!(Shore::known(&SeaEnds { sides: String::new(), ..sea }, corner, 10.0), None);
    }

    #[test]
    fn rivers_ponds_and_water_within_are_no_sea() {
        // A river of one cell, a pond of two at the side, a lake within, and a map that is all land.
        for is_water in [
            |x: usize, _: usize| x == 20,
            |x: usize, y: usize| y < 10 && (20..30).contains(&x),
            |x: usize, y: usize| (14..30).contains(&x) && (14..30).contains(&y),
            |_: usize, _: usize| false,
        ] {
            assert_eq!(Shore::of(&coast(|x, y| town(x, y, is_water))), None);
        }
    }
}
