//! The settings of `serve`.
//!
//! [`ServeConfig`] combines, by rising precedence, defaults, a TOML file, the environment and the command line. A setting has
//! the same name, `table.key`, in all of them.

mod keys;
mod load;
mod network;
mod public_url;
mod settings;
mod site;

pub use keys::check_address;
pub use load::ConfigError;
pub(crate) use load::environment;
pub use network::Network;
pub use public_url::PublicUrl;
pub use settings::{
    AccessConfig, AnalysesConfig, BlockCacheConfig, CorsPolicy, DEFAULT_LISTEN, DrawingsConfig, LimitsConfig,
    LogConfig, LogFormat, LogRequests, ReloadConfig, ServeConfig, TlsConfig,
};
pub use site::SiteConfig;
