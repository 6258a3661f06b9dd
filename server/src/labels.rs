//! Reads `labels.toml`: what people read instead of the names of attributes. Each table is named as its attribute:
//!
//! ```toml
//! [bouwjaar]
//! title = "Built in"
//! titles = { de = "Baujahr", nl = "Bouwjaar" }
//! order = 1
//!
//! [b3_h_dak_max]
//! unit = "m"
//!
//! ["identificatie"]
//! hidden = true
//! ```

use insula_archive::file::read_text;
use insula_objects::schema::{
    AttributeLabel, Labels, MAX_ATTRIBUTES, MAX_LANGUAGES, MAX_NAME_BYTES, MAX_TITLE_BYTES, is_language,
};
use std::path::Path;
use toml::de::{DeInteger, DeTable, DeValue};

const MAX_FILE_BYTES: u64 = 1 << 20;
const KEYS: &str = "title, titles, order, unit and hidden";

/// Why a file of labels cannot be used: where in it, and what is wrong.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct LabelError {
    /// The file, the line and the key.
    place: String,
    reason: String,
}

/// Reads a file. Fails if it cannot be read, is no TOML, or has an unknown key or an invalid value.
pub fn read(path: &Path) -> Result<Labels, LabelError> {
    let name = path.display().to_string();
    match read_text(path, MAX_FILE_BYTES) {
        Ok(text) => parse(&name, &text),
        Err(error) => Err(LabelError { place: name, reason: error.to_string() }),
    }
}

fn parse(name: &str, text: &str) -> Result<Labels, LabelError> {
    let line_at = |start: usize| text.get(..start).map_or(1, |before| before.matches('\n').count() + 1);
    let at = |start: usize, key: &str, reason: String| LabelError {
        place: format!("{name}, line {}{}{key}", line_at(start), if key.is_empty() { "" } else { ", " }),
        reason,
    };
    let table = DeTable::parse(text)
        .map_err(|error| at(error.span().map_or(0, |span| span.start), "", error.message().replace('\n', " ")))?;
    let mut labels = Labels::default();
    for (key, value) in table.get_ref().iter() {
        let (attribute, start) = (key.get_ref().to_string(), key.span().start);
        let refused = |reason: String| Err(at(start, &attribute, reason));
        let DeValue::Table(settings) = value.get_ref() else {
            return refused(format!("each attribute has a table, as in [{attribute}]; its keys are {KEYS}"));
        };
        if attribute.is_empty() || attribute.len() > MAX_NAME_BYTES {
            return refused(format!("the name of an attribute has 1 to {MAX_NAME_BYTES} bytes"));
        }
        if labels.attributes.len() >= MAX_ATTRIBUTES {
            return refused(format!("a file has at most {MAX_ATTRIBUTES} attributes"));
        }
        let mut label = AttributeLabel::default();
        for (key, value) in settings.iter() {
            let setting = key.get_ref().as_ref();
            let full = format!("{attribute}.{setting}");
            let unit = set(&mut label, setting, value.get_ref()).map_err(|why| at(key.span().start, &full, why))?;
            labels.units.extend(unit.map(|unit| (attribute.clone(), unit)));
        }
        labels.attributes.insert(attribute, label);
    }
    Ok(labels)
}

/// Sets what a key says. Returns the unit, if it is one.
fn set(label: &mut AttributeLabel, key: &str, value: &DeValue<'_>) -> Result<Option<String>, String> {
    match (key, value) {
        ("title", value) => label.title = Some(line(value, MAX_TITLE_BYTES)?),
        ("unit", value) => return line(value, MAX_NAME_BYTES).map(Some),
        ("order", DeValue::Integer(number)) => label.order = Some(order(number)?),
        ("order", _) => return Err("a place is a number, as in 1: the smallest comes first".into()),
        ("hidden", DeValue::Boolean(hidden)) => label.hidden = *hidden,
        ("hidden", _) => return Err("expected true or false".into()),
        ("titles", DeValue::Table(titles)) => {
            if titles.len() > MAX_LANGUAGES {
                return Err(format!("a title has at most {MAX_LANGUAGES} languages"));
            }
            for (code, title) in titles.iter() {
                let code = code.get_ref().to_ascii_lowercase();
                if !is_language(&code) {
                    return Err(format!("{code:?} is no code of a language such as \"de\" or \"pt-br\""));
                }
                let title = line(title.get_ref(), MAX_TITLE_BYTES).map_err(|why| format!("{code}: {why}"))?;
                label.titles.insert(code, title);
            }
        }
        ("titles", _) => return Err("expected titles by languages, as in { de = \"Baujahr\" }".into()),
        _ => return Err(format!("there is no such key; the keys are {KEYS}")),
    }
    Ok(None)
}

