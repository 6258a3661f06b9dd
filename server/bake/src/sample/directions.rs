//! The directions from which a block's visibility is tested.
//!
//! They are spherical Fibonacci sets (Keinert et al. 2015, "Spherical Fibonacci mapping"), ordered so that the first
//! few of a set are spread as evenly as all of them.

use glam::Vec3;

const GOLDEN_ANGLE_RAD: f32 = 2.399_963_2;
/// z of the steepest direction from below the horizon (27 degrees).
const LOWEST_Z: f32 = -0.45;

/// `n` unit vectors towards the viewer, spread evenly over the upper half of the sphere.
pub(super) fn sky(n: u32) -> Vec<Vec3> {
    spread(n, 0.0, 1.0)
}

/// `n` unit vectors towards a viewer up to 27 degrees below the horizon.
pub(super) fn below_horizon(n: u32) -> Vec<Vec3> {
    spread(n, LOWEST_Z, 0.0)
}

/// Directions whose z is spread evenly between the two limits.
fn spread(n: u32, z_low: f32, z_high: f32) -> Vec<Vec3> {
    // A stride near the golden section that shares no factor with n visits every index once.
    let mut stride = (n as f32 * 0.618) as u32 | 1;
    while gcd(stride, n.max(1)) != 1 {
        stride += 1;
    }
    (0..n)
        .map(|i| {
            let index = (u64::from(i) * u64::from(stride) % u64::from(n)) as f32;
            let z = z_low + (z_high - z_low) * (index + 0.5) / n as f32;
            let r = (1.0 - z * z).sqrt();
            let (sin, cos) = libm::sincosf(index * GOLDEN_ANGLE_RAD);
            Vec3::new(r * cos, r * sin, z)
        })
        .collect()
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_spread_evenly_and_distinct() {
        for n in [1, 7, 64, 128, 160] {
            let all = sky(n);
            let mean = all.iter().sum::<Vec3>() / n as f32;
            assert!((mean.z - 0.5).abs() < 0.01, "{n}: {mean}");
            let mut zs: Vec<i64> = all.iter().map(|d| (d.z * 1e6) as i64).collect();
            zs.sort_unstable();
            zs.dedup();
            assert_eq!(zs.len(), n as usize);
        }
        assert!(below_horizon(32).iter().all(|d| d.z < 0.0 && d.z > -0.46));
    }
}
