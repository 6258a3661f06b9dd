//! Loads the settings: defaults, then a TOML file, the environment and the command line.

use super::keys::{self, RawValue, SETTINGS};
use super::settings::ServeConfig;
use insula_archive::file::read_text;
use std::fmt::Write;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// Prefix of environment variables: `limits.in_flight` is `INSULA_SERVE_LIMITS_IN_FLIGHT`.
const PREFIX: &str = "INSULA_SERVE_";
const MAX_FILE_BYTES: u64 = 1 << 20;

/// The variables of this process. Those that are not UTF-8 cannot be ours.
pub(crate) fn environment() -> impl Iterator<Item = (String, String)> {
    std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
}

/// An invalid setting: where it was given, and what is wrong.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot use the settings: {place}: {reason}; `insula-server serve --print-config` shows all keys")]
pub struct ConfigError {
    /// File and line, environment variable, or command line option, with the key.
    place: String,
    reason: String,
}

impl ConfigError {
    fn new(place: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { place: place.into(), reason: reason.into() }
    }
}

impl ServeConfig {
    /// Applies the file, the environment (pairs of name and value) and `settings` (`key=value`) to the defaults, in this order.
    /// Fails if the file cannot be read, a key is unknown or a value is invalid.
    pub fn load(
        file: Option<&Path>,
        environment: impl IntoIterator<Item = (String, String)>,
        settings: &[String],
    ) -> Result<Self, ConfigError> {
        let mut config = Self::default();
        if let Some(path) = file {
            let name = path.display().to_string();
            let text = read_text(path, MAX_FILE_BYTES).map_err(|error| ConfigError::new(&name, error.to_string()))?;
            config.apply_file(&name, &text)?;
        }
        config.apply_environment(environment)?;
        for setting in settings {
            let place = || format!("--set {setting}");
            let (key, value) =
                setting.split_once('=').ok_or_else(|| ConfigError::new(place(), "expected KEY=VALUE"))?;
            keys::set(&mut config, key, &RawValue::Untyped(value.to_owned()))
                .map_err(|reason| ConfigError::new(place(), reason))?;
        }
        config.validate().map_err(|reason| ConfigError::new("conflicting settings", reason))?;
        Ok(config)
    }

    fn apply_file(&mut self, name: &str, text: &str) -> Result<(), ConfigError> {
        let line_at = |start: usize| text.get(..start).map_or(1, |before| before.matches('\n').count() + 1);
        let table = DeTable::parse(text).map_err(|error| {
            let line = error.span().map_or(1, |span| line_at(span.start));
            ConfigError::new(format!("{name}, line {line}"), error.message().replace('\n', " "))
        })?;
        for (key, value) in table.get_ref().iter() {
            let place = |start: usize, key: &str| format!("{name}, line {}, {key}", line_at(start));
            if let DeValue::Table(table) = value.get_ref() {
                for (sub_key, value) in table.iter() {
                    let full = format!("{}.{}", key.get_ref(), sub_key.get_ref());
                    keys::set(self, &full, &raw_value(value.get_ref()))
                        .map_err(|reason| ConfigError::new(place(sub_key.span().start, &full), reason))?;
                }
            } else {
                keys::set(self, key.get_ref(), &raw_value(value.get_ref()))
                    .map_err(|reason| ConfigError::new(place(key.span().start, key.get_ref()), reason))?;
            }
        }
        Ok(())
    }

    fn apply_environment(
        &mut self,
        environment: impl IntoIterator<Item = (String, String)>,
    ) -> Result<(), ConfigError> {
        for (name, value) in environment {
            let Some(suffix) = name.strip_prefix(PREFIX) else { continue };
            let known = SETTINGS.iter().find(|(key, _)| key.replace('.', "_").to_uppercase() == suffix);
            let (key, _) = known.ok_or_else(|| ConfigError::new(&name, "there is no such setting"))?;
            keys::set(self, key, &RawValue::Untyped(value)).map_err(|reason| ConfigError::new(&name, reason))?;
        }
        Ok(())
    }

    /// All settings as a documented TOML file, from which [`Self::load`] restores this value.
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        let mut config = self.clone();
        let mut current_table = "";
        for (key, doc) in SETTINGS {
            let (table, name) = key.split_once('.').unwrap_or(("", key));
            if table != current_table {
                let _ = write!(out, "\n[{table}]\n");
                current_table = table;
            }
            let _ = writeln!(out, "# {doc}\n{name} = {}", keys::get(&mut config, key));
        }
        out
    }
}

