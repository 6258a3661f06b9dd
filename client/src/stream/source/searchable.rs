//! The search of a city in a folder.

use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_archive::{
    city::{MAX_SEARCH_BYTES, SEARCH_FILE},
    file::open_regular,
};
use insula_objects::search::SearchIndex;
use insula_viewer::{
    source::FetchError,
    source::{
        TileSource,
        archive::ArchivedCity,
        searchable::{SearchableCity, open_index},
    },
};
use std::{
    fmt::Display,
    io::{ErrorKind, Read},
    path::Path,
    sync::Arc,
};

/// The city whose archives are in `folder`.
pub fn in_folder(archives: ArchivedCity, folder: &Path, http: &Arc<Http>) -> impl TileSource + 'static {
    let (file, http) = (folder.join(SEARCH_FILE), Arc::clone(http));
    SearchableCity::new(archives, move || {
        let (file, http) = (file.clone(), Arc::clone(&http));
        Box::pin(async move {
            // Its checksum covers up to 256 MiB.
            let place = file.display().to_string();
            let read = tokio::task::spawn_blocking(move || read_index(&file)).await;
            let index = read.map_err(|error| unusable(&place, &error))??;
            if let Some((_, bytes)) = &index {
                http.carry(*bytes).await?;
            }
            Ok(index.map(|(index, _)| index))
        })
    })
}

/// The index of a file and its length; `None` if there is no such file.
fn read_index(file: &Path) -> Result<Option<(SearchIndex<Bytes>, usize)>, FetchError> {
    let place = file.display().to_string();
    let mut bytes = Vec::new();
    let read = open_regular(file).and_then(|opened| opened.take(MAX_SEARCH_BYTES + 1).read_to_end(&mut bytes));
    match read {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(unusable(&place, &error)),
        Ok(length) if length as u64 > MAX_SEARCH_BYTES => {
            Err(unusable(&place, &"larger than 256 MiB: bake the city again"))
        }
        Ok(length) => Ok(Some((open_index(bytes.into())?, length))),
    }
}

fn unusable(place: &str, error: &dyn Display) -> FetchError {
    FetchError::Unusable(format!("{place}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::source::folder;
    use insula_objects::search::{SearchHit, SearchIndexBuilder};
    use std::fs;

    fn search(folder: &Path, query: &str) -> Result<Option<Vec<SearchHit>>, FetchError> {
        let http = Http::new(None).unwrap().into();
        let city = in_folder(folder::open(folder, "", &http), folder, &http);
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
