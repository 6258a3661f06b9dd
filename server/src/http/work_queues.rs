//! Which routes compute, and the queues in which their work waits.

use super::client_usage::default_share;
use super::fair_queue::{FairQueue, QueueLimits};
use crate::config::{AnalysesConfig, DrawingsConfig, ServeConfig};
use axum::http::request::Parts;
use insula_protocol::route::RouteTemplate;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

/// Requests that wait for a place, where no setting says otherwise.
const MAX_WAITING: usize = 256;

/// A kind of work with a queue of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WorkKind {
    Search,
    Filter,
    Groups,
    Tileset,
    Draw,
    Analyse,
    Lists,
}

impl WorkKind {
    const ALL: [Self; 7] =
        [Self::Search, Self::Filter, Self::Groups, Self::Tileset, Self::Draw, Self::Analyse, Self::Lists];

    /// The work of a route; `None` for those that only send what exists.
    pub(super) const fn of_route(route: RouteTemplate) -> Option<Self> {
        use RouteTemplate as R;
        match route {
            R::Search => Some(Self::Search),
            // Both decode all objects of a city.
            R::Filter | R::Proposals => Some(Self::Filter),
            R::Groups => Some(Self::Groups),
            R::Tileset | R::TilesetFile => Some(Self::Tileset),
            R::Draw => Some(Self::Draw),
            R::Analyse => Some(Self::Analyse),
            R::Cities | R::Index => Some(Self::Lists),
            R::Subtrees | R::BlockMaps | R::Meshes | R::Objects | R::Visibility => None,
            R::Manifest | R::OpenApi | R::CityPage | R::Thumbnail => None,
            R::Health | R::Readiness | R::Metrics | R::Asset | R::ServiceWorker | R::Other => None,
        }
    }

    fn limits(self, config: &ServeConfig) -> QueueLimits {
        let secs = Duration::from_secs;
        // One core is left to others.
        let at_ease = cores().saturating_sub(1).max(1);
        match self {
            // Milliseconds, except for the first search of a city, which reads the index.
            Self::Search => QueueLimits { at_once: 8, waiting: MAX_WAITING, at_ease, max_time: secs(10) },
            Self::Filter => QueueLimits { at_once: 2, waiting: MAX_WAITING, at_ease, max_time: secs(30) },
            // Reads up to 64 tiles, from the network if the city is remote.
            Self::Groups => {
                let at_once = groups_at_once();
                // Viewers ask for several at a time, which the thread of their connection makes with the least work.
                QueueLimits { at_once, waiting: 4 * MAX_WAITING, at_ease: default_share(at_once), max_time: secs(30) }
            }
            // A core for up to a second.
            Self::Tileset => QueueLimits { at_once: 2, waiting: MAX_WAITING, at_ease, max_time: secs(30) },
            // Up to a thousand cities, which take tens of milliseconds. The usual page of the list is in memory.
            Self::Lists => QueueLimits { at_once: 2, waiting: MAX_WAITING, at_ease, max_time: secs(10) },
            Self::Draw => {
                let DrawingsConfig { at_once, waiting, secs: max_secs, .. } = config.drawings;
                QueueLimits { at_once, waiting, at_ease, max_time: secs(max_secs) }
            }
            Self::Analyse => {
                let AnalysesConfig { at_once, waiting, secs: max_secs, .. } = config.analyses;
                QueueLimits { at_once, waiting, at_ease, max_time: secs(max_secs) }
            }
        }
    }
}

/// Groups that are made at once: few for each core, because one waits for all that run on its core. Those of remote cities wait for the
/// network.
fn groups_at_once() -> usize {
    const OF_A_CORE: usize = 4;
    OF_A_CORE * cores()
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(2, usize::from)
}

#[derive(Debug)]
pub(super) struct WorkQueues([FairQueue; WorkKind::ALL.len()]);

impl WorkQueues {
    pub(super) fn new(config: &ServeConfig) -> Self {
        Self(WorkKind::ALL.map(|kind| FairQueue::new(kind.limits(config))))
    }

    /// Queues that give up all work, for tests.
    #[cfg(test)]
    pub(super) fn closed() -> Self {
        let limits = QueueLimits { at_once: 0, waiting: 0, at_ease: 1, max_time: Duration::from_secs(600) };
        Self(WorkKind::ALL.map(|_| FairQueue::new(limits)))
    }

    pub(super) fn of(&self, kind: WorkKind) -> &FairQueue {
        &self.0[kind as usize]
    }
}

/// The client of a request, whose turn its work waits for. Requests of no connection are of one client.
#[derive(Debug, Clone, Copy)]
pub(super) struct RequestClient(pub(super) IpAddr);

impl RequestClient {
    pub(super) fn of(parts: &Parts) -> IpAddr {
        parts.extensions.get::<Self>().map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), |client| client.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lockouts_are_measured_for_each_kind_of_work() {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/load/lockout.py");
        let script = std::fs::read_to_string(script).unwrap();
        for kind in WorkKind::ALL {
            let name = format!("{kind:?}").to_lowercase();
            let name = name.trim_end_matches('s');
            assert!(script.contains(&format!("    def {name}(self):")), "tests/load/lockout.py has no {name}");
            assert!(script.lines().any(|line| line.contains("NAMES = (") && line.contains(&format!("\"{name}\""))));
        }
    }
}
