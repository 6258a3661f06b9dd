//! Files packed by gzip. Their bytes tell, whatever their names: servers unpack on the way, and browsers keep the packed bytes.

use flate2::read::MultiGzDecoder;
use std::io::{self, BufReader, Cursor, Read};

/// First bytes of a file that is packed by gzip.
const MAGIC: [u8; 3] = [0x1f, 0x8b, 0x08];

/// The unpacked bytes of a reader. Fails if it cannot be read.
pub fn unpacked<'a>(mut reader: impl Read + 'a) -> io::Result<Box<dyn Read + 'a>> {
    let start = start_of(&mut reader)?;
    let is_packed = start == MAGIC;
    let whole = BufReader::new(Cursor::new(start).chain(reader));
    Ok(if is_packed { Box::new(MultiGzDecoder::new(whole)) } else { Box::new(whole) })
}

/// Whether the bytes of a reader, from its start, are packed. Fails if it cannot be read.
pub fn is_packed(reader: &mut impl Read) -> io::Result<bool> {
    Ok(start_of(reader)? == MAGIC)
}

/// The name of a file without `.gz`.
pub fn unpacked_name(name: &str) -> &str {
    let end = name.len().saturating_sub(3);
    let has_end = name.get(end..).is_some_and(|end| end.eq_ignore_ascii_case(".gz"));
    if has_end { name.get(..end).unwrap_or(name) } else { name }
}

fn start_of(reader: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut start = Vec::with_capacity(MAGIC.len());
    reader.take(MAGIC.len() as u64).read_to_end(&mut start)?;
    Ok(start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::gzip;

    #[test]
    fn bytes_tell_whether_they_are_packed() {
        for bytes in [&b""[..], b"\x1f", b"\x1f\x8b", b"{}", b"some text"] {
            let read = |packed: &[u8]| {
                let mut found = Vec::new();
                unpacked(packed).unwrap().read_to_end(&mut found).unwrap();
                found
            };
            assert_eq!((read(bytes), read(&gzip(bytes))), (bytes.to_vec(), bytes.to_vec()));
            assert!(!is_packed(&mut &*bytes).unwrap() && is_packed(&mut &*gzip(bytes)).unwrap());
        }
    }

    #[test]
    fn names_lose_their_end() {
        for (name, expected) in
            [("a.tif.GZ", "a.tif"), ("a.tif", "a.tif"), (".gz", ""), ("gz", "gz"), ("ä.gz", "ä"), ("öä", "öä")]
        {
            assert_eq!(unpacked_name(name), expected);
        }
    }
}
