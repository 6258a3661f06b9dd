//! One connection: HTTP/1.1 or HTTP/2 by its first bytes, and what its client may take its time for.
//!
//! In: a stream. Out: nothing, once it has ended or been closed. Next: `app` answers each request on it.

use super::{App, Problem};
use axum::http::{Request, StatusCode};
use hyper::{body::Incoming, service::service_fn};
use hyper_util::{
    rt::{TokioExecutor, TokioIo, TokioTimer},
    server::conn::auto,
};
use std::{
    cell::Cell,
    future::{Future, poll_fn},
    io::{self, IoSlice},
    net::IpAddr,
    pin::{Pin, pin},
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed},
    },
    task::{Context, Poll, Waker, ready},
    time::Duration,
};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// A client that takes fewer bytes than this in `limits.write_secs`, while more wait for it, is too slow.
const LEAST_TAKEN_BYTES: u64 = 16 << 10;
/// Answers of a thread in a row.
const TURN: u32 = 32;
/// HTTP/2 connections are asked so often whether they live.
const PING: Duration = Duration::from_secs(30);

/// How a connection's settings reach hyper; made once a thread.
pub(super) fn builder(app: &App) -> auto::Builder<TokioExecutor> {
    let limits = app.state().limits();
    let mut builder = auto::Builder::new(TokioExecutor::new());
    // `worker` looks at the clock for all: that costs less than a timer for each request.
    builder.http1().header_read_timeout(None).max_buf_size(limits.header_bytes);
    builder
        .http2()
        .timer(TokioTimer::new())
        .keep_alive_interval(PING)
        .max_concurrent_streams(limits.streams)
        .max_header_list_size(limits.header_bytes as u32);
    builder
}

/// Serves one connection until it ends, or its client was told to finish and has.
pub(super) async fn serve<S>(stream: S, builder: &auto::Builder<TokioExecutor>, app: App, client: Arc<Client>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let stream = Watched { stream, client: client.clone(), refusal: None };
    let of = client.clone();
    let service = service_fn(move |request: Request<Incoming>| app.answer(Some(&of), request.into_parts().0));
    let mut connection = pin!(builder.serve_connection(TokioIo::new(stream), service));
    let mut told = false;
    let ended = poll_fn(|context| {
        client.set_waker(context.waker());
        if client.finishing.load(Relaxed) && !told {
            told = true;
            connection.as_mut().graceful_shutdown();
        }
        connection.as_mut().poll(context)
    });
    if let Err(error) = ended.await {
        tracing::debug!(%error, "a connection ended early");
    }
}

/// What is known of a connection. Times are the clock's milliseconds; 0 is never.
#[derive(Debug)]
pub(super) struct Client {
    ip: Option<IpAddr>,
    over: bool,
    /// The thread's, which `worker` sets a few times a second: who looks often need not ask the system.
    clock: Arc<AtomicU64>,
    patience: Patience,
    /// Requests in work.
    busy: AtomicU32,
    several: AtomicBool,
    /// When the last request was done; that of a new connection never was.
    idle_since: AtomicU64,
    /// When the first byte after that came.
    first_byte: AtomicU64,
    /// Since when bytes wait that the client does not take, and how many it took since.
    stalled_since: AtomicU64,
    taken_bytes: AtomicU64,
    slow: OnceLock<&'static str>,
    finishing: AtomicBool,
    waker: OnceLock<Waker>,
}

/// How long a client may take.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patience {
    pub(super) header: Duration,
    pub(super) idle: Duration,
    pub(super) write: Duration,
}

impl Client {
    /// `over`: the connection is one too many, and each request on it is told so.
    pub(super) fn new(ip: Option<IpAddr>, over: bool, clock: Arc<AtomicU64>, patience: Patience) -> Self {
        let now = clock.load(Relaxed);
        Self {
            ip,
            over,
            clock,
            patience,
            busy: AtomicU32::new(0),
            several: AtomicBool::new(false),
            idle_since: AtomicU64::new(0),
            first_byte: AtomicU64::new(now),
            stalled_since: AtomicU64::new(0),
            taken_bytes: AtomicU64::new(0),
            slow: OnceLock::new(),
            finishing: AtomicBool::new(false),
            waker: OnceLock::new(),
        }
    }

    pub(super) fn ip(&self) -> Option<IpAddr> {
        self.ip
    }

    pub(super) fn over(&self) -> bool {
        self.over
    }

