//! A plain web server with ranges and ETags, and with faults on demand: a store that is slow, failing, gone, or lying.

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    os::unix::fs::FileExt,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    time::Duration,
};

/// What it does, changed while it runs.
#[derive(Default)]
pub(crate) struct Faults {
    /// Of a hundred requests, so many fail: by turns 500, a cut answer, a closed connection.
    pub(crate) failing_percent: AtomicU64,
    /// Before each answer.
    pub(crate) slow_millis: AtomicU64,
    /// Connections are closed at once.
    pub(crate) gone: AtomicBool,
    /// Of a hundred answers, so many have a byte that is wrong.
    pub(crate) lying_percent: AtomicU64,
    requests: AtomicU64,
    fetches: AtomicU64,
}

pub(crate) struct Origin {
    address: SocketAddr,
    pub(crate) faults: Arc<Faults>,
}

impl Origin {
    /// Serves the files of a folder as long as the process lives.
    pub(crate) fn start(folder: &Path) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let (address, faults) = (listener.local_addr().unwrap(), Arc::new(Faults::default()));
        let (of, folder) = (faults.clone(), folder.to_owned());
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let (faults, folder) = (of.clone(), folder.clone());
                std::thread::spawn(move || serve(stream, &folder, &faults));
            }
        });
        Self { address, faults }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Answers with a part of a file, so far.
    #[allow(dead_code, reason = "the load programs do not ask")]
    pub(crate) fn fetches(&self) -> u64 {
        self.faults.fetches.load(Relaxed)
    }
}

fn serve(stream: TcpStream, folder: &Path, faults: &Faults) {
    let mut stream = BufReader::new(stream);
    while answer(&mut stream, folder, faults).is_some() {}
}

/// One request; `None` ends the connection.
fn answer(stream: &mut BufReader<TcpStream>, folder: &Path, faults: &Faults) -> Option<()> {
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        if stream.read_line(&mut line).ok()? == 0 {
            return None;
        }
        if line.trim().is_empty() {
            break;
        }
        lines.push(line.trim().to_owned());
    }
    if faults.gone.load(Relaxed) {
        return None;
    }
    std::thread::sleep(Duration::from_millis(faults.slow_millis.load(Relaxed)));
    let number = faults.requests.fetch_add(1, Relaxed);
    // Spread evenly, and the same each time.
    let chance = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    let mut request = lines.first()?.split(' ');
    let (method, path) = (request.next()?, request.next()?.trim_start_matches('/'));
    let file = folder.join(path);
    let out = stream.get_mut();
    let fails = chance % 100 < faults.failing_percent.load(Relaxed);
    if fails && number.is_multiple_of(3) {
        return None;
    }
    if fails && number % 3 == 1 {
        return out.write_all(b"HTTP/1.1 500 Internal Server Error\r\nContent-Length: 0\r\n\r\n").ok();
    }
    let (Ok(opened), Ok(about)) = (fs::File::open(&file), fs::metadata(&file)) else {
        return out.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n").ok();
    };
    let length = about.len();
    let modified = about.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?.as_nanos();
    let range =
        lines.iter().find_map(|line| line.to_ascii_lowercase().strip_prefix("range: bytes=").map(str::to_owned));
    let (status, first, last) = match range.as_deref().and_then(|range| range.split_once('-')) {
        Some((first, last)) => {
            faults.fetches.fetch_add(1, Relaxed);
            ("206 Partial Content", first.parse().ok()?, last.parse::<u64>().ok()?.min(length - 1))
        }
        None => ("200 OK", 0, length - 1),
    };
    let mut body = vec![0; (last + 1 - first) as usize];
    opened.read_exact_at(&mut body, first).ok()?;
    if chance / 100 % 100 < faults.lying_percent.load(Relaxed) && range.is_some() {
        let at = chance as usize % body.len();
        body[at] ^= 4;
    }
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Length: {}\r\nContent-Range: bytes {first}-{last}/{}\r\nETag: \"{modified:x}\"\r\n\
         Last-Modified: Sat, 21 Nov 2026 08:00:00 GMT\r\n\r\n",
        body.len(),
        length
    );
    out.write_all(head.as_bytes()).ok()?;
    if method != "HEAD" {
        let whole = if fails { &body[..body.len() / 2] } else { &body[..] };
        out.write_all(whole).ok()?;
    }
    (!fails).then_some(())
}
