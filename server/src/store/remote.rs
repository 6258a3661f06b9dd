//! Cities in object stores (`s3://BUCKET/PATH`) and behind web servers that answer ranges (`https://HOST/PATH`).
//!
//! Archives are looked for in a folder of the version's name below the city's URL first. So a new version can be uploaded
//! beside the old one, and `city.json` last: readers never see half of a version.

use super::city::{CityStamp, CityStore};
use super::error::StoreError;
use super::requests::{RemoteObject, StoreRequests, read_body};
use super::same_host::SameHostConnector;
use super::search::SearchFile;
use insula_archive::block_cache::BlockCache;
use insula_archive::city::{MANIFEST_FILE, MAX_MANIFEST_BYTES, SEARCH_FILE, parse_manifest};
use insula_archive::joined::joined;
use insula_archive::limits::MAX_OPENING_TIME;
use insula_archive::mark::mark_of;
use insula_archive::{Archive, BakedCity, CityArchives, CityError, ReadError};
use insula_protocol::release::SharedCity;
use insula_protocol::route::without_secrets;
use insula_protocol::{Manifest, TileKind};
use object_store::aws::AmazonS3Builder;
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{ClientOptions, GetOptions, ObjectStore, ObjectStoreExt as _, RetryConfig};
use std::sync::Arc;
use std::time::Instant;
use tokio::runtime::Handle;
use tokio::task::{JoinError, spawn_blocking};

/// A city's URL, and where it is in its store.
#[derive(Debug, Clone)]
pub(super) struct RemoteCity {
    pub(super) url: String,
    store: Arc<dyn ObjectStore>,
    folder: Path,
    requests: Arc<StoreRequests>,
    cache: Arc<BlockCache>,
}

impl RemoteCity {
    /// Fails if the URL is of no known kind.
    pub(super) fn new(url: &str, requests: Arc<StoreRequests>, cache: Arc<BlockCache>) -> Result<Self, StoreError> {
        let wrong = |reason: String| StoreError::Remote { url: without_secrets(url).into_owned(), reason };
        if url.contains(['?', '#']) {
            // It would become a part of names, and be shown with them.
            return Err(wrong("an address with a query cannot be served".into()));
        }
        let failed = |error: object_store::Error| wrong(error.to_string());
        let url = url.trim_end_matches('/');
        let (scheme, rest) = url.split_once("://").ok_or_else(|| wrong("not a URL".into()))?;
        let (host, folder) = rest.split_once('/').unwrap_or((rest, ""));
        // `StoreRequests` repeats requests; two layers of retries would multiply.
        let retry = RetryConfig { max_retries: 0, ..RetryConfig::default() };
        let options = ClientOptions::new().with_allow_http(true);
        let connector = SameHostConnector { timeout: requests.timeout };
        let store: Arc<dyn ObjectStore> = match scheme {
            "s3" => {
                insula_command_line::tls::choose_cryptography();
                let builder = AmazonS3Builder::from_env().with_bucket_name(host);
                let builder = builder.with_retry(retry).with_client_options(options);
                Arc::new(builder.with_http_connector(connector).build().map_err(failed)?)
            }
            "http" | "https" => {
                let builder = HttpBuilder::new().with_url(format!("{scheme}://{host}")).with_http_connector(connector);
                Arc::new(builder.with_retry(retry).with_client_options(options).build().map_err(failed)?)
            }
            _ => return Err(wrong("only s3, http and https are known".into())),
        };
        let folder = Path::parse(folder).map_err(|error| wrong(error.to_string()))?;
        Ok(Self { url: url.to_owned(), store, folder, requests, cache })
    }

