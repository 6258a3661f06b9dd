//! The outline of a footprint, checked: a simple polygon with holes, in metres from its centre.

use super::{RoofFault, simple};
use glam::DVec2;

/// Plans with more corners get no roof but a flat one.
const MAX_CORNERS: usize = 2000;
/// Coordinates beyond this have too few digits left.
const MAX_COORDINATE_M: f64 = 1e8;
/// Corners nearer than this to each other, or to another edge, are taken as touching.
pub(super) const TOUCH_M: f64 = 1e-6;

/// A simple polygon with holes. Corners are numbered through all rings.
pub(super) struct Outline {
    /// The outer ring counter-clockwise, then the holes clockwise, in metres from the centre of the outer ring's box.
    pub(super) rings: Vec<Vec<DVec2>>,
    /// Corners as they were given.
    pub(super) given: Vec<[f64; 2]>,
    /// Centre, in the coordinates that were given.
    pub(super) centre: DVec2,
    pub(super) area_m2: f64,
}

impl Outline {
    /// Checks rings. Fails if they are no simple polygon, or have too many corners.
    pub(super) fn new(rings: &[Vec<[f64; 2]>]) -> Result<Self, RoofFault> {
        if rings.iter().map(Vec::len).sum::<usize>() > MAX_CORNERS {
            return Err(RoofFault::TooManyCorners);
        }
        let is_valid = |corner: &[f64; 2]| corner.iter().all(|x| x.abs() < MAX_COORDINATE_M);
        if rings.is_empty() || rings.iter().any(|ring| ring.len() < 3 || !ring.iter().all(is_valid)) {
            return Err(RoofFault::Ring);
        }
        let corners = |ring: &[[f64; 2]]| ring.iter().map(|&corner| DVec2::from_array(corner)).collect::<Vec<_>>();
        let outer = corners(&rings[0]);
        let [low, high] =
            [outer.iter().fold(outer[0], |a, b| a.min(*b)), outer.iter().fold(outer[0], |a, b| a.max(*b))];
        let centre = ((low + high) / 2.0).round();
        let centred: Vec<Vec<DVec2>> =
            rings.iter().map(|ring| corners(ring).into_iter().map(|corner| corner - centre).collect()).collect();
        check(&centred)?;
        let area_m2 = centred.iter().map(|ring| simple::area(ring)).sum();
        Ok(Self { rings: centred, given: rings.concat(), centre, area_m2 })
    }

    /// All corners in the order of their numbers.
    pub(super) fn corners(&self) -> Vec<DVec2> {
        self.rings.concat()
    }

    /// The numbers of the corners of each ring.
    pub(super) fn ring_numbers(&self) -> Vec<Vec<usize>> {
        let mut start = 0;
        let numbers = |ring: &Vec<DVec2>| {
            start += ring.len();
            (start - ring.len()..start).collect()
        };
        self.rings.iter().map(numbers).collect()
    }
}

fn check(rings: &[Vec<DVec2>]) -> Result<(), RoofFault> {
    for (i, ring) in rings.iter().enumerate() {
        for (k, corner) in ring.iter().enumerate() {
            if corner.distance(ring[(k + 1) % ring.len()]) <= TOUCH_M {
                return Err(RoofFault::Ring);
            }
        }
        let area_m2 = simple::area(ring);
        let turned_m2 = if i == 0 { area_m2 } else { -area_m2 };
        if turned_m2.is_nan() || turned_m2 <= TOUCH_M {
            return Err(RoofFault::Turn);
        }
    }
    if !simple::is_simple(rings, TOUCH_M) {
        return Err(RoofFault::Crossing);
    }
    let is_inside = |hole: &Vec<DVec2>| {
        simple::contains(&rings[..1], hole[0])
            && rings[1..]
                .iter()
                .all(|other| std::ptr::eq(hole, other) || !simple::contains(std::slice::from_ref(other), hole[0]))
    };
    if rings[1..].iter().all(is_inside) { Ok(()) } else { Err(RoofFault::Crossing) }
}
