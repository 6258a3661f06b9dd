//! Reads city files from web servers and buckets for `bake` and `inspect`.

use super::bucket_client::{MAX_OBJECTS, RefusedKeys, list_of};
use super::work_store::{io_error, open_bucket};
use futures_util::StreamExt;
use insula_bake::read::{AddressReader, ListedObject};
use insula_command_line::http::{self, Elsewhere, Redirects};
use insula_protocol::route::{host_of, without_secrets};
use object_store::aws::AmazonS3;
use object_store::path::Path as ObjectPath;
use object_store::{ObjectMeta, ObjectStore, ObjectStoreExt as _};
use reqwest::StatusCode;
use reqwest::header::LOCATION;
use std::cell::RefCell;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io;
use std::ops::Range;
use std::time::{Duration, Instant};

/// Time to connect, and between two parts of a response.
const TIMEOUT: Duration = Duration::from_secs(30);
/// A file may take this long, and longer if it comes with more than [`MIN_BYTES_PER_S`].
const MIN_FILE_TIME: Duration = Duration::from_secs(120);
const MIN_BYTES_PER_S: u64 = 10_000;

/// The addresses that this program reads: each thread has its own client.
#[derive(Debug)]
pub(super) struct Addresses {
    redirects: Redirects,
}

impl Addresses {
    /// Reads addresses until the program ends. Redirects lead to the same host or to one of `hosts`.
    pub(super) fn new(hosts: &[String]) -> &'static Self {
        Box::leak(Box::new(Self { redirects: Redirects::Hosts(hosts.to_vec()) }))
    }

    /// Calls `use_it` with this thread's client. Fails if there can be none.
    fn with_fetcher<T>(&self, use_it: impl FnOnce(&mut Fetcher) -> io::Result<T>) -> io::Result<T> {
        thread_local! {
            static FETCHER: RefCell<Option<Fetcher>> = const { RefCell::new(None) };
        }
        FETCHER.with_borrow_mut(|fetcher| {
            let fetcher = match fetcher {
                Some(fetcher) => fetcher,
                None => fetcher.insert(Fetcher::new(self.redirects.clone())?),
            };
            use_it(fetcher)
        })
    }
}

/// A client, and the runtime that drives it.
struct Fetcher {
    runtime: tokio::runtime::Runtime,
    client: reqwest::Client,
    buckets: HashMap<String, AmazonS3>,
    /// What the lists of the buckets leave out.
    refused: RefusedKeys,
}

