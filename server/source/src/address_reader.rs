//! What reads inputs that are addresses. The bake has no HTTP of its own: the program that calls it passes this.

use std::fmt::Debug;
use std::io;
use std::ops::Range;

/// Reads inputs that are addresses.
pub trait AddressReader: Debug + Sync {
    /// All bytes of a file on a web server. Fails with `NotFound` if there is none, and if it has more than `max_bytes`.
    fn fetch(&self, url: &str, max_bytes: u64) -> io::Result<Vec<u8>>;

    /// The objects below a folder of a bucket, `s3://BUCKET/FOLDER/`, with their names within it. The last ones may have names that are
    /// no paths, such as `a/../b`. Fails if it cannot be listed.
    fn list(&self, folder: &str) -> io::Result<Vec<ListedObject>>;

    /// Size in bytes of an object of a bucket, `s3://BUCKET/NAME`. Fails with `NotFound` if there is none.
    fn size(&self, address: &str) -> io::Result<u64>;

    /// Some bytes of an object of a bucket. Fails if it does not have them.
    fn range(&self, address: &str, range: Range<u64>) -> io::Result<Vec<u8>>;
}

/// An object of a bucket.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedObject {
    /// Within the listed folder.
    pub name: String,
    pub bytes: u64,
}
