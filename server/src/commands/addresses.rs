//! Reads city files from web servers and buckets for `bake` and `inspect`.

use super::work_store::{io_error, open_bucket};
use futures_util::{StreamExt, TryStreamExt};
use insula_bake::read::{AddressReader, ListedObject};
use object_store::{ObjectMeta, ObjectStore, ObjectStoreExt as _, aws::AmazonS3, path::Path as ObjectPath};
use std::{
    cell::RefCell,
    collections::{HashMap, hash_map::Entry},
    io,
    ops::Range,
    time::Duration,
};

/// Time to connect, and between two parts of a response.
const TIMEOUT: Duration = Duration::from_secs(30);
const MAX_REDIRECTS: usize = 5;

/// The addresses that this program reads: each thread has its own client.
#[derive(Debug)]
pub(super) struct Addresses;

/// A client, and the runtime that drives it.
struct Fetcher {
    runtime: tokio::runtime::Runtime,
    client: reqwest::Client,
    buckets: HashMap<String, AmazonS3>,
}

impl Fetcher {
    fn new() -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        insula_command_line::tls::choose_cryptography();
        let client = reqwest::Client::builder()
            .connect_timeout(TIMEOUT)
            .read_timeout(TIMEOUT)
            .redirect(reqwest::redirect::Policy::limited(MAX_REDIRECTS))
            .user_agent(concat!("insula/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(io::Error::other)?;
        Ok(Self { runtime, client, buckets: HashMap::new() })
    }

    async fn get(&self, url: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
        let response = self.client.get(url).send().await.map_err(io::Error::other)?;
        if !response.status().is_success() {
            let not_found = matches!(response.status().as_u16(), 404 | 410);
            let kind = if not_found { io::ErrorKind::NotFound } else { io::ErrorKind::Other };
            return Err(io::Error::new(kind, format!("{url}: the server answers {}", response.status())));
        }
        let (mut bytes, mut parts) = (Vec::new(), response.bytes_stream());
        while let Some(part) = parts.next().await {
            bytes.extend_from_slice(&part.map_err(io::Error::other)?);
            if bytes.len() as u64 > max_bytes {
                return Err(io::Error::other(format!("{url}: more than {max_bytes} bytes")));
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
            Entry::Vacant(place) => place.insert(open_bucket(bucket)?),
        };
        self.runtime.block_on(ask(store.clone(), path)).map_err(io_error)
    }
}

/// Calls `use_it` with this thread's client. Fails if there can be none.
fn with_fetcher<T>(use_it: impl FnOnce(&mut Fetcher) -> io::Result<T>) -> io::Result<T> {
    thread_local! {
        static FETCHER: RefCell<Option<Fetcher>> = const { RefCell::new(None) };
    }
    FETCHER.with_borrow_mut(|fetcher| {
        let fetcher = match fetcher {
            Some(fetcher) => fetcher,
            None => fetcher.insert(Fetcher::new()?),
        };
        use_it(fetcher)
    })
}

impl AddressReader for Addresses {
    fn fetch(&self, url: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
        with_fetcher(|fetcher| fetcher.runtime.block_on(fetcher.get(url, max_bytes)))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<ListedObject>> {
        let list = async |store: AmazonS3, prefix: ObjectPath| {
            let found: Vec<ObjectMeta> = store.list(Some(&prefix)).try_collect().await?;
            let object = |meta: &ObjectMeta| {
                let parts = meta.location.prefix_match(&prefix)?;
                let name = parts.map(|part| part.as_ref().to_owned()).collect::<Vec<_>>().join("/");
                Some(ListedObject { name, bytes: meta.size })
            };
            Ok(found.iter().filter_map(object).collect())
        };
        let mut objects: Vec<ListedObject> = with_fetcher(|fetcher| fetcher.wait(folder, list))?;
        objects.sort_unstable_by(|a, b| a.name.cmp(&b.name));
        Ok(objects)
    }

    fn size(&self, address: &str) -> io::Result<u64> {
        let head = async |store: AmazonS3, path: ObjectPath| Ok(store.head(&path).await?.size);
        with_fetcher(|fetcher| fetcher.wait(address, head))
    }

    fn range(&self, address: &str, range: Range<u64>) -> io::Result<Vec<u8>> {
        let get = async |store: AmazonS3, path: ObjectPath| Ok(store.get_range(&path, range).await?.into());
        with_fetcher(|fetcher| fetcher.wait(address, get))
    }
}
