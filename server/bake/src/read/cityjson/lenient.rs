//! Numbers that JSON does not have, as some writers write them.
//!
//! In: text that failed to parse. Out: the same text with `null` in their place. Next: `model`.

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
}
