//! A slow link: a TCP proxy with a bandwidth shared by all connections and a delay each way.

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

/// Bytes that pass at once; small, so that connections share the link fairly.
const CHUNK_BYTES: usize = 1460;
/// Chunks under way in one direction of one connection: the link's buffer.
const CHUNKS: usize = 32;

/// What a link is like.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// Towards the client, all connections together.
    pub bits_per_sec: f64,
    pub round_trip: Duration,
}

#[derive(Debug)]
struct Shared {
    upstream: SocketAddr,
    link: Link,
    /// When the link is free again.
    free_at: Mutex<Instant>,
    bytes: AtomicU64,
    connections: AtomicU64,
    cut_short: AtomicU64,
}

/// A running proxy; its connections end with it.
pub struct Proxy {
    pub address: SocketAddr,
    shared: Arc<Shared>,
    runtime: Option<Runtime>,
}

impl Proxy {
    /// Listens on a free port and forwards to `upstream`, which need not be there all the time.
    pub fn start(upstream: SocketAddr, link: Link) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let shared = Arc::new(Shared {
            upstream,
            link,
            free_at: Mutex::new(Instant::now()),
            bytes: AtomicU64::new(0),
            connections: AtomicU64::new(0),
            cut_short: AtomicU64::new(0),
        });
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0"))?;
        let address = listener.local_addr()?;
        runtime.spawn(accept(listener, shared.clone()));
        Ok(Self { address, shared, runtime: Some(runtime) })
    }

    /// Bytes that have reached the client.
    pub fn bytes(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
    }

    pub fn connections(&self) -> u64 {
        self.shared.connections.load(Ordering::Relaxed)
    }

    /// Connections that the client closed while an answer was on its way.
    pub fn cut_short(&self) -> u64 {
        self.shared.cut_short.load(Ordering::Relaxed)
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
    let up = pass(from_client, to_server, shared.clone(), false);
    let down = pass(from_server, to_client, shared.clone(), true);
    tokio::join!(up, down);
    Ok(())
}

/// Forwards one direction: each chunk arrives half a round trip after it was sent, and no faster than the link lets it.
async fn pass(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, shared: Arc<Shared>, to_client: bool) {
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
                shared.slot(chunk.len()).await;
            }
            if to.write_all(&chunk).await.is_err() {
                shared.cut_short.fetch_add(u64::from(to_client), Ordering::Relaxed);
                receiver.close();
                return;
            }
            shared.bytes.fetch_add(if to_client { chunk.len() as u64 } else { 0 }, Ordering::Relaxed);
        }
        let _ = to.shutdown().await;
    };
    tokio::select! {
        () = write => {}
        // All is read: what is under way still has to arrive, which `write` sees to when it is polled on.
        () = async { read.await; std::future::pending::<()>().await } => {}
    }
}

impl Shared {
    /// Waits until the link has carried `bytes` more.
    async fn slot(&self, bytes: usize) {
        let takes = Duration::from_secs_f64(bytes as f64 * 8.0 / self.link.bits_per_sec);
        let mut free_at = self.free_at.lock().await;
        let at = (*free_at).max(Instant::now()) + takes;
        *free_at = at;
        drop(free_at);
        sleep_until(at).await;
    }
}