fn raw_value(value: &DeValue<'_>) -> RawValue {
    let text = |value: &DeValue<'_>| match value {
        DeValue::String(text) => Some(text.to_string()),
        _ => None,
    };
    match value {
        DeValue::String(text) => RawValue::Text(text.to_string()),
        DeValue::Integer(number) if number.radix() == 10 => RawValue::Number(number.as_str().to_owned()),
        DeValue::Float(number) => RawValue::Number(number.as_str().to_owned()),
        DeValue::Array(list) => list
            .iter()
            .map(|value| text(value.get_ref()))
            .collect::<Option<_>>()
            .map_or(RawValue::Other, RawValue::List),
        _ => RawValue::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str, environment: &[(&str, &str)], settings: &[&str]) -> Result<ServeConfig, String> {
        let file = tempfile::NamedTempFile::with_suffix(".toml").unwrap();
        std::fs::write(file.path(), text).unwrap();
        let environment = environment.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        let settings: Vec<_> = settings.iter().map(|setting| (*setting).to_owned()).collect();
        ServeConfig::load(Some(file.path()), environment, &settings).map_err(|error| error.to_string())
    }

    #[test]
    fn command_line_overrides_environment_overrides_file() {
        let file = "listen = \"0.0.0.0:80\"\n[limits]\nin_flight = 5\nheaders = 9\n";
        let environment = [("INSULA_SERVE_LIMITS_IN_FLIGHT", "6"), ("INSULA_SERVE_DRAIN_SECS", "1"), ("HOME", "/")];
        let config = load(file, &environment, &["drain_secs=2"]).unwrap();
        assert_eq!((config.listen.as_str(), config.limits.headers), ("0.0.0.0:80", 9));
        assert_eq!((config.limits.in_flight, config.drain_secs), (6, 2));
        assert_eq!(ServeConfig::load(None, [], &[]).unwrap(), ServeConfig::default());
    }

    #[test]
    fn errors_name_line_and_key() {
        for (text, expected) in [
            ("\n\nlisten = \"here\"", ["line 3, listen", "HOST:PORT"]),
            ("[limits]\n# none\nin_flight = 0", ["line 3, limits.in_flight", "from 1 to"]),
            ("[limits]\nin_flight = \"5\"", ["line 2, limits.in_flight", "without quotes"]),
            ("[limits]\nin_flight = 0x10", ["line 2, limits.in_flight", "number"]),
            ("[limits]\nin_fligth = 5", ["line 2, limits.in_fligth", "no such key"]),
            ("in_flight = 5", ["line 1, in_flight", "did you mean limits.in_flight"]),
            ("\n[log]\nformat = \"xml\"", ["line 3, log.format", "\"text\", \"json\""]),
            ("[access]\nprivate = [1]", ["line 2, access.private", "list of names"]),
            ("[access]\nprivate = [\"Delft\"]", ["line 2, access.private", "Delft"]),
            ("[access]\nhosts = [\"a:80\"]", ["line 2, access.hosts", "without port"]),
            ("metrics_address = \"here\"", ["line 1, metrics_address", "HOST:PORT"]),
            ("threads = true", ["line 1, threads", "number"]),
            ("threads = 1\nthreads = 2", ["line 2", "duplicate"]),
            ("[limits", ["line 1", ""]),
            ("{\"listen\": \"127.0.0.1:7700\"}", ["line 1", ""]),
            ("[tls]\nkey = \"k.pem\"", ["tls.key", "tls.certificate"]),
            ("[access]\nprivate = [\"delft\"]", ["access.private", "access.tokens"]),
        ] {
            let line = load(text, &[], &[]).expect_err(text);
            assert!(!line.contains('\n') && expected.iter().all(|part| line.contains(part)), "{text}: {line}");
        }
        let line = load("", &[("INSULA_SERVE_LIMIT", "1")], &[]).unwrap_err();
        assert!(line.contains("INSULA_SERVE_LIMIT"), "{line}");
        let line = load("", &[("INSULA_SERVE_THREADS", "many")], &[]).unwrap_err();
        assert!(line.contains("INSULA_SERVE_THREADS") && line.contains("many"), "{line}");
        for setting in ["threads", "threads=-1", "thread=1"] {
            assert!(load("", &[], &[setting]).unwrap_err().contains(setting));
        }
    }

    #[test]
    fn cities_that_are_not_served_are_told() {
        let settings = ["access.tokens=t", "access.private=delft,delt", "site.start=a=1,2,3,4,5,6;delft=1,2,3,4,5,6"];
        let config = load("", &[], &settings).unwrap();
        let unknown = config.unknown_cities(|name| name == "delft");
        assert_eq!(unknown, [("access.private", "delt"), ("site.start", "a")]);
    }

    #[test]
    fn printed_settings_load_to_the_same_config() {
        assert_eq!(load(&ServeConfig::default().to_toml(), &[], &[]).unwrap(), ServeConfig::default());
        let odd = [
            "listen=[::1]:0",
            "access.tokens=/a \"b\"\\c",
            "access.share_keys=keys",
            "access.private=a,b-c",
            "access.cors=none",
            "access.hosts=localhost,[::1]",
            "metrics_address=127.0.0.1:0",
            "site.title=3D \"Stadt\"",
            "site.start=a=1,2,3,4,5,6;b-c=1,2,3,4,5,6.5",
            "public_url=https://cities.example.org/3d",
            "drain_notice_secs=5",
            "limits.client_rate=0.5",
            "log.format=json",
            "log.requests=all",
            "tls.key=k",
            "tls.certificate=c",
        ];
        let config = load("", &[], &odd).unwrap();
        assert_ne!(config, ServeConfig::default());
        let text = config.to_toml();
        assert_eq!(load(&text, &[], &[]).unwrap(), config);
        for (key, doc) in SETTINGS {
            let name = key.rsplit('.').next().unwrap();
            assert!(text.contains(&format!("# {doc}\n{name} = ")), "{key} is missing from the output");
        }
    }
}
