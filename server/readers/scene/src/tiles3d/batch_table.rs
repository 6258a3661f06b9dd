//! Batch tables: the attributes of a tile's features.

use super::batch_column::Column;
use super::hierarchy::Hierarchy;
use insula_source::attributes::Attributes;
use serde_json::{Map, Value};

/// The extension by which features have classes and parents.
const HIERARCHY: &str = "3DTILES_batch_table_hierarchy";

/// The attributes of features, column by column.
#[derive(Debug, Default)]
pub(super) struct BatchTable<'a> {
    columns: Vec<(String, Column<'a>)>,
    hierarchy: Option<Hierarchy<'a>>,
    /// Columns and extensions that cannot be read, with the reason.
    pub(super) faults: Vec<(String, &'static str)>,
}

impl<'a> BatchTable<'a> {
    /// The table of a tile with `length` features.
    pub(super) fn new(json: &Map<String, Value>, binary: &'a [u8], length: u32) -> Self {
        let mut table = Self::default();
        for (name, value) in
            json.iter().filter(|(name, _)| !matches!(name.as_str(), "extensions" | "extras" | "HIERARCHY"))
        {
            match Column::new(value, binary, length) {
                Ok(column) => table.columns.push((name.clone(), column)),
                Err(reason) => table.faults.push((name.clone(), reason)),
            }
        }
        let extension = json.get("extensions").and_then(|extensions| extensions.get(HIERARCHY));
        if let Some(hierarchy) = extension.or_else(|| json.get("HIERARCHY")) {
            match Hierarchy::new(hierarchy, binary) {
                Ok(hierarchy) => table.hierarchy = Some(hierarchy),
                Err(reason) => table.faults.push((HIERARCHY.to_owned(), reason)),
            }
        }
        table
    }

    /// Number of features for which the table has a value.
    pub(super) fn rows(&self) -> usize {
        self.columns.iter().map(|(_, column)| column.rows()).max().unwrap_or(0)
    }

    /// The attributes of a feature; empty if the table has none. Then its class, if it has one.
    pub(super) fn attributes(&self, feature: u32) -> (Attributes, Option<&str>) {
        let mut attributes = Attributes::default();
        for (name, column) in &self.columns {
            column.add_to(name, feature as usize, &mut attributes);
        }
        let hierarchy = self.hierarchy.as_ref();
        let class = hierarchy.and_then(|hierarchy| hierarchy.add_to(feature, &mut attributes));
        (attributes, class)
    }
}
