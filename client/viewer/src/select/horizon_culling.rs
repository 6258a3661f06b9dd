//! Which boxes other boxes may occlude, seen from the eye.
//!
//! The horizon around the eye is divided into 64 sectors. Boxes are taken from the nearest to the farthest, and each raises the
//! horizon of the sectors that it reaches into. A box below the horizon of all its sectors may be occluded.

use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Parts of the horizon, of equal angle.
const SECTORS: usize = 64;
/// A box can only be occluded by boxes that are nearer by this factor and by [`MARGIN_M`]: neighbours do not occlude each other.
const DISTANCE_FACTOR: f64 = 2.0;
/// Distances below this count as inside, in metres: an eye where tiles meet is inside all of them.
const MARGIN_M: f64 = 1.0;

/// The bounding box of a tile's content, in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Occluder {
    pub(crate) centre: DVec3,
    /// Half of the box's sides.
    pub(crate) half: DVec3,
}

impl Occluder {
    /// Horizontal distance from the eye to the nearest point of the box.
    fn distance_m(&self, eye: DVec3) -> f64 {
        ((eye - self.centre).abs() - self.half).max(DVec3::ZERO).truncate().length()
    }

    /// The steepest slope (rise over run) at which any part of the box can be seen.
    fn slope(&self, eye: DVec3) -> f64 {
        let rise_m = self.centre.z + self.half.z - eye.z;
        let farthest_m = ((eye - self.centre).abs() + self.half).truncate().length();
        rise_m / if rise_m > 0.0 { self.distance_m(eye) } else { farthest_m }
    }

    /// The sectors that the box reaches into, all of them if the eye is inside. They may begin below 0 or end above the last.
    fn sectors(&self, eye: DVec3) -> std::ops::RangeInclusive<i64> {
        if self.distance_m(eye) <= MARGIN_M {
            return 0..=SECTORS as i64 - 1;
        }
        let to_centre = (self.centre - eye).truncate();
        let half = self.half.truncate();
        let corners = [half, -half, DVec2::new(half.x, -half.y), DVec2::new(-half.x, half.y)];
        let angles = corners.map(|corner| to_centre.angle_to(to_centre + corner));
        let min = angles.into_iter().fold(f64::INFINITY, f64::min);
        let max = angles.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let sector = |angle: f64| ((to_centre.to_angle() + angle) / TAU * SECTORS as f64).floor() as i64;
        sector(min)..=sector(max)
    }
}

/// For each box, whether nearer boxes may occlude all of it.
pub(crate) fn may_be_occluded(eye: DVec3, boxes: &[Occluder]) -> Vec<bool> {
    let distances_m: Vec<f64> = boxes.iter().map(|occluder| occluder.distance_m(eye)).collect();
    let mut by_distance: Vec<usize> = (0..boxes.len()).collect();
    by_distance.sort_by(|a, b| distances_m[*a].total_cmp(&distances_m[*b]));
    let mut nearer = by_distance.iter().peekable();
    let mut horizon = [f64::NEG_INFINITY; SECTORS];
    let wrap = |sector: i64| sector.rem_euclid(SECTORS as i64) as usize;
    let mut occluded = vec![false; boxes.len()];
    for i in &by_distance {
        let is_in_front = |other: &&usize| distances_m[**other] * DISTANCE_FACTOR + MARGIN_M < distances_m[*i];
        while let Some(front) = nearer.next_if(is_in_front) {
            let slope = boxes[*front].slope(eye);
            boxes[*front].sectors(eye).for_each(|sector| horizon[wrap(sector)] = horizon[wrap(sector)].max(slope));
        }
        let slope = boxes[*i].slope(eye);
        occluded[*i] = boxes[*i].sectors(eye).all(|sector| slope <= horizon[wrap(sector)]);
    }
    occluded
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYE: DVec3 = DVec3::new(100.0, -50.0, 2.0);

    /// A block with sides of 60 m on the ground: distance from the eye to its middle, direction, and height.
    fn block(distance_m: f64, degrees: f64, height_m: f64) -> Occluder {
        let to = DVec2::from_angle(degrees.to_radians()) * distance_m;
        let z = height_m * 0.5;
        Occluder { centre: DVec3::new(EYE.x + to.x, EYE.y + to.y, z), half: DVec3::new(30.0, 30.0, z) }
    }

    #[test]
    fn lower_boxes_behind_may_be_occluded_in_every_direction() {
        for degrees in (0..360).step_by(7).map(f64::from) {
            let front = block(100.0, degrees, 20.0);
            // 18 m above the eye after 55 to 70 m: 120 to 155 m above it after 470 m.
            let [low, high] = [50.0, 200.0].map(|height_m| block(500.0, degrees, height_m));
            assert_eq!(may_be_occluded(EYE, &[low, high, front]), [true, false, false], "{degrees}");
            // Boxes beside the front box, or not far enough behind it, are not occluded whatever their height.
            let beside = block(500.0, degrees + 60.0, 5.0);
            assert_eq!(may_be_occluded(EYE, &[front, beside]), [false, false], "{degrees}");
            let next_to = [block(110.0, degrees, 5.0), front];
            assert_eq!(may_be_occluded(EYE, &next_to), [false, false], "{degrees}");
        }
    }

    #[test]
    fn box_in_front_of_a_row_occludes_its_middle() {
        // Distant blocks, 10 degrees from one to the next, and one in front of them that reaches 23 degrees to both sides.
        let row: Vec<Occluder> = (-3..=3).map(|i| block(1000.0, f64::from(i) * 10.0, 10.0)).collect();
        let boxes: Vec<Occluder> = row.into_iter().chain([block(100.0, 0.0, 20.0)]).collect();
        assert_eq!(may_be_occluded(EYE, &boxes), [false, true, true, true, true, true, false, false]);
    }

    #[test]
    fn nothing_is_occluded_from_above_the_roofs() {
        let eye = EYE.with_z(500.0);
        let row = [100.0, 300.0, 1000.0, 3000.0].map(|distance_m| block(distance_m, 20.0, 200.0));
        assert_eq!(may_be_occluded(eye, &row), [false; 4]);
    }

    #[test]
    fn box_around_the_eye_may_occlude_everything() {
        // What is inside is unknown, and its highest part may be right in front of the eye.
        let own = Occluder { centre: EYE.with_z(10.0), half: DVec3::new(30.0, 30.0, 10.0) };
        let tower = block(300.0, 200.0, 300.0);
        assert_eq!(may_be_occluded(EYE, &[tower, own]), [true, false]);
        // An eye above its roof sees over it.
        assert_eq!(may_be_occluded(EYE.with_z(25.0), &[tower, own]), [false, false]);
        assert!(may_be_occluded(EYE, &[]).is_empty());
    }
}
