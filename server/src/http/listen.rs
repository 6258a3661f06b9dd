//! The router on a port, until it is told to stop.
//!
//! In: a bound listener, a store, a future that ends when the server shall. Out: nothing once every answer is out, or the
//! time for that is over. Next: the process ends, or the client that embeds it.

use super::{AppState, app};
use crate::{config::Config, store::Store};
use axum::Router;
use hyper_util::{
    rt::{TokioExecutor, TokioIo, TokioTimer},
    server::{conn::auto, graceful::GracefulShutdown},
    service::TowerToHyperService,
};
use std::{future::Future, io, pin::pin, sync::Arc, time::Duration};
use tokio::{
    net::{TcpListener, TcpStream},
    sync::Semaphore,
    task::JoinSet,
    time::{sleep, timeout},
};

/// Connections at once; more wait in the system's queue.
const MAX_CONNECTIONS: usize = 8192;
/// A connection that has not sent a request's headers for so long is closed.
const HEADER_READ_SECS: u64 = 60;
/// HTTP/2 connections are asked so often whether they live.
const PING_SECS: u64 = 30;

/// Serves the cities of `store` on `listener` until `shutdown` ends; then accepts no more, lets requests in flight finish
/// for at most `config.drain_secs`, and drops the rest. Errors: none that a server does not survive; the type is kept for
/// what may come.
pub async fn serve(
    listener: TcpListener,
    store: Store,
    config: &Config,
    shutdown: impl Future<Output = ()>,
) -> io::Result<()> {
    let state = AppState::new(store, config.max_in_flight);
    let service = app(state.clone());
    let graceful = GracefulShutdown::new();
    let slots = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let mut connections = JoinSet::new();
    let mut shutdown = pin!(shutdown);
    loop {
        let accepted = tokio::select! {
            () = &mut shutdown => break,
            Some(_) = connections.join_next() => continue,
            accepted = accept(&listener, &slots) => accepted,
        };
        let (stream, slot) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                // Mostly a lack of file descriptors, which passes.
                tracing::warn!(%error, "cannot accept a connection");
                sleep(Duration::from_millis(100)).await;
                continue;
            }
        };
        let connection = connection(stream, service.clone(), graceful.watcher());
        connections.spawn(async move {
            connection.await;
            drop(slot);
        });
    }
    drop(listener);
    state.drain();
    tracing::info!(connections = connections.len(), "shutting down: finishing what is in flight");
    if timeout(Duration::from_secs(config.drain_secs), graceful.shutdown()).await.is_err() {
        tracing::warn!("some requests did not finish in time and were dropped");
    }
    connections.shutdown().await;
    Ok(())
}

async fn accept(
    listener: &TcpListener,
    slots: &Arc<Semaphore>,
) -> io::Result<(TcpStream, tokio::sync::OwnedSemaphorePermit)> {
    let slot = Arc::clone(slots).acquire_owned().await.map_err(io::Error::other)?;
    let (stream, _) = listener.accept().await?;
    // Tiles are small: waiting for fuller packets would only delay them. A peer that is gone already fails later.
    let _ = stream.set_nodelay(true);
    Ok((stream, slot))
}

/// One connection, HTTP/1.1 or HTTP/2 by its first bytes.
async fn connection(stream: TcpStream, service: Router, watcher: hyper_util::server::graceful::Watcher) {
    let mut builder = auto::Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(Duration::from_secs(HEADER_READ_SECS));
    builder.http2().timer(TokioTimer::new()).keep_alive_interval(Duration::from_secs(PING_SECS));
    let connection = builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(service));
    if let Err(error) = watcher.watch(connection.into_owned()).await {
        tracing::debug!(%error, "a connection ended early");
    }
}
