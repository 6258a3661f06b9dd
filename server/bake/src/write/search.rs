//! Writes `search.index`: the texts by which objects are found.
//!
//! One file from the numbered objects and their records, or none if no object has a text. A text is the object's
//! identifier, a name, an address, or the value of an attribute that `--search` names. Texts and words are sorted in scratch files.

use super::files::remove_file;
use super::objects::NumberedRecords;
use crate::error::BakeError;
use crate::scene::object_records::SourceRecord;
use insula_archive::city::MAX_SEARCH_BYTES;
use insula_objects::attribute_names::{TextPart, TextUse};
use insula_objects::schema::Schema;
use insula_objects::search::{
    SearchEntry, SearchError, SearchTextWriter, SearchWordWriter, SearchWriteError, WordRun, write_index,
};
use insula_scratch::error::ScratchError;
use insula_scratch::record_list::RecordScratch;
use insula_scratch::record_sorter::{RecordSorter, SortedRecords};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom};
use std::path::Path;

/// The attributes of a city that have texts.
struct TextAttributes<'a>(HashMap<&'a str, TextUse>);

impl<'a> TextAttributes<'a> {
    /// `searchable` attributes of the schema are texts whatever their names.
    fn new(schema: &'a Schema) -> Self {
        let use_of = |name: &'a str| {
            let mut found = TextUse::of_name(name);
            found.is_text |= schema.searchable.iter().any(|searchable| searchable == name);
            (found.is_text || found.part.is_some()).then_some((name, found))
        };
        Self(schema.attributes.iter().filter_map(|attribute| use_of(&attribute.name)).collect())
    }

    /// The texts of an object, its identifier first. Some may be empty or equal.
    fn texts(&self, record: &SourceRecord) -> Vec<String> {
        let used = || record.attributes.iter().filter_map(|(name, value)| Some((self.0.get(name.as_str())?, value)));
        let has_street =
            |group: &str| used().any(|(other, _)| other.part == Some(TextPart::Street) && other.group == group);
        let mut texts = vec![record.identifier.clone()];
        for (found, value) in used() {
            if found.is_text {
                texts.push(value.to_string());
            }
            match found.part {
                Some(TextPart::Street) => {
                    let is_number =
                        |other: &TextUse| other.part == Some(TextPart::Number) && other.group == found.group;
                    let numbers = used().filter(|(other, _)| is_number(other)).map(|(_, number)| number.to_string());
                    texts.push([value.to_string()].into_iter().chain(numbers).collect::<Vec<_>>().join(" "));
                }
                Some(TextPart::Locality) if !has_street(&found.group) => texts.push(value.to_string()),
                Some(TextPart::Number | TextPart::Locality) | None => {}
            }
        }
        texts
    }
}

/// Writes the index and returns its length; `None`, and no file, if there is no text or the index would exceed its limits. Fails if a
/// record cannot be read or a file cannot be written.
pub(super) fn write(objects: &NumberedRecords<'_>, schema: &Schema, path: &Path) -> Result<Option<u64>, BakeError> {
    // A city is complete without a search.
    match write_sections(objects, schema, path) {
        Err(UnwrittenSearch::Index(error)) => {
            tracing::warn!("the city has no search: {error}");
            remove_file(path)?;
            Ok(None)
        }
        Err(UnwrittenSearch::Bake(error)) => Err(error),
        Ok(length) => Ok(length),
    }
}

/// The checksum of an index, its last bytes. Fails if it cannot be read.
pub(super) fn checksum(path: &Path) -> Result<u32, BakeError> {
    let read = || {
        let (mut file, mut bytes) = (File::open(path)?, [0; 4]);
        file.seek(SeekFrom::End(-4))?;
        file.read_exact(&mut bytes)?;
        io::Result::Ok(u32::from_le_bytes(bytes))
    };
    read().map_err(|cause| BakeError::io(path, "read", cause))
}

/// Why there is no index.
enum UnwrittenSearch {
    /// The texts exceed a limit of the format.
    Index(SearchError),
    Bake(BakeError),
}

impl From<ScratchError> for UnwrittenSearch {
    fn from(error: ScratchError) -> Self {
        BakeError::from(error).into()
    }
}

