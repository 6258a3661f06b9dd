//! Checks the languages of the page, `language-CODE.json`, against the English one: the page takes a text that a language lacks from
//! there, but a misspelt key or place would only be noticed by readers. So would a key that stands twice: the last text counts.

use crate::{asset_files::AssetFiles, error::BundleError};
use serde::{
    Deserialize, Deserializer,
    de::{Error, MapAccess, SeqAccess, Visitor},
};
use serde_json::{Map, Value};
use std::{collections::BTreeSet, fmt};

const PREFIX: &str = "language-";
const ENGLISH: &str = "language-en.json";

/// Fails at the first text that English does not have, or has in another form or with other places for values.
pub(crate) fn check(files: &AssetFiles) -> Result<(), BundleError> {
    let Some(english) = files.get(ENGLISH) else { return Ok(()) };
    let english = parsed(ENGLISH, english)?;
    let is_language = |name: &str| name.starts_with(PREFIX) && name.ends_with(".json");
    for (name, content) in files.iter().filter(|(name, _)| is_language(name)) {
        compare("", &english, &parsed(name, content)?)
            .map_err(|reason| BundleError::Asset(format!("{name}: {reason}")))?;
    }
    Ok(())
}

fn parsed(name: &str, content: &[u8]) -> Result<Value, BundleError> {
    let read = serde_json::from_slice(content).map(|Texts(value)| value);
    read.map_err(|error| BundleError::Asset(format!("{name}: {error}")))
}

/// Texts of a language, no two with the same key.
struct Texts(Value);

impl<'de> Deserialize<'de> for Texts {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TextsVisitor).map(Self)
    }
}

struct TextsVisitor;

impl<'de> Visitor<'de> for TextsVisitor {
    type Value = Value;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a text, a list or an object of texts")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Value, E> {
        Ok(Value::String(text.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Value, A::Error> {
        let mut texts = Vec::new();
        while let Some(Texts(value)) = list.next_element()? {
            texts.push(value);
        }
        Ok(Value::Array(texts))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut texts = Map::new();
        while let Some((key, Texts(value))) = entries.next_entry::<String, Texts>()? {
            if texts.contains_key(&key) {
                return Err(A::Error::custom(format!("the key {key:?} stands twice in one object")));
            }
            texts.insert(key, value);
        }
        Ok(Value::Object(texts))
    }
}

fn compare(key: &str, english: &Value, text: &Value) -> Result<(), String> {
    match (english, text) {
        (Value::String(english), Value::String(text)) => {
            let [known, used] = [places(english), places(text)];
            let unknown = used.difference(&known).next();
            unknown.map_or(Ok(()), |place| Err(format!("{key}: there is no place {{{place}}} in the English text")))
        }
        (Value::Array(english), Value::Array(text)) if english.len() == text.len() => {
            english.iter().zip(text).try_for_each(|(english, text)| compare(key, english, text))
        }
        (Value::Object(english), Value::Object(text)) => {
            // The forms of plurals differ between languages.
            let is_plural = english.contains_key("other");
            if is_plural && !text.get("other").is_some_and(Value::is_string) {
                return Err(format!("{key}: a text with plurals has the form \"other\""));
            }
            text.iter().filter(|_| !is_plural).try_for_each(|(name, text)| {
                let key = format!("{key}/{name}");
                let english = english.get(name).ok_or_else(|| format!("{key}: there is no such text in {ENGLISH}"))?;
                compare(&key, english, text)
            })
        }
        (Value::Array(english), _) => Err(format!("{key}: a list of {} texts is expected", english.len())),
        _ => Err(format!("{key}: another kind of value than in {ENGLISH}")),
    }
}

/// The names in braces.
fn places(text: &str) -> BTreeSet<&str> {
    text.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may panic")]
mod tests {
    use super::*;

    const TEXTS: &str = r##"{"a": "go to {place}", "b": {"one": "# tile", "other": "# tiles"}, "c": [["x", "y"]]}"##;

    fn checked(language: &str) -> Result<(), String> {
        let files = [(ENGLISH, TEXTS), ("language-de.json", language)];
        let files = files.map(|(name, text)| (name.to_owned(), text.as_bytes().to_vec()));
        check(&files.into_iter().collect()).map_err(|error| error.to_string())
    }

    #[test]
    fn languages_have_the_texts_of_english() {
        checked(r##"{"a": "zu {place}", "b": {"few": "#", "other": "# Kacheln"}, "c": [["x", "z"]]}"##).unwrap();
        // What is missing is English.
        checked("{}").unwrap();
        for (language, expected) in [
            (r##"{"z": "?"}"##, "/z: there is no such text"),
            (r##"{"a": "zu {ort}"}"##, "{ort}"),
            (r##"{"b": {"one": "#"}}"##, "\"other\""),
            (r##"{"c": []}"##, "a list of 1"),
            (r##"{"a": ["?"]}"##, "another kind"),
            (r##"{"a": 1}"##, "expected a text"),
            (r##"{"c": [], "a": "1", "b": {"other": "2"}, "a": "3"}"##, "the key \"a\" stands twice"),
            (r##"{"b": {"other": "2", "other": "#"}}"##, "stands twice"),
            ("{", "language-de.json"),
        ] {
            let error = checked(language).unwrap_err();
            assert!(error.contains(expected), "{language}: {error}");
        }
    }

    #[test]
    fn languages_of_the_page_are_complete() {
        fn keys(value: &Value, key: &str, into: &mut Vec<String>) {
            match value {
                Value::Object(all) if !all.contains_key("other") => {
                    all.iter().for_each(|(name, value)| keys(value, &format!("{key}/{name}"), into));
                }
                _ => into.push(key.to_owned()),
            }
        }
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../page");
        let files = crate::asset_files::read_page(std::path::Path::new(page)).unwrap();
        check(&files).unwrap();
        let of = |name: &str| {
            let mut found = Vec::new();
            keys(&parsed(name, &files[name]).unwrap(), "", &mut found);
            found.sort();
            found
        };
        let names: Vec<_> = files.keys().filter(|name| name.starts_with(PREFIX)).collect();
        assert!(names.len() >= 6, "{names:?}");
        for name in names {
            assert_eq!(of(name), of(ENGLISH), "{name}");
        }
    }
}
