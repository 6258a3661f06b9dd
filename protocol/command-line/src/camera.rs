//! What commands say of cameras.

use insula_protocol::Manifest;

/// Numbers so near to the place of a city, in degrees, are a place in it.
const NEAR_DEG: f64 = 1.0;
/// A camera that lies no further from a city, in metres, may be meant so.
const FAR_M: f64 = 10_000.0;

/// Says that the first two numbers of a camera are degrees, in either order, where metres are meant; `None` if they are not.
#[must_use]
pub fn degrees_fault(manifest: &Manifest, [x, y]: [f64; 2]) -> Option<String> {
    let [low, high] = manifest.bounds;
    let is_far = (0..2).any(|k| !(low[k] - FAR_M..=high[k] + FAR_M).contains(&[x, y][k]));
    let place = manifest.location?;
    let is_near = |longitude: f64, latitude: f64| {
        (longitude - place.longitude_deg).abs() <= NEAR_DEG && (latitude - place.latitude_deg).abs() <= NEAR_DEG
    };
    let system = manifest.crs.as_deref().unwrap_or("the city");
    let [middle_x, middle_y] = [0, 1].map(|k| (low[k] + high[k]) / 2.0);
    (is_far && (is_near(x, y) || is_near(y, x))).then(|| {
        format!(
            "--camera {x},{y},...: these are degrees: write metres of {system}, the middle of the city is {middle_x:.0},{middle_y:.0}"
        )
    })
}

/// Says that a camera is inside of a building or below the ground, and whether it stays there or is lifted by so many metres.
#[must_use]
pub fn inside_note(is_kept: bool, up_m: f64) -> String {
    let inside = "the camera is inside of a building or below the ground";
    if is_kept { inside.to_owned() } else { format!("{inside}: lifted by {up_m:.1} m; --keep-camera keeps it") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lift_is_told_in_metres() {
        assert!(inside_note(false, 4.72).ends_with("ground: lifted by 4.7 m; --keep-camera keeps it"));
        assert!(inside_note(true, 4.72).ends_with("below the ground"));
    }
}