/// A text of one line.
fn line(value: &DeValue<'_>, max_bytes: usize) -> Result<String, String> {
    match value {
        DeValue::String(text) if (1..=max_bytes).contains(&text.len()) && !text.chars().any(char::is_control) => {
            Ok(text.to_string())
        }
        _ => Err(format!("expected a text of one line and 1 to {max_bytes} bytes")),
    }
}

fn order(number: &DeInteger<'_>) -> Result<u32, String> {
    let valid = u32::from_str_radix(number.as_str(), number.radix()).ok().filter(|order| *order < u32::MAX);
    valid.ok_or_else(|| "a place is a whole number from 0 to 4294967294".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Labels, String> {
        parse("labels.toml", text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_table_for_each_attribute_says_what_people_read() {
        let text = "[\"addr:street\"]\ntitle = \"Street\"\n[year]\ntitles = { DE = \"Jahr\", pt-BR = \"Ano\" }\norder = 2\nunit = \"a\"\n[id]\nhidden = true\n";
        let labels = parsed(text).unwrap();
        assert_eq!(labels.attributes["addr:street"].title.as_deref(), Some("Street"));
        let year = &labels.attributes["year"];
        let titles: Vec<_> = year.titles.iter().map(|(code, title)| format!("{code} {title}")).collect();
        assert_eq!((titles.join(", "), year.order), ("de Jahr, pt-br Ano".into(), Some(2)));
        assert_eq!((labels.units.len(), labels.units["year"].as_str()), (1, "a"));
        assert!(labels.attributes["id"].hidden && !year.hidden);
        assert_eq!(parsed("").unwrap(), Labels::default());
    }

    #[test]
    fn errors_name_file_line_and_key() {
        let long = "x".repeat(MAX_TITLE_BYTES + 1);
        for (text, place) in [
            ("a", "labels.toml, line 1: "),
            ("\ntitle = \"Year\"", "labels.toml, line 2, title: "),
            ("[year]\ntitel = \"Year\"", "labels.toml, line 2, year.titel: "),
            ("[year]\n\ntitle = 7", "labels.toml, line 3, year.title: "),
            ("[year]\ntitle = \"\"", "labels.toml, line 2, year.title: "),
            ("[year]\ntitle = \"a\\nb\"", "labels.toml, line 2, year.title: "),
            (&format!("[year]\ntitle = \"{long}\""), "labels.toml, line 2, year.title: "),
            ("[year]\norder = -1", "labels.toml, line 2, year.order: "),
            ("[year]\norder = 4294967295", "labels.toml, line 2, year.order: "),
            ("[year]\norder = \"first\"", "labels.toml, line 2, year.order: "),
            ("[year]\nhidden = 1", "labels.toml, line 2, year.hidden: "),
            ("[year]\ntitles = \"Jahr\"", "labels.toml, line 2, year.titles: "),
            ("[year]\ntitles = { deutsch = \"Jahr\" }", "labels.toml, line 2, year.titles: "),
            ("[year]\ntitles = { de = 1 }", "labels.toml, line 2, year.titles: de: "),
            ("[year]\nunit = [\"m\"]", "labels.toml, line 2, year.unit: "),
            ("[\"\"]\ntitle = \"a\"", "labels.toml, line 1, : "),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.starts_with(place.trim_end_matches(", : ")), "{text}: {error}");
        }
        let many: String = (0..=MAX_ATTRIBUTES).map(|k| format!("[a{k}]\n")).collect();
        assert!(parsed(&many).unwrap_err().contains("at most 4096"));
        let languages: String = (0..=MAX_LANGUAGES)
            .map(|k| format!("a{}{} = \"t\"\n", (b'a' + (k / 26) as u8) as char, (b'a' + (k % 26) as u8) as char))
            .collect();
        assert!(parsed(&format!("[a.titles]\n{languages}")).unwrap_err().contains("at most 64"));
    }
}
