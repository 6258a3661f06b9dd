//! Blocks keep their objects; damaged bytes fail without a panic.

use super::*;
use crate::schema::{Schema, SchemaBuilder};
use insula_protocol::DecodeError;
use insula_protocol::codec::{checksum, zstd};
use insula_test_support::tier;
use proptest::prelude::*;
use proptest::{collection, option};

/// A schema with an attribute of each type, named like it.
fn schema() -> Schema {
    let mut builder = SchemaBuilder::default();
    let values = [
        Value::Text("x".into()),
        Value::Integer(1),
        Value::Float(0.5),
        Value::Bool(true),
        Value::Date(0),
        Value::Text("y".into()),
    ];
    for (name, value) in ["text", "integer", "float", "bool", "date", "code"].into_iter().zip(&values) {
        builder.add(name, value);
    }
    builder.finish(1)
}

/// Buildings with parts, as 3DBAG has them.
fn sample(count: u32) -> Vec<Option<ObjectRecord>> {
    let record = |id: u32| {
        let (building, is_part) = (id / 2, id % 2 == 1);
        let noise = building.wrapping_mul(0x9e37_79b9) >> 8;
        let identifier = format!(
            "NL.IMBAG.Pand.{:016}{}",
            503_100_000_010_000 + u64::from(noise % 20_000),
            if is_part { "-0" } else { "" }
        );
        let min = [noise % 9000, noise % 7000, 3].map(|v| v as i32);
        let max = [min[0] + 80 + (noise % 40) as i32, min[1] + 90, 60 + (noise % 100) as i32];
        let attributes = vec![
            (0, Value::Text(format!("2010-10-13T12:{:02}:{:02}Z", noise % 60, noise / 60 % 60))),
            (1, Value::Integer(1850 + i64::from(noise % 170))),
            (2, Value::Float(f64::from(noise % 100_000) / 100.0)),
            (3, Value::Bool(noise.is_multiple_of(7))),
            (4, Value::Date((noise % 20_000) as i32)),
            (5, Value::Text(identifier.clone())),
        ];
        ObjectRecord {
            identifier,
            kind: if is_part { FeatureKind::BuildingPart } else { FeatureKind::Building },
            parent: is_part.then_some(1024 + id - 1),
            bounds: Some(ObjectBounds { min, max }),
            attributes: if is_part { Vec::new() } else { attributes },
        }
    };
    (0..count).map(|id| (id % 50 != 49).then(|| record(id))).collect()
}

/// Decodes, compares with the records, and returns the block.
fn check(block: u32, records: &[Option<ObjectRecord>], schema: &Schema) -> ObjectBlock {
    let bytes = encode(block, records, schema).unwrap();
    let decoded = ObjectBlock::decode(block, &bytes, schema).unwrap();
    let first = block * BLOCK_OBJECTS as u32;
    for (slot, record) in (first..).zip(records) {
        assert_eq!(decoded.record(slot), *record);
    }
    let ids = (first..).zip(records).filter(|(_, record)| record.is_some()).map(|(id, _)| id);
    assert!(ids.eq(decoded.ids().iter().copied()));
    assert_eq!(decoded.record(first + records.len() as u32), None);
    decoded
}

/// The bytes of a block with another payload, with a valid checksum.
fn with_payload(payload: &[u8], payload_bytes: u32) -> Vec<u8> {
    let mut checked = 2u32.to_le_bytes().to_vec();
    checked.extend(payload_bytes.to_le_bytes());
    checked.extend(zstd::compress(payload).unwrap());
    [&MAGIC[..], &VERSION.to_le_bytes(), &checksum(&checked).to_le_bytes(), &checked].concat()
}

fn payload(bytes: &[u8]) -> Vec<u8> {
    let payload_bytes = u32::from_le_bytes(bytes[14..18].try_into().unwrap());
    zstd::decompress(&bytes[HEADER_BYTES..], payload_bytes as usize).unwrap()
}

#[test]
fn objects_round_trip_and_are_found_by_id() {
    let (records, schema) = (sample(512), schema());
    let block = check(2, &records, &schema);
    let (id, record) = (1024 + 2, records[2].as_ref().unwrap());
    assert_eq!(block.identifier(id), Some(record.identifier.as_str()));
    assert_eq!((block.kind(id), block.parent(id), block.parent(id + 1)), (Some(record.kind), None, Some(id)));
    assert_eq!(block.bounds(id), record.bounds);
    assert_eq!(block.value(id, 1), Some(record.attributes[1].1.clone()));
    assert_eq!((block.value(id + 1, 1), block.value(id, 99), block.kind(1024 + 49)), (None, None, None));
    check(0, &[], &schema);
    check(u32::MAX / 512, &[None, None], &schema);
    check(7, &sample(1), &schema);
}

