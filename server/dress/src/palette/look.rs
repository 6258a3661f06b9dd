//! The look of one building: what its walls are made of, and how it differs from its neighbours.

use super::tables::{BRICK_WALLS, CONCRETE_WALLS, FLAT_ROOF, HALL_ROOF, PLASTER_WALLS, TILED_ROOF};
use glam::DVec3;
use insula_source::text::split_words;

/// Least z of a flat roof's unit normal. It is the cosine of 14 degrees: drained flat roofs slope by up to 5, and tiles
/// hold off rain from about 15 degrees on.
const FLAT_NORMAL_Z: f64 = 0.97;
/// Least z of a roof's unit normal where the source does not distinguish roofs from walls: up to 75 degrees steep.
const ROOF_NORMAL_Z: f64 = 0.26;
/// Larger pitched roofs are those of halls, which have sheet metal.
const HALL_M2: f64 = 1500.0;
/// Change of lightness of one step, in percent of the sRGB values.
const STEP_PERCENT: i32 = 5;

/// Material of a building's walls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WallKind {
    Plaster,
    Brick,
    Concrete,
}

/// Words in the names of uses, in the languages of the sources that are common.
const USES: &[(WallKind, &[&str])] = &[
    (
        WallKind::Plaster,
        &["resid", "house", "home", "apartment", "dwelling", "detached", "wohn", "woon", "住宅", "31001_1"],
    ),
    (
        WallKind::Brick,
        &split_words::<11>("church chapel cathedral religious school terrace farm barn stable kirche kerk"),
    ),
    (
        WallKind::Concrete,
        &split_words::<27>(
            "industr factory storage depot hangar parking garage office commerc retail business hotel hospital public \
            civic transport kantoor winkel büro gewerbe 業務 商業 工場 倉庫 宿泊 31001_2 31001_3",
        ),
    ),
];

impl WallKind {
    /// By the use of the building, such as `apartments` in OpenStreetMap or 411 in PLATEAU; `None` if it is not known.
    pub fn of_use(name: &str) -> Option<Self> {
        let name = name.trim().to_lowercase();
        // PLATEAU's codes: 41x are dwellings, 40x to 44x businesses, public buildings and industry.
        if let (3, Ok(code)) = (name.len(), name.parse::<u32>()) {
            return match code {
                410..=419 => Some(Self::Plaster),
                400..=449 => Some(Self::Concrete),
                _ => None,
            };
        }
        // Its name contains "house".
        if name.contains("warehouse") {
            return Some(Self::Concrete);
        }
        let is_named = |(_, words): &&(Self, &[&str])| words.iter().any(|word| name.contains(word));
        USES.iter().find(is_named).map(|(kind, _)| *kind)
    }
}

/// Extent of an object, measured before its surfaces get colours.
#[derive(Debug, Clone, Copy, Default)]
pub struct ObjectShape {
    /// Area of the upward surfaces, seen from above.
    footprint_m2: f64,
}

impl ObjectShape {
    /// Adds a surface by its area seen from above, negative if it looks down.
    pub fn add(&mut self, up_m2: f64) {
        self.footprint_m2 += up_m2.max(0.0);
    }
}

/// The vector that is as long as the ring's area and perpendicular to it (Newell's method).
pub fn area_vector(ring: &[[f64; 3]]) -> DVec3 {
    let Some(&anchor) = ring.first() else { return DVec3::ZERO };
    // Relative to the first corner: products of full map coordinates would lose their digits by cancellation.
    let from = |p: [f64; 3]| DVec3::from_array(p) - DVec3::from_array(anchor);
    ring.windows(2).map(|pair| from(pair[0]).cross(from(pair[1]))).sum::<DVec3>() * 0.5
}

/// Absolute z of a ring's unit normal, so that the direction of turning does not matter; 0 without an area.
pub fn normal_z(ring: &[[f64; 3]]) -> f64 {
    let normal = area_vector(ring);
    let length = normal.length();
    if length > 0.0 { normal.z.abs() / length } else { 0.0 }
}

/// What a building's surfaces have in common. A building always has the same look: it follows from its identifier and
/// its own surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuildingLook {
    walls: WallKind,
    is_hall: bool,
    /// Index of the tone, 0 to 3.
    tone: u8,
    /// Steps by which it is lighter, -1 to 1.
    step: i32,
}

