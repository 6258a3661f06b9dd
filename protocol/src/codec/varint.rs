//! Variable-length integers (LEB128) and the zigzag mapping of signed to unsigned numbers.

/// Maps 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
pub const fn zigzag(v: i32) -> u32 {
    ((v << 1) ^ (v >> 31)) as u32
}

/// The inverse of [`zigzag`].
pub(crate) const fn unzigzag(v: u32) -> i32 {
    (v >> 1) as i32 ^ -((v & 1) as i32)
}

/// Appends `v` as LEB128: seven bits per byte, low bits first.
pub fn push(out: &mut Vec<u8>, mut v: u32) {
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
    }

    #[test]
    fn overlong_and_truncated_numbers_are_refused() {
        assert!(ByteReader::new(&[0xff; 5]).varint().is_err());
        assert!(ByteReader::new(&[0x80]).varint().is_err());
    }
}
