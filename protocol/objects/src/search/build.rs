//! Builds an index in memory.

use std::collections::BTreeMap;

use super::fold::{cut, fold, tokens, weak_string};
use super::layout::Sections;
use super::postings::ListBuilder;
use super::table::TableBuilder;
use super::{MAX_ENTRIES, MAX_TEXT_BYTES, SearchError, words};

/// A pair of a text and an object. The texts are in the builder.
#[derive(Debug, Clone, Copy)]
struct Entry {
    text: u32,
    text_bytes: u16,
    folded_bytes: u16,
    folded: u32,
    object: u32,
}

/// Collects texts of objects and writes the index of them.
///
/// It holds each text twice, as added and folded, and 16 bytes more, until [`finish`](Self::finish).
#[derive(Debug, Default)]
pub struct SearchIndexBuilder {
    entries: Vec<Entry>,
    texts: String,
    folded: String,
}

impl SearchIndexBuilder {
    /// An index without texts.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a text of an object: a name, an address, an identifier. Texts are cut at [`MAX_TEXT_BYTES`] bytes, between
    /// characters. An object may have several texts, and objects may have the same one. A text without a letter or a digit
    /// cannot be found, and is left out. So is a pair that was added before.
    pub fn add(&mut self, text: &str, object: u32) {
        let text = cut(text.trim(), MAX_TEXT_BYTES);
        let mut glyphs = Vec::new();
        fold(text, &mut glyphs);
        if glyphs.is_empty() {
            return;
        }
        let folded = weak_string(glyphs);
        // Offsets that do not fit are an error of `finish`.
        self.entries.push(Entry {
            text: self.texts.len() as u32,
            text_bytes: text.len() as u16,
            folded_bytes: folded.len() as u16,
            folded: self.folded.len() as u32,
            object,
        });
        self.texts.push_str(text);
        self.folded.push_str(&folded);
    }

    fn text(&self, entry: &Entry) -> &str {
        &self.texts[entry.text as usize..][..usize::from(entry.text_bytes)]
    }

    fn folded(&self, entry: &Entry) -> &str {
        &self.folded[entry.folded as usize..][..usize::from(entry.folded_bytes)]
    }

    /// Writes the index. The same texts and objects, in any order, give the same bytes.
    ///
    /// # Errors
    /// [`SearchError::Limit`] if there are more than [`MAX_ENTRIES`] pairs, or 4 GiB of texts or of a section of the index.
    pub fn finish(mut self) -> Result<Vec<u8>, SearchError> {
        let bytes = self.texts.len().max(self.folded.len()) as u64;
        for (what, found, limit) in [
            ("entries", self.entries.len() as u64, u64::from(MAX_ENTRIES)),
            ("bytes of texts", bytes, u64::from(u32::MAX)),
        ] {
            if found > limit {
                return Err(SearchError::Limit { what, found, limit });
            }
        }
        let mut entries = std::mem::take(&mut self.entries);
        let key = |entry: &Entry| (self.folded(entry), self.text(entry), entry.object);
        entries.sort_unstable_by(|a, b| key(a).cmp(&key(b)));
        entries.dedup_by(|a, b| key(a) == key(b));

        let mut table = TableBuilder::default();
        // Ordered, so that the bytes do not depend on a hash.
        let mut lists: BTreeMap<Box<str>, ListBuilder> = BTreeMap::new();
        let mut before = "";
        for (number, entry) in entries.iter().enumerate() {
            let text = self.text(entry);
            table.push(before, text);
            before = text;
            for token in tokens(self.folded(entry)) {
                match lists.get_mut(token.text) {
                    Some(list) => list.push(number as u32),
                    None => lists.entry(token.text.into()).or_default().push(number as u32),
                }
            }
        }
        let objects = entries.iter().map(|entry| entry.object).collect();
        drop(entries);
        self.texts = String::new();
        self.folded = String::new();
        let mut bytes = Vec::new();
        let starts = lists.into_iter().map(|(token, list)| {
            let start = bytes.len() as u64;
            list.finish(&mut bytes);
            (token.into_string(), start)
        });
        let dictionary = words::build(starts).map_err(|_| SearchError::Invalid("the dictionary cannot be written"))?;
        Sections { objects, blocks: table.blocks, texts: table.bytes, dictionary, lists: bytes }.encode()
    }
}
