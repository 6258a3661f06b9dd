//! Directions of a plan: the smallest rectangle around it, and the ridge that follows.

use super::{Outline, RoofOrientation, RoofSpec, simple};
use glam::DVec2;

/// Plans that fill this share of their rectangle are treated as one.
const RECTANGULAR_SHARE: f64 = 0.9;
/// Directions are turned by no more than this to be parallel to a wall: many are only named points of the compass.
const SNAP_DEG: f64 = 12.0;

/// The rectangle with the smallest area around a ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rectangle {
    /// Unit vector along the longer side.
    pub(super) along: DVec2,
    pub(super) length_m: f64,
    pub(super) width_m: f64,
}

impl Rectangle {
    /// The rectangle around points; `None` if they have no area. One of its sides is on a side of the convex hull.
    pub(super) fn around(points: &[DVec2]) -> Option<Self> {
        let hull = hull(points);
        let of_side = |(a, b): (DVec2, DVec2)| {
            let side = (b - a).try_normalize()?;
            let [length_m, width_m] = [side, side.perp()].map(|axis| {
                let (low, high) = extent(&hull, axis);
                high - low
            });
            let (along, length_m, width_m) =
                if length_m < width_m { (side.perp(), width_m, length_m) } else { (side, length_m, width_m) };
            Some(Self { along, length_m, width_m })
        };
        let all = simple::edges(&hull).filter_map(of_side);
        let smallest = all.min_by(|a, b| a.area().total_cmp(&b.area()));
        smallest.filter(|smallest| smallest.area() > 0.0)
    }

    fn area(&self) -> f64 {
        self.length_m * self.width_m
    }
}

/// The least and the greatest coordinate of points along an axis.
pub(super) fn extent(points: &[DVec2], axis: DVec2) -> (f64, f64) {
    points.iter().map(|point| point.dot(axis)).fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)))
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let chain = |sorted: &mut dyn Iterator<Item = &DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for &point in sorted {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(point - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter());
    hull.extend(chain(&mut sorted.iter().rev()));
    hull
}

/// Whether a plan is a rectangle but for details.
pub(super) fn is_nearly_rectangular(outline: &Outline) -> bool {
    Rectangle::around(&outline.rings[0]).is_some_and(|around| outline.area_m2 >= RECTANGULAR_SHARE * around.area())
}

/// Width of the rooms below a roof: that of the rectangle around the plan, or of the rectangle with the plan's area and
/// perimeter if that is narrower, as it is for an L. `None` for plans without area.
pub(super) fn usual_width_m(rings: &[Vec<[f64; 2]>]) -> Option<f64> {
    let rings: Vec<Vec<DVec2>> =
        rings.iter().map(|ring| ring.iter().map(|&c| DVec2::from_array(c)).collect()).collect();
    let around = Rectangle::around(rings.first()?)?;
    let area_m2: f64 = rings.iter().map(|ring| simple::area(ring)).sum();
    let perimeter_m: f64 = rings.iter().flat_map(|ring| simple::edges(ring)).map(|(a, b)| a.distance(b)).sum();
    let quarter_m = perimeter_m / 4.0;
    let equivalent_m = quarter_m - (quarter_m * quarter_m - area_m2).max(0.0).sqrt();
    let width_m = around.width_m.min(equivalent_m);
    (width_m.is_finite() && width_m > 0.0).then_some(width_m)
}

/// Axis of a roof with one ridge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ridge {
    /// Unit vector along the ridge. Heights change across it, from its right to its left.
    pub(super) along: DVec2,
}

impl Ridge {
    /// The ridge of a roof: perpendicular to its direction, or by its orientation, or along the plan.
    pub(super) fn of(outline: &Outline, direction_deg: Option<f64>, orientation: Option<RoofOrientation>) -> Self {
        if let Some(direction) = direction_deg.and_then(unit) {
            return Self { along: snapped(outline, direction).perp() };
        }
        let along = Rectangle::around(&outline.rings[0]).map_or(DVec2::X, |around| around.along);
        Self { along: if orientation == Some(RoofOrientation::Across) { along.perp() } else { along } }
    }

    /// The level line of a roof with one slope. The slope faces `direction_deg`, or by default the longest wall along the
    /// ridge.
    pub(super) fn of_slope(outline: &Outline, spec: &RoofSpec) -> Self {
        if spec.direction_deg.and_then(unit).is_some() {
            return Self::of(outline, spec.direction_deg, None);
        }
        let ridge = Self::of(outline, None, spec.orientation);
        let longest_wall = |turned: DVec2| {
            let walls = simple::edges(&outline.rings[0]).map(|(a, b)| b - a);
            let facing = walls.filter(|wall| wall.dot(turned) > 0.99 * wall.length());
            facing.map(DVec2::length).fold(0.0, f64::max)
        };
        // The low side is to the right of the ridge, where walls of a counter-clockwise ring have the ridge's direction.
        if longest_wall(-ridge.along) > longest_wall(ridge.along) + 1e-6 { Self { along: -ridge.along } } else { ridge }
    }
}

/// Unit vector of a direction on the compass.
fn unit(direction_deg: f64) -> Option<DVec2> {
    let (east, north) = libm::sincos(direction_deg.to_radians());
    (east.is_finite() && north.is_finite()).then_some(DVec2::new(east, north))
}

/// A direction, turned to be parallel or perpendicular to the longest wall that it nearly is.
fn snapped(outline: &Outline, direction: DVec2) -> DVec2 {
    let mut best = (0.0, direction);
    for wall in simple::edges(&outline.rings[0]).map(|(a, b)| b - a) {
        let Some(axis) = wall.try_normalize() else { continue };
        for axis in [axis, -axis, axis.perp(), -axis.perp()] {
            let is_near = axis.dot(direction) >= libm::cos(SNAP_DEG.to_radians());
            if is_near && wall.length() > best.0 + 1e-6 {
                best = (wall.length(), axis);
            }
        }
    }
    best.1
}
