//! Accepts connections on a listener and passes them to the workers, until shutdown.

use super::access_control::AccessControl;
use super::client_usage::{ClientSlot, ClientTable, ConnectionClass};
use super::reload::{ReloadTask, report_failures};
use super::service::HttpService;
use super::state::{AppState, MessageKind};
use super::tls::TlsIdentity;
use super::worker::{AcceptedConnection, WorkerPool};
use crate::config::ServeConfig;
use crate::page::{Brand, ViewerAssets};
use crate::store::Store;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::future::Future;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::time::{sleep, timeout};
use tower::ServiceExt;

/// Of `limits.connections`, this fraction (1/n) may be open in addition: their requests are rejected with 503, except for health
/// and metrics. Further connections wait in the system's accept queue.
const OVER_LIMIT_FRACTION: usize = 4;
/// Further connections, for clients that have their share of both kinds and may still ask for health.
const RESERVED_CONNECTIONS: usize = 16;
/// Pause after a failed `accept`: the usual cause is a temporary lack of file descriptors.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(100);

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    #[error("cannot use tls.certificate or tls.key: {0}; both must be PEM files")]
    Tls(io::Error),
    /// No token and no key could be read: private cities could not be opened.
    #[error("cannot use access.tokens or access.share_keys: {0}")]
    Access(String),
    #[error("cannot use site.logo {}: {source}", path.display())]
    Logo { path: PathBuf, source: io::Error },
    #[error("cannot listen on metrics_address {address}: {source}; use another one, port 0 picks a free one")]
    Metrics { address: String, source: io::Error },
    #[error("cannot start the server's threads: {0}")]
    System(#[from] io::Error),
}

/// A configured server that does not listen yet.
#[derive(Debug)]
pub struct HttpServer {
    service: HttpService,
    tls: Option<Arc<TlsIdentity>>,
    operations: Option<OperationsListener>,
    config: ServeConfig,
    reload_signal: Arc<Notify>,
}

/// Serves the cities of `store` on `listener` until `shutdown` completes. Then `/readyz` fails, and `config.drain_notice_secs` later it
/// accepts no more connections, gives requests in flight `config.drain_secs` to finish, and drops the rest. Fails if a file that the config names cannot be used, or if
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
    /// Reads certificate, key, tokens and keys of share links, and binds the listener for operators. Fails if one of them is
    /// configured and cannot be used.
    pub fn new(store: Store, config: &ServeConfig) -> Result<Self, ServeError> {
        let tls = TlsIdentity::load(&config.tls).map_err(ServeError::Tls)?.map(Arc::new);
        let (access, faults) = AccessControl::load(&config.access);
        if !access.is_usable() {
            return Err(ServeError::Access(faults.join("; ")));
        }
        for fault in faults {
            tracing::error!(fault, "part of the tokens and keys cannot be used");
        }
        let operations = match &config.metrics_address {
            Some(address) => Some(
                OperationsListener::bind(address)
                    .map_err(|source| ServeError::Metrics { address: address.clone(), source })?,
            ),
            None => None,
        };
        let brand = Brand::load(&config.site)
            .map_err(|source| ServeError::Logo { path: config.site.logo.clone().unwrap_or_default(), source })?;
        let state = AppState::with_access(store, config, access, ViewerAssets::embedded(), brand);
        report_failures(&state, state.catalog().store().failures());
        let service = HttpService::new(state);
        Ok(Self { service, tls, operations, config: config.clone(), reload_signal: Arc::default() })
    }

    /// Address of the listener for operators, if there is one.
    pub fn metrics_address(&self) -> Option<SocketAddr> {
        self.operations.as_ref().map(|operations| operations.address)
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
        let (state, reload_signal) = (self.state().clone(), self.reload_signal());
        let operators = self.service.for_operators();
        let service = if self.operations.is_some() { self.service.without_metrics() } else { self.service };
        let workers = WorkerPool::start(&service, self.tls.as_ref(), &self.config)?;
        let reload = ReloadTask::new(state.clone(), self.tls, self.config.clone(), reload_signal).start()?;
        let operations = self.operations.map(|operations| tokio::spawn(operations.serve(operators)));
        let acceptor = ConnectionAcceptor::new(listener, state.clone());
        // While load balancers notice that the server is not ready, they still send requests.
        let notice = self.config.drain_notice();
        let shutdown = async {
            shutdown.await;
            state.start_draining();
            if !notice.is_zero() {
                tracing::info!(secs = notice.as_secs(), "not ready any more: still accepting connections");
            }
            sleep(notice).await;
        };
        let mut shutdown = pin!(shutdown);
        loop {
            let accepted = tokio::select! {
                () = &mut shutdown => break,
                accepted = acceptor.accept() => accepted,
            };
            match accepted {
                Ok(Some(connection)) => {
                    if !workers.assign(connection).await {
                        break;
                    }
                }
                Ok(None) => state.metrics.connection_refused(),
                Err(error) => {
                    if state.admits_message(MessageKind::FailedAccept) {
                        tracing::warn!(%error, "cannot accept a connection");
                    }
                    sleep(ACCEPT_RETRY_DELAY).await;
                }
            }
        }
        drop(acceptor);
        drop(reload);
        tracing::info!("shutting down: waiting for requests in flight");
        workers.join().await;
        if let Some(operations) = operations {
            operations.abort();
        }
        Ok(())
    }
}

