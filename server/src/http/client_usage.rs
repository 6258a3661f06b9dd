//! What each client address uses of the server's limits, so that no single one can use up all of a limit.
//!
//! A client is an IPv4 address or an IPv6 /64 network, which usually belongs to one customer.

use super::in_flight::InFlightBudget;
use crate::config::LimitsConfig;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a connection is there for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ConnectionClass {
    /// Its requests are served.
    Served,
    /// There are too many connections: its requests are rejected, except for health and metrics.
    OverLimit,
    /// The same for a client that has its share of both: it may still ask for health. No share limits this class.
    Reserved,
}

/// All clients with open connections.
#[derive(Debug)]
pub(super) struct ClientTable {
    shares: ClientShares,
    clients: Mutex<HashMap<IpAddr, Arc<ClientUsage>>>,
}

/// What one client may use at once.
#[derive(Debug, Clone, Copy)]
struct ClientShares {
    /// Connections whose requests are served.
    connections: usize,
    /// Further connections, whose requests are rejected.
    over_limit: usize,
    requests: usize,
    bytes: usize,
}

#[derive(Debug)]
pub(super) struct ClientUsage {
    connections: AtomicUsize,
    over_limit: AtomicUsize,
    /// The client's requests and response bytes in flight.
    pub(super) in_flight: InFlightBudget,
}

/// An open connection of a client; counted until it is dropped.
#[derive(Debug)]
pub(super) struct ClientSlot {
    table: Arc<ClientTable>,
    network: IpAddr,
    pub(super) usage: Arc<ClientUsage>,
    class: ConnectionClass,
}

/// The default share of one client: three quarters, at least 1.
pub(super) fn default_share(limit: usize) -> usize {
    (limit - limit / 4).min(limit.saturating_sub(1)).max(1)
}

impl ClientTable {
    /// `over_limit` is the number of connections that may be open besides `limits.connections`.
    pub(super) fn new(limits: &LimitsConfig, over_limit: usize) -> Self {
        let share = |configured: usize, limit| if configured == 0 { default_share(limit) } else { configured };
        let shares = ClientShares {
            connections: share(limits.client_connections, limits.connections),
            over_limit: default_share(over_limit),
            requests: share(limits.client_in_flight, limits.in_flight),
            bytes: share(limits.client_in_flight_bytes, limits.in_flight_bytes),
        };
        Self { shares, clients: Mutex::default() }
    }

    /// Counts a connection. `None` if the client has its share of this kind of connection.
    pub(super) fn connect(self: &Arc<Self>, ip: IpAddr, class: ConnectionClass) -> Option<ClientSlot> {
        let network = client_network(ip);
        let ClientShares { connections, over_limit, requests, bytes } = self.shares;
        let mut clients = self.lock();
        let usage = clients.entry(network).or_insert_with(|| {
            Arc::new(ClientUsage {
                connections: AtomicUsize::new(0),
                over_limit: AtomicUsize::new(0),
                in_flight: InFlightBudget::new(requests, bytes),
            })
        });
        let max = match class {
            ConnectionClass::Served => connections,
            ConnectionClass::OverLimit => over_limit,
            ConnectionClass::Reserved => usize::MAX,
        };
        // The count changes under the lock only.
        let counter = usage.counter(class);
        if counter.load(Relaxed) >= max {
            return None;
        }
        counter.fetch_add(1, Relaxed);
        Some(ClientSlot { table: self.clone(), network, usage: usage.clone(), class })
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<IpAddr, Arc<ClientUsage>>> {
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ClientUsage {
    fn counter(&self, class: ConnectionClass) -> &AtomicUsize {
        if class == ConnectionClass::Served { &self.connections } else { &self.over_limit }
    }
}

impl Drop for ClientSlot {
    fn drop(&mut self) {
        let mut clients = self.table.lock();
        self.usage.counter(self.class).fetch_sub(1, Relaxed);
        if self.usage.connections.load(Relaxed) + self.usage.over_limit.load(Relaxed) == 0 {
            clients.remove(&self.network);
        }
    }
}

/// The address that stands for the client of an address.
pub(super) fn client_network(ip: IpAddr) -> IpAddr {
    match ip.to_canonical() {
        IpAddr::V6(ip) => {
            let [a, b, c, d, ..] = ip.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
        v4 => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::ConnectionClass::{OverLimit, Reserved, Served};
    use super::*;

    #[test]
    fn a_client_gets_its_share_and_is_forgotten_when_it_leaves() {
        let limits = LimitsConfig { connections: 4, client_in_flight: 7, ..LimitsConfig::default() };
        let table = Arc::new(ClientTable::new(&limits, 2));
        let [one, same, other] = ["2001:db8::1", "2001:db8::2", "192.0.2.1"].map(|ip| ip.parse().unwrap());
        let mut slots: Vec<_> = [one, same, one].iter().map(|ip| table.connect(*ip, Served).unwrap()).collect();
        assert!(table.connect(same, Served).is_none(), "three quarters of four");
        assert!(table.connect(other, Served).is_some());
        assert!((0..7).all(|_| slots[0].usage.in_flight.try_enter()));
        assert!(!slots[1].usage.in_flight.try_enter(), "a /64 network is one client");
        slots.push(table.connect(one, OverLimit).unwrap());
        assert!(table.connect(one, OverLimit).is_none());
        slots.extend((0..5).filter_map(|_| table.connect(one, Reserved)));
        assert_eq!(slots.len(), 9);
        slots.clear();
        assert!(table.lock().is_empty());
    }

    #[test]
    fn default_shares_leave_something_to_others() {
        assert_eq!([1, 2, 3, 4, 8, 1024].map(default_share), [1, 1, 2, 3, 6, 768]);
    }
}
