//! Which surfaces look inwards: some formats leave the direction of rings open, many files disagree with their format, and
//! coordinates whose order is corrected are a mirror image of those that were written. So it is decided in the city's system.

use glam::DVec3;
use insula_dress::palette::area_vector;
use insula_source::object::ring_ranges;
use insula_source::report::SourceFormat;

/// A body is closed if its area vectors add up to less than this share of its area.
const CLOSED_SHARE: f64 = 0.02;
/// An open shell looks down if it does by more than this share of its area.
const DOWN_SHARE: f64 = 0.1;
/// A body encloses at least this share of the cube over its area; the sign of less is chance.
const VOLUME_SHARE: f64 = 1e-6;

/// How surfaces look as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Facing {
    Outward,
    /// They enclose a body, and look inwards.
    Inward,
    /// They are an open shell that looks down.
    Down,
}

/// Numbers of the objects of a source by how they look, if its format says from which side surfaces are seen.
#[derive(Debug, Default)]
pub(super) struct FacingCounts {
    all: u64,
    wrong: u64,
}

impl FacingCounts {
    pub(super) fn add(&mut self, facing: Facing) {
        self.all += 1;
        self.wrong += u64::from(facing != Facing::Outward);
    }

    /// Tells that an order of coordinates, which `finding` names, makes a mirror image of most objects, if it does.
    pub(super) fn mirror_text(&self, finding: &str) -> Option<String> {
        let (all, wrong) = (self.all, self.wrong);
        (2 * wrong > all).then(|| format!("{wrong} of {all} objects: {finding}"))
    }
}

/// Sums over the placed surfaces of an object.
#[derive(Debug, Default)]
pub(super) struct ShellSums {
    base: Option<DVec3>,
    area: DVec3,
    /// Of lengths of area vectors.
    total_area: f64,
    /// Three times the volume that is enclosed if the surfaces look outwards.
    volume: f64,
}

impl ShellSums {
    /// Adds a polygon: the outer ring, then holes that begin at `hole_starts`, in any direction.
    pub(super) fn add_polygon(&mut self, points: &[[f64; 3]], hole_starts: &[u32]) {
        let Some(origin) = points.first() else { return };
        let mut sum = DVec3::ZERO;
        for (number, ring) in ring_ranges(points.len(), hole_starts).enumerate() {
            let area = points.get(ring).map_or(DVec3::ZERO, area_vector);
            sum += if number > 0 && area.dot(sum) > 0.0 { -area } else { area };
        }
        self.add(*origin, sum);
    }

    pub(super) fn add_triangle(&mut self, corners: &[[f64; 3]; 3]) {
        self.add(corners[0], area_vector(corners));
    }

    fn add(&mut self, origin: [f64; 3], area: DVec3) {
        let origin = DVec3::from_array(origin);
        let base = *self.base.get_or_insert(origin);
        self.area += area;
        self.total_area += area.length();
        self.volume += (origin - base).dot(area);
    }

    pub(super) fn facing(&self) -> Facing {
        let is_closed = self.area.length() <= CLOSED_SHARE * self.total_area;
        let least_volume = VOLUME_SHARE * self.total_area * self.total_area.sqrt();
        match is_closed {
            true if self.volume < -least_volume => Facing::Inward,
            false if self.area.z < -DOWN_SHARE * self.total_area => Facing::Down,
            _ => Facing::Outward,
        }
    }
}

/// Whether a format says from which side surfaces are seen.
pub(super) fn has_direction(format: SourceFormat) -> bool {
    !matches!(
        format,
        SourceFormat::GeoJson
            | SourceFormat::FlatGeobuf
            | SourceFormat::GeoPackage
            | SourceFormat::Shapefile
            | SourceFormat::GeoParquet
            | SourceFormat::Csv
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: [[[f64; 3]; 4]; 6] = [
        [[0., 0., 0.], [0., 1., 0.], [1., 1., 0.], [1., 0., 0.]],
        [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]],
        [[0., 0., 0.], [1., 0., 0.], [1., 0., 1.], [0., 0., 1.]],
        [[0., 1., 0.], [0., 1., 1.], [1., 1., 1.], [1., 1., 0.]],
        [[0., 0., 0.], [0., 0., 1.], [0., 1., 1.], [0., 1., 0.]],
        [[1., 0., 0.], [1., 1., 0.], [1., 1., 1.], [1., 0., 1.]],
    ];

    fn facing(quads: &[[[f64; 3]; 4]], is_turned: bool) -> Facing {
        let mut sums = ShellSums::default();
        for quad in quads {
            let mut points = quad.map(|[x, y, z]| [x + 1e5, y + 5e6, z]);
            if is_turned {
                points.reverse();
            }
            sums.add_polygon(&points, &[]);
        }
        sums.facing()
    }

    #[test]
    fn bodies_look_outward_and_shells_up() {
        assert_eq!((facing(&CUBE, false), facing(&CUBE, true)), (Facing::Outward, Facing::Inward));
        assert_eq!((facing(&CUBE[1..2], false), facing(&CUBE[1..2], true)), (Facing::Outward, Facing::Down));
        assert_eq!((facing(&CUBE[2..3], false), facing(&CUBE[2..3], true)), (Facing::Outward, Facing::Outward));
        let both = [CUBE[2], [CUBE[2][0], CUBE[2][3], CUBE[2][2], CUBE[2][1]]];
        assert_eq!(
            (facing(&both, false), facing(&both, true)),
            (Facing::Outward, Facing::Outward),
            "two sides of a sheet"
        );
    }

    #[test]
    fn a_source_is_a_mirror_image_if_most_of_its_objects_are() {
        let mut counts = FacingCounts::default();
        assert_eq!(counts.mirror_text("x"), None);
        [Facing::Inward, Facing::Outward].into_iter().for_each(|facing| counts.add(facing));
        assert_eq!(counts.mirror_text("x"), None);
        counts.add(Facing::Down);
        assert_eq!(counts.mirror_text("x").as_deref(), Some("2 of 3 objects: x"));
    }

    #[test]
    fn holes_count_against_their_polygon() {
        let outer = [[0., 0., 0.], [4., 0., 0.], [4., 4., 0.], [0., 4., 0.]];
        let hole = [[1., 1., 0.], [2., 1., 0.], [2., 2., 0.], [1., 2., 0.]];
        let turned = [hole[0], hole[3], hole[2], hole[1]];
        for hole in [hole, turned] {
            let mut sums = ShellSums::default();
            sums.add_polygon(&[outer, hole].concat(), &[4]);
            assert!((sums.area.z - 15.0).abs() < 1e-12);
        }
    }
}
