//! Variable-length integers (LEB128) and the zigzag mapping of signed to unsigned numbers.

/// Maps 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
pub const fn zigzag(v: i32) -> u32 {
    ((v << 1) ^ (v >> 31)) as u32
}

/// The inverse of [`zigzag`].
pub(crate) const fn unzigzag(v: u32) -> i32 {
    (v >> 1) as i32 ^ -((v & 1) as i32)
}

/// [`zigzag`] of 64 bits.
pub const fn zigzag64(v: i64) -> u64 {
    ((v << 1) ^ (v >> 63)) as u64
}

/// The inverse of [`zigzag64`].
pub const fn unzigzag64(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

/// Appends `v` as LEB128: seven bits per byte, low bits first.
pub fn push(out: &mut Vec<u8>, v: u32) {
    push64(out, v.into());
}

/// [`push`] of 64 bits.
pub fn push64(out: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        out.push(v as u8 | 0x80);
        v >>= 7;
    }
    out.push(v as u8);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::byte_reader::ByteReader;

    #[test]
    fn numbers_round_trip() {
        for v in [0, 1, -1, 63, -64, 127, 128, i32::MAX, i32::MIN] {
            assert_eq!(unzigzag(zigzag(v)), v);
            let mut bytes = Vec::new();
            push(&mut bytes, zigzag(v));
            let mut reader = ByteReader::new(&bytes);
            assert_eq!(reader.varint().unwrap(), zigzag(v));
            reader.finish().unwrap();
        }
        for v in [0, 1, -1, 63, -64, 64, i64::MAX, i64::MIN] {
            assert_eq!(unzigzag64(zigzag64(v)), v);
            let mut bytes = Vec::new();
            push64(&mut bytes, zigzag64(v));
            let mut reader = ByteReader::new(&bytes);
            assert_eq!(reader.varint64().unwrap(), zigzag64(v));
            reader.finish().unwrap();
        }
    }

    #[test]
    fn overlong_and_truncated_numbers_are_refused() {
        assert!(ByteReader::new(&[0xff; 5]).varint().is_err());
        assert!(ByteReader::new(&[0x80]).varint().is_err());
        assert!(ByteReader::new(&[0xff; 10]).varint64().is_err());
        assert!(ByteReader::new(&[0xff; 3]).varint64().is_err());
        assert!(ByteReader::new(&[9]).count("things", 8).is_err());
    }
}
