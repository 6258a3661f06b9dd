//! Divides a filter into tokens.

use super::Fault;
use crate::value::{Value, parse_date};

/// A token with its offset in bytes.
pub(super) type Positioned = (usize, Token);

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    /// A name that is no keyword, or one in backticks.
    Name {
        name: String,
        is_quoted: bool,
    },
    Literal(Value),
    Null,
    In,
    /// An operator or a mark of punctuation.
    Symbol(&'static str),
}

/// Longer symbols first.
const SYMBOLS: [&str; 15] = ["==", "!=", "<=", ">=", "&&", "||", "<", ">", "~", "!", "(", ")", ",", "-", "="];

pub(super) fn tokens(text: &str) -> Result<Vec<Positioned>, Fault> {
    let mut tokens = Vec::new();
    let mut rest = text;
    loop {
        rest = rest.trim_start();
        let at = text.len() - rest.len();
        let Some(first) = rest.chars().next() else { return Ok(tokens) };
        let (token, bytes) = match first {
            '"' | '\'' => quoted(rest, at, first).map(|(text, bytes)| (Token::Literal(Value::Text(text)), bytes))?,
            '`' => quoted(rest, at, first).map(|(name, bytes)| (Token::Name { name, is_quoted: true }, bytes))?,
            '0'..='9' | '.' => number(rest, at)?,
            _ if is_name_start(first) => name(rest),
            _ => symbol(rest, at)?,
        };
        tokens.push((at, token));
        rest = rest.get(bytes..).unwrap_or_default();
    }
}

fn is_name_start(c: char) -> bool {
    c.is_alphabetic() || "_@#$".contains(c)
}

fn is_name_part(c: char) -> bool {
    c.is_alphanumeric() || "_.:-@#$".contains(c)
}

/// The text between quotes, and the bytes with them.
fn quoted(rest: &str, at: usize, quote: char) -> Result<(String, usize), Fault> {
    let mut text = String::new();
    let mut chars = rest.char_indices().skip(1);
    while let Some((offset, c)) = chars.next() {
        match c {
            _ if c == quote => return Ok((text, offset + quote.len_utf8())),
            '\\' => text.extend(chars.next().map(|(_, c)| c)),
            _ => text.push(c),
        }
    }
    Err(Fault::syntax(at, format!("a text in quotes has no end: add another {quote}")))
}

/// A date, an integer or a float.
fn number(rest: &str, at: usize) -> Result<(Token, usize), Fault> {
    let end = |part: &dyn Fn(char) -> bool| rest.find(|c| !part(c)).unwrap_or(rest.len());
    let word = rest.get(..end(&|c| c.is_ascii_digit() || c == '-')).unwrap_or_default();
    if word.len() == 10 && word.bytes().filter(|byte| *byte == b'-').count() == 2 {
        let wrong = || Fault::syntax(at, format!("the date {word} does not exist: write it as YYYY-MM-DD"));
        return Ok((Token::Literal(Value::Date(parse_date(word).ok_or_else(wrong)?)), word.len()));
    }
    let mut before = ' ';
    let bytes = rest.find(|c: char| {
        let is_sign = "+-".contains(c) && "eE".contains(before);
        before = c;
        !(c.is_alphanumeric() || c == '.' || is_sign)
    });
    let word = rest.get(..bytes.unwrap_or(rest.len())).unwrap_or_default();
    let is_integer = word.bytes().all(|byte| byte.is_ascii_digit());
    let integer = if is_integer { word.parse().ok().map(Value::Integer) } else { None };
    let float = || word.parse().ok().filter(|value: &f64| value.is_finite()).map(Value::Float);
    let hint = "write texts in double quotes, and names that begin with a digit in backticks";
    let value = integer.or_else(float).ok_or_else(|| Fault::syntax(at, format!("{word} is no number: {hint}")))?;
    Ok((Token::Literal(value), word.len()))
}

fn name(rest: &str) -> (Token, usize) {
    let bytes = rest.find(|c| !is_name_part(c)).unwrap_or(rest.len());
    let name = rest.get(..bytes).unwrap_or_default();
    let token = match name {
        "true" => Token::Literal(Value::Bool(true)),
        "false" => Token::Literal(Value::Bool(false)),
        "null" => Token::Null,
        "in" => Token::In,
        _ => Token::Name { name: name.to_owned(), is_quoted: false },
    };
    (token, bytes)
}

fn symbol(rest: &str, at: usize) -> Result<(Token, usize), Fault> {
    let message = match SYMBOLS.into_iter().find(|symbol| rest.starts_with(symbol)) {
        Some("=") => "a single = is no comparison: write ==".to_owned(),
        Some(symbol) => return Ok((Token::Symbol(symbol), symbol.len())),
        None if rest.starts_with('&') => "a single & is no operator: write &&".to_owned(),
        None if rest.starts_with('|') => "a single | is no operator: write ||".to_owned(),
        None => {
            let c = rest.chars().next().unwrap_or_default();
            format!("the character {c:?} has no meaning here: write names that have it in backticks")
        }
    };
    Err(Fault::syntax(at, message))
}
