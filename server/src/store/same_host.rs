//! The HTTP client for cities behind web servers. A server may be hostile, so it cannot send this machine elsewhere.

use insula_protocol::route::is_same_host;
use object_store::{
    ClientOptions, Result,
    client::{HttpClient, HttpConnector},
};
use reqwest::redirect::Policy;
use std::time::Duration;

const CONNECT: Duration = Duration::from_secs(5);
const MAX_REDIRECTS: usize = 5;

/// Makes clients that follow redirects to the same host only ([`is_same_host`]).
#[derive(Debug)]
pub(super) struct SameHostConnector {
    /// Time limit of a request with its response.
    pub(super) timeout: Duration,
}

impl HttpConnector for SameHostConnector {
    fn connect(&self, _options: &ClientOptions) -> Result<HttpClient> {
        insula_command_line::tls::choose_cryptography();
        let client = reqwest::Client::builder()
            .connect_timeout(CONNECT)
            .timeout(self.timeout)
            .user_agent(concat!("insula-server/", env!("CARGO_PKG_VERSION")))
            .redirect(Policy::custom(|attempt| {
                let is_allowed =
                    attempt.previous().last().is_some_and(|from| is_same_host(from.as_str(), attempt.url().as_str()));
                match attempt.previous().len() {
                    length if length > MAX_REDIRECTS => attempt.error("too many redirects"),
                    _ if is_allowed => attempt.follow(),
                    _ => attempt.error("it redirects to another host"),
                }
            }))
            .build()
            .map_err(|error| object_store::Error::Generic { store: "HTTP", source: Box::new(error) })?;
        Ok(HttpClient::new(client))
    }
}