impl From<BakeError> for UnwrittenSearch {
    fn from(error: BakeError) -> Self {
        Self::Bake(error)
    }
}

/// Sorts the texts and then their words, each in scratch files beside `path`, and writes the index.
fn write_sections(objects: &NumberedRecords<'_>, schema: &Schema, path: &Path) -> Result<Option<u64>, UnwrittenSearch> {
    let folder = path.parent().unwrap_or_else(|| Path::new("."));
    let scratch = RecordScratch::in_folder(folder);
    let failed = |cause| BakeError::io(path, "written", cause);
    let file = || tempfile::tempfile_in(folder).map_err(failed);
    let unwritten = |error| match error {
        SearchWriteError::Io(cause) => UnwrittenSearch::Bake(failed(cause)),
        SearchWriteError::Index(error) => UnwrittenSearch::Index(error),
    };
    let mut entries = sorted_texts(objects, schema, &scratch)?;
    let mut texts = SearchTextWriter::new(file()?, file()?);
    let mut runs = RecordSorter::new(&scratch, WordRun::cmp);
    while let Some(entry) = entries.read_next()? {
        texts.add(entry).map_err(unwritten)?.into_iter().try_for_each(|run| runs.push(run))?;
    }
    let (mut texts, rest) = texts.finish().map_err(unwritten)?;
    if texts.is_empty() {
        return Ok(None);
    }
    rest.into_iter().try_for_each(|run| runs.push(run))?;
    let mut words = SearchWordWriter::new(file()?, file()?).map_err(unwritten)?;
    let mut runs = runs.finish()?;
    while let Some(run) = runs.read_next()? {
        words.add(run).map_err(unwritten)?;
    }
    let mut words = words.finish().map_err(unwritten)?;
    let mut out = BufWriter::new(File::create_new(path).map_err(failed)?);
    let length = write_index(&mut texts, &mut words, MAX_SEARCH_BYTES, &mut out).map_err(unwritten)?;
    let out = out.into_inner().map_err(|error| failed(error.into_error()))?;
    out.sync_all().map_err(failed)?;
    Ok(Some(length))
}

