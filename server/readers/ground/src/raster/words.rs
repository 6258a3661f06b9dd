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

/// A number, with a point or a comma; also what is none in the words of the C library of Windows, such as `-nan(ind)` and `1.#QNAN`.
pub(super) fn number_of(word: &str) -> Option<f64> {
    let number = word.parse().ok().or_else(|| word.replace(',', ".").parse().ok());
    let digits = word.trim_start_matches(['+', '-']);
    let is_none = || digits.starts_with("1.#") || digits.to_ascii_lowercase().starts_with("nan(");
    number.or_else(|| is_none().then_some(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_programs_of_any_system_write_them() {
        assert_eq!([number_of("-1.5"), number_of("1,5"), number_of("2e3")], [Some(-1.5), Some(1.5), Some(2000.0)]);
        for word in ["nan", "-nan(ind)", "-NaN(snan)", "1.#QNAN", "-1.#IND", "1.#INF"] {
            assert!(number_of(word).is_some_and(|number| !number.is_finite()), "{word}");
        }
        assert_eq!(["ncols", "x", "", "1.2.3"].map(number_of), [None; 4]);
    }
}
