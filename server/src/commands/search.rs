//! `search`: objects by their texts.

use super::error::CommandError;
use super::output::{print, print_pretty};
use crate::args::SearchArgs;
use crate::store::{CityStore, StoredObjects};
use insula_objects::FeatureKind;
use insula_objects::search::SearchHit;
use insula_protocol::text::printable;
use serde::Serialize;
use std::fmt::Write;

/// A hit with what identifies its object.
#[derive(Debug, Serialize)]
struct FoundObjectJson {
    object: u32,
    text: String,
    typos: u8,
    /// `None` if the city has no such object, because its files are not of one bake.
    identifier: Option<String>,
    kind: Option<FeatureKind>,
}

/// Runs `search` and prints the hits, the best first. Fails if the city cannot be opened, has no search index or no objects, or one of
/// these is damaged.
pub(super) fn run(args: &SearchArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    let index = city.search_index()?;
    let objects = StoredObjects::open(&city)?;
    let found = |SearchHit { text, object, typos }| {
        let record = objects.object(object)?;
        let kind = record.as_ref().map(|record| record.kind);
        Ok(FoundObjectJson { object, text, typos, identifier: record.map(|record| record.identifier), kind })
    };
    let hits = index.search(&args.text, usize::from(args.limit));
    let hits = hits.into_iter().map(found).collect::<Result<Vec<_>, CommandError>>()?;
    if args.json.json {
        return print_pretty(&hits);
    }
    print(&hits_text(&hits));
    Ok(())
}

/// A line per hit: number, identifier and kind of the object, then the text unless it is the identifier.
fn hits_text(hits: &[FoundObjectJson]) -> String {
    if hits.is_empty() {
        return "nothing found\n".to_owned();
    }
    let mut out = String::new();
    for FoundObjectJson { object, text, identifier, kind, .. } in hits {
        let name = identifier.as_deref().unwrap_or("unknown");
        let kind = kind.map_or("unknown", FeatureKind::name);
        let _ = write!(out, "{object} {} ({kind})", printable(name));
        let _ = if identifier.as_ref() == Some(text) { writeln!(out) } else { writeln!(out, ": {}", printable(text)) };
    }
    out
}
