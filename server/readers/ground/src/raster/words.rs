//! Words of a text file of any size, with their places.

use super::error::RasterError;
use super::source::Source;

const BLOCK_BYTES: u64 = 1 << 16;
/// Longer words are damage.
const MAX_WORD_BYTES: usize = 256;

/// Words between spaces and ends of lines.
pub(super) struct Words<'s> {
    source: &'s mut Source,
    block: Vec<u8>,
    block_offset: u64,
    /// Index of the next byte in the block.
    next: usize,
    word: Vec<u8>,
}

impl<'s> Words<'s> {
    pub(super) fn new(source: &'s mut Source, offset: u64) -> Self {
        Self { source, block: Vec::new(), block_offset: offset, next: 0, word: Vec::new() }
    }

    pub(super) fn file_len(&self) -> u64 {
        self.source.len()
    }

    /// The next word with its offset in the file.
    pub(super) fn next(&mut self) -> Result<Option<(u64, &str)>, RasterError> {
        self.word.clear();
        loop {
            let rest = self.rest()?;
            if rest.is_empty() {
                return Ok(None);
            }
            let spaces = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
            let is_word = spaces < rest.len();
            self.next += spaces;
            if is_word {
                break;
            }
        }
        let offset = self.block_offset + self.next as u64;
        loop {
            let rest = self.rest()?;
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            let is_end = end < rest.len() || end == 0;
            self.word.extend_from_slice(&self.block[self.next..self.next + end]);
            self.next += end;
            if self.word.len() > MAX_WORD_BYTES {
                return Err(RasterError::damaged("it has a word that is too long"));
            }
            if is_end {
                break;
            }
        }
        let word = std::str::from_utf8(&self.word).map_err(|_| RasterError::damaged("it is not text"))?;
        Ok(Some((offset, word)))
    }

    /// Bytes after the last word; none only at the end of the file.
    fn rest(&mut self) -> Result<&[u8], RasterError> {
        if self.next == self.block.len() {
            self.block_offset += self.block.len() as u64;
            self.next = 0;
            let left = self.source.len().saturating_sub(self.block_offset);
            self.block = self.source.read_at(self.block_offset, left.min(BLOCK_BYTES))?;
        }
        Ok(&self.block[self.next..])
    }
}

/// A number, with a point or a comma.
pub(super) fn number_of(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| word.replace(',', ".").parse().ok())
}
