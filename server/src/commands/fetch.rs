//! Fetches city files from web servers for `bake` and `inspect`.

use futures_util::StreamExt;
use std::{cell::OnceCell, io, time::Duration};

/// Time to connect, and between two parts of a response.
const TIMEOUT: Duration = Duration::from_secs(30);
const MAX_REDIRECTS: usize = 5;

/// A client, and the runtime that drives it.
struct Fetcher {
    runtime: tokio::runtime::Runtime,
    client: reqwest::Client,
}

impl Fetcher {
    fn new() -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let client = reqwest::Client::builder()
            .connect_timeout(TIMEOUT)
            .read_timeout(TIMEOUT)
            .redirect(reqwest::redirect::Policy::limited(MAX_REDIRECTS))
            .user_agent(concat!("insula/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(io::Error::other)?;
        Ok(Self { runtime, client })
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
}

/// Fetches an address: see [`insula_bake::read::FetchFunction`].
pub(super) fn fetch(url: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
    thread_local! {
        static FETCHER: OnceCell<Fetcher> = const { OnceCell::new() };
    }
    FETCHER.with(|cell| {
        if cell.get().is_none() {
            // Nobody else sets it: the cell is this thread's.
            let _ = cell.set(Fetcher::new()?);
        }
        let Some(fetcher) = cell.get() else { return Err(io::Error::other("no HTTP client")) };
        fetcher.runtime.block_on(fetcher.get(url, max_bytes))
    })
}
