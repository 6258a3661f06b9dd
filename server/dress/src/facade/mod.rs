//! Generated facades: windows on walls of which the source has no picture.
//!
//! A wall is what lies in one vertical plane of an object. Its parts of whole storeys and bays get texture coordinates
//! into a small generated texture that repeats once per four bays and storeys. To everything after reading it is a
//! texture like any other, so it is filtered by area in columns, parents and meshes.

mod parts;
mod pattern;
mod walls;

use crate::world_triangle::WorldTriangle;
use glam::{DVec2, DVec3, Vec3Swizzles};
use insula_source::report::FacadeReport;
use insula_source::text::split_words;
use parts::{Storeys, WallPart, above_ground, find_parts};
use pattern::CELLS;
pub use pattern::SIDE_TEXELS;
use walls::{Wall, find_walls};

/// Increased whenever the same input would get other facades than before.
pub const ALGORITHM: u32 = 2;
/// Most generated textures. A wall in a further colour gets the nearest of these.
const MAX_TEXTURES: usize = 96;
/// Lower and smaller objects are garages and sheds.
const MIN_HEIGHT_M: f64 = 4.0;
const MIN_FOOTPRINT_M2: f64 = 20.0;
/// Cut faces are at most this many times the given ones; further faces stay plain.
const MAX_GROWTH: usize = 6;

/// What walls without a texture get.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum FacadeOption {
    /// Their colour.
    #[default]
    Plain,
    /// Generated windows by storey height and use of the building.
    Windows,
}

impl std::str::FromStr for FacadeOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "plain" => Ok(Self::Plain),
            "windows" => Ok(Self::Windows),
            _ => Err("expected plain or windows".into()),
        }
    }
}

/// The city's materials and ground, as far as facades need them.
pub trait FacadeMaterials {
    fn colour(&self, material: u32) -> [u8; 3];

    /// Adds a material with a generated texture of [`SIDE_TEXELS`] rows of as many texels, from the top. Returns its number.
    fn add_pattern(&mut self, texels: Vec<[u8; 3]>) -> u32;

    /// World height of the ground at a world position on the map, if it is known.
    fn ground_m(&mut self, position: [f64; 2]) -> Option<f64>;
}

/// A generated texture and its material.
struct FacadeMaterial {
    facade_use: FacadeUse,
    rgb: [u8; 3],
    /// Number among the city's materials.
    number: u32,
}

/// Puts windows on walls, and keeps the textures for it.
#[derive(Default)]
pub struct FacadeMaker {
    materials: Vec<FacadeMaterial>,
    report: FacadeReport,
}

impl FacadeMaker {
    /// The report; `None` if there are no facades.
    pub fn into_report(self) -> Option<FacadeReport> {
        let textures = self.materials.len() as u64;
        (self.report.walls > 0).then_some(FacadeReport { generated: true, textures, ..self.report })
    }

    /// Counts an object with facades.
    pub fn count_object(&mut self) {
        self.report.objects += 1;
    }

