//! Random cities of one to three levels with all kinds of columns, and random cameras.

use crate::draw_list::{CityArea, DrawList};
use crate::rng::Rng;
use crate::view::Camera;
use anyhow::{Context, Result};
use glam::{DVec3, Vec3};
use insula_protocol::blockmap::{
    COLUMNS, ColumnClip, ColumnObjects, CornerWall, MapColumn, OuterTop, STEPS_PER_CELL, ThinShare, WallStrip,
    Z_CODE_MAX, Z_SHIFT_MAX, strip_rows,
};
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId, octahedral};

#[derive(Debug, Clone)]
pub struct RandomCity {
    pub area: CityArea,
    pub maps: Vec<BlockMap>,
    /// The maps, ready to be drawn.
    pub draw_list: DrawList,
}

/// Parameters of a node's columns.
#[derive(Debug, Clone, Copy)]
struct Style {
    /// Share of cells with a column.
    density: f64,
    /// Share of columns with a wall strip.
    exposed: f64,
    inclined: f64,
    /// Side of the squares of equal columns, in cells.
    patch: usize,
    /// Largest height, in codes.
    height: u16,
}

pub fn city(seed: u64) -> Result<RandomCity> {
    let mut rng = Rng::new(seed);
    let depth = 1 + rng.below(3) as u8;
    let cell_m = [0.5, 1.0, 2.0][rng.below(3)];
    let root_side_m = cell_m * (NODE_CELLS << depth) as f64;
    let origin = [rng.range(-1e5, 1e5).round(), rng.range(-1e5, 1e5).round(), rng.range(-50.0, 50.0).round()];
    let area = CityArea { origin, root_side_m };
    let mut maps = Vec::new();
    grow(&mut rng, TileId::ROOT, depth, cell_m, &mut maps)?;
    let mut draw_list = DrawList::new(area);
    maps.iter().for_each(|map| draw_list.add(map));
    Ok(RandomCity { area, maps, draw_list })
}

/// Three draw lists of a cross-fade: both sides, the new one and the old one. Each square has two maps, of which `share` of 64
/// rays see the second. A third of the second ones are parts of coarser maps.
pub fn fading(city: &RandomCity, seed: u64, share: u8) -> Result<[DrawList; 3]> {
    let mut rng = Rng::new(seed);
    let [mut both, mut new, mut old] = [(); 3].map(|()| DrawList::new(city.area));
    for map in &city.maps {
        let id = map.id.parent().filter(|_| rng.chance(0.3)).unwrap_or(map.id);
        let times = f64::from(1u32 << (map.id.level() - id.level()));
        let other = node(&mut rng, id, f64::from(map.cell_m) * times)?;
        both.add(map);
        both.add_behind(&other, share);
        new.add(map);
        old.add_in(map.id, &other);
    }
    Ok([both, new, old])
}

fn grow(rng: &mut Rng, id: TileId, depth: u8, leaf_cell_m: f64, maps: &mut Vec<BlockMap>) -> Result<()> {
    if id.level() < depth && (id.level() == 0 || (rng.chance(0.35) && maps.len() < 12)) {
        return id.children().try_for_each(|child| grow(rng, child, depth, leaf_cell_m, maps));
    }
    if !rng.chance(0.12) {
        maps.push(node(rng, id, leaf_cell_m * f64::from(1u32 << (depth - id.level())))?);
    }
    Ok(())
}

