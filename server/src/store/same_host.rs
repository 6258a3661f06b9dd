//! The HTTP client for cities behind web servers. A server may be hostile, so it cannot send this machine elsewhere.

use object_store::{
    ClientOptions, Result,
    client::{HttpClient, HttpConnector},
};
use reqwest::redirect::{Attempt, Policy};
use std::time::Duration;

const CONNECT: Duration = Duration::from_secs(5);
const MAX_REDIRECTS: usize = 5;

/// Makes clients that follow redirects to the same host only: others could lead into this machine's network.
#[derive(Debug)]
pub(super) struct SameHostConnector {
    /// Time limit of a request with its response.
    pub(super) timeout: Duration,
}

impl HttpConnector for SameHostConnector {
    fn connect(&self, _options: &ClientOptions) -> Result<HttpClient> {
        let client = reqwest::Client::builder()
            .connect_timeout(CONNECT)
            .timeout(self.timeout)
            .user_agent(concat!("insula-server/", env!("CARGO_PKG_VERSION")))
            .redirect(Policy::custom(|attempt| {
                if attempt.previous().len() > MAX_REDIRECTS {
                    attempt.error("too many redirects")
                } else if leads_elsewhere(&attempt) {
                    attempt.error("it redirects to another host")
                } else {
                    attempt.follow()
                }
            }))
            .build()
            .map_err(|error| object_store::Error::Generic { store: "HTTP", source: Box::new(error) })?;
        Ok(HttpClient::new(client))
    }
}

fn leads_elsewhere(attempt: &Attempt<'_>) -> bool {
    let next = attempt.url();
    let is_same = |first: &reqwest::Url| {
        let is_upgrade = first.scheme() == "http" && next.scheme() == "https";
        first.host_str() == next.host_str() && (first.origin() == next.origin() || is_upgrade)
    };
    !attempt.previous().first().is_some_and(is_same)
}
