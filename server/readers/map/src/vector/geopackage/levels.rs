//! Tables of the same objects in several levels of detail, such as `lod12_3d` and `lod22_3d` of 3DBAG.

use super::tables::{FeatureTable, FoundTables};
use crate::vector::layer::Layer;
use insula_source::object::FeatureKind;
use insula_source::problems::COARSER_TABLE;

/// Columns that identify an object in all tables, in lower case.
const SHARED_IDS: [&str; 6] = ["identificatie", "gml_id", "building_id", "bldg_id", "globalid", "uuid"];

/// What the name of a table tells.
#[derive(Debug, Clone, PartialEq, Eq)]
struct TableLevel {
    /// The name without the level, which tables of the same objects have in common.
    stem: String,
    /// Whether it may have bodies, and the level times 10.
    rank: (bool, u32),
}

/// Leaves out tables of which others have the same objects in more detail: those of coarser levels, and outlines of buildings whose bodies
/// are in another table.
pub(super) fn leave_out_coarser(found: &mut FoundTables) {
    let levels: Vec<Option<TableLevel>> = found.features.iter().map(|table| level_of(&table.name)).collect();
    let best = |stem: &str| levels.iter().flatten().filter(|level| level.stem == stem).map(|level| level.rank).max();
    let is_best = |level: &TableLevel| best(&level.stem) == Some(level.rank);
    let has_bodies = |level: &Option<TableLevel>| level.as_ref().is_some_and(|level| level.rank.0 && is_best(level));
    let of_bodies: Vec<&FeatureTable> =
        found.features.iter().zip(&levels).filter(|(_, level)| has_bodies(level)).map(|(table, _)| table).collect();
    let is_kept: Vec<bool> = found
        .features
        .iter()
        .zip(&levels)
        .map(|(table, level)| match level {
            Some(level) => is_best(level),
            None => !of_bodies.iter().any(|bodies| is_outline_of(table, bodies)),
        })
        .collect();
    let mut is_kept = is_kept.into_iter();
    let left_out = &mut found.left_out;
    found.features.retain(|table| {
        let is_kept = is_kept.next().unwrap_or(true);
        if !is_kept {
            left_out.push((table.name.clone(), COARSER_TABLE));
        }
        is_kept
    });
}

/// Whether a table has the buildings whose bodies another one has.
fn is_outline_of(table: &FeatureTable, bodies: &FeatureTable) -> bool {
    let has = |table: &FeatureTable, id: &str| table.columns.iter().any(|column| column.name.eq_ignore_ascii_case(id));
    let is_shared = SHARED_IDS.iter().any(|id| has(table, id) && has(bodies, id));
    is_shared && Layer::new(&table.name, std::iter::empty()).kind == Some(FeatureKind::Building)
}

/// The level in a name: `lod`, one or two digits, and perhaps `2d` or `3d`.
fn level_of(name: &str) -> Option<TableLevel> {
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
    let mark = rest.strip_prefix('_').unwrap_or(rest);
    let (may_be_bodies, rest) = match (mark.strip_prefix("2d"), mark.strip_prefix("3d")) {
        (Some(rest), _) => (false, rest),
        (None, Some(rest)) => (true, rest),
        (None, None) => (true, rest),
    };
    Some(TableLevel { stem: format!("{before}{rest}"), rank: (may_be_bodies, 10 * whole + tenths) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_levels() {
        let level = |name: &str| level_of(name).map(|level| (level.stem, level.rank));
        for (name, stem, rank) in [
            ("lod12_2d", "", (false, 12)),
            ("LoD22_3d", "", (true, 22)),
            ("buildings_lod2.2", "buildings_", (true, 22)),
            ("lod2_2d", "", (false, 20)),
            ("lod1_buildings", "_buildings", (true, 10)),
        ] {
            assert_eq!(level(name), Some((stem.to_owned(), rank)), "{name}");
        }
        for name in ["pand", "lod", "lodge1", "explod2", "lodé"] {
            assert_eq!(level(name), None, "{name}");
        }
    }
}
