//! The address at which people reach a server that stands behind a proxy.

use std::fmt;
use std::str::FromStr;

/// Longest address in bytes.
const MAX_BYTES: usize = 512;

/// `https://HOST/PATH/`: scheme, host and the path below which a proxy has the server.
#[derive(Clone, PartialEq, Eq)]
pub struct PublicUrl {
    /// With a slash at the end.
    text: String,
    /// Where the path begins.
    path_at: usize,
}

impl PublicUrl {
    /// The whole address, with a slash at its end.
    pub fn as_str(&self) -> &str {
        &self.text
    }

    /// The address without the slash at its end: what paths of the server are appended to.
    pub fn base(&self) -> &str {
        self.text.trim_end_matches('/')
    }

    /// The path without the slash at its end; empty if the server has a host of its own.
    pub fn prefix(&self) -> &str {
        self.text[self.path_at..].trim_end_matches('/')
    }
}

impl FromStr for PublicUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let invalid = || format!("{text:?} is not an address such as \"https://example.org/city/\"");
        let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://")).ok_or_else(invalid)?;
        let host = rest.split('/').next().unwrap_or_default();
        let path = &rest[host.len()..];
        let is_host = |byte: u8| byte.is_ascii_alphanumeric() || b".-:[]_".contains(&byte);
        let is_path = |byte: u8| byte.is_ascii_alphanumeric() || b"/.-_~".contains(&byte);
        // Relative addresses must mean the same for browsers and here.
        let is_plain = !path.contains("//") && path.split('/').all(|part| part != "." && part != "..");
        let is_valid = text.len() <= MAX_BYTES && !host.is_empty() && host.bytes().all(is_host);
        if !is_valid || !is_plain || !path.bytes().all(is_path) {
            return Err(invalid());
        }
        let slash = if path.ends_with('/') { "" } else { "/" };
        Ok(Self { text: format!("{text}{slash}"), path_at: text.len() - path.len() })
    }
}

impl fmt::Debug for PublicUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.text, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_base_and_a_prefix() {
        for (text, base, prefix) in [
            ("https://a.b", "https://a.b", ""),
            ("http://a:80/", "http://a:80", ""),
            ("https://[::1]:1/city", "https://[::1]:1/city", "/city"),
            ("https://a/maps/3d/", "https://a/maps/3d", "/maps/3d"),
        ] {
            let url: PublicUrl = text.parse().unwrap();
            assert_eq!((url.base(), url.prefix()), (base, prefix), "{text}");
            assert_eq!(url.as_str().parse::<PublicUrl>().unwrap(), url);
        }
    }

    #[test]
    fn what_could_be_another_address_is_refused() {
        let long = format!("https://a/{}", "b".repeat(MAX_BYTES));
        for text in [
            "", "a", "ftp://a", "https://", "https:///a", "https://a b", "https://a/?b", "https://a/#b",
            "https://a/%2e",
        ]
        .into_iter()
        .chain(["https://a//b", "https://a/../b", "https://u@a", "https://a/<b>", "https://a/\"b", &long])
        {
            assert!(text.parse::<PublicUrl>().is_err(), "{text}");
        }
    }
}
