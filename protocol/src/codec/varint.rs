//! Whole numbers in as few bytes as they need, and bytes read with their limits checked.

use crate::error::DecodeError;

/// Small for numbers near zero of either sign.
pub const fn zigzag(v: i32) -> u32 {
    ((v << 1) ^ (v >> 31)) as u32
}

/// Undoes [`zigzag`].
pub const fn unzigzag(v: u32) -> i32 {
    (v >> 1) as i32 ^ -((v & 1) as i32)
}

/// LEB128: seven bits a byte, low ones first.
pub fn push(out: &mut Vec<u8>, mut v: u32) {
    while v >= 0x80 {
        out.push(v as u8 | 0x80);
        v >>= 7;
    }
    out.push(v as u8);
}

/// Walks over bytes; every read is checked.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    len: usize,
}

impl<'a> Reader<'a> {
    /// From the first byte on.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, len: bytes.len() }
    }

    /// The next `n` bytes.
    pub fn take(&mut self, n: usize) -> Result<&'a [u8], DecodeError> {
        let (head, tail) = self
            .bytes
            .split_at_checked(n)
            .ok_or(DecodeError::Truncated { wanted: self.len - self.bytes.len() + n, found: self.len })?;
        self.bytes = tail;
        Ok(head)
    }

    /// The next `N` bytes.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    /// One byte.
    pub fn u8(&mut self) -> Result<u8, DecodeError> {
        Ok(self.array::<1>()?[0])
    }

    /// Two bytes, little-endian.
    pub fn u16(&mut self) -> Result<u16, DecodeError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    /// Four bytes, little-endian.
    pub fn u32(&mut self) -> Result<u32, DecodeError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// Four bytes, little-endian; must be finite.
    pub fn f32(&mut self) -> Result<f32, DecodeError> {
        let v = f32::from_le_bytes(self.array()?);
        if v.is_finite() { Ok(v) } else { Err(DecodeError::Invalid("a number is not finite")) }
    }

    /// A number of [`push`].
    pub fn varint(&mut self) -> Result<u32, DecodeError> {
        let mut v = 0u64;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.u8()?;
            v |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return u32::try_from(v).map_err(|_| DecodeError::Invalid("a varint is over 32 bits"));
            }
        }
        Err(DecodeError::Invalid("a varint is over 32 bits"))
    }

    /// All that is left.
    pub fn rest(self) -> &'a [u8] {
        self.bytes
    }

    /// Whether all was read: what is left over is an error.
    pub fn finish(self) -> Result<(), DecodeError> {
        if self.bytes.is_empty() { Ok(()) } else { Err(DecodeError::TrailingBytes(self.bytes.len())) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trips() {
        for v in [0, 1, -1, 63, -64, 127, 128, i32::MAX, i32::MIN] {
            assert_eq!(unzigzag(zigzag(v)), v);
            let mut bytes = Vec::new();
            push(&mut bytes, zigzag(v));
            let mut reader = Reader::new(&bytes);
            assert_eq!(reader.varint().unwrap(), zigzag(v));
            reader.finish().unwrap();
        }
        assert!(Reader::new(&[0xff; 5]).varint().is_err());
        assert!(Reader::new(&[0x80]).varint().is_err());
    }
}
