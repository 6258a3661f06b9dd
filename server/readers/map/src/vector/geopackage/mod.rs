//! GeoPackage: an SQLite database with tables of features, whose geometries are WKB behind a header.
//!
//! The file is hostile: it is opened read-only and unchangeable, no view and no virtual table is read, functions of the
//! schema are not trusted, lengths are limited, and a query that does not end is stopped.

mod blob;
mod levels;
mod tables;

use super::feature::FeatureWriter;
use super::layer::Layer;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{Description, ObjectSink};
use insula_source::problems::UNSAVED;
use insula_source::text::expected_in_utf8;
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, Row};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tables::{Column, ColumnType, FeatureTable};

/// Instructions of SQLite between two checks of the time that a row takes.
const CHECK_INSTRUCTIONS: i32 = 1 << 16;
/// A single row takes at most this many checks.
const MAX_CHECKS_OF_ROW: u64 = 1 << 12;
/// A row takes at least this many bytes of the file; more rows mean that the tree of the table goes in circles.
const MIN_ROW_BYTES: u64 = 4;
/// Texts and geometries have at most so many bytes for each byte of the file: a text that is the default of its column is stored once.
/// More mean that rows or tables share pages.
const MAX_CONTENT_RATIO: u64 = 16;
/// Longest text or geometry.
const MAX_VALUE_BYTES: u64 = 1 << 30;
/// Rows between two progress reports.
const TICK_ROWS: u64 = 256;

/// Reads a source. Fails if it is no GeoPackage, has no features, is damaged, or is in a system that cannot be placed.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let file = input.on_disk()?;
    let file_bytes = std::fs::metadata(&file.path).map_err(|cause| InputError::io(input.label, cause))?.len();
    let checks = Arc::new(AtomicU64::new(0));
    let open = open(&file.path, input.max_bytes, &checks);
    let connection = open.map_err(|cause| damaged(input, "database", &cause))?;
    let mut writer = FeatureWriter::new(input, sink);
    let mut found = tables::find(&connection).map_err(|cause| damaged(input, "list of tables", &cause))?;
    levels::leave_out_coarser(&mut found);
    let changes = format!("{}-wal", input.name);
    if let Some(bytes) = input.files.len(&changes).ok().filter(|bytes| *bytes > 0) {
        let what_to_do = "close the program that has the database open, or let it run PRAGMA wal_checkpoint(TRUNCATE)";
        writer.sink.problem(UNSAVED, format!("{bytes} bytes in {changes}; {what_to_do}"));
    }
    for (name, reason) in &found.left_out {
        writer.sink.problem(reason, name.clone());
    }
    if found.features.is_empty() {
        return Err(InputError::unsupported(input.label, "a database without a table of features"));
    }
    let reader = TableReader {
        input,
        connection: &connection,
        checks: &checks,
        max_rows: file_bytes / MIN_ROW_BYTES,
        file_bytes,
        has_many_tables: found.features.len() > 1,
    };
    let mut done = Done::default();
    for table in &found.features {
        reader.read(table, &mut writer, &mut done)?;
    }
    writer.sink.tick(file_bytes);
    writer.finish()
}

/// Opens a database that nothing changes, in a way that lets it do nothing.
fn open(path: &Path, max_bytes: u64, checks: &Arc<AtomicU64>) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let mut connection = Connection::open_with_flags(uri_of(path), flags)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false)?;
    let max_value = i32::try_from(max_bytes.min(MAX_VALUE_BYTES)).unwrap_or(i32::MAX);
    connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, max_value)?;
    connection.set_limit(Limit::SQLITE_LIMIT_ATTACHED, 0)?;
    connection.set_limit(Limit::SQLITE_LIMIT_WORKER_THREADS, 0)?;
    connection.set_limit(Limit::SQLITE_LIMIT_VDBE_OP, 100_000)?;
    let checks = Arc::clone(checks);
    let is_stuck = move || checks.fetch_add(1, Ordering::Relaxed) > MAX_CHECKS_OF_ROW;
    connection.progress_handler(CHECK_INSTRUCTIONS, Some(is_stuck))?;
    Ok(connection)
}

