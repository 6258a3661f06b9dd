//! Defines what V-BlockMaps look like, in the simplest way: every solid of every column is intersected with every ray in f64,
//! and the hits are composited front to back. Without a tree, summaries, pages or stepping.

use crate::draw_list::CityArea;
use crate::view::Camera;
use glam::{DVec2, DVec3};
use insula_protocol::blockmap::{
    CLIP_STEPS_PER_CELL, COLUMNS, ColumnClip, MapColumn, STEPS_PER_CELL, ThinShare, flag, strip_rows,
};
use insula_protocol::{BlockMap, NODE_CELLS, Texel};
use insula_shaders::pack::slope_codes;

/// What a ray returns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferencePixel {
    /// Metres to the nearest surface; infinity if there is none.
    pub distance_m: f64,
    /// Its linear colour.
    pub rgb: DVec3,
}

#[derive(Debug, Clone)]
struct Solid {
    low: DVec2,
    cell_m: f64,
    bottom_m: f64,
    top_m: f64,
    slope: DVec2,
    roof: Option<Texel>,
    wall: Wall,
    /// For a column without a wall strip: the facades of the columns to the west, east, south and north, which cover its sides.
    neighbours: [Option<Facade>; 4],
    part: CellPart,
    /// What a thin column covers, and its number.
    thin: Option<(ThinShare, usize)>,
}

/// A ray, and which of the rays through thin objects it is: 0 to 4,095 by its pixel, as even as possible.
#[derive(Debug, Clone, Copy)]
struct ThresholdRay {
    o: DVec3,
    d: DVec3,
    threshold: u32,
}

/// A wall that covers the side of the column behind it.
#[derive(Debug, Clone)]
struct Facade {
    texels: Vec<Texel>,
    base_m: f64,
    bottom_m: f64,
    top_m: f64,
}

/// A vertical plane: normal, and distance from the cell's centre in metres.
type Plane = (DVec2, f64);

/// The part of its cell that a solid fills.
#[derive(Debug, Clone)]
enum CellPart {
    /// The inner side of all planes.
    All(Vec<Plane>),
    /// All but that.
    NotAll(Vec<Plane>),
}

#[derive(Debug, Clone)]
enum Wall {
    /// The same texel everywhere.
    Plain(Texel),
    /// Texels from `base_m` upwards, each as high as a cell is wide. With `holes`, some are transparent.
    Strip { texels: Vec<Texel>, base_m: f64, holes: bool },
}

/// The solids of a city, in metres relative to its area's origin.
#[derive(Debug, Clone)]
pub struct ReferenceCaster {
    area: CityArea,
    solids: Vec<Solid>,
}

impl ReferenceCaster {
    pub fn new(area: CityArea, maps: &[BlockMap]) -> Self {
        let mut solids = Vec::new();
        for map in maps {
            add_solids(area, map, &mut solids);
        }
        Self { area, solids }
    }

    /// Casts the ray of a pixel from `camera` along the unit vector `dir`.
    pub fn cast(&self, camera: &Camera, dir: DVec3, pixel: [u32; 2]) -> ReferencePixel {
        let o = DVec3::from(camera.position) - DVec3::from(self.area.origin);
        let mut events = Vec::new();
        for solid in &self.solids {
            solid.intersect(&ThresholdRay { o, d: dir, threshold: threshold(pixel) }, &mut events);
        }
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        events.first().map_or(ReferencePixel { distance_m: f64::INFINITY, rgb: DVec3::ZERO }, |(distance_m, texel)| {
            ReferencePixel { distance_m: *distance_m, rgb: linear(*texel) }
        })
    }
}

/// The order of Bayer's matrix of 64 x 64.
fn threshold([x, y]: [u32; 2]) -> u32 {
    (0..6).fold(0, |sum, k| sum * 4 + ((x ^ y) >> k & 1) * 2 + (y >> k & 1))
}

fn linear(texel: Texel) -> DVec3 {
    let [r, g, b] = texel.rgb().map(|c| {
        let v = f64::from(c) / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    });
    DVec3::new(r, g, b)
}

