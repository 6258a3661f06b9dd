//! Accepts connections on a listener and passes them to the workers, until shutdown.

use super::{
    access_control::AccessControl,
    reload::ReloadTask,
    service::HttpService,
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

/// Of `limits.connections`, this fraction (1/n) may be open in addition to be rejected with 503. Further connections wait in
/// the system's accept queue.
const OVER_LIMIT_FRACTION: usize = 4;
/// Pause after a failed `accept`: the usual cause is a temporary lack of file descriptors.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(100);

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    #[error("cannot use tls.certificate or tls.key: {0}; both must be PEM files")]
    Tls(io::Error),
    #[error("cannot use access.tokens: {0}")]
    Tokens(io::Error),
    #[error("cannot start the server's threads: {0}")]
    System(#[from] io::Error),
}

/// A configured server that does not listen yet.
#[derive(Debug)]
pub struct HttpServer {
    service: HttpService,
    tls: Option<Arc<TlsIdentity>>,
    config: ServeConfig,
    reload_signal: Arc<Notify>,
}

/// Serves the cities of `store` on `listener` until `shutdown` completes. Then it accepts no more connections, gives requests
/// in flight `config.drain_secs` to finish, and drops the rest. Fails if a file that the config names cannot be used, or if
/// the system refuses threads.
pub async fn serve(
    listener: TcpListener,
    store: Store,
    config: &ServeConfig,
    shutdown: impl Future<Output = ()>,
) -> Result<(), ServeError> {
    HttpServer::new(store, config)?.run(listener, shutdown).await
}

impl HttpServer {
    /// Reads certificate, key and tokens. Fails if one of them is configured and cannot be used.
    pub fn new(store: Store, config: &ServeConfig) -> Result<Self, ServeError> {
        let tls = TlsIdentity::load(&config.tls).map_err(ServeError::Tls)?.map(Arc::new);
        let access = AccessControl::load(&config.access).map_err(ServeError::Tokens)?;
        let service = HttpService::new(AppState::with_access(store, config, access));
        Ok(Self { service, tls, config: config.clone(), reload_signal: Arc::default() })
    }

    /// State that all requests share.
    pub fn state(&self) -> &AppState {
        self.service.state()
    }

    /// `https` or `http`.
    pub fn scheme(&self) -> &'static str {
        if self.tls.is_some() { "https" } else { "http" }
    }

    /// Notify it to make the server check at once for new cities, certificate and tokens.
    pub fn reload_signal(&self) -> Arc<Notify> {
        Arc::clone(&self.reload_signal)
    }

    /// Serves as [`serve`] does. Fails if the system refuses threads.
    pub async fn run(self, listener: TcpListener, shutdown: impl Future<Output = ()>) -> Result<(), ServeError> {
        let workers = WorkerPool::start(&self.service, self.tls.as_ref(), &self.config)?;
        let reload = ReloadTask::new(self.state().clone(), self.tls.clone(), self.config.clone(), self.reload_signal());
        let reload = tokio::spawn(reload.run());
        let acceptor = ConnectionAcceptor::new(listener, self.config.limits.connections);
        let mut shutdown = pin!(shutdown);
        loop {
            let accepted = tokio::select! {
                () = &mut shutdown => break,
                accepted = acceptor.accept() => accepted,
            };
            match accepted {
                Ok(connection) => {
                    if !workers.assign(connection).await {
                        break;
                    }
                }
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    sleep(ACCEPT_RETRY_DELAY).await;
                }
            }
        }
        drop(acceptor);
        reload.abort();
        self.state().start_draining();
        tracing::info!("shutting down: waiting for requests in flight");
        workers.join().await;
        Ok(())
    }
}

/// A listener that bounds the number of open connections.
struct ConnectionAcceptor {
    listener: TcpListener,
    served: Arc<Semaphore>,
    over_limit: Arc<Semaphore>,
}

impl ConnectionAcceptor {
    fn new(listener: TcpListener, connections: usize) -> Self {
        let served = Arc::new(Semaphore::new(connections));
        Self { listener, served, over_limit: Arc::new(Semaphore::new((connections / OVER_LIMIT_FRACTION).max(1))) }
    }

    /// Waits for a free slot and a connection. Fails if the system cannot accept.
    async fn accept(&self) -> io::Result<AcceptedConnection> {
        // Only this task takes permits, so the one seen here is still free below.
        tokio::select! {
            permit = self.served.acquire() => permit.map(drop),
            permit = self.over_limit.acquire() => permit.map(drop),
        }
        .map_err(io::Error::other)?;
        let (stream, peer) = self.listener.accept().await?;
        let (permit, over_limit) = match Arc::clone(&self.served).try_acquire_owned() {
            Ok(permit) => (permit, false),
            Err(_) => (Arc::clone(&self.over_limit).try_acquire_owned().map_err(io::Error::other)?, true),
        };
        Ok(AcceptedConnection { stream: deregister(stream)?, ip: Some(peer.ip()), over_limit, permit })
    }
}

/// Takes a stream off this thread's event loop, so that a worker can add it to its own.
fn deregister(stream: TcpStream) -> io::Result<std::net::TcpStream> {
    // Tiles are small: waiting for full packets would only delay them. An error means a closed connection, found later.
    let _ = stream.set_nodelay(true);
    stream.into_std()
}
