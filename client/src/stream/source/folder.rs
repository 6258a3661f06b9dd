//! A baked city's folder on this machine.

use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_archive::{RangeRead, RangeSource, ReadError, file_source::FileSource};
use insula_protocol::Manifest;
use insula_viewer::source::archive::{ArchivedCity, to_read_error};
use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

/// One archive of a folder, opened at the first read. A file that is replaced later is still the one that was opened.
#[derive(Debug, Clone)]
struct FolderArchive {
    path: PathBuf,
    /// Counts the bytes, and simulates a link if one is configured.
    http: Arc<Http>,
    file: Arc<OnceLock<FileSource>>,
}

/// The city in `folder`, in the version of its manifest.
pub fn open(folder: &Path, manifest: &Manifest, http: &Arc<Http>) -> ArchivedCity {
    ArchivedCity::new(folder.display().to_string(), manifest, |kind| {
        Arc::new(FolderArchive { path: folder.join(kind.file_name()), http: http.clone(), file: Arc::default() })
    })
}

impl FolderArchive {
    fn read_file(&self, range: Range<u64>) -> Result<Bytes, ReadError> {
        if self.file.get().is_none() {
            // Another thread may have opened it meanwhile.
            let _ = self.file.set(FileSource::open(&self.path)?);
        }
        let file = self.file.get().ok_or(ReadError::Missing)?;
        file.read(range).ready()
    }
}

impl RangeSource for FolderArchive {
    fn length(&self) -> Option<u64> {
        self.file.get().and_then(RangeSource::length)
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        let archive = self.clone();
        RangeRead::Pending(Box::pin(async move {
            let unusable =
                |error: &dyn std::fmt::Display| ReadError::Unusable(format!("{}: {error}", archive.path.display()));
            let reader = archive.clone();
            let read = tokio::task::spawn_blocking(move || reader.read_file(range)).await;
            let bytes = read.map_err(|error| unusable(&error))?.map_err(|error| unusable(&error))?;
            archive.http.carry(bytes.len()).await.map_err(to_read_error)?;
            Ok(bytes)
        }))
    }
}
