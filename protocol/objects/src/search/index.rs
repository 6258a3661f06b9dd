//! Opens an index and answers queries.

use super::candidates::Candidates;
use super::fold::{fold, weak_string};
use super::layout::Layout;
use super::query::{Query, Rank};
use super::table::{BLOCK, TableReader};
use super::words::{self, Words};
use super::{MAX_HITS, SearchError};
use insula_protocol::manifest::CityMarks;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;

/// A text that a query found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SearchHit {
    /// The text as it was added, at most [`MAX_TEXT_BYTES`](super::MAX_TEXT_BYTES) bytes. From untrusted bytes it may be any text.
    pub text: String,
    /// The object that it was added for. From untrusted bytes it may be any number.
    pub object: u32,
    pub typos: u8,
}

/// What one pass of a query may do.
#[derive(Clone, Copy)]
struct Budget {
    /// Words may have a typo.
    typos: bool,
    /// Bytes of lists that are read.
    list_bytes: u64,
    /// Texts that are compared.
    texts: usize,
}

/// The texts with the words as typed.
const EXACT: Budget = Budget { typos: false, list_bytes: 128 << 10, texts: 2048 };

/// Those with typos are more, and wanted only where the query has few others.
const WITH_TYPOS: Budget = Budget { typos: true, list_bytes: 512 << 10, texts: 2048 };

/// An opened index. `D` holds its bytes: a vector, a slice, a mapped file.
pub struct SearchIndex<D> {
    data: D,
    layout: Layout,
}

impl<D> fmt::Debug for SearchIndex<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SearchIndex").field("layout", &self.layout).finish_non_exhaustive()
    }
}

impl<D: AsRef<[u8]>> SearchIndex<D> {
    /// Opens an index. Reads all its bytes once, for the checksum. `data` must return the same bytes each time.
    ///
    /// # Errors
    /// Fails if the bytes are not an index of the version that this program reads, are damaged or are too many or too few.
    pub fn open(data: D) -> Result<Self, SearchError> {
        let layout = Layout::decode(data.as_ref())?;
        words::check(&data.as_ref()[layout.dictionary.clone()])?;
        Ok(Self { data, layout })
    }

    /// Opens the index of a city whose manifest has these marks. Cities of earlier bakes have none, and any index.
    ///
    /// # Errors
    /// Fails as [`Self::open`], or if the index is of another bake.
    pub fn of_city(data: D, marks: Option<CityMarks>) -> Result<Self, SearchError> {
        let index = Self::open(data)?;
        match marks {
            Some(marks) if marks.search_index != Some(index.checksum()) => Err(SearchError::OtherBake),
            _ => Ok(index),
        }
    }

    /// Checksum of all texts and objects.
    pub fn checksum(&self) -> u32 {
        self.data.as_ref().last_chunk::<4>().map_or(0, |bytes| u32::from_le_bytes(*bytes))
    }

    /// Pairs of a text and an object.
    pub fn len(&self) -> usize {
        self.layout.entries as usize
    }

    /// Length of the index in bytes, which are all in memory or all mapped.
    pub fn byte_len(&self) -> usize {
        self.data.as_ref().len()
    }

    /// Whether there are no texts.
    pub fn is_empty(&self) -> bool {
        self.layout.entries == 0
    }

    fn section(&self, range: &Range<usize>) -> &[u8] {
        self.data.as_ref().get(range.clone()).unwrap_or_default()
    }

    fn table(&self) -> TableReader<'_> {
        TableReader::new(self.section(&self.layout.blocks), self.section(&self.layout.texts))
    }

    /// The best hits of `query`, at most `limit` and at most [`MAX_HITS`]. The query counts to its 128th character.
    ///
    /// In order: fewer typos; the whole text, first with the same diacritics; the first word of the text as a whole; earlier
    /// words; shorter texts; lower numbers of objects. An object has one hit per text. The same query has the same hits.
    pub fn search(&self, query: &str, limit: usize) -> Vec<SearchHit> {
        let limit = limit.min(MAX_HITS);
        let query = Query::new(query);
        let lists = self.section(&self.layout.lists);
        let words = match Words::new(self.section(&self.layout.dictionary), lists.len()) {
            Some(words) if limit > 0 && !query.words.is_empty() => words,
            _ => return Vec::new(),
        };
        let mut found = self.pass(&query, &words, EXACT);
        if found.len() < limit && query.may_have_typo() {
            found.extend(self.pass(&query, &words, WITH_TYPOS));
        }
        found.sort_unstable();
        // Both passes find the texts without typos, with the same rank.
        found.dedup();
        found.truncate(limit);
        let mut table = self.table();
        let hit = |(rank, object, entry): (Rank, u32, u32)| {
            Some(SearchHit { text: table.text(entry)?.to_owned(), object, typos: rank.typos })
        };
        found.into_iter().filter_map(hit).collect()
    }

    /// The entries that match, with their ranks and objects.
    fn pass(&self, query: &Query, words: &Words<'_>, budget: Budget) -> Vec<(Rank, u32, u32)> {
        let lists = self.section(&self.layout.lists);
        let reader = Candidates { lists, entries: self.layout.entries, left: budget.list_bytes };
        let Some(candidates) = reader.find(query, words, budget.typos) else { return Vec::new() };
        let mut found = Vec::new();
        let (mut table, mut glyphs) = (self.table(), Vec::new());
        let entries = self.layout.entries;
        let first = self.blocks_with_start(&query.words[0].weak);
        let order = [first.clone(), 0..first.start, first.end..entries];
        for entry in order.into_iter().flat_map(|range| candidates.iter(range)).take(budget.texts) {
            let Some(text) = table.text(entry) else { continue };
            fold(text, &mut glyphs);
            if let Some(rank) = query.rank(&glyphs, budget.typos) {
                found.push((rank, self.layout.object(self.data.as_ref(), entry), entry));
            }
        }
        found
    }

    /// The blocks that may have texts whose folded form starts with `prefix`, as a range of entries.
    fn blocks_with_start(&self, prefix: &str) -> Range<u32> {
        let (mut table, mut glyphs) = (self.table(), Vec::new());
        let mut blocks_before = |is_before: &dyn Fn(&str) -> bool| {
            let (mut low, mut high) = (0, self.layout.entries.div_ceil(BLOCK));
            while low < high {
                let middle = low + (high - low) / 2;
                fold(table.text(middle * BLOCK).unwrap_or_default(), &mut glyphs);
                if is_before(&weak_string(glyphs.iter().copied())) { low = middle + 1 } else { high = middle }
            }
            low
        };
        let start = blocks_before(&|head| head < prefix).saturating_sub(1);
        // False bytes may have any order.
        let end = blocks_before(&|head| head < prefix || head.starts_with(prefix)).max(start);
        start * BLOCK..(end * BLOCK).min(self.layout.entries)
    }
}
