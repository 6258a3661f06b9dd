//! The host that a request is for: `:authority` or the target's authority, else `Host`. The client that it comes from.

use super::connection_state::ConnectionState;
use super::problem::Problem;
use crate::config::Network;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, Version, header};
use std::net::IpAddr;
use std::sync::Arc;

const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// The host of a request with its port. `None` if it names none, or none that is ASCII text.
pub(super) fn request_host<'a>(uri: &'a Uri, headers: &'a HeaderMap) -> Option<&'a str> {
    let header = || headers.get(header::HOST).and_then(|host| host.to_str().ok());
    uri.authority().map(|authority| authority.as_str()).or_else(header)
}

/// Checks the host of a request on a connection. Fails with 400 if there is none or more than one (RFC 9112, 3.2; RFC 9113,
/// 8.3.1), or with 421 if it is none of `allowed`. Without the latter check, a page could read a server of its reader's machine
/// under a name of its own (DNS rebinding). `allowed` may be empty: then any host will do.
pub(super) fn check_host(
    connection: Option<&Arc<ConnectionState>>,
    parts: &Parts,
    allowed: &[String],
) -> Result<(), Problem> {
    if connection.is_none() {
        return Ok(());
    }
    let mut named = parts.headers.get_all(header::HOST).iter();
    let (first, second) = (named.next(), named.next());
    let authority = parts.uri.authority().map(|authority| authority.as_str());
    let is_missing = first.is_none() && authority.is_none() && parts.version >= Version::HTTP_11;
    // Of HTTP/1.1, the target's authority replaces `Host`.
    let differs = |host: &HeaderValue| authority.is_some_and(|authority| authority.as_bytes() != host.as_bytes());
    if is_missing || second.is_some() || (parts.version == Version::HTTP_2 && first.is_some_and(differs)) {
        return Err(Problem::bad_request("a request must name one host"));
    }
    if allowed.is_empty() {
        return Ok(());
    }
    let host = request_host(&parts.uri, &parts.headers).unwrap_or_default();
    if allowed.iter().any(|allowed| without_port(host).eq_ignore_ascii_case(allowed)) {
        return Ok(());
    }
    Err(Problem::new(StatusCode::MISDIRECTED_REQUEST, "this server does not serve this host"))
}

/// The address of a request's client: that of the connection, unless that is a trusted proxy's. Then it is the last address of
/// `X-Forwarded-For` that is not a trusted proxy's: those before it are the client's own words. The proxy's if there is none.
pub(super) fn client_address(connection: IpAddr, proxies: &[Network], headers: &HeaderMap) -> IpAddr {
    let is_proxy = |ip: &IpAddr| proxies.iter().any(|network| network.contains(*ip));
    if proxies.is_empty() || !is_proxy(&connection) {
        return connection;
    }
    let lists: Vec<_> = headers.get_all(FORWARDED_FOR).iter().filter_map(|value| value.to_str().ok()).collect();
    let words = lists.iter().rev().flat_map(|list| list.rsplit(','));
    let mut addresses = words.map(|word| word.trim().parse().ok());
    // What is no address was not written by a proxy that can be understood.
    addresses.find(|ip: &Option<IpAddr>| ip.is_none_or(|ip| !is_proxy(&ip))).flatten().unwrap_or(connection)
}

fn without_port(host: &str) -> &str {
    let is_port = |port: &str| port.bytes().all(|byte| byte.is_ascii_digit());
    match host.rsplit_once(':') {
        Some((name, port)) if is_port(port) => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_are_no_part_of_a_host() {
        for (host, name) in [("a.b:1", "a.b"), ("a", "a"), ("[::1]:80", "[::1]"), ("[::1]", "[::1]"), ("", "")] {
            assert_eq!(without_port(host), name);
        }
    }

    #[test]
    fn a_proxy_names_its_client_and_nobody_else_does() {
        let proxies: Vec<Network> = ["10.0.0.0/8", "::1"].iter().map(|text| text.parse().unwrap()).collect();
        for (connection, forwarded, client) in [
            ("192.0.2.1", &["203.0.113.5"][..], "192.0.2.1"),
            ("10.0.0.1", &["203.0.113.5"], "203.0.113.5"),
            ("10.0.0.1", &["6.6.6.6, 203.0.113.5, 10.2.3.4"], "203.0.113.5"),
            ("::1", &["6.6.6.6", "2001:db8::7"], "2001:db8::7"),
            ("10.0.0.1", &["6.6.6.6, unknown"], "10.0.0.1"),
            ("10.0.0.1", &["10.9.9.9"], "10.0.0.1"),
            ("10.0.0.1", &[], "10.0.0.1"),
        ] {
            let headers = forwarded.iter().map(|text| (FORWARDED_FOR, HeaderValue::from_static(text)));
            let mut map = HeaderMap::new();
            headers.for_each(|(name, value)| {
                map.append(name, value);
            });
            let expected: IpAddr = client.parse().unwrap();
            assert_eq!(client_address(connection.parse().unwrap(), &proxies, &map), expected, "{forwarded:?}");
            assert_eq!(client_address(connection.parse().unwrap(), &[], &map).to_string(), connection);
        }
    }
}
