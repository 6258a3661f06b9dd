//! Roads: pavements, kerbs, carriageways and their markings.

use crate::paint::canvas::{Brush, Canvas};
use crate::paint::class::LineClass;
use crate::paint::material::{MaterialSet, PaintMaterial};
use crate::paint::palette::PaintStyle;
use crate::paint::prepare::ReadyLine;
use crate::paint::reach::{CASING_M, KERB_M, MAX_HALF_M};
use crate::paint::shape::Sidewalks;
use crate::paint::stroke::{Stripe, band, stripe};
use PaintMaterial as M;

/// Width of lane lines.
const LINE_M: f64 = 0.15;
/// Lane lines: length of a dash, and from one to the next.
const LANE_DASH_M: [f64; 2] = [3.0, 12.0];
/// Stripes of zebra crossings, and from one to the next.
const ZEBRA_DASH_M: [f64; 2] = [0.5, 1.0];
/// What is left of a carriageway beside the lanes: on each side of a motorway, and of other roads.
const SHOULDER_M: [f64; 2] = [0.5, 0.25];
/// Width of a lane if their number is not known.
const USUAL_LANE_M: f64 = 3.25;
/// Roads with narrower lanes have no lines between them: side streets, and others.
const MIN_LANE_M: [f64; 2] = [3.0, 2.4];
/// Distance between the middles of double lines.
const DOUBLE_M: f64 = 0.3;
/// Details that are smaller than this number of samples are left out.
const MIN_SAMPLES: f64 = 1.0;

/// On what pavements are painted.
pub(super) struct Grounds {
    built_up: MaterialSet,
    dry: MaterialSet,
    walks: MaterialSet,
    carriageways: MaterialSet,
}

impl Grounds {
    pub(super) fn new() -> Self {
        let built_up = [
            M::ResidentialGround,
            M::CommercialGround,
            M::IndustrialGround,
            M::RailwayGround,
            M::Park,
            M::Grass,
            M::Graveyard,
            M::Earth,
            M::SideAsphalt,
            M::Gravel,
            M::Turf,
            M::Pavement,
        ];
        let rural = [M::Farmland, M::Meadow, M::Scrub, M::Forest, M::Sand, M::Rock];
        Self {
            built_up: MaterialSet::new(&built_up, true),
            dry: MaterialSet::new(&[&built_up[..], &rural].concat(), true),
            walks: MaterialSet::new(&[M::Pavement, M::Paving, M::Concrete, M::Setts, M::Cycleway], false),
            carriageways: MaterialSet::new(&[M::Asphalt, M::SideAsphalt, M::Carriageway], false),
        }
    }
}

/// Paints the pavements of a road.
pub(super) fn paint_sidewalks(canvas: &mut Canvas, line: &ReadyLine, style: &PaintStyle, grounds: &Grounds) {
    let brush = Brush::plain(M::Pavement);
    let reach_m = line.half_m + CASING_M;
    let edges_m = match line.sidewalks {
        Sidewalks::Usual if style.has_usual_sidewalks && line.class.has_sidewalks() => {
            band(line, reach_m, &mut canvas.polygons(brush, Some(&grounds.built_up)));
            return;
        }
        Sidewalks::Both => {
            band(line, reach_m, &mut canvas.polygons(brush, Some(&grounds.dry)));
            return;
        }
        Sidewalks::Left => [0.0, reach_m],
        Sidewalks::Right => [-reach_m, 0.0],
        Sidewalks::Usual | Sidewalks::None => return,
    };
    stripe(line, Stripe { edges_m, dash_m: None, cuts_m: &[] }, &mut canvas.polygons(brush, Some(&grounds.dry)));
}

/// Paints the kerbs of a road, where there is a pavement.
pub(super) fn paint_kerb(canvas: &mut Canvas, line: &ReadyLine, grounds: &Grounds) {
    if line.class.is_street() && line.sidewalks != Sidewalks::None && is_visible(canvas, KERB_M) {
        let mut fill = canvas.polygons(Brush::plain(M::Kerb), Some(&grounds.walks));
        band(line, line.half_m + KERB_M, &mut fill);
    }
}

pub(super) fn paint_carriageway(canvas: &mut Canvas, line: &ReadyLine) {
    band(line, line.half_m, &mut canvas.polygons(line.brush(), None));
}

