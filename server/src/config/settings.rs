//! The settings of `serve` with their defaults, and the checks that span several of them.

use super::network::Network;
use super::public_url::PublicUrl;
use super::site::SiteConfig;
use std::path::PathBuf;
use std::time::Duration;

/// Default of `listen`.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7700";

/// All settings of `serve`. `keys` documents each of them, also for users, who print that with `--print-config`. `None` stands for an empty text.
#[derive(Debug, Clone, PartialEq)]
pub struct ServeConfig {
    pub listen: String,
    pub metrics_address: Option<String>,
    pub public_url: Option<PublicUrl>,
    pub threads: usize,
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
    pub certificate: Option<PathBuf>,
    pub key: Option<PathBuf>,
}

/// Replacement of cities while they are served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReloadConfig {
    pub watch_secs: u64,
    pub keep_secs: u64,
    pub keep_versions: usize,
}

/// Limits on connections, requests and memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitsConfig {
    pub connections: usize,
    pub client_connections: usize,
    pub in_flight: usize,
    pub in_flight_bytes: usize,
    pub client_in_flight: usize,
    pub client_in_flight_bytes: usize,
    pub cache_bytes: usize,
    pub tile_bytes: usize,
    pub header_bytes: usize,
    pub headers: usize,
    /// Seconds from a request's first byte (at first: from the connection) to the end of its headers.
    pub header_secs: u64,
    pub idle_secs: u64,
    pub write_secs: u64,
    pub streams: u32,
    pub client_rate: f64,
    pub client_burst: u32,
}

/// Drawings that are made for clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DrawingsConfig {
    pub at_once: usize,
    pub waiting: usize,
    pub secs: u64,
    pub triangles: usize,
}

/// Analyses that are made for clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnalysesConfig {
    pub at_once: usize,
    pub waiting: usize,
    pub secs: u64,
    pub cells: u64,
}

/// Block cache of cities in object stores and behind web servers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockCacheConfig {
    pub memory_bytes: u64,
    pub block_bytes: u64,
    pub folder: Option<PathBuf>,
    pub folder_bytes: u64,
    pub fetches: usize,
    pub timeout_secs: u64,
}

/// Who may read what.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AccessConfig {
    pub tokens: Option<PathBuf>,
    pub share_keys: Option<PathBuf>,
    pub private: Vec<String>,
    pub cors: CorsPolicy,
    pub hosts: Vec<String>,
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