/// Five objects of version 1, as its first encoder wrote them.
const FROZEN: &str = "\
    494e534f01009b70ec4302000000d300000028b52ffd20d3c50500820b292c606f1a0344016a00008a0e90361013918dbe63\
    460572b1cbd1a27e6fb06788ecbd1f141c7ceaa388086d2253daf47f0219d0eddda7f45f305558d3e9d5a8f61def43c496ee\
    1eb39ee4e85988a7b9f0d47a8e228704ab58c7d77650ac60fb7dc37e77d74279e468ef7e59c3549308077e3bd9f6ad6a7fb3\
    9a513eeef44e3618b58266599615ac2259193504893e9ab01291602ce1253308b938c7632f253aef1db03f17060080538000\
    4cd085f1ea48a5ad08400f";

#[test]
fn the_format_has_not_changed() {
    let digit = |at: usize| u8::from_str_radix(&FROZEN[2 * at..2 * at + 2], 16).unwrap();
    let bytes: Vec<u8> = (0..FROZEN.len() / 2).map(digit).collect();
    let block = ObjectBlock::decode(2, &bytes, &schema()).unwrap();
    assert!((1024..).zip(sample(5)).all(|(id, record)| block.record(id) == record));
}

#[test]
fn an_object_with_attributes_takes_few_bytes() {
    let bytes = encode(2, &sample(512), &schema()).unwrap().len();
    assert!(bytes < 512 * 16, "{bytes}");
}

#[test]
fn equal_objects_give_equal_bytes() {
    assert_eq!(encode(2, &sample(512), &schema()), encode(2, &sample(512), &schema()));
}

#[test]
fn what_a_block_cannot_hold_is_refused() {
    let schema = schema();
    let refused = |change: &dyn Fn(&mut ObjectRecord)| {
        let mut records = sample(4);
        change(records[0].as_mut().unwrap());
        encode(2, &records, &schema).is_err()
    };
    assert!(!refused(&|_| {}));
    assert!(refused(&|record| record.attributes[1].1 = Value::Bool(true)));
    assert!(refused(&|record| record.attributes[2].1 = Value::Float(f64::NAN)));
    assert!(refused(&|record| record.attributes.swap(0, 1)));
    assert!(refused(&|record| record.attributes[1].0 = 0));
    assert!(refused(&|record| record.attributes.push((99, Value::Bool(true)))));
    assert!(refused(&|record| record.attributes[0].1 = Value::Text("x".repeat(4097))));
    assert!(refused(&|record| record.identifier = "x".repeat(4097)));
    assert!(refused(&|record| record.bounds = Some(ObjectBounds { min: [1; 3], max: [0; 3] })));
    assert!(encode(2, &vec![None; 513], &schema).is_err());
    assert!(encode(u32::MAX / 512 + 1, &[], &schema).is_err());
    let long = |id: usize| {
        let attributes = (0..9).map(|i| (i, Value::Text(format!("{id:04}{}", "x".repeat(4092))))).collect();
        Some(ObjectRecord { attributes, ..sample(1).remove(0)? })
    };
    let mut builder = SchemaBuilder::default();
    (0..9).for_each(|i| builder.add(&i.to_string(), &Value::Text(String::new())));
    let schema = builder.finish(1);
    check(2, &(0..400).map(long).collect::<Vec<_>>(), &schema);
    assert!(encode(2, &(0..512).map(long).collect::<Vec<_>>(), &schema).is_err());
}

#[test]
fn truncated_flipped_and_extra_bytes_are_refused() {
    let schema = schema();
    let bytes = encode(2, &sample(60), &schema).unwrap();
    for length in 0..bytes.len() {
        assert!(ObjectBlock::decode(2, &bytes[..length], &schema).is_err(), "{length}");
    }
    assert!(ObjectBlock::decode(2, &[&bytes[..], &[0]].concat(), &schema).is_err());
    for at in 0..bytes.len() {
        let mut wrong = bytes.clone();
        wrong[at] ^= 0x10;
        assert!(ObjectBlock::decode(2, &wrong, &schema).is_err(), "{at}");
    }
    assert!(ObjectBlock::decode(3, &bytes, &schema).is_err());
    let version = [&MAGIC[..], &9u16.to_le_bytes(), &bytes[6..]].concat();
    assert_eq!(ObjectBlock::decode(2, &version, &schema).unwrap_err(), DecodeError::Version { found: 9, known: 1 });
}

