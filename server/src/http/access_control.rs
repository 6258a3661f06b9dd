//! Bearer tokens and private cities.
//!
//! Tokens are stored and compared as BLAKE3 hashes, whose comparison takes constant time. They never reach the log: they are
//! not part of a path, and headers are not logged.

use super::problem::Problem;
use crate::config;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use std::{collections::BTreeSet, io, path::Path};

const MAX_FILE_BYTES: u64 = 1 << 20;
/// 16 random characters carry at least 64 bits.
const MIN_TOKEN_BYTES: usize = 16;

/// The accepted tokens and the cities that need one.
#[derive(Debug, Default)]
pub(super) struct AccessControl {
    tokens: Vec<blake3::Hash>,
    /// If empty and there are tokens, all cities are private.
    private: BTreeSet<String>,
}

/// How a request was granted access to a city; decides how its responses may be cached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CityAccess {
    Public,
    Private,
}

impl AccessControl {
    /// Reads the token file. Fails if it cannot be read, holds no token, or holds one that is too short.
    pub(super) fn load(config: &config::AccessConfig) -> io::Result<Self> {
        let Some(path) = &config.tokens else { return Ok(Self::default()) };
        let tokens = read_tokens(path)?;
        Ok(Self { tokens, private: config.private.iter().cloned().collect() })
    }

    /// Whether the city needs a token.
    pub(super) fn is_private(&self, city: &str) -> bool {
        !self.tokens.is_empty() && (self.private.is_empty() || self.private.contains(city))
    }

    /// Whether the request has a valid token. Compares with every token, so that the time does not depend on the match.
    pub(super) fn has_token(&self, headers: &HeaderMap) -> bool {
        let value = headers.get(header::AUTHORIZATION).map(HeaderValue::as_bytes).unwrap_or_default();
        let Some((scheme, token)) = value.split_at_checked(7) else { return false };
        let given = blake3::hash(token.trim_ascii());
        let found = self.tokens.iter().fold(false, |found, token| found | (*token == given));
        found && scheme.eq_ignore_ascii_case(b"bearer ")
    }

    /// Grants access to a city. Fails with 401 for a private city without a token, even if the city does not exist.
    pub(super) fn authorize(&self, city: &str, headers: &HeaderMap) -> Result<CityAccess, Problem> {
        if !self.is_private(city) {
            Ok(CityAccess::Public)
        } else if self.has_token(headers) {
            Ok(CityAccess::Private)
        } else {
            let challenge = HeaderValue::from_static("Bearer realm=\"insula\"");
            let detail = "this city is not public: send a bearer token";
            Err(Problem::new(StatusCode::UNAUTHORIZED, detail).with(header::WWW_AUTHENTICATE, challenge))
        }
    }
}

fn read_tokens(path: &Path) -> io::Result<Vec<blake3::Hash>> {
    let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    if std::fs::metadata(path)?.len() > MAX_FILE_BYTES {
        return Err(invalid("the token file is larger than 1 MiB"));
    }
    let text = std::fs::read_to_string(path)?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut tokens = Vec::new();
    for token in lines {
        if token.len() < MIN_TOKEN_BYTES || !token.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(invalid("a token must be one line of at least 16 visible characters without spaces"));
        }
        tokens.push(blake3::hash(token.as_bytes()));
    }
    if tokens.is_empty() { Err(invalid("the token file contains no token")) } else { Ok(tokens) }
}
