//! The buildings of a block: rows of houses, courtyards, towers, squares with trees, halls.

use super::streets::{half_street, key, street};
use crate::rng::Rng;
use glam::{DVec2, Vec2};

/// Triangles of a block's ground and of the streets west and south of it.
pub const GROUND_TRIANGLES: u64 = 6;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Roof {
    Flat,
    /// Two slopes. The ridge runs along `axis`, this far above the eaves.
    Gable(f64),
}

/// A box, which may be above the ground and may have a pitched roof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    pub centre: DVec2,
    /// Unit vector along its length.
    pub axis: DVec2,
    /// Half its length and half its width.
    pub half: DVec2,
    /// 0 on the ground.
    pub bottom_m: f64,
    pub eaves_m: f64,
    pub roof: Roof,
    /// 8-bit sRGB.
    pub wall: [u8; 3],
    pub top: [u8; 3],
    pub windows: bool,
}

impl Part {
    /// A point in the box's axes: along and across, from the centre.
    pub fn local(&self, p: DVec2) -> DVec2 {
        let d = p - self.centre;
        DVec2::new(d.dot(self.axis), d.dot(self.axis.perp()))
    }

    /// Height of its top at a point in its axes.
    pub fn top_at(&self, local: DVec2) -> f64 {
        match self.roof {
            Roof::Flat => self.eaves_m,
            Roof::Gable(rise_m) => self.eaves_m + rise_m * (1.0 - local.y.abs() / self.half.y).max(0.0),
        }
    }

    /// Slope of its top along x and y at a point in its axes.
    pub fn slope(&self, local: DVec2) -> Vec2 {
        match self.roof {
            Roof::Flat => Vec2::ZERO,
            Roof::Gable(rise_m) => (self.axis.perp() * (-local.y.signum() * rise_m / self.half.y)).as_vec2(),
        }
    }

    /// Half the extent along x and y.
    pub fn reach(&self) -> DVec2 {
        self.axis.abs() * self.half.x + self.axis.perp().abs() * self.half.y
    }
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Building {
    /// Parts on the ground come before those above them.
    pub parts: Vec<Part>,
}

/// The area between four streets.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Centre lines of the western and southern street, and of the eastern and northern one.
    pub streets: [DVec2; 2],
    /// South-west corner without the streets.
    pub low: DVec2,
    pub high: DVec2,
    pub ground: [u8; 3],
    pub buildings: Vec<Building>,
    pub trees: Vec<Part>,
}

/// Triangles of a part: walls, roof, and the underside of what hangs.
fn triangles_of(part: &Part) -> u64 {
    let roof = match part.roof {
        Roof::Flat => 2,
        Roof::Gable(_) => 6,
    };
    8 + roof + if part.bottom_m > 0.0 { 2 } else { 0 }
}

impl Block {
    pub fn parts(&self) -> impl Iterator<Item = &Part> {
        self.buildings.iter().flat_map(|b| &b.parts).chain(&self.trees)
    }

    pub fn triangles(&self) -> u64 {
        GROUND_TRIANGLES + self.parts().map(triangles_of).sum::<u64>()
    }

    pub fn clear(&mut self) {
        self.buildings.clear();
        self.trees.clear();
    }
}

const WALLS: [[u8; 3]; 8] = [
    [203, 190, 168],
    [178, 150, 126],
    [214, 208, 196],
    [160, 96, 74],
    [188, 172, 140],
    [150, 158, 160],
    [226, 214, 186],
    [122, 110, 100],
];
const TILES: [[u8; 3]; 5] = [[150, 78, 58], [118, 66, 54], [92, 84, 82], [170, 96, 66], [80, 70, 66]];
const FLATS: [[u8; 3]; 4] = [[128, 126, 122], [150, 146, 138], [104, 106, 108], [168, 164, 156]];
const GLASS: [[u8; 3]; 4] = [[110, 130, 146], [140, 150, 156], [84, 98, 112], [170, 172, 168]];
const CROWNS: [[u8; 3]; 3] = [[74, 104, 56], [92, 118, 60], [62, 90, 52]];

pub fn block(i: i32, j: i32) -> Block {
    let mut rng = Rng::new(key(i, j) ^ 0x5bd1_e995);
    let west_south = DVec2::new(street(0, i), street(1, j));
    let streets = [west_south, DVec2::new(street(0, i + 1), street(1, j + 1))];
    let low = streets[0] + DVec2::new(half_street(i), half_street(j));
    let high = streets[1] - DVec2::new(half_street(i + 1), half_street(j + 1));
    let mut block = Block { streets, low, high, ground: [122, 118, 108], buildings: Vec::new(), trees: Vec::new() };
    // Towers form clusters.
    let busy = Rng::new(key(i.div_euclid(5), j.div_euclid(5)) ^ 0xc0de).unit();
    match rng.unit() {
        kind if kind < 0.05 => square(&mut rng, &mut block),
        kind if kind < 0.08 + 0.5 * busy * busy * busy => towers(&mut rng, &mut block, busy),
        kind if kind > 0.94 => halls(&mut rng, &mut block),
        kind if kind > 0.62 => courtyard(&mut rng, &mut block),
        _ => houses(&mut rng, &mut block),
    }
    block
}

