//! Normal forms of Unicode. Browsers have their tables, which would be a tenth of the viewer's module.

#[cfg(not(target_arch = "wasm32"))]
mod tables {
    use std::borrow::Cow;
    use unicode_normalization::{IsNormalized, UnicodeNormalization, is_nfkc_quick};

    /// Normalization form KC.
    pub(in super::super) fn nfkc(text: &str) -> Cow<'_, str> {
        let is_normal = is_nfkc_quick(text.chars()) == IsNormalized::Yes;
        if is_normal { Cow::Borrowed(text) } else { Cow::Owned(text.nfkc().collect()) }
    }

    /// Calls `emit` with the characters of the canonical decomposition.
    pub(in super::super) fn decompose(c: char, emit: impl FnMut(char)) {
        unicode_normalization::char::decompose_canonical(c, emit);
    }

    /// Whether the character is of the general category Mark.
    pub(in super::super) fn is_mark(c: char) -> bool {
        unicode_normalization::char::is_combining_mark(c)
    }
}

#[cfg(target_arch = "wasm32")]
mod tables {
    use js_sys::{JsString, RegExp};
    use std::borrow::Cow;

    /// Normalization form KC.
    pub(in super::super) fn nfkc(text: &str) -> Cow<'_, str> {
        Cow::Owned(String::from(JsString::from(text).normalize("NFKC")))
    }

    /// Calls `emit` with the characters of the canonical decomposition.
    pub(in super::super) fn decompose(c: char, emit: impl FnMut(char)) {
        String::from(JsString::from(c).normalize("NFD")).chars().for_each(emit);
    }

    /// Whether the character is of the general category Mark.
    pub(in super::super) fn is_mark(c: char) -> bool {
        RegExp::new(r"\p{M}", "u").test(c.encode_utf8(&mut [0; 4]))
    }
}

pub(super) use tables::{decompose, is_mark, nfkc};
