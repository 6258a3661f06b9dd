//! Filters and colours: any text gives a filter or an error within the text.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_objects::{ColorBy, FeatureKind, Filter, ObjectBlock, ObjectRecord, SchemaBuilder, Value, block};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let mut builder = SchemaBuilder::default();
    let values =
        [Value::Text("1999-12-31x".into()), Value::Integer(7), Value::Float(0.5), Value::Bool(true), Value::Date(9)];
    ["a", "b", "c", "d", "e f"].into_iter().zip(&values).for_each(|(name, value)| builder.add(name, value));
    let schema = builder.finish(2);
    let attributes = (0..).zip(values).collect();
    let full =
        ObjectRecord { identifier: "x".into(), kind: FeatureKind::Bridge, parent: None, bounds: None, attributes };
    let bare = ObjectRecord { attributes: Vec::new(), ..full.clone() };
    let bytes = block::encode(0, &[Some(full), Some(bare)], &schema).expect("objects can be encoded");
    let block = ObjectBlock::decode(0, &bytes, &schema).expect("an encoded block can be decoded");
    match Filter::parse(text, &schema) {
        Ok(filter) => {
            let selected = filter.select(&block);
            assert!(selected.iter().all(|id| id < 2));
        }
        Err(error) => assert!((1..=text.chars().count() + 1).contains(&error.at)),
    }
    if let Ok(by) = ColorBy::parse(text, &schema) {
        let _ = by.object_rgba(&block, 0);
        let _ = by.legend();
    }
});
