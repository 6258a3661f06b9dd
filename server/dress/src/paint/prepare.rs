//! Prepares shapes for painting: drops invalid positions and sorts them.

use crate::map_store::{MapRecord, is_position, overlap};
use crate::paint::canvas::Brush;
use crate::paint::class::{AreaClass, AreaLayer, LineClass};
use crate::paint::material::PaintMaterial;
use crate::paint::mix_bits;
use crate::paint::shape::{PaintArea, PaintLine, PaintShape, Sidewalks};
use crate::paint::surfacing::Surfacing;
use crate::polygon::area_m2;
use std::borrow::Borrow;
use std::cmp::Reverse;

/// Corners of areas nearer to each other than this part of a texel are one.
const SAME_CORNER_TEXELS: f64 = 0.125;
/// Points of lines nearer to each other, in metres, are one.
const SAME_POINT_M: f64 = 0.01;
/// More lanes or tracks are taken for an error of the source.
const MAX_LANES: u8 = 16;
/// Fields differ by so much from the mean of all, of 128.
const FIELD_TONE: u64 = 104;

/// An area to paint.
#[derive(Debug, Clone)]
pub(super) struct ReadyArea {
    pub rings: Vec<Vec<[f64; 2]>>,
    pub bounds: [[f64; 2]; 2],
    pub layer: AreaLayer,
    pub brush: Brush,
    order: (Reverse<u64>, AreaClass, u64),
}

/// A line to paint, with at least two points.
#[derive(Debug, Clone)]
pub(super) struct ReadyLine {
    pub points: Vec<[f64; 2]>,
    /// Distance of each point from the first, in metres along the line.
    pub along_m: Vec<f64>,
    pub bounds: [[f64; 2]; 2],
    pub class: LineClass,
    pub half_m: f64,
    pub lanes: Option<u8>,
    pub is_one_way: bool,
    pub sidewalks: Sidewalks,
    pub surfacing: Option<Surfacing>,
    /// Whether its start and its end are round: lines of the same material begin there.
    pub goes_on: [bool; 2],
    /// Parts of the line without lane lines, in metres along it, ascending.
    pub cuts_m: Vec<[f64; 2]>,
    hash: u64,
}

/// All shapes of a picture, in the order of painting.
#[derive(Debug, Default)]
pub(super) struct ReadyShapes {
    pub areas: Vec<ReadyArea>,
    pub lines: Vec<ReadyLine>,
}

impl ReadyShapes {
    /// Prepares the shapes that touch a rectangle. Their order does not matter.
    pub(super) fn new<S: Borrow<PaintShape>>(shapes: &[S], rectangle: [[f64; 2]; 2], texel_m: f64) -> Self {
        let mut ready = Self::default();
        for shape in shapes {
            let shape = shape.borrow();
            let Some(bounds) = shape.bounds().filter(|bounds| overlap(*bounds, rectangle)) else { continue };
            match shape {
                PaintShape::Area(area) => ready.areas.extend(ReadyArea::new(area, bounds, texel_m)),
                PaintShape::Line(line) => ready.lines.extend(ReadyLine::new(line, bounds)),
            }
        }
        ready.areas.sort_by_key(|area| (area.layer, area.order));
        ready.lines.sort_by_key(|line| (line.class, line.hash));
        ready
    }
}

impl ReadyArea {
    /// `None` if no ring has three corners.
    fn new(area: &PaintArea, bounds: [[f64; 2]; 2], texel_m: f64) -> Option<Self> {
        let rings: Vec<Vec<[f64; 2]>> = area
            .rings
            .iter()
            .map(|ring| distinct(ring, SAME_CORNER_TEXELS * texel_m))
            .filter(|ring| ring.len() >= 3)
            .collect();
        if rings.is_empty() {
            return None;
        }
        let hash = hash(area.rings.iter().flatten());
        let brush = match (area.class, area.surfacing) {
            (AreaClass::Farmland, _) => field_brush(&rings, hash),
            (class, Some(surfacing)) if class.layer() >= AreaLayer::Paved => Brush::plain(surfacing.material()),
            (class, _) => Brush::plain(class.material()),
        };
        let size = rings.iter().map(|ring| area_m2(ring).abs()).fold(0.0, f64::max);
        // Positive floats have the order of their bits.
        let order = (Reverse(size.to_bits()), area.class, mix_bits(hash ^ brush.material as u64));
        Some(Self { rings, bounds, layer: area.class.layer(), brush, order })
    }
}

