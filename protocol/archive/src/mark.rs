//! What an archive carries of the version of its city, so that archives and manifest of different bakes are told apart.
//!
//! The version is a hash of the archives, so they cannot contain it: the mark is a hash of the version, and the hash of an archive takes it
//! for zeros. It stands where a PMTiles header has the centre of the map, which means nothing for the nodes of a city, and is a valid
//! centre. Archives of earlier bakes, whose manifest says nothing of marks, may have none.

use insula_protocol::Manifest;
use std::ops::Range;

/// Where the header of an archive has its mark: longitude and latitude of the centre, in 10^-7 degrees.
pub const MARK_AT: Range<usize> = 119..127;

const LONGITUDES: u32 = 3_600_000_001;
const LATITUDES: u32 = 1_800_000_001;

/// The mark of a version of a city.
pub fn mark_of(version: &str) -> [u8; 8] {
    // FNV-1a. A version is a hash already.
    let hash = version
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    let within = |bits: u32, count: u32| (i64::from(bits % count) - i64::from(count / 2)) as i32;
    let longitude = within((hash >> 32) as u32, LONGITUDES);
    // Zeros are no mark.
    let latitude = if longitude == 0 { 1 } else { within(hash as u32, LATITUDES) };
    let mut mark = [0; 8];
    mark[..4].copy_from_slice(&longitude.to_le_bytes());
    mark[4..].copy_from_slice(&latitude.to_le_bytes());
    mark
}

/// The mark that the archives of a city have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExpectedMark {
    mark: [u8; 8],
    may_be_missing: bool,
}

impl ExpectedMark {
    pub(crate) fn of(manifest: &Manifest) -> Self {
        Self { mark: mark_of(&manifest.version), may_be_missing: manifest.marks.is_none() }
    }

    /// Whether an archive with this mark can be of the city.
    pub(crate) fn accepts(self, mark: [u8; 8]) -> bool {
        mark == self.mark || self.may_be_missing && mark == [0; 8]
    }
}

/// Marks an archive file as of a version, and synchronises it. Fails if it cannot be written.
#[cfg(feature = "fs")]
pub fn mark_file(path: &std::path::Path, version: &str) -> std::io::Result<()> {
    use std::io::{Seek as _, SeekFrom, Write as _};
    let mut file = std::fs::OpenOptions::new().write(true).open(path)?;
    file.seek(SeekFrom::Start(MARK_AT.start as u64))?;
    file.write_all(&mark_of(version))?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_differ_and_are_centres_of_maps() {
        let versions: Vec<String> = (0..1000).map(|number| format!("{number:016x}")).collect();
        let marks: std::collections::BTreeSet<_> = versions.iter().map(|version| mark_of(version)).collect();
        assert_eq!(marks.len(), 1000);
        for mark in marks {
            let number = |at: usize| i32::from_le_bytes([mark[at], mark[at + 1], mark[at + 2], mark[at + 3]]);
            assert!(number(0).unsigned_abs() <= 1_800_000_000 && number(4).unsigned_abs() <= 900_000_000);
        }
        for may_be_missing in [false, true] {
            let expected = ExpectedMark { mark: mark_of("a"), may_be_missing };
            assert!(expected.accepts(mark_of("a")) && !expected.accepts(mark_of("b")));
            assert_eq!(expected.accepts([0; 8]), may_be_missing);
        }
    }
}