#[test]
fn damaged_payloads_with_valid_checksums_never_panic() {
    let schema = schema();
    let payload = payload(&encode(2, &sample(60), &schema).unwrap());
    assert!(ObjectBlock::decode(2, &with_payload(&payload, payload.len() as u32), &schema).is_ok());
    // The quick tier changes one bit of most bytes, another one each time.
    let step = if tier::is_full() { 1 } else { 9 };
    for length in (0..payload.len()).step_by(step) {
        assert!(ObjectBlock::decode(2, &with_payload(&payload[..length], length as u32), &schema).is_err(), "{length}");
    }
    for bit in (0..8 * payload.len()).step_by(step) {
        let mut wrong = payload.clone();
        wrong[bit / 8] ^= 1 << (bit % 8);
        if let Ok(block) = ObjectBlock::decode(2, &with_payload(&wrong, wrong.len() as u32), &schema) {
            block.ids().iter().for_each(|id| assert!(block.record(*id).is_some()));
        }
    }
    let mut longer = payload.clone();
    longer.push(0);
    let found = ObjectBlock::decode(2, &with_payload(&longer, longer.len() as u32), &schema);
    assert_eq!(found.unwrap_err(), DecodeError::TrailingBytes(1));
}

#[test]
fn sizes_and_counts_over_a_limit_are_refused() {
    let schema = schema();
    let limit = |bytes: &[u8]| matches!(ObjectBlock::decode(2, bytes, &schema), Err(DecodeError::Limit { .. }));
    assert!(limit(&with_payload(&[0], MAX_PAYLOAD_BYTES as u32 + 1)));
    // 513 slots; then no slots, kinds, identifiers, parents and bounds, but seven columns.
    assert!(limit(&with_payload(&[0x81, 4], 2)));
    let numbers = [0, 0, 0];
    let empty = [&[0, 0][..], &numbers, &[0], &numbers, &numbers, &[0], &numbers, &[0], &numbers.repeat(6)].concat();
    let with_columns = |count: u8| [&empty[..], &[count]].concat();
    assert!(ObjectBlock::decode(2, &with_payload(&with_columns(0), empty.len() as u32 + 1), &schema).is_ok());
    assert!(limit(&with_payload(&with_columns(7), empty.len() as u32 + 1)));
}

#[test]
fn another_schema_is_refused() {
    let bytes = encode(2, &sample(60), &schema()).unwrap();
    let mut fewer = schema();
    fewer.attributes.pop();
    let mut other = schema();
    other.attributes[1].value_type = crate::value::ValueType::Float;
    assert!([fewer, other].iter().all(|schema| ObjectBlock::decode(2, &bytes, schema).is_err()));
}

fn any_value(attribute: u32) -> BoxedStrategy<Value> {
    match attribute {
        0 => "\\PC{0,12}".prop_map(Value::Text).boxed(),
        1 => prop_oneof![any::<i64>(), -3i64..100].prop_map(Value::Integer).boxed(),
        2 => prop_oneof![
            any::<f64>().prop_filter("finite", |value| value.is_finite()),
            (-9999i32..9999).prop_map(|value| f64::from(value) / 100.0),
            (-9999i32..9999).prop_map(|value| f64::from(value as f32 / 10.0)),
            Just(-0.0),
        ]
        .prop_map(Value::Float)
        .boxed(),
        3 => any::<bool>().prop_map(Value::Bool).boxed(),
        4 => any::<i32>().prop_map(Value::Date).boxed(),
        _ => "[A-C]{0,2}[0-9]{0,22}-?[0-9]{0,3}".prop_map(Value::Text).boxed(),
    }
}

fn any_record() -> impl Strategy<Value = ObjectRecord> {
    let attributes: Vec<_> =
        (0..6).map(|attribute| option::of(any_value(attribute).prop_map(move |value| (attribute, value)))).collect();
    let bounds = option::of(prop_oneof![any::<[[i32; 2]; 3]>(), Just([[-5, 7]; 3])]);
    ("[a-z]{0,3}[0-9]{0,5}", 0..FeatureKind::NAMES.len(), option::of(any::<u32>()), bounds, attributes).prop_map(
        |(identifier, kind, parent, bounds, attributes)| {
            let bounds =
                bounds.map(|axes| ObjectBounds { min: axes.map(|[a, b]| a.min(b)), max: axes.map(|[a, b]| a.max(b)) });
            let attributes = attributes.into_iter().flatten().collect();
            ObjectRecord { identifier, kind: FeatureKind::NAMES[kind].1, parent, bounds, attributes }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(tier::cases()))]

    #[test]
    fn any_objects_round_trip(block in 0u32..8_388_608, records in collection::vec(option::of(any_record()), 0..40)) {
        check(block, &records, &schema());
    }

    #[test]
    fn any_payload_never_panics(payload in collection::vec(any::<u8>(), 0..200)) {
        let _ = ObjectBlock::decode(2, &with_payload(&payload, payload.len() as u32), &schema());
    }
}
