//! Levels of detail by switching distances, as in scenes of multi-resolution objects (Gasparello 2007, sections 4.3.5 and 5.3.1),
//! instead of by screen-space error. For comparisons of both.

use glam::DVec3;

/// Most switching distances.
pub const MAX_SWITCHES: usize = 16;

/// To which volume around a node a distance is measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SwitchVolume {
    #[default]
    Box,
    Sphere,
}

/// Distances from the eye, in metres, at which the next coarser level of detail is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwitchDistances {
    /// Ascending; infinite after the last one.
    metres: [f64; MAX_SWITCHES],
    volume: SwitchVolume,
}

/// Centre, half of the sides and radius of a node's volumes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeVolume {
    pub(crate) centre: DVec3,
    pub(crate) half: DVec3,
    pub(crate) radius_m: f64,
}

impl SwitchDistances {
    /// `None` unless there are 1 to [`MAX_SWITCHES`] finite distances above 0 that ascend.
    pub fn new(distances_m: &[f64], volume: SwitchVolume) -> Option<Self> {
        let is_valid = |m: &f64| m.is_finite() && *m > 0.0;
        let ascends = distances_m.windows(2).all(|pair| pair[0] < pair[1]);
        if !(1..=MAX_SWITCHES).contains(&distances_m.len()) || !distances_m.iter().all(is_valid) || !ascends {
            return None;
        }
        let mut metres = [f64::INFINITY; MAX_SWITCHES];
        metres[..distances_m.len()].copy_from_slice(distances_m);
        Some(Self { metres, volume })
    }

    /// Stands for a screen-space error: 1 where `level`, counted from the finest one, is drawn, and twice as much for each level
    /// that it is coarser than that. Never larger for a child than for its parent, if its volume lies inside the parent's.
    #[cold]
    pub(crate) fn error_px(&self, level: u8, node: &NodeVolume, eye: DVec3) -> f64 {
        let offset = eye - node.centre;
        let distance_m = match self.volume {
            SwitchVolume::Box => (offset.abs() - node.half).max(DVec3::ZERO).length(),
            SwitchVolume::Sphere => offset.length() - node.radius_m,
        };
        let drawn = self.metres.iter().filter(|metres| distance_m >= **metres).count();
        2.0f64.powi(i32::from(level) - drawn as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_distance_is_one_level() {
        let node = NodeVolume { centre: DVec3::ZERO, half: DVec3::new(10.0, 10.0, 4.0), radius_m: 15.0 };
        let by_box = SwitchDistances::new(&[25.0, 50.0, 100.0], SwitchVolume::Box).unwrap();
        let at = |x: f64| DVec3::new(x, 0.0, 0.0);
        for (x, drawn) in [(0.0, 0), (34.9, 0), (35.0, 1), (60.0, 2), (110.0, 3), (1e6, 3)] {
            assert_eq!(by_box.error_px(drawn, &node, at(x)), 1.0);
            assert_eq!(by_box.error_px(drawn + 2, &node, at(x)), 4.0);
        }
        let by_sphere = SwitchDistances::new(&[25.0, 50.0, 100.0], SwitchVolume::Sphere).unwrap();
        assert_eq!((by_sphere.error_px(1, &node, at(39.0)), by_sphere.error_px(1, &node, at(40.0))), (2.0, 1.0));
    }

    #[test]
    fn distances_must_ascend() {
        for bad in [&[][..], &[2.0, 1.0], &[1.0, 1.0], &[0.0], &[-1.0], &[f64::NAN], &[f64::INFINITY], &[1.0; 17]] {
            assert_eq!(SwitchDistances::new(bad, SwitchVolume::Box), None);
        }
    }
}
