//! The settings of `serve` with their defaults, and the checks that span several of them.

use super::network::Network;
use super::public_url::PublicUrl;
use super::site::SiteConfig;
use std::path::PathBuf;
use std::time::Duration;

/// Default of `listen`.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7700";

/// All settings of `serve`. `keys` documents each setting for users.
#[derive(Debug, Clone, PartialEq)]
pub struct ServeConfig {
    /// `HOST:PORT`; port 0 picks a free one.
    pub listen: String,
    /// `HOST:PORT` of a listener for health and metrics alone; `None` to serve both at `listen`.
    pub metrics_address: Option<String>,
    /// The address at which people reach the server; `None` for that of each request.
    pub public_url: Option<PublicUrl>,
    /// Number of worker threads; 0 for one per core.
    pub threads: usize,
    /// Seconds between the end of readiness and the end of the listener.
    pub drain_notice_secs: u64,
    pub drain_secs: u64,
    pub tls: TlsConfig,
    pub reload: ReloadConfig,
    pub limits: LimitsConfig,
    pub drawings: DrawingsConfig,
    pub analyses: AnalysesConfig,
    pub cache: BlockCacheConfig,
    pub access: AccessConfig,
    pub site: SiteConfig,
    pub log: LogConfig,
}

/// HTTPS; off without a certificate.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TlsConfig {
    /// PEM file of the certificate and its chain.
    pub certificate: Option<PathBuf>,
    /// PEM file of the private key.
    pub key: Option<PathBuf>,
}

/// Replacement of cities while they are served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReloadConfig {
    /// Seconds between two checks for changes; 0 for SIGHUP only.
    pub watch_secs: u64,
    /// Seconds for which a replaced version is still served.
    pub keep_secs: u64,
    /// Replaced versions per city that are still served.
    pub keep_versions: usize,
}

/// Limits on connections, requests and memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitsConfig {
    pub connections: usize,
    /// Open connections per client address; 0 for three quarters of `connections`.
    pub client_connections: usize,
    /// Requests in flight, without those for health and metrics.
    pub in_flight: usize,
    pub in_flight_bytes: usize,
    /// Requests in flight per client address; 0 for three quarters of `in_flight`.
    pub client_in_flight: usize,
    /// Bytes of responses in flight per client address; 0 for three quarters of `in_flight_bytes`.
    pub client_in_flight_bytes: usize,
    /// Bytes of all caches together: of tiles, of blocks of remote cities, of directories of archives, of search indexes, made files and
    /// parts for drawings.
    pub cache_bytes: usize,
    /// Size of the tile caches of all threads together, a part of `cache_bytes`.
    pub tile_bytes: usize,
    pub header_bytes: usize,
    /// Number of headers per request.
    pub headers: usize,
    /// Seconds from a request's first byte (at first: from the connection) to the end of its headers.
    pub header_secs: u64,
    pub idle_secs: u64,
    /// Seconds in which a client must take at least 16 KiB of what waits for it on a connection, and on each HTTP/2 stream.
    pub write_secs: u64,
    /// Concurrent requests per HTTP/2 connection.
    pub streams: u32,
    /// Requests per second and client address; 0 for no limit.
    pub client_rate: f64,
    /// Requests that an address may make at once before the rate applies.
    pub client_burst: u32,
}

/// Drawings that are made for clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DrawingsConfig {
    /// Drawings that are made at the same time; 0 for none.
    pub at_once: usize,
    /// Requests that may wait for that.
    pub waiting: usize,
    /// Seconds within which a drawing must be made, including the wait.
    pub secs: u64,
    /// Triangles of a drawing.
    pub triangles: usize,
}

/// Analyses that are made for clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnalysesConfig {
    /// Analyses that are made at the same time; 0 for none.
    pub at_once: usize,
    /// Requests that may wait for that.
    pub waiting: usize,
    /// Seconds within which an analysis must be made, including the wait.
    pub secs: u64,
    /// Cells of an analysis, with those around its area.
    pub cells: u64,
}

/// Block cache of cities in object stores and behind web servers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockCacheConfig {
    pub memory_bytes: u64,
    /// Size of a block, the unit of fetching.
    pub block_bytes: u64,
    /// Folder for blocks on disk; `None` for memory only.
    pub folder: Option<PathBuf>,
    pub folder_bytes: u64,
    /// Concurrent requests to stores.
    pub fetches: usize,
    /// Seconds for which a failing or silent store is retried.
    pub timeout_secs: u64,
}

