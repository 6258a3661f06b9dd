//! A file as the parquet crate reads it.

use bytes::Bytes;
use insula_source::random_file::{RandomFile, RandomReader};
use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use std::io::{BufReader, Read};

/// A file that is read in any order.
#[derive(Clone)]
pub(super) struct ParquetFile(pub(super) RandomFile);

impl Length for ParquetFile {
    fn len(&self) -> u64 {
        self.0.bytes()
    }
}

impl ChunkReader for ParquetFile {
    type T = BufReader<RandomReader>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        Ok(self.0.reader(start))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        let is_inside = start.checked_add(length as u64).is_some_and(|end| end <= self.len());
        if !is_inside {
            return Err(ParquetError::EOF("a part of the file lies behind its end".into()));
        }
        let mut bytes = vec![0; length];
        self.0.reader(start).read_exact(&mut bytes)?;
        Ok(bytes.into())
    }
}
