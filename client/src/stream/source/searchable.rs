//! The search of a city in a folder.

use super::folder;
use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_archive::{
    city::{MAX_SEARCH_BYTES, SEARCH_FILE},
    file::open_regular,
};
use insula_objects::search::SearchIndex;
use insula_protocol::{Manifest, manifest::CityMarks};
use insula_viewer::{
    source::FetchError,
    source::{
        TileSource,
        searchable::{SearchableCity, open_index},
    },
};
use std::{
    fmt::Display,
    io::{ErrorKind, Read},
    path::Path,
    sync::Arc,
};

/// The city in `folder`, in the version of its manifest.
pub fn in_folder(folder: &Path, manifest: &Manifest, http: &Arc<Http>) -> impl TileSource + 'static {
    let (archives, marks) = (folder::open(folder, manifest, http), manifest.marks);
    let (file, http) = (folder.join(SEARCH_FILE), Arc::clone(http));
    SearchableCity::new(archives, move || {
        let (file, http) = (file.clone(), Arc::clone(&http));
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
        let city = in_folder(folder, &Manifest { marks, ..empty_manifest(0) }, &http);
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
