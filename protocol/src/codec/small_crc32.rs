//! CRC-32 by tables that are made at the first use. Those of the crate that all other targets use are a fortieth of what browsers download.

use std::sync::LazyLock;

/// Reflected, of IEEE 802.3.
const POLYNOMIAL: u32 = 0xedb8_8320;

/// For each byte, its remainder, and that of it before one, two and three bytes of zero.
static TABLES: LazyLock<[[u32; 256]; 4]> = LazyLock::new(|| {
    let mut tables = [[0; 256]; 4];
    for byte in 0..256 {
        tables[0][byte] = (0..8).fold(byte as u32, |rest, _| (rest >> 1) ^ (POLYNOMIAL & (rest & 1).wrapping_neg()));
    }
    for byte in 0..256 {
        for k in 1..4 {
            let before = tables[k - 1][byte];
            tables[k][byte] = (before >> 8) ^ tables[0][(before & 0xff) as usize];
        }
    }
    tables
});

/// The checksum of bytes that have the checksum `before`, and of `bytes` behind them.
pub(super) fn extend(before: u32, bytes: &[u8]) -> u32 {
    let [one, two, three, four] = &*TABLES;
    let (words, rest) = bytes.as_chunks();
    let sum = words.iter().fold(!before, |sum, word| {
        let [a, b, c, d] = (sum ^ u32::from_le_bytes(*word)).to_le_bytes().map(usize::from);
        four[a] ^ three[b] ^ two[c] ^ one[d]
    });
    !rest.iter().fold(sum, |sum, byte| (sum >> 8) ^ one[usize::from(sum as u8 ^ byte)])
}
