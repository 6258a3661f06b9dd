//! The server on a port, until it is told to stop.
//!
//! In: a bound listener, a store, a future that ends when the server shall. Out: nothing once every answer is out, or the
//! time for that is over. Next: `worker` takes the connections; the process ends, or the client that embeds it.

use super::{
    access_control::AccessControl,
    reload::ReloadTask,
    service::{HttpService, app},
    state::AppState,
    tls::TlsIdentity,
    worker::{AcceptedConnection, WorkerPool},
};
use crate::{config::ServeConfig, store::Store};
use std::{future::Future, io, pin::pin, sync::Arc, time::Duration};
use tokio::{
    net::{TcpListener, TcpStream},
    sync::{Notify, Semaphore},
    time::sleep,
};

/// Of the connections that are told that there are too many, for each one that is served: the others wait in the system's
/// queue.
const OVER_SHARE: usize = 4;

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The certificate or its key cannot be used.
    #[error("cannot use tls.certificate or tls.key: {0}; both are PEM files")]
    Tls(io::Error),
    /// The tokens cannot be used.
    #[error("cannot use access.tokens: {0}")]
    Tokens(io::Error),
    /// The system refuses threads or a socket.
    #[error("cannot start threads: {0}")]
    System(#[from] io::Error),
}

/// A server that is ready to run.
#[derive(Debug)]
pub struct HttpServer {
    app: HttpService,
    tls: Option<Arc<TlsIdentity>>,
    config: ServeConfig,
    look: Arc<Notify>,
}

/// Serves the cities of `store` on `listener` until `shutdown` ends; then accepts no more, lets requests in flight finish
/// for at most `config.drain_secs`, and drops the rest. Errors: a file that the config names cannot be used.
pub async fn serve(
    listener: TcpListener,
    store: Store,
    config: &ServeConfig,
    shutdown: impl Future<Output = ()>,
) -> Result<(), ServeError> {
    HttpServer::new(store, config)?.run(listener, shutdown).await
}

impl HttpServer {
    /// Reads what the config names. Errors: it cannot be used.
    pub fn new(store: Store, config: &ServeConfig) -> Result<Self, ServeError> {
        let tls = TlsIdentity::read(&config.tls).map_err(ServeError::Tls)?.map(Arc::new);
        let access = AccessControl::read(&config.access).map_err(ServeError::Tokens)?;
        let app = app(AppState::with_access(store, config, access));
        Ok(Self { app, tls, config: config.clone(), look: Arc::default() })
    }

    /// What all requests share.
    pub fn state(&self) -> &AppState {
        self.app.state()
    }

    /// `https` or `http`.
    pub fn scheme(&self) -> &'static str {
        if self.tls.is_some() { "https" } else { "http" }
    }

    /// Notified, it makes the server look at once at its cities, certificate and tokens.
    pub fn look(&self) -> Arc<Notify> {
        Arc::clone(&self.look)
    }

    /// See [`serve`].
    pub async fn run(self, listener: TcpListener, shutdown: impl Future<Output = ()>) -> Result<(), ServeError> {
        let workers = WorkerPool::start(&self.app, self.tls.as_ref(), &self.config)?;
        let watch = ReloadTask::new(self.app.state().clone(), self.tls.clone(), self.config.clone(), self.look());
        let watch = tokio::spawn(watch.run());
        let door = ConnectionAcceptor::new(listener, self.config.limits.connections);
        let mut shutdown = pin!(shutdown);
        loop {
            let accepted = tokio::select! {
                () = &mut shutdown => break,
                accepted = door.accept() => accepted,
            };
            match accepted {
                Ok(arrived) => {
                    if !workers.give(arrived).await {
                        break;
                    }
                }
                Err(error) => {
                    // Mostly a lack of file descriptors, which passes.
                    tracing::warn!(%error, "cannot accept a connection");
                    sleep(Duration::from_millis(100)).await;
                }
            }
        }
        drop(door);
        watch.abort();
        self.app.state().drain();
        tracing::info!("shutting down: finishing what is in flight");
        workers.end().await;
        Ok(())
    }
}

/// Where connections come in, so many at once.
struct ConnectionAcceptor {
    listener: TcpListener,
    served: Arc<Semaphore>,
    over: Arc<Semaphore>,
}

impl ConnectionAcceptor {
    fn new(listener: TcpListener, connections: usize) -> Self {
        let served = Arc::new(Semaphore::new(connections));
        Self { listener, served, over: Arc::new(Semaphore::new((connections / OVER_SHARE).max(1))) }
    }

    async fn accept(&self) -> io::Result<AcceptedConnection> {
        // If there is a place for neither, whoever leaves first makes one. Nobody else takes places.
        tokio::select! {
            place = self.served.acquire() => place.map(drop),
            place = self.over.acquire() => place.map(drop),
        }
        .map_err(io::Error::other)?;
        let (stream, peer) = self.listener.accept().await?;
        let (slot, over) = match Arc::clone(&self.served).try_acquire_owned() {
            Ok(slot) => (slot, false),
            Err(_) => (Arc::clone(&self.over).try_acquire_owned().map_err(io::Error::other)?, true),
        };
        Ok(AcceptedConnection { stream: unbound(stream)?, ip: Some(peer.ip()), over, slot })
    }
}

/// Off this thread's event loop.
fn unbound(stream: TcpStream) -> io::Result<std::net::TcpStream> {
    // Tiles are small: waiting for fuller packets would only delay them. A peer that is gone already fails later.
    let _ = stream.set_nodelay(true);
    stream.into_std()
}
