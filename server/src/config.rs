//! What `serve` was told, checked.
//!
//! In: a JSON file and the command line. Out: [`Config`]. Next: `http::serve`; only this travels.

use serde::Deserialize;
use std::path::Path;

/// Address that `serve` listens on unless told otherwise.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7700";

/// How to serve.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Config {
    /// `HOST:PORT`; port 0 picks a free one.
    pub listen: String,
    /// Requests worked on at once; more are turned away with 503.
    pub max_in_flight: usize,
    /// How long requests in flight may take to finish at shutdown.
    pub drain_secs: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self { listen: DEFAULT_LISTEN.into(), max_in_flight: 1024, drain_secs: 10 }
    }
}

/// What a config file may hold; all of it may be left out.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    listen: Option<String>,
    max_in_flight: Option<usize>,
}

/// Why there is no config.
#[derive(Debug, thiserror::Error)]
#[error(
    "cannot use the config file {path}: {reason}; it is JSON like {{\"listen\":\"127.0.0.1:7700\",\"max_in_flight\":1024}}"
)]
pub struct ConfigError {
    path: String,
    reason: String,
}

impl Config {
    /// The defaults, over them the file, over it the command line.
    pub fn new(file: Option<&Path>, listen: Option<&str>) -> Result<Self, ConfigError> {
        let read = match file {
            Some(path) => read(path).map_err(|reason| ConfigError { path: path.display().to_string(), reason })?,
            None => File::default(),
        };
        let default = Self::default();
        Ok(Self {
            listen: listen.map(str::to_owned).or(read.listen).unwrap_or(default.listen),
            max_in_flight: read.max_in_flight.unwrap_or(default.max_in_flight),
            drain_secs: default.drain_secs,
        })
    }
}

fn read(path: &Path) -> Result<File, String> {
    let text = std::fs::read(path).map_err(|error| error.to_string())?;
    let file: File = serde_json::from_slice(&text).map_err(|error| error.to_string())?;
    if file.max_in_flight == Some(0) {
        return Err("max_in_flight is 0, so that nobody would be served".into());
    }
    if let Some(listen) = &file.listen {
        check_address(listen)?;
    }
    Ok(file)
}

/// Whether `text` looks like `HOST:PORT`.
pub fn check_address(text: &str) -> Result<(), String> {
    match text.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(()),
        _ => Err(format!("{text:?} is not HOST:PORT, as in {DEFAULT_LISTEN}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_wins_over_the_file() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let with = |text: &str, listen: Option<&str>| {
            std::fs::write(file.path(), text).unwrap();
            Config::new(Some(file.path()), listen)
        };
        let config = with(r#"{"listen":"0.0.0.0:80","max_in_flight":5}"#, None).unwrap();
        assert_eq!((config.listen.as_str(), config.max_in_flight), ("0.0.0.0:80", 5));
        assert_eq!(with(r#"{"listen":"0.0.0.0:80"}"#, Some("[::1]:0")).unwrap().listen, "[::1]:0");
        assert_eq!(Config::new(None, None).unwrap(), Config::default());
        for wrong in ["", "[]", r#"{"listen":"here"}"#, r#"{"max_in_flight":0}"#, r#"{"lisden":"0.0.0.0:80"}"#] {
            assert!(!with(wrong, None).unwrap_err().to_string().contains('\n'), "{wrong}");
        }
    }
}
