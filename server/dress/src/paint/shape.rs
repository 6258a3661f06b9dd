//! Shapes that are painted.

use crate::map_store::{MapBounds, MapRecord, bounds};
use crate::paint::class::{AreaClass, LineClass};
use crate::paint::reach::{CASING_M, JUNCTION_REACH_M, MAX_MITER, ROUND_END_REACH_M};
use crate::paint::surfacing::Surfacing;
use serde::{Deserialize, Serialize};

/// Widths of lines are brought into this range.
pub(super) const WIDTH_RANGE_M: [f64; 2] = [0.05, 200.0];

/// An area or a line on the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum PaintShape {
    Area(PaintArea),
    Line(PaintLine),
}

/// An area on the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PaintArea {
    /// Rings in metres, x east and y north, in any orientation, closed or not. What an odd number of rings contains is
    /// painted. Positions that are not finite are left out.
    pub rings: Vec<Vec<[f64; 2]>>,
    pub class: AreaClass,
    /// What it is covered with, where that is not usual for the class.
    pub surfacing: Option<Surfacing>,
}

/// A line on the map. Lines on bridges and in tunnels are left out by the reader: they are not on the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PaintLine {
    /// Points in metres, x east and y north. Lines that meet have a common point there. Positions that are not finite
    /// are left out.
    pub points: Vec<[f64; 2]>,
    pub class: LineClass,
    /// Of the carriageway, without pavements; of the bed, for rails. The usual one of the class if it is not a number.
    pub width_m: f64,
    /// Number of lanes of a road, or of tracks of a railway, if known.
    pub lanes: Option<u8>,
    /// Whether all lanes of a road have the same direction.
    pub is_one_way: bool,
    pub sidewalks: Sidewalks,
    /// What it is covered with, where that is not usual for the class.
    pub surfacing: Option<Surfacing>,
}

/// On which sides a road has pavements.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Sidewalks {
    /// Both, if the class usually has them, but not on fields, in woods and on water.
    #[default]
    Usual,
    None,
    /// Left in the direction of the line.
    Left,
    Right,
    Both,
}

/// A shape touches a picture if its bounds do.
impl MapRecord for PaintShape {
    fn bounds(&self) -> Option<MapBounds> {
        match self {
            Self::Area(area) => bounds(area.rings.iter().flatten()),
            Self::Line(line) => {
                let [low, high] = bounds(&line.points)?;
                let reach_m = line.reach_m();
                Some([low.map(|v| v - reach_m), high.map(|v| v + reach_m)])
            }
        }
    }

    fn size_bytes(&self) -> u64 {
        let ring = |ring: &Vec<[f64; 2]>| 4 + size_of_val(ring.as_slice()) as u64;
        match self {
            Self::Area(area) => 7 + area.rings.iter().map(ring).sum::<u64>(),
            Self::Line(line) => 18 + ring(&line.points),
        }
    }
}

impl PaintLine {
    /// A line of a class with its usual width and nothing else known.
    #[must_use]
    pub fn new(class: LineClass, points: Vec<[f64; 2]>) -> Self {
        Self {
            points,
            class,
            width_m: class.usual_width_m(),
            lanes: None,
            is_one_way: false,
            sidewalks: Sidewalks::Usual,
            surfacing: None,
        }
    }

    /// The width that is painted.
    pub fn width_m(&self) -> f64 {
        let width_m = if self.width_m.is_finite() { self.width_m } else { self.class.usual_width_m() };
        width_m.clamp(WIDTH_RANGE_M[0], WIDTH_RANGE_M[1])
    }

    /// How far from its positions the line changes a picture: with its width, its pavements, and around junctions.
    pub fn reach_m(&self) -> f64 {
        let joins_m = if self.class.is_street() { JUNCTION_REACH_M } else { ROUND_END_REACH_M };
        (MAX_MITER * (self.width_m() / 2.0 + CASING_M)).max(joins_m)
    }
}
