//! One connection: HTTP/1.1 or HTTP/2 by its first bytes, and what its client may take its time for.
//!
//! In: a stream. Out: nothing, once it has ended or been closed. Next: `app` answers each request on it.

use super::{connection_state::ConnectionState, problem::Problem, service::HttpService};
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
    pin::{Pin, pin},
    sync::Arc,
    task::{Context, Poll, ready},
    time::Duration,
};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// Answers of a thread in a row.
const TURN: u32 = 32;
/// HTTP/2 connections are asked so often whether they live.
const PING: Duration = Duration::from_secs(30);

/// How a connection's settings reach hyper; made once a thread.
pub(super) fn builder(app: &HttpService) -> auto::Builder<TokioExecutor> {
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
pub(super) async fn serve<S>(
    stream: S,
    builder: &auto::Builder<TokioExecutor>,
    app: HttpService,
    client: Arc<ConnectionState>,
) where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let stream = MonitoredStream { stream, client: client.clone(), refusal: None };
    let of = client.clone();
    let service = service_fn(move |request: Request<Incoming>| app.answer(Some(&of), request.into_parts().0));
    let mut connection = pin!(builder.serve_connection(TokioIo::new(stream), service));
    let mut told = false;
    let ended = poll_fn(|context| {
        client.set_waker(context.waker());
        if client.is_finishing() && !told {
            told = true;
            connection.as_mut().graceful_shutdown();
        }
        connection.as_mut().poll(context)
    });
    if let Err(error) = ended.await {
        tracing::debug!(%error, "a connection ended early");
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

/// A stream that tells a [`ConnectionState`] what goes over it, and puts hyper's own refusals into words.
struct MonitoredStream<S> {
    stream: S,
    client: Arc<ConnectionState>,
    refusal: Option<RejectionRewrite>,
}

/// An answer that is written in place of hyper's: how much of it is out.
struct RejectionRewrite {
    raw: Vec<u8>,
    out: usize,
}

impl RejectionRewrite {
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

impl<S: AsyncWrite + Unpin> MonitoredStream<S> {
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

impl<S: AsyncRead + Unpin> AsyncRead for MonitoredStream<S> {
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

impl<S: AsyncWrite + Unpin> AsyncWrite for MonitoredStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if self.refusal.is_none() {
            self.refusal = RejectionRewrite::of(bytes);
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
            self.refusal = slices.first().and_then(|head| RejectionRewrite::of(head));
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
