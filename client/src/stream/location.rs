//! Locations of cities as typed by the user.

use crate::error::{ClientError, Result};
use insula_archive::city::{MANIFEST_FILE, dated_folder, first_city_in};
use insula_protocol::name::is_name;
use insula_protocol::route::{self, CITIES, without_secrets};
use std::ffi::OsStr;
use std::fmt;
use std::path::PathBuf;

/// Where a city, or a server with cities, is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CityLocation {
    /// An Insula server.
    Server {
        /// `http://host:port`, and the path below which a proxy has the server, without a slash at its end.
        base: String,
        /// Name of the city, if the URL has one.
        name: Option<String>,
        /// Value of `?share=`, which opens a private city. It is a secret: no message shows it.
        share: Option<String>,
        /// Whether the URL is a host without a path: it may also be a web host with a baked city in its root.
        is_bare_host: bool,
    },
    /// URL of a baked city's folder on a web host, without a slash at its end.
    WebFolder(String),
    /// A baked city's folder on this machine.
    Folder(PathBuf),
}

impl CityLocation {
    /// Parses a URL or a path. Fails if it cannot be a city.
    pub fn parse(place: impl AsRef<OsStr>) -> Result<Self> {
        let place = place.as_ref();
        // Only a path may be other than text.
        let text = &*place.to_string_lossy();
        let (text, query) = match text.split_once('?') {
            Some((address, query)) if address.contains("://") => (address, Some(query)),
            _ => (text, None),
        };
        let not_a_city = |what: &str| {
            ClientError::Usage(format!(
                "{text}: {what}: write http://host:port, http://host:port{CITIES}/NAME, the URL of a baked folder on a \
                 host that supports range requests, or the path of a baked folder"
            ))
        };
        let invalid = || not_a_city("not a city");
        let Some(scheme_end) = text.find("://").map(|at| at + 3) else {
            let path = &*dated_folder(PathBuf::from(place));
            let folder = if path.ends_with(MANIFEST_FILE) { path.parent().unwrap_or(path) } else { path };
            if folder.join(MANIFEST_FILE).is_file() {
                return Ok(Self::Folder(folder.to_owned()));
            }
            return Err(match first_city_in(folder) {
                Some(city) => ClientError::Usage(format!(
                    "{text}: a folder of cities, not a city: name one of them, such as {}",
                    city.display()
                )),
                None if folder.exists() => invalid(),
                None => not_a_city("there is no such city or folder"),
            });
        };
        if !["http://", "https://"].contains(&text[..scheme_end].to_lowercase().as_str()) {
            return Err(invalid());
        }
        let host_end = text[scheme_end..].find('/').map_or(text.len(), |at| at + scheme_end);
        let (base, path) = text.split_at(host_end);
        let is_banned = |c: char| c.is_whitespace() || c.is_control() || "?#".contains(c);
        if base.len() == scheme_end || text.contains(is_banned) {
            return Err(invalid());
        }
        let share = query.map(|query| parse_share(query).ok_or_else(invalid)).transpose()?;
        let path = path.trim_end_matches('/');
        let (prefix, name) = match split_prefix(path) {
            Some((prefix, "")) => (prefix, None),
            Some((prefix, name)) => match name.strip_prefix('/') {
                Some(name) if is_name(name) => (prefix, Some(name.to_owned())),
                _ => return Err(invalid()),
            },
            None if path.is_empty() => ("", None),
            None if share.is_some() => match page_of(path) {
                // A web folder knows no share links, so it is a server's page.
                Some((prefix, name)) => (prefix, Some(name)),
                _ => return Err(invalid()),
            },
            None => {
                let folder = path.strip_suffix(MANIFEST_FILE).map_or(path, |folder| folder.trim_end_matches('/'));
                return Ok(Self::WebFolder(format!("{base}{folder}")));
            }
        };
        Ok(Self::Server { base: format!("{base}{prefix}"), name, share, is_bare_host: path.is_empty() })
    }
}

impl fmt::Display for CityLocation {
    /// As it may be shown: without the share link and the user.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Server { base, name: Some(name), .. } => write!(f, "{}{CITIES}/{name}", without_secrets(base)),
            Self::Server { base, .. } => f.write_str(&without_secrets(base)),
            Self::WebFolder(base) => write!(f, "{}/", without_secrets(base)),
            Self::Folder(path) => write!(f, "{}", path.display()),
        }
    }
}

/// Splits the path of a server's list or city: the path below which a proxy has the server, and what follows the list's.
fn split_prefix(path: &str) -> Option<(&str, &str)> {
    let (prefix, rest) = path.split_once(CITIES)?;
    // Another folder may have a name that begins so.
    (rest.is_empty() || rest.starts_with('/')).then_some((prefix, rest))
}

