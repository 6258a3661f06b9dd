//! Addresses of servers that end and start again.

use anyhow::{Context, Result};
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::AtomicU16;
use std::sync::atomic::Ordering::Relaxed;

/// Ports below those that the system gives to connections.
const FIRST_PORT: u16 = 20_000;
const PORTS: u16 = 10_000;

/// A local address for a server that will be restarted. No connection gets its port while nothing listens there. Fails if all
/// such ports are in use.
pub fn restartable() -> Result<SocketAddr> {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    // Other test programs, which may run at the same time, begin elsewhere.
    let begin = (std::process::id() % u32::from(PORTS)) as u16;
    let mut addresses = (0..PORTS).map(|_| {
        let port = FIRST_PORT + begin.wrapping_add(NEXT.fetch_add(1, Relaxed)) % PORTS;
        SocketAddr::from(([127, 0, 0, 1], port))
    });
    addresses.find(|address| TcpListener::bind(address).is_ok()).context("no port is free")
}