fn pick<const N: usize>(rng: &mut Rng, colours: &[[u8; 3]; N]) -> [u8; 3] {
    let by = rng.range(0.9, 1.1);
    colours[rng.below(N)].map(|c| (f64::from(c) * by).clamp(0.0, 255.0) as u8)
}

fn upright(low: DVec2, high: DVec2, heights: [f64; 2], rng: &mut Rng) -> Part {
    Part {
        centre: (low + high) / 2.0,
        axis: DVec2::X,
        half: (high - low) / 2.0,
        bottom_m: heights[0],
        eaves_m: heights[1],
        roof: Roof::Flat,
        wall: pick(rng, &WALLS),
        top: pick(rng, &FLATS),
        windows: true,
    }
}

/// The same box with its length along y.
fn turned(part: Part) -> Part {
    Part { axis: DVec2::Y, half: DVec2::new(part.half.y, part.half.x), ..part }
}

fn houses(rng: &mut Rng, block: &mut Block) {
    block.ground = [112, 118, 88];
    let size = block.high - block.low;
    let rows = (size.y / 18.0).floor().max(1.0);
    let columns = (size.x / rng.range(9.5, 12.5)).floor().max(1.0);
    let lot = size / DVec2::new(columns, rows);
    for n in 0..(rows * columns) as usize {
        let place = DVec2::new((n % columns as usize) as f64, (n / columns as usize) as f64);
        let centre = block.low + (place + 0.5) * lot + DVec2::new(0.0, rng.range(-0.6, 0.6));
        let half = DVec2::new(lot.x / 2.0 - rng.range(0.9, 1.6), rng.range(4.2, 6.2));
        let angle: f64 = if rng.chance(0.5) { rng.range(-0.1, 0.1) } else { 0.0 };
        let axis = DVec2::from_angle(angle);
        let eaves_m = rng.range(3.0, 7.5);
        let (wall, top) = (pick(rng, &WALLS), pick(rng, &TILES));
        let roof = if rng.chance(0.85) { Roof::Gable(rng.range(1.4, 2.8)) } else { Roof::Flat };
        let house = Part { centre, axis, half, bottom_m: 0.0, eaves_m, roof, wall, top, windows: true };
        let mut parts = vec![if rng.chance(0.5) { square_turned(house) } else { house }];
        if eaves_m > 5.0 && rng.chance(0.4) {
            let centre = centre - axis.perp() * (half.y + 0.8);
            let half = DVec2::new(half.x * 0.6, 0.9);
            parts.push(Part { centre, half, bottom_m: 2.6, eaves_m: 3.6, roof: Roof::Flat, windows: false, ..house });
        }
        block.buildings.push(Building { parts });
    }
}

/// Turns the ridge by a quarter, on the same plan.
fn square_turned(part: Part) -> Part {
    Part { axis: part.axis.perp(), half: DVec2::new(part.half.y, part.half.x), ..part }
}

fn courtyard(rng: &mut Rng, block: &mut Block) {
    block.ground = [134, 128, 114];
    let depth = rng.range(10.5, 13.5);
    let height = rng.range(11.0, 25.0);
    let pitched = rng.chance(0.6);
    let (low, high) = (block.low, block.high);
    let wings = [
        [low, DVec2::new(high.x, low.y + depth)],
        [DVec2::new(low.x, high.y - depth), high],
        [DVec2::new(low.x, low.y + depth), DVec2::new(low.x + depth, high.y - depth)],
        [DVec2::new(high.x - depth, low.y + depth), high - DVec2::new(0.0, depth)],
    ];
    for (n, [low, high]) in wings.into_iter().enumerate() {
        let axis = if n < 2 { DVec2::X } else { DVec2::Y };
        let length = (high - low).dot(axis);
        let count = (length / rng.range(12.0, 19.0)).round().max(1.0) as usize;
        for k in 0..count {
            let from = low + axis * (length * k as f64 / count as f64);
            let to = high - axis * (length * (count - 1 - k) as f64 / count as f64);
            let passage = k == 1 && n == 0 && rng.chance(0.5);
            let bottom_m = if passage { 4.6 } else { 0.0 };
            let part = upright(from, to, [bottom_m, height + rng.range(-2.5, 2.5)], rng);
            let part = if n < 2 { part } else { turned(part) };
            let roof = if pitched { Roof::Gable(rng.range(2.5, 4.5)) } else { Roof::Flat };
            let top = if pitched { pick(rng, &TILES) } else { part.top };
            let mut parts = vec![Part { roof, top, ..part }];
            if !pitched && rng.chance(0.5) {
                let attic = (part.half - 2.2).max(DVec2::ONE);
                let eaves_m = part.eaves_m + 3.0;
                parts.push(Part { half: attic, bottom_m: 0.0, eaves_m, ..part });
            }
            block.buildings.push(Building { parts });
        }
    }
    trees(rng, block, 4, 0.32);
}

