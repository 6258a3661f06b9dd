//! Writes to the atlas on their way to what draws: the workers of the CPU, each of which has its own copy, or the GPU.
//!
//! As words: for each write its kind (0 words, 1 summary), its number, its length in words, then its words.

use insula_shaders::layout::SUMMARY_WORDS;
use insula_viewer::cache::Upload;

const WORDS: u32 = 0;
const SUMMARY: u32 = 1;

/// Writes that have not been sent yet.
#[derive(Debug, Default)]
pub struct PageWrites {
    words: Vec<u32>,
}

impl PageWrites {
    fn push(&mut self, kind: u32, number: u32, words: &[u32]) {
        self.words.extend([kind, number, words.len() as u32]);
        self.words.extend_from_slice(words);
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The waiting writes, which are forgotten.
    pub fn take(&mut self) -> Vec<u32> {
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
pub fn apply(mut words: &[u32], upload: &mut impl Upload) {
    while let &[kind, number, length, ref rest @ ..] = words {
        let Some((content, rest)) = rest.split_at_checked(length as usize) else { return };
        match (kind, content.try_into()) {
            (SUMMARY, Ok(summary)) => upload.write_summary(number, summary),
            _ => upload.write_words(number, content),
        }
        words = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was written: the kind of each write, its number, its words.
    #[derive(Default, Debug, PartialEq)]
    struct Record(Vec<(u32, u32, Vec<u32>)>);

    impl Upload for Record {
        fn write_words(&mut self, at: u32, words: &[u32]) {
            self.0.push((WORDS, at, words.to_vec()));
        }

        fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
            self.0.push((SUMMARY, slot, words.to_vec()));
        }
    }

    #[test]
    fn writes_arrive_in_their_order() {
        let mut writes = PageWrites::default();
        writes.write_words(4096, &[1, 2, 3]);
        writes.write_summary(5, &[6; SUMMARY_WORDS]);
        assert!(!writes.is_empty());
        let words = writes.take();
        assert!(writes.is_empty() && writes.take().is_empty());
        let applied = |words: &[u32]| {
            let mut record = Record::default();
            apply(words, &mut record);
            record.0
        };
        let expected = vec![(WORDS, 4096, vec![1, 2, 3]), (SUMMARY, 5, vec![6; SUMMARY_WORDS])];
        assert_eq!(applied(&words), expected);
        assert_eq!(applied(&words[..words.len() - 1]), expected[..1], "what is incomplete is ignored");
    }
}
