//! The server under test: how the faults start it and read its metrics.

use super::client::Connection;
use insula_test_support::programs::{ServerProcess, path_text, program};
use insula_test_support::small_city;
use std::net::SocketAddr;
use std::process::Command;

pub(super) const ANY_PORT: &str = "127.0.0.1:0";

/// The built server.
pub(super) fn command() -> Command {
    Command::new(program("insula-server").unwrap())
}

/// Serves `place`. `settings` are `key=value`.
pub(super) fn start(place: &str, settings: &[&str]) -> ServerProcess {
    ServerProcess::start(&mut command(), place, ANY_PORT, settings).unwrap()
}

/// Serves the city of two nodes. The folder is deleted when dropped.
pub(super) fn start_small_city(settings: &[&str]) -> (tempfile::TempDir, ServerProcess) {
    let folder = small_city::temporary_city();
    let server = start(path_text(folder.path()), settings);
    (folder, server)
}

/// One counter or gauge of `/metrics`; 0 if it is missing.
pub(super) fn metric(address: SocketAddr, name: &str) -> f64 {
    let response = Connection::new(address).get("/metrics").unwrap();
    let text = String::from_utf8(response.body).unwrap();
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.parse().ok());
    value.unwrap_or(0.0)
}
