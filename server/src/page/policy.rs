//! The Content-Security-Policy of pages.

use super::list_page::STYLE;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};
use std::sync::LazyLock;

/// A page can be shown in frames of other sites, as a map is.
const FRAMES: &str = "; frame-ancestors *";
const VIEWER: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; \
    img-src 'self' blob: data:; connect-src 'self'; worker-src 'self'; manifest-src 'self'; \
    base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; trusted-types insula";

/// The policy of pages with the viewer: only files of this host, and WebAssembly.
pub(crate) fn viewer_policy() -> &'static str {
    static POLICY: LazyLock<String> = LazyLock::new(|| VIEWER.to_owned() + FRAMES);
    &POLICY
}

/// The policy of lists: no scripts, and the one style that they have.
pub(crate) fn list_policy() -> &'static str {
    static POLICY: LazyLock<String> = LazyLock::new(|| {
        let hash = STANDARD.encode(Sha256::digest(STYLE.as_bytes()));
        format!(
            "default-src 'none'; style-src 'sha256-{hash}'; img-src 'self' data:; manifest-src 'self'; base-uri 'none'; \
             form-action 'none'{FRAMES}"
        )
    });
    &POLICY
}

/// A policy for a `<meta>` element, where browsers complain about a rule for frames.
pub(crate) fn meta_policy(policy: &str) -> String {
    policy.strip_suffix(FRAMES).unwrap_or(policy).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_allow_nothing_inline() {
        for policy in [viewer_policy(), list_policy()] {
            assert!(policy.starts_with("default-src 'none'; ") && !policy.contains("unsafe-inline"), "{policy}");
            assert!(policy.ends_with(FRAMES) && !meta_policy(policy).contains("frame-ancestors"));
        }
    }
}