/// A listener that bounds the number of open connections, in total and per client.
struct ConnectionAcceptor {
    listener: TcpListener,
    clients: Arc<ClientTable>,
    served: Arc<Semaphore>,
    over_limit: Arc<Semaphore>,
    reserved: Arc<Semaphore>,
}

impl ConnectionAcceptor {
    fn new(listener: TcpListener, state: AppState) -> Self {
        let connections = state.limits.connections;
        let over_limit = (connections / OVER_LIMIT_FRACTION).max(2);
        Self {
            listener,
            clients: Arc::new(ClientTable::new(&state.limits, over_limit)),
            served: Arc::new(Semaphore::new(connections)),
            over_limit: Arc::new(Semaphore::new(over_limit)),
            reserved: Arc::new(Semaphore::new(RESERVED_CONNECTIONS)),
        }
    }

    /// Waits for a free slot and a connection. `None`: the client has its share of all slots, and the connection was closed.
    /// Fails if the system cannot accept.
    async fn accept(&self) -> io::Result<Option<AcceptedConnection>> {
        // Only this task takes permits, so the one seen here is still free below.
        tokio::select! {
            permit = self.served.acquire() => permit.map(drop),
            permit = self.over_limit.acquire() => permit.map(drop),
        }
        .map_err(io::Error::other)?;
        let (stream, peer) = self.listener.accept().await?;
        let classes = [ConnectionClass::Served, ConnectionClass::OverLimit, ConnectionClass::Reserved];
        let slot = classes.into_iter().find_map(|class| self.slot(peer.ip(), class));
        let Some((permit, client, over_limit)) = slot else { return Ok(None) };
        Ok(Some(AcceptedConnection { stream: deregister(stream)?, ip: peer.ip(), client, over_limit, permit }))
    }

    /// Takes a slot of one class. `None` if there is none, or if the client has its share. Also returns whether the connection's
    /// requests are rejected.
    fn slot(&self, ip: IpAddr, class: ConnectionClass) -> Option<(OwnedSemaphorePermit, ClientSlot, bool)> {
        let permits = match class {
            ConnectionClass::Served => &self.served,
            ConnectionClass::OverLimit => &self.over_limit,
            ConnectionClass::Reserved => &self.reserved,
        };
        let permit = permits.clone().try_acquire_owned().ok()?;
        Some((permit, self.clients.connect(ip, class)?, class != ConnectionClass::Served))
    }
}

/// Takes a stream off this thread's event loop, so that a worker can add it to its own.
fn deregister(stream: TcpStream) -> io::Result<std::net::TcpStream> {
    // Tiles are small: waiting for full packets would only delay them. An error means a closed connection, found later.
    let _ = stream.set_nodelay(true);
    stream.into_std()
}

/// Open connections; further ones are closed at once.
const MAX_CONNECTIONS: usize = 64;
/// Time limit of a connection, which is for one request.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause after a failed `accept`.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// A bound listener for operators that does not accept yet: for health and metrics, apart from the port that clients use.
///
/// It answers however many connections clients have. It speaks plain HTTP/1.1, and belongs to a network that only orchestrator
/// and monitoring reach.
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
