//! Text from files and servers, made safe to show.

use std::borrow::Cow;

/// Longest text that [`printable`] returns, in characters, apart from the mark of its cut.
pub const MAX_CHARS: usize = 8192;

/// The text as it may be written to a terminal, a log or a window: on one line, without anything that a terminal obeys.
///
/// Line breaks and tabs become spaces. Other control characters, and characters that change the direction of text or are
/// invisible, become escapes such as `\u{1b}`. A text of more than [`MAX_CHARS`] is cut. Everything that comes from a file,
/// a server or an archive has to pass through here before a person sees it. Addresses in it lose their users ([`without_users`]).
pub fn printable(text: &str) -> Cow<'_, str> {
    match without_users(text) {
        Cow::Borrowed(text) => printable_characters(text),
        Cow::Owned(text) => printable_characters(&text).into_owned().into(),
    }
}

/// The text with addresses that name no users and passwords: `https://me:secret@host/city` becomes `https://host/city`.
pub fn without_users(text: &str) -> Cow<'_, str> {
    const SCHEME_END: &str = "://";
    let mut plain = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(SCHEME_END).map(|at| at + SCHEME_END.len()) {
        let (before, after) = rest.split_at(start);
        let is_end = |c: char| c.is_whitespace() || "/?#\"'<>\\".contains(c);
        let authority = &after[..after.find(is_end).unwrap_or(after.len())];
        let user = authority.rfind('@').map_or(0, |at| at + 1);
        plain.push_str(before);
        rest = &after[user..];
    }
    if plain.len() + rest.len() == text.len() {
        return text.into();
    }
    plain.push_str(rest);
    plain.into()
}

fn printable_characters(text: &str) -> Cow<'_, str> {
    if text.len() <= MAX_CHARS && !text.chars().any(is_unsafe) {
        return text.into();
    }
    let mut safe = String::with_capacity(text.len().min(MAX_CHARS));
    for (position, c) in text.chars().enumerate() {
        match c {
            _ if position >= MAX_CHARS => {
                safe.push('…');
                break;
            }
            '\n' | '\r' | '\t' => safe.push(' '),
            c if is_unsafe(c) => safe.extend(c.escape_unicode()),
            c => safe.push(c),
        }
    }
    safe.into()
}

/// [`printable`], line by line: for a report of several lines.
pub fn printable_lines(text: &str) -> String {
    text.split_inclusive('\n').map(|line| line.strip_suffix('\n').map_or(printable(line), end_line)).collect()
}

/// JSON with all that [`printable`] escapes as JSON's own escapes, so that it stays the same value.
pub fn printable_json(json: &str) -> String {
    let mut safe = String::with_capacity(json.len());
    for c in json.chars() {
        // Outside of strings there is no unsafe character but the line break.
        if is_unsafe(c) && c != '\n' {
            let mut units = [0; 2];
            c.encode_utf16(&mut units).iter().for_each(|unit| safe.push_str(&format!("\\u{unit:04x}")));
        } else {
            safe.push(c);
        }
    }
    safe
}

/// Formats a size with a decimal unit, such as `1.5 MB`.
pub fn human_bytes(bytes: u64) -> String {
    let (mut value, mut unit) = (bytes as f64, "B");
    for larger in ["kB", "MB", "GB", "TB"] {
        if value < 1000.0 {
            break;
        }
        (value, unit) = (value / 1000.0, larger);
    }
    if unit == "B" { format!("{bytes} B") } else { format!("{value:.1} {unit}") }
}

/// A word of a command line as a shell has to read it: in quotes if it has characters that a shell does not take literally.
/// Quotes are those of POSIX shells, on Windows those of its command prompt.
pub fn shell_word(word: &str) -> Cow<'_, str> {
    let is_plain = |c: char| c.is_alphanumeric() || "_@%+=:,./-".contains(c) || (cfg!(windows) && "\\~".contains(c));
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else if cfg!(windows) {
        format!("\"{word}\"").into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''")).into()
    }
}

fn end_line(line: &str) -> Cow<'_, str> {
    (printable(line) + "\n").into_owned().into()
}

/// Controls of both sets (C0 and C1), marks that embed or override the direction of text, separators of lines, and
/// characters without width.
fn is_unsafe(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200b}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}')
        || matches!(c, '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

/// The number, with zero instead of minus zero: nobody reads `-0`.
pub fn without_sign_of_zero(number: f64) -> f64 {
    // Minus zero and zero are zero.
    number + 0.0
}

/// The number with so many decimals. What rounds to zero has no sign.
pub fn fixed(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|byte| matches!(byte, b'0' | b'.')) => rest.to_owned(),
        _ => text,
    }
}

