//! PMTiles directories with valid framing: entries of a root directory and of leaves that point to each other.
#![no_main]

mod open_archive;

use libfuzzer_sys::fuzz_target;

const DATA_BYTES: usize = 4096;
/// Bytes of an entry in the input: id difference, run length, length and offset, each as value and shift.
const ENTRY_BYTES: usize = 8;
/// Separates directories in the input: the first is the root.
const SEPARATOR: u8 = 255;

fn push_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 128 {
        bytes.push(value as u8 | 128);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// A PMTiles directory: the number of entries, then one column per field.
fn directory(input: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let entries: Vec<&[u8]> = input.chunks_exact(ENTRY_BYTES).collect();
    push_varint(&mut bytes, entries.len() as u64);
    for field in 0..4 {
        for entry in &entries {
            push_varint(&mut bytes, u64::from(entry[2 * field]) << (entry[2 * field + 1] & 63));
        }
    }
    bytes
}

fuzz_target!(|input: &[u8]| {
    let mut directories = input.split(|byte| *byte == SEPARATOR).map(directory);
    let (root, leaves) = (directories.next().unwrap_or_default(), directories.flatten().collect::<Vec<u8>>());
    let mut file = b"PMTiles\x03".to_vec();
    file.resize(127, 0);
    let mut offset = file.len();
    for (at, length) in [(8, root.len()), (40, leaves.len()), (56, DATA_BYTES)] {
        file[at..at + 8].copy_from_slice(&(offset as u64).to_le_bytes());
        file[at + 8..at + 16].copy_from_slice(&(length as u64).to_le_bytes());
        offset += length;
    }
    // Neither directories nor tiles are compressed.
    (file[97], file[98]) = (1, 1);
    let bytes = [&file[..], &root, &leaves, &[7; DATA_BYTES]].concat();
    open_archive::check(&bytes);
});
