//! What expressions select, and what fails to parse.

use super::*;
use crate::block::{self, ObjectBounds, ObjectRecord};
use crate::schema::SchemaBuilder;
use crate::value::{Value, ValueType, parse_date};
use insula_test_support::tier;
use proptest::prelude::*;

/// Object 0 has all attributes, object 1 only a name, object 2 is not in use, object 3 has nothing.
fn city() -> (Schema, ObjectBlock) {
    let text = |text: &str| Value::Text(text.to_owned());
    let values = [
        ("name", text("Nieuwe Kerk")),
        ("yearOfConstruction", Value::Integer(1496)),
        ("area", Value::Float(1250.5)),
        ("listed", Value::Bool(true)),
        ("built", Value::Date(parse_date("1496-05-01").unwrap())),
        ("registered", text("2010-10-13T12:43:04Z")),
        ("number", text("12")),
        ("addr:street", text("Markt")),
        ("roof type", text("gabled")),
    ];
    let mut builder = SchemaBuilder::default();
    values.iter().for_each(|(name, value)| builder.add(name, value));
    let schema = builder.finish(4);
    let attributes: Vec<_> = (0..).zip(values.map(|(_, value)| value)).collect();
    let bounds = Some(ObjectBounds { min: [0, 0, -5], max: [10, 10, 1082] });
    let full =
        ObjectRecord { identifier: "NL.1".into(), kind: FeatureKind::Building, parent: None, bounds, attributes };
    let named = ObjectRecord {
        identifier: "NL.2".into(),
        kind: FeatureKind::Bridge,
        bounds: None,
        attributes: vec![(0, text("ÄRGER"))],
        ..full.clone()
    };
    let bare = ObjectRecord {
        identifier: "NL.3".into(),
        kind: FeatureKind::Road,
        bounds,
        attributes: Vec::new(),
        ..named.clone()
    };
    let records = [Some(full), Some(named), None, Some(bare)];
    let bytes = block::encode(0, &records, &schema).unwrap();
    let block = ObjectBlock::decode(0, &bytes, &schema).unwrap();
    (schema, block)
}

#[test]
fn filters_select_the_objects_that_they_describe() {
    let (schema, block) = city();
    let cases: [(&str, &[u32]); 49] = [
        ("yearOfConstruction < 1900 && height > 20", &[0]),
        ("yearOfConstruction >= 1496", &[0]),
        ("1496 <= yearOfConstruction", &[0]),
        ("yearOfConstruction != 1496", &[]),
        ("yearOfConstruction == 1496.0", &[0]),
        ("area > -1", &[0]),
        ("area > 1.2505e3", &[]),
        ("area > 1.2504e+3", &[0]),
        ("area >= yearOfConstruction", &[]),
        ("height == 108.7", &[0]),
        ("name == \"Nieuwe Kerk\"", &[0]),
        ("name == 'Nieuwe Kerk'", &[0]),
        ("name != 'x'", &[0, 1]),
        ("name < \"O\"", &[0]),
        ("name ~ \"kerk\"", &[0]),
        ("name ~ \"ärg\"", &[1]),
        ("identifier ~ 'nl'", &[0, 1, 3]),
        ("kind in (\"building\", \"bridge\")", &[0, 1]),
        ("kind == 'road'", &[3]),
        ("yearOfConstruction in (1, 1496)", &[0]),
        ("built in (\"1496-05-01\")", &[0]),
        ("id in (0, 3)", &[0, 3]),
        ("id > 0", &[1, 3]),
        ("listed", &[0]),
        ("!listed", &[1, 3]),
        ("listed == false", &[]),
        ("listed != false", &[0]),
        ("name", &[0, 1]),
        ("name == null", &[3]),
        ("null != name", &[0, 1]),
        ("height == null", &[1, 3]),
        ("built == 1496-05-01", &[0]),
        ("built < 1496-05-02", &[0]),
        ("built < \"1496-05-02\"", &[0]),
        ("year(built) == 1496", &[0]),
        ("year(registered) == 2010 && registered > 2010-10-12", &[0]),
        ("registered > 2010-10-13", &[]),
        ("number == 12", &[0]),
        ("name == 12", &[]),
        ("addr:street == 'Markt'", &[0]),
        ("`addr:street` == 'Markt'", &[0]),
        ("`roof type` ~ 'GABLE'", &[0]),
        ("!(name || listed)", &[3]),
        ("!!name", &[0, 1]),
        ("name == 'x' || name == 'Nieuwe Kerk' && listed || id == 3", &[0, 3]),
        ("(name == 'x' || name == 'Nieuwe Kerk') && !listed", &[]),
        ("!(yearOfConstruction < 1900)", &[1, 3]),
        ("name == \"say \\\"hi\\\" \\\\\"", &[]),
        ("true == listed && 1 < 2", &[0]),
    ];
    for (text, expected) in cases {
        let filter = Filter::parse(text, &schema).unwrap_or_else(|error| panic!("{text}: {error}"));
        let selected: Vec<u32> = filter.select(&block).into_iter().collect();
        assert_eq!(selected, expected, "{text}");
    }
}

