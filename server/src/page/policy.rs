//! The Content-Security-Policy of pages.

use super::list_page::STYLE;
use sha2::{Digest, Sha256};
use std::{fmt::Write, sync::LazyLock};

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
        let hash = base64(&Sha256::digest(STYLE.as_bytes()));
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

pub(super) fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let bits = chunk.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - chunk.len()));
        for place in 0..=chunk.len() {
            let _ = out.write_char(char::from(DIGITS[(bits >> (18 - 6 * place)) as usize & 63]));
        }
    }
    out + &"=".repeat((3 - bytes.len() % 3) % 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        for (text, expected) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(text.as_bytes()), expected);
        }
        assert_eq!(base64(&[0xfb, 0xff]), "+/8=");
    }

    #[test]
    fn policies_allow_nothing_inline() {
        for policy in [viewer_policy(), list_policy()] {
            assert!(policy.starts_with("default-src 'none'; ") && !policy.contains("unsafe-inline"), "{policy}");
            assert!(policy.ends_with(FRAMES) && !meta_policy(policy).contains("frame-ancestors"));
        }
    }
}