/// Paints lane lines, or the stripes of a crossing.
pub(super) fn paint_markings(canvas: &mut Canvas, line: &ReadyLine, grounds: &Grounds) {
    let (brush, over) = (Brush::plain(M::Marking), Some(&grounds.carriageways));
    if line.class == LineClass::Zebra {
        if is_visible(canvas, ZEBRA_DASH_M[0] / 2.0) {
            let edges_m = [-line.half_m, line.half_m];
            stripe(
                line,
                Stripe { edges_m, dash_m: Some(ZEBRA_DASH_M), cuts_m: &[] },
                &mut canvas.polygons(brush, over),
            );
        }
    } else if is_visible(canvas, LINE_M) {
        for (middle_m, dash_m) in lane_lines(line) {
            let edges_m = [middle_m - LINE_M / 2.0, middle_m + LINE_M / 2.0];
            stripe(line, Stripe { edges_m, dash_m, cuts_m: &line.cuts_m }, &mut canvas.polygons(brush, over));
        }
    }
}

/// Whether a detail of a width can be seen.
pub(super) fn is_visible(canvas: &Canvas, width_m: f64) -> bool {
    width_m * canvas.window().samples_per_m >= MIN_SAMPLES
}

/// Distances of lane lines to the left of the middle in metres, with their dashes.
fn lane_lines(line: &ReadyLine) -> Vec<(f64, Option<[f64; 2]>)> {
    let is_motorway = line.class == LineClass::Motorway;
    let shoulder_m = SHOULDER_M[usize::from(!is_motorway)];
    let usable_m = 2.0 * (line.half_m - shoulder_m);
    let mut found = Vec::new();
    let is_marked = (LineClass::Residential..=LineClass::Motorway).contains(&line.class);
    if !is_marked || usable_m <= 0.0 || line.half_m > MAX_HALF_M {
        return found;
    }
    if is_motorway {
        found.extend([(usable_m / 2.0, None), (-usable_m / 2.0, None)]);
    }
    let lanes = lane_count(line, usable_m);
    let lane_m = usable_m / f64::from(lanes);
    if lane_m < MIN_LANE_M[usize::from(!is_side_street(line.class))] {
        return found;
    }
    for lane in 1..lanes {
        let middle_m = usable_m / 2.0 - f64::from(lane) * lane_m;
        if !line.is_one_way && lanes > 3 && lane == lanes / 2 {
            found.extend([(middle_m + DOUBLE_M / 2.0, None), (middle_m - DOUBLE_M / 2.0, None)]);
        } else {
            found.push((middle_m, Some(LANE_DASH_M)));
        }
    }
    found
}

fn lane_count(line: &ReadyLine, usable_m: f64) -> u8 {
    line.lanes.unwrap_or_else(|| match is_side_street(line.class) {
        true => 1,
        // At most 200 m wide.
        false => ((usable_m / USUAL_LANE_M).round() as u8).clamp(1, 16),
    })
}

fn is_side_street(class: LineClass) -> bool {
    matches!(class, LineClass::Residential | LineClass::Unclassified)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paint::prepare::ReadyShapes;
    use crate::paint::shape::{PaintLine, PaintShape};

    fn lines(class: LineClass, width_m: f64, lanes: Option<u8>, is_one_way: bool) -> Vec<(f64, bool)> {
        let line = PaintLine::new(class, vec![[0.0, 0.0], [10.0, 0.0]]);
        let shape = PaintShape::Line(PaintLine { width_m, lanes, is_one_way, ..line });
        let ready = ReadyShapes::new(&[shape], [[0.0; 2], [1.0; 2]], 0.25);
        lane_lines(&ready.lines[0]).into_iter().map(|(middle_m, dash_m)| (middle_m, dash_m.is_some())).collect()
    }

    #[test]
    fn lanes_have_lines_between_them() {
        use LineClass::{Motorway, Primary, Residential, Service, Tertiary};
        assert_eq!(lines(Primary, 7.0, None, false), [(0.0, true)]);
        assert_eq!(lines(Primary, 9.5, Some(3), true), [(1.5, true), (-1.5, true)]);
        assert_eq!(lines(Primary, 12.5, Some(4), false), [(3.0, true), (0.15, false), (-0.15, false), (-3.0, true)]);
        assert_eq!(lines(Motorway, 9.0, Some(2), true), [(4.0, false), (-4.0, false), (0.0, true)]);
        assert_eq!(lines(Residential, 5.5, None, false), []);
        assert_eq!(lines(Residential, 4.0, Some(2), false), []);
        assert_eq!(lines(Residential, 6.0, Some(2), false), []);
        assert_eq!(lines(Residential, 7.0, Some(2), false), [(0.0, true)]);
        assert_eq!(lines(Motorway, 6.0, Some(2), true).len(), 3);
        assert_eq!(lines(Service, 7.0, Some(2), false), []);
        assert_eq!(lines(Tertiary, 0.3, Some(2), false), []);
        assert_eq!(lines(Primary, 31.0, Some(8), false), []);
    }
}
