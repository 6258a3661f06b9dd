//! The cryptography of TLS.

/// Chooses ring for all TLS of this process, unless the program chose another before. Everything that makes an HTTP client
/// calls it first, because a client without cryptography panics.
pub fn choose_cryptography() {
    let _ = rustls::crypto::ring::default_provider().install_default();
}