/// A node with random columns of all kinds.
fn node(rng: &mut Rng, id: TileId, cell_m: f64) -> Result<BlockMap> {
    let z_shift = rng.below(usize::from(Z_SHIFT_MAX) + 1) as u8;
    let codes = STEPS_PER_CELL >> z_shift;
    let style = Style {
        density: [0.05, 0.4, 0.9, 1.0][rng.below(4)],
        exposed: rng.unit(),
        inclined: rng.unit() * 0.7,
        patch: [1, 1, 3, 9, 20][rng.below(5)],
        height: (codes * [4, 20, 60][rng.below(3)]).min(Z_CODE_MAX),
    };
    let per_row = NODE_CELLS.div_ceil(style.patch);
    let patches: Vec<_> = (0..per_row * per_row).map(|_| column(rng, &style, z_shift)).collect();
    let columns: Vec<_> = (0..COLUMNS)
        .map(|i| {
            let (x, y) = (i % NODE_CELLS / style.patch, i / NODE_CELLS / style.patch);
            let lone = rng.chance(0.01).then(|| column(rng, &style, z_shift));
            lone.unwrap_or_else(|| patches[y * per_row + x].clone())
        })
        .collect();
    let z_base_cells = rng.below(20) as i32 - 10;
    let mut map =
        BlockMap::from_columns(id, cell_m as f32, z_base_cells, z_shift, &columns).context("a random node")?;
    map.objects = Some(Box::new(objects(&columns, id)));
    Ok(map)
}

/// An object for each part of a column: patches of roofs, walls and lower tops.
fn objects(columns: &[Option<MapColumn>], id: TileId) -> ColumnObjects {
    let mut objects = ColumnObjects::default();
    let first = id.x() * 7919 + id.y() * 104_729;
    for (i, column) in columns.iter().enumerate() {
        let Some(column) = column else { continue };
        let patch = first + (i % NODE_CELLS / 9 + i / NODE_CELLS / 9 * 8) as u32 * 3;
        objects.roof[i] = patch;
        objects.wall[i] = patch + u32::from(i % 3 == 0);
        if column.gap.is_some() || column.clip.is_some_and(|clip| clip.outer.is_some()) {
            objects.lower[i] = patch + 2;
        }
    }
    objects
}

fn column(rng: &mut Rng, style: &Style, z_shift: u8) -> Option<MapColumn> {
    if !rng.chance(style.density) {
        return None;
    }
    let z_max = rng.between(5, style.height.max(6));
    let suspended = rng.chance(0.3);
    let z_min = if suspended { rng.between(0, z_max - 1) } else { 0 };
    let strip = rng.chance(style.exposed).then(|| strip(rng, strip_rows(z_min, z_max, z_shift).1));
    let gap = (strip.is_some() && z_max - z_min > 4 && rng.chance(0.3)).then(|| {
        let low = rng.between(z_min + 1, z_max - 2);
        [low, rng.between(low + 1, z_max - 1)]
    });
    let clip = (strip.is_some() && rng.chance(0.4)).then(|| clip(rng, z_min, z_max));
    let lean = if rng.chance(0.5) { 0.3 } else { 1.5 };
    let n = Vec3::new(rng.range(-lean, lean) as f32, rng.range(-lean, lean) as f32, 1.0).normalize_or(Vec3::Z);
    let inclined = rng.chance(style.inclined);
    // Of the heights, so that all else is as without.
    let may_be_thin = strip.is_some() && clip.is_none() && !inclined && (z_max + z_min) % 5 < 2;
    let thin = may_be_thin.then_some(ThinShare { side: (z_max % 255 + 1) as u8, top: (z_max * 7 % 256) as u8 });
    Some(MapColumn {
        z_min,
        z_max,
        inclined,
        suspended,
        gap,
        roof: texel(rng),
        roof_normal: octahedral::encode(n.into()),
        strip,
        clip,
        reflective: false,
        thin,
    })
}

fn clip(rng: &mut Rng, z_min: u16, z_max: u16) -> ColumnClip {
    let corner = rng.chance(0.5).then(|| CornerWall {
        azimuth: rng.below(256) as u8,
        offset: (i32::from(rng.between(0, 180)) - 90) as i8,
        concave: rng.chance(0.5),
    });
    let outer = (z_max - z_min > 1 && rng.chance(0.5))
        .then(|| OuterTop { z: rng.between(z_min + 1, z_max - 1), roof: texel(rng) });
    ColumnClip { offset: (i32::from(rng.between(0, 180)) - 90) as i8, corner, outer }
}

