//! Shapes of a whole city, found by place. Those beyond a limit of memory are in a scratch file.
//!
//! The map is divided into square cells. Each has the numbers of the shapes that touch it, in the order in which they
//! were added. A shape is kept once, however many cells it touches.

mod bounds;

pub use bounds::{MAX_COORDINATE_M, MapBounds, bounds, is_position, overlap};
use insula_protocol::codec::bincode;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

const CELL_M: f64 = 1000.0;
/// Shapes that touch more cells are looked at for every rectangle.
const MAX_CELLS: i64 = 1024;
const BUFFER_BYTES: usize = 1 << 18;

/// A shape that can be kept.
pub trait MapRecord: Serialize + DeserializeOwned {
    /// Lowest and highest position of what it covers; `None` if it has no position.
    fn bounds(&self) -> Option<MapBounds>;

    /// What it takes of the memory of a store.
    fn size_bytes(&self) -> u64;

    /// Its bytes in a scratch file; `None` if it has none.
    fn encode(&self) -> Option<Vec<u8>> {
        bincode::to_bytes(self).ok()
    }

    /// The inverse of [`Self::encode`]; `None` if the bytes are not those of a shape.
    fn decode(bytes: &[u8]) -> Option<Self> {
        bincode::long_from_bytes(bytes).ok()
    }
}

/// Why shapes cannot be kept or found.
#[derive(Debug, thiserror::Error)]
pub enum MapStoreError {
    #[error("the scratch file {path} cannot be {action}: {cause}")]
    Io { path: PathBuf, action: &'static str, cause: io::Error },
    #[error("the scratch file {path} has changed")]
    Damaged { path: PathBuf },
    #[error("shapes on the map need more than {limit_mib} MiB of scratch files")]
    TooLarge { limit_mib: u64 },
    #[error("there are more than 4 billion shapes on the map")]
    TooMany,
}

/// Where a shape is.
#[derive(Debug)]
enum Slot<T> {
    Memory(Arc<T>),
    File { start: u64, bytes: u32 },
}

#[derive(Debug)]
struct StoredShape<T> {
    bounds: MapBounds,
    slot: Slot<T>,
}

/// Shapes by their place on the map.
#[derive(Debug)]
pub struct MapStore<T> {
    entries: Vec<StoredShape<T>>,
    cells: HashMap<[i64; 2], Vec<u32>>,
    /// Numbers of the shapes that touch too many cells.
    wide: Vec<u32>,
    memory_left_bytes: u64,
    file_limit_bytes: u64,
    path: PathBuf,
    file: Option<Mutex<ScratchFile>>,
}

#[derive(Debug)]
struct ScratchFile {
    writer: BufWriter<File>,
    end: u64,
    /// Whether the file's position is its end.
    is_at_end: bool,
}

impl<T: MapRecord> MapStore<T> {
    /// An empty store. Shapes beyond `memory_limit_bytes` are written to a file at `path`, which must not exist, and
    /// has at most `file_limit_bytes`. The file is created when it is needed, and removed with the store. Numbers and
    /// bounds of shapes, about 60 bytes each, stay in memory.
    #[must_use]
    pub fn new(path: &Path, memory_limit_bytes: u64, file_limit_bytes: u64) -> Self {
        Self {
            entries: Vec::new(),
            cells: HashMap::new(),
            wide: Vec::new(),
            memory_left_bytes: memory_limit_bytes,
            file_limit_bytes,
            path: path.to_owned(),
            file: None,
        }
    }

    /// Number of shapes.
    #[must_use]
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Lowest and highest position of all shapes; `None` without any.
    pub fn bounds(&self) -> Option<MapBounds> {
        self.entries.iter().map(|entry| entry.bounds).reduce(|[low, high], [other_low, other_high]| {
            [[0, 1].map(|axis| low[axis].min(other_low[axis])), [0, 1].map(|axis| high[axis].max(other_high[axis]))]
        })
    }

    /// Whether it has no records.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Adds a shape. One without a position is left out. Fails if the scratch file cannot be written or would be too
    /// large.
    pub fn push(&mut self, shape: T) -> Result<(), MapStoreError> {
        let Some(bounds) = shape.bounds() else { return Ok(()) };
        let number = u32::try_from(self.entries.len()).map_err(|_| MapStoreError::TooMany)?;
        let bytes = shape.size_bytes();
        let slot = if let Some(left) = self.memory_left_bytes.checked_sub(bytes) {
            self.memory_left_bytes = left;
            Slot::Memory(Arc::new(shape))
        } else {
            // A later smaller shape would fit, but the limit would then be spent on small shapes only.
            self.memory_left_bytes = 0;
            self.write(&shape)?
        };
        self.entries.push(StoredShape { bounds, slot });
        match cells_of(bounds) {
            Some(range) if range.count() <= MAX_CELLS => {
                range.cells().for_each(|cell| self.cells.entry(cell).or_default().push(number));
            }
            _ => self.wide.push(number),
        }
        Ok(())
    }