    /// Gives the walls among faces of one object windows. Faces may be cut, and keep their order. Returns whether there are
    /// such walls.
    pub fn apply(
        &mut self,
        faces: &mut Vec<WorldTriangle>,
        facade_use: FacadeUse,
        materials: &mut impl FacadeMaterials,
    ) -> bool {
        let Some(anchor) = faces.first().map(|face| DVec3::from_array(face.corners[0])) else { return false };
        if facade_use == FacadeUse::Windowless || !faces.iter().any(|face| face.is_facade) {
            return false;
        }
        let corners: Vec<[DVec3; 3]> =
            faces.iter().map(|face| face.corners.map(|p| DVec3::from_array(p) - anchor)).collect();
        let Some(base_m) = base_of_large_object(&corners) else { return false };
        let is_facade = |i: usize| faces[i].is_facade;
        let walls = find_walls(&corners, &is_facade);
        // Windows begin above the ground, and storeys where it is lowest.
        let mut lowest_m = f64::INFINITY;
        let mut ground_m = |place: DVec2| {
            let height_m = materials.ground_m((place + anchor.xy()).to_array())? - anchor.z;
            lowest_m = lowest_m.min(height_m);
            Some(height_m)
        };
        let parts_of = |wall: &Wall| {
            let parts = find_parts(&wall.outline(&corners));
            above_ground(parts, &mut |along_m| ground_m(wall.place_m(along_m)))
        };
        let parts: Vec<Vec<WallPart>> = walls.iter().map(parts_of).collect();
        let base_m = if lowest_m.is_finite() { base_m.max(lowest_m) } else { base_m };
        let Some(storeys) = Storeys::of(&parts, base_m, facade_use.storey_m()) else { return false };
        let zones: Vec<Vec<FacadeZone>> =
            parts.into_iter().map(|parts| storeys.zones(parts, facade_use.bay_m())).collect();
        for zone in zones.iter().flatten() {
            self.report.walls += 1;
            self.report.windows = self.report.windows.saturating_add(zone.windows());
        }
        let mut wall_of = vec![None; faces.len()];
        for (wall, zones) in walls.iter().zip(&zones).filter(|(_, zones)| !zones.is_empty()) {
            wall.faces.iter().for_each(|face| wall_of[*face as usize] = Some((wall, zones)));
        }
        let has_facade = wall_of.iter().any(Option::is_some);
        if has_facade {
            *faces = self.cut_all(faces, &wall_of, anchor, facade_use, materials);
        }
        has_facade
    }

    /// The faces, cut at the zones of their walls, with texture coordinates in them.
    fn cut_all(
        &mut self,
        faces: &[WorldTriangle],
        wall_of: &[Option<(&Wall, &Vec<FacadeZone>)>],
        anchor: DVec3,
        facade_use: FacadeUse,
        materials: &mut impl FacadeMaterials,
    ) -> Vec<WorldTriangle> {
        let limit = MAX_GROWTH * faces.len() + 64;
        let mut cut = Vec::with_capacity(faces.len());
        for (face, wall) in faces.iter().zip(wall_of) {
            let wall = wall.filter(|_| cut.len() < limit);
            let windows = wall
                .and_then(|wall| Some((wall, self.material(materials.colour(face.material), facade_use, materials)?)));
            match windows {
                Some(((wall, zones), material)) => cut_face(face, wall, zones, anchor, material, &mut cut),
                None => cut.push(*face),
            }
        }
        cut
    }

    /// The number of the material of facades of a colour; `None` if there are too many and none has this use.
    fn material(&mut self, rgb: [u8; 3], facade_use: FacadeUse, materials: &mut impl FacadeMaterials) -> Option<u32> {
        let distance =
            |other: [u8; 3]| rgb.iter().zip(other).map(|(a, b)| (i32::from(*a) - i32::from(b)).pow(2)).sum::<i32>();
        let of_use = self.materials.iter().filter(|material| material.facade_use == facade_use);
        let nearest = of_use.min_by_key(|material| distance(material.rgb));
        if let Some(known) = nearest.filter(|known| known.rgb == rgb || self.materials.len() >= MAX_TEXTURES) {
            return Some(known.number);
        }
        if self.materials.len() >= MAX_TEXTURES {
            return None;
        }
        let number = materials.add_pattern(pattern::draw(facade_use, rgb));
        self.materials.push(FacadeMaterial { facade_use, rgb, number });
        Some(number)
    }
}

/// The lowest height of an object; `None` if it is too small for windows.
fn base_of_large_object(faces: &[[DVec3; 3]]) -> Option<f64> {
    let heights = faces.iter().flatten().map(|p| p.z);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), z| (low.min(z), high.max(z)));
    let (mut up_m2, mut down_m2) = (0.0, 0.0);
    for [a, b, c] in faces {
        let area_m2 = (b - a).cross(c - a).z / 2.0;
        *(if area_m2 > 0.0 { &mut up_m2 } else { &mut down_m2 }) += area_m2.abs();
    }
    (high - low >= MIN_HEIGHT_M && f64::max(up_m2, down_m2) >= MIN_FOOTPRINT_M2).then_some(low)
}

