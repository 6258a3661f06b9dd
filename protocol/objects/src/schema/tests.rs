//! Schemas are read back; damaged bytes fail.

use super::*;

fn text(text: &str) -> Value {
    Value::Text(text.to_owned())
}

#[test]
fn types_ranges_and_frequent_values_are_collected_in_one_pass() {
    let mut builder = SchemaBuilder::default();
    for i in 0..100 {
        builder.add("year", &Value::Integer(1900 + i % 10));
        builder.add("height", &if i % 2 == 0 { Value::Integer(i) } else { Value::Float(i as f64 / 2.0) });
        builder.add("mixed", &if i == 50 { Value::Bool(true) } else { Value::Integer(i) });
        builder.add("built", &Value::Date(i as i32));
        builder.add("name", &text(if i < 70 { "Haus" } else { "Kirche" }));
    }
    builder.set_unit("height", "m");
    let schema = builder.finish(100);
    schema.check().unwrap();
    let info = |name: &str| &schema.attributes[schema.index_of(name).unwrap()];
    assert_eq!(
        schema.attributes.iter().map(|attribute| attribute.name.as_str()).collect::<Vec<_>>(),
        ["year", "height", "mixed", "built", "name"]
    );
    assert_eq!((info("year").min, info("year").max, info("year").distinct), (Some(1900.0), Some(1909.0), Some(10)));
    assert_eq!((info("height").value_type, info("height").unit.as_deref()), (ValueType::Float, Some("m")));
    assert_eq!((info("mixed").value_type, info("mixed").min), (ValueType::Text, None));
    assert_eq!((info("built").value_type, info("built").max), (ValueType::Date, Some(99.0)));
    assert_eq!(info("name").top, [("Haus".to_owned(), 70), ("Kirche".to_owned(), 30)]);
    let convert = |name: &str, value| schema.convert(schema.index_of(name).unwrap(), &value);
    assert_eq!(convert("height", Value::Integer(3)), Value::Float(3.0));
    assert_eq!(convert("mixed", Value::Bool(true)), text("true"));
    assert_eq!(convert("year", Value::Integer(3)), Value::Integer(3));
    assert_eq!(schema.index_of("none"), None);
}

#[test]
fn distinct_values_are_bounded() {
    let mut builder = SchemaBuilder::default();
    for i in 0..5000 {
        builder.add("id", &Value::Integer(i % 1001));
        builder.add("few", &Value::Integer(i % 1000));
        builder.add("long", &text(&format!("{i}{}", "x".repeat(5000))));
    }
    let schema = builder.finish(5000);
    schema.check().unwrap();
    let distinct: Vec<_> = schema.attributes.iter().map(|attribute| attribute.distinct).collect();
    assert_eq!(distinct, [None, Some(1000), None]);
    assert!(schema.attributes.iter().all(|attribute| attribute.top.len() == MAX_TOP));
}

#[test]
fn further_attributes_and_invalid_values_are_dropped() {
    let mut builder = SchemaBuilder::default();
    for i in 0..MAX_ATTRIBUTES + 5 {
        builder.add(&format!("{i}{}", "ü".repeat(200)), &text(&"y".repeat(4097)));
    }
    builder.add("nan", &Value::Float(f64::NAN));
    builder.add("", &Value::Integer(1));
    assert_eq!(builder.dropped(), 7);
    let schema = builder.finish(1);
    schema.check().unwrap();
    assert_eq!(schema.attributes.len(), MAX_ATTRIBUTES);
}

#[test]
fn json_round_trips_and_names_types() {
    let mut builder = SchemaBuilder::default();
    builder.add("a", &Value::Float(1.5));
    let schema = Schema { searchable: vec!["a".into()], ..builder.finish(7) };
    let json = serde_json::to_string(&schema).unwrap();
    assert_eq!(
        json,
        r#"{"objects":7,"attributes":[{"name":"a","type":"float","count":1,"min":1.5,"max":1.5,"distinct":1,"top":[["1.5",1]]}],"searchable":["a"]}"#
    );
    assert_eq!(serde_json::from_str::<Schema>(&json).unwrap(), schema);
}

#[test]
fn schemas_over_a_limit_are_refused() {
    let mut builder = SchemaBuilder::default();
    builder.add("a", &Value::Integer(1));
    builder.add("b", &Value::Integer(1));
    let valid = builder.finish(1);
    let refused = |change: &dyn Fn(&mut Schema)| {
        let mut schema = valid.clone();
        change(&mut schema);
        schema.check().is_err()
    };
    assert!(!refused(&|_| {}));
    assert!(refused(&|schema| schema.attributes[1].name = "a".into()));
    assert!(refused(&|schema| schema.attributes[1].name = String::new()));
    assert!(refused(&|schema| schema.attributes[1].name = "n".repeat(257)));
    assert!(refused(&|schema| schema.attributes[1].unit = Some("n".repeat(257))));
    assert!(refused(&|schema| schema.attributes[1].top = vec![("n".repeat(4097), 1)]));
    assert!(refused(&|schema| schema.attributes[1].top = vec![("n".into(), 1); 21]));
    assert!(refused(&|schema| schema.attributes[1].min = Some(2.0)));
    assert!(refused(&|schema| schema.attributes[1].max = Some(f64::INFINITY)));
    assert!(refused(&|schema| schema.searchable = vec!["n".into(); MAX_ATTRIBUTES + 1]));
    assert!(refused(&|schema| schema.attributes = vec![schema.attributes[0].clone(); MAX_ATTRIBUTES + 1]));
}

#[test]
fn names_with_a_number_come_first_where_objects_are_coloured() {
    let mut builder = SchemaBuilder::default();
    for name in ["zone", "age", "floors", "b"] {
        builder.add(name, &Value::Integer(1));
    }
    let mut schema = builder.finish(1);
    assert_eq!(schema.names_to_color_by(), ["age", "b", "floors", "height", "kind", "zone"]);
    for (name, order) in [("zone", 1), ("floors", 2), ("height", 2)] {
        schema.labels.insert(name.to_owned(), AttributeLabel { order: Some(order), ..AttributeLabel::default() });
    }
    assert_eq!(schema.names_to_color_by(), ["zone", "floors", "height", "age", "b", "kind"]);
}

#[test]
fn values_are_in_the_order_of_the_source_with_the_telling_ones_first() {
    let mut builder = SchemaBuilder::default();
    for (name, value) in [
        ("zone", Value::Integer(3)),
        ("height", Value::Float(8.63)),
        ("area", Value::Float(-0.0)),
        ("name", Value::Text("Kerk".into())),
    ] {
        builder.add(name, &value);
    }
    let schema = builder.finish(1);
    let values = vec![
        (0, Value::Integer(3)),
        (1, Value::Float(8.63)),
        (2, Value::Float(-0.0)),
        (3, Value::Text("Kerk".into())),
        (9, Value::Bool(true)),
    ];
    let named = NamedValues::new(&schema, values);
    let json = serde_json::to_string(&named).unwrap();
    assert_eq!(json, r#"{"name":"Kerk","height":8.63,"zone":3,"area":0.0}"#);
    let texts: Vec<String> = named.iter().map(|(_, value)| value.to_string()).collect();
    assert_eq!((texts.join(" "), named.get("zone")), ("Kerk 8.63 3 0".into(), Some(&Value::Integer(3))));
}