    /// Opens the current version of the city. `None` if it is the version of `known`.
    pub(super) async fn open(&self, known: Option<&CityStamp>) -> Result<Option<CityStore>, StoreError> {
        let failed =
            |error: object_store::Error| StoreError::Remote { url: self.url.clone(), reason: error.to_string() };
        let path = self.folder.clone().join(MANIFEST_FILE);
        let got = self.requests.retry(|| self.store.get_opts(&path, GetOptions::default())).await.map_err(failed)?;
        let wrong = |reason| CityError::Manifest { location: format!("{}/{MANIFEST_FILE}", self.url), reason };
        if got.meta.size > MAX_MANIFEST_BYTES as u64 {
            return Err(wrong(format!("the manifest is larger than {MAX_MANIFEST_BYTES} bytes")).into());
        }
        // The length above is what the server says.
        let text = read_body(got, MAX_MANIFEST_BYTES).await.map_err(failed)?;
        let stamp = CityStamp::Remote(blake3::hash(&text));
        if known == Some(&stamp) {
            return Ok(None);
        }
        let manifest = parse_manifest(&text).map_err(wrong)?;
        let archive = |kind| self.archive(&manifest, kind);
        let missing = |kind: TileKind| StoreError::Remote {
            url: format!("{}/{}", self.url, kind.file_name()),
            reason: "there is no such file".into(),
        };
        let archives = CityArchives {
            subtrees: archive(TileKind::Subtree).await?.ok_or_else(|| missing(TileKind::Subtree))?,
            blockmaps: archive(TileKind::BlockMap).await?.ok_or_else(|| missing(TileKind::BlockMap))?,
            meshes: archive(TileKind::Mesh).await?,
            objects: archive(TileKind::Objects).await?,
            visibility: archive(TileKind::Visibility).await?,
        };
        let search = self.object(&manifest.version, SEARCH_FILE, false).await?;
        let search = search.map(|object| SearchFile::remote(&self.url, object, Handle::current()));
        Ok(Some(CityStore::new(stamp, BakedCity::new(self.url.clone(), manifest, archives)?).with_search(search)))
    }

    /// Finds a file of a version. `None` if there is no such file.
    async fn object(
        &self,
        version: &str,
        file_name: &str,
        is_required: bool,
    ) -> Result<Option<RemoteObject>, StoreError> {
        let mut path = self.folder.clone().join(version).join(file_name);
        let mut meta = self.requests.retry(|| self.store.head(&path)).await;
        if matches!(meta, Err(object_store::Error::NotFound { .. })) {
            path = self.folder.clone().join(file_name);
            meta = self.requests.retry(|| self.store.head(&path)).await;
        }
        // Stores that may not be listed answer "forbidden" for missing objects.
        let forbidden = matches!(meta, Err(object_store::Error::PermissionDenied { .. })) && !is_required;
        if forbidden || matches!(meta, Err(object_store::Error::NotFound { .. })) {
            return Ok(None);
        }
        let location = || format!("{}/{file_name}", self.url);
        let meta = meta.map_err(|error| StoreError::Remote { url: location(), reason: error.to_string() })?;
        let about = format!("{}/{path} {:?} {} {}", self.url, meta.e_tag, meta.size, meta.last_modified);
        let hash = blake3::hash(about.as_bytes());
        let id = hash.as_bytes()[..16].iter().fold(0, |id, byte| id << 8 | u128::from(*byte));
        let (requests, store) = (self.requests.clone(), self.store.clone());
        Ok(Some(RemoteObject { requests, store, path, tag: meta.e_tag, length: meta.size, id }))
    }

    /// The city of this name in the same folder.
    fn beside(&self, name: &str) -> Self {
        let folder = self.folder.parent().unwrap_or(Path::ROOT).join(name);
        let parent = self.url.rsplit_once('/').map_or("", |(parent, _)| parent);
        Self { url: format!("{parent}/{name}"), folder, ..self.clone() }
    }

    /// Opens one archive, with those of the cities with which it shares tiles. `None` if there is no such file.
    async fn archive(&self, manifest: &Manifest, kind: TileKind) -> Result<Option<Archive>, StoreError> {
        let (location, file) = (format!("{}/{}", self.url, kind.file_name()), kind.file_name());
        let Some(object) = self.object(&manifest.version, file, kind.is_required()).await? else { return Ok(None) };
        let mut shared = Vec::new();
        for SharedCity { name, version } in manifest.shared() {
            let other = self.beside(name);
            let Some(object) = other.object(version, file, kind.is_required()).await? else {
                if kind.is_required() {
                    let reason = format!("there is no such file, and {} has tiles in it", self.url);
                    return Err(StoreError::Remote { url: format!("{}/{file}", other.url), reason });
                }
                break;
            };
            shared.push((self.cache.source(Arc::new(object)), mark_of(version)));
        }
        let source = joined(self.cache.source(Arc::new(object)), &mut shared.into_iter());
        // Directories are parsed on a thread of their own, because this one may accept connections.
        let (runtime, deadline) = (Handle::current(), Instant::now() + MAX_OPENING_TIME);
        let load = move || runtime.block_on(Archive::load(source, Some(deadline)));
        let interrupted = |error: JoinError| Err(ReadError::Failed(error.to_string()).into());
        let archive = spawn_blocking(load).await.unwrap_or_else(interrupted);
        Ok(Some(archive.map_err(|source| CityError::Archive { location, source })?))
    }
}
