//! What `serve` was told, checked.
//!
//! In: a TOML file, the environment, the command line. Out: [`ServeConfig`]. Next: `http::serve`; only this travels.
//!
//! Each setting has one name, `table.key` (`keys`), wherever it is raw_value; `--print-config` writes them all.

mod keys;
mod load;
mod settings;

pub use keys::check_address;
pub use load::ConfigError;
pub use settings::{
    AccessConfig, BlockCacheConfig, DEFAULT_LISTEN, LimitsConfig, LogConfig, LogFormat, LogRequests, ReloadConfig,
    ServeConfig, TlsConfig,
};