/// The number with at most so many decimals, without zeros at its end.
pub fn at_most(number: f64, decimals: usize) -> String {
    let text = fixed(number, decimals);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A number with its noun, which gets an `s` unless it is one.
pub fn count(n: u64, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_round_to_zero_have_no_sign() {
        assert_eq!([-0.0, -0.004, -0.006, 1.0].map(|number| fixed(number, 2)), ["0.00", "0.00", "-0.01", "1.00"]);
        assert_eq!([-0.0004, -2.50, 100.0, 8.63].map(|number| at_most(number, 3)), ["0", "-2.5", "100", "8.63"]);
        assert_eq!((fixed(-0.4, 0), fixed(f64::NAN, 1)), ("0".into(), "NaN".into()));
        assert!(without_sign_of_zero(-0.0).is_sign_positive() && without_sign_of_zero(-1.0) == -1.0);
    }

    #[test]
    fn nouns_follow_their_numbers() {
        assert_eq!([0, 1, 2].map(|n| count(n, "tile")), ["0 tiles", "1 tile", "2 tiles"]);
    }

    #[test]
    fn texts_of_people_stay_as_they_are() {
        for text in ["", "Delft", "Zürich, 東京 & São Paulo", "👩‍👧 \u{e9}", "a\\b \"c\" <d>"] {
            assert!(matches!(printable(text), Cow::Borrowed(found) if found == text), "{text}");
        }
    }

    #[test]
    fn nothing_that_a_terminal_obeys_passes() {
        assert_eq!(printable("a\u{1b}]0;title\u{7}b"), "a\\u{1b}]0;title\\u{7}b");
        assert_eq!(printable("line\r\nbreak\tx"), "line  break x");
        assert_eq!(
            printable("\u{9b}31m \u{202e}gnp.exe \u{2066}\u{feff}"),
            "\\u{9b}31m \\u{202e}gnp.exe \\u{2066}\\u{feff}"
        );
        assert_eq!(printable_lines("a\u{1b}[2J\nb\n\nc"), "a\\u{1b}[2J\nb\n\nc");
        for c in (0..=u32::from(char::MAX)).filter_map(char::from_u32) {
            let text = c.to_string();
            assert!(!printable(&text).chars().any(is_unsafe), "{c:?}");
        }
    }

    #[test]
    fn users_of_addresses_are_not_shown() {
        for (text, plain) in [
            ("http://me:secret@h:1/a: no response", "http://h:1/a: no response"),
            ("https://me@h and s3://a:b@c@d/e?f=g@h", "https://h and s3://d/e?f=g@h"),
            ("{\"url\":\"http://me:secret@h\"}", "{\"url\":\"http://h\"}"),
        ] {
            assert_eq!(printable(text), plain);
        }
        for text in ["me@h, https://h/@me, https://h?a=b@c", "https://h, me@h", "://", "a://@", "ü://ü"] {
            assert_eq!(without_users(text), text.replace("://@", "://"), "{text}");
        }
        assert!(matches!(without_users("https://h/a"), Cow::Borrowed(_)));
    }

    #[test]
    fn json_stays_the_same_value() {
        let value = serde_json::json!({ "title": "\u{9b}31m \u{202e}x \u{e0041} \u{1b}", "n": [1, "é\n"] });
        let safe = printable_json(&serde_json::to_string_pretty(&value).unwrap());
        assert!(safe.lines().all(|line| printable(line) == line), "{safe}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&safe).unwrap(), value);
    }

    #[test]
    #[cfg(unix)]
    fn words_reach_a_program_as_they_are() {
        for word in ["cities/delft", "東京", "a b", "", "it's", "$HOME `x` \\ \"*\" !", "-1", "~", "a;b&c|d<e>f#g"] {
            let line = format!("printf %s {}", shell_word(word));
            let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), word, "{line}");
        }
        assert!(matches!(shell_word("cities/delft.city.json"), Cow::Borrowed(_)));
    }

    #[test]
    fn long_texts_are_cut() {
        let long = "\u{e9}".repeat(3 * MAX_CHARS);
        let cut = printable(&long);
        assert_eq!((cut.chars().count(), cut.ends_with("é…")), (MAX_CHARS + 1, true));
        let text = "é".repeat(MAX_CHARS);
        assert_eq!(printable(&text), text);
    }
}
