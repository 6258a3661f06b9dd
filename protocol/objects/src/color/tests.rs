//! Legends and the colours of values.

use super::*;
use crate::block::{self, ObjectBounds, ObjectRecord};
use crate::schema::SchemaBuilder;
use std::collections::BTreeSet;

fn schema() -> Schema {
    let mut builder = SchemaBuilder::default();
    for i in 0..100i32 {
        builder.add("year", &Value::Integer(1900 + i64::from(i)));
        builder.add("area", &Value::Float(f64::from(i) / 10.0));
        builder.add("built", &Value::Date(i * 365));
        builder.add("addr:city", &Value::Text(["Delft", "Den Haag", "Delft"][i as usize % 3].into()));
        builder.add("name", &Value::Text(format!("{}", 200 + i / 3 * 3)));
        builder.add("listed", &Value::Bool(false));
    }
    builder.set_unit("area", "m2");
    builder.finish(100)
}

fn parse(text: &str) -> ColorBy {
    ColorBy::parse(text, &schema()).unwrap()
}

fn labels(by: &ColorBy) -> Vec<String> {
    by.legend().entries.into_iter().map(|entry| entry.label).collect()
}

#[test]
fn numbers_and_dates_have_a_gradient_over_the_range_of_the_schema() {
    let by = parse("year");
    assert_eq!(by.range(), Some([1900.0, 1999.0]));
    assert_eq!(by.rgba(Some(&Value::Integer(1900))), [68, 1, 84, 255]);
    assert_eq!(by.rgba(Some(&Value::Integer(1))), by.rgba(Some(&Value::Float(1900.0))));
    assert_eq!(by.rgba(Some(&Value::Integer(1999))), [253, 231, 37, 255]);
    assert_eq!(by.rgba(None), [211, 211, 211, 255]);
    assert_eq!(by.rgba(Some(&Value::Text("1950".into()))), [211, 211, 211, 255]);
    assert_eq!(labels(&by), ["1900", "1925", "1950", "1974", "1999", "no data"]);
    assert_eq!(
        labels(&parse("built")),
        ["1970-01-01", "1994-09-26", "2019-06-21", "2044-03-14", "2068-12-07", "no data"]
    );
    let legend = parse("area:turbo").legend();
    assert_eq!((legend.title.as_str(), legend.unit.as_deref()), ("area", Some("m2")));
    assert_eq!(legend.entries[1].label, "2.48");
    let ramp = legend.ramp.unwrap();
    assert_eq!((ramp.range, ramp.stops.len(), ramp.stops[0]), ([0.0, 9.9], 32, legend.entries[0].rgb));
}

#[test]
fn a_range_can_be_replaced_reversed_and_empty() {
    let value = |value: f64| Some(Value::Float(value));
    let by = parse("area:magma").with_range([1.0, 2.0]);
    assert_eq!(by.rgba(value(2.0).as_ref()), by.rgba(value(9.0).as_ref()));
    let reversed = by.clone().with_range([2.0, 1.0]);
    assert_eq!(reversed.rgba(value(2.0).as_ref()), by.rgba(value(1.0).as_ref()));
    assert_eq!(labels(&reversed)[0], "1.00");
    assert_eq!(by.clone().with_range([f64::NAN, 1.0]).range(), Some([1.0, 2.0]));
    let empty = by.clone().with_range([1.0, 1.0]);
    assert_eq!(empty.rgba(value(1.0).as_ref()), by.rgba(value(1.5).as_ref()));
    assert_eq!(labels(&empty).len(), 2);
    let [r, g, b, _] = empty.rgba(value(1.0).as_ref());
    assert_eq!(empty.legend().entries[0].rgb, [r, g, b], "the legend has the colour of the only value");
    let huge = by.clone().with_range([f64::MIN, f64::MAX]);
    assert_eq!(huge.rgba(value(0.0).as_ref()), by.rgba(value(1.5).as_ref()));
    assert_eq!(huge.rgba(value(f64::MAX).as_ref()), by.rgba(value(2.0).as_ref()));
    assert_eq!(parse("listed").with_range([0.0, 1.0]).range(), None);
}

