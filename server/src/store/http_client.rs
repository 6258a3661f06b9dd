//! The HTTP client of object stores and web servers.

use insula_protocol::route::is_same_host;
use object_store::{
    ClientOptions,
    client::{HttpClient, HttpConnector},
};
use reqwest::redirect::{Attempt, Policy};
use std::time::Duration;

/// Limit for opening a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Limit for a request; [`super::requests::StoreRequests`] mostly ends it earlier.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(30);
/// Most redirects of a request.
const MAX_REDIRECTS: usize = 5;

/// Makes clients that follow redirects only to the host that was asked ([`is_same_host`]).
#[derive(Debug)]
pub(super) struct SameHostConnector;

impl HttpConnector for SameHostConnector {
    fn connect(&self, _: &ClientOptions) -> object_store::Result<HttpClient> {
        let client = reqwest::Client::builder()
            .user_agent(concat!("insula-server/", env!("CARGO_PKG_VERSION")))
            .connect_timeout(CONNECT_TIMEOUT)
            .timeout(REQUEST_TIMEOUT)
            // Many connections carry more than the streams of one.
            .http1_only()
            .redirect(Policy::custom(|attempt| {
                let is_allowed = is_to_same_host(&attempt) && attempt.previous().len() <= MAX_REDIRECTS;
                if is_allowed { attempt.follow() } else { attempt.error("redirects to other hosts are not followed") }
            }))
            .build();
        let client = client.map_err(|error| object_store::Error::Generic { store: "HTTP", source: error.into() })?;
        Ok(HttpClient::new(client))
    }
}

fn is_to_same_host(attempt: &Attempt<'_>) -> bool {
    attempt.previous().last().is_some_and(|from| is_same_host(from.as_str(), attempt.url().as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use object_store::{ObjectStoreExt as _, RetryConfig, http::HttpBuilder, path::Path};
    use std::{
        io::{Read, Write},
        net::TcpListener,
    };

    /// Sends the next of `heads` on each connection, without a body.
    fn serve(heads: Vec<String>) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for (head, stream) in heads.iter().zip(listener.incoming()) {
                let mut stream = stream.unwrap();
                let _ = stream.read(&mut [0; 2048]);
                write!(stream, "HTTP/1.1 {head}\r\nconnection: close\r\ncontent-length: 0\r\n\r\n").unwrap();
            }
        });
        url
    }

    #[tokio::test]
    async fn redirects_are_followed_within_a_host_only() {
        let found = "200 OK\r\nlast-modified: Sun, 06 Nov 1994 08:49:37 GMT";
        let other = serve(vec![found.into()]);
        let options = || ClientOptions::new().with_allow_http(true);
        for (location, is_followed) in [("/b", true), (other.as_str(), false)] {
            let host = serve(vec![format!("302 Found\r\nlocation: {location}"), found.into()]);
            let retry = RetryConfig { max_retries: 0, ..RetryConfig::default() };
            let store = HttpBuilder::new().with_url(host).with_retry(retry).with_client_options(options());
            let store = store.with_http_connector(SameHostConnector).build().unwrap();
            let got = store.get(&Path::from("a")).await;
            assert_eq!(got.is_ok(), is_followed, "{location}: {got:?}");
        }
    }
}