impl BuildingLook {
    /// `id` is that of the whole building, and `walls` follows from its use. Half of the buildings have the common look,
    /// the others one of eight: each border between two colours costs bytes of the tiles.
    pub fn new(id: &str, walls: Option<WallKind>, shape: &ObjectShape) -> Self {
        let variant = blake3::hash(id.as_bytes()).as_bytes()[0] % 16;
        let (tone, step) = match variant.checked_sub(8) {
            None => (0, 0),
            Some(variant) => (variant % 4, if variant < 4 { 1 } else { -1 }),
        };
        let walls = walls.unwrap_or(WallKind::Plaster);
        Self { walls, is_hall: shape.footprint_m2 > HALL_M2, tone, step }
    }

    /// The look of objects that are not buildings: no variation.
    pub const PLAIN: Self = Self { walls: WallKind::Plaster, is_hall: false, tone: 0, step: 0 };

    pub(super) fn wall(&self) -> [u8; 3] {
        let tones = match self.walls {
            WallKind::Plaster => PLASTER_WALLS,
            WallKind::Brick => BRICK_WALLS,
            WallKind::Concrete => CONCRETE_WALLS,
        };
        self.shade(tones[usize::from(self.tone % 4)])
    }

    pub(super) fn roof(&self, normal_z: f64) -> [u8; 3] {
        match (normal_z > FLAT_NORMAL_Z, self.is_hall) {
            (true, _) => FLAT_ROOF,
            (false, true) => HALL_ROOF,
            (false, false) => self.shade(TILED_ROOF),
        }
    }

    /// Roof or wall.
    pub(super) fn shell(&self, normal_z: f64) -> [u8; 3] {
        if normal_z > ROOF_NORMAL_Z { self.roof(normal_z) } else { self.wall() }
    }

    /// A colour as light as this building is among its neighbours.
    pub(super) fn shade(&self, rgb: [u8; 3]) -> [u8; 3] {
        let percent = 100 + self.step * STEP_PERCENT;
        rgb.map(|v| ((i32::from(v) * percent + 50) / 100).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(width_m: f64) -> ObjectShape {
        let ring = [[0.0, 0.0, 8.0], [width_m, 0.0, 8.0], [width_m, 10.0, 8.0], [0.0, 10.0, 8.0]];
        let mut shape = ObjectShape::default();
        shape.add(area_vector(&ring).z);
        shape.add(area_vector(&ring.map(|[x, y, _]| [y, x, 0.0])).z);
        shape
    }

    #[test]
    fn looks_differ_between_buildings_and_stay_close() {
        let mut colours: Vec<_> =
            (0..200).map(|i| BuildingLook::new(&i.to_string(), None, &shape(10.0)).wall()).collect();
        colours.sort_unstable();
        colours.dedup();
        assert_eq!(colours.len(), 9);
        let luminance = |rgb: [u8; 3]| rgb.map(i32::from).iter().sum::<i32>();
        let levels = colours.iter().map(|rgb| luminance(*rgb));
        assert!(levels.clone().max().unwrap() - levels.min().unwrap() < 120);
        let look = BuildingLook::new("a", None, &shape(10.0));
        assert_eq!(look, BuildingLook::new("a", None, &shape(20.0)));
    }

    #[test]
    fn slope_and_size_decide_the_roof() {
        let look = BuildingLook { is_hall: shape(151.0).footprint_m2 > HALL_M2, ..BuildingLook::PLAIN };
        assert!(look.is_hall && shape(149.0).footprint_m2 < HALL_M2);
        let rise = |z: f64| normal_z(&[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, z], [0.0, 4.0, z]]);
        assert_eq!((BuildingLook::PLAIN.roof(rise(0.9)), BuildingLook::PLAIN.roof(rise(1.1))), (FLAT_ROOF, TILED_ROOF));
        assert_eq!((look.roof(rise(0.9)), look.roof(rise(1.1))), (FLAT_ROOF, HALL_ROOF));
        assert_eq!((look.shell(0.1), look.shell(0.5)), (PLASTER_WALLS[0], HALL_ROOF));
    }

    #[test]
    fn use_decides_the_walls() {
        let cases = [
            ("apartments", Some(WallKind::Plaster)),
            ("warehouse", Some(WallKind::Concrete)),
            ("Church", Some(WallKind::Brick)),
            ("411", Some(WallKind::Plaster)),
            ("441", Some(WallKind::Concrete)),
            ("31001_2000", Some(WallKind::Concrete)),
            ("yes", None),
        ];
        for (name, kind) in cases {
            assert_eq!(WallKind::of_use(name), kind, "{name}");
        }
        let walls = |known| BuildingLook::new("a", known, &shape(10.0)).walls;
        assert_eq!((walls(None), walls(Some(WallKind::Brick))), (WallKind::Plaster, WallKind::Brick));
    }
}