    /// At what the client was too slow, if it was.
    pub(super) fn slow(&self) -> Option<&'static str> {
        self.slow.get().copied()
    }

    /// A task has one waker as long as it lives.
    fn set_waker(&self, waker: &Waker) {
        if self.waker.get().is_none() {
            let _ = self.waker.set(waker.clone());
        }
    }

    /// The request in work is the last one.
    pub(super) fn finish(&self) {
        self.finishing.store(true, Relaxed);
        if let Some(waker) = self.waker.get() {
            waker.wake_by_ref();
        }
    }

    fn now(&self) -> u64 {
        self.clock.load(Relaxed)
    }

    /// A request has come.
    pub(super) fn begin(&self) {
        // Several at once: HTTP/2, whose connection speaks between requests too.
        if self.busy.fetch_add(1, Relaxed) > 0 {
            self.several.store(true, Relaxed);
        }
        self.first_byte.store(0, Relaxed);
    }

    /// It is done.
    pub(super) fn end(&self) {
        if self.busy.fetch_sub(1, Relaxed) == 1 {
            self.idle_since.store(self.now(), Relaxed);
        }
    }

    fn read(&self) {
        if self.busy.load(Relaxed) == 0 && self.first_byte.load(Relaxed) == 0 {
            self.first_byte.store(self.now(), Relaxed);
        }
    }

    /// `taken` of `offered` bytes went out; `None`: none can.
    fn wrote(&self, taken: Option<usize>, offered: usize) {
        match taken {
            Some(taken) if taken == offered => self.flow(),
            Some(taken) => {
                let taken = taken as u64;
                if self.taken_bytes.fetch_add(taken, Relaxed) + taken >= LEAST_TAKEN_BYTES {
                    self.stall();
                }
            }
            None if self.stalled_since.load(Relaxed) == 0 => self.stall(),
            None => {}
        }
    }

    fn flow(&self) {
        let stalled = self.stalled_since.swap(0, Relaxed) != 0;
        if stalled && self.first_byte.load(Relaxed) != 0 {
            // What came meanwhile could not be read: its time begins now.
            self.first_byte.store(self.now(), Relaxed);
        }
    }

    fn stall(&self) {
        self.taken_bytes.store(0, Relaxed);
        self.stalled_since.store(self.now(), Relaxed);
    }

    /// Whether the client has been too slow, and at what.
    pub(super) fn is_too_slow(&self) -> bool {
        let Patience { header, idle, write } = self.patience;
        let now = self.now();
        let past = |since: u64, limit: Duration| since != 0 && now.saturating_sub(since) > limit.as_millis() as u64;
        let quiet = self.busy.load(Relaxed) == 0 && self.stalled_since.load(Relaxed) == 0;
        let kind = if past(self.stalled_since.load(Relaxed), write) {
            "reading"
        } else if quiet && !self.several.load(Relaxed) && past(self.first_byte.load(Relaxed), header) {
            "headers"
        } else if quiet && past(self.idle_since.load(Relaxed), idle) {
            "idle"
        } else {
            return false;
        };
        // It is said once.
        let _ = self.slow.set(kind);
        true
    }
}

/// To be called after an answer: each [`TURN`] of them, whoever waits for this core runs first.
///
/// A thread that always has something to answer never sleeps, and the kernel lets others wait for its whole time slices:
/// with a client on the same two cores that was 8 ms at the 99th percentile, and is one.
fn give_way() {
    thread_local!(static WRITTEN: Cell<u32> = const { Cell::new(0) });
    let written = WRITTEN.get() + 1;
    if written < TURN {
        WRITTEN.set(written);
    } else {
        WRITTEN.set(0);
        std::thread::yield_now();
    }
}

/// A stream that tells a [`Client`] what goes over it, and puts hyper's own refusals into words.
struct Watched<S> {
    stream: S,
    client: Arc<Client>,
    refusal: Option<Refusal>,
}

/// An answer that is written in place of hyper's: how much of it is out.
struct Refusal {
    raw: Vec<u8>,
    out: usize,
}

impl Refusal {
    /// hyper answers what is no request by itself: a status without a body. All others of our answers have an id.
    fn of(head: &[u8]) -> Option<Self> {
        let ours = || head.windows(12).any(|window| window.eq_ignore_ascii_case(b"x-request-id"));
        let problem = match head.get(..12)? {
            b"HTTP/1.1 400" if !ours() => Problem::bad_request("this is not HTTP, or not whole"),
            b"HTTP/1.1 414" if !ours() => Problem::new(StatusCode::URI_TOO_LONG, "the address is too long"),
            b"HTTP/1.1 431" if !ours() => {
                Problem::new(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE, "the request's headers are too large")
            }
            _ => return None,
        };
        Some(Self { raw: problem.raw(), out: 0 })
    }
}

impl<S: AsyncWrite + Unpin> Watched<S> {
    /// Writes the rest of a refusal; then `offered` bytes of what it replaces count as written.
    fn refuse(&mut self, context: &mut Context<'_>, offered: usize) -> Poll<io::Result<usize>> {
        while let Some(refusal) = &mut self.refusal {
            let written = ready!(Pin::new(&mut self.stream).poll_write(context, &refusal.raw[refusal.out..]))?;
            refusal.out += written;
            if refusal.out >= refusal.raw.len() || written == 0 {
                self.refusal = None;
            }
        }
        Poll::Ready(Ok(offered))
    }

    fn watched(&mut self, offered: usize, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        match &written {
            Poll::Ready(Ok(taken)) => {
                self.client.wrote(Some(*taken), offered);
                give_way();
            }
            Poll::Pending => self.client.wrote(None, offered),
            Poll::Ready(Err(_)) => {}
        }
        written
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.stream).poll_read(context, buffer))?;
        if buffer.filled().len() > before {
            self.client.read();
        }
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if self.refusal.is_none() {
            self.refusal = Refusal::of(bytes);
        }
        let written = match self.refusal {
            Some(_) => self.refuse(context, bytes.len()),
            None => Pin::new(&mut self.stream).poll_write(context, bytes),
        };
        self.watched(bytes.len(), written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let offered = slices.iter().map(|slice| slice.len()).sum();
        if self.refusal.is_none() {
            self.refusal = slices.first().and_then(|head| Refusal::of(head));
        }
        let written = match self.refusal {
            Some(_) => self.refuse(context, offered),
            None => Pin::new(&mut self.stream).poll_write_vectored(context, slices),
        };
        self.watched(offered, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