/// Splits the address of a city's page, on a server or a published site: what is before the page's path, and the city's name. Capitals
/// are taken as small letters, as servers do for browsers.
pub(super) fn page_of(address: &str) -> Option<(&str, String)> {
    let written = address.rsplit('/').next()?;
    let name = written.to_ascii_lowercase();
    let before = is_name(&name).then(|| address.strip_suffix(&route::city_page(written)))??;
    Some((before, name))
}

/// The value of `share=VALUE`, if that is the whole query and could be a share link.
fn parse_share(query: &str) -> Option<String> {
    let share = query.strip_prefix("share=")?;
    let is_link = !share.is_empty() && share.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._~%".contains(&b));
    is_link.then(|| share.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn urls_are_servers_or_web_folders() {
        let server = |base: &str, name: Option<&str>, is_bare_host| CityLocation::Server {
            base: base.into(),
            name: name.map(str::to_owned),
            share: None,
            is_bare_host,
        };
        let parsed = |text: &str| CityLocation::parse(text).unwrap();
        assert_eq!(parsed("http://h:1"), server("http://h:1", None, true));
        assert_eq!(parsed("http://h:1/"), server("http://h:1", None, true));
        assert_eq!(parsed("https://h/v1/cities/"), server("https://h", None, false));
        assert_eq!(parsed("http://h:1/v1/cities/the_hague"), server("http://h:1", Some("the_hague"), false));
        assert_eq!(parsed("https://h/maps/3d/v1/cities/delft/"), server("https://h/maps/3d", Some("delft"), false));
        assert_eq!(parsed("https://h/maps/v1/cities"), server("https://h/maps", None, false));
        assert_eq!(parsed("https://h/v1/citiesque"), CityLocation::WebFolder("https://h/v1/citiesque".into()));
        for page in ["https://h:1/cities/delft", "https://h:1/cities/Delft"] {
            assert_eq!(page_of(page), Some(("https://h:1", "delft".to_owned())));
        }
        assert_eq!((page_of("https://h/maps/delft"), page_of("https://h/cities/a.b")), (None, None));
        for web in ["https://h/maps/delft", "https://h/maps/delft/", "https://h/maps/delft/city.json"] {
            assert_eq!(parsed(web), CityLocation::WebFolder("https://h/maps/delft".into()));
        }
    }

    #[test]
    fn a_share_link_is_a_server_with_a_secret() {
        let link = "s1.k.delft.~.99.r~-1~0~2~3.00ff";
        let expected = CityLocation::Server {
            base: "https://h".into(),
            name: Some("delft".into()),
            share: Some(link.into()),
            is_bare_host: false,
        };
        assert_eq!(CityLocation::parse(format!("https://h/v1/cities/delft?share={link}")).unwrap(), expected);
        assert_eq!(CityLocation::parse(format!("https://h/cities/delft?share={link}")).unwrap(), expected);
        assert_eq!(CityLocation::parse(format!("https://h/cities/Delft?share={link}")).unwrap(), expected);
        assert_eq!(expected.to_string(), "https://h/v1/cities/delft");
        for invalid in
            ["https://h/v1/cities/A?share=secret", "https://h/maps/delft?share=secret", "https://h?share=secret&"]
        {
            let error = CityLocation::parse(invalid).unwrap_err();
            assert!(error.exit_code() == 2 && !error.to_string().contains("secret"), "{error}");
        }
    }

    #[test]
    fn a_user_is_not_shown() {
        for (place, shown) in [
            ("https://me:secret@h/maps/delft", "https://h/maps/delft/"),
            ("http://me@h:1", "http://h:1"),
            ("http://me:secret@h/v1/cities/delft", "http://h/v1/cities/delft"),
        ] {
            assert_eq!(CityLocation::parse(place).unwrap().to_string(), shown);
        }
    }

    #[test]
    fn a_folder_of_cities_names_one() {
        let folder = tempfile::tempdir().unwrap();
        let error = |path: &Path| CityLocation::parse(path).unwrap_err().to_string();
        assert!(error(folder.path()).contains("not a city"));
        std::fs::create_dir(folder.path().join("town")).unwrap();
        std::fs::write(folder.path().join("town").join(MANIFEST_FILE), "{}").unwrap();
        let cities = error(folder.path());
        assert!(cities.contains("folder of cities") && cities.ends_with("town"), "{cities}");
        let missing = error(&folder.path().join("twon"));
        assert!(missing.contains("twon: there is no such"), "{missing}");
    }

    #[test]
    fn other_text_is_a_usage_error() {
        for invalid in [
            "h:1", "ftp://h", "http://", "http://h/v1/cities/A", "http://h/v1/cities/a/b", "http://a b", "nowhere",
            "http://h/x?y",
        ] {
            assert_eq!(CityLocation::parse(invalid).unwrap_err().exit_code(), 2, "{invalid}");
        }
    }
}
