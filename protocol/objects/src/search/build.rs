//! Writes an index.
//!
//! Entries come in order, and so do then their words: an entry is a pair of a text and an object, and a word has runs of entries. Each
//! section is written to a file of its own, because the header, which has their lengths, comes first.

use super::fold::{cut, fold, tokens, weak_string};
use super::layout::{Section, Sections};
use super::postings::ListBuilder;
use super::table::TableBuilder;
use super::{MAX_ENTRIES, MAX_TEXT_BYTES, SearchError, SearchWriteError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{BufWriter, Cursor, Read, Seek, Write};

/// A text of an object. The order is that of an index.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SearchEntry {
    folded: String,
    text: String,
    object: u32,
}

impl SearchEntry {
    /// A text of an object: a name, an address, an identifier. Texts are cut at [`MAX_TEXT_BYTES`] bytes, between characters.
    /// `None` for a text without a letter or a digit, which cannot be found.
    pub fn new(text: &str, object: u32) -> Option<Self> {
        let text = cut(text.trim(), MAX_TEXT_BYTES);
        let mut glyphs = Vec::new();
        fold(text, &mut glyphs);
        (!glyphs.is_empty()).then(|| Self { folded: weak_string(glyphs), text: text.to_owned(), object })
    }
}

/// A word, and consecutive entries that have it. The order is that of an index.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct WordRun {
    word: String,
    start: u32,
    length: u32,
}

/// Writes the texts of an index. Each of its two files is at its start.
#[derive(Debug)]
pub struct SearchTextWriter<F: Write> {
    texts: BufWriter<F>,
    objects: BufWriter<F>,
    table: TableBuilder,
    entries: u32,
    max_object: u32,
    before: Option<SearchEntry>,
    /// Start of the run that the last entry ends, of each of its words.
    open: BTreeMap<String, u32>,
}

/// The texts of an index, and what follows from them.
#[derive(Debug)]
pub struct WrittenTexts<F> {
    texts: F,
    objects: F,
    blocks: Vec<u64>,
    texts_bytes: u64,
    entries: u32,
    max_object: u32,
}

impl<F: Write> SearchTextWriter<F> {
    /// An index without texts, for whose texts and objects there are two empty files.
    pub fn new(texts: F, objects: F) -> Self {
        Self {
            texts: BufWriter::new(texts),
            objects: BufWriter::new(objects),
            table: TableBuilder::default(),
            entries: 0,
            max_object: 0,
            before: None,
            open: BTreeMap::new(),
        }
    }

    /// Adds an entry and returns the runs of words that end before it. Entries come in ascending order; one that was added before
    /// is left out.
    ///
    /// # Errors
    /// [`SearchError::Limit`] if there are more than [`MAX_ENTRIES`], or the error of a file.
    pub fn add(&mut self, entry: SearchEntry) -> Result<Vec<WordRun>, SearchWriteError> {
        if self.before.as_ref() == Some(&entry) {
            return Ok(Vec::new());
        }
        if self.entries == MAX_ENTRIES {
            let found = u64::from(MAX_ENTRIES) + 1;
            return Err(SearchError::Limit { what: "entries", found, limit: MAX_ENTRIES.into() }.into());
        }
        self.table.push(self.before.as_ref().map_or("", |before| &before.text), &entry.text);
        self.table.write_to(&mut self.texts)?;
        self.objects.write_all(&entry.object.to_le_bytes())?;
        let mut ended = std::mem::take(&mut self.open);
        for token in tokens(&entry.folded) {
            if !self.open.contains_key(token.text) {
                let (word, start) =
                    ended.remove_entry(token.text).unwrap_or_else(|| (token.text.to_owned(), self.entries));
                self.open.insert(word, start);
            }
        }
        let runs = runs(ended, self.entries);
        self.entries += 1;
        self.max_object = self.max_object.max(entry.object);
        self.before = Some(entry);
        Ok(runs)
    }

    /// Ends the texts, and returns the runs that are left.
    ///
    /// # Errors
    /// The error of a file.
    pub fn finish(mut self) -> Result<(WrittenTexts<F>, Vec<WordRun>), SearchWriteError> {
        let runs = runs(std::mem::take(&mut self.open), self.entries);
        let texts_bytes = self.table.length();
        let [texts, objects] = [self.texts, self.objects].map(into_file);
        let (entries, max_object, blocks) = (self.entries, self.max_object, self.table.blocks);
        Ok((WrittenTexts { texts: texts?, objects: objects?, blocks, texts_bytes, entries, max_object }, runs))
    }
}

impl<F> WrittenTexts<F> {
    /// Whether there are no texts.
    pub fn is_empty(&self) -> bool {
        self.entries == 0
    }
}

/// Runs that end before entry `end`.
fn runs(starts: BTreeMap<String, u32>, end: u32) -> Vec<WordRun> {
    starts.into_iter().map(|(word, start)| WordRun { word, start, length: end - start }).collect()
}

fn into_file<F: Write>(writer: BufWriter<F>) -> std::io::Result<F> {
    writer.into_inner().map_err(std::io::IntoInnerError::into_error)
}

/// Writes the dictionary of an index, and the list of each word. Each of its two files is at its start.
pub struct SearchWordWriter<F: Write> {
    dictionary: fst::raw::Builder<BufWriter<F>>,
    lists: BufWriter<F>,
    lists_bytes: u64,
    word: Option<(String, ListBuilder)>,
}

