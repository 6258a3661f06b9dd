//! What stands in front of what, as far as boxes tell.
//!
//! In: the boxes of tiles that are on their way. Out: which of them those before may hide. Next: `session::flow` asks for the
//! others first.
//!
//! Pure. The horizon around the eye is cut into 64 sectors like a cake; boxes are taken from the nearest to the farthest, and
//! each raises the horizon of the sectors that it reaches into. A box below the horizon of all its sectors may be hidden.

use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Parts of the horizon.
const SECTORS: usize = 64;
/// In front stands what is nearer by so many times, and by [`MARGIN_M`]: what lies side by side waits for nothing.
const TIMES: f64 = 2.0;
/// Whoever stands where tiles meet is in all of them.
const MARGIN_M: f64 = 1.0;

/// A node's box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Occluder {
    /// Middle.
    pub centre: DVec3,
    /// Half of its sides.
    pub half: DVec3,
}

impl Occluder {
    /// Metres from the eye to the nearest place of its square.
    fn near_m(&self, eye: DVec3) -> f64 {
        ((eye - self.centre).abs() - self.half).max(DVec3::ZERO).truncate().length()
    }

    /// The highest angle at which any of it can be seen, as rise by run.
    fn slope(&self, eye: DVec3) -> f64 {
        let rise = self.centre.z + self.half.z - eye.z;
        let far_m = ((eye - self.centre).abs() + self.half).truncate().length();
        rise / if rise > 0.0 { self.near_m(eye) } else { far_m }
    }

    /// Its sectors, which may begin below 0 or end behind the last; all of them around the eye.
    fn sectors(&self, eye: DVec3) -> std::ops::RangeInclusive<i64> {
        if self.near_m(eye) <= MARGIN_M {
            return 0..=SECTORS as i64 - 1;
        }
        let to = (self.centre - eye).truncate();
        let half = self.half.truncate();
        let corners =
            [half, -half, DVec2::new(half.x, -half.y), DVec2::new(-half.x, half.y)].map(|h| to.angle_to(to + h));
        let least = corners.into_iter().fold(f64::INFINITY, f64::min);
        let most = corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let sector = |angle: f64| ((to.to_angle() + angle) / TAU * SECTORS as f64).floor() as i64;
        sector(least)..=sector(most)
    }
}

/// For each box, whether those before it may hide all of it.
pub fn may_be_occluded(eye: DVec3, solids: &[Occluder]) -> Vec<bool> {
    let near_m: Vec<f64> = solids.iter().map(|solid| solid.near_m(eye)).collect();
    let mut order: Vec<usize> = (0..solids.len()).collect();
    order.sort_by(|a, b| near_m[*a].total_cmp(&near_m[*b]));
    let mut in_front = order.iter().peekable();
    let mut horizon = [f64::NEG_INFINITY; SECTORS];
    let place = |sector: i64| sector.rem_euclid(SECTORS as i64) as usize;
    let mut hidden = vec![false; solids.len()];
    for i in &order {
        while let Some(front) = in_front.next_if(|front| near_m[**front] * TIMES + MARGIN_M < near_m[*i]) {
            let slope = solids[*front].slope(eye);
            solids[*front].sectors(eye).for_each(|at| horizon[place(at)] = horizon[place(at)].max(slope));
        }
        let slope = solids[*i].slope(eye);
        hidden[*i] = solids[*i].sectors(eye).all(|at| slope <= horizon[place(at)]);
    }
    hidden
}

#[cfg(test)]
mod tests {
    use crate::select::horizon_culling::*;

    const EYE: DVec3 = DVec3::new(100.0, -50.0, 2.0);

    /// A block of 60 m, `away_m` from the eye to its middle, at an angle and up to a height above the ground.
    fn block(away_m: f64, degrees: f64, height_m: f64) -> Occluder {
        let to = DVec2::from_angle(degrees.to_radians()) * away_m;
        let z = height_m * 0.5;
        Occluder { centre: DVec3::new(EYE.x + to.x, EYE.y + to.y, z), half: DVec3::new(30.0, 30.0, z) }
    }

    #[test]
    fn what_is_lower_and_behind_may_be_hidden_all_around() {
        for degrees in (0..360).step_by(7).map(f64::from) {
            let front = block(100.0, degrees, 20.0);
            // 18 m above the eye after 55 to 70 m: 120 to 155 m above it after 470 m.
            let [low, high] = [50.0, 200.0].map(|height_m| block(500.0, degrees, height_m));
            assert_eq!(may_be_occluded(EYE, &[low, high, front]), [true, false, false], "{degrees}");
            // Whatever its height: it is beside, or it is in front of nothing.
            let beside = block(500.0, degrees + 60.0, 5.0);
            assert_eq!(may_be_occluded(EYE, &[front, beside]), [false, false], "{degrees}");
            let side_by_side = [block(110.0, degrees, 5.0), front];
            assert_eq!(may_be_occluded(EYE, &side_by_side), [false, false], "{degrees}");
        }
    }

    #[test]
    fn what_stands_before_the_middle_of_a_row_hides_the_middle() {
        // Blocks far away, 10 degrees from one to the next, and one in front of them that is 23 degrees wide to both sides.
        let row: Vec<Occluder> = (-3..=3).map(|i| block(1000.0, f64::from(i) * 10.0, 10.0)).collect();
        let solids: Vec<Occluder> = row.into_iter().chain([block(100.0, 0.0, 20.0)]).collect();
        assert_eq!(may_be_occluded(EYE, &solids), [false, true, true, true, true, true, false, false]);
    }

    #[test]
    fn from_above_the_roofs_nothing_hides_anything() {
        let eye = EYE.with_z(500.0);
        let rows = [100.0, 300.0, 1000.0, 3000.0].map(|away_m| block(away_m, 20.0, 200.0));
        assert_eq!(may_be_occluded(eye, &rows), [false; 4]);
    }

    #[test]
    fn where_one_stands_hides_all_the_rest() {
        // Nothing is known of what is inside, and the highest of it may be before the eyes.
        let own = Occluder { centre: EYE.with_z(10.0), half: DVec3::new(30.0, 30.0, 10.0) };
        let tower = block(300.0, 200.0, 300.0);
        assert_eq!(may_be_occluded(EYE, &[tower, own]), [true, false]);
        // But not who stands on its roof.
        assert_eq!(may_be_occluded(EYE.with_z(25.0), &[tower, own]), [false, false]);
        assert!(may_be_occluded(EYE, &[]).is_empty());
    }
}
