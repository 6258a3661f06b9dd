//! Units of length that comments of meshes tell.

use insula_source::units::metres_of;

/// What to report of a comment that tells another unit than metres, as `File units = inches` of SketchUp does; `None` if it does not.
/// `place` is that of the comment. The unit is not applied: place files may scale the mesh.
pub(crate) fn told_unit(place: &str, comment: &str) -> Option<String> {
    let lower = comment.to_lowercase();
    let mut words = lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    words.find(|word| matches!(*word, "unit" | "units"))?;
    let unit = words.find(|word| !matches!(*word, "1" | "in" | "is" | "are"))?;
    let unit_m = metres_of(unit).filter(|unit_m| *unit_m != 1.0)?;
    let advice = format!("scale the mesh, or give \"scale\": {unit_m} in its .place.json file");
    let start: String = comment.chars().take(60).collect();
    Some(format!("{place}: {start}, taken as metres; {advice}"))
}
