//! `objects`: what is known of objects, and which attributes a city has.

use super::error::CommandError;
use super::output::{print, print_pretty};
use crate::args::ObjectsArgs;
use crate::store::{CityStore, StoredObjects};
use insula_objects::{AttributeInfo, FeatureKind, NamedValues, ObjectRecord, Schema};
use insula_protocol::text::{printable, without_sign_of_zero};
use serde::Serialize;
use serde_json::json;
use std::fmt::Write;

/// An object as JSON.
#[derive(Debug, Serialize)]
pub(crate) struct ObjectReport {
    pub(crate) id: u32,
    pub(crate) identifier: String,
    /// Identifier of its parent.
    pub(crate) parent: Option<String>,
    pub(crate) kind: FeatureKind,
    pub(crate) attributes: NamedValues,
}

/// Runs `objects`. Fails if the city cannot be opened, has no objects, or not all of the requested ones.
pub(super) fn run(args: &ObjectsArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    let objects = StoredObjects::open(&city)?;
    if args.ids.is_empty() {
        if args.json.json {
            return print_pretty(&json!(objects.schema()));
        }
        print(&schema_table(&city.manifest().counts.words(), objects.schema()));
        return Ok(());
    }
    let mut found = Vec::with_capacity(args.ids.len());
    for id in &args.ids {
        let missing = || CommandError::Usage(format!("{}: there is no object {id}", args.city.display()));
        let record = objects.object(*id)?.ok_or_else(missing)?;
        found.push(describe(&objects, *id, record)?);
    }
    if args.json.json {
        return print_pretty(&json!(found));
    }
    print(&found.iter().map(|object| object_text(object, objects.schema())).collect::<Vec<_>>().join("\n"));
    Ok(())
}

/// An object with the names of its attributes. Fails if its parent's block is damaged.
pub(crate) fn describe(
    objects: &StoredObjects<'_>,
    id: u32,
    record: ObjectRecord,
) -> Result<ObjectReport, CommandError> {
    let parent = record.parent.map(|parent| objects.identifier(parent)).transpose()?.flatten();
    let attributes = NamedValues::new(objects.schema(), objects.with_family(id, &record)?);
    Ok(ObjectReport { id, identifier: record.identifier, parent, kind: record.kind, attributes })
}

/// An object with the names of its attributes as filters have them, and the titles that people read.
fn object_text(object: &ObjectReport, schema: &Schema) -> String {
    let mut out = format!("{} {} ({})\n", object.id, printable(&object.identifier), object.kind.name());
    if let Some(parent) = &object.parent {
        let _ = writeln!(out, "  part of {}", printable(parent));
    }
    for (name, value) in object.attributes.iter() {
        let value = schema.text_of(name, value);
        let _ = writeln!(out, "  {:<28} {}", printable(&named(schema, name)), printable(&value));
    }
    out
}

/// The name of an attribute, with its title if it has one.
fn named(schema: &Schema, name: &str) -> String {
    match schema.title_of(name, "") {
        title if title == name => name.to_owned(),
        title => format!("{name} ({title})"),
    }
}

/// The attributes of a city, below its size in words.
fn schema_table(size: &str, schema: &Schema) -> String {
    let mut out = format!("{size}\n{:<32} {:<8} {:>9}  values\n", "attribute", "type", "objects");
    let shown = schema.display_order().into_iter().filter_map(|index| schema.attributes.get(index));
    for AttributeInfo { name, value_type, count, min, max, top, unit, .. } in shown {
        let unit = unit.as_ref().map(|unit| format!(" {unit}")).unwrap_or_default();
        let values = match (min, max) {
            (Some(min), Some(max)) => {
                format!("{} to {}{unit}", without_sign_of_zero(*min), without_sign_of_zero(*max))
            }
            _ => top.iter().take(4).map(|(text, _)| text.as_str()).collect::<Vec<_>>().join(", "),
        };
        let values = shortened(&printable(&values));
        let _ =
            writeln!(out, "{:<32} {:<8} {count:>9}  {values}", printable(&named(schema, name)), value_type.to_string());
    }
    out
}

/// A text of at most so many characters, which says whether there is more.
fn shortened(text: &str) -> String {
    const MAX_CHARS: usize = 60;
    match text.chars().nth(MAX_CHARS) {
        Some(_) => text.chars().take(MAX_CHARS - 1).chain(['…']).collect(),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::{SchemaBuilder, Value};

    #[test]
    fn values_that_are_cut_end_in_dots() {
        let mut builder = SchemaBuilder::default();
        builder.add("name", &Value::Text("x".repeat(80)));
        builder.add("use", &Value::Text("y".repeat(60)));
        let table = schema_table("1 building", &builder.finish(1));
        let cut = "  ".to_owned() + &"x".repeat(59) + "…\n";
        assert!(table.contains(&cut) && table.contains(&("y".repeat(60) + "\n")), "{table}");
    }
}
