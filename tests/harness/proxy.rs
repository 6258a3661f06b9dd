//! A slow link whose speed does not depend on the machine: a TCP proxy that lets as many bytes of responses through as a test
//! allows.

use anyhow::Result;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::Semaphore;

/// Bytes that are forwarded at once; few, so that connections share the link fairly.
const CHUNK_BYTES: usize = 1460;

#[derive(Debug)]
struct Shared {
    upstream: SocketAddr,
    /// Chunks of responses that may pass. Connections that wait for one get it in turn. Closed when all may pass.
    allowed: Semaphore,
    bytes: AtomicU64,
    connections: AtomicU64,
    closed: AtomicU64,
}

/// A running proxy. Its connections end when it is dropped.
pub struct Proxy {
    /// Where it listens.
    pub address: SocketAddr,
    shared: Arc<Shared>,
    runtime: Option<Runtime>,
}

impl Proxy {
    /// Listens on a free port. Connects to `upstream` for each connection; it need not be reachable all the time. Lets at most
    /// `bytes` of responses through until [`Self::allow`] or [`Self::open`] is called.
    pub fn start(upstream: SocketAddr, bytes: usize) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let shared = Arc::new(Shared {
            upstream,
            allowed: Semaphore::new(bytes.div_ceil(CHUNK_BYTES)),
            bytes: AtomicU64::new(0),
            connections: AtomicU64::new(0),
            closed: AtomicU64::new(0),
        });
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0"))?;
        let address = listener.local_addr()?;
        runtime.spawn(accept(listener, shared.clone()));
        Ok(Self { address, shared, runtime: Some(runtime) })
    }

    /// Lets at most this many bytes of responses through, in place of what is left of those that were allowed before.
    pub fn allow(&self, bytes: usize) {
        self.shared.allowed.forget_permits(Semaphore::MAX_PERMITS);
        self.shared.allowed.add_permits(bytes.div_ceil(CHUNK_BYTES));
    }

    /// Lets everything through from now on.
    pub fn open(&self) {
        self.shared.allowed.close();
    }

    /// Bytes of responses that were let through.
    pub fn bytes(&self) -> u64 {
        self.shared.bytes.load(Relaxed)
    }

    /// Connections of the client so far.
    pub fn connections(&self) -> u64 {
        self.shared.connections.load(Relaxed)
    }

    /// Connections that the client has closed.
    pub fn closed(&self) -> u64 {
        self.shared.closed.load(Relaxed)
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
        shared.connections.fetch_add(1, Relaxed);
        tokio::spawn(connection(client, shared.clone()));
    }
}

async fn connection(client: TcpStream, shared: Arc<Shared>) -> io::Result<()> {
    let server = TcpStream::connect(shared.upstream).await?;
    client.set_nodelay(true)?;
    server.set_nodelay(true)?;
    let (from_client, to_client) = client.into_split();
    let (from_server, to_server) = server.into_split();
    // When either end closes, so does the other.
    tokio::select! {
        () = forward_requests(from_client, to_server) => {
            shared.closed.fetch_add(1, Relaxed);
        }
        () = forward_responses(from_server, to_client, &shared) => {}
    }
    Ok(())
}

async fn forward_requests(mut from: OwnedReadHalf, mut to: OwnedWriteHalf) {
    let mut chunk = [0; CHUNK_BYTES];
    while let Ok(n @ 1..) = from.read(&mut chunk).await {
        if to.write_all(&chunk[..n]).await.is_err() {
            // The server closes the connection, and the rest of its response is still to be forwarded.
            return std::future::pending().await;
        }
    }
}

async fn forward_responses(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, shared: &Shared) {
    let mut chunk = [0; CHUNK_BYTES];
    while let Ok(n @ 1..) = from.read(&mut chunk).await {
        if let Ok(permit) = shared.allowed.acquire().await {
            permit.forget();
        }
        if to.write_all(&chunk[..n]).await.is_err() {
            return;
        }
        shared.bytes.fetch_add(n as u64, Relaxed);
    }
}
