//! The settings of `serve` with their defaults, and the checks that span several of them.

use std::{path::PathBuf, time::Duration};

/// Address that `serve` listens on unless told otherwise.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7700";

/// How to serve.
#[derive(Debug, Clone, PartialEq)]
pub struct ServeConfig {
    /// `HOST:PORT`; port 0 picks a free one.
    pub listen: String,
    /// Threads that answer; 0 for one a core.
    pub threads: usize,
    /// Seconds that requests in flight may take to finish at shutdown.
    pub drain_secs: u64,
    /// TLS.
    pub tls: TlsConfig,
    /// Replacing cities while they are served.
    pub reload: ReloadConfig,
    /// What is bounded.
    pub limits: LimitsConfig,
    /// Blocks of remote cities.
    pub cache: BlockCacheConfig,
    /// Who may see what.
    pub access: AccessConfig,
    /// What is logged.
    pub log: LogConfig,
}

/// HTTPS; off without a certificate.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TlsConfig {
    /// PEM file with the certificate and those between it and a root.
    pub certificate: Option<PathBuf>,
    /// PEM file with its private key.
    pub key: Option<PathBuf>,
}

/// How cities are replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReloadConfig {
    /// Seconds between looks at the folders; 0: only at SIGHUP.
    pub watch_secs: u64,
    /// Seconds that a replaced version is still served.
    pub keep_secs: u64,
    /// Replaced versions of one city that are still served.
    pub keep_versions: usize,
}

/// Bounds, all of them enforced.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitsConfig {
    /// Connections at once; those over it are told 503 and closed.
    pub connections: usize,
    /// Requests for cities worked on at once; more are turned away with 503.
    pub in_flight: usize,
    /// Bytes of answers that wait to be sent; more requests are turned away with 503.
    pub in_flight_bytes: usize,
    /// Bytes of tiles that are kept ready to be sent.
    pub tile_bytes: usize,
    /// Bytes of a request's line and headers.
    pub header_bytes: usize,
    /// Headers of a request.
    pub headers: usize,
    /// Seconds from a request's first byte to the end of its headers; from the connection to the first request.
    pub header_secs: u64,
    /// Seconds that a connection may idle between requests.
    pub idle_secs: u64,
    /// Seconds in which a client must take at least 16 KiB of what waits for it.
    pub write_secs: u64,
    /// Requests at once on one connection of HTTP/2.
    pub streams: u32,
    /// Requests a second of one client's address; 0 for no limit.
    pub client_rate: f64,
    /// Requests that a client may make at once before that rate counts.
    pub client_burst: u32,
}

/// What is kept of cities in object stores and behind web servers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockCacheConfig {
    /// Bytes of blocks in memory.
    pub memory_bytes: u64,
    /// Bytes of one block: what is fetched at once.
    pub block_bytes: u64,
    /// Folder for blocks on disk; none are kept there without it.
    pub folder: Option<PathBuf>,
    /// Bytes of blocks on disk.
    pub folder_bytes: u64,
    /// Requests to stores at once.
    pub fetches: usize,
    /// Seconds after which a store that fails or does not answer is raw_value up.
    pub timeout_secs: u64,
}

/// Private cities.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AccessConfig {
    /// File of bearer tokens, one a line.
    pub tokens: Option<PathBuf>,
    /// Cities that ask for a token; all of them if there are tokens and this is empty.
    pub private: Vec<String>,
}

/// Logs, to standard error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogConfig {
    /// How a line looks.
    pub format: LogFormat,
    /// Which requests have one.
    pub requests: LogRequests,
}

/// How a line of the log looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogFormat {
    /// For people.
    Text,
    /// An object a line.
    Json,
}

/// Which requests have a line in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogRequests {
    /// None.
    None,
    /// Answers of 5xx.
    Errors,
    /// All.
    All,
}

impl Default for ServeConfig {
    fn default() -> Self {
        Self {
            listen: DEFAULT_LISTEN.into(),
            threads: 0,
            drain_secs: 10,
            tls: TlsConfig::default(),
            reload: ReloadConfig { watch_secs: 2, keep_secs: 300, keep_versions: 4 },
            limits: LimitsConfig::default(),
            cache: BlockCacheConfig::default(),
            access: AccessConfig::default(),
            log: LogConfig { format: LogFormat::Text, requests: LogRequests::Errors },
        }
    }
}

impl Default for BlockCacheConfig {
    fn default() -> Self {
        Self {
            memory_bytes: 128 << 20,
            block_bytes: 128 << 10,
            folder: None,
            folder_bytes: 4 << 30,
            fetches: 64,
            timeout_secs: 15,
        }
    }
}

impl Default for LimitsConfig {
    fn default() -> Self {
        Self {
            connections: 8192,
            in_flight: 1024,
            in_flight_bytes: 256 << 20,
            tile_bytes: 64 << 20,
            header_bytes: 16 << 10,
            headers: 64,
            header_secs: 10,
            idle_secs: 60,
            write_secs: 30,
            streams: 128,
            client_rate: 0.0,
            client_burst: 200,
        }
    }
}

impl ServeConfig {
    /// Threads that answer.
    pub fn worker_threads(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(2, usize::from),
            threads => threads,
        }
    }

    /// How long requests in flight may take to finish.
    pub fn drain(&self) -> Duration {
        Duration::from_secs(self.drain_secs)
    }

    /// What spans several settings. Errors: what is wrong, naming the key.
    pub(super) fn check(&self) -> Result<(), String> {
        match (&self.tls.certificate, &self.tls.key) {
            (Some(_), None) => return Err("tls.certificate is raw_value, tls.key is not: give both or none".into()),
            (None, Some(_)) => return Err("tls.key is raw_value, tls.certificate is not: give both or none".into()),
            _ => {}
        }
        if !self.access.private.is_empty() && self.access.tokens.is_none() {
            return Err("access.private names cities, but without access.tokens nobody could see them".into());
        }
        Ok(())
    }
}