impl ReadyLine {
    /// `None` if there are not two points.
    fn new(line: &PaintLine, bounds: [[f64; 2]; 2]) -> Option<Self> {
        let mut points = distinct(&line.points, SAME_POINT_M);
        // The end is where other lines begin.
        if let (Some(end), Some(last)) = (line.points.iter().rfind(|point| is_position(**point)), points.last_mut()) {
            *last = *end;
        }
        if points.len() < 2 {
            return None;
        }
        let mut along_m = Vec::with_capacity(points.len());
        let mut sum = 0.0;
        along_m.push(sum);
        for pair in points.windows(2) {
            sum += distance(pair[0], pair[1]);
            along_m.push(sum);
        }
        let details = [
            line.width_m.to_bits(),
            u64::from(line.lanes.unwrap_or(0)),
            u64::from(line.is_one_way),
            line.sidewalks as u64,
            line.surfacing.map_or(u64::MAX, |surfacing| surfacing as u64),
        ];
        Some(Self {
            hash: details.into_iter().fold(hash(&line.points), |hash, bits| mix_bits(hash ^ bits)),
            points,
            along_m,
            bounds,
            class: line.class,
            half_m: line.width_m() / 2.0,
            lanes: line.lanes.filter(|lanes| (1..=MAX_LANES).contains(lanes)),
            is_one_way: line.is_one_way,
            sidewalks: line.sidewalks,
            surfacing: line.surfacing,
            goes_on: [false; 2],
            cuts_m: Vec::new(),
        })
    }

    /// What the line is made of.
    pub(super) fn brush(&self) -> Brush {
        Brush::plain(self.surfacing.map_or(self.class.material(), Surfacing::material))
    }
}

impl AreaClass {
    fn material(self) -> PaintMaterial {
        match self {
            Self::Residential => PaintMaterial::ResidentialGround,
            Self::Commercial => PaintMaterial::CommercialGround,
            Self::Industrial => PaintMaterial::IndustrialGround,
            Self::RailwayLand => PaintMaterial::RailwayGround,
            Self::Construction => PaintMaterial::Earth,
            Self::Park => PaintMaterial::Park,
            Self::Cemetery => PaintMaterial::Graveyard,
            Self::Farmland => PaintMaterial::Farmland,
            Self::Meadow => PaintMaterial::Meadow,
            Self::Grass => PaintMaterial::Grass,
            Self::Scrub => PaintMaterial::Scrub,
            Self::Forest => PaintMaterial::Forest,
            Self::Wetland => PaintMaterial::Wetland,
            Self::Sand | Self::Playground => PaintMaterial::Sand,
            Self::Rock => PaintMaterial::Rock,
            Self::Water => PaintMaterial::Water,
            Self::Parking => PaintMaterial::SideAsphalt,
            Self::Square => PaintMaterial::Paving,
            Self::Pavement => PaintMaterial::Pavement,
            Self::Platform => PaintMaterial::Concrete,
            Self::Pier => PaintMaterial::Wood,
            Self::Pitch => PaintMaterial::Turf,
            Self::Carriageway => PaintMaterial::Carriageway,
            Self::TrackBed => PaintMaterial::Ballast,
        }
    }
}

impl LineClass {
    fn material(self) -> PaintMaterial {
        match self {
            Self::Waterway => PaintMaterial::Water,
            Self::Pier => PaintMaterial::Wood,
            Self::Platform => PaintMaterial::Concrete,
            Self::Rail | Self::NarrowGauge => PaintMaterial::Ballast,
            Self::Tram | Self::Service | Self::LivingStreet => PaintMaterial::SideAsphalt,
            Self::Track => PaintMaterial::Earth,
            Self::Path => PaintMaterial::Gravel,
            Self::Footway | Self::Pedestrian => PaintMaterial::Pavement,
            Self::Cycleway => PaintMaterial::Cycleway,
            Self::Steps => PaintMaterial::Concrete,
            Self::Zebra => PaintMaterial::Marking,
            _ => PaintMaterial::Asphalt,
        }
    }
}

/// The positions of a line or ring, without those nearer than `same_m` to the one before.
fn distinct(points: &[[f64; 2]], same_m: f64) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::with_capacity(points.len());
    for point in points.iter().filter(|point| is_position(**point)) {
        if kept.last().is_none_or(|last| distance(*last, *point) >= same_m) {
            kept.push(*point);
        }
    }
    kept
}

