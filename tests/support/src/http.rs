//! HTTP servers that respond as a test wants, with a thread for each connection.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;

/// A request without its body.
#[derive(Debug)]
pub struct Request {
    /// The request line, then the headers.
    pub head: Vec<String>,
    /// Whether it is the first of its connection.
    pub is_first: bool,
}

impl Request {
    /// What is requested: a path, with its query.
    pub fn target(&self) -> &str {
        self.head.first().and_then(|line| line.split(' ').nth(1)).unwrap_or_default()
    }
}

/// Responds to all requests at a free port of this machine until the process ends. Where `respond` gives `None`, the connection is closed.
pub fn serve(respond: impl Fn(&Request, &mut TcpStream) -> Option<()> + Send + Sync + 'static) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, respond) = (listener.local_addr().unwrap(), Arc::new(respond));
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let respond = Arc::clone(&respond);
            std::thread::spawn(move || {
                let (mut stream, mut is_first) = (BufReader::new(stream), true);
                while let Some(head) = read_head(&mut stream) {
                    if respond(&Request { head, is_first }, stream.get_mut()).is_none() {
                        return;
                    }
                    is_first = false;
                }
            });
        }
    });
    address
}

/// The whole response to a request after which the server closes the connection.
pub fn exchange(address: SocketAddr, request: &[u8]) -> io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(address)?;
    stream.write_all(request)?;
    let mut response = Vec::new();
    stream.read_to_end(&mut response)?;
    Ok(response)
}

/// The lines of a request's head; `None` if the connection ends.
fn read_head(stream: &mut BufReader<TcpStream>) -> Option<Vec<String>> {
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        if stream.read_line(&mut line).ok()? == 0 {
            return None;
        }
        if line.trim().is_empty() {
            return Some(lines);
        }
        lines.push(line.trim().to_owned());
    }
}
