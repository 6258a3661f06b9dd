//! Worker threads: each has an event loop of its own and keeps its connections for their whole life.
//!
//! A worker responds with a tile without waking another thread. New connections go to the worker with the fewest.

use super::client_usage::{ClientSlot, client_network};
use super::connection::{self, connection_builder};
use super::connection_state::{ClientTimeouts, ConnectionState};
use super::service::HttpService;
use super::stream_progress::StreamExecutor;
use super::tls::TlsIdentity;
use super::turns::InTurn;
use crate::config::ServeConfig;
use hyper_util::server::conn::auto;
use slab::Slab;
use std::io;
use std::net::{IpAddr, TcpStream};
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicU64, AtomicUsize};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{OwnedSemaphorePermit, mpsc, oneshot};
use tokio::task::AbortHandle;
use tokio::time::{sleep, timeout};

/// Accepted connections that may wait for one worker.
const QUEUE_LENGTH: usize = 256;
/// Tasks that a worker polls before it looks for new connections, and for sockets that have become ready. With tokio's 61,
/// clients wait long for each other's tasks.
const EVENT_INTERVAL: u32 = 16;
/// Interval at which a draining worker checks whether its connections have ended.
const DRAIN_POLL: Duration = Duration::from_millis(10);

/// An accepted stream with its connection permit.
pub(super) struct AcceptedConnection {
    pub(super) stream: TcpStream,
    pub(super) ip: IpAddr,
    pub(super) client: ClientSlot,
    /// There are too many connections: each request on this one is rejected.
    pub(super) over_limit: bool,
    pub(super) permit: OwnedSemaphorePermit,
}

/// The acceptor's side of one worker thread.
struct WorkerHandle {
    connections: mpsc::Sender<AcceptedConnection>,
    open: Arc<AtomicUsize>,
    ended: oneshot::Receiver<()>,
}

pub(super) struct WorkerPool(Vec<WorkerHandle>);

impl WorkerPool {
    /// Starts the threads. Fails if the system refuses one.
    pub(super) fn start(
        service: &HttpService,
        tls: Option<&Arc<TlsIdentity>>,
        config: &ServeConfig,
    ) -> io::Result<Self> {
        let start_worker = |number: usize| {
            let mut runtime = tokio::runtime::Builder::new_current_thread();
            let runtime =
                runtime.enable_all().event_interval(EVENT_INTERVAL).global_queue_interval(EVENT_INTERVAL).build()?;
            let (connections, accepted) = mpsc::channel(QUEUE_LENGTH);
            let (ended_sender, ended) = oneshot::channel();
            let open = Arc::new(AtomicUsize::new(0));
            let state = WorkerState {
                service: service.for_thread(config.worker_threads()),
                tls: tls.cloned(),
                timeouts: client_timeouts(config),
                open: open.clone(),
                clock_ms: Arc::new(AtomicU64::new(1)),
                connections: Mutex::default(),
            };
            let drain_timeout = config.drain_timeout();
            std::thread::Builder::new().name(format!("insula-serve-{number}")).spawn(move || {
                runtime.block_on(state.run(accepted, drain_timeout));
                drop(runtime);
                // Fails if the server was dropped and nothing waits.
                let _ = ended_sender.send(());
            })?;
            Ok(WorkerHandle { connections, open, ended })
        };
        (0..config.worker_threads()).map(start_worker).collect::<io::Result<_>>().map(Self)
    }

    /// Passes a connection to the worker with the fewest. `false`: the workers have ended.
    pub(super) async fn assign(&self, accepted: AcceptedConnection) -> bool {
        match self.0.iter().min_by_key(|worker| worker.open.load(Relaxed)) {
            Some(worker) => {
                worker.open.fetch_add(1, Relaxed);
                worker.connections.send(accepted).await.is_ok()
            }
            None => false,
        }
    }

    /// Makes the workers drain their connections, and waits until all threads have ended.
    pub(super) async fn join(self) {
        // Collected first, so that all senders are dropped before the first wait.
        let ended: Vec<_> = self.0.into_iter().map(|worker| worker.ended).collect();
        for ended in ended {
            // An error means that the thread has panicked, and so has ended as well.
            let _ = ended.await;
        }
    }
}

fn client_timeouts(config: &ServeConfig) -> ClientTimeouts {
    let limits = &config.limits;
    let [header, idle, write] = [limits.header_secs, limits.idle_secs, limits.write_secs].map(Duration::from_secs);
    ClientTimeouts { header, idle, write }
}

