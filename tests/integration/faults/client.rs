//! An HTTP client that checks the tiles that it gets.

use insula_protocol::tile::TileReader;
use insula_protocol::{TileId, TileKind, route};
use insula_test_support::small_city;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Duration;

/// Longest time for a connection and for each part of a response. Only a hang takes as long.
const PATIENCE: Duration = Duration::from_secs(60);

pub(super) struct Response {
    pub(super) status: u16,
    pub(super) body: Vec<u8>,
}

/// A connection that is kept between requests.
pub(super) struct Connection {
    address: SocketAddr,
    stream: Option<BufReader<TcpStream>>,
}

impl Connection {
    pub(super) fn new(address: SocketAddr) -> Self {
        Self { address, stream: None }
    }

    /// Fails without a connection and if the response is incomplete; the next request opens a new connection.
    pub(super) fn get(&mut self, path: &str) -> io::Result<Response> {
        let response = self.try_get(path);
        if response.is_err() {
            self.stream = None;
        }
        response
    }

    fn try_get(&mut self, path: &str) -> io::Result<Response> {
        if self.stream.is_none() {
            let stream = TcpStream::connect_timeout(&self.address, PATIENCE)?;
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.set_nodelay(true)?;
            self.stream = Some(BufReader::new(stream));
        }
        let stream = self.stream.as_mut().unwrap();
        write!(stream.get_mut(), "GET {path} HTTP/1.1\r\nHost: x\r\n\r\n")?;
        let invalid = || io::Error::from(io::ErrorKind::InvalidData);
        let mut line = String::new();
        stream.read_line(&mut line)?;
        let status = line.split(' ').nth(1).and_then(|code| code.parse().ok()).ok_or_else(invalid)?;
        let (mut length, mut is_closed) = (0, false);
        loop {
            line.clear();
            if stream.read_line(&mut line)? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            let lower = line.trim().to_ascii_lowercase();
            if lower.is_empty() {
                break;
            }
            if let Some(value) = lower.strip_prefix("content-length:") {
                length = value.trim().parse().map_err(|_| invalid())?;
            }
            is_closed |= lower == "connection: close";
        }
        let mut body = vec![0; length];
        stream.read_exact(&mut body)?;
        if is_closed {
            self.stream = None;
        }
        Ok(Response { status, body })
    }

    /// Whether a tile is served with valid checksums. Fails as [`Self::get`] does.
    pub(super) fn serves(&mut self, kind: TileKind, path: &str) -> io::Result<bool> {
        let response = self.get(path)?;
        Ok(response.status == 200 && is_intact(kind, &response.body))
    }

    /// Whether all tiles of the small city are served with valid checksums.
    pub(super) fn serves_all(&mut self, version: &str) -> bool {
        tile_paths(version).iter().all(|(kind, path)| self.serves(*kind, path).unwrap_or(false))
    }
}

/// Responses that several clients got together.
#[derive(Default)]
pub(super) struct ResponseCounts {
    pub(super) intact: AtomicU64,
    pub(super) refused: AtomicU64,
    /// Lost connections and incomplete responses.
    pub(super) broken: AtomicU64,
    pub(super) wrong: AtomicU64,
}

impl ResponseCounts {
    /// Number of requests that have ended.
    pub(super) fn all(&self) -> u64 {
        [&self.intact, &self.refused, &self.broken, &self.wrong].map(|count| count.load(Relaxed)).iter().sum()
    }
}

/// The paths of all tiles of the small city.
pub(super) fn tile_paths(version: &str) -> Vec<(TileKind, String)> {
    let blockmaps = small_city::blockmaps().into_iter().map(|(id, _)| (TileKind::BlockMap, id));
    let all = blockmaps.chain([(TileKind::Subtree, TileId::ROOT)]);
    all.map(|(kind, id)| (kind, route::tile("two", version, kind, id))).collect()
}

/// Whether every checksum in a tile is right.
pub(super) fn is_intact(kind: TileKind, bytes: &[u8]) -> bool {
    TileReader::new(bytes, kind).is_ok()
}

/// Tells threads to end, also when a test fails: otherwise it would wait for them for ever.
pub(super) struct StopOnDrop<'a>(pub(super) &'a AtomicBool);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

/// Clients that request tiles at the same time.
pub(super) const CLIENTS: u64 = 4;

/// Several clients request all tiles of the small city again and again while `fault` runs.
pub(super) fn request_during(address: SocketAddr, fault: impl FnOnce(&ResponseCounts)) -> ResponseCounts {
    let (counts, stop) = (ResponseCounts::default(), AtomicBool::new(false));
    std::thread::scope(|scope| {
        for _ in 0..CLIENTS {
            scope.spawn(|| {
                let mut connection = Connection::new(address);
                while !stop.load(Relaxed) {
                    for (kind, path) in tile_paths(small_city::VERSION) {
                        let count = match connection.get(&path) {
                            Ok(response) if response.status != 200 => &counts.refused,
                            Ok(response) if is_intact(kind, &response.body) => &counts.intact,
                            Ok(_) => &counts.wrong,
                            Err(_) => {
                                std::thread::sleep(Duration::from_millis(5));
                                &counts.broken
                            }
                        };
                        count.fetch_add(1, Relaxed);
                    }
                }
            });
        }
        let _stop = StopOnDrop(&stop);
        fault(&counts);
    });
    assert_eq!(counts.wrong.load(Relaxed), 0, "wrong bytes were served");
    counts
}
