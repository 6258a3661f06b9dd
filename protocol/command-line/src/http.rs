//! HTTP clients. A server may be hostile, so it cannot send this machine elsewhere.

use crate::private_network::{GuardedNames, SystemNames};
use insula_protocol::route::{host_of, is_same_host};
use reqwest::ClientBuilder;
use reqwest::redirect::Policy;
use std::error::Error;

const MAX_REDIRECTS: usize = 5;

/// Where responses may send a client. Other hosts could be of the private network of this machine.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Redirects {
    /// To the host that was asked ([`is_same_host`]).
    #[default]
    SameHost,
    /// To it, and to these hosts, each with its port if it is not the scheme's.
    Hosts(Vec<String>),
    All,
}

impl Redirects {
    fn allows(&self, from: &str, to: &str) -> bool {
        let is_named = match self {
            Self::SameHost => false,
            Self::Hosts(hosts) => {
                host_of(to).is_some_and(|host| hosts.iter().any(|own| own.eq_ignore_ascii_case(host)))
            }
            Self::All => true,
        };
        is_named || is_same_host(from, to)
    }
}

/// What a redirect elsewhere is to the caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Elsewhere {
    Response,
    Error,
}

/// The beginning of every client of both programs. More than 5 redirects are an error. No host learns from where it is
/// asked: addresses may have share links or signatures. A host of the internet does not become one of the private network.
pub fn client(redirects: Redirects, elsewhere: Elsewhere) -> ClientBuilder {
    super::tls::choose_cryptography();
    let policy = Policy::custom(move |attempt| {
        if attempt.previous().len() > MAX_REDIRECTS {
            return attempt.error("too many redirects");
        }
        let from = attempt.previous().last().map(ToString::to_string).unwrap_or_default();
        match elsewhere {
            _ if redirects.allows(&from, attempt.url().as_str()) => attempt.follow(),
            Elsewhere::Response => attempt.stop(),
            Elsewhere::Error => attempt.error("it redirects to another host"),
        }
    });
    reqwest::Client::builder().referer(false).redirect(policy).dns_resolver(GuardedNames::new(SystemNames))
}

/// The innermost cause of an error, which is the most specific one ("connection refused", "too many redirects").
pub fn cause_of(error: &dyn Error) -> String {
    let mut cause = error;
    while let Some(next) = cause.source() {
        cause = next;
    }
    cause.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn redirects_lead_to_the_same_host_or_to_named_ones() {
        let named = Redirects::Hosts(vec!["CDN.example.org".into(), "tiles.example.org:8443".into()]);
        for (to, is_same, is_named) in [
            ("https://example.org/b", true, true),
            ("https://cdn.example.org/b", false, true),
            ("https://user@cdn.example.org/b", false, true),
            ("https://tiles.example.org:8443/b", false, true),
            ("https://tiles.example.org/b", false, false),
            ("https://cdn.example.org.evil.net/b", false, false),
            ("http://169.254.169.254/latest", false, false),
            ("http://[::1]/", false, false),
        ] {
            let from = "https://example.org/a";
            let found = [&Redirects::SameHost, &named, &Redirects::All].map(|rule| rule.allows(from, to));
            assert_eq!(found, [is_same, is_named, true], "{to}");
        }
    }
}
