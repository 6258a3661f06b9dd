//! A baked city's folder on this machine.

use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_archive::city::{MAX_SEARCH_BYTES, SEARCH_FILE};
use insula_archive::file::open_regular;
use insula_archive::file_source::FileSource;
use insula_archive::joined::joined;
use insula_archive::mark::mark_of;
use insula_archive::{RangeRead, RangeSource, ReadError, SharedSource};
use insula_objects::search::SearchIndex;
use insula_protocol::manifest::CityMarks;
use insula_protocol::release::SharedCity;
use insula_protocol::{Manifest, TileKind};
use insula_viewer::source::archive::{ArchivedCity, open_index, to_read_error};
use insula_viewer::source::{FetchError, ObjectSource};
use std::fmt::Display;
use std::io::{ErrorKind, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// One archive of a folder, opened at the first read. A file that is replaced later is still the one that was opened.
#[derive(Debug, Clone)]
struct FolderArchive {
    path: PathBuf,
    /// Counts the bytes, and simulates a link if one is configured.
    http: Arc<Http>,
    file: Arc<OnceLock<FileSource>>,
}

/// The city in `folder`, in the version of its manifest.
pub fn open(folder: &Path, manifest: &Manifest, http: &Arc<Http>) -> impl ObjectSource + 'static {
    let file = |folder: &Path, kind: TileKind| -> SharedSource {
        Arc::new(FolderArchive { path: folder.join(kind.file_name()), http: http.clone(), file: Arc::default() })
    };
    let beside = folder.join("..");
    let archive = |kind: TileKind| {
        let other = |city: &SharedCity| (file(&beside.join(&city.name), kind), mark_of(&city.version));
        joined(file(folder, kind), &mut manifest.shared().iter().map(other))
    };
    let (marks, file, index_http) = (manifest.marks, folder.join(SEARCH_FILE), Arc::clone(http));
    ArchivedCity::new(folder.display().to_string(), manifest, archive, move || {
        let (file, http) = (file.clone(), Arc::clone(&index_http));
        Box::pin(async move {
            // Its checksum covers up to 256 MiB.
            let place = file.display().to_string();
            let read = tokio::task::spawn_blocking(move || read_index(&file, marks)).await;
            let index = read.map_err(|error| unusable(&place, &error))??;
            if let Some((_, bytes)) = &index {
                http.carry(*bytes).await?;
            }
            Ok(index.map(|(index, _)| index))
        })
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

/// The index of a file and its length; `None` if there is no such file.
fn read_index(file: &Path, marks: Option<CityMarks>) -> Result<Option<(SearchIndex<Bytes>, usize)>, FetchError> {
    let place = file.display().to_string();
    let mut bytes = Vec::new();
    let read = open_regular(file).and_then(|opened| opened.take(MAX_SEARCH_BYTES + 1).read_to_end(&mut bytes));
    match read {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(unusable(&place, &error)),
        Ok(length) if length as u64 > MAX_SEARCH_BYTES => {
            Err(unusable(&place, &"larger than 256 MiB: bake the city again"))
        }
        Ok(length) => Ok(Some((open_index(bytes.into(), marks)?, length))),
    }
}

fn unusable(place: &str, error: &dyn Display) -> FetchError {
    FetchError::Unusable(format!("{place}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::search::{SearchHit, SearchIndexBuilder};
    use insula_test_support::small_city::empty_manifest;
    use std::fs;

    fn search(folder: &Path, query: &str) -> Result<Option<Vec<SearchHit>>, FetchError> {
        search_marked(folder, query, None)
    }

    fn search_marked(
        folder: &Path,
        query: &str,
        marks: Option<CityMarks>,
    ) -> Result<Option<Vec<SearchHit>>, FetchError> {
        let http = Http::new(None).unwrap().into();
        let city = open(folder, &Manifest { marks, ..empty_manifest(0) }, &http);
        http.block_on(city.search(query, 5))
    }

    #[test]
    fn the_index_of_a_folder_is_searched() {
        let folder = tempfile::tempdir().unwrap();
        let mut builder = SearchIndexBuilder::new();
        builder.add("Oude Delft 95", 7);
        builder.add("Markt 1", 8);
        fs::write(folder.path().join(SEARCH_FILE), builder.finish().unwrap()).unwrap();
        let hits = search(folder.path(), "delft").unwrap().unwrap();
        assert_eq!(hits.iter().map(|hit| hit.object).collect::<Vec<_>>(), [7]);
        assert_eq!(search(folder.path(), "kerk").unwrap(), Some(Vec::new()));
        let other = Some(CityMarks { search_index: Some(1) });
        let error = search_marked(folder.path(), "delft", other).unwrap_err();
        assert!(error.to_string().contains("another bake"), "{error}");
    }

    #[test]
    fn a_city_without_an_index_has_no_search_and_a_damaged_one_fails() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(search(folder.path(), "delft").unwrap(), None);
        fs::write(folder.path().join(SEARCH_FILE), b"INSX and more").unwrap();
        let error = search(folder.path(), "delft").unwrap_err();
        assert!(error.to_string().contains(SEARCH_FILE), "{error}");
    }
}
