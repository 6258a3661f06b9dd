//! Prints how many bytes an object takes in blocks: `attribute_bytes FILE...`, CityJSON or CityJSONSeq.
//!
//! Objects are taken in the order of the file. Bounds are of all vertices of an object's geometry, or of its parts'.

use anyhow::{Context, Result};
use insula_objects::{
    BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectBounds, ObjectRecord, Schema, SchemaBuilder, Value, block,
};
use serde_json::Value as Json;
use std::{collections::BTreeMap, env, fs, time::Instant};

/// Removes something from an object.
type Change = fn(&mut ObjectRecord);

/// An object with attributes by name.
struct Object {
    record: ObjectRecord,
    attributes: Vec<(String, Value)>,
}

fn main() -> Result<()> {
    let mut objects = Vec::new();
    for path in env::args().skip(1) {
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {path}"))?;
        let mut transform = Json::Null;
        for document in serde_json::Deserializer::from_str(&text).into_iter::<Json>() {
            let document = document.with_context(|| format!("{path} is not JSON"))?;
            if !document["transform"].is_null() {
                transform = document["transform"].clone();
            }
            read_objects(&document, &transform, &mut objects);
        }
    }
    let mut builder = SchemaBuilder::default();
    objects.iter().flat_map(|object| &object.attributes).for_each(|(name, value)| builder.add(name, value));
    let schema = builder.finish(objects.len() as u32);
    schema.check()?;
    let records: Vec<Option<ObjectRecord>> = objects.into_iter().map(|object| Some(record(object, &schema))).collect();
    print(&records, &schema)
}

/// Prints sizes, with and without bounds.
fn print(records: &[Option<ObjectRecord>], schema: &Schema) -> Result<()> {
    let attributes: usize = records.iter().flatten().map(|record| record.attributes.len()).sum();
    let with_attributes = records.iter().flatten().filter(|record| !record.attributes.is_empty()).count();
    println!(
        "{} objects, {with_attributes} with attributes, {attributes} values, {} attributes",
        records.len(),
        schema.attributes.len()
    );
    let variants: [(&str, Change); 3] = [
        ("all", |_| {}),
        ("without bounds", |record| record.bounds = None),
        ("without attributes", |record| record.attributes.clear()),
    ];
    for (name, change) in variants {
        let mut changed = records.to_vec();
        changed.iter_mut().flatten().for_each(change);
        let (mut bytes, mut encode_secs, mut decode_secs) = (0, 0.0, 0.0);
        for (number, objects) in changed.chunks(BLOCK_OBJECTS).enumerate() {
            let start = Instant::now();
            let encoded = block::encode(number as u32, objects, schema)?;
            encode_secs += start.elapsed().as_secs_f64();
            bytes += encoded.len();
            let start = Instant::now();
            let decoded = ObjectBlock::decode(number as u32, &encoded, schema)?;
            decode_secs += start.elapsed().as_secs_f64();
            let same = decoded.ids().iter().zip(objects).all(|(id, object)| decoded.record(*id) == *object);
            anyhow::ensure!(same, "block {number} does not round trip");
        }
        let blocks = changed.len().div_ceil(BLOCK_OBJECTS) as f64;
        println!(
            "{name}: {bytes} bytes, {:.1} an object, {:.1} an object with attributes; {:.2} ms to encode a block, {:.3} ms to decode it",
            bytes as f64 / records.len() as f64,
            bytes as f64 / with_attributes as f64,
            1e3 * encode_secs / blocks,
            1e3 * decode_secs / blocks,
        );
    }
    Ok(())
}

/// Appends the objects of a document, parents before their parts.
fn read_objects(document: &Json, transform: &Json, objects: &mut Vec<Object>) {
    let Some(members) = document["CityObjects"].as_object() else { return };
    let mut ids: BTreeMap<&str, u32> = BTreeMap::new();
    let mut ordered: Vec<&String> = members.keys().filter(|name| members[*name]["parents"].is_null()).collect();
    ordered.extend(members.keys().filter(|name| !members[*name]["parents"].is_null()));
    for (i, name) in ordered.iter().enumerate() {
        ids.insert(name, (objects.len() + i) as u32);
    }
    for name in ordered {
        let object = &members[name];
        let mut vertices = Vec::new();
        collect_vertices(&object["geometry"], &mut vertices);
        for child in object["children"].as_array().into_iter().flatten().filter_map(Json::as_str) {
            collect_vertices(&members.get(child).map_or(Json::Null, |child| child["geometry"].clone()), &mut vertices);
        }
        let mut attributes = Vec::new();
        flatten("", &object["attributes"], &mut attributes);
        let parent = object["parents"][0].as_str().and_then(|parent| ids.get(parent)).copied();
        let kind = FeatureKind::of_cityjson_type(object["type"].as_str().unwrap_or_default());
        let bounds = bounds(document, transform, &vertices);
        let record = ObjectRecord { identifier: name.clone(), kind, parent, bounds, attributes: Vec::new() };
        objects.push(Object { record, attributes });
    }
}

fn collect_vertices(geometry: &Json, vertices: &mut Vec<usize>) {
    match geometry {
        Json::Array(items) => items.iter().for_each(|item| collect_vertices(item, vertices)),
        Json::Object(members) => members
            .iter()
            .filter(|(name, _)| !["semantics", "material", "texture"].contains(&name.as_str()))
            .for_each(|(_, member)| collect_vertices(member, vertices)),
        Json::Number(index) => vertices.extend(index.as_u64().map(|index| index as usize)),
        _ => {}
    }
}

fn bounds(document: &Json, transform: &Json, vertices: &[usize]) -> Option<ObjectBounds> {
    let scale = |axis: usize| transform["scale"][axis].as_f64().unwrap_or(1.0);
    let (mut min, mut max) = ([i32::MAX; 3], [i32::MIN; 3]);
    for vertex in vertices {
        for axis in 0..3 {
            let metres = document["vertices"][*vertex][axis].as_f64()? * scale(axis);
            min[axis] = min[axis].min((10.0 * metres).floor() as i32);
            max[axis] = max[axis].max((10.0 * metres).ceil() as i32);
        }
    }
    (!vertices.is_empty()).then_some(ObjectBounds { min, max })
}

/// Appends attributes as the bake does: lists and members flattened, missing values left out.
fn flatten(name: &str, json: &Json, attributes: &mut Vec<(String, Value)>) {
    let inner = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    let value = match json {
        Json::Null => return,
        Json::Bool(value) => Value::Bool(*value),
        Json::Number(value) => match (value.as_i64(), value.as_f64()) {
            (Some(value), _) => Value::Integer(value),
            (None, Some(value)) => Value::Float(value),
            (None, None) => return,
        },
        Json::String(text) => Value::Text(text.clone()),
        Json::Array(items) => {
            return items.iter().enumerate().for_each(|(i, item)| flatten(&inner(&i.to_string()), item, attributes));
        }
        Json::Object(members) => {
            return members.iter().for_each(|(key, member)| flatten(&inner(key), member, attributes));
        }
    };
    attributes.push((name.to_owned(), value));
}

fn record(object: Object, schema: &Schema) -> ObjectRecord {
    let indexed = |(name, value): (String, Value)| {
        let index = schema.index_of(&name)?;
        Some((index as u32, schema.convert(index, &value)))
    };
    let mut attributes: Vec<(u32, Value)> = object.attributes.into_iter().filter_map(indexed).collect();
    attributes.sort_by_key(|(index, _)| *index);
    ObjectRecord { attributes, ..object.record }
}
