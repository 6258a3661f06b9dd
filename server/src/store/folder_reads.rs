//! Reads of folders of cities, while a disk or a network file system may not respond.
//!
//! A thread that waits for such a file system cannot be stopped. It is left alone: until it ends, its folder counts as one that does not
//! respond, and all others are read. The check after its end uses what it has read. So slow cities are opened, too, only later.

use super::city::{CityStamp, CityStore};
use super::error::StoreError;
use insula_archive::city::MANIFEST_FILE;
use insula_archive::limits::MAX_OPENING_TIME;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use std::{fs, io, thread};

/// Reads of one kind that do not end, before the others get [`SHORT_READ_TIME`] only: a check must not wait for each city of a disk.
const PATIENT_READS: usize = 4;
const SHORT_READ_TIME: Duration = Duration::from_secs(1);
/// Most reads of one kind that do not end, each of which has a thread.
const MAX_LATE_READS: usize = 64;

type Job = Box<dyn FnOnce() + Send>;

/// Reads that have not ended, by their folder.
type LateReads<T> = Mutex<HashMap<PathBuf, Receiver<T>>>;

/// Reads folders on threads of its own.
#[derive(Debug)]
pub(super) struct FolderReads {
    /// Time until a read is left alone.
    limit: Duration,
    /// A thread without work.
    idle: Mutex<Option<SyncSender<Job>>>,
    manifests: LateReads<io::Result<bool>>,
    lists: LateReads<Result<Vec<PathBuf>, StoreError>>,
    cities: LateReads<Result<Option<CityStore>, StoreError>>,
}

impl Default for FolderReads {
    fn default() -> Self {
        Self {
            limit: MAX_OPENING_TIME,
            idle: Mutex::default(),
            manifests: Mutex::default(),
            lists: Mutex::default(),
            cities: Mutex::default(),
        }
    }
}

impl FolderReads {
    /// Whether a folder has a manifest. Fails if that cannot be known.
    pub(super) fn has_manifest(&self, folder: &Path) -> Result<bool, StoreError> {
        let manifest = folder.join(MANIFEST_FILE);
        let read = move || match fs::metadata(manifest) {
            Ok(metadata) => Ok(metadata.is_file()),
            Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(false),
            Err(error) => Err(error),
        };
        let io_error = |source| StoreError::Io { path: folder.to_owned(), source };
        self.run(&self.manifests, folder, read)?.map_err(io_error)
    }

    /// What is directly inside a folder, by name. Fails if it cannot be read.
    pub(super) fn entries(&self, folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
        let path = folder.to_owned();
        let read = move || {
            if path.is_file() {
                return Err(StoreError::NotAFolder(path));
            }
            let list = || fs::read_dir(&path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>();
            let mut entries = list().map_err(|source| StoreError::Io { path: path.clone(), source })?;
            entries.sort();
            Ok(entries)
        };
        self.run(&self.lists, folder, read)?
    }

    /// The city in a folder; `None` if its files are those of `known`.
    pub(super) fn changed_city(
        &self,
        folder: &Path,
        known: Option<CityStamp>,
    ) -> Result<Option<CityStore>, StoreError> {
        let path = folder.to_owned();
        let read = move || match known {
            Some(known) if CityStamp::of(&path).is_ok_and(|stamp| stamp == known) => Ok(None),
            _ => CityStore::open(&path).map(Some),
        };
        self.run(&self.cities, folder, read)?
    }

    /// Makes a folder one whose city is being read until the returned end of the read gets it.
    #[cfg(test)]
    pub(super) fn hang(&self, folder: &Path) -> SyncSender<Result<Option<CityStore>, StoreError>> {
        let (end, ended) = sync_channel(1);
        self.cities.lock().unwrap().insert(folder.to_owned(), ended);
        end
    }

    /// The result of a read, or of an earlier one of the same folder that was late. Fails if it has not ended in time.
    fn run<T: Send + 'static>(
        &self,
        late: &LateReads<T>,
        folder: &Path,
        read: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, StoreError> {
        let no_response = || StoreError::NoResponse(folder.to_owned());
        let failed = |source| StoreError::Io { path: folder.to_owned(), source };
        let mut waiting = late.lock().unwrap_or_else(PoisonError::into_inner);
        let earlier = waiting.get(folder).map(Receiver::try_recv);
        if let Some(Err(TryRecvError::Empty)) = earlier {
            return Err(no_response());
        }
        waiting.remove(folder);
        let number = waiting.len();
        drop(waiting);
        if let Some(Ok(result)) = earlier {
            return Ok(result);
        }
        if number >= MAX_LATE_READS {
            return Err(no_response());
        }
        let limit = if number < PATIENT_READS { self.limit } else { self.limit.min(SHORT_READ_TIME) };
        let (sender, receiver) = sync_channel(1);
        let job: Job = Box::new(move || {
            // Nobody may wait any more.
            let _ = sender.send(read());
        });
        let worker = self.worker().map_err(failed)?;
        let fault = || failed(io::Error::other("reading it failed; this is a fault of the program"));
        worker.send(job).map_err(|_| fault())?;
        match receiver.recv_timeout(limit) {
            Ok(result) => {
                *self.idle.lock().unwrap_or_else(PoisonError::into_inner) = Some(worker);
                Ok(result)
            }
            Err(RecvTimeoutError::Timeout) => {
                late.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned(), receiver);
                Err(no_response())
            }
            Err(RecvTimeoutError::Disconnected) => Err(fault()),
        }
    }

    /// A thread without work. It ends when what is returned is dropped. Fails if the system refuses a thread.
    fn worker(&self) -> io::Result<SyncSender<Job>> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(worker) = idle {
            return Ok(worker);
        }
        let (worker, jobs) = sync_channel::<Job>(1);
        thread::Builder::new().name("insula-folders".into()).spawn(move || jobs.into_iter().for_each(|job| job()))?;
        Ok(worker)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_read_that_hangs_stops_no_other_and_its_result_is_used_when_it_comes() {
        let mut reads = FolderReads { limit: Duration::ZERO, ..FolderReads::default() };
        let (late, [hung, other]) = (LateReads::default(), ["hung", "other"].map(Path::new));
        let (end, ended) = sync_channel::<()>(0);
        let hang = move || {
            let _ = ended.recv();
            "late"
        };
        assert!(matches!(reads.run(&late, hung, hang), Err(StoreError::NoResponse(_))));
        reads.limit = Duration::MAX;
        assert!(reads.run(&late, hung, || "second").is_err(), "one at a time");
        for _ in 0..2 {
            assert_eq!(reads.run(&late, other, || "read").unwrap(), "read");
        }
        drop(end);
        let result = loop {
            match reads.run(&late, hung, || "second") {
                Ok(result) => break result,
                Err(_) => thread::yield_now(),
            }
        };
        assert_eq!(result, "late");
        assert_eq!(reads.run(&late, hung, || "second").unwrap(), "second");
    }

    #[test]
    fn only_so_many_reads_are_left_alone() {
        let reads = FolderReads::default();
        let (late, mut ends) = (LateReads::default(), Vec::new());
        for number in 0..MAX_LATE_READS {
            let (end, ended) = sync_channel(1);
            ends.push(end);
            late.lock().unwrap().insert(PathBuf::from(number.to_string()), ended);
        }
        assert!(reads.run(&late, Path::new("other"), || "read").is_err());
        ends.pop().unwrap().send("late").unwrap();
        let last = (MAX_LATE_READS - 1).to_string();
        assert_eq!(reads.run(&late, Path::new(&last), || "read").unwrap(), "late");
    }
}
