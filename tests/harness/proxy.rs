//! A slow link: a TCP proxy with a delay in each direction and a bandwidth that all connections share.

use anyhow::Result;
use std::{
    io,
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream, tcp::OwnedReadHalf, tcp::OwnedWriteHalf},
    runtime::Runtime,
    sync::{Mutex, mpsc},
    time::{Instant, sleep_until},
};

/// Bytes that are forwarded at once; few, so that connections share the link fairly.
const CHUNK_BYTES: usize = 1460;
/// Chunks in flight per direction of a connection.
const CHUNKS: usize = 32;

#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// Of all connections together, towards the client.
    pub bits_per_sec: f64,
    pub round_trip: Duration,
}

#[derive(Debug)]
struct Shared {
    upstream: SocketAddr,
    link: Link,
    /// When the link has sent everything that is queued.
    free_at: Mutex<Instant>,
    bytes: AtomicU64,
    connections: AtomicU64,
    aborted: AtomicU64,
}

/// A running proxy. Its connections end when it is dropped.
pub struct Proxy {
    pub address: SocketAddr,
    shared: Arc<Shared>,
    runtime: Option<Runtime>,
}

impl Proxy {
    /// Listens on a free port. Connects to `upstream` for each connection; it need not be reachable all the time.
    pub fn start(upstream: SocketAddr, link: Link) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let shared = Arc::new(Shared {
            upstream,
            link,
            free_at: Mutex::new(Instant::now()),
            bytes: AtomicU64::new(0),
            connections: AtomicU64::new(0),
            aborted: AtomicU64::new(0),
        });
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0"))?;
        let address = listener.local_addr()?;
        runtime.spawn(accept(listener, shared.clone()));
        Ok(Self { address, shared, runtime: Some(runtime) })
    }

    /// Bytes that the client has received.
    pub fn bytes(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
    }

    pub fn connections(&self) -> u64 {
        self.shared.connections.load(Ordering::Relaxed)
    }

    /// Connections that the client closed during a response.
    pub fn aborted(&self) -> u64 {
        self.shared.aborted.load(Ordering::Relaxed)
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

async fn accept(listener: TcpListener, shared: Arc<Shared>) {
    while let Ok((client, _)) = listener.accept().await {
        shared.connections.fetch_add(1, Ordering::Relaxed);
        tokio::spawn(connection(client, shared.clone()));
    }
}

async fn connection(client: TcpStream, shared: Arc<Shared>) -> io::Result<()> {
    let server = TcpStream::connect(shared.upstream).await?;
    client.set_nodelay(true)?;
    server.set_nodelay(true)?;
    let (from_client, to_client) = client.into_split();
    let (from_server, to_server) = server.into_split();
    let up = forward(from_client, to_server, shared.clone(), false);
    let down = forward(from_server, to_client, shared.clone(), true);
    tokio::join!(up, down);
    Ok(())
}

/// Forwards one direction: a chunk arrives half a round trip after it was sent, or when the link has capacity.
async fn forward(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, shared: Arc<Shared>, to_client: bool) {
    let (sender, mut receiver) = mpsc::channel::<(Instant, Vec<u8>)>(CHUNKS);
    let delay = shared.link.round_trip / 2;
    let read = async move {
        let mut chunk = vec![0; CHUNK_BYTES];
        while let Ok(n @ 1..) = from.read(&mut chunk).await {
            if sender.send((Instant::now() + delay, chunk[..n].to_vec())).await.is_err() {
                break;
            }
        }
    };
    let write = async move {
        while let Some((due, chunk)) = receiver.recv().await {
            sleep_until(due).await;
            if to_client {
                shared.wait_for_capacity(chunk.len()).await;
            }
            if to.write_all(&chunk).await.is_err() {
                shared.aborted.fetch_add(u64::from(to_client), Ordering::Relaxed);
                receiver.close();
                return;
            }
            shared.bytes.fetch_add(if to_client { chunk.len() as u64 } else { 0 }, Ordering::Relaxed);
        }
        let _ = to.shutdown().await;
    };
    tokio::select! {
        () = write => {}
        // Everything is read, but chunks in flight must still be written.
        () = async { read.await; std::future::pending::<()>().await } => {}
    }
}

impl Shared {
    /// Waits until the link has sent `bytes` more.
    async fn wait_for_capacity(&self, bytes: usize) {
        let takes = Duration::from_secs_f64(bytes as f64 * 8.0 / self.link.bits_per_sec);
        let mut free_at = self.free_at.lock().await;
        let at = (*free_at).max(Instant::now()) + takes;
        *free_at = at;
        drop(free_at);
        sleep_until(at).await;
    }
}
