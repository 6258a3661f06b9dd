//! A baked city's folder on this machine.
//!
//! In: ranges of its archives. Out: bytes. Next: `archive`.

use super::archive::{Archives, Ranges};
use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_viewer::streamer::FetchError;
use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

/// One archive of a folder. `http` counts, and simulates a link if it was told to.
#[derive(Clone)]
pub struct FileRanges {
    path: PathBuf,
    http: Arc<Http>,
    file: Arc<Mutex<Option<File>>>,
}

/// The city in `folder`.
pub fn open(folder: &Path, http: &Arc<Http>) -> Archives<FileRanges> {
    Archives::new(folder.display().to_string(), |layer| FileRanges {
        path: folder.join(layer.file_name()),
        http: http.clone(),
        file: Arc::default(),
    })
}

impl Ranges for FileRanges {
    async fn read(&self, offset: u64, length: usize) -> Result<(Bytes, Option<String>), FetchError> {
        let (path, file) = (self.path.clone(), self.file.clone());
        let read = tokio::task::spawn_blocking(move || read(&path, &file, offset, length));
        let failed = |e: &dyn std::fmt::Display| FetchError::Unusable(format!("{}: {e}", self.path.display()));
        let bytes = read.await.map_err(|e| failed(&e))?.map_err(|e| failed(&e))?;
        self.http.carry(bytes.len()).await?;
        Ok((bytes, None))
    }
}

/// Opens the file once. A file that was replaced meanwhile is still the one that was opened.
fn read(path: &Path, file: &Mutex<Option<File>>, offset: u64, length: usize) -> std::io::Result<Bytes> {
    let mut file = file.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let file = match &mut *file {
        Some(file) => file,
        closed => closed.insert(File::open(path)?),
    };
    file.seek(SeekFrom::Start(offset))?;
    let mut bytes = Vec::new();
    file.take(length as u64).read_to_end(&mut bytes)?;
    Ok(bytes.into())
}
