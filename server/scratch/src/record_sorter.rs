//! Sorts records in bounded memory: sorted runs in a scratch file, which are merged (Knuth, "The Art of Computer Programming", vol. 3,
//! 5.4).

use crate::error::ScratchError;
use crate::record_list::RecordScratch;
use insula_protocol::codec::bincode;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::cmp::Ordering;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

/// Records that are sorted in memory.
const RUN_RECORDS: usize = 1 << 14;
/// Runs of one level that are merged.
const FAN_IN: usize = 32;
/// Bytes of a run that are read at once.
const READ_BYTES: usize = 16 << 10;

/// Collects records. Equal ones keep their order.
pub struct RecordSorter<T> {
    scratch: RecordScratch,
    compare: fn(&T, &T) -> Ordering,
    buffer: Vec<T>,
    file: Option<File>,
    end: u64,
    /// In the order of their records.
    runs: Vec<SortedRun>,
}

/// A sorted run in the file: records, each after its length in four bytes.
#[derive(Debug, Clone, Copy)]
struct SortedRun {
    level: u32,
    start: u64,
    end: u64,
}

/// The records in order.
pub enum SortedRecords<T> {
    Memory(std::vec::IntoIter<T>),
    Runs(RunMerger<T>),
}

/// Merges runs.
pub struct RunMerger<T> {
    file: File,
    compare: fn(&T, &T) -> Ordering,
    runs: Vec<RunReader<T>>,
}

/// A run of which some is read.
struct RunReader<T> {
    /// Its bytes in the file that are not read.
    start: u64,
    end: u64,
    bytes: Vec<u8>,
    at: usize,
    next: Option<T>,
}

impl<T: Serialize + DeserializeOwned> RecordSorter<T> {
    /// Without records.
    pub fn new(scratch: &RecordScratch, compare: fn(&T, &T) -> Ordering) -> Self {
        Self { scratch: scratch.clone(), compare, buffer: Vec::new(), file: None, end: 0, runs: Vec::new() }
    }

    /// Adds a record. Fails if the file cannot be written.
    pub fn push(&mut self, record: T) -> Result<(), ScratchError> {
        self.buffer.push(record);
        if self.scratch.folder().is_some() && self.buffer.len() >= RUN_RECORDS { self.spill() } else { Ok(()) }
    }

    /// The records in order. Fails if the file cannot be read or written.
    pub fn finish(mut self) -> Result<SortedRecords<T>, ScratchError> {
        if self.runs.is_empty() {
            self.buffer.sort_by(self.compare);
            return Ok(SortedRecords::Memory(self.buffer.into_iter()));
        }
        self.spill()?;
        let file = self.file.take().ok_or_else(damaged)?;
        Ok(SortedRecords::Runs(RunMerger::new(file, self.compare, &self.runs)?))
    }

    /// Writes the buffer as a run, and merges runs if there are many of one level.
    fn spill(&mut self) -> Result<(), ScratchError> {
        if self.buffer.is_empty() {
            return Ok(());
        }
        self.buffer.sort_by(self.compare);
        let mut records = std::mem::take(&mut self.buffer).into_iter();
        self.write_run(0, &mut || Ok(records.next()))?;
        self.buffer.reserve(RUN_RECORDS);
        while let Some(level) = self.full_level() {
            let merged = self.runs.split_off(self.runs.len() - FAN_IN);
            let file = self.file.as_ref().ok_or_else(damaged)?;
            let file = file.try_clone().map_err(|cause| ScratchError::io(&self.path(), "read", cause))?;
            let mut merger = RunMerger::new(file, self.compare, &merged)?;
            self.write_run(level + 1, &mut || merger.next())?;
        }
        Ok(())
    }

    /// The level of the last runs, if there are as many as are merged.
    fn full_level(&self) -> Option<u32> {
        let last = self.runs.len().checked_sub(FAN_IN).map(|first| &self.runs[first..])?;
        let level = last[0].level;
        last.iter().all(|run| run.level == level).then_some(level)
    }

    fn write_run(
        &mut self,
        level: u32,
        next: &mut dyn FnMut() -> Result<Option<T>, ScratchError>,
    ) -> Result<(), ScratchError> {
        let path = self.path();
        let failed = |cause| ScratchError::io(&path, "written", cause);
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(tempfile::tempfile_in(&path).map_err(failed)?),
        };
        // Reading the runs that are merged moves the place at which is written: each block of bytes is written at its own.
        let (start, mut end) = (self.end, self.end);
        let mut block = Vec::new();
        loop {
            let record = next()?;
            if let Some(record) = &record {
                let bytes = bincode::to_bytes(record).map_err(|_| damaged())?;
                block.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
                block.extend(bytes);
            }
            if record.is_none() || block.len() >= READ_BYTES {
                file.seek(SeekFrom::Start(end)).and_then(|_| file.write_all(&block)).map_err(failed)?;
                end += block.len() as u64;
                block.clear();
            }
            if record.is_none() {
                break;
            }
        }
        self.end = end;
        self.runs.push(SortedRun { level, start, end });
        Ok(())
    }

    fn path(&self) -> PathBuf {
        self.scratch.folder().map_or_else(PathBuf::new, std::path::Path::to_owned)
    }
}