/// The dictionary of an index, and the lists of its words.
#[derive(Debug)]
pub struct WrittenWords<F> {
    dictionary: F,
    dictionary_bytes: u64,
    lists: F,
    lists_bytes: u64,
}

impl<F: Write> SearchWordWriter<F> {
    /// A dictionary without words, for which there are two empty files.
    ///
    /// # Errors
    /// The error of a file.
    pub fn new(dictionary: F, lists: F) -> Result<Self, SearchWriteError> {
        let dictionary = fst::raw::Builder::new(BufWriter::new(dictionary)).map_err(fst_error)?;
        Ok(Self { dictionary, lists: BufWriter::new(lists), lists_bytes: 0, word: None })
    }

    /// Adds a run. All runs come in ascending order.
    ///
    /// # Errors
    /// The error of a file.
    pub fn add(&mut self, run: WordRun) -> Result<(), SearchWriteError> {
        let WordRun { word, start, length } = run;
        match &mut self.word {
            Some((known, list)) if *known == word => list.push(start, length),
            _ => {
                self.end_word()?;
                let mut list = ListBuilder::default();
                list.push(start, length);
                self.word = Some((word, list));
            }
        }
        Ok(())
    }

    fn end_word(&mut self) -> Result<(), SearchWriteError> {
        let Some((word, list)) = self.word.take() else { return Ok(()) };
        self.dictionary.insert(word, self.lists_bytes).map_err(fst_error)?;
        let mut bytes = Vec::new();
        list.finish(&mut bytes);
        self.lists.write_all(&bytes)?;
        self.lists_bytes += bytes.len() as u64;
        Ok(())
    }
}

impl<F: Write + Seek> SearchWordWriter<F> {
    /// Ends the dictionary.
    ///
    /// # Errors
    /// The error of a file.
    pub fn finish(mut self) -> Result<WrittenWords<F>, SearchWriteError> {
        self.end_word()?;
        let mut dictionary = into_file(self.dictionary.into_inner().map_err(fst_error)?)?;
        let dictionary_bytes = dictionary.stream_position()?;
        Ok(WrittenWords { dictionary, dictionary_bytes, lists: into_file(self.lists)?, lists_bytes: self.lists_bytes })
    }
}

fn fst_error(error: fst::Error) -> SearchWriteError {
    match error {
        fst::Error::Io(error) => error.into(),
        fst::Error::Fst(_) => SearchError::Invalid("the dictionary cannot be written").into(),
    }
}

/// Writes the index of texts and their words, unless it has more than `max_bytes`. Returns its size. The same texts and objects give
/// the same bytes.
///
/// # Errors
/// [`SearchError::Limit`] if the index is larger, or has 4 GiB of a section; or the error of a file.
pub fn write_index<F: Read + Seek>(
    texts: &mut WrittenTexts<F>,
    words: &mut WrittenWords<F>,
    max_bytes: u64,
    out: &mut dyn Write,
) -> Result<u64, SearchWriteError> {
    for file in [&mut texts.texts, &mut texts.objects, &mut words.dictionary, &mut words.lists] {
        file.rewind()?;
    }
    let sections = Sections {
        entries: texts.entries,
        max_object: texts.max_object,
        objects: &mut texts.objects,
        blocks: &texts.blocks,
        texts: Section { bytes: &mut texts.texts, length: texts.texts_bytes },
        dictionary: Section { bytes: &mut words.dictionary, length: words.dictionary_bytes },
        lists: Section { bytes: &mut words.lists, length: words.lists_bytes },
    };
    let size = sections.size_bytes();
    if size > max_bytes {
        return Err(SearchError::Limit { what: "bytes", found: size, limit: max_bytes }.into());
    }
    sections.write(out)?;
    Ok(size)
}

/// Collects texts of objects in memory and writes the index of them.
///
/// It holds each text twice, as added and folded, until [`finish`](Self::finish), and then each word of each text.
#[derive(Debug, Default)]
pub struct SearchIndexBuilder {
    entries: Vec<SearchEntry>,
}

impl SearchIndexBuilder {
    /// An index without texts.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a text of an object, see [`SearchEntry::new`]. An object may have several texts, and objects may have the same one. A
    /// pair that was added before is left out.
    pub fn add(&mut self, text: &str, object: u32) {
        self.entries.extend(SearchEntry::new(text, object));
    }

    /// Writes the index. The same texts and objects, in any order, give the same bytes.
    ///
    /// # Errors
    /// [`SearchError::Limit`] if there are more than [`MAX_ENTRIES`] pairs, or 4 GiB of a section of the index.
    pub fn finish(self) -> Result<Vec<u8>, SearchError> {
        self.write().map_err(|error| match error {
            SearchWriteError::Index(error) => error,
            // Memory has no errors of files.
            SearchWriteError::Io(_) => SearchError::Invalid("its sections cannot be read"),
        })
    }

    fn write(mut self) -> Result<Vec<u8>, SearchWriteError> {
        self.entries.sort_unstable();
        let file = || Cursor::new(Vec::new());
        let (mut texts, mut runs) = (SearchTextWriter::new(file(), file()), Vec::new());
        for entry in self.entries {
            runs.extend(texts.add(entry)?);
        }
        let (mut texts, rest) = texts.finish()?;
        runs.extend(rest);
        runs.sort_unstable();
        let mut words = SearchWordWriter::new(file(), file())?;
        runs.into_iter().try_for_each(|run| words.add(run))?;
        let mut bytes = Vec::new();
        write_index(&mut texts, &mut words.finish()?, u64::MAX, &mut bytes)?;
        Ok(bytes)
    }
}
