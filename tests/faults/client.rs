//! A client that checks what it gets.

use insula_protocol::{TileId, TileKind, route, tile::TileReader};
use std::{
    io::{self, BufRead, BufReader, Read, Write},
    net::{SocketAddr, TcpStream},
    sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    time::Duration,
};

/// What came back.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) body: Vec<u8>,
}

/// One connection that is kept.
pub(crate) struct Connection {
    address: SocketAddr,
    stream: Option<BufReader<TcpStream>>,
}

impl Connection {
    pub(crate) fn new(address: SocketAddr) -> Self {
        Self { address, stream: None }
    }

    /// Errors: no connection, or half an answer; the next request makes a new connection.
    pub(crate) fn get(&mut self, path: &str) -> io::Result<Answer> {
        let answer = self.try_get(path);
        if answer.is_err() {
            self.stream = None;
        }
        answer
    }

    fn try_get(&mut self, path: &str) -> io::Result<Answer> {
        if self.stream.is_none() {
            let stream = TcpStream::connect_timeout(&self.address, Duration::from_secs(5))?;
            stream.set_read_timeout(Some(Duration::from_secs(30)))?;
            stream.set_nodelay(true)?;
            self.stream = Some(BufReader::new(stream));
        }
        let stream = self.stream.as_mut().unwrap();
        write!(stream.get_mut(), "GET {path} HTTP/1.1\r\nHost: x\r\n\r\n")?;
        let bad = || io::Error::from(io::ErrorKind::InvalidData);
        let mut line = String::new();
        stream.read_line(&mut line)?;
        let status = line.split(' ').nth(1).and_then(|code| code.parse().ok()).ok_or_else(bad)?;
        let (mut length, mut close) = (0, false);
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
                length = value.trim().parse().map_err(|_| bad())?;
            }
            close |= lower == "connection: close";
        }
        let mut body = vec![0; length];
        stream.read_exact(&mut body)?;
        if close {
            self.stream = None;
        }
        Ok(Answer { status, body })
    }
}

/// What several clients saw together.
#[derive(Default)]
pub(crate) struct Seen {
    pub(crate) whole: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) broken: AtomicU64,
    pub(crate) wrong: AtomicU64,
}

/// Every address of a city that `common::write_city` wrote, with its layer.
pub(crate) fn addresses(version: &str) -> Vec<(TileKind, String)> {
    let blockmaps = crate::common::blockmaps().into_iter().map(|(id, _)| (TileKind::BlockMap, id));
    let all = blockmaps.chain([(TileKind::Subtree, TileId::ROOT)]);
    all.map(|(layer, id)| (layer, route::tile("two", version, layer, id))).collect()
}

/// Whether every checksum in a tile is right.
pub(crate) fn is_whole(layer: TileKind, bytes: &[u8]) -> bool {
    let kind = if layer == TileKind::Subtree { TileKind::Subtree } else { TileKind::BlockMap };
    TileReader::new(bytes, kind).is_ok()
}

/// Four clients ask for all tiles, again and again, while `fault` happens.
pub(crate) fn while_asking(address: SocketAddr, fault: impl FnOnce()) -> Seen {
    let (seen, stop) = (Seen::default(), AtomicBool::new(false));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let mut connection = Connection::new(address);
                while !stop.load(Relaxed) {
                    for (layer, path) in addresses(crate::common::VERSION) {
                        let count = match connection.get(&path) {
                            Ok(answer) if answer.status == 200 && is_whole(layer, &answer.body) => &seen.whole,
                            Ok(answer) if answer.status == 200 => &seen.wrong,
                            Ok(_) => &seen.refused,
                            Err(_) => {
                                std::thread::sleep(Duration::from_millis(5));
                                &seen.broken
                            }
                        };
                        count.fetch_add(1, Relaxed);
                    }
                }
            });
        }
        fault();
        stop.store(true, Relaxed);
    });
    seen
}
