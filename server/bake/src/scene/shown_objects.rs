//! What blocks need to know of objects, in memory or in a scratch file.
//!
//! Each block asks for its own objects, and a city has tens of millions. Records of one length are found without an index.

use std::{
    fs::File,
    io::{self, BufWriter, Read, Seek, SeekFrom, Write},
    path::PathBuf,
    sync::{Mutex, PoisonError},
};

use insula_protocol::blockmap::NO_OBJECT;

use super::{ObjectKind, record_list::RecordList, scratch_scene::StoredObject};
use crate::error::BakeError;

/// Kind, height of the base, number: 9 bytes.
const RECORD_BYTES: usize = 9;
/// Records that are read at once: neighbours in a source often are neighbours in the city.
const WINDOW: usize = 64;
/// Fewer objects are in memory.
const MAX_IN_MEMORY: usize = 1 << 14;

/// What a block needs to know of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ShownObject {
    pub(crate) kind: ObjectKind,
    /// Height of the lowest vertex in metres above the scene's origin.
    pub(crate) base_z_m: f32,
    /// Number in the baked city; [`NO_OBJECT`] for generated ground.
    pub(crate) number: u32,
}

/// The objects of a city as blocks need them.
#[derive(Debug)]
pub(crate) enum ShownObjects {
    Memory(Vec<ShownObject>),
    File { file: Mutex<File>, folder: PathBuf, length: usize },
}

impl Default for ShownObjects {
    fn default() -> Self {
        Self::Memory(Vec::new())
    }
}

impl ShownObjects {
    /// Of all objects in order, with their numbers. They are in a file if both lists are, and there are many. Fails if a list cannot be
    /// read, or the file not be written.
    pub(crate) fn new(objects: &RecordList<StoredObject>, numbers: &RecordList<u32>) -> Result<Self, BakeError> {
        Self::within(objects, numbers, MAX_IN_MEMORY)
    }

    fn within(
        objects: &RecordList<StoredObject>,
        numbers: &RecordList<u32>,
        max_in_memory: usize,
    ) -> Result<Self, BakeError> {
        let mut numbers = Numbers { cursor: numbers.cursor(), length: numbers.len() };
        let scratch = objects.scratch();
        let Some(folder) = scratch.folder().filter(|_| objects.len() > max_in_memory) else {
            let mut all = Vec::with_capacity(objects.len());
            objects.try_for_each(|i, object| {
                all.push(numbers.shown(i, object)?);
                Ok(())
            })?;
            return Ok(Self::Memory(all));
        };
        let failed = |cause| BakeError::io(folder, "written", cause);
        let mut writer = BufWriter::new(tempfile::tempfile_in(folder).map_err(failed)?);
        objects.try_for_each(|i, object| {
            let record = to_record(&numbers.shown(i, object)?);
            writer.write_all(&record).map_err(failed)
        })?;
        let file = writer.into_inner().map_err(|error| failed(error.into_error()))?;
        Ok(Self::File { file: Mutex::new(file), folder: folder.to_owned(), length: objects.len() })
    }

    /// Those of some objects, in the order in which these are given. Fails if there is no such object, or the file cannot be read.
    pub(crate) fn of(&self, objects: &[u32]) -> Result<Vec<ShownObject>, BakeError> {
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
        let nothing = ShownObject { kind: ObjectKind::Building, base_z_m: 0.0, number: NO_OBJECT };
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

/// Reads numbers in the order of the objects. The list may be shorter.
struct Numbers<'a> {
    cursor: super::record_list::RecordCursor<'a, u32>,
    length: usize,
}

impl Numbers<'_> {
    fn shown(&mut self, i: usize, object: &StoredObject) -> Result<ShownObject, BakeError> {
        let number = if i < self.length { *self.cursor.get(i)? } else { NO_OBJECT };
        Ok(ShownObject { kind: object.kind, base_z_m: object.base_z_m, number })
    }
}

fn read_at(file: &mut File, start: u64, bytes: &mut [u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(start))?;
    file.read_exact(bytes)
}

fn to_record(object: &ShownObject) -> [u8; RECORD_BYTES] {
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
fn from_record([kind, b0, b1, b2, b3, n0, n1, n2, n3]: &[u8; RECORD_BYTES]) -> Option<ShownObject> {
    let kind = match kind {
        0 => ObjectKind::Building,
        1 => ObjectKind::Terrain,
        2 => ObjectKind::GeneratedGround,
        _ => return None,
    };
    let base_z_m = f32::from_le_bytes([*b0, *b1, *b2, *b3]);
    Some(ShownObject { kind, base_z_m, number: u32::from_le_bytes([*n0, *n1, *n2, *n3]) })
}

fn missing() -> BakeError {
    BakeError::Scratch { path: PathBuf::from("objects") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::record_list::RecordScratch;
    use insula_test_support::{folder::TestFolder, rng::Rng};

    #[test]
    fn objects_are_found_in_any_order_in_memory_and_in_a_file() {
        let folder = TestFolder::new("shown-objects");
        let kinds = [ObjectKind::Building, ObjectKind::Terrain, ObjectKind::GeneratedGround];
        for (scratch, is_file) in [(RecordScratch::default(), false), (RecordScratch::in_folder(&folder.path), true)] {
            let (mut objects, mut numbers) = (RecordList::new(&scratch), RecordList::new(&scratch));
            let object = |i: u32| StoredObject {
                kind: kinds[i as usize % 3],
                base_z_m: i as f32 * -0.5,
                bounds_m: [[0.0; 3]; 2],
                identity: None,
            };
            (0..1000).for_each(|i| objects.push(object(i)));
            // The last object has no number.
            (0..999).for_each(|i| numbers.push(7 * i));
            let shown = ShownObjects::within(&objects, &numbers, 100).unwrap();
            assert_eq!(matches!(shown, ShownObjects::File { .. }), is_file);
            let mut rng = Rng::new(5);
            for count in [0, 1, 5, 300] {
                let wanted: Vec<u32> = (0..count).map(|_| rng.below(1000) as u32).chain([999, 0, 0]).collect();
                let expected: Vec<ShownObject> = wanted
                    .iter()
                    .map(|i| ShownObject {
                        kind: kinds[*i as usize % 3],
                        base_z_m: *i as f32 * -0.5,
                        number: if *i == 999 { NO_OBJECT } else { 7 * i },
                    })
                    .collect();
                assert_eq!(shown.of(&wanted).unwrap(), expected);
            }
            assert!(shown.of(&[3, 1000]).is_err());
        }
    }
}
