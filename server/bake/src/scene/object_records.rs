//! What sources say of objects besides their shape: identifier, kind, parent, attributes. In memory or in a scratch file.

use super::scratch_budget::ScratchBudget;
use super::triangle_store::TriangleStore;
use crate::error::BakeError;
use insula_objects::FeatureKind;
use insula_objects::value::Value;
use insula_protocol::codec::bincode;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Name of a file of records.
pub(crate) const FILE_NAME: &str = "records";

/// Place of a record: its index in memory, or the position of its length in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct RecordPlace(u64);

impl RecordPlace {
    /// The place of the same record if `bytes` of other records precede its file.
    pub(crate) fn after(self, bytes: u64) -> Self {
        Self(self.0 + bytes)
    }
}

/// What a source says of an object.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SourceRecord {
    /// The source's own: gml:id, CityJSON key, feature id.
    pub(crate) identifier: String,
    pub(crate) kind: FeatureKind,
    /// In the order of the source.
    pub(crate) attributes: Vec<(String, Value)>,
}

#[derive(Serialize, Deserialize)]
struct StoredRecord {
    identifier: String,
    kind: FeatureKind,
    attributes: Vec<(String, StoredValue)>,
}

#[derive(Serialize, Deserialize)]
struct StoredValue(#[serde(with = "StoredVariants")] Value);

/// The variants of a value, which by itself is serialised as in JSON.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Value")]
enum StoredVariants {
    Text(String),
    Integer(i64),
    Float(f64),
    Bool(bool),
    Date(i32),
}

/// Records in the order in which they were added.
#[derive(Debug)]
pub(crate) enum ObjectRecords {
    Memory(Vec<SourceRecord>),
    File(RecordFile),
    /// Files that others wrote, one after the other.
    Parts(Vec<RecordPart>),
}

/// One of several files of records.
#[derive(Debug, Clone)]
pub(crate) struct RecordPart {
    pub(crate) path: PathBuf,
    /// Bytes of the files before.
    pub(crate) start: u64,
}

/// A scratch file of records, each after its length in four bytes. The first write error is kept until [`ObjectRecords::finish`].
#[derive(Debug)]
pub(crate) struct RecordFile {
    path: PathBuf,
    writer: Option<BufWriter<File>>,
    /// Bytes of other files before.
    start: u64,
    /// Bytes of this one.
    end: u64,
    budget: ScratchBudget,
    failed: Option<BakeError>,
}

impl ObjectRecords {
    /// Keeps records where the triangles are kept.
    pub(crate) fn for_triangles(triangles: &TriangleStore) -> Self {
        Self::after(0, triangles)
    }

    /// As [`Self::for_triangles`], after so many bytes of other files.
    pub(crate) fn after(start: u64, triangles: &TriangleStore) -> Self {
        let Some(file) = triangles.own_file() else { return Self::Memory(Vec::new()) };
        let path = file.path().with_file_name(FILE_NAME);
        let (writer, failed) = match File::create_new(&path) {
            Ok(file) => (Some(BufWriter::new(file)), None),
            Err(cause) => (None, Some(BakeError::io(&path, "written", cause))),
        };
        Self::File(RecordFile { path, writer, start, end: 0, budget: file.budget(), failed })
    }

    /// Adds a record. An object with more attributes than fit into a record loses them all.
    pub(crate) fn push(&mut self, record: SourceRecord) -> RecordPlace {
        match self {
            Self::Memory(all) => {
                all.push(record);
                RecordPlace(all.len() as u64 - 1)
            }
            Self::File(file) => file.push(record),
            // Parts are complete.
            Self::Parts(_) => RecordPlace(u64::MAX),
        }
    }

    /// Size of a file of records so far, 0 in memory.
    pub(crate) fn bytes(&self) -> u64 {
        if let Self::File(file) = self { file.end } else { 0 }
    }

    /// Ends the writing. Fails if any write failed or the scratch files are larger than they may be.
    pub(crate) fn finish(&mut self) -> Result<(), BakeError> {
        let Self::File(file) = self else { return Ok(()) };
        let flushed = file.writer.take().map_or(Ok(()), |mut writer| writer.flush());
        let flushed = flushed.map_err(|cause| BakeError::io(&file.path, "written", cause));
        file.failed.take().map_or(flushed, Err)
    }

    /// Opens the records for reading. Fails if their file cannot be opened.
    pub(crate) fn reader(&self) -> Result<RecordReader<'_>, BakeError> {
        let file = match self {
            Self::Memory(_) | Self::Parts(_) => None,
            Self::File(file) => Some(File::open(&file.path).map_err(|cause| BakeError::io(&file.path, "read", cause))?),
        };
        Ok(RecordReader { records: self, file, part: None })
    }
}

