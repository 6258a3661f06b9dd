//! Geometry of one feature, the same for all vector formats.

use insula_source::object::TriangleMesh;

/// Positions of a ring or line in source coordinates; z is 0 where the source has none, and not a number where only this position has none.
pub(crate) type Ring = Vec<[f64; 3]>;
/// The outer ring, then the holes.
pub(crate) type Polygon = Vec<Ring>;

/// Collections nested deeper are refused.
pub(super) const MAX_DEPTH: u32 = 16;
pub(super) const TOO_DEEP: &str = "geometry nested too deep";
pub(super) const MALFORMED: &str = "malformed geometry";
pub(crate) const UNKNOWN_TYPE: &str = "geometry of unknown type";

/// Heights on land, in metres or feet; others are marks of missing ones, such as -9999.
const HEIGHTS: std::ops::RangeInclusive<f64> = -1500.0..=30_000.0;
/// Larger ones are marks in any unit, such as the largest number of single precision.
const LARGEST: f64 = 1e9;

/// Whether two positions are one on the map. Their heights may be missing.
pub(super) fn is_same_place(a: Option<&[f64; 3]>, b: Option<&[f64; 3]>) -> bool {
    a.is_some() && a.map(|a| &a[..2]) == b.map(|b| &b[..2])
}

/// West, south, east and north of positions, ignoring those that are not numbers; infinite without any.
pub(super) fn extent_of<'p>(positions: impl IntoIterator<Item = &'p [f64; 3]>) -> [f64; 4] {
    let none = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    positions.into_iter().fold(none, |[w, s, e, n], [x, y, _]| [w.min(*x), s.min(*y), e.max(*x), n.max(*y)])
}

/// All parts of a feature's geometry.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Geometry {
    pub(crate) polygons: Vec<Polygon>,
    pub(crate) meshes: Vec<TriangleMesh>,
    pub(crate) lines: Vec<Ring>,
    pub(crate) points: Vec<[f64; 3]>,
    /// The source says that the polygons and meshes are surfaces in space: TIN, polyhedral surface or multipatch.
    pub(crate) is_surface: bool,
    /// The positions have heights.
    pub(crate) has_z: bool,
}

impl Geometry {
    #[cfg(test)]
    pub(super) fn is_empty(&self) -> bool {
        self.positions().next().is_none()
    }

    pub(crate) fn positions(&self) -> impl Iterator<Item = &[f64; 3]> {
        let rings = self.polygons.iter().flatten().chain(&self.lines).flatten();
        rings.chain(&self.points).chain(self.meshes.iter().flat_map(|mesh| &mesh.positions))
    }

    /// West, south, east and north of all positions, ignoring those that are not numbers; `None` without any.
    pub(crate) fn bounds(&self) -> Option<[f64; 4]> {
        let bounds = extent_of(self.positions());
        (bounds[0] <= bounds[2] && bounds[1] <= bounds[3]).then_some(bounds)
    }

    /// Settles the heights of a source where each position may have one or none (not a number): they count if one has one.
    /// [`Self::fill_heights`] gives the others theirs.
    pub(super) fn settle_heights(&mut self) {
        let has_z = self.positions().any(|position| position[2].is_finite());
        self.has_z = has_z;
        self.level_without_heights();
    }

    /// Gives all positions the height 0 if none has one, which are not a number so far. If only some have none, [`Self::fill_heights`]
    /// gives them theirs.
    pub(super) fn level_without_heights(&mut self) {
        if !self.has_z {
            self.for_each_position(|position| position[2] = 0.0);
        }
    }

    /// Gives positions whose height is missing by a mark the lowest height of the others. Without any others the geometry has no heights.
    /// Returns the first mark.
    pub(super) fn fill_heights(&mut self) -> Option<f64> {
        if !self.has_z {
            return None;
        }
        // Bodies may be in a small unit, whose heights are large.
        for range in [HEIGHTS, *HEIGHTS.start()..=LARGEST] {
            let heights = || self.positions().map(|position| position[2]);
            let mark = heights().find(|z| !range.contains(z))?;
            if let Some(lowest) = heights().filter(|z| range.contains(z)).reduce(f64::min) {
                self.for_each_position(|position| {
                    if !range.contains(&position[2]) {
                        position[2] = lowest;
                    }
                });
                return Some(mark);
            }
        }
        if self.is_surface {
            return None;
        }
        let mark = self.positions().next()?[2];
        self.has_z = false;
        self.for_each_position(|position| position[2] = 0.0);
        Some(mark)
    }

    pub(super) fn for_each_position(&mut self, change: impl FnMut(&mut [f64; 3])) {
        let rings = self.polygons.iter_mut().flatten().chain(&mut self.lines).flatten();
        let of_meshes = self.meshes.iter_mut().flat_map(|mesh| &mut mesh.positions);
        rings.chain(&mut self.points).chain(of_meshes).for_each(change);
    }

    /// Adds a polygon unless it has no ring.
    pub(crate) fn push_polygon(&mut self, mut polygon: Polygon) {
        polygon.retain(|ring| !ring.is_empty());
        if !polygon.is_empty() {
            self.polygons.push(polygon);
        }
    }

    /// Adds a line unless it has no position.
    pub(crate) fn push_line(&mut self, line: Ring) {
        if !line.is_empty() {
            self.lines.push(line);
        }
    }

    /// Adds a point unless it is empty (not a number).
    pub(crate) fn push_point(&mut self, point: [f64; 3]) {
        if !point[0].is_nan() {
            self.points.push(point);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_missing_heights_become_the_lowest_of_the_others() {
        let of = |heights: [f64; 3]| Geometry {
            lines: vec![heights.map(|z| [1.0, 2.0, z]).to_vec()],
            has_z: true,
            ..Geometry::default()
        };
        let filled = |heights| {
            let mut geometry = of(heights);
            (geometry.fill_heights().is_some(), geometry == of([512.0, 513.0, 512.0]))
        };
        assert_eq!(filled([512.0, 513.0, -9999.0]), (true, true));
        assert_eq!(filled([512.0, 513.0, 512.0]), (false, true));
        for mark in [-9999.0, f64::NAN, -1.797e308, 3.4028235e38] {
            let mut geometry = of([mark; 3]);
            assert_eq!(geometry.fill_heights().map(f64::to_bits), Some(mark.to_bits()));
            assert_eq!(geometry, Geometry { has_z: false, ..of([0.0; 3]) });
        }
        assert_eq!(filled([500_000.0; 3]), (false, false), "millimetres");
        let mut geometry = of([500_000.0, f64::NAN, 600_000.0]);
        assert!(geometry.fill_heights().is_some_and(f64::is_nan));
        assert_eq!(geometry, of([500_000.0, 500_000.0, 600_000.0]));
    }
}
