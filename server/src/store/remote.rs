//! Cities in object stores (`s3://BUCKET/PATH`) and behind web servers that answer ranges (`https://HOST/PATH`).
//!
//! In: a URL. Out: a [`CityStore`] whose archives are read by blocks. Next: `Store` holds it like any other.
//!
//! CityArchives are looked for in a folder of the version's name below the city's URL first, so that a new version can be put
//! beside the old one and `city.json` last: whoever reads never sees half of it.

use super::{
    Archive, CityStore, MANIFEST_FILE, StoreError,
    blocks::{Blocks, Object},
    city::{CityArchives, CityStamp, parse_manifest},
    source::{Read, ReadError, Source},
};
use insula_protocol::{codec::bincode, route::Layer};
use object_store::{
    ClientOptions, GetOptions, ObjectStore, ObjectStoreExt as _, RetryConfig, aws::AmazonS3Builder, http::HttpBuilder,
    path::Path,
};
use std::{future::Future, ops::Range, pin::Pin, sync::Arc, time::Duration};

const CONNECT: Duration = Duration::from_secs(5);

/// A city's URL, its store and its place in it.
#[derive(Debug, Clone)]
pub(super) struct Remote {
    url: String,
    store: Arc<dyn ObjectStore>,
    folder: Path,
    blocks: Arc<Blocks>,
}

impl Remote {
    /// Errors: not a URL of a kind that is known.
    pub(super) fn new(url: &str, blocks: Arc<Blocks>) -> Result<Self, StoreError> {
        let wrong = |reason: String| StoreError::Remote { url: url.to_owned(), reason };
        let failed = |error: object_store::Error| wrong(error.to_string());
        let url = url.trim_end_matches('/');
        let (scheme, rest) = url.split_once("://").ok_or_else(|| wrong("not a URL".into()))?;
        let (host, folder) = rest.split_once('/').unwrap_or((rest, ""));
        // `Blocks` asks again; two who do that would multiply.
        let retry = RetryConfig { max_retries: 0, ..RetryConfig::default() };
        let options = ClientOptions::new().with_connect_timeout(CONNECT).with_allow_http(true);
        let store: Arc<dyn ObjectStore> = match scheme {
            "s3" => {
                let builder = AmazonS3Builder::from_env().with_bucket_name(host);
                Arc::new(builder.with_retry(retry).with_client_options(options).build().map_err(failed)?)
            }
            "http" | "https" => {
                let builder = HttpBuilder::new().with_url(format!("{scheme}://{host}"));
                Arc::new(builder.with_retry(retry).with_client_options(options).build().map_err(failed)?)
            }
            _ => return Err(wrong("only s3, http and https are known".into())),
        };
        let folder = Path::parse(folder).map_err(|error| wrong(error.to_string()))?;
        Ok(Self { url: url.to_owned(), store, folder, blocks })
    }

    pub(super) fn url(&self) -> &str {
        &self.url
    }

    /// Opens what is there now, unless it is what `known` says.
    pub(super) async fn open(&self, known: Option<&CityStamp>) -> Result<Option<CityStore>, StoreError> {
        let failed =
            |error: object_store::Error| StoreError::Remote { url: self.url.clone(), reason: error.to_string() };
        let path = self.folder.clone().join(MANIFEST_FILE);
        let got = self.blocks.patiently(|| self.store.get_opts(&path, GetOptions::default())).await.map_err(failed)?;
        let wrong = |reason| StoreError::Manifest { place: format!("{}/{MANIFEST_FILE}", self.url), reason };
        if got.meta.size > bincode::LIMIT as u64 {
            return Err(wrong(format!("a manifest is at most {} bytes", bincode::LIMIT)));
        }
        let text = got.bytes().await.map_err(failed)?;
        let stamp = CityStamp::Remote(blake3::hash(&text));
        if known == Some(&stamp) {
            return Ok(None);
        }
        let manifest = parse_manifest(&text).map_err(wrong)?;
        let archive = |layer| self.archive(&manifest.version, layer);
        let missing = |layer: Layer| StoreError::Remote {
            url: format!("{}/{}", self.url, layer.file_name()),
            reason: "there is no such file".into(),
        };
        let archives = CityArchives {
            subtrees: archive(Layer::Subtrees).await?.ok_or_else(|| missing(Layer::Subtrees))?,
            blockmaps: archive(Layer::BlockMaps).await?.ok_or_else(|| missing(Layer::BlockMaps))?,
            meshes: archive(Layer::Meshes).await?,
        };
        CityStore::new(self.url.clone(), stamp, manifest, archives).map(Some)
    }

    /// `None`: there is no such file.
    async fn archive(&self, version: &str, layer: Layer) -> Result<Option<Archive>, StoreError> {
        let place = format!("{}/{}", self.url, layer.file_name());
        let mut path = self.folder.clone().join(version).join(layer.file_name());
        let mut meta = self.blocks.patiently(|| self.store.head(&path)).await;
        if matches!(meta, Err(object_store::Error::NotFound { .. })) {
            path = self.folder.clone().join(layer.file_name());
            meta = self.blocks.patiently(|| self.store.head(&path)).await;
        }
        // Stores that may not be listed call what is not there forbidden.
        let forbidden = matches!(meta, Err(object_store::Error::PermissionDenied { .. })) && !layer.is_always_there();
        if forbidden || matches!(meta, Err(object_store::Error::NotFound { .. })) {
            return Ok(None);
        }
        let meta = meta.map_err(|error| StoreError::Remote { url: place.clone(), reason: error.to_string() })?;
        let about = format!("{}/{path} {:?} {} {}", self.url, meta.e_tag, meta.size, meta.last_modified);
        let hash = blake3::hash(about.as_bytes());
        let hash = hash.as_bytes()[..16].iter().fold(0, |hash, byte| hash << 8 | u128::from(*byte));
        let object = Object { store: self.store.clone(), path, tag: meta.e_tag, file_bytes: meta.size, hash };
        let source = RemoteSource { object: Arc::new(object), blocks: self.blocks.clone() };
        let archive = Archive::load(Arc::new(source)).await;
        archive.map(Some).map_err(|source| StoreError::Archive { place, source })
    }
}

/// An archive in a store.
#[derive(Debug)]
struct RemoteSource {
    object: Arc<Object>,
    blocks: Arc<Blocks>,
}

impl Source for RemoteSource {
    fn file_bytes(&self) -> u64 {
        self.object.file_bytes
    }

    fn read(&self, range: Range<u64>) -> Read {
        if range.end > self.object.file_bytes || range.start > range.end {
            return Read::Now(Err(ReadError::Failed("the range lies outside of the file".into())));
        }
        let (object, blocks) = (self.object.clone(), self.blocks.clone());
        Read::Later(Box::pin(async move { blocks.read(&object, range).await }))
    }

    fn forget(&self, range: Range<u64>) -> Pin<Box<dyn Future<Output = ()> + Send + '_>> {
        Box::pin(self.blocks.forget(&self.object, range))
    }
}
