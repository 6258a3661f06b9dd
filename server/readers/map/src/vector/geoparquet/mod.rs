//! GeoParquet, such as Overture's buildings: columns in row groups, a geometry column in WKB, as nested lists or as texts.
//!
//! Row groups outside of the wanted area are not read, if a column has the boxes of the features. Decoders of the parquet
//! crate may panic on damaged pages; that ends the reading with an error like any other damage.

mod columns;
mod metadata;
mod native;
mod parquet_file;

use super::feature::{FeatureWriter, MAX_DECISIVE};
use super::geometry::Geometry;
use super::layer::Layer;
use super::{csv, wkb};
use arrow_array::{Array, BinaryArray, RecordBatch, StringArray};
use columns::ColumnValues;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::error::InputError;
use insula_source::input::{Input, Share};
use insula_source::object::{Description, ObjectSink};
use insula_source::problems::NO_COLUMN;
use metadata::{GeoColumn, GeometryEncoding};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder,
};
use parquet::file::metadata::{ParquetMetaData, RowGroupMetaData};
use parquet::file::reader::Length;
use parquet_file::ParquetFile;
use std::collections::BTreeSet;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Rows that are decoded at once.
const BATCH_ROWS: usize = 1024;
/// Most rows of a small file, and of a larger one for each of its bytes: equal rows take next to none.
const MIN_ROWS: u64 = 1 << 20;
const ROWS_OF_BYTE: u64 = 8;
/// Sources of data that are named.
const MAX_ATTRIBUTIONS: usize = 32;

/// Reads a source. Fails if it is no parquet file, has no geometry column, is damaged, or is in a system that cannot be
/// placed.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let file = ParquetFile(input.random()?);
    let file_bytes = file.len();
    // The types are those of the columns, not of the copy of an Arrow schema that some writers add.
    let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    let metadata = guarded(input, "footer", || {
        ArrowReaderMetadata::load(&file, options).map_err(|cause| damaged(input, "footer", &cause.to_string()))
    })?;
    let geo = metadata::find(metadata.metadata(), metadata.schema())
        .map_err(|what| InputError::unsupported(input.label, what))?;
    check_rows(input, metadata.metadata(), file_bytes)?;
    check_sizes(input, metadata.metadata())?;
    let mut writer = FeatureWriter::new(input, sink);
    let names = metadata.schema().fields().iter().map(|field| field.name().as_str());
    writer.begin(Layer::of_file(input.name, names), geo.crs.clone())?;
    for name in columns::unread(metadata.schema(), &geo).into_iter().filter(|_| input.share.number == 0) {
        writer.sink.problem(NO_COLUMN, name);
    }
    if let Some(attribution) = metadata::text_of(metadata.metadata(), "attribution") {
        writer.sink.describe(Description::Attribution, attribution);
    }
    let (own, decisive) = share_of(input, metadata.metadata());
    let groups: Vec<usize> = match writer.wanted_deg() {
        Some(wanted) => metadata::groups_within(metadata.metadata(), &geo.covering, wanted),
        None => (0..metadata.metadata().num_row_groups()).collect(),
    };
    let mut source = Source { input, file, file_bytes, metadata, geo, attributions: BTreeSet::new(), bytes_done: 0 };
    if own.start > 0 && !own.is_empty() {
        source.note_groups(decisive, &mut writer)?;
    }
    for group in groups.into_iter().filter(|group| own.contains(group)) {
        source.read_group(group, &mut writer)?;
    }
    for attribution in &source.attributions {
        writer.sink.describe(Description::Attribution, attribution);
    }
    writer.sink.tick(file_bytes);
    writer.finish()
}

/// The row groups of the input's share, and those that decide for all shares: the first ones, which are of the first share. Where only an
/// area is wanted, that share is the whole file.
fn share_of(input: &Input<'_>, metadata: &ParquetMetaData) -> (Range<usize>, Range<usize>) {
    let groups = metadata.num_row_groups();
    let share = if input.bbox_deg.is_none() { input.share } else { Share { count: 1, ..input.share } };
    if share.number >= share.count {
        return (0..0, 0..0);
    }
    let mut rows = 0;
    let is_decisive = |group: &&RowGroupMetaData| {
        let is_decisive = rows < MAX_DECISIVE;
        rows += u64::try_from(group.num_rows()).unwrap_or(0);
        is_decisive
    };
    let decisive = metadata.row_groups().iter().take_while(is_decisive).count();
    let bound = |group: u64| if group == 0 { 0 } else { (group as usize).max(decisive) };
    let own = share.of(groups as u64);
    (bound(own.start)..bound(own.end), 0..decisive)
}

fn damaged(input: &Input<'_>, place: &str, what: &str) -> InputError {
    let first = what.lines().next().unwrap_or("not readable");
    InputError::damaged(input.label, place, first)
}

