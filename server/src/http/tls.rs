//! TLS, with a certificate that can be replaced while the server runs.
//!
//! In: PEM files. Out: streams in the clear. Next: `connection`.

use crate::config;
use arc_swap::ArcSwap;
use std::{io, path::Path, sync::Arc};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        ServerConfig,
        crypto::aws_lc_rs,
        pki_types::{CertificateDer, PrivateKeyDer, pem::PemObject},
    },
    server::TlsStream,
};

/// The present certificate; connections keep the one that they began with.
#[derive(Debug)]
pub(super) struct TlsIdentity(ArcSwap<ServerConfig>);

impl TlsIdentity {
    /// `None` if no certificate is configured. Errors: it cannot be used.
    pub(super) fn read(config: &config::TlsConfig) -> io::Result<Option<Self>> {
        Ok(server_config(config)?.map(|config| Self(ArcSwap::from_pointee(config))))
    }

    /// Reads it again; what cannot be used changes nothing.
    pub(super) fn reload(&self, config: &config::TlsConfig) -> io::Result<()> {
        if let Some(config) = server_config(config)? {
            self.0.store(Arc::new(config));
        }
        Ok(())
    }

    /// The handshake.
    pub(super) async fn accept<S: AsyncRead + AsyncWrite + Unpin>(&self, stream: S) -> io::Result<TlsStream<S>> {
        TlsAcceptor::from(self.0.load_full()).accept(stream).await
    }
}

fn server_config(config: &config::TlsConfig) -> io::Result<Option<ServerConfig>> {
    let (Some(certificate), Some(key)) = (&config.certificate, &config.key) else { return Ok(None) };
    let wrong = |path: &Path, reason: String| {
        io::Error::new(io::ErrorKind::InvalidData, format!("{}: {reason}", path.display()))
    };
    let chain: Result<Vec<_>, _> = CertificateDer::pem_file_iter(certificate).and_then(Iterator::collect);
    let chain = chain.map_err(|error| wrong(certificate, error.to_string()))?;
    // The error of a key says nothing of the key.
    let secret = PrivateKeyDer::from_pem_file(key).map_err(|error| wrong(key, error.to_string()))?;
    let provider = Arc::new(aws_lc_rs::default_provider());
    let mut made = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(io::Error::other)?
        .with_no_client_auth()
        .with_single_cert(chain, secret)
        .map_err(|error| wrong(certificate, error.to_string()))?;
    made.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
    // So that a client that comes again needs no second handshake; the key changes by itself.
    made.ticketer = aws_lc_rs::Ticketer::new().map_err(io::Error::other)?;
    Ok(Some(made))
}