#[test]
fn attributes_are_listed_once_and_hide_fields() {
    let (mut schema, block) = city();
    let attributes = |text: &str, schema: &Schema| Filter::parse(text, schema).unwrap().attributes().to_vec();
    assert_eq!(
        attributes("area > 1 && !(name ~ 'x' || area in (1)) && year(built) == 1 && kind && height", &schema),
        [0, 2, 4]
    );
    schema.attributes[2].name = "height".into();
    assert_eq!(attributes("height > 1", &schema), [2]);
    assert!(Filter::parse("height == 1250.5", &schema).unwrap().select(&block).contains(0));
    schema.attributes[2].value_type = ValueType::Text;
    assert_eq!(attributes("height > 1", &schema), [0; 0], "text");
}

#[test]
fn errors_say_what_where_and_what_to_do() {
    let (schema, _) = city();
    let cases = [
        ("", 0, "ends where a value is missing"),
        ("yearOfConstuction < 1", 0, "did you mean yearOfConstruction?"),
        ("name && zzz", 8, "objects have no attribute zzz: write one that they have, such as "),
        ("zzz == 1", 0, ", height, kind"),
        ("name == zzz", 8, "objects have no attribute zzz: write texts in double quotes"),
        ("name in (zzz)", 9, "write texts in double quotes"),
        ("name == (zzz)", 9, "write one that they have"),
        ("name = 'x'", 5, "write =="),
        ("name & listed", 5, "write &&"),
        ("name | listed", 5, "write ||"),
        ("name == 'x", 8, "add another '"),
        ("name == 'x' listed", 12, "write && or ||"),
        ("(name", 5, "add )"),
        ("name)", 4, "remove it"),
        ("area > 'x'", 7, "a float is compared with a text"),
        ("listed > true", 7, "have no order"),
        ("listed == 1", 10, "a bool is compared with an integer"),
        ("built > 12", 8, "a date is compared with an integer"),
        ("built > 2001-02-30", 8, "the date 2001-02-30 does not exist"),
        ("built > 'May'", 8, "is no date"),
        ("name > null", 5, "write == null"),
        ("null == null", 5, "compare an attribute"),
        ("area ~ 'x'", 5, "compare it by =="),
        ("name ~ 3", 7, "write it in double quotes"),
        ("name in 'x'", 8, "write in (1, 2)"),
        ("name in ('x'", 12, "write , or )"),
        ("name in (listed)", 9, "lists have texts"),
        ("kind == 'bulding'", 8, "write building"),
        ("kind == 'xyz'", 8, "write building, building-part"),
        ("12abc > 3", 0, "12abc is no number"),
        ("area > 1e999", 7, "no number"),
        ("area > -name", 7, "filters do not calculate"),
        ("area + 1", 5, "has no meaning here"),
        ("year(area) > 1", 0, "only dates have a year"),
        ("3", 0, "compare it"),
        ("(name) == 3", 7, "combine them"),
        ("name == ==", 8, "a value is missing here"),
    ];
    for (text, at, message) in cases {
        let error = Filter::parse(text, &schema).unwrap_err();
        assert!(error.at == at + 1 && error.message.contains(message), "{text}: {error:?}");
    }
}

#[test]
fn faults_have_a_code_for_other_languages() {
    let (schema, _) = city();
    let (deep, long) = ("(".repeat(65), "x".repeat(MAX_FILTER_BYTES + 1));
    for (text, code) in [
        ("name =", "syntax"),
        ("built > 2001-02-30", "syntax"),
        ("zzz == 1", "name"),
        ("kind == 'bulding'", "name"),
        ("area > 'x'", "type"),
        ("listed > true", "type"),
        ("built > 'May'", "type"),
        ("area ~ 'x'", "type"),
        ("year(area) > 1", "type"),
        (deep.as_str(), "size"),
        (long.as_str(), "size"),
    ] {
        assert_eq!(Filter::parse(text, &schema).unwrap_err().fault.code(), code, "{text}");
    }
}

#[test]
fn long_and_deep_filters_are_refused() {
    let (schema, _) = city();
    let nested = |depth: usize| format!("{}name{}", "(".repeat(depth), ")".repeat(depth));
    assert!(Filter::parse(&nested(64), &schema).is_ok());
    assert!(Filter::parse(&nested(65), &schema).unwrap_err().message.contains("64 levels"));
    assert!(Filter::parse(&format!("{}name", "!".repeat(65)), &schema).is_err());
    assert!(Filter::parse(&"(".repeat(4096), &schema).is_err());
    assert!(Filter::parse(&"year(".repeat(800), &schema).is_err());
    let chain = vec!["name"; 512].join("&& ");
    assert!(Filter::parse(&chain, &schema).is_ok());
    let long = format!("name == '{}'", "x".repeat(4096));
    assert_eq!(Filter::parse(&long, &schema).unwrap_err().at, MAX_FILTER_BYTES + 1);
    // People count characters, from 1.
    let error = Filter::parse("name == 'München' zzz", &schema).unwrap_err();
    assert!(error.at == 19 && error.to_string().ends_with("(at character 19)"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(tier::cases()))]

    #[test]
    fn any_text_gives_a_filter_or_an_error_within_it(
        text in prop_oneof![
            "\\PC{0,40}",
            "((name|area|built|listed|kind|year\\(|`roof type`|12|-|'x'|1999-01-01|null|true|\\(|\\)|,|in|~|==|<|!|&&|\\|\\|) ?){0,14}",
        ],
    ) {
        let (schema, block) = city();
        match Filter::parse(&text, &schema) {
            Ok(filter) => prop_assert!(filter.select(&block).len() <= 3),
            Err(error) => prop_assert!((1..=text.chars().count() + 1).contains(&error.at)),
        }
    }
}