/// Runs a decoder of the parquet crate; its panic is damage of the file.
fn guarded<T>(input: &Input<'_>, place: &str, decode: impl FnOnce() -> Result<T, InputError>) -> Result<T, InputError> {
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err(damaged(input, place, "its decoder failed")))
}

/// Fails if a file has far more rows, or values of a column, than bytes.
fn check_rows(input: &Input<'_>, metadata: &ParquetMetaData, file_bytes: u64) -> Result<(), InputError> {
    let limit = MIN_ROWS.max(file_bytes.saturating_mul(ROWS_OF_BYTE));
    let most = |group: &RowGroupMetaData| {
        let values = group.columns().iter().map(|column| column.num_values());
        u64::try_from(values.chain([group.num_rows()]).max().unwrap_or(0)).unwrap_or(0)
    };
    let rows = metadata.row_groups().iter().map(most).fold(0, u64::saturating_add);
    if rows > limit {
        let what = format!("its number of rows or values, {rows} in {file_bytes} bytes,");
        return Err(InputError::TooLarge { path: input.label.to_owned(), what, limit });
    }
    Ok(())
}

/// Fails if a column of a row group is larger than allowed, because pages of any size within it would be unpacked, or if it
/// has a negative place, at which the parquet crate panics.
fn check_sizes(input: &Input<'_>, metadata: &ParquetMetaData) -> Result<(), InputError> {
    for (index, group) in metadata.row_groups().iter().enumerate() {
        for column in group.columns() {
            let places = [column.data_page_offset(), column.compressed_size()].into_iter();
            if places.chain(column.dictionary_page_offset()).any(|place| place < 0) {
                return Err(damaged(input, &format!("row group {index}"), "a column has a negative place"));
            }
            let bytes = u64::try_from(column.uncompressed_size()).unwrap_or(u64::MAX);
            if bytes > input.max_bytes {
                let what = format!("column {} of row group {index}, {bytes} bytes,", column.column_path());
                return Err(InputError::TooLarge { path: input.label.to_owned(), what, limit: input.max_bytes });
            }
        }
    }
    Ok(())
}

struct Source<'a> {
    input: &'a Input<'a>,
    file: ParquetFile,
    file_bytes: u64,
    metadata: ArrowReaderMetadata,
    geo: GeoColumn,
    attributions: BTreeSet<String>,
    bytes_done: u64,
}

