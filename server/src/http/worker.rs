//! The threads that answer: each has its own connections and never shares them.
//!
//! In: accepted streams. Out: nothing once all are answered. Next: `connection`.
//!
//! A thread with a queue of its own answers a tile without waking another one; streams go to the thread that has fewest.

use super::{
    connection,
    connection_state::{ClientTimeouts, ConnectionState},
    service::HttpService,
    tls::TlsIdentity,
};
use crate::config::ServeConfig;
use hyper_util::{rt::TokioExecutor, server::conn::auto};
use slab::Slab;
use std::{
    io,
    net::{IpAddr, TcpStream},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};
use tokio::{
    sync::{OwnedSemaphorePermit, mpsc, oneshot},
    task::AbortHandle,
    time::{sleep, timeout},
};

/// Streams on their way to a thread.
const QUEUE: usize = 256;

/// A stream and what it holds.
pub(super) struct AcceptedConnection {
    pub(super) stream: TcpStream,
    pub(super) ip: Option<IpAddr>,
    /// One too many: each request is told so.
    pub(super) over: bool,
    pub(super) slot: OwnedSemaphorePermit,
}

/// One thread, seen from outside.
struct WorkerHandle {
    streams: mpsc::Sender<AcceptedConnection>,
    open: Arc<AtomicUsize>,
    ended: oneshot::Receiver<()>,
}

/// All of them.
pub(super) struct WorkerPool(Vec<WorkerHandle>);

impl WorkerPool {
    /// Starts the threads. Errors: the system has no more.
    pub(super) fn start(app: &HttpService, tls: Option<&Arc<TlsIdentity>>, config: &ServeConfig) -> io::Result<Self> {
        let start = |number: usize| {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            let (streams, arriving) = mpsc::channel(QUEUE);
            let (ending, ended) = oneshot::channel();
            let open = Arc::new(AtomicUsize::new(0));
            let house = WorkerState {
                app: app.for_thread(config.worker_threads()),
                tls: tls.cloned(),
                patience: patience(config),
                open: open.clone(),
                clock: Arc::new(AtomicU64::new(1)),
                guests: Mutex::default(),
            };
            let drain = config.drain();
            std::thread::Builder::new().name(format!("insula-serve-{number}")).spawn(move || {
                runtime.block_on(house.run(arriving, drain));
                drop(runtime);
                // Nobody waits any more if the server was dropped.
                let _ = ending.send(());
            })?;
            Ok(WorkerHandle { streams, open, ended })
        };
        (0..config.worker_threads()).map(start).collect::<io::Result<_>>().map(Self)
    }

    /// Gives a stream to the thread that has fewest. `false`: the threads have ended.
    pub(super) async fn give(&self, arrived: AcceptedConnection) -> bool {
        match self.0.iter().min_by_key(|worker| worker.open.load(Relaxed)) {
            Some(worker) => {
                worker.open.fetch_add(1, Relaxed);
                worker.streams.send(arrived).await.is_ok()
            }
            None => false,
        }
    }

    /// Takes no more, and waits until all requests are answered or their time is over.
    pub(super) async fn end(self) {
        let ends: Vec<_> = self.0.into_iter().map(|worker| worker.ended).collect();
        for ended in ends {
            // An error is a thread that has ended too.
            let _ = ended.await;
        }
    }
}

fn patience(config: &ServeConfig) -> ClientTimeouts {
    let limits = &config.limits;
    let [header, idle, write] = [limits.header_secs, limits.idle_secs, limits.write_secs].map(Duration::from_secs);
    ClientTimeouts { header, idle, write }
}

/// What a thread's connections share.
struct WorkerState {
    app: HttpService,
    tls: Option<Arc<TlsIdentity>>,
    patience: ClientTimeouts,
    open: Arc<AtomicUsize>,
    /// Milliseconds since the thread started, and one.
    clock: Arc<AtomicU64>,
    guests: Mutex<Slab<Connection>>,
}

/// A connection and what ends it.
struct Connection {
    client: Arc<ConnectionState>,
    task: AbortHandle,
}

impl WorkerState {
    async fn run(self, mut arriving: mpsc::Receiver<AcceptedConnection>, drain: Duration) {
        let house = Arc::new(self);
        let builder = Arc::new(connection::builder(&house.app));
        let janitor = tokio::spawn(house.clone().look_after());
        while let Some(arrived) = arriving.recv().await {
            house.clone().welcome(arrived, &builder);
        }
        house.lock().iter().for_each(|(_, guest)| guest.client.finish());
        let all_gone = async {
            while !house.lock().is_empty() {
                sleep(Duration::from_millis(10)).await;
            }
        };
        if timeout(drain, all_gone).await.is_err() {
            tracing::warn!("some requests did not finish in time and were dropped");
        }
        janitor.abort();
    }

    fn lock(&self) -> MutexGuard<'_, Slab<Connection>> {
        self.guests.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the clock, and ends connections whose clients are too slow.
    async fn look_after(self: Arc<Self>) {
        let start = Instant::now();
        let ClientTimeouts { header, idle, write } = self.patience;
        let often = (header.min(idle).min(write) / 8).clamp(Duration::from_millis(20), Duration::from_millis(250));
        loop {
            sleep(often).await;
            self.clock.store(start.elapsed().as_millis() as u64 + 1, Relaxed);
            for (_, guest) in self.lock().iter() {
                if guest.client.is_too_slow() {
                    guest.task.abort();
                }
            }
        }
    }

    fn welcome(self: Arc<Self>, arrived: AcceptedConnection, builder: &Arc<auto::Builder<TokioExecutor>>) {
        let AcceptedConnection { stream, ip, over, slot } = arrived;
        let client = Arc::new(ConnectionState::new(ip, over, self.clock.clone(), self.patience));
        self.app.state().metrics().connected(over);
        let (house, builder) = (self.clone(), builder.clone());
        let mut guests = self.lock();
        let entry = guests.vacant_entry();
        let left = ConnectionGuard { house: self.clone(), client: client.clone(), key: entry.key(), _slot: slot };
        let of = client.clone();
        let task = tokio::spawn(async move {
            let left = left;
            house.serve(stream, &builder, of).await;
            drop(left);
        });
        entry.insert(Connection { client, task: task.abort_handle() });
    }

    async fn serve(&self, stream: TcpStream, builder: &auto::Builder<TokioExecutor>, client: Arc<ConnectionState>) {
        let Ok(stream) = tokio::net::TcpStream::from_std(stream) else { return };
        match &self.tls {
            None => connection::serve(stream, builder, self.app.clone(), client).await,
            Some(tls) => match timeout(self.patience.header, tls.accept(stream)).await {
                Ok(Ok(stream)) => connection::serve(stream, builder, self.app.clone(), client).await,
                Ok(Err(error)) => tracing::debug!(%error, "a handshake failed"),
                Err(_) => tracing::debug!("a handshake took too long"),
            },
        }
    }
}

/// Counts a connection until it is gone.
struct ConnectionGuard {
    house: Arc<WorkerState>,
    client: Arc<ConnectionState>,
    key: usize,
    _slot: OwnedSemaphorePermit,
}

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        self.house.lock().try_remove(self.key);
        self.house.open.fetch_sub(1, Relaxed);
        self.house.app.state().metrics().disconnected(self.client.slow());
    }
}