fn towers(rng: &mut Rng, block: &mut Block, busy: f64) {
    block.ground = [140, 138, 132];
    let size = block.high - block.low;
    let grid = [DVec2::new(3.0, 2.0), DVec2::new(2.0, 2.0), DVec2::new(2.0, 1.0)][rng.below(3)];
    let lot = size / grid;
    let mut last: Option<(DVec2, f64)> = None;
    for n in 0..(grid.x * grid.y) as usize {
        let place = DVec2::new((n % grid.x as usize) as f64, (n / grid.x as usize) as f64);
        let centre = block.low + (place + 0.5) * lot;
        let half = (lot / 2.0 - DVec2::new(rng.range(3.0, 5.0), rng.range(3.0, 6.0))).max(DVec2::splat(5.0));
        let height = (22.0 + 150.0 * busy * rng.unit() * rng.unit()).min(super::MAX_HEIGHT_M - 20.0);
        let axis = if rng.chance(0.25) { DVec2::from_angle(rng.range(-0.12, 0.12)) } else { DVec2::X };
        let (wall, top) = (pick(rng, &GLASS), pick(rng, &FLATS));
        let base =
            Part { centre, axis, half, bottom_m: 0.0, eaves_m: height, roof: Roof::Flat, wall, top, windows: true };
        let mut parts = vec![base];
        match rng.below(4) {
            // Wider at the top: an overhang on all sides.
            0 => {
                parts[0].half = half * 0.8;
                parts.push(Part { bottom_m: height * 0.45, ..base });
            }
            1 => parts.push(Part { half: half * 0.6, eaves_m: height + 9.0, ..base }),
            2 => parts.push(Part { half: (half + 2.0).min(lot / 2.0 - 0.6), eaves_m: 9.0, ..base }),
            _ => {}
        }
        if let Some((other, other_m)) = last.filter(|(other, _)| (other.y - centre.y).abs() < 1.0 && rng.chance(0.4)) {
            let bottom_m = (0.5 * height.min(other_m)).floor();
            let (low, high) = (DVec2::new(other.x, centre.y - 2.0), DVec2::new(centre.x, centre.y + 2.0));
            parts.push(upright(low, high, [bottom_m, bottom_m + 4.0], rng));
        }
        last = Some((centre, height));
        block.buildings.push(Building { parts });
    }
    trees(rng, block, 3, 0.48);
}

fn square(rng: &mut Rng, block: &mut Block) {
    block.ground = if rng.chance(0.6) { [104, 124, 74] } else { [158, 150, 136] };
    let middle = (block.low + block.high) / 2.0;
    for k in 0..1 + rng.below(2) {
        let half = DVec2::new(rng.range(5.0, 9.0), rng.range(4.0, 6.0));
        let centre = middle + DVec2::new(k as f64 * 22.0 - 6.0, rng.range(-4.0, 4.0));
        let canopy = upright(centre - half, centre + half, [4.0, 4.6], rng);
        let mut parts = vec![Part { windows: false, ..canopy }];
        parts.extend([-1.0, 1.0].map(|side| {
            let post = centre + DVec2::new(side * (half.x - 1.0), 0.0);
            Part { windows: false, ..upright(post - 0.7, post + 0.7, [0.0, 4.0], rng) }
        }));
        parts.reverse();
        block.buildings.push(Building { parts });
    }
    trees(rng, block, 16, 0.48);
}

fn halls(rng: &mut Rng, block: &mut Block) {
    block.ground = [126, 124, 120];
    let size = block.high - block.low;
    let count = 2 + rng.below(2);
    let lot = DVec2::new(size.x / count as f64, size.y);
    for k in 0..count {
        let low = block.low + DVec2::new(k as f64 * lot.x + 1.5, rng.range(1.0, 9.0));
        let high = block.low + DVec2::new((k + 1) as f64 * lot.x - 1.5, lot.y - rng.range(1.0, 9.0));
        let hall = Part { windows: false, ..upright(low, high, [0.0, rng.range(6.0, 11.0)], rng) };
        let hall = if rng.chance(0.7) { Part { roof: Roof::Gable(rng.range(1.5, 3.5)), ..turned(hall) } } else { hall };
        block.buildings.push(Building { parts: vec![hall] });
    }
}

/// Adds up to `most` trees within `share` of the block's size around its centre, where they touch no part.
fn trees(rng: &mut Rng, block: &mut Block, most: usize, share: f64) {
    let (middle, size) = ((block.low + block.high) / 2.0, block.high - block.low);
    for _ in 0..most {
        let centre = middle + size * DVec2::new(rng.range(-share, share), rng.range(-share, share)) * 0.9;
        let half = DVec2::splat(rng.range(1.4, 2.6));
        let bottom_m = rng.range(2.0, 3.0);
        let eaves_m = bottom_m + rng.range(3.0, 5.0);
        let part = Part { windows: false, ..upright(centre - half, centre + half, [bottom_m, eaves_m], rng) };
        let crown = pick(rng, &CROWNS);
        let free = |other: &Part| {
            let away = (other.local(centre).abs() - other.half).max_element();
            away > half.x + 0.5 || other.bottom_m > eaves_m
        };
        if block.parts().all(free) {
            block.trees.push(Part { wall: crown, top: crown, ..part });
        }
    }
}
