//! Bearer tokens, share links and private cities.
//!
//! Tokens are stored and compared as BLAKE3 hashes, whose comparison takes constant time. Neither they nor share links reach the
//! log: they are not part of a path, and headers and queries are not logged.

use super::problem::Problem;
use crate::config;
use crate::secret_file::SecretFile;
use crate::share_link::{self, ShareGrant, ShareKeys, ShareScope};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use insula_protocol::route::RouteTemplate;
use std::collections::BTreeSet;
use std::path::Path;
use std::time::SystemTime;

/// 16 random characters carry at least 64 bits.
const MIN_TOKEN_BYTES: usize = 16;

/// The accepted tokens and share links, and the cities that need one.
#[derive(Debug, Default, PartialEq)]
pub(super) struct AccessControl {
    /// Tokens or share links are configured. Their files may be empty: then nothing opens a private city.
    pub(super) is_restricted: bool,
    tokens: BTreeSet<[u8; 32]>,
    share_keys: ShareKeys,
    /// If empty, all cities are private.
    private: BTreeSet<String>,
}

/// How a request was granted access to a city.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CityAccess {
    Public,
    Token,
    Link(ShareScope),
}

/// What a request shows to open private cities.
#[derive(Debug, Clone, Copy)]
pub(super) struct Credentials<'a> {
    headers: &'a HeaderMap,
    link: Option<&'a str>,
}

/// A city or a version of it that a request asks for.
#[derive(Debug, Clone, Copy)]
pub(super) struct AccessRequest<'a> {
    pub(super) route: RouteTemplate,
    pub(super) city: &'a str,
    /// `None` if there is no such city.
    pub(super) version: Option<&'a str>,
}

impl<'a> Credentials<'a> {
    pub(super) fn of(request: &'a Parts) -> Self {
        Self { headers: &request.headers, link: request.uri.query().and_then(share_link::from_query) }
    }
}

impl CityAccess {
    pub(super) fn is_public(self) -> bool {
        self == Self::Public
    }

    /// Whether what is computed of the whole city may be sent.
    pub(super) fn admits_computed(self, route: RouteTemplate) -> bool {
        if let Self::Link(scope) = self { scope.admits_computed(route) } else { true }
    }
}

impl AccessControl {
    /// Without any tokens and keys: nothing opens a private city.
    pub(super) fn closed(config: &config::AccessConfig) -> Self {
        let private = config.private.iter().cloned().collect();
        Self { is_restricted: config.is_restricted(), private, ..Self::default() }
    }

    /// Reads the files of tokens and keys. Also returns what is wrong with them: what they do not list opens nothing.
    pub(super) fn load(config: &config::AccessConfig) -> (Self, Vec<String>) {
        let mut access = Self::closed(config);
        let mut faults = Vec::new();
        if let Some(path) = &config.tokens {
            let tokens = read_tokens(path);
            access.tokens.extend(tokens.entries);
            faults.extend(tokens.faults);
        }
        if let Some(path) = &config.share_keys {
            let (keys, key_faults) = ShareKeys::read(path);
            access.share_keys = keys;
            faults.extend(key_faults);
        }
        (access, faults)
    }

    /// Whether there are tokens or keys, or none are configured.
    pub(super) fn is_usable(&self) -> bool {
        !self.is_restricted || !self.tokens.is_empty() || !self.share_keys.is_empty()
    }

    /// Whether a city of this name needs no token.
    pub(super) fn is_public(&self, city: &str) -> bool {
        !self.is_restricted || !(self.private.is_empty() || self.private.contains(city))
    }

    /// Whether the request has a valid token. Compares with every token, so that the time does not depend on the match.
    pub(super) fn has_token(&self, credentials: Credentials<'_>) -> bool {
        let value = credentials.headers.get(header::AUTHORIZATION).map(HeaderValue::as_bytes).unwrap_or_default();
        let Some((scheme, token)) = value.split_at_checked(7) else { return false };
        let given = blake3::hash(token.trim_ascii());
        let tokens = self.tokens.iter().map(|token| blake3::Hash::from_bytes(*token));
        let found = tokens.fold(false, |found, token| found | (token == given));
        found && scheme.eq_ignore_ascii_case(b"bearer ")
    }

    /// What the request's share link opens, if it has a valid one: the version of its city is for the caller to check.
    pub(super) fn shared(&self, credentials: Credentials<'_>) -> Option<ShareGrant> {
        self.share_keys.verify(credentials.link?, SystemTime::now())
    }

    /// Grants access to a city. Without a token or link, fails with the same 401 for a private city as for one that does not
    /// exist, so that names cannot be guessed. A public server responds to the latter with 404, after this.
    pub(super) fn authorize(
        &self,
        credentials: Credentials<'_>,
        request: AccessRequest<'_>,
    ) -> Result<CityAccess, Problem> {
        if !self.is_restricted || (request.version.is_some() && self.is_public(request.city)) {
            return Ok(CityAccess::Public);
        }
        if self.has_token(credentials) {
            return Ok(CityAccess::Token);
        }
        let is_admitted = |grant: &ShareGrant| {
            grant.city == request.city
                && request.version.is_some_and(|version| grant.admits_version(version))
                && grant.scope.admits_route(request.route)
        };
        match self.shared(credentials).filter(is_admitted) {
            Some(grant) => Ok(CityAccess::Link(grant.scope)),
            None => Err(unauthorized()),
        }
    }
}

fn unauthorized() -> Problem {
    let challenge = HeaderValue::from_static("Bearer realm=\"insula\"");
    let detail = "there is no public city of this name: send a bearer token, or open a valid link to a private one";
    Problem::new(StatusCode::UNAUTHORIZED, detail).with(header::WWW_AUTHENTICATE, challenge)
}

fn read_tokens(path: &Path) -> SecretFile<[u8; 32]> {
    SecretFile::read(path, |token| {
        let is_valid = token.len() >= MIN_TOKEN_BYTES && token.bytes().all(|byte| byte.is_ascii_graphic());
        let hash = is_valid.then(|| *blake3::hash(token.as_bytes()).as_bytes());
        hash.ok_or("a token must be one line of at least 16 visible characters without spaces")
    })
}
