//! What blocks need to know of objects, in memory or in a scratch file.
//!
//! Each block asks for its own objects, and a city has tens of millions. Records of one length are found without an index.

use super::ObjectKind;
use crate::error::BakeError;
use insula_protocol::blockmap::NO_OBJECT;
use insula_scratch::record_list::RecordScratch;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Kind, height of the base, number: 9 bytes.
const RECORD_BYTES: usize = 9;
/// Records that are read at once: neighbours in a source often are neighbours in the city.
const WINDOW: usize = 64;
/// Fewer objects are in memory.
const MAX_IN_MEMORY: usize = 1 << 14;

/// What a block needs to know of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BlockObjectFacts {
    pub(crate) kind: ObjectKind,
    /// Height of the lowest vertex in metres above the scene's origin.
    pub(crate) base_z_m: f32,
    /// Number in the baked city; [`NO_OBJECT`] for generated ground.
    pub(crate) number: u32,
}

/// The objects of a city as blocks need them.
#[derive(Debug)]
pub(crate) enum ObjectFactsStore {
    Memory(Vec<BlockObjectFacts>),
    File { file: Mutex<File>, folder: PathBuf, length: usize },
}

impl Default for ObjectFactsStore {
    fn default() -> Self {
        Self::Memory(Vec::new())
    }
}

/// Collects the objects of a city in order.
#[derive(Debug)]
pub(crate) enum ObjectFactsWriter {
    Memory(Vec<BlockObjectFacts>),
    File { writer: BufWriter<File>, folder: PathBuf, length: usize },
}

impl ObjectFactsWriter {
    /// For `count` objects. They are in a file if `scratch` has a folder, and if they are many. Fails if the file cannot be created.
    pub(crate) fn new(scratch: &RecordScratch, count: usize) -> Result<Self, BakeError> {
        Self::within(scratch, count, MAX_IN_MEMORY)
    }

    fn within(scratch: &RecordScratch, count: usize, max_in_memory: usize) -> Result<Self, BakeError> {
        let Some(folder) = scratch.folder().filter(|_| count > max_in_memory) else {
            return Ok(Self::Memory(Vec::with_capacity(count)));
        };
        let file = tempfile::tempfile_in(folder).map_err(|cause| BakeError::io(folder, "written", cause))?;
        Ok(Self::File { writer: BufWriter::new(file), folder: folder.to_owned(), length: 0 })
    }

    /// Adds the next object. Fails if the file cannot be written.
    pub(crate) fn push(&mut self, object: BlockObjectFacts) -> Result<(), BakeError> {
        match self {
            Self::Memory(all) => all.push(object),
            Self::File { writer, folder, length } => {
                let written = writer.write_all(&to_record(&object));
                written.map_err(|cause| BakeError::io(folder, "written", cause))?;
                *length += 1;
            }
        }
        Ok(())
    }

    /// All objects. Fails if the file cannot be written.
    pub(crate) fn finish(self) -> Result<ObjectFactsStore, BakeError> {
        Ok(match self {
            Self::Memory(all) => ObjectFactsStore::Memory(all),
            Self::File { writer, folder, length } => {
                let file = writer.into_inner();
                let file = file.map_err(|error| BakeError::io(&folder, "written", error.into_error()))?;
                ObjectFactsStore::File { file: Mutex::new(file), folder, length }
            }
        })
    }
}

impl ObjectFactsStore {
    /// Those of some objects, in the order in which these are given. Fails if there is no such object, or the file cannot be read.
    pub(crate) fn of(&self, objects: &[u32]) -> Result<Vec<BlockObjectFacts>, BakeError> {
        let (file, folder, length) = match self {
            Self::Memory(all) => {
                let shown = objects.iter().map(|object| all.get(*object as usize).copied().ok_or_else(missing));
                return shown.collect();
            }
            Self::File { file, folder, length } => (file, folder, *length),
        };
        let mut order: Vec<(usize, usize)> =
            objects.iter().map(|object| *object as usize).enumerate().map(|(place, object)| (object, place)).collect();
        order.sort_unstable();
        let nothing = BlockObjectFacts { kind: ObjectKind::Building, base_z_m: 0.0, number: NO_OBJECT };
        let mut shown = vec![nothing; objects.len()];
        let (mut first, mut window) = (0, Vec::new());
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        for (object, place) in order {
            if object >= length {
                return Err(missing());
            }
            if window.is_empty() || object >= first + window.len() / RECORD_BYTES {
                first = object;
                window.resize(WINDOW.min(length - first) * RECORD_BYTES, 0);
                let read = read_at(&mut file, (first * RECORD_BYTES) as u64, &mut window);
                read.map_err(|cause| BakeError::io(folder, "read", cause))?;
            }
            let record = window[(object - first) * RECORD_BYTES..].first_chunk::<RECORD_BYTES>();
            shown[place] = record.and_then(from_record).ok_or_else(missing)?;
        }
        Ok(shown)
    }
}

fn read_at(file: &mut File, start: u64, bytes: &mut [u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(start))?;
    file.read_exact(bytes)
}

fn to_record(object: &BlockObjectFacts) -> [u8; RECORD_BYTES] {
    let mut record = [0; RECORD_BYTES];
    record[0] = match object.kind {
        ObjectKind::Building => 0,
        ObjectKind::Terrain => 1,
        ObjectKind::GeneratedGround => 2,
    };
    record[1..5].copy_from_slice(&object.base_z_m.to_le_bytes());
    record[5..].copy_from_slice(&object.number.to_le_bytes());
    record
}

/// The inverse of [`to_record`]; `None` for another kind.
fn from_record([kind, b0, b1, b2, b3, n0, n1, n2, n3]: &[u8; RECORD_BYTES]) -> Option<BlockObjectFacts> {
    let kind = match kind {
        0 => ObjectKind::Building,
        1 => ObjectKind::Terrain,
        2 => ObjectKind::GeneratedGround,
        _ => return None,
    };
    let base_z_m = f32::from_le_bytes([*b0, *b1, *b2, *b3]);
    Some(BlockObjectFacts { kind, base_z_m, number: u32::from_le_bytes([*n0, *n1, *n2, *n3]) })
}

fn missing() -> BakeError {
    BakeError::Scratch { path: PathBuf::from("objects") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;
    use insula_test_support::rng::Rng;

    #[test]
    fn objects_are_found_in_any_order_in_memory_and_in_a_file() {
        let folder = TestFolder::new("object-facts");
        let kinds = [ObjectKind::Building, ObjectKind::Terrain, ObjectKind::GeneratedGround];
        let object = |i: u32| BlockObjectFacts {
            kind: kinds[i as usize % 3],
            base_z_m: i as f32 * -0.5,
            number: NO_OBJECT - 7 * i,
        };
        for (scratch, is_file) in [(RecordScratch::default(), false), (RecordScratch::in_folder(&folder.path), true)] {
            let mut writer = ObjectFactsWriter::within(&scratch, 1000, 100).unwrap();
            (0..1000).for_each(|i| writer.push(object(i)).unwrap());
            let shown = writer.finish().unwrap();
            assert_eq!(matches!(shown, ObjectFactsStore::File { .. }), is_file);
            let mut rng = Rng::new(5);
            for count in [0, 1, 5, 300] {
                let wanted: Vec<u32> = (0..count).map(|_| rng.below(1000) as u32).chain([999, 0, 0]).collect();
                let expected: Vec<BlockObjectFacts> = wanted.iter().map(|i| object(*i)).collect();
                assert_eq!(shown.of(&wanted).unwrap(), expected);
            }
            assert!(shown.of(&[3, 1000]).is_err());
        }
    }
}