/// A `file:` address of a path, by which SQLite is told that nothing changes the file.
fn uri_of(path: &Path) -> String {
    let mut uri = String::from("file:");
    let text = path.to_string_lossy().replace('\\', "/");
    if text.as_bytes().get(1) == Some(&b':') {
        // A drive letter of Windows.
        uri.push('/');
    }
    for byte in text.bytes() {
        match byte {
            b'/' | b':' | b'-' | b'_' | b'.' | b'~' => uri.push(char::from(byte)),
            _ if byte.is_ascii_alphanumeric() => uri.push(char::from(byte)),
            _ => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri + "?immutable=1&mode=ro"
}

fn damaged(input: &Input<'_>, place: &str, cause: &rusqlite::Error) -> InputError {
    InputError::damaged(input.label, place, cause.to_string())
}

/// What was read of all tables.
#[derive(Default)]
struct Done {
    rows: u64,
    /// Of texts and geometries.
    content_bytes: u64,
    /// For progress.
    bytes: u64,
}

struct TableReader<'a> {
    input: &'a Input<'a>,
    connection: &'a Connection,
    checks: &'a AtomicU64,
    max_rows: u64,
    file_bytes: u64,
    /// Numbers of rows are only unique within a table.
    has_many_tables: bool,
}

impl TableReader<'_> {
    fn read(&self, table: &FeatureTable, writer: &mut FeatureWriter<'_>, done: &mut Done) -> Result<(), InputError> {
        let place = format!("table {}", table.name);
        let fault = |cause: rusqlite::Error| damaged(self.input, &place, &cause);
        for text in [&table.title, &table.description].into_iter().flatten() {
            writer.sink.describe(Description::Title, text);
        }
        writer.begin(
            Layer::new(&table.name, table.columns.iter().map(|column| column.name.as_str())),
            table.crs.clone(),
        )?;
        self.checks.store(0, Ordering::Relaxed);
        let mut statement = self.connection.prepare(&table.query()).map_err(fault)?;
        let mut rows = statement.query([]).map_err(fault)?;
        while let Some(row) = rows.next().map_err(fault)? {
            self.checks.store(0, Ordering::Relaxed);
            done.rows += 1;
            if done.rows > self.max_rows || done.content_bytes > self.file_bytes.saturating_mul(MAX_CONTENT_RATIO) {
                return Err(InputError::damaged(self.input.label, place, "it has more rows than fit in the file"));
            }
            self.read_row(row, table, writer, done)?;
            if done.rows.is_multiple_of(TICK_ROWS) {
                writer.sink.tick(done.bytes.min(self.file_bytes));
            }
        }
        Ok(())
    }

    fn read_row(
        &self,
        row: &Row<'_>,
        table: &FeatureTable,
        writer: &mut FeatureWriter<'_>,
        done: &mut Done,
    ) -> Result<(), InputError> {
        let number = match row.get_ref(0) {
            Ok(ValueRef::Integer(number)) if self.has_many_tables => Some(format!("{}.{number}", table.name)),
            Ok(ValueRef::Integer(number)) => Some(number.to_string()),
            _ => None,
        };
        let bytes = match row.get_ref(1) {
            Ok(ValueRef::Blob(bytes)) => Some(bytes),
            _ => None,
        };
        let length = bytes.map_or(0, <[u8]>::len) as u64;
        done.bytes += length;
        done.content_bytes += length;
        if let Some(bounds) = bytes.and_then(blob::bounds)
            && writer.is_unwanted(bounds)
        {
            writer.pass_over();
            return Ok(());
        }
        let mut attributes = Attributes::default();
        for (index, column) in table.columns.iter().enumerate() {
            let Ok(value) = row.get_ref(index + 2) else { continue };
            done.bytes += 8;
            if let ValueRef::Text(text) = value {
                done.content_bytes += text.len() as u64;
            }
            if let Some(value) = value_of(value, column, writer.sink) {
                attributes.push(&column.name, value);
            }
        }
        writer.add(number, attributes, bytes.ok_or("no geometry").and_then(blob::geometry))
    }
}

/// The value of a column; `None` for null, an empty text and bytes.
fn value_of(value: ValueRef<'_>, column: &Column, sink: &mut dyn ObjectSink) -> Option<AttributeValue> {
    match value {
        ValueRef::Integer(number) if column.kind == ColumnType::Bool => Some(AttributeValue::Bool(number != 0)),
        ValueRef::Integer(number) => Some(AttributeValue::Integer(number)),
        ValueRef::Real(number) => Some(AttributeValue::Float(number)),
        ValueRef::Text(text) => {
            let text = expected_in_utf8(text, sink);
            let date = if column.kind == ColumnType::Date { AttributeValue::date(&text) } else { None };
            date.or_else(|| (!text.is_empty()).then(|| AttributeValue::Text(text.into_owned())))
        }
        ValueRef::Null | ValueRef::Blob(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_become_addresses() {
        assert_eq!(uri_of(Path::new("/a b/c?#%.gpkg")), "file:/a%20b/c%3F%23%25.gpkg?immutable=1&mode=ro");
        assert_eq!(uri_of(Path::new("C:\\d\\e.gpkg")), "file:/C:/d/e.gpkg?immutable=1&mode=ro");
    }
}
