//! A plain web host with a folder of files: it knows ranges and nothing of cities. It can be ill.

use anyhow::Result;
use std::{
    io::{BufRead, BufReader, Read, Seek, SeekFrom, Write},
    net::{TcpListener, TcpStream},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

/// What a host does with a request for a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manner {
    /// As it should.
    Well,
    /// Answers with the whole file.
    Whole,
    /// Answers another range than was asked for.
    Beside,
    /// Breaks off in the middle of every third answer.
    Breaks,
    /// Every file is another one after so many requests, as its ETag says.
    Replaces(u64),
}

#[derive(Debug)]
struct Shared {
    folder: PathBuf,
    manner: Manner,
    requests: AtomicU64,
}

/// A running host.
#[derive(Debug)]
pub struct Host {
    /// `http://127.0.0.1:PORT`.
    pub url: String,
    shared: Arc<Shared>,
}

impl Host {
    /// Serves `folder` on a free port, until the process ends.
    pub fn start(folder: &Path, manner: Manner) -> Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let url = format!("http://{}", listener.local_addr()?);
        let shared = Arc::new(Shared { folder: folder.to_owned(), manner, requests: AtomicU64::new(0) });
        let served = shared.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let shared = served.clone();
                // A client that goes away ends its connection.
                std::thread::spawn(move || connection(stream, &shared));
            }
        });
        Ok(Self { url, shared })
    }

    /// Requests so far.
    pub fn requests(&self) -> u64 {
        self.shared.requests.load(Ordering::Relaxed)
    }
}

fn connection(mut stream: TcpStream, shared: &Shared) -> Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    loop {
        let (mut path, mut range) = (String::new(), None);
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line)? == 0 {
                return Ok(());
            }
            let line = line.trim_end();
            if line.is_empty() {
                break;
            }
            if path.is_empty() {
                path = line.split(' ').nth(1).unwrap_or("/").trim_start_matches('/').to_owned();
            }
            if let Some(value) = line.to_lowercase().strip_prefix("range: bytes=") {
                range = value.split_once('-').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
            }
        }
        if !answer(&mut stream, shared, &path, range)? {
            return Ok(());
        }
    }
}

/// Whether the connection stays.
fn answer(stream: &mut TcpStream, shared: &Shared, path: &str, range: Option<(u64, u64)>) -> Result<bool> {
    let count = shared.requests.fetch_add(1, Ordering::Relaxed);
    let Ok(mut file) = std::fs::File::open(shared.folder.join(path)) else {
        write!(stream, "HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n")?;
        return Ok(true);
    };
    let whole = file.metadata()?.len();
    let etag = match shared.manner {
        Manner::Replaces(after) if count >= after => "\"new\"",
        _ => "\"old\"",
    };
    let (first, last, status) = match range.filter(|_| shared.manner != Manner::Whole) {
        Some((first, last)) => (first, last.min(whole - 1), "206 Partial Content"),
        None => (0, whole - 1, "200 OK"),
    };
    let shift = u64::from(shared.manner == Manner::Beside && first > 0);
    let mut body = Vec::new();
    file.seek(SeekFrom::Start(first - shift))?;
    file.take(last + 1 - first).read_to_end(&mut body)?;
    write!(stream, "HTTP/1.1 {status}\r\netag: {etag}\r\ncontent-length: {}\r\n", body.len())?;
    if status.starts_with("206") {
        write!(stream, "content-range: bytes {}-{}/{whole}\r\n", first - shift, last - shift)?;
    }
    stream.write_all(b"\r\n")?;
    let breaks = shared.manner == Manner::Breaks && count % 3 == 2;
    stream.write_all(if breaks { &body[..body.len() / 2] } else { &body })?;
    Ok(!breaks)
}