fn strip(rng: &mut Rng, rows: u16) -> WallStrip {
    let holes = rng.chance(0.3);
    let texels = (0..rows).map(|_| {
        let is_open = holes && rng.below(4) == 0;
        let texel = texel(rng);
        if is_open { Texel::OPEN } else { texel }
    });
    let texels = texels.collect();
    WallStrip { texels, azimuth: rng.below(256) as u8 }
}

fn texel(rng: &mut Rng) -> Texel {
    let rgb = [0; 3].map(|_: u8| rng.below(256) as u8);
    Texel::new(rgb, rng.below(64) as u8)
}

/// Position and direction of a random camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pose {
    /// Above the city, looking down at an angle.
    Above,
    /// In the middle of the city, perhaps inside a column.
    Inside,
    /// Just above the roofs, almost level.
    Grazing,
    Down,
    Up,
    /// Along an axis, from the edge of a cell.
    AlongAxis,
    /// Along a diagonal, from the corner of a cell.
    Diagonal,
    Outside,
    Below,
}

impl Pose {
    pub const ALL: [Self; 9] = [
        Self::Above,
        Self::Inside,
        Self::Grazing,
        Self::Down,
        Self::Up,
        Self::AlongAxis,
        Self::Diagonal,
        Self::Outside,
        Self::Below,
    ];
}

pub fn camera(rng: &mut Rng, city: &RandomCity, pose: Pose) -> Camera {
    let side = city.area.root_side_m;
    let tallest_m = city.maps.iter().map(top_m).fold(1.0, f64::max);
    let somewhere = |rng: &mut Rng, low: f64, high: f64| {
        DVec3::new(rng.range(0.0, side), rng.range(0.0, side), rng.range(low, high))
    };
    let on_grid = |v: DVec3| DVec3::new(v.x.round(), v.y.round(), v.z);
    let (position, target) = match pose {
        Pose::Above => {
            let position = somewhere(rng, tallest_m + 1.0, tallest_m * 1.5 + side);
            (position, somewhere(rng, 0.0, tallest_m))
        }
        Pose::Inside => (somewhere(rng, 0.0, tallest_m * 0.7), somewhere(rng, 0.0, tallest_m * 0.7)),
        Pose::Grazing => {
            let position = somewhere(rng, tallest_m * 0.3, tallest_m);
            (position, somewhere(rng, position.z - 1.0, position.z + 1.0))
        }
        Pose::Down => straight(somewhere(rng, tallest_m, tallest_m + side), -DVec3::Z),
        Pose::Up => straight(somewhere(rng, -side, 0.0), DVec3::Z),
        Pose::AlongAxis => {
            let axis = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y][rng.below(4)];
            straight(on_grid(somewhere(rng, 0.0, tallest_m)), axis)
        }
        Pose::Diagonal => {
            let signs = [-1.0, 1.0];
            let (x, y) = (signs[rng.below(2)], signs[rng.below(2)]);
            straight(on_grid(somewhere(rng, 0.0, tallest_m)), DVec3::new(x, y, 0.0))
        }
        Pose::Outside => {
            let angle = rng.range(0.0, std::f64::consts::TAU);
            let around = DVec3::new(angle.cos(), angle.sin(), 0.0) * side * 1.2;
            (DVec3::new(side / 2.0, side / 2.0, rng.range(0.0, side)) + around, somewhere(rng, 0.0, tallest_m))
        }
        Pose::Below => (somewhere(rng, -side, -12.0), somewhere(rng, 0.0, tallest_m)),
    };
    let origin = DVec3::from(city.area.origin);
    Camera { fov_y_deg: rng.range(25.0, 95.0), ..Camera::looking(origin + position, origin + target) }
}

fn straight(position: DVec3, direction: DVec3) -> (DVec3, DVec3) {
    (position, position + direction * 10.0)
}

fn top_m(map: &BlockMap) -> f64 {
    let code = map.z_max.iter().copied().max().unwrap_or(0);
    map.z_base_m() + f64::from(code) * f64::from(map.z_step_m())
}
