//! What `serve` was told, checked.
//!
//! In: a TOML file, the environment, the command line. Out: [`Config`]. Next: `http::serve`; only this travels.
//!
//! Each setting has one name, `table.key` (`keys`), wherever it is given; `--print-config` writes them all.

mod keys;
mod load;
mod settings;

pub use keys::check_address;
pub use load::ConfigError;
pub use settings::{Access, Cache, Config, DEFAULT_LISTEN, Limits, Log, LogFormat, LogRequests, Reload, Tls};