#[test]
fn texts_and_booleans_have_classes() {
    let by = parse("addr:city");
    assert_eq!(labels(&by), ["Delft", "Den Haag", "no data"]);
    let color = |by: &ColorBy, text: &str| by.rgba(Some(&Value::Text(text.into())));
    assert_eq!(color(&by, "Delft"), [78, 121, 167, 255]);
    assert_eq!(color(&by, "Rotterdam"), [128, 128, 128, 255]);
    assert_ne!(color(&parse("addr:city:viridis"), "Delft"), color(&parse("addr:city:viridis"), "Den Haag"));
    let many = parse("name");
    assert_eq!((labels(&many).len(), labels(&many)[12].as_str()), (14, "others"));
    let different: BTreeSet<[u8; 3]> = many.legend().entries.iter().map(|entry| entry.rgb).collect();
    assert_eq!(different.len(), 14);
    assert_eq!(labels(&parse("listed")), ["true", "false", "no data"]);
    assert_eq!(parse("listed").rgba(Some(&Value::Bool(false))), [242, 142, 44, 255]);
    let years = parse("year:classes");
    assert_eq!(years.rgba(Some(&Value::Integer(1900)))[..3], years.legend().entries[0].rgb);
    assert_eq!(parse("kind").legend().entries.len(), 13);
}

#[test]
fn objects_are_coloured_by_attributes_and_fields() {
    let schema = schema();
    let bounds = Some(ObjectBounds { min: [0; 3], max: [10, 10, 500] });
    let attributes = vec![(0, Value::Integer(1950))];
    let record = ObjectRecord { identifier: "a".into(), kind: FeatureKind::Bridge, parent: None, bounds, attributes };
    let bytes = block::encode(0, &[Some(record)], &schema).unwrap();
    let block = ObjectBlock::decode(0, &bytes, &schema).unwrap();
    let by = |text: &str| ColorBy::parse(text, &schema).unwrap();
    assert_eq!((by("year").value(&block, 0), by("year").attribute()), (Some(Value::Integer(1950)), Some(0)));
    assert_eq!((by("height").value(&block, 0), by("height").attribute()), (Some(Value::Float(50.0)), None));
    assert_eq!(by("kind").value(&block, 0), Some(Value::Text("bridge".into())));
    assert_eq!(by("height").object_rgba(&block, 0), by("height").rgba(Some(&Value::Float(50.0))));
    assert_eq!(by("area").object_rgba(&block, 0), [211, 211, 211, 255]);
    assert_eq!(by("height").object_rgba(&block, 9), [211, 211, 211, 255]);
    assert_eq!((by("height").legend().unit.as_deref(), by("id").range()), (Some("m"), Some([0.0, 99.0])));
}

#[test]
fn gradients_of_heights_end_where_nearly_all_objects_do() {
    let schema = schema();
    let record = |height_dm: i32| {
        let bounds = Some(ObjectBounds { min: [0; 3], max: [10, 10, height_dm] });
        Some(ObjectRecord {
            identifier: "a".into(),
            kind: FeatureKind::Building,
            parent: None,
            bounds,
            attributes: Vec::new(),
        })
    };
    let range = |text: &str, heights_dm: &[i32]| {
        let records: Vec<_> = heights_dm.iter().map(|height_dm| record(*height_dm)).collect();
        let block = ObjectBlock::decode(0, &block::encode(0, &records, &schema).unwrap(), &schema).unwrap();
        ColorBy::parse(text, &schema).unwrap().over_heights([&block]).range()
    };
    // Houses, and one tower among a hundred.
    let mut town = vec![60; 99];
    assert_eq!(range("height", &town), Some([0.0, 10.0]));
    town.push(1500);
    assert_eq!(range("height:magma", &town), Some([0.0, 10.0]));
    assert_eq!(range("height", &[1500, 9990]), Some([0.0, 200.0]));
    assert_eq!(range("height", &[99_990]), Some([0.0, 400.0]));
    // Nothing to go by, and colours of something else.
    assert_eq!(range("height", &[0]), Some([0.0, 100.0]));
    assert_eq!(range("year", &town), Some([1900.0, 1999.0]));
    assert_eq!(sampled_blocks(3).collect::<Vec<_>>(), [0, 1, 2]);
    assert!(sampled_blocks(100_000).count() <= 64 && sampled_blocks(0).next().is_none());
}

#[test]
fn errors_suggest_names() {
    let message = |text: &str| ColorBy::parse(text, &schema()).unwrap_err().to_string();
    assert_eq!(message("yaer"), "objects have no attribute yaer: did you mean year?");
    assert!(message("unknown:viridis").contains("no attribute unknown: see the schema"));
    assert_eq!(message("year:virdis"), "no palette has the name virdis: write one of viridis");
    assert!(message("year:").contains("viridis, cividis"));
    assert!(message(&"x".repeat(513)).contains("more than 512 bytes"));
    let fault = |text: &str| ColorBy::parse(text, &schema()).unwrap_err();
    assert_eq!(fault("yaer").code(), ("attribute", Some("yaer")));
    assert_eq!(fault("year:virdis").code(), ("palette", Some("virdis")));
    assert_eq!(fault(&"x".repeat(513)).code(), ("long", None));
    let schema = schema();
    for palette in ColorBy::palettes() {
        assert!(ColorBy::parse(&format!("area:{palette}"), &schema).is_ok());
    }
}
