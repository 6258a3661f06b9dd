//! Who may see which city.
//!
//! In: a request's `Authorization`. Out: whether the city is public, or may be seen, or 401. Next: `tile`, `manifest`.
//!
//! Tokens are kept and compared as BLAKE3 hashes, whose comparison takes the same time wherever they differ. They are never
//! logged: they are in no path, and headers are not logged.

use super::problem::Problem;
use crate::config;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use std::{collections::BTreeSet, io, path::Path};

/// Longest file of tokens.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// Shortest token: 16 characters can hold 64 bits and more.
const MIN_TOKEN_BYTES: usize = 16;

/// The rules.
#[derive(Debug, Default)]
pub(super) struct AccessControl {
    tokens: Vec<blake3::Hash>,
    /// Empty: all cities, if there are tokens.
    private: BTreeSet<String>,
}

/// How a request sees a city.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CityAccess {
    /// As everybody does.
    Public,
    /// With a token.
    Private,
}

impl AccessControl {
    /// Reads the tokens. Errors: the file cannot be read, has no token, or one that could be guessed.
    pub(super) fn read(config: &config::AccessConfig) -> io::Result<Self> {
        let Some(path) = &config.tokens else { return Ok(Self::default()) };
        let tokens = read_tokens(path)?;
        Ok(Self { tokens, private: config.private.iter().cloned().collect() })
    }

    /// Whether a token is asked for.
    pub(super) fn is_private(&self, city: &str) -> bool {
        !self.tokens.is_empty() && (self.private.is_empty() || self.private.contains(city))
    }

    /// Whether the request bears a token. All are compared, whichever matches.
    pub(super) fn has_token(&self, headers: &HeaderMap) -> bool {
        let value = headers.get(header::AUTHORIZATION).map(HeaderValue::as_bytes).unwrap_or_default();
        let Some((scheme, token)) = value.split_at_checked(7) else { return false };
        let given = blake3::hash(token.trim_ascii());
        let found = self.tokens.iter().fold(false, |found, token| found | (*token == given));
        found && scheme.eq_ignore_ascii_case(b"bearer ")
    }

    /// How the request sees a city. Errors: 401, also for a private city that does not exist.
    pub(super) fn sight(&self, city: &str, headers: &HeaderMap) -> Result<CityAccess, Problem> {
        if !self.is_private(city) {
            Ok(CityAccess::Public)
        } else if self.has_token(headers) {
            Ok(CityAccess::Private)
        } else {
            let challenge = HeaderValue::from_static("Bearer realm=\"insula\"");
            let detail = "this city is not public: a bearer token is wanted";
            Err(Problem::new(StatusCode::UNAUTHORIZED, detail).with(header::WWW_AUTHENTICATE, challenge))
        }
    }
}

fn read_tokens(path: &Path) -> io::Result<Vec<blake3::Hash>> {
    let wrong = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    if std::fs::metadata(path)?.len() > MAX_FILE_BYTES {
        return Err(wrong("a file of tokens is at most 1 MiB"));
    }
    let text = std::fs::read_to_string(path)?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut tokens = Vec::new();
    for token in lines {
        if token.len() < MIN_TOKEN_BYTES || !token.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(wrong("a token is one line of at least 16 visible characters without spaces"));
        }
        tokens.push(blake3::hash(token.as_bytes()));
    }
    if tokens.is_empty() { Err(wrong("there is no token in it")) } else { Ok(tokens) }
}
