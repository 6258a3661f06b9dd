//! The search of a city without a server: its index is read in one piece at the first search.

use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_archive::{
    city::{MAX_SEARCH_BYTES, SEARCH_FILE},
    file::open_regular,
};
use insula_objects::search::{SearchHit, SearchIndex};
use insula_viewer::{
    scene::TileKey,
    source::{BoxFuture, PendingTile, TileSource, Transport, archive::ArchivedCity},
    streamer::FetchError,
};
use std::{
    io::{self, Read},
    path::{Path, PathBuf},
    sync::Arc,
};
use tokio::sync::OnceCell;

/// Where the index is.
enum IndexFile {
    Local(PathBuf),
    Web(String),
}

/// A city in a folder or on a plain host.
pub struct SearchableCity {
    inner: ArchivedCity,
    file: IndexFile,
    http: Arc<Http>,
    /// `None` if the city has no index.
    index: OnceCell<Option<SearchIndex<Bytes>>>,
}

impl SearchableCity {
    /// The city in `folder`.
    pub fn in_folder(inner: ArchivedCity, folder: &Path, http: &Arc<Http>) -> Self {
        Self::new(inner, IndexFile::Local(folder.join(SEARCH_FILE)), http)
    }

    /// The city at `base`, an address without a slash at its end.
    pub fn on_host(inner: ArchivedCity, base: &str, http: &Arc<Http>) -> Self {
        Self::new(inner, IndexFile::Web(format!("{base}/{SEARCH_FILE}")), http)
    }

    fn new(inner: ArchivedCity, file: IndexFile, http: &Arc<Http>) -> Self {
        Self { inner, file, http: Arc::clone(http), index: OnceCell::new() }
    }

    async fn read(&self) -> Result<Option<SearchIndex<Bytes>>, FetchError> {
        let read = match &self.file {
            IndexFile::Local(path) => self.read_file(path.clone()).await,
            IndexFile::Web(url) => Transport::get(&*self.http, url.clone(), MAX_SEARCH_BYTES as usize).await,
        };
        let bytes = match read {
            Err(FetchError::Missing) => return Ok(None),
            read => read?,
        };
        let open =
            move || SearchIndex::open(bytes).map_err(|error| FetchError::Archive(format!("{SEARCH_FILE}: {error}")));
        // Its checksum covers up to 256 MiB.
        tokio::task::spawn_blocking(open).await.map_err(|error| FetchError::Unusable(error.to_string()))?.map(Some)
    }

    async fn read_file(&self, path: PathBuf) -> Result<Bytes, FetchError> {
        let unusable = {
            let path = path.display().to_string();
            move |error: &dyn std::fmt::Display| FetchError::Unusable(format!("{path}: {error}"))
        };
        let read = tokio::task::spawn_blocking(move || {
            let mut bytes = Vec::new();
            open_regular(&path)?.take(MAX_SEARCH_BYTES + 1).read_to_end(&mut bytes)?;
            Ok(bytes)
        });
        match read.await.map_err(|error| unusable(&error))? {
            Ok(bytes) if bytes.len() as u64 > MAX_SEARCH_BYTES => {
                Err(unusable(&"larger than 256 MiB: bake the city again"))
            }
            Ok(bytes) => {
                self.http.carry(bytes.len()).await?;
                Ok(bytes.into())
            }
            Err(error) if io::Error::kind(&error) == io::ErrorKind::NotFound => Err(FetchError::Missing),
            Err(error) => Err(unusable(&error)),
        }
    }
}

impl TileSource for SearchableCity {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        self.inner.tile(key)
    }

    fn search<'a>(&'a self, query: &'a str, limit: usize) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        Box::pin(async move {
            let index = self.index.get_or_try_init(|| self.read()).await?;
            Ok(index.as_ref().map(|index| index.search(query, limit)))
        })
    }

    fn location(&self) -> &str {
        self.inner.location()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::source::folder;
    use insula_objects::search::SearchIndexBuilder;
    use std::fs;

    fn search(folder: &Path, query: &str) -> Result<Option<Vec<SearchHit>>, FetchError> {
        let http = Http::new(None).unwrap().into();
        let city = SearchableCity::in_folder(folder::open(folder, &http), folder, &http);
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