/// Who may read what.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AccessConfig {
    /// File of bearer tokens, one per line.
    pub tokens: Option<PathBuf>,
    /// File of the keys that sign share links, one per line.
    pub share_keys: Option<PathBuf>,
    /// Names of the cities that need a token or a link. If empty while one of the files is set, all cities need one.
    pub private: Vec<String>,
    pub cors: CorsPolicy,
    /// Hosts that requests may name; empty for any.
    pub hosts: Vec<String>,
    /// Proxies whose `X-Forwarded-For` names the address of the client.
    pub proxies: Vec<Network>,
}

/// Which pages of other origins may read responses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum CorsPolicy {
    #[default]
    Any,
    None,
}

impl AccessConfig {
    /// Whether there are private cities.
    pub(crate) fn is_restricted(&self) -> bool {
        self.tokens.is_some() || self.share_keys.is_some()
    }
}

/// The log on standard error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogConfig {
    pub format: LogFormat,
    pub requests: LogRequests,
}

/// Format of a log line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogFormat {
    Text,
    /// One JSON object per line.
    Json,
}

/// Which requests are logged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogRequests {
    None,
    /// Those with a 5xx response.
    Errors,
    All,
}

impl Default for ServeConfig {
    fn default() -> Self {
        Self {
            listen: DEFAULT_LISTEN.into(),
            metrics_address: None,
            public_url: None,
            threads: 0,
            drain_notice_secs: 0,
            drain_secs: 10,
            tls: TlsConfig::default(),
            reload: ReloadConfig { watch_secs: 2, keep_secs: 300, keep_versions: 4 },
            limits: LimitsConfig::default(),
            drawings: DrawingsConfig { at_once: 0, waiting: 4, secs: 60, triangles: 200_000 },
            analyses: AnalysesConfig { at_once: 0, waiting: 4, secs: 120, cells: 8_000_000 },
            cache: BlockCacheConfig::default(),
            access: AccessConfig::default(),
            site: SiteConfig::default(),
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
            client_connections: 0,
            in_flight: 1024,
            in_flight_bytes: 256 << 20,
            client_in_flight: 0,
            client_in_flight_bytes: 0,
            cache_bytes: 512 << 20,
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
    /// Cities that settings name but are not known, with the setting. One that was meant to be private is public then.
    pub fn unknown_cities(&self, is_known: impl Fn(&str) -> bool) -> Vec<(&'static str, &str)> {
        let private = self.access.private.iter().map(|name| ("access.private", name.as_str()));
        private.chain(self.site.cities().map(|name| ("site.start", name))).filter(|(_, name)| !is_known(name)).collect()
    }

    /// Number of worker threads.
    pub fn worker_threads(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(2, usize::from),
            threads => threads,
        }
    }

    /// Bytes for search indexes, made files and parts for drawings: what other caches leave of `limits.cache_bytes`.
    pub(crate) fn computed_bytes(&self, has_remote_cities: bool) -> usize {
        self.spare_bytes(has_remote_cities) - self.directory_bytes(has_remote_cities)
    }

    /// Bytes for directories of archives: an eighth of what tiles and remote blocks leave of `limits.cache_bytes`.
    pub(crate) fn directory_bytes(&self, has_remote_cities: bool) -> usize {
        self.spare_bytes(has_remote_cities) / 8
    }

    fn spare_bytes(&self, has_remote_cities: bool) -> usize {
        let blocks = if has_remote_cities { self.cache.memory_bytes as usize } else { 0 };
        self.limits.cache_bytes.saturating_sub(self.limits.tile_bytes).saturating_sub(blocks)
    }

    /// Time at shutdown in which load balancers notice that the server is not ready any more, while it still accepts connections.
    pub fn drain_notice(&self) -> Duration {
        Duration::from_secs(self.drain_notice_secs)
    }

    /// Time that requests in flight may take to finish at shutdown.
    pub fn drain_timeout(&self) -> Duration {
        Duration::from_secs(self.drain_secs)
    }

    /// Checks rules that span several settings. Fails with a message that names the keys.
    pub(super) fn validate(&self) -> Result<(), String> {
        match (&self.tls.certificate, &self.tls.key) {
            (Some(_), None) => return Err("tls.certificate is set, tls.key is not: set both or none".into()),
            (None, Some(_)) => return Err("tls.key is set, tls.certificate is not: set both or none".into()),
            _ => {}
        }
        if self.limits.tile_bytes as u64 + self.cache.memory_bytes > self.limits.cache_bytes as u64 {
            return Err(
                "limits.tile_bytes and cache.memory_bytes are together more than limits.cache_bytes, of which they \
                        are parts"
                    .into(),
            );
        }
        if !self.access.private.is_empty() && !self.access.is_restricted() {
            return Err("access.private names cities, but without access.tokens or access.share_keys no client could \
                        open them"
                .into());
        }
        Ok(())
    }
}
