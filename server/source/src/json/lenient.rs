//! Numbers that JSON does not allow but some programs write: `NaN`, `Infinity` and numbers beyond f64.

use serde::Deserialize;
use std::io::{self, BufRead, Read};

/// Parses JSON. If that fails, replaces numbers that JSON does not allow by `null` and tries again; `repaired` then
/// holds the text. Fails if the text is still invalid.
pub fn parse<'t, T: Deserialize<'t>>(text: &'t [u8], repaired: &'t mut Vec<u8>) -> serde_json::Result<T> {
    serde_json::from_slice(text).or_else(|error| match replace_invalid_numbers(text) {
        None => Err(error),
        Some(clean) => {
            *repaired = clean;
            serde_json::from_slice(repaired)
        }
    })
}

/// Replaces `NaN`, `Infinity` and numbers beyond f64 outside of strings by `null`, and keeps the line numbers. `None`
/// if there are no such numbers.
pub fn replace_invalid_numbers(text: &[u8]) -> Option<Vec<u8>> {
    let mut clean = Vec::with_capacity(text.len());
    let (mut i, mut changed) = (0, false);
    while i < text.len() {
        let length = match text[i] {
            b'"' => string_length(&text[i..]),
            b'-' | b'+' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' => word_length(&text[i..]),
            _ => 1,
        };
        let token = &text[i..i + length];
        if is_invalid_number(token) {
            clean.extend_from_slice(b"null");
            changed = true;
        } else {
            clean.extend_from_slice(token);
        }
        i += length;
    }
    changed.then_some(clean)
}

/// Length of the string at the start of the text, with its quotes. An unclosed string extends to the end of the text.
fn string_length(text: &[u8]) -> usize {
    let mut i = 1;
    while i < text.len() {
        match text[i] {
            b'\\' => i += 2,
            b'"' => return i + 1,
            _ => i += 1,
        }
    }
    text.len()
}

fn word_length(text: &[u8]) -> usize {
    let in_word = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'-' | b'.');
    text.iter().take_while(|byte| in_word(byte)).count().max(1)
}

fn is_invalid_number(token: &[u8]) -> bool {
    let Ok(token) = std::str::from_utf8(token) else { return false };
    if token.starts_with('"') || !token.contains(['N', 'n', 'I', 'i', 'e', 'E']) && token.len() < 300 {
        return false;
    }
    token.parse::<f64>().is_ok_and(|number| !number.is_finite())
}

/// Replaces `NaN` and `Infinity` by `null` while reading. Outside of strings, JSON has no word that begins with a
/// capital letter.
pub struct LenientReader<R> {
    inner: R,
    in_string: bool,
    escaped: bool,
    /// Remaining bytes of a replacement.
    pending: &'static [u8],
}

impl<R: BufRead> LenientReader<R> {
    /// Reads `inner`.
    pub fn new(inner: R) -> Self {
        Self { inner, in_string: false, escaped: false, pending: b"" }
    }

    fn next(&mut self) -> io::Result<Option<u8>> {
        if let Some((&byte, rest)) = self.pending.split_first() {
            self.pending = rest;
            return Ok(Some(byte));
        }
        let Some(byte) = self.take()? else { return Ok(None) };
        if self.in_string {
            self.in_string = byte != b'"' || self.escaped;
            self.escaped = byte == b'\\' && !self.escaped;
            return Ok(Some(byte));
        }
        self.in_string = byte == b'"';
        let is_capital = |byte: Option<u8>| matches!(byte, Some(b'N' | b'I'));
        if is_capital(Some(byte)) || byte == b'-' && is_capital(self.peek()?) {
            while self.peek()?.is_some_and(|byte| byte.is_ascii_alphabetic()) {
                self.inner.consume(1);
            }
            self.pending = b"ull";
            return Ok(Some(b'n'));
        }
        Ok(Some(byte))
    }

    fn peek(&mut self) -> io::Result<Option<u8>> {
        Ok(self.inner.fill_buf()?.first().copied())
    }

    fn take(&mut self) -> io::Result<Option<u8>> {
        let byte = self.peek()?;
        self.inner.consume(usize::from(byte.is_some()));
        Ok(byte)
    }
}

impl<R: BufRead> Read for LenientReader<R> {
    /// Reads one byte, as the JSON parser requests them.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(slot) = buffer.first_mut() else { return Ok(0) };
        match self.next()? {
            Some(byte) => {
                *slot = byte;
                Ok(1)
            }
            None => Ok(0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_invalid_numbers_are_replaced() {
        let text = br#"{"NaN": [NaN, -Infinity, 1e999, 1e300, true, null, "a\"NaN"], "b": -1.5}"#;
        let clean = replace_invalid_numbers(text).unwrap();
        let expected = r#"{"NaN": [null, null, null, 1e300, true, null, "a\"NaN"], "b": -1.5}"#;
        assert_eq!(String::from_utf8(clean).unwrap(), expected);
        assert_eq!(replace_invalid_numbers(br#"{"a": "NaN", "b": 1"#), None);
        assert_eq!(replace_invalid_numbers(b"\"open \\"), None);
    }

    #[test]
    fn streams_are_repaired_wherever_their_buffers_end() {
        let text = br#"{"NaN \" I": [NaN, -Infinity, Infinity,-NaN, -1.5, true, null, "-I\\"], "N": 1}"#;
        let expected = r#"{"NaN \" I": [null, null, null,null, -1.5, true, null, "-I\\"], "N": 1}"#;
        for capacity in 1..9 {
            let mut clean = String::new();
            let reader = io::BufReader::with_capacity(capacity, &text[..]);
            LenientReader::new(reader).read_to_string(&mut clean).unwrap();
            assert_eq!(clean, expected);
        }
    }
}
