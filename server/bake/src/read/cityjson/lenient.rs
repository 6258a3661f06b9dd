//! Numbers that JSON does not have, as some writers write them.
//!
//! In: text that failed to parse, or any text as a stream. Out: the same text with `null` in their place. Next: `model`.

use std::io::{self, BufRead, Read};

/// Replaces `NaN`, `Infinity` and numbers beyond f64 outside of strings by `null`, on the same lines; `None` if there
/// are none, and so something else is wrong with the text.
pub(crate) fn without_odd_numbers(text: &[u8]) -> Option<Vec<u8>> {
    let mut clean = Vec::with_capacity(text.len());
    let (mut i, mut changed) = (0, false);
    while i < text.len() {
        let length = match text[i] {
            b'"' => string_length(&text[i..]),
            b'-' | b'+' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' => word_length(&text[i..]),
            _ => 1,
        };
        let token = &text[i..i + length];
        if is_odd(token) {
            clean.extend_from_slice(b"null");
            changed = true;
        } else {
            clean.extend_from_slice(token);
        }
        i += length;
    }
    changed.then_some(clean)
}

/// With its quotes; to the end of the text if it is not closed.
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

fn is_odd(token: &[u8]) -> bool {
    let Ok(token) = std::str::from_utf8(token) else { return false };
    if token.starts_with('"') || !token.contains(['N', 'n', 'I', 'i', 'e', 'E']) && token.len() < 300 {
        return false;
    }
    token.parse::<f64>().is_ok_and(|number| !number.is_finite())
}

/// A text on its way to the parser, with `null` for `NaN` and `Infinity`: outside of strings JSON has no other word
/// that begins with a capital letter.
pub(crate) struct LenientReader<R> {
    inner: R,
    in_string: bool,
    escaped: bool,
    /// What is still to be given in place of a word that was taken.
    pending: &'static [u8],
}

impl<R: BufRead> LenientReader<R> {
    pub(crate) fn new(inner: R) -> Self {
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
        let odd = |byte: Option<u8>| matches!(byte, Some(b'N' | b'I'));
        if odd(Some(byte)) || byte == b'-' && odd(self.peek()?) {
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
    /// A byte at a time, as the JSON parser asks for them.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(place) = buffer.first_mut() else { return Ok(0) };
        match self.next()? {
            Some(byte) => {
                *place = byte;
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
    fn only_numbers_that_are_none_are_replaced() {
        let text = br#"{"NaN": [NaN, -Infinity, 1e999, 1e300, true, null, "a\"NaN"], "b": -1.5}"#;
        let clean = without_odd_numbers(text).unwrap();
        let expected = r#"{"NaN": [null, null, null, 1e300, true, null, "a\"NaN"], "b": -1.5}"#;
        assert_eq!(String::from_utf8(clean).unwrap(), expected);
        assert_eq!(without_odd_numbers(br#"{"a": "NaN", "b": 1"#), None);
        assert_eq!(without_odd_numbers(b"\"open \\"), None);
    }
    #[test]
    fn streams_are_cleaned_wherever_their_buffers_end() {
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
