//! Values in objects of the work store, with a hash.
//!
//! Layout: magic, what it is (4 bytes each), the job's number (16 characters), the value in bincode, a BLAKE3 hash of everything
//! before. Only the version of the program that wrote an object reads it.

use super::owned::{OwnedStore, Removal};
use crate::error::BakeError;
use insula_protocol::codec::bincode;
use serde::Serialize;
use serde::de::DeserializeOwned;

const MAGIC: [u8; 4] = *b"INSW";
const HEAD_BYTES: usize = 24;
const HASH_BYTES: usize = blake3::OUT_LEN;
/// Larger objects are refused.
const MAX_BYTES: u64 = bincode::LONG_LIMIT as u64;

/// What an object is.
pub(super) type SealedKind = [u8; 4];

/// Objects of one job.
#[derive(Clone, Copy)]
pub(super) struct SealedStore<'a> {
    pub(super) store: OwnedStore<'a>,
    /// The job's number: 16 characters.
    pub(super) job: &'a str,
}

impl SealedStore<'_> {
    /// Writes a value. Fails if the store does not take it.
    pub(super) fn write(&self, name: &str, kind: SealedKind, value: &impl Serialize) -> Result<(), BakeError> {
        let bytes = seal(self.job, kind, value).map_err(|what| self.damaged(name, what))?;
        self.store.put(name, bytes).map_err(|cause| self.failed(name, cause))
    }

    /// The value of an object; `None` if there is none. Fails if it is of another job or damaged.
    pub(super) fn find<T: DeserializeOwned>(&self, name: &str, kind: SealedKind) -> Result<Option<T>, BakeError> {
        let Some(size) = self.store.size(name).map_err(|cause| self.failed(name, cause))? else { return Ok(None) };
        if size > MAX_BYTES {
            return Err(self.damaged(name, "it is too large"));
        }
        let bytes = self.store.range(name, 0, size).map_err(|cause| self.failed(name, cause))?;
        open(self.job, kind, &bytes).map(Some).map_err(|what| self.damaged(name, what))
    }

    /// The value of an object that an earlier step writes. Fails as [`Self::find`], or if there is none yet.
    pub(super) fn read<T: DeserializeOwned>(&self, name: &str, kind: SealedKind) -> Result<T, BakeError> {
        let missing = || BakeError::StepMissing { work: self.store.address(), name: name.to_owned() };
        self.find(name, kind)?.ok_or_else(missing)
    }

    /// Whether an object is there. It is complete then.
    pub(super) fn has(&self, name: &str) -> Result<bool, BakeError> {
        Ok(self.store.size(name).map_err(|cause| self.failed(name, cause))?.is_some())
    }

    /// The error of an object that is not as this version of the program wrote it.
    pub(super) fn damaged(&self, name: &str, what: &'static str) -> BakeError {
        BakeError::StepDamaged { work: self.store.address(), name: name.to_owned(), what }
    }

    /// The error of a store that does not answer.
    pub(super) fn failed(&self, name: &str, cause: std::io::Error) -> BakeError {
        BakeError::work(self.store.address(), name, cause)
    }
}

/// What was removed, and what stays because no step wrote it as it is.
#[derive(Debug, Default)]
pub(super) struct Removed {
    /// Number of objects.
    pub(super) objects: usize,
    /// Names of those that stay.
    pub(super) kept: Vec<String>,
}

impl Removed {
    /// Removes objects, except for those that no step wrote as they are. Fails if the store does not answer.
    pub(super) fn remove(&mut self, store: OwnedStore<'_>, names: &[String]) -> Result<(), BakeError> {
        for name in names {
            let failed = |cause| BakeError::work(store.address(), name, cause);
            match store.remove(name).map_err(failed)? {
                Removal::Removed => self.objects += 1,
                Removal::Missing => {}
                Removal::Kept => self.kept.push(name.clone()),
            }
        }
        Ok(())
    }

    /// Removes the entries of a folder. Fails as [`Self::remove`].
    pub(super) fn remove_folder(&mut self, store: OwnedStore<'_>, folder: &str) -> Result<(), BakeError> {
        let failed = |cause| BakeError::work(store.address(), folder, cause);
        self.remove(store, &store.list(folder).map_err(failed)?)
    }
}

fn seal(job: &str, kind: SealedKind, value: &impl Serialize) -> Result<Vec<u8>, &'static str> {
    let mut bytes = Vec::new();
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&kind);
    bytes.extend_from_slice(format!("{job:16.16}").as_bytes());
    bytes.extend(bincode::to_bytes(value).map_err(|_| "it cannot be written")?);
    bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
    if bytes.len() as u64 > MAX_BYTES { Err("it is too large") } else { Ok(bytes) }
}

fn open<T: DeserializeOwned>(job: &str, kind: SealedKind, bytes: &[u8]) -> Result<T, &'static str> {
    let (body, hash) = bytes.split_last_chunk::<HASH_BYTES>().ok_or("it is cut short")?;
    if blake3::hash(body) != *hash {
        return Err("its hash is wrong");
    }
    let (head, value) = body.split_at_checked(HEAD_BYTES).ok_or("it is cut short")?;
    if head[..4] != MAGIC || head[4..8] != kind {
        return Err("it is no object of this kind");
    }
    if &head[8..] != format!("{job:16.16}").as_bytes() {
        return Err("it belongs to another job");
    }
    bincode::long_from_bytes(value).map_err(|_| "its fields are damaged")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_return_and_damage_is_detected() {
        let value = (vec![1.5_f32, f32::INFINITY], "text".to_owned(), Some(7_u64));
        let bytes = seal("0123456789abcdef", *b"TEST", &value).unwrap();
        let back = |job: &str, kind, bytes: &[u8]| open::<(Vec<f32>, String, Option<u64>)>(job, kind, bytes);
        assert_eq!(back("0123456789abcdef", *b"TEST", &bytes).unwrap(), value);
        assert_eq!(back("0123456789abcdee", *b"TEST", &bytes), Err("it belongs to another job"));
        assert_eq!(back("0123456789abcdef", *b"TEXT", &bytes), Err("it is no object of this kind"));
        for at in 0..bytes.len() {
            assert!(back("0123456789abcdef", *b"TEST", &bytes[..at]).is_err(), "cut to {at}");
            let mut bad = bytes.clone();
            bad[at] ^= 1;
            assert!(back("0123456789abcdef", *b"TEST", &bad).is_err(), "flipped {at}");
        }
    }

    #[test]
    fn a_length_beyond_the_bytes_allocates_nothing() {
        // A sealed list that announces 2^60 numbers.
        let mut bytes = seal("j", *b"TEST", &()).unwrap();
        bytes.truncate(bytes.len() - HASH_BYTES);
        bytes.push(253);
        bytes.extend_from_slice(&(1_u64 << 60).to_le_bytes());
        bytes.extend_from_slice(blake3::hash(&bytes.clone()).as_bytes());
        assert_eq!(open::<Vec<u64>>("j", *b"TEST", &bytes), Err("its fields are damaged"));
    }
}
