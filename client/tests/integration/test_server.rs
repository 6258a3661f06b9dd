//! An HTTP server that responds as a test wants.

use super::fixture_city::Files;
use insula_test_support::http::{self, Request};
use std::collections::HashMap;
use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// How the server responds to a request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Reply {
    Intact,
    /// One flipped bit in the body.
    Damaged,
    /// A status instead of 200.
    Status(u16),
    /// A status and a `Retry-After` header in seconds.
    RetryAfter(u16, u32),
    /// Closes the connection after half of the body.
    Truncated,
    /// Sends 20 bytes a second until the client gives up.
    Trickle,
}

/// Chooses the reply by the path and the number of earlier requests for it.
pub(crate) type ReplyPolicy = dyn Fn(&str, u32) -> Reply + Send + Sync;

/// A server on a free port of this machine.
pub(crate) struct TestServer {
    pub(crate) url: String,
    state: Arc<ServerState>,
}

struct ServerState {
    files: Arc<Files>,
    policy: Box<ReplyPolicy>,
    /// While set, requests get no response, and their connections are closed.
    is_down: AtomicBool,
    connections: AtomicU32,
    requests: AtomicU32,
    /// Number of requests by path.
    log: Mutex<HashMap<String, u32>>,
}

impl TestServer {
    /// A server whose replies are all intact.
    pub(crate) fn start(files: Arc<Files>) -> Self {
        Self::with_policy(files, |_, _| Reply::Intact)
    }

    pub(crate) fn with_policy(files: Arc<Files>, policy: impl Fn(&str, u32) -> Reply + Send + Sync + 'static) -> Self {
        let state = Arc::new(ServerState {
            files,
            policy: Box::new(policy),
            is_down: AtomicBool::new(false),
            connections: AtomicU32::new(0),
            requests: AtomicU32::new(0),
            log: Mutex::default(),
        });
        let shared = state.clone();
        let address = http::serve(move |request, stream| shared.respond(request, stream));
        let url = format!("http://{address}");
        Self { url, state }
    }

    pub(crate) fn set_down(&self, is_down: bool) {
        self.state.is_down.store(is_down, Ordering::Relaxed);
    }

    pub(crate) fn connections(&self) -> u32 {
        self.state.connections.load(Ordering::Relaxed)
    }

    pub(crate) fn requests(&self) -> u32 {
        self.state.requests.load(Ordering::Relaxed)
    }

    /// Number of requests by path.
    pub(crate) fn log(&self) -> HashMap<String, u32> {
        self.state.log.lock().unwrap().clone()
    }
}

impl ServerState {
    /// `None` if the connection is to be closed.
    fn respond(&self, request: &Request, stream: &mut TcpStream) -> Option<()> {
        self.connections.fetch_add(u32::from(request.is_first), Ordering::Relaxed);
        if self.is_down.load(Ordering::Relaxed) {
            return None;
        }
        let path = request.target();
        self.requests.fetch_add(1, Ordering::Relaxed);
        let earlier = {
            let mut log = self.log.lock().unwrap();
            let count = log.entry(path.to_owned()).or_insert(0);
            *count += 1;
            *count - 1
        };
        let reply = (self.policy)(path, earlier);
        let (mut status, mut body) = match self.files.get(path) {
            Some(body) => (200, body.clone()),
            None => (404, Vec::new()),
        };
        let mut headers = String::new();
        match reply {
            Reply::Status(other) => status = other,
            Reply::RetryAfter(other, secs) => (status, headers) = (other, format!("retry-after: {secs}\r\n")),
            Reply::Damaged => {
                let middle = body.len() / 2;
                body.iter_mut().skip(middle).take(1).for_each(|byte| *byte ^= 0x40);
            }
            Reply::Intact | Reply::Truncated | Reply::Trickle => {}
        }
        let head = format!("HTTP/1.1 {status} x\r\n{headers}content-length: {}\r\n\r\n", body.len());
        stream.write_all(head.as_bytes()).ok()?;
        match reply {
            Reply::Truncated => {
                stream.write_all(&body[..body.len() / 2]).ok()?;
                None
            }
            Reply::Trickle => body.iter().try_for_each(|byte| {
                std::thread::sleep(Duration::from_millis(50));
                stream.write_all(&[*byte]).ok()
            }),
            _ => stream.write_all(&body).ok(),
        }
    }
}