#[cfg(test)]
mod tests;

/// Kind of facade.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum FacadeUse {
    /// Dwellings, and everything whose use is not known.
    #[default]
    Home,
    /// Offices, shops, schools and public buildings: higher storeys and wider windows.
    Office,
    /// Halls, garages and churches: storeys and bays of dwellings would be wrong.
    Windowless,
}

/// Words in the names of uses, in the languages of the sources that are common. The first row that has one decides.
const USES: &[(FacadeUse, &[&str])] = &[
    (
        FacadeUse::Windowless,
        &split_words::<25>(
            "industr factory storage warehouse depot hangar parking garage carport shed roof barn stable farm_aux \
            greenhouse church chapel cathedral mosque temple religious kirche kerk 工場 倉庫",
        ),
    ),
    (
        FacadeUse::Office,
        &split_words::<20>(
            "office commerc retail business hotel hospital public civic school university transport kantoor winkel \
            büro gewerbe 業務 商業 宿泊 31001_2 31001_3",
        ),
    ),
];

impl FacadeUse {
    /// By the use of the building, such as `apartments` in OpenStreetMap or 411 in PLATEAU; `None` if it is not known.
    pub fn of_use(name: &str) -> Option<Self> {
        let name = name.trim().to_lowercase();
        // PLATEAU's codes: 43x are transport and storage, 44x factories, 45x farms and supply.
        if let (3, Ok(code)) = (name.len(), name.parse::<u32>()) {
            return match code {
                410..=419 => Some(Self::Home),
                400..=429 => Some(Self::Office),
                430..=459 => Some(Self::Windowless),
                _ => None,
            };
        }
        USES.iter().find(|(_, words)| words.iter().any(|word| name.contains(word))).map(|(kind, _)| *kind)
    }

    /// Usual height of a storey.
    fn storey_m(self) -> f64 {
        if self == Self::Office { 3.6 } else { 2.9 }
    }

    /// Usual width of a bay.
    fn bay_m(self) -> f64 {
        if self == Self::Office { 3.6 } else { 3.0 }
    }
}

/// A rectangle of a wall with whole bays and storeys. Lengths are along the wall and upwards, in metres.
#[derive(Debug, Clone, PartialEq)]
struct FacadeZone {
    /// Ends along the wall, at which bays begin and end.
    along_m: [f64; 2],
    /// Where faces are cut: a little beyond the storeys if the wall has nothing else there.
    z_m: [f64; 2],
    bays: u32,
    /// The first storey with windows, and the one after the last.
    storeys: [u32; 2],
    /// Height of the floor of storey 0.
    base_m: f64,
    storey_m: f64,
}

impl FacadeZone {
    /// Bays from the zone's start and storeys from the floor of the first; the plinth below it is negative.
    fn uv(&self, along_m: f64, z_m: f64) -> [f32; 2] {
        let share = (along_m - self.along_m[0]) / (self.along_m[1] - self.along_m[0]);
        let cells = [share * f64::from(self.bays), (z_m - self.base_m) / self.storey_m];
        cells.map(|cells| (cells / f64::from(CELLS)) as f32)
    }

    fn windows(&self) -> u64 {
        u64::from(self.bays).saturating_mul(u64::from(self.storeys[1] - self.storeys[0]))
    }
}

/// Corners nearer to a border are on it, so that rounded coordinates make no splinters.
const SNAP_M: f64 = 0.03;
/// Pieces with less area are left out.
const MIN_AREA_M2: f64 = 1e-9;

