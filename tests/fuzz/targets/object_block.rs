//! Blocks of objects: whatever decodes round trips. The input is used as a block, and as the payload of one with a valid checksum.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_objects::{
    BLOCK_OBJECTS, ObjectBlock, Schema, SchemaBuilder, Value,
    block::{MAGIC, VERSION, encode},
};
use insula_protocol::codec::{checksum, zstd};
use libfuzzer_sys::fuzz_target;

const BLOCK: u32 = 3;

fn check(bytes: &[u8], schema: &Schema) {
    let Ok(block) = ObjectBlock::decode(BLOCK, bytes, schema) else { return };
    let first = BLOCK * BLOCK_OBJECTS as u32;
    let records: Vec<_> = (first..first + BLOCK_OBJECTS as u32).map(|id| block.record(id)).collect();
    assert_eq!(records.iter().flatten().count(), block.ids().len());
    // Texts may take more memory in the encoder's coding than a block may have.
    let Ok(again) = encode(BLOCK, &records, schema) else { return };
    let again = ObjectBlock::decode(BLOCK, &again, schema).expect("an encoded block can be decoded");
    assert!((first..).zip(records).all(|(id, record)| again.record(id) == record));
}

fuzz_target!(|bytes: &[u8]| {
    let mut builder = SchemaBuilder::default();
    let values = [Value::Text(String::new()), Value::Integer(0), Value::Float(0.0), Value::Bool(true), Value::Date(0)];
    for (name, value) in ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j"].into_iter().zip(values.iter().cycle()) {
        builder.add(name, value);
    }
    let schema = builder.finish(1);
    check(bytes, &schema);
    // A fuzzer cannot guess checksums.
    let mut checked = BLOCK.to_le_bytes().to_vec();
    checked.extend((bytes.len() as u32).to_le_bytes());
    checked.extend(zstd::compress(bytes).expect("bytes can be compressed"));
    check(&[&MAGIC[..], &VERSION.to_le_bytes(), &checksum(&checked).to_le_bytes(), &checked].concat(), &schema);
});