impl Fetcher {
    fn new(redirects: Redirects) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let client = http::client(redirects, Elsewhere::Response)
            .connect_timeout(TIMEOUT)
            .read_timeout(TIMEOUT)
            .user_agent(concat!("insula/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(io::Error::other)?;
        Ok(Self { runtime, client, buckets: HashMap::new(), refused: RefusedKeys::default() })
    }

    async fn get(&self, url: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
        let shown = without_secrets(url);
        let network_error = |error: reqwest::Error| io::Error::other(http::cause_of(&error.without_url()));
        let start = Instant::now();
        let response = self.client.get(url).send().await.map_err(network_error)?;
        let status = response.status();
        let to = response.headers().get(LOCATION).and_then(|to| to.to_str().ok());
        if let Some(to) = to.filter(|_| status.is_redirection()) {
            // Other schemes, such as `file:`, are never followed.
            let is_web = ["http://", "https://"].iter().any(|scheme| to.starts_with(scheme));
            let advice = match host_of(to).filter(|_| is_web) {
                Some(host) => format!("allow it with --allow-host {host}"),
                None => "give the address of the file itself".to_owned(),
            };
            let what = format!("{shown} redirects to {}, another host: {advice}", without_secrets(to));
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, what));
        }
        // A part of the file, which nobody asked for, would be taken for all of it.
        if !matches!(status, StatusCode::OK | StatusCode::NON_AUTHORITATIVE_INFORMATION) {
            let not_found = matches!(status.as_u16(), 404 | 410);
            let kind = if not_found { io::ErrorKind::NotFound } else { io::ErrorKind::Other };
            return Err(io::Error::new(kind, format!("{shown}: the server answers {status}")));
        }
        let (mut bytes, mut parts) = (Vec::new(), response.bytes_stream());
        while let Some(part) = parts.next().await {
            bytes.extend_from_slice(&part.map_err(network_error)?);
            let count = bytes.len() as u64;
            if count > max_bytes {
                return Err(io::Error::other(format!("{shown}: more than {max_bytes} bytes")));
            }
            if start.elapsed() > MIN_FILE_TIME.max(Duration::from_secs(count / MIN_BYTES_PER_S)) {
                let what = format!("{shown}: comes with less than {MIN_BYTES_PER_S} bytes a second");
                return Err(io::Error::new(io::ErrorKind::TimedOut, what));
            }
        }
        Ok(bytes)
    }

    /// Waits for what an object of a bucket, or the objects below it, are asked for. Fails if the address is not that of a bucket.
    fn wait<T, F>(&mut self, address: &str, ask: impl FnOnce(AmazonS3, ObjectPath) -> F) -> io::Result<T>
    where
        F: Future<Output = object_store::Result<T>>,
    {
        let invalid = |reason: String| io::Error::new(io::ErrorKind::InvalidInput, reason);
        let rest = address.strip_prefix("s3://").ok_or_else(|| invalid("expected s3://BUCKET/NAME".into()))?;
        let (bucket, name) = rest.split_once('/').unwrap_or((rest, ""));
        let path = ObjectPath::parse(name).map_err(|error| invalid(error.to_string()))?;
        let store = match self.buckets.entry(bucket.to_owned()) {
            Entry::Occupied(store) => store.into_mut(),
            Entry::Vacant(place) => place.insert(open_bucket(bucket, self.refused.clone())?),
        };
        self.runtime.block_on(ask(store.clone(), path)).map_err(io_error)
    }
}

/// What the keys of a folder's objects begin with.
fn key_prefix(folder: &str) -> String {
    let (_, folder) = folder.strip_prefix("s3://").and_then(|rest| rest.split_once('/')).unwrap_or_default();
    let folder = folder.trim_matches('/');
    if folder.is_empty() { String::new() } else { format!("{folder}/") }
}

impl AddressReader for Addresses {
    fn fetch(&self, url: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
        self.with_fetcher(|fetcher| fetcher.runtime.block_on(fetcher.get(url, max_bytes)))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<ListedObject>> {
        let list = async |store: AmazonS3, prefix: ObjectPath| {
            let found = list_of(store.list(Some(&prefix)), MAX_OBJECTS).await?;
            let object = |meta: &ObjectMeta| {
                let parts = meta.location.prefix_match(&prefix)?;
                let name = parts.map(|part| part.as_ref().to_owned()).collect::<Vec<_>>().join("/");
                Some(ListedObject { name, bytes: meta.size })
            };
            Ok(found.iter().filter_map(object).collect())
        };
        let mut objects = self.with_fetcher(|fetcher| {
            let mut objects: Vec<ListedObject> = fetcher.wait(folder, list)?;
            // Those of a list that failed are no longer asked for.
            let refused = fetcher.refused.take();
            let name = |key: &String| Some(key.strip_prefix(&key_prefix(folder))?.to_owned());
            objects.extend(refused.iter().filter_map(name).map(|name| ListedObject { name, bytes: 0 }));
            Ok(objects)
        })?;
        objects.sort_unstable_by(|a, b| a.name.cmp(&b.name));
        Ok(objects)
    }

    fn size(&self, address: &str) -> io::Result<u64> {
        let head = async |store: AmazonS3, path: ObjectPath| Ok(store.head(&path).await?.size);
        self.with_fetcher(|fetcher| fetcher.wait(address, head))
    }

    fn range(&self, address: &str, range: Range<u64>) -> io::Result<Vec<u8>> {
        let get = async |store: AmazonS3, path: ObjectPath| Ok(store.get_range(&path, range).await?.into());
        self.with_fetcher(|fetcher| fetcher.wait(address, get))
    }
}
