//! TLS with a certificate that can be replaced while the server runs.

use crate::config::TlsConfig;
use arc_swap::ArcSwap;
use insula_archive::file::read_limited;
use std::io;
use std::path::Path;
use std::sync::Arc;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::server::TlsStream;

/// Larger certificates and keys are refused.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// The current certificate and key. Open connections keep those that they started with.
#[derive(Debug)]
pub(super) struct TlsIdentity(ArcSwap<ServerConfig>);

impl TlsIdentity {
    /// Reads certificate and key; `None` if none are configured. Fails if they cannot be read or do not belong together.
    pub(super) fn load(config: &TlsConfig) -> io::Result<Option<Self>> {
        Ok(rustls_config(config)?.map(|config| Self(ArcSwap::from_pointee(config))))
    }

    /// Reads certificate and key again. If that fails, the old ones stay in use.
    pub(super) fn reload(&self, config: &TlsConfig) -> io::Result<()> {
        if let Some(config) = rustls_config(config)? {
            self.0.store(Arc::new(config));
        }
        Ok(())
    }

    /// Performs the handshake. Fails if the client offers nothing that the server accepts.
    pub(super) async fn accept<S: AsyncRead + AsyncWrite + Unpin>(&self, stream: S) -> io::Result<TlsStream<S>> {
        TlsAcceptor::from(self.0.load_full()).accept(stream).await
    }
}

fn rustls_config(config: &TlsConfig) -> io::Result<Option<ServerConfig>> {
    let (Some(certificate), Some(key)) = (&config.certificate, &config.key) else { return Ok(None) };
    let invalid = |path: &Path, reason: String| {
        io::Error::new(io::ErrorKind::InvalidData, format!("{}: {reason}", path.display()))
    };
    let read = |path: &Path| {
        let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
        read_limited(path, MAX_FILE_BYTES).map_err(named)
    };
    let (certificates, key_text) = (read(certificate)?, read(key)?);
    let chain: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&certificates).collect();
    let chain = chain.map_err(|error| invalid(certificate, error.to_string()))?;
    // rustls does not quote the key in this error.
    let private_key = PrivateKeyDer::from_pem_slice(&key_text).map_err(|error| invalid(key, error.to_string()))?;
    let provider = Arc::new(ring::default_provider());
    let mut rustls = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(io::Error::other)?
        .with_no_client_auth()
        .with_single_cert(chain, private_key)
        .map_err(|error| invalid(certificate, error.to_string()))?;
    rustls.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
    // Session tickets save returning clients a full handshake. The ticketer rotates its key itself.
    rustls.ticketer = ring::Ticketer::new().map_err(io::Error::other)?;
    Ok(Some(rustls))
}
