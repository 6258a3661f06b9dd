//! Fields of Protocol Buffers messages, without copies.

/// The bytes are no valid message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WireFault;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Value<'a> {
    Number(u64),
    Bytes(&'a [u8]),
    /// A fixed number, which no field of OpenStreetMap's messages uses.
    Other,
}

impl<'a> Value<'a> {
    pub(super) fn bytes(self) -> Result<&'a [u8], WireFault> {
        match self {
            Self::Bytes(bytes) => Ok(bytes),
            _ => Err(WireFault),
        }
    }

    pub(super) fn number(self) -> Result<u64, WireFault> {
        match self {
            Self::Number(number) => Ok(number),
            _ => Err(WireFault),
        }
    }
}

/// Takes a number of variable length from the front.
#[inline]
pub(super) fn take_varint(bytes: &mut &[u8]) -> Result<u64, WireFault> {
    if let Some((&first, rest)) = bytes.split_first().filter(|(first, _)| **first < 0x80) {
        *bytes = rest;
        return Ok(u64::from(first));
    }
    take_long_varint(bytes)
}

fn take_long_varint(bytes: &mut &[u8]) -> Result<u64, WireFault> {
    let mut value = 0_u64;
    for (i, &byte) in bytes.iter().take(10).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * i);
        if byte < 0x80 {
            *bytes = &bytes[i + 1..];
            return Ok(value);
        }
    }
    Err(WireFault)
}

fn take<'a>(bytes: &mut &'a [u8], count: u64) -> Result<&'a [u8], WireFault> {
    let count = usize::try_from(count).map_err(|_| WireFault)?;
    let (taken, rest) = bytes.split_at_checked(count).ok_or(WireFault)?;
    *bytes = rest;
    Ok(taken)
}

/// The signed number of a zigzag number.
pub(super) fn zigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

/// Number and value of the first field of a message, and the rest of the message.
pub(super) fn first_field(mut message: &[u8]) -> Result<(u64, Value<'_>, &[u8]), WireFault> {
    let tag = take_varint(&mut message)?;
    let value = match tag & 7 {
        0 => Value::Number(take_varint(&mut message)?),
        1 => take(&mut message, 8).map(|_| Value::Other)?,
        2 => {
            let count = take_varint(&mut message)?;
            Value::Bytes(take(&mut message, count)?)
        }
        5 => take(&mut message, 4).map(|_| Value::Other)?,
        _ => return Err(WireFault),
    };
    Ok((tag >> 3, value, message))
}

/// Calls `field` with the number and the value of each field of a message.
pub(super) fn fields<'a>(
    mut message: &'a [u8],
    mut field: impl FnMut(u64, Value<'a>) -> Result<(), WireFault>,
) -> Result<(), WireFault> {
    while !message.is_empty() {
        let (number, value, rest) = first_field(message)?;
        message = rest;
        field(number, value)?;
    }
    Ok(())
}

/// The numbers of a packed field; ends after the first damaged one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Packed<'a>(pub(super) &'a [u8]);

impl Iterator for Packed<'_> {
    type Item = Result<u64, WireFault>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let number = take_varint(&mut self.0);
        if number.is_err() {
            self.0 = &[];
        }
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_length_are_read() {
        for value in [0, 1, 127, 128, 300, u64::from(u32::MAX), u64::MAX] {
            let (mut bytes, mut rest) = (Vec::new(), value);
            while rest >= 0x80 {
                bytes.push(rest as u8 | 0x80);
                rest >>= 7;
            }
            bytes.push(rest as u8);
            assert_eq!(take_varint(&mut &bytes[..]), Ok(value));
            bytes.pop();
            assert_eq!(take_varint(&mut &bytes[..]), Err(WireFault));
        }
        assert_eq!(take_varint(&mut &[0xff; 11][..]), Err(WireFault));
        assert_eq!([0, 1, 2, 3, u64::MAX].map(zigzag), [0, -1, 1, -2, i64::MIN]);
    }

    #[test]
    fn lengths_beyond_the_message_are_faults() {
        let mut found = Vec::new();
        let read = fields(&[0x08, 0x05, 0x12, 0x02, 7, 8, 0x1d, 0, 0, 0, 0], |number, value| {
            found.push((number, value));
            Ok(())
        });
        assert_eq!(read, Ok(()));
        assert_eq!(found, [(1, Value::Number(5)), (2, Value::Bytes(&[7, 8])), (3, Value::Other)]);
        for bad in [&[0x12, 3, 0, 0][..], &[0x12], &[0x0b], &[0x09, 0], &[0x12, 0xff, 0xff, 0xff, 0xff, 0x0f]] {
            assert_eq!(fields(bad, |_, _| Ok(())), Err(WireFault), "{bad:?}");
        }
    }
}
