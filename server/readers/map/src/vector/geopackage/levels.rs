//! Tables of the same objects in several levels of detail, such as `lod12_3d` and `lod22_3d` of 3DBAG.

use super::tables::{FeatureTable, FoundTables};
use crate::vector::layer::Layer;
use insula_source::name_level::NameLevel;
use insula_source::object::FeatureKind;
use insula_source::problems::COARSER_TABLE;

/// Columns that identify an object in all tables, in lower case.
const SHARED_IDS: [&str; 6] = ["identificatie", "gml_id", "building_id", "bldg_id", "globalid", "uuid"];

/// Leaves out tables of which others have the same objects in more detail: those of coarser levels, and outlines of buildings whose bodies
/// are in another table.
pub(super) fn leave_out_coarser(found: &mut FoundTables) {
    let levels: Vec<Option<NameLevel>> = found.features.iter().map(|table| NameLevel::of(&table.name)).collect();
    let best = |stem: &str| levels.iter().flatten().filter(|level| level.stem == stem).map(|level| level.rank).max();
    let is_best = |level: &NameLevel| best(&level.stem) == Some(level.rank);
    let has_bodies = |level: &Option<NameLevel>| level.as_ref().is_some_and(|level| level.rank.0 && is_best(level));
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
