//! What commands say of cameras.

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