impl<T: DeserializeOwned> SortedRecords<T> {
    /// The next record; `None` after the last one. Fails if the file cannot be read.
    pub fn read_next(&mut self) -> Result<Option<T>, ScratchError> {
        match self {
            Self::Memory(records) => Ok(records.next()),
            Self::Runs(merger) => merger.next(),
        }
    }

    /// Calls `visit` for all records that are left. Fails as [`Self::read_next`], or with the first error of `visit`.
    pub fn try_for_each<E: From<ScratchError>>(mut self, mut visit: impl FnMut(T) -> Result<(), E>) -> Result<(), E> {
        while let Some(record) = self.read_next()? {
            visit(record)?;
        }
        Ok(())
    }
}

impl<T: DeserializeOwned> RunMerger<T> {
    fn new(mut file: File, compare: fn(&T, &T) -> Ordering, runs: &[SortedRun]) -> Result<Self, ScratchError> {
        let reader =
            |run: &SortedRun| RunReader { start: run.start, end: run.end, bytes: Vec::new(), at: 0, next: None };
        let mut runs: Vec<RunReader<T>> = runs.iter().map(reader).collect();
        runs.iter_mut().try_for_each(|run| run.advance(&mut file))?;
        Ok(Self { file, compare, runs })
    }

    fn next(&mut self) -> Result<Option<T>, ScratchError> {
        let mut least: Option<usize> = None;
        for (number, run) in self.runs.iter().enumerate() {
            let Some(next) = &run.next else { continue };
            let known = least.and_then(|least| self.runs[least].next.as_ref());
            // Of equal records, the one of the first run.
            if known.is_none_or(|known| (self.compare)(next, known) == Ordering::Less) {
                least = Some(number);
            }
        }
        let Some(run) = least.and_then(|least| self.runs.get_mut(least)) else { return Ok(None) };
        let record = run.next.take();
        run.advance(&mut self.file)?;
        Ok(record)
    }
}

impl<T: DeserializeOwned> RunReader<T> {
    /// Reads the next record.
    fn advance(&mut self, file: &mut File) -> Result<(), ScratchError> {
        self.next = None;
        self.fill(file, 4)?;
        let Some(length) = self.bytes[self.at..].first_chunk::<4>() else { return Ok(()) };
        let length = u32::from_le_bytes(*length) as usize;
        self.fill(file, 4 + length)?;
        let record = self.bytes.get(self.at + 4..self.at + 4 + length).ok_or_else(damaged)?;
        self.next = Some(bincode::long_from_bytes(record).map_err(|_| damaged())?);
        self.at += 4 + length;
        Ok(())
    }

    /// Has so many bytes in memory, as far as the run has them.
    fn fill(&mut self, file: &mut File, wanted: usize) -> Result<(), ScratchError> {
        let known = self.bytes.len() - self.at;
        if known >= wanted || self.start == self.end {
            return Ok(());
        }
        self.bytes.drain(..self.at);
        self.at = 0;
        let length = (self.end - self.start).min(READ_BYTES.max(wanted - known) as u64);
        self.bytes.resize(known + length as usize, 0);
        let read = file.seek(SeekFrom::Start(self.start)).and_then(|_| file.read_exact(&mut self.bytes[known..]));
        read.map_err(|cause| ScratchError::io("records".as_ref(), "read", cause))?;
        self.start += length;
        Ok(())
    }
}

fn damaged() -> ScratchError {
    ScratchError::Damaged
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;
    use insula_test_support::rng::Rng;

    #[test]
    fn records_are_sorted_and_equal_ones_keep_their_order() {
        let folder = TestFolder::new("record-sorter");
        // The last is more than runs of two levels.
        for count in [0, 1, 1000, RUN_RECORDS * 3 + 7, RUN_RECORDS * (2 * FAN_IN + 3) + 5] {
            let mut rng = Rng::new(count as u64);
            let compare = |a: &(u32, u32), b: &(u32, u32)| a.0.cmp(&b.0);
            let mut sorter = RecordSorter::new(&RecordScratch::in_folder(&folder.path), compare);
            let mut expected = Vec::with_capacity(count);
            for number in 0..count as u32 {
                let record = (rng.below(1 + count / 5) as u32, number);
                sorter.push(record).unwrap();
                expected.push(record);
            }
            expected.sort_by(compare);
            let mut found = Vec::with_capacity(count);
            let sorted = sorter.finish().unwrap();
            sorted
                .try_for_each(|record| {
                    found.push(record);
                    Ok::<_, ScratchError>(())
                })
                .unwrap();
            assert!(found == expected, "{count} records");
        }
    }
}