fn add_solids(area: CityArea, map: &BlockMap, solids: &mut Vec<Solid>) {
    let side_m = area.root_side_m / f64::from(1u32 << map.id.level());
    let corner = DVec2::new(f64::from(map.id.x()), f64::from(map.id.y())) * side_m;
    let cell_m = side_m / NODE_CELLS as f64;
    let step_m = cell_m / f64::from(STEPS_PER_CELL) * f64::from(1u32 << map.z_shift);
    let z_m = |code: f64| map.z_base_m() + code * step_m;
    let columns = map.columns();
    for i in 0..COLUMNS {
        let Some(column) = &columns[i] else { continue };
        let low = corner + DVec2::new((i % NODE_CELLS) as f64, (i / NODE_CELLS) as f64) * cell_m;
        let mut slope = DVec2::ZERO;
        if column.inclined {
            let [x, y] = slope_codes(column.roof_normal, u32::from(map.z_shift));
            slope = DVec2::new(f64::from(x), f64::from(y)) * step_m / cell_m;
        }
        let holes = map.flags[i] & flag::HOLES != 0;
        let first_row = strip_rows(column.z_min, column.z_max, map.z_shift).0;
        let codes = STEPS_PER_CELL >> map.z_shift;
        let ranges = match column.gap {
            None => vec![[column.z_min, column.z_max]],
            Some([a, b]) => vec![[column.z_min, a], [b, column.z_max]],
        };
        let clip = column.clip.as_ref();
        let (planes, concave) = clip.map_or((Vec::new(), false), |clip| planes(column, clip, cell_m));
        let part = |outer: bool| match (concave != outer, outer) {
            _ if planes.is_empty() => CellPart::All(Vec::new()),
            // Beyond a concave corner means beyond both planes.
            (false, true) => CellPart::All(planes.iter().map(|(n, offset)| (-*n, -*offset)).collect()),
            (false, false) => CellPart::All(planes.clone()),
            (true, true) => CellPart::NotAll(planes.clone()),
            (true, false) => CellPart::NotAll(planes.iter().map(|(n, offset)| (-*n, -*offset)).collect()),
        };
        if let Some(outer) = clip.and_then(|clip| clip.outer) {
            let (bottom_m, top_m) = (z_m(f64::from(column.z_min)), z_m(f64::from(outer.z)));
            let (slope, roof, wall) = (DVec2::ZERO, Some(outer.roof), Wall::Plain(outer.roof));
            let (neighbours, part) = (Default::default(), part(true));
            let thin = None;
            solids.push(Solid { low, cell_m, bottom_m, top_m, slope, roof, wall, neighbours, part, thin });
        }
        let facade = |dx: i32, dy: i32| {
            let (x, y) = ((i % NODE_CELLS) as i32 + dx, (i / NODE_CELLS) as i32 + dy);
            let inside = (0..NODE_CELLS as i32).contains(&x) && (0..NODE_CELLS as i32).contains(&y);
            let other = inside.then(|| columns[y as usize * NODE_CELLS + x as usize].as_ref()).flatten()?;
            let other = Some(other).filter(|other| other.thin.is_none())?;
            let base_m = z_m(f64::from(other.z_min / codes * codes));
            let (bottom_m, top_m) = (z_m(f64::from(other.z_min)), z_m(f64::from(other.z_max)));
            Some(Facade { texels: other.strip.as_ref()?.texels.clone(), base_m, bottom_m, top_m })
        };
        let facades = || [facade(-1, 0), facade(1, 0), facade(0, -1), facade(0, 1)];
        for [bottom, top] in ranges {
            let is_top = top == column.z_max;
            let wall = match &column.strip {
                None => Wall::Plain(column.roof),
                Some(strip) => {
                    let (from, rows) = strip_rows(bottom, top, map.z_shift);
                    let at = usize::from(from - first_row);
                    let texels = strip.texels[at..at + usize::from(rows)].to_vec();
                    Wall::Strip { texels, base_m: z_m(f64::from(from * codes)), holes }
                }
            };
            solids.push(Solid {
                low,
                cell_m,
                bottom_m: z_m(f64::from(bottom)),
                top_m: z_m(f64::from(top)),
                slope: if is_top { slope } else { DVec2::ZERO },
                roof: is_top.then_some(column.roof),
                wall,
                neighbours: if column.strip.is_none() { facades() } else { Default::default() },
                part: part(false),
                thin: column.thin.filter(|_| is_top).map(|share| (share, i)),
            });
        }
    }
}

/// The planes of a clipped column, and whether they form a concave corner.
fn planes(column: &MapColumn, clip: &ColumnClip, cell_m: f64) -> (Vec<Plane>, bool) {
    let plane = |azimuth: u8, offset: i8| {
        let normal = DVec2::from_angle(f64::from(azimuth) / 256.0 * std::f64::consts::TAU);
        (normal, f64::from(offset) / f64::from(CLIP_STEPS_PER_CELL) * cell_m)
    };
    let azimuth = column.strip.as_ref().map_or(0, |strip| strip.azimuth);
    let mut planes = vec![plane(azimuth, clip.offset)];
    planes.extend(clip.corner.map(|c| plane(c.azimuth, c.offset)));
    (planes, clip.corner.is_some_and(|c| c.concave))
}

