//! Who must be named wherever a city is shown: whom the user names, else what the sources say of themselves, completed by what is known
//! of publishers.

pub(super) use super::known_sources::is_publisher;
use super::known_sources::{KnownSource, known_source};
use crate::read::{ReadReport, SourceReport};
use insula_protocol::manifest::{Attribution, MAX_ALL_TEXT_BYTES, MAX_ATTRIBUTIONS, MAX_TEXT_BYTES, shorten_text};

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
        'sources: for source in &read.sources {
            let (attributions, filled_in) = attributions_of(source);
            for attribution in attributions {
                if attribution.text.is_empty() || found.all.iter().any(|known| attribution.is_said_by(known)) {
                    continue;
                }
                let path = &source.path;
                bytes += attribution.texts().map(String::len).sum::<usize>();
                if found.all.len() == MAX_ATTRIBUTIONS || bytes > MAX_ALL_TEXT_BYTES - 3 * MAX_TEXT_BYTES {
                    tracing::warn!("{path}: too many attributions, the rest is left out; give one with --attribution");
                    break 'sources;
                }
                if filled_in {
                    let texts: Vec<&str> = attribution.texts().map(String::as_str).collect();
                    found.filled_in.push(format!("{path}: {}", texts.join(", ")));
                }
                attribution.add_to(&mut found.all);
            }
        }
        found
    }
}

/// What a source says of itself, with what is known of its publisher where it says nothing, and whether there is any of that. A text of
/// several sources, as exports write it, is taken apart.
fn attributions_of(source: &SourceReport) -> (Vec<Attribution>, bool) {
    let licence = (!source.licences.is_empty()).then(|| cut(source.licences.join(", ")));
    let named = |text: String| Attribution { text, licence: None, url: None };
    let mut all = Vec::new();
    for attribution in source.attributions.iter().flat_map(|text| Attribution::of_line(&cut(text.clone()))) {
        attribution.add_to(&mut all);
    }
    if !all.iter().any(Attribution::is_told) && !all.is_empty() {
        all = vec![named(cut(source.attributions.join(", ")))];
    }
    all.iter_mut().for_each(|one| one.licence = one.licence.take().or_else(|| licence.clone()));
    let known = if all.len() > 1 { None } else { known_source(source) };
    let Some(KnownSource { name, licence: known_licence, url: known_url, .. }) = known else {
        if all.is_empty() {
            all.push(Attribution { licence, ..named(cut(source.titles.join(", "))) });
        }
        return (all, false);
    };
    let is_named = !all.is_empty();
    let mut one = all.pop().unwrap_or_else(|| Attribution { licence, ..named((*name).to_owned()) });
    // Nothing is added that the text has already.
    let text = one.text.to_lowercase();
    let is_new = |known: &str| !text.contains(&known.to_lowercase());
    let filled_in = !is_named || one.licence.is_none() && is_new(known_licence);
    if one.licence.is_none() && is_new(known_licence) {
        one.licence = Some((*known_licence).to_owned());
    }
    if filled_in && one.url.is_none() && is_new(known_url) {
        one.url = Some((*known_url).to_owned());
    }
    (vec![one], filled_in)
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
    fn sources_of_an_export_are_the_same_again() {
        let osm = Attribution {
            text: "OpenStreetMap contributors".to_owned(),
            licence: Some("ODbL 1.0".to_owned()),
            url: Some("https://www.openstreetmap.org/copyright".to_owned()),
        };
        let office = Attribution { text: "Office".to_owned(), licence: Some("Ours".to_owned()), url: None };
        for all in [vec![osm.clone()], vec![osm.clone(), office]] {
            let mut source = SourceReport::new("a.geojson", SourceFormat::GeoJson, 0);
            source.attributions.push(Attribution::line(&all));
            // The same source twice, and a map of it.
            let mut map = SourceReport::new("b.osm", SourceFormat::OpenStreetMap, 0);
            map.attributions.push("OpenStreetMap contributors".to_owned());
            map.licences.push("ODbL 1.0".to_owned());
            let read = ReadReport { sources: vec![source.clone(), source, map], ..ReadReport::default() };
            assert_eq!(Attributions::new(&[], &read), Attributions { all, filled_in: Vec::new() });
        }
        // A licence in the text is not said again.
        let mut told = SourceReport::new("a.geojson", SourceFormat::GeoJson, 0);
        told.attributions.push("OpenStreetMap contributors, ODbL 1.0".to_owned());
        let read = ReadReport { sources: vec![told], ..ReadReport::default() };
        let all = Attributions::new(&[], &read).all;
        assert_eq!((all[0].licence.as_deref(), all[0].url.as_deref()), (None, None));
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