/// The texts of all objects, in the order of the index.
fn sorted_texts(
    objects: &NumberedRecords<'_>,
    schema: &Schema,
    scratch: &RecordScratch,
) -> Result<SortedRecords<SearchEntry>, BakeError> {
    let attributes = TextAttributes::new(schema);
    let mut reader = objects.records.reader()?;
    let mut entries = RecordSorter::new(scratch, SearchEntry::cmp);
    objects.rows.try_for_each(|number, row| {
        let Some(row) = row else { return Ok(()) };
        let texts = attributes.texts(&reader.read(row.record)?);
        let mut found = texts.iter().filter_map(|text| SearchEntry::new(text, number as u32));
        found.try_for_each(|entry| entries.push(entry)).map_err(BakeError::from)
    })?;
    entries.finish().map_err(BakeError::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::object_numbers::NumberedObject;
    use crate::scene::object_records::ObjectRecords;
    use crate::scene::triangle_store::TriangleStore;
    use insula_objects::FeatureKind;
    use insula_objects::schema::SchemaBuilder;
    use insula_objects::search::SearchIndex;
    use insula_objects::value::Value;
    use insula_test_support::folder::TestFolder;

    fn record(identifier: &str, attributes: &[(&str, &str)]) -> SourceRecord {
        let value = |text: &str| text.parse().map_or_else(|_| Value::Text(text.to_owned()), Value::Integer);
        let attributes = attributes.iter().map(|(name, text)| ((*name).to_owned(), value(text))).collect();
        SourceRecord { identifier: identifier.to_owned(), kind: FeatureKind::Building, attributes }
    }

    fn schema(record: &SourceRecord, searchable: &[&str]) -> Schema {
        let mut builder = SchemaBuilder::default();
        record.attributes.iter().for_each(|(name, value)| builder.add(name, value));
        let mut schema = builder.finish(1);
        schema.searchable = searchable.iter().map(|name| (*name).to_owned()).collect();
        schema
    }

    fn texts(attributes: &[(&str, &str)], searchable: &[&str]) -> Vec<String> {
        let record = record("id", attributes);
        TextAttributes::new(&schema(&record, searchable)).texts(&record).split_off(1)
    }

    #[test]
    fn names_and_addresses_of_many_sources_are_texts() {
        for (attributes, expected) in [
            (
                &[("name", "Oude Kerk"), ("Name", "Old Church"), ("name.1", "Kerk")][..],
                &["Oude Kerk", "Old Church", "Kerk"][..],
            ),
            (&[("gml:name", "Dom"), ("bldg:address", "Platz 1"), ("Bezeichnung", "B")], &["Dom", "Platz 1", "B"]),
            (
                &[("names.primary", "Kerk"), ("names.common.en", "Church"), ("names.rules.0.value", "x")],
                &["Kerk", "Church"],
            ),
            (&[("name:zh-Hant", "塔"), ("name:etymology", "x"), ("名称", "市役所")], &["塔", "市役所"]),
            (
                &[("detail.1.name", "A"), ("filename", "x"), ("name.uom", "x"), ("full", "x"), ("addr:full", "B")],
                &["A", "B"],
            ),
            (&[("addr:street", "Markt"), ("addr:city", "x"), ("addr:housenumber", "3a")], &["Markt 3a"]),
            (&[("huisnummer", "5"), ("straatnaam", "Delft"), ("huisletter", "b")], &["Delft 5 b"]),
            (&[("street", "Markt"), ("addr:housenumber", "3")], &["Markt"]),
            (&[("number", "3"), ("height", "12"), ("locality", "x"), ("roof", "flat")], &[]),
        ] {
            assert_eq!(texts(attributes, &[]), expected, "{attributes:?}");
        }
    }

    #[test]
    fn addresses_of_citygml_have_a_street_or_else_a_locality() {
        let german = [
            ("address.country", "Germany"),
            ("address.locality", "Bonn"),
            ("address.thoroughfare", "Am Hang"),
            ("address.thoroughfareNumber", "15"),
            ("address.1.thoroughfare", "Am Markt"),
            ("address.1.thoroughfareNumber", "2"),
        ];
        assert_eq!(texts(&german, &[]), ["Am Hang 15", "Am Markt 2"]);
        assert_eq!(texts(&[("address.country", "日本"), ("address.locality", "横須賀市")], &[]), ["横須賀市"]);
    }

    #[test]
    fn requested_attributes_are_texts_and_unknown_ones_are_not() {
        let attributes = [("parcel", "4711"), ("owner", "x"), ("number", "9")];
        assert_eq!(texts(&attributes, &["parcel", "number"]), ["4711", "9"]);
        let known = record("id", &[("owner", "x")]);
        let other = record("id", &[("name", "not in the schema")]);
        assert_eq!(TextAttributes::new(&schema(&known, &[])).texts(&other), ["id"]);
    }

    #[test]
    fn index_finds_numbers_and_is_absent_without_texts() {
        let folder = TestFolder::new("search-index");
        let path = folder.path.join("search.index");
        let write_city = |identifiers: [&str; 2]| {
            let mut records = ObjectRecords::for_triangles(&TriangleStore::Memory(Vec::new()));
            let [first, second] = identifiers.map(|identifier| records.push(record(identifier, &[])));
            let row = |record| Some(NumberedObject { record, parent: None, bounds_m: None });
            let rows = vec![row(first), None, row(second)].into();
            let objects =
                NumberedRecords { records: &records, rows: &rows, origin_m: [0.0; 3], searchable: Vec::new() };
            write(&objects, &objects.schema().unwrap(), &path).unwrap()
        };
        assert_eq!(write_city(["", "-"]), None);
        assert!(!path.exists());
        let length = write_city(["Pand.1", "Pand.22"]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len() as u64, length);
        let index = SearchIndex::open(bytes).unwrap();
        assert_eq!(checksum(&path).unwrap(), index.checksum());
        let hits = index.search("22", 9);
        assert_eq!(hits.iter().map(|hit| (hit.text.as_str(), hit.object)).collect::<Vec<_>>(), [("Pand.22", 2)]);
    }
}