impl Solid {
    /// Adds the intersections with a ray: distance, texel and coverage.
    fn intersect(&self, ray: &ThresholdRay, events: &mut Vec<(f64, Texel)>) {
        let (o, d) = (ray.o, ray.d);
        let (mut s, mut e) = (0.0, f64::INFINITY);
        for axis in 0..2 {
            clip(&mut s, &mut e, o[axis] - self.low[axis], d[axis]);
            clip(&mut s, &mut e, self.low[axis] + self.cell_m - o[axis], -d[axis]);
        }
        let (mut from, mut to) = (s, e);
        let centre = self.low + self.cell_m / 2.0;
        let (CellPart::All(planes) | CellPart::NotAll(planes)) = &self.part;
        for (normal, offset) in planes {
            clip(&mut from, &mut to, offset - normal.dot(o.truncate() - centre), -normal.dot(d.truncate()));
        }
        match &self.part {
            CellPart::All(_) => self.intersect_part(ray, [from, to], events),
            CellPart::NotAll(_) if from < to => {
                self.intersect_part(ray, [s, from], events);
                self.intersect_part(ray, [to, e], events);
            }
            CellPart::NotAll(_) => self.intersect_part(ray, [s, e], events),
        }
    }

    fn intersect_part(&self, ray: &ThresholdRay, [mut s, mut e]: [f64; 2], events: &mut Vec<(f64, Texel)>) {
        let (o, d) = (ray.o, ray.d);
        let side_entry = s;
        clip(&mut s, &mut e, o.z - self.bottom_m, d.z);
        if s >= e {
            return;
        }
        let from_top = self.top_at(o) - o.z;
        let before = s;
        clip(&mut s, &mut e, from_top, self.slope.dot(d.truncate()) - d.z);
        if s >= e {
            return;
        }
        let through_top = s > before;
        // From inside, a solid is invisible.
        if s <= 0.0 {
            return;
        }
        if let Some((share, i)) = self.thin {
            let share = if s == side_entry { share.side } else { share.top };
            // Each column shifts the thresholds by another part of the golden ratio.
            let share = u32::from(share) * (u32::from(share) + 2);
            if (ray.threshold * 16 + i as u32 * 40503) % 65536 >= share {
                return;
            }
        }
        match (&self.wall, self.roof) {
            (_, Some(roof)) if through_top => events.push((s, roof)),
            (Wall::Plain(texel), _) => {
                let neighbours = if s == side_entry { self.facade(o, d, s) } else { None };
                events.push((s, neighbours.unwrap_or(*texel)));
            }
            (Wall::Strip { texels, base_m, holes }, _) => {
                self.intersect_rows(o, d, [s, e], (texels, *base_m, *holes), events)
            }
        }
    }

    /// The facade texel where the ray enters through a side.
    fn facade(&self, o: DVec3, d: DVec3, s: f64) -> Option<Texel> {
        let near = |axis: usize| {
            let face = self.low[axis] + if d[axis] > 0.0 { 0.0 } else { self.cell_m };
            (face - o[axis]) / d[axis]
        };
        let axis = if near(0) >= near(1) { 0 } else { 1 };
        let facade = self.neighbours[axis * 2 + usize::from(d[axis] <= 0.0)].as_ref()?;
        let z = o.z + d.z * s;
        let row = ((z - facade.base_m) / self.cell_m).floor() as usize;
        let covers = (facade.bottom_m..facade.top_m).contains(&z);
        facade.texels.get(row).copied().filter(|texel| covers && !texel.is_open())
    }

    fn intersect_rows(
        &self,
        o: DVec3,
        d: DVec3,
        [s, e]: [f64; 2],
        (texels, base_m, holes): (&[Texel], f64, bool),
        events: &mut Vec<(f64, Texel)>,
    ) {
        if !holes {
            let row = ((o.z + d.z * s - base_m) / self.cell_m).floor().clamp(0.0, texels.len() as f64 - 1.0);
            events.push((s, texels[row as usize]));
            return;
        }
        for (row, texel) in texels.iter().enumerate() {
            let (mut from, mut to) = (s, e);
            if row > 0 {
                clip(&mut from, &mut to, o.z - base_m - row as f64 * self.cell_m, d.z);
            }
            if row + 1 < texels.len() {
                clip(&mut from, &mut to, base_m + (row + 1) as f64 * self.cell_m - o.z, -d.z);
            }
            if from < to && !texel.is_open() {
                events.push((from, *texel));
            }
        }
    }

    fn top_at(&self, p: DVec3) -> f64 {
        self.top_m + self.slope.dot(p.truncate() - self.low - self.cell_m / 2.0)
    }
}

/// Reduces `s..e` to the part where `at + rate * t >= 0`.
fn clip(s: &mut f64, e: &mut f64, at: f64, rate: f64) {
    if rate > 0.0 {
        *s = s.max(-at / rate);
    } else if rate < 0.0 {
        *e = e.min(at / -rate);
    } else if at < 0.0 {
        *e = f64::NEG_INFINITY;
    }
}
