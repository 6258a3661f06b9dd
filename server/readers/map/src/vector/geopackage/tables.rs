//! Which tables have features, their columns and coordinate systems.

use insula_source::problems::NO_TABLE;
use rusqlite::{Connection, OptionalExtension, Row};

/// Names of columns that only number the rows.
const ROW_NUMBERS: [&str; 2] = ["fid", "ogc_fid"];
/// Further tables are left out.
const MAX_TABLES: u32 = 1000;

pub(super) struct FeatureTable {
    pub(super) name: String,
    pub(super) title: Option<String>,
    pub(super) description: Option<String>,
    /// `EPSG:n` or WKT; `None` if the table names no known system.
    pub(super) crs: Option<String>,
    geometry: String,
    /// The column that numbers the rows; the hidden one of SQLite if `None`.
    key: Option<String>,
    /// All columns but the geometry and the mere number of the row.
    pub(super) columns: Vec<Column>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: ColumnType,
}

/// What the declared type of a column adds to the type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColumnType {
    Bool,
    Date,
    Other,
}

#[derive(Default)]
pub(super) struct FoundTables {
    pub(super) features: Vec<FeatureTable>,
    /// Names and reasons.
    pub(super) left_out: Vec<(String, &'static str)>,
}

impl FeatureTable {
    /// Selects the row's number, the geometry, then all columns.
    pub(super) fn query(&self) -> String {
        let key = self.key.as_deref().map_or_else(|| "NULL".to_owned(), quote);
        let columns: String = self.columns.iter().map(|column| format!(", {}", quote(&column.name))).collect();
        format!("SELECT {key}, {}{columns} FROM main.{}", quote(&self.geometry), quote(&self.name))
    }
}

/// A name as SQL quotes it.
fn quote(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

pub(super) fn find(connection: &Connection) -> rusqlite::Result<FoundTables> {
    let mut found = FoundTables::default();
    if !is_table(connection, "gpkg_geometry_columns")? || !is_table(connection, "gpkg_contents")? {
        return Ok(found);
    }
    let sql = "SELECT g.table_name, g.column_name, g.srs_id, c.identifier, c.description
        FROM gpkg_geometry_columns g LEFT JOIN gpkg_contents c ON lower(c.table_name) = lower(g.table_name) LIMIT ?1";
    let listed: rusqlite::Result<Vec<_>> = connection.prepare(sql)?.query_map([MAX_TABLES], listed_table)?.collect();
    let has_systems = is_table(connection, "gpkg_spatial_ref_sys")?;
    for ListedTable { name, geometry, srs_id, title, description } in listed? {
        if !is_table(connection, &name)? {
            found.left_out.push((name, NO_TABLE));
            continue;
        }
        if found.features.iter().any(|known| known.name.eq_ignore_ascii_case(&name)) {
            found.left_out.push((name, "table listed again, read once"));
            continue;
        }
        let (columns, key) = columns(connection, &name, &geometry)?;
        if !columns.iter().any(|column| column.name.eq_ignore_ascii_case(&geometry)) {
            found.left_out.push((name, "table without its geometry column"));
            continue;
        }
        let is_kept = |column: &Column| {
            let is_row_number = key.as_deref() == Some(&column.name) && ROW_NUMBERS.contains(&column.name.as_str());
            !is_row_number && !column.name.eq_ignore_ascii_case(&geometry)
        };
        let columns = columns.into_iter().filter(is_kept).collect();
        let crs = if has_systems { crs(connection, srs_id)? } else { None };
        let title = title.filter(|title| !title.trim().is_empty() && *title != name);
        let description = description.filter(|text| !text.trim().is_empty());
        found.features.push(FeatureTable { name, title, description, crs, geometry, key, columns });
    }
    let sql = "SELECT table_name FROM gpkg_contents WHERE data_type <> 'features' LIMIT ?1";
    let others: rusqlite::Result<Vec<String>> =
        connection.prepare(sql)?.query_map([MAX_TABLES], |row| row.get(0))?.collect();
    found.left_out.extend(others?.into_iter().map(|name| (name, "table without features")));
    Ok(found)
}

/// A row of the list of feature tables.
struct ListedTable {
    name: String,
    geometry: String,
    srs_id: i64,
    title: Option<String>,
    description: Option<String>,
}

fn listed_table(row: &Row<'_>) -> rusqlite::Result<ListedTable> {
    Ok(ListedTable {
        name: row.get(0)?,
        geometry: row.get(1)?,
        srs_id: row.get(2)?,
        title: row.get(3)?,
        description: row.get(4)?,
    })
}

/// Whether there is an ordinary table of this name.
fn is_table(connection: &Connection, name: &str) -> rusqlite::Result<bool> {
    let sql = "SELECT type FROM pragma_table_list WHERE schema = 'main' AND lower(name) = lower(?1)";
    let kind: Option<String> = connection.query_row(sql, [name], |row| row.get(0)).optional()?;
    Ok(kind.as_deref() == Some("table"))
}

/// The columns of a table that are neither hidden nor computed, and the name of the one that numbers its rows.
fn columns(connection: &Connection, table: &str, geometry: &str) -> rusqlite::Result<(Vec<Column>, Option<String>)> {
    let mut statement = connection.prepare("SELECT name, type, pk FROM pragma_table_info(?1)")?;
    let mut rows = statement.query([table])?;
    let (mut columns, mut key) = (Vec::new(), None);
    while let Some(row) = rows.next()? {
        let (name, declared, pk): (String, String, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
        if pk == 1 && !name.eq_ignore_ascii_case(geometry) {
            key = Some(name.clone());
        }
        let declared = declared.to_ascii_uppercase();
        let kind = match declared.as_str() {
            "BOOLEAN" => ColumnType::Bool,
            _ if declared.starts_with("DATE") || declared.starts_with("TIMESTAMP") => ColumnType::Date,
            _ => ColumnType::Other,
        };
        columns.push(Column { name, kind });
    }
    Ok((columns, key))
}

/// Name of the coordinate system with a number: `EPSG:n`, else its WKT; `None` if it is undefined.
fn crs(connection: &Connection, srs_id: i64) -> rusqlite::Result<Option<String>> {
    if srs_id == 0 || srs_id == -1 {
        return Ok(None);
    }
    let sql = "SELECT organization, organization_coordsys_id, definition FROM gpkg_spatial_ref_sys WHERE srs_id = ?1";
    let row = |row: &Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?));
    let found: Option<(Option<String>, Option<i64>, Option<String>)> =
        connection.query_row(sql, [srs_id], row).optional()?;
    let Some((organisation, code, definition)) = found else {
        // The usual numbers are those of EPSG.
        return Ok((srs_id > 0).then(|| format!("EPSG:{srs_id}")));
    };
    let organisation = organisation.unwrap_or_default();
    if let Some(code) = code.filter(|code| *code > 0)
        && organisation.eq_ignore_ascii_case("EPSG")
    {
        return Ok(Some(format!("EPSG:{code}")));
    }
    let is_given = |text: &String| !text.trim().is_empty() && !text.trim().eq_ignore_ascii_case("undefined");
    let definition = match definition.filter(is_given) {
        None => newer_definition(connection, srs_id)?.filter(is_given),
        definition => definition,
    };
    let named = code.map(|code| format!("{}:{code}", organisation.to_ascii_uppercase()));
    Ok(definition.or_else(|| named.filter(|_| !organisation.is_empty() && !organisation.eq_ignore_ascii_case("NONE"))))
}

/// The definition as WKT of 2019, which GDAL writes where the older form cannot tell the system; `None` if there is none.
fn newer_definition(connection: &Connection, srs_id: i64) -> rusqlite::Result<Option<String>> {
    let (columns, _) = columns(connection, "gpkg_spatial_ref_sys", "")?;
    if !columns.iter().any(|column| column.name == "definition_12_063") {
        return Ok(None);
    }
    let sql = "SELECT definition_12_063 FROM gpkg_spatial_ref_sys WHERE srs_id = ?1";
    Ok(connection.query_row(sql, [srs_id], |row| row.get(0)).optional()?.flatten())
}
