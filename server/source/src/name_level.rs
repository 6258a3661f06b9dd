//! Levels of detail in names of files and tables, such as `LoD2_32_560.gml` and `lod22_3d`.

use std::cmp::Reverse;
use std::collections::HashMap;

/// What a name tells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameLevel {
    /// The name in lower case without the level, which names of the same objects have in common.
    pub stem: String,
    /// Whether there may be bodies, and the level times 10. Finer ones are greater.
    pub rank: (bool, u32),
}

impl NameLevel {
    /// Of `lod`, one or two digits, and perhaps `2d` or `3d`; `None` if a name has no such word.
    pub fn of(name: &str) -> Option<Self> {
        let lower = name.to_lowercase();
        let (before, behind) = lower.split_once("lod")?;
        if before.ends_with(char::is_alphanumeric) {
            return None;
        }
        let digit = |text: &str| text.chars().next().and_then(|c| c.to_digit(10));
        let whole = digit(behind)?;
        let rest = behind.get(1..)?;
        let rest_of_tenth = rest.strip_prefix('.').unwrap_or(rest);
        let (tenths, rest) = match digit(rest_of_tenth) {
            Some(tenths) => (tenths, rest_of_tenth.get(1..)?),
            None => (0, rest),
        };
        let mark = rest.strip_prefix(['_', '-']).unwrap_or(rest);
        let (may_be_bodies, rest) = match (mark.strip_prefix("2d"), mark.strip_prefix("3d")) {
            (Some(rest), _) => (false, rest),
            (None, Some(rest)) => (true, rest),
            (None, None) => (true, rest),
        };
        Some(Self { stem: format!("{before}{rest}"), rank: (may_be_bodies, 10 * whole + tenths) })
    }
}

/// Puts the finest first among names that differ only in a level, at the place of the first of them. Of objects that several files have, the
/// first counts.
pub fn finest_first(names: &mut Vec<String>) {
    let mut first_places: HashMap<String, usize> = HashMap::new();
    let mut placed = Vec::with_capacity(names.len());
    for (place, name) in std::mem::take(names).into_iter().enumerate() {
        let (place, rank) = match NameLevel::of(&name) {
            Some(NameLevel { stem, rank }) => (*first_places.entry(stem).or_insert(place), rank),
            None => (place, (false, 0)),
        };
        placed.push((place, Reverse(rank), name));
    }
    placed.sort();
    names.extend(placed.into_iter().map(|(.., name)| name));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_levels() {
        let level = |name: &str| NameLevel::of(name).map(|level| (level.stem, level.rank));
        for (name, stem, rank) in [
            ("lod12_2d", "", (false, 12)),
            ("LoD22_3d", "", (true, 22)),
            ("buildings_lod2.2", "buildings_", (true, 22)),
            ("lod2_2d", "", (false, 20)),
            ("lod1_buildings", "_buildings", (true, 10)),
            ("9-284-556-LoD12-3D.obj", "9-284-556-.obj", (true, 12)),
            ("LoD2_32_560_5935_1_HH.xml", "_32_560_5935_1_hh.xml", (true, 20)),
        ] {
            assert_eq!(level(name), Some((stem.to_owned(), rank)), "{name}");
        }
        for name in ["pand", "lod", "lodge1", "explod2", "lodé"] {
            assert_eq!(level(name), None, "{name}");
        }
    }

    #[test]
    fn the_finest_of_equal_names_is_first() {
        let mut names = ["LoD1_32_560.xml", "LoD2_32_560.xml", "a.gml", "t-LoD12-3D.obj", "t-LoD22-3D.obj", "z.obj"]
            .map(str::to_owned)
            .to_vec();
        finest_first(&mut names);
        assert_eq!(names, ["LoD2_32_560.xml", "LoD1_32_560.xml", "a.gml", "t-LoD22-3D.obj", "t-LoD12-3D.obj", "z.obj"]);
    }
}
