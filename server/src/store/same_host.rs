//! The HTTP client for object stores, and for cities behind web servers. A server may be hostile, so it cannot send this machine elsewhere.

use insula_command_line::http::{self, Elsewhere, Redirects};
use object_store::client::{HttpClient, HttpConnector};
use object_store::{ClientOptions, Result};
use std::time::Duration;

const CONNECT: Duration = Duration::from_secs(5);

/// Makes clients that follow redirects to the same host only.
#[derive(Debug)]
pub(crate) struct SameHostConnector {
    /// Time limit of a request with its response.
    pub(crate) timeout: Duration,
}

impl HttpConnector for SameHostConnector {
    fn connect(&self, _options: &ClientOptions) -> Result<HttpClient> {
        let client = http::client(Redirects::SameHost, Elsewhere::Error)
            .connect_timeout(CONNECT)
            .timeout(self.timeout)
            .user_agent(concat!("insula-server/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(|error| object_store::Error::Generic { store: "HTTP", source: Box::new(error) })?;
        Ok(HttpClient::new(client))
    }
}
