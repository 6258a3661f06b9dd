//! Checked reading of a block's payload, and variable-length numbers of 64 bits.

use insula_protocol::DecodeError;

/// A cursor over a payload. Reads fail with [`DecodeError::Truncated`] if too few bytes remain.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    rest: &'a [u8],
    total_bytes: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, total_bytes: bytes.len() }
    }

    pub(super) fn take(&mut self, bytes: usize) -> Result<&'a [u8], DecodeError> {
        let read = self.total_bytes - self.rest.len();
        let (head, tail) = self
            .rest
            .split_at_checked(bytes)
            .ok_or(DecodeError::Truncated { wanted: read.saturating_add(bytes), found: self.total_bytes })?;
        self.rest = tail;
        Ok(head)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub(super) fn u8(&mut self) -> Result<u8, DecodeError> {
        let [byte] = self.array()?;
        Ok(byte)
    }

    pub(super) fn varint(&mut self) -> Result<u64, DecodeError> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            let digits = u64::from(byte & 0x7f);
            if shift == 63 && digits > 1 {
                break;
            }
            value |= digits << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(DecodeError::Invalid("a varint has more than 64 bits"))
    }

    /// A count of `what`. Fails if it is above `limit`.
    pub(super) fn count(&mut self, what: &'static str, limit: usize) -> Result<usize, DecodeError> {
        let found = self.varint()?;
        if found > limit as u64 {
            return Err(DecodeError::Limit { what, found, limit: limit as u64 });
        }
        Ok(found as usize)
    }

    /// Fails if bytes remain.
    pub(super) fn finish(self) -> Result<(), DecodeError> {
        if self.rest.is_empty() { Ok(()) } else { Err(DecodeError::TrailingBytes(self.rest.len())) }
    }
}

/// Appends `value` as LEB128.
pub(super) fn push_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Maps 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
pub(super) fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

/// The inverse of [`zigzag`].
pub(super) fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_round_trip_and_longer_ones_are_refused() {
        for value in [0, 1, -1, 63, -64, 64, i64::MAX, i64::MIN] {
            assert_eq!(unzigzag(zigzag(value)), value);
            let mut bytes = Vec::new();
            push_varint(&mut bytes, zigzag(value));
            let mut reader = Reader::new(&bytes);
            assert_eq!(reader.varint().unwrap(), zigzag(value));
            reader.finish().unwrap();
        }
        assert!(Reader::new(&[0xff; 10]).varint().is_err());
        assert!(Reader::new(&[0xff; 3]).varint().is_err());
        assert!(Reader::new(&[9]).count("things", 8).is_err());
    }
}
