//! The listener for operators: health and metrics, apart from the port that clients use.
//!
//! It answers however many connections clients have. It speaks plain HTTP/1.1, and belongs to a network that only orchestrator
//! and monitoring reach.

use super::service::HttpService;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tower::ServiceExt;

/// Open connections; further ones are closed at once.
const MAX_CONNECTIONS: usize = 64;
/// Time limit of a connection, which is for one request.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause after a failed `accept`.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// A bound listener that does not accept yet.
#[derive(Debug)]
pub(super) struct OperationsListener {
    listener: std::net::TcpListener,
    pub(super) address: SocketAddr,
}

impl OperationsListener {
    /// Binds `HOST:PORT`. Fails if the system refuses.
    pub(super) fn bind(address: &str) -> io::Result<Self> {
        let listener = std::net::TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address })
    }

    /// Serves until the task is aborted. Fails if the system refuses to watch the listener.
    pub(super) async fn serve(self, service: HttpService) -> io::Result<()> {
        let listener = TcpListener::from_std(self.listener)?;
        let slots = Arc::new(Semaphore::new(MAX_CONNECTIONS));
        let mut builder = http1::Builder::new();
        builder.timer(TokioTimer::new()).keep_alive(false);
        loop {
            let Ok((stream, _)) = listener.accept().await else {
                sleep(RETRY_DELAY).await;
                continue;
            };
            let Ok(slot) = slots.clone().try_acquire_owned() else { continue };
            let service = service.clone();
            let handler =
                service_fn(move |request: Request<Incoming>| service.clone().oneshot(request.map(|_| Body::empty())));
            let connection = builder.serve_connection(TokioIo::new(stream), handler);
            tokio::spawn(async move {
                // A client that is slow or leaves is not worth a message.
                let _ = timeout(CONNECTION_TIMEOUT, connection).await;
                drop(slot);
            });
        }
    }
}