impl RecordFile {
    fn push(&mut self, record: SourceRecord) -> RecordPlace {
        let place = RecordPlace(self.start + self.end);
        let SourceRecord { identifier, kind, attributes } = record;
        let attributes = attributes.into_iter().map(|(name, value)| (name, StoredValue(value))).collect();
        let mut stored = StoredRecord { identifier, kind, attributes };
        let bytes = bincode::to_bytes(&stored).or_else(|_| {
            stored.attributes.clear();
            bincode::to_bytes(&stored)
        });
        let (Some(writer), Ok(bytes)) = (&mut self.writer, bytes) else { return place };
        let written = |cause| BakeError::io(&self.path, "written", cause);
        let length = (bytes.len() as u32).to_le_bytes();
        let spent = self.budget.spend(length.len() + bytes.len());
        let result =
            spent.and_then(|()| writer.write_all(&length).and_then(|()| writer.write_all(&bytes)).map_err(written));
        if let Err(error) = result {
            (self.failed, self.writer) = (Some(error), None);
        }
        self.end += (length.len() + bytes.len()) as u64;
        place
    }
}

/// Reads records in any order.
#[derive(Debug)]
pub(crate) struct RecordReader<'a> {
    records: &'a ObjectRecords,
    file: Option<File>,
    /// The part that was read last.
    part: Option<(usize, File)>,
}

impl RecordReader<'_> {
    /// A record. Fails if it cannot be read.
    pub(crate) fn read(&mut self, place: RecordPlace) -> Result<SourceRecord, BakeError> {
        match (self.records, &mut self.file) {
            (ObjectRecords::File(RecordFile { path, start, .. }), Some(file)) => {
                let at = place.0.checked_sub(*start).ok_or_else(|| BakeError::Scratch { path: path.clone() })?;
                read_at(file, path, at)
            }
            (ObjectRecords::Parts(parts), _) => {
                let number = parts.partition_point(|part| part.start <= place.0).saturating_sub(1);
                let missing = || BakeError::Scratch { path: PathBuf::from("records") };
                let RecordPart { path, start } = parts.get(number).ok_or_else(missing)?;
                if self.part.as_ref().is_none_or(|(open, _)| *open != number) {
                    let file = File::open(path).map_err(|cause| BakeError::io(path, "read", cause))?;
                    self.part = Some((number, file));
                }
                let (_, file) = self.part.as_mut().ok_or_else(missing)?;
                read_at(file, path, place.0 - start)
            }
            (ObjectRecords::Memory(all), _) => {
                let record = all.get(place.0 as usize);
                record.cloned().ok_or_else(|| BakeError::Scratch { path: PathBuf::from("records") })
            }
            (ObjectRecords::File(file), None) => Err(BakeError::Scratch { path: file.path.clone() }),
        }
    }
}

fn read_at(file: &mut File, path: &Path, position: u64) -> Result<SourceRecord, BakeError> {
    let damaged = || BakeError::Scratch { path: path.to_owned() };
    let failed = |cause| BakeError::io(path, "read", cause);
    let mut length = [0; 4];
    file.seek(SeekFrom::Start(position)).and_then(|_| file.read_exact(&mut length)).map_err(failed)?;
    let length = u32::from_le_bytes(length) as usize;
    if length > bincode::LIMIT {
        return Err(damaged());
    }
    let mut bytes = vec![0; length];
    file.read_exact(&mut bytes).map_err(failed)?;
    let StoredRecord { identifier, kind, attributes } = bincode::from_bytes(&bytes).map_err(|_| damaged())?;
    let attributes = attributes.into_iter().map(|(name, StoredValue(value))| (name, value)).collect();
    Ok(SourceRecord { identifier, kind, attributes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn records_are_read_in_any_order_from_memory_and_from_a_file() {
        let folder = TestFolder::new("records");
        let budget = ScratchBudget::new(u64::MAX);
        let stored = TriangleStore::in_file(folder.path.join("triangles"), budget).unwrap();
        let record = |n: i64| SourceRecord {
            identifier: format!("house {n}"),
            kind: FeatureKind::Building,
            attributes: vec![
                ("floors".into(), Value::Integer(n)),
                ("name".into(), Value::Text("x".repeat(n as usize))),
            ],
        };
        for triangles in [TriangleStore::Memory(Vec::new()), stored] {
            let mut records = ObjectRecords::for_triangles(&triangles);
            let places: Vec<RecordPlace> = (0..100).map(|n| records.push(record(n))).collect();
            records.finish().unwrap();
            let mut reader = records.reader().unwrap();
            for n in [99, 0, 57, 57, 1] {
                assert_eq!(reader.read(places[n]).unwrap(), record(n as i64));
            }
        }
    }

    #[test]
    fn records_count_towards_the_budget() {
        let folder = TestFolder::new("records-budget");
        let triangles = TriangleStore::in_file(folder.path.join("triangles"), ScratchBudget::new(1000)).unwrap();
        let mut records = ObjectRecords::for_triangles(&triangles);
        for _ in 0..100 {
            let identifier = "x".repeat(30);
            records.push(SourceRecord { identifier, kind: FeatureKind::Road, attributes: Vec::new() });
        }
        assert!(matches!(records.finish(), Err(BakeError::ScratchLimit { .. })));
    }
}