impl Source<'_> {
    /// Takes note of the first rows of the file.
    fn note_groups(&mut self, groups: Range<usize>, writer: &mut FeatureWriter<'_>) -> Result<(), InputError> {
        let geometry = self.metadata.schema().index_of(&self.geo.name);
        let wanted: Vec<usize> = geometry.into_iter().collect();
        for group in groups {
            let mut batches = self.batches(group, wanted.clone())?;
            while let Some(batch) = self.next_batch(group, &mut batches)? {
                let geometries = GeometryColumn::of(&batch, &self.geo);
                for row in 0..batch.num_rows() {
                    let parsed = self.geometry(&geometries, row, writer)?;
                    if !writer.note(parsed)? {
                        return Ok(());
                    }
                }
            }
        }
        Ok(())
    }

    /// The rows of a group, with these columns.
    fn batches(&self, group: usize, columns: Vec<usize>) -> Result<ParquetRecordBatchReader, InputError> {
        let (input, place) = (self.input, place_of(group));
        let mask = ProjectionMask::roots(self.metadata.parquet_schema(), columns);
        guarded(input, &place, || {
            ParquetRecordBatchReaderBuilder::new_with_metadata(self.file.clone(), self.metadata.clone())
                .with_batch_size(BATCH_ROWS)
                .with_row_groups(vec![group])
                .with_projection(mask)
                .build()
                .map_err(|cause| damaged(input, &place, &cause.to_string()))
        })
    }

    fn next_batch(
        &self,
        group: usize,
        batches: &mut ParquetRecordBatchReader,
    ) -> Result<Option<RecordBatch>, InputError> {
        let (input, place) = (self.input, place_of(group));
        guarded(input, &place, || {
            let next = batches.next().transpose();
            next.map_err(|cause| damaged(input, &place, &cause.to_string()))
        })
    }

    fn read_group(&mut self, group: usize, writer: &mut FeatureWriter<'_>) -> Result<(), InputError> {
        let (input, all) = (self.input, self.metadata.metadata().row_groups());
        let row_count = |group: &RowGroupMetaData| u64::try_from(group.num_rows()).unwrap_or(0);
        let group_rows = row_count(&all[group]);
        let group_bytes = u64::try_from(all[group].compressed_size()).unwrap_or(0);
        writer.continue_after(all[..group].iter().map(row_count).fold(0, u64::saturating_add));
        let mut batches = self.batches(group, columns::wanted(self.metadata.schema(), &self.geo))?;
        let mut rows = 0;
        while let Some(batch) = self.next_batch(group, &mut batches)? {
            rows += batch.num_rows() as u64;
            if rows > group_rows {
                return Err(damaged(input, &place_of(group), "it has more rows than it announces"));
            }
            self.read_batch(&batch, writer)?;
            let share = (group_bytes as f64 * rows as f64 / group_rows.max(1) as f64) as u64;
            writer.sink.tick((self.bytes_done.saturating_add(share)).min(self.file_bytes));
        }
        if rows < group_rows {
            return Err(damaged(input, &place_of(group), "it has fewer rows than it announces"));
        }
        self.bytes_done = self.bytes_done.saturating_add(group_bytes);
        Ok(())
    }

    /// The geometry of a row. Its own system, as databases write it, counts where the file tells none. Fails if positions of it cannot be
    /// placed.
    fn geometry(
        &self,
        geometries: &GeometryColumn<'_>,
        row: usize,
        writer: &mut FeatureWriter<'_>,
    ) -> Result<Result<Geometry, &'static str>, InputError> {
        let parsed = geometries.at(row);
        if let (Ok((_, srid)), None) = (&parsed, &self.geo.crs) {
            writer.set_srid(*srid)?;
        }
        Ok(parsed.map(|(geometry, _)| geometry))
    }

    fn read_batch(&mut self, batch: &RecordBatch, writer: &mut FeatureWriter<'_>) -> Result<(), InputError> {
        let schema = batch.schema();
        let columns: Vec<(&str, ColumnValues<'_>)> = schema
            .fields()
            .iter()
            .zip(batch.columns())
            .filter(|(field, _)| *field.name() != self.geo.name)
            .map(|(field, array)| (field.name().as_str(), ColumnValues::of(array)))
            .collect();
        let geometries = GeometryColumn::of(batch, &self.geo);
        for row in 0..batch.num_rows() {
            let parsed = self.geometry(&geometries, row, writer)?;
            if let Ok(geometry) = &parsed
                && writer.wanted_deg().is_some()
                && geometry.bounds().is_some_and(|bounds| writer.is_unwanted(bounds))
            {
                writer.pass_over();
                continue;
            }
            let mut attributes = Attributes::default();
            for (name, values) in &columns {
                values.push(row, name, &mut attributes, 0);
            }
            note_attributions(&mut self.attributions, &attributes);
            writer.add(None, attributes, parsed)?;
        }
        Ok(())
    }
}

/// Notes the data sets that Overture names as the sources of a feature.
fn note_attributions(noted: &mut BTreeSet<String>, attributes: &Attributes) {
    let dataset = attributes.get("sources.0.dataset").and_then(AttributeValue::as_str);
    if let Some(dataset) = dataset
        && noted.len() < MAX_ATTRIBUTIONS
        && !noted.contains(dataset)
    {
        noted.insert(dataset.to_owned());
    }
}

/// For messages.
fn place_of(group: usize) -> String {
    format!("row group {group}")
}

/// The geometries of some rows.
struct GeometryColumn<'a> {
    array: Option<&'a dyn Array>,
    binary: Option<&'a BinaryArray>,
    encoding: &'a GeometryEncoding,
}

impl<'a> GeometryColumn<'a> {
    fn of(batch: &'a RecordBatch, geo: &'a GeoColumn) -> Self {
        let array = batch.column_by_name(&geo.name).map(|array| &**array);
        let binary = array.and_then(|array| array.as_any().downcast_ref::<BinaryArray>());
        Self { array, binary, encoding: &geo.encoding }
    }

    /// The geometry of a row, and the number of its system if it tells one. Fails with the reason if it has none.
    fn at(&self, row: usize) -> Result<(Geometry, Option<u32>), &'static str> {
        let array = self.array.filter(|array| !array.is_null(row)).ok_or("no geometry")?;
        let mut geometry = Geometry::default();
        let srid = match (self.encoding, self.binary) {
            (GeometryEncoding::Wkb, Some(binary)) => wkb::parse(binary.value(row), &mut geometry)?,
            (GeometryEncoding::Text, _) => {
                let texts = array.as_any().downcast_ref::<StringArray>().ok_or("geometry of unknown type")?;
                csv::geometry_of(texts.value(row), &mut geometry)?
            }
            (GeometryEncoding::Wkb, None) => return Err("geometry of unknown type"),
            (GeometryEncoding::Nested(kind), _) => {
                native::read(array, row, *kind, &mut geometry)?;
                None
            }
        };
        Ok((geometry, srid))
    }
}
