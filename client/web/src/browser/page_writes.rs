//! Writes to the atlas on their way to the workers that draw on the CPU, each of which has its own copy.
//!
//! As words: for each write its kind (0 words, 1 summary), its number, its length in words, then its words.

use insula_shaders::layout::SUMMARY_WORDS;
use insula_viewer::cache::Upload;

const WORDS: u32 = 0;
const SUMMARY: u32 = 1;

/// Writes that the workers have not got yet.
#[derive(Debug, Default)]
pub(crate) struct PageWrites {
    words: Vec<u32>,
}

impl PageWrites {
    fn push(&mut self, kind: u32, number: u32, words: &[u32]) {
        self.words.extend([kind, number, words.len() as u32]);
        self.words.extend_from_slice(words);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The waiting writes, which are forgotten.
    pub(crate) fn take(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.words)
    }
}

impl Upload for PageWrites {
    fn write_words(&mut self, at: u32, words: &[u32]) {
        self.push(WORDS, at, words);
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        self.push(SUMMARY, slot, words);
    }
}

/// Carries out what [`PageWrites::take`] returned. Ignores what is incomplete.
pub(crate) fn apply(mut words: &[u32], upload: &mut impl Upload) {
    while let &[kind, number, length, ref rest @ ..] = words {
        let Some((content, rest)) = rest.split_at_checked(length as usize) else { return };
        match (kind, content.try_into()) {
            (SUMMARY, Ok(summary)) => upload.write_summary(number, summary),
            _ => upload.write_words(number, content),
        }
        words = rest;
    }
}