/// Appends the pieces of a face: those in zones with their material and texture coordinates, the others as they are.
/// `anchor` is the position that the wall and its zones are relative to.
fn cut_face(
    face: &WorldTriangle,
    wall: &Wall,
    zones: &[FacadeZone],
    anchor: DVec3,
    material: u32,
    out: &mut Vec<WorldTriangle>,
) {
    let mut rest = vec![face.corners.map(DVec3::from_array).to_vec()];
    let (along_m, z_m) = (|p: DVec3| wall.along_m(p - anchor), |p: DVec3| p.z - anchor.z);
    for zone in zones {
        let mut outside = Vec::new();
        for polygon in rest {
            if !overlaps(&polygon, &along_m, zone.along_m) || !overlaps(&polygon, &z_m, zone.z_m) {
                outside.push(polygon);
                continue;
            }
            let borders: [&dyn Fn(DVec3) -> f64; 4] = [
                &|p| along_m(p) - zone.along_m[0],
                &|p| zone.along_m[1] - along_m(p),
                &|p| z_m(p) - zone.z_m[0],
                &|p| zone.z_m[1] - z_m(p),
            ];
            let mut inside = polygon;
            for border in borders {
                let [kept, cut_off] = split(&inside, border);
                inside = kept;
                outside.extend((!cut_off.is_empty()).then_some(cut_off));
            }
            let uv = |p: DVec3| zone.uv(along_m(p), z_m(p));
            push_fan(&inside, |corners| WorldTriangle { uv: corners.map(uv), material, ..*face }, out);
        }
        rest = outside;
    }
    rest.iter().for_each(|polygon| push_fan(polygon, |_| *face, out));
}

/// Whether a polygon has more than its border in a range.
fn overlaps(polygon: &[DVec3], of: &dyn Fn(DVec3) -> f64, [low, high]: [f64; 2]) -> bool {
    let values = polygon.iter().map(|p| of(*p));
    let (least, most) = values.fold((f64::MAX, f64::MIN), |(least, most), v| (least.min(v), most.max(v)));
    most > low + SNAP_M && least < high - SNAP_M
}

/// Splits a convex polygon into the parts where `distance_m` is positive and negative; either may be empty.
fn split(polygon: &[DVec3], distance_m: &dyn Fn(DVec3) -> f64) -> [Vec<DVec3>; 2] {
    let snapped = |p: DVec3| Some(distance_m(p)).filter(|d| d.abs() > SNAP_M).unwrap_or(0.0);
    let distances: Vec<f64> = polygon.iter().map(|p| snapped(*p)).collect();
    if distances.iter().all(|d| *d >= 0.0) {
        return [polygon.to_vec(), Vec::new()];
    }
    if distances.iter().all(|d| *d <= 0.0) {
        return [Vec::new(), polygon.to_vec()];
    }
    let (mut positive, mut negative) = (Vec::new(), Vec::new());
    for (i, (&p, &d)) in polygon.iter().zip(&distances).enumerate() {
        if d >= 0.0 {
            positive.push(p);
        }
        if d <= 0.0 {
            negative.push(p);
        }
        let next = (i + 1) % polygon.len();
        let (q, e) = (polygon[next], distances[next]);
        if d * e < 0.0 {
            let crossing = crossing((p, d), (q, e));
            positive.push(crossing);
            negative.push(crossing);
        }
    }
    [positive, negative]
}

/// Where an edge crosses a border; the same in both directions, so that neighbouring faces fit.
fn crossing(a: (DVec3, f64), b: (DVec3, f64)) -> DVec3 {
    let is_first = a.0.to_array().partial_cmp(&b.0.to_array()) == Some(std::cmp::Ordering::Less);
    let [(p, d), (q, e)] = if is_first { [a, b] } else { [b, a] };
    p + (q - p) * (d / (d - e))
}

/// Appends the triangles of a convex polygon; `face_of` takes their corners.
fn push_fan(polygon: &[DVec3], face_of: impl Fn([DVec3; 3]) -> WorldTriangle, out: &mut Vec<WorldTriangle>) {
    for k in 2..polygon.len() {
        let corners = [polygon[0], polygon[k - 1], polygon[k]];
        let [a, b, c] = corners;
        if (b - a).cross(c - a).length() >= 2.0 * MIN_AREA_M2 || polygon.len() == 3 {
            out.push(WorldTriangle { corners: corners.map(|p| p.to_array()), ..face_of(corners) });
        }
    }
}
