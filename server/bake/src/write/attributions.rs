//! Who must be named wherever a city is shown: whom the user names, else what the sources say of themselves, completed by what is known
//! of publishers.

use super::known_sources::{KnownSource, known_source};
use crate::read::{ReadReport, SourceReport};
use insula_protocol::manifest::{Attribution, MAX_ALL_TEXT_BYTES, MAX_ATTRIBUTIONS, MAX_TEXT_BYTES, shorten_text};

pub(super) use super::known_sources::is_publisher;

/// The attributions of a city.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Attributions {
    pub(super) all: Vec<Attribution>,
    /// A line for each name or licence that no source says: what was filled in, and of which source.
    pub(super) filled_in: Vec<String>,
}

impl Attributions {
    /// The requested attributions; else one for each different set of names (titles if there are none) and licences in the sources.
    pub(super) fn new(requested: &[Attribution], read: &ReadReport) -> Self {
        let mut found = Self { all: requested.to_vec(), filled_in: Vec::new() };
        if !requested.is_empty() {
            return found;
        }
        // The rest is for the title and the coordinate system.
        let mut bytes = 0;
        for source in &read.sources {
            let (attribution, filled_in) = attribution_of(source);
            if attribution.text.is_empty() || found.all.contains(&attribution) {
                continue;
            }
            bytes += attribution.texts().map(String::len).sum::<usize>();
            if found.all.len() == MAX_ATTRIBUTIONS || bytes > MAX_ALL_TEXT_BYTES - 3 * MAX_TEXT_BYTES {
                let path = &source.path;
                tracing::warn!("{path}: too many attributions, the rest is left out; give one with --attribution");
                break;
            }
            if filled_in {
                let texts: Vec<&str> = attribution.texts().map(String::as_str).collect();
                found.filled_in.push(format!("{}: {}", source.path, texts.join(", ")));
            }
            found.all.push(attribution);
        }
        found
    }
}

/// What a source says of itself, with what is known of its publisher where it says nothing, and whether there is any of that.
fn attribution_of(source: &SourceReport) -> (Attribution, bool) {
    let licence = (!source.licences.is_empty()).then(|| cut(source.licences.join(", ")));
    let Some(KnownSource { name, licence: known_licence, url, .. }) = known_source(source) else {
        let names = if source.attributions.is_empty() { &source.titles } else { &source.attributions };
        return (Attribution { text: cut(names.join(", ")), licence, url: None }, false);
    };
    let filled_in = source.attributions.is_empty() || licence.is_none();
    let text = if source.attributions.is_empty() { (*name).to_owned() } else { cut(source.attributions.join(", ")) };
    let licence = licence.or_else(|| Some((*known_licence).to_owned()));
    (Attribution { text, licence, url: filled_in.then(|| (*url).to_owned()) }, filled_in)
}

/// The text as far as a manifest can hold it.
fn cut(text: String) -> String {
    let short = shorten_text(&text);
    if short.len() == text.len() {
        return text;
    }
    tracing::warn!("the attribution {:.40}... is too long and is cut; give one with --attribution", short);
    short.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::SourceFormat;

    #[test]
    fn attributions_of_any_sources_fit_into_a_manifest() {
        let source = |name: String, licence: &str| {
            let mut source = SourceReport::new(&name, SourceFormat::Obj, 0);
            source.attributions.push(name);
            source.licences.push(licence.to_owned());
            source
        };
        let long = "\u{1}".repeat(5000);
        for licence in ["L", &long] {
            let sources = (0..1000).map(|i| source(format!("office {i} {licence}"), licence)).collect();
            let all = Attributions::new(&[], &ReadReport { sources, ..ReadReport::default() }).all;
            assert!(all.len() > 10 && all.len() <= MAX_ATTRIBUTIONS);
            assert!(all.iter().flat_map(Attribution::texts).map(String::len).sum::<usize>() <= MAX_ALL_TEXT_BYTES);
        }
    }

    #[test]
    fn licences_of_known_sources_are_filled_in_and_told() {
        let mut delft = SourceReport::new("delft.city.jsonl", SourceFormat::CityJsonSeq, 0);
        delft.titles.push("3DBAG".to_owned());
        delft.attributions.push("3DBAG Team".to_owned());
        let plain = SourceReport::new("town.obj", SourceFormat::Obj, 0);
        let read = ReadReport { sources: vec![delft.clone(), plain], ..ReadReport::default() };
        let Attributions { all, filled_in } = Attributions::new(&[], &read);
        let expected = Attribution {
            text: "3DBAG Team".to_owned(),
            licence: Some("CC BY 4.0".to_owned()),
            url: Some("https://3dbag.nl".to_owned()),
        };
        assert_eq!(
            (all, filled_in),
            (vec![expected], vec!["delft.city.jsonl: 3DBAG Team, CC BY 4.0, https://3dbag.nl".to_owned()])
        );
        // What the file or the user says counts.
        delft.licences.push("CC0".to_owned());
        let read = ReadReport { sources: vec![delft], ..ReadReport::default() };
        let Attributions { all, filled_in } = Attributions::new(&[], &read);
        assert_eq!((all[0].licence.as_deref(), filled_in.len()), (Some("CC0"), 0));
        let own = Attribution { text: "me".to_owned(), licence: None, url: None };
        assert_eq!(
            Attributions::new(std::slice::from_ref(&own), &read),
            Attributions { all: vec![own], filled_in: Vec::new() }
        );
    }
}