/// What the connections of one worker share.
struct WorkerState {
    service: HttpService,
    tls: Option<Arc<TlsIdentity>>,
    timeouts: ClientTimeouts,
    open: Arc<AtomicUsize>,
    /// Milliseconds since the worker started, plus one: 0 is reserved for "never".
    clock_ms: Arc<AtomicU64>,
    connections: Mutex<Slab<Connection>>,
}

/// An open connection and its task.
struct Connection {
    state: Arc<ConnectionState>,
    task: AbortHandle,
}

impl WorkerState {
    async fn run(self, mut accepted: mpsc::Receiver<AcceptedConnection>, drain_timeout: Duration) {
        let worker = Arc::new(self);
        let builder = Arc::new(connection_builder(&worker.service));
        let reaper = tokio::spawn(worker.clone().reap_slow_connections());
        while let Some(connection) = accepted.recv().await {
            worker.clone().spawn_connection(connection, &builder);
        }
        worker.lock().iter().for_each(|(_, connection)| connection.state.start_shutdown());
        let drained = async {
            while !worker.lock().is_empty() {
                sleep(DRAIN_POLL).await;
            }
        };
        if timeout(drain_timeout, drained).await.is_err() {
            tracing::warn!("some requests did not finish in time and were dropped");
        }
        reaper.abort();
    }

    fn lock(&self) -> MutexGuard<'_, Slab<Connection>> {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Advances the clock, and aborts connections whose clients have exceeded a timeout.
    async fn reap_slow_connections(self: Arc<Self>) {
        let start = Instant::now();
        let ClientTimeouts { header, idle, write } = self.timeouts;
        let interval = (header.min(idle).min(write) / 8).clamp(Duration::from_millis(20), Duration::from_millis(250));
        loop {
            sleep(interval).await;
            self.clock_ms.store(start.elapsed().as_millis() as u64 + 1, Relaxed);
            for (_, connection) in self.lock().iter() {
                let reset = connection.state.reset_stalled_streams();
                self.service.state().metrics.streams_reset(reset);
                if connection.state.has_timed_out() {
                    connection.task.abort();
                }
            }
        }
    }

    fn spawn_connection(self: Arc<Self>, accepted: AcceptedConnection, builder: &Arc<auto::Builder<StreamExecutor>>) {
        let AcceptedConnection { stream, ip, client, over_limit, permit } = accepted;
        let (usage, clock_ms) = (client.usage.clone(), self.clock_ms.clone());
        let state = ConnectionState::new(Some(ip), Some(usage), over_limit, clock_ms, self.timeouts);
        let state = Arc::new(state);
        self.service.state().metrics.connection_opened(over_limit);
        let (worker, builder) = (self.clone(), builder.clone());
        let mut connections = self.lock();
        let entry = connections.vacant_entry();
        let guard = ConnectionGuard {
            worker: self.clone(),
            state: state.clone(),
            key: entry.key(),
            _permit: permit,
            _client: client,
        };
        let task_state = state.clone();
        let task = tokio::spawn(InTurn::new(client_network(ip), async move {
            // Moved into the task, so that it is dropped when the task is aborted.
            let guard = guard;
            worker.serve(stream, &builder, task_state).await;
            drop(guard);
        }));
        entry.insert(Connection { state, task: task.abort_handle() });
    }

    async fn serve(&self, stream: TcpStream, builder: &auto::Builder<StreamExecutor>, state: Arc<ConnectionState>) {
        let Ok(stream) = tokio::net::TcpStream::from_std(stream) else { return };
        match &self.tls {
            None => connection::serve(stream, builder, self.service.clone(), state).await,
            Some(tls) => match timeout(self.timeouts.header, tls.accept(stream)).await {
                Ok(Ok(stream)) => connection::serve(stream, builder, self.service.clone(), state).await,
                Ok(Err(error)) => tracing::debug!(%error, "TLS handshake failed"),
                Err(_) => tracing::debug!("TLS handshake timed out"),
            },
        }
    }
}

/// Removes a connection from its worker when dropped.
struct ConnectionGuard {
    worker: Arc<WorkerState>,
    state: Arc<ConnectionState>,
    key: usize,
    _permit: OwnedSemaphorePermit,
    _client: ClientSlot,
}

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        self.worker.lock().try_remove(self.key);
        self.worker.open.fetch_sub(1, Relaxed);
        self.worker.service.state().metrics.connection_closed(self.state.timeout_kind());
    }
}