/// A number for positions. Equal shapes of different files have the same.
fn hash<'p>(points: impl IntoIterator<Item = &'p [f64; 2]>) -> u64 {
    points.into_iter().flatten().fold(0, |hash, v| mix_bits(hash ^ v.to_bits()))
}

/// Rows along the longer direction of a field, and its own tone.
fn field_brush(rings: &[Vec<[f64; 2]>], hash: u64) -> Brush {
    // The mean direction of edges by the square of their lengths, as twice the angle: opposite edges are alike.
    let mut sum = [0.0; 2];
    for pair in rings.iter().take(1).flat_map(|ring| ring.windows(2)) {
        let [x, y] = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
        let length = libm::hypot(x, y);
        sum = [sum[0] + (x * x - y * y) * length, sum[1] + 2.0 * x * y * length];
    }
    let turns = (libm::atan2(sum[1], sum[0]) / std::f64::consts::TAU).rem_euclid(1.0);
    let tone = u64::from(Brush::NEUTRAL_TONE) + hash % (2 * FIELD_TONE + 1) - FIELD_TONE;
    Brush {
        material: PaintMaterial::Farmland,
        // Half of the doubled angle: 256 steps are half a turn. The last step is the first.
        direction: (turns * 256.0).round() as u64 as u8,
        tone: u8::try_from(tone).unwrap_or(Brush::NEUTRAL_TONE),
    }
}

pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(b[0] - a[0], b[1] - a[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(class: AreaClass, side_m: f64) -> PaintShape {
        let ring = vec![[0.0, 0.0], [side_m, 0.0], [side_m, side_m], [0.0, side_m]];
        PaintShape::Area(PaintArea { rings: vec![ring], class, surfacing: None })
    }

    #[test]
    fn order_is_by_layer_then_size() {
        let shapes = [
            area(AreaClass::Pitch, 5.0),
            area(AreaClass::Water, 10.0),
            area(AreaClass::Park, 2.0),
            area(AreaClass::Forest, 30.0),
            area(AreaClass::Grass, 3.0),
            area(AreaClass::Residential, 100.0),
            area(AreaClass::Carriageway, 200.0),
        ];
        let materials = |shapes: &[PaintShape]| {
            let ready = ReadyShapes::new(shapes, [[0.0; 2], [1.0; 2]], 0.25);
            ready.areas.iter().map(|area| area.brush.material).collect::<Vec<_>>()
        };
        let expected = [
            PaintMaterial::ResidentialGround,
            PaintMaterial::Park,
            PaintMaterial::Forest,
            PaintMaterial::Water,
            PaintMaterial::Grass,
            PaintMaterial::Turf,
            PaintMaterial::Carriageway,
        ];
        assert_eq!(materials(&shapes), expected);
        let mut other = shapes;
        other.reverse();
        other.swap(1, 4);
        assert_eq!(materials(&other), expected);
    }

    #[test]
    fn rows_lie_along_the_longer_side() {
        for (degrees, expected) in [(0.0f64, 0), (45.0, 64), (90.0, 128), (135.0, 192)] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let turned = |[x, y]: [f64; 2]| [1e6 + x * cos - y * sin, 5e6 + x * sin + y * cos];
            let ring = [[0.0, 0.0], [300.0, 0.0], [300.0, 80.0], [0.0, 80.0], [0.0, 0.0]].map(turned).to_vec();
            let brush = field_brush(&[ring], 5);
            assert_eq!(brush.direction, expected, "{degrees}");
        }
        let tones: std::collections::BTreeSet<u8> = (0..999).map(|hash| field_brush(&[], hash).tone).collect();
        assert_eq!((tones.first(), tones.last()), (Some(&24), Some(&232)));
    }

    #[test]
    fn what_is_no_position_is_left_out() {
        let points =
            vec![[f64::NAN, 0.0], [0.0, 0.0], [0.001, 0.0], [3.0, 4.0], [1e12, 0.0], [3.0, 10.0], [3.001, 10.0]];
        let shape = PaintShape::Line(PaintLine {
            lanes: Some(200),
            width_m: f64::NAN,
            ..PaintLine::new(LineClass::Primary, points)
        });
        let ready = ReadyShapes::new(&[shape], [[0.0; 2], [1.0; 2]], 0.25);
        let [line] = &ready.lines[..] else { panic!("{ready:?}") };
        assert_eq!(line.points, [[0.0, 0.0], [3.0, 4.0], [3.001, 10.0]]);
        assert_eq!((line.lanes, line.half_m), (None, 3.5));
        assert!((line.along_m[2] - 11.0).abs() < 1e-3);
    }
}