    /// The shapes that touch a rectangle, from its lowest to its highest position in metres, in the order in which they
    /// were added. Fails if the scratch file cannot be read.
    pub fn shapes_in(&self, rectangle: MapBounds) -> Result<Vec<Arc<T>>, MapStoreError> {
        let mut numbers = self.wide.clone();
        match cells_of(rectangle) {
            Some(range) if range.count() <= self.cells.len() as i64 => {
                range.cells().filter_map(|cell| self.cells.get(&cell)).for_each(|found| numbers.extend(found));
            }
            Some(_) => numbers = (0..self.entries.len() as u32).collect(),
            None => return Ok(Vec::new()),
        }
        numbers.sort_unstable();
        numbers.dedup();
        let entries = numbers.into_iter().filter_map(|number| self.entries.get(number as usize));
        entries.filter(|entry| overlap(entry.bounds, rectangle)).map(|entry| self.load(entry)).collect()
    }

    /// Calls `visit` for all shapes, in the order in which they were added. Fails if the scratch file cannot be read, or with the first
    /// error of `visit`.
    pub fn try_for_each(&self, mut visit: impl FnMut(&T) -> io::Result<()>) -> io::Result<()> {
        self.entries.iter().try_for_each(|entry| visit(&*self.load(entry).map_err(io::Error::other)?))
    }

    fn load(&self, entry: &StoredShape<T>) -> Result<Arc<T>, MapStoreError> {
        let (start, bytes) = match &entry.slot {
            Slot::Memory(shape) => return Ok(shape.clone()),
            Slot::File { start, bytes } => (*start, *bytes),
        };
        let damaged = || MapStoreError::Damaged { path: self.path.clone() };
        // A thread that panicked while it held the file left a position, which the next read sets anyway.
        let mut file = self.file.as_ref().ok_or_else(damaged)?.lock().unwrap_or_else(PoisonError::into_inner);
        let mut record = vec![0; bytes as usize];
        file.read(start, &mut record).map_err(|cause| self.failed("read", cause))?;
        drop(file);
        T::decode(&record).map(Arc::new).ok_or_else(damaged)
    }

    fn write(&mut self, shape: &T) -> Result<Slot<T>, MapStoreError> {
        let too_large = MapStoreError::TooLarge { limit_mib: self.file_limit_bytes >> 20 };
        let damaged = || MapStoreError::Damaged { path: self.path.clone() };
        let record = shape.encode().ok_or_else(damaged)?;
        let Ok(bytes) = u32::try_from(record.len()) else { return Err(too_large) };
        if self.file.is_none() {
            let file = File::options().read(true).write(true).create_new(true).open(&self.path);
            let file = file.map_err(|cause| self.failed("created", cause))?;
            let writer = BufWriter::with_capacity(BUFFER_BYTES, file);
            self.file = Some(Mutex::new(ScratchFile { writer, end: 0, is_at_end: true }));
        }
        let Some(file) = self.file.as_mut().map(|file| file.get_mut().unwrap_or_else(PoisonError::into_inner)) else {
            return Err(MapStoreError::Damaged { path: self.path.clone() });
        };
        let start = file.end;
        if start + u64::from(bytes) > self.file_limit_bytes {
            return Err(too_large);
        }
        match file.append(&record) {
            Ok(()) => Ok(Slot::File { start, bytes }),
            Err(cause) => Err(self.failed("written", cause)),
        }
    }

    fn failed(&self, action: &'static str, cause: io::Error) -> MapStoreError {
        MapStoreError::Io { path: self.path.clone(), action, cause }
    }
}

impl<T> Drop for MapStore<T> {
    /// Removes the scratch file. If that fails, it stays until the whole scratch folder is removed.
    fn drop(&mut self) {
        if self.file.take().is_some() {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl ScratchFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        if !self.is_at_end {
            self.writer.seek(SeekFrom::Start(self.end))?;
            self.is_at_end = true;
        }
        self.writer.write_all(bytes)?;
        self.end += bytes.len() as u64;
        Ok(())
    }

    fn read(&mut self, start: u64, bytes: &mut [u8]) -> io::Result<()> {
        self.is_at_end = false;
        // Seeking flushes the buffer.
        self.writer.seek(SeekFrom::Start(start))?;
        self.writer.get_mut().read_exact(bytes)
    }
}

/// A rectangle of cells; the last ones belong to it.
#[derive(Debug, Clone, Copy)]
struct CellRange {
    low: [i64; 2],
    high: [i64; 2],
}

impl CellRange {
    fn count(self) -> i64 {
        (self.high[0] - self.low[0] + 1) * (self.high[1] - self.low[1] + 1)
    }

    fn cells(self) -> impl Iterator<Item = [i64; 2]> {
        (self.low[1]..=self.high[1]).flat_map(move |y| (self.low[0]..=self.high[0]).map(move |x| [x, y]))
    }
}

/// The cells of a rectangle; `None` if its corners are no positions or it is empty. Bounds of shapes reach a little
/// beyond all positions.
fn cells_of([low, high]: MapBounds) -> Option<CellRange> {
    let is_one = |corner: [f64; 2]| is_position(corner.map(|v| v / 2.0));
    let is_some = is_one(low) && is_one(high) && (0..2).all(|axis| low[axis] <= high[axis]);
    // Below 10^7 by the limit of positions.
    let cell = |corner: [f64; 2]| corner.map(|v| (v / CELL_M).floor() as i64);
    is_some.then(|| CellRange { low: cell(low), high: cell(high) })
}
