//! Search of objects by their texts: names, addresses, identifiers.
//!
//! The bake writes one string of bytes: it sorts [`SearchEntry`] values, of which [`SearchTextWriter`] writes the texts and tells
//! the words, sorts these, and passes them to [`SearchWordWriter`], so that its memory does not follow the number of texts.
//! [`SearchIndexBuilder`] does the same in memory. The server and a viewer read the bytes into memory in one piece, at the first
//! search, and open them with [`SearchIndex`].
//!
//! # What is found
//!
//! A text is found if each word of the query is the start of a word of the text, in any order. Texts of Han, Hiragana,
//! Katakana and Hangul have no spaces, so there a match may start at each character. Words are what other characters than
//! letters, digits and marks separate.
//!
//! Case and compatibility forms do not matter (NFKC), nor do diacritics: `Muller` and `Mueller` find `Müller`, `strasse`
//! finds `Straße`, `ijssel` finds `Ĳssel`. `oe` in a query matches `ö` and `oe`, not `o`.
//!
//! If a query has fewer hits than its limit, words of four characters or more may have one typo: a character too many, one
//! missing, one wrong, or two swapped.
//!
//! # Size and speed
//!
//! The index keeps the texts as they were added, in order, each as its difference from the one before it. A dictionary (`fst`)
//! has the words, and for each word the runs of texts with it. Neighbours in the order share words, so a street is one run.
//! With made-up names, 1.7 million addresses take 7.4 bytes each, 9.3 with post codes and towns behind them, and a query takes
//! 0.3 ms, 1.5 ms at the 99th percentile. Identifiers of one word take 14 bytes: each is a word.
//!
//! Work per query is bounded: a query reads at most a fixed number of bytes of lists and compares at most a fixed number of
//! texts. A query that matches more, such as one letter, ranks only those that it compares. It takes texts that start with the
//! first word of the query before others, and otherwise the first in order of texts. A query of nothing but frequent words
//! that are seldom next to each other, such as one character of CJK and a digit, may then miss texts.
//!
//! # Damaged and hostile bytes
//!
//! [`SearchIndex::open`] checks the lengths, a checksum and each node of the dictionary. A checksum alone would not do, because
//! whoever makes up an index can compute it, and `fst` panics on false addresses. Everything else is checked where it is read:
//! false texts and lists give false hits or none.

mod build;
mod candidates;
mod fold;
mod index;
mod layout;
mod postings;
mod query;
mod table;
#[cfg(test)]
mod tests;
mod unicode;
mod words;

pub use build::{
    SearchEntry, SearchIndexBuilder, SearchTextWriter, SearchWordWriter, WordRun, WrittenTexts, WrittenWords,
    write_index,
};
pub use index::{SearchHit, SearchIndex};

/// Longest text in bytes. Longer ones are cut.
pub const MAX_TEXT_BYTES: usize = 256;

/// Longest query in characters. What follows is ignored.
pub const MAX_QUERY_CHARS: usize = 128;

/// Most hits of one query.
pub const MAX_HITS: usize = 1000;

/// Most pairs of a text and an object in one index.
pub const MAX_ENTRIES: u32 = 1 << 26;

/// Why bytes are no index, or an index cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SearchError {
    #[error("not a search index: the magic bytes are missing")]
    Magic,
    #[error("search index of version {found}, this program reads {known}: bake again, or update")]
    Version { found: u16, known: u16 },
    /// The bytes are not as many as the header announces.
    #[error("search index of {wanted} bytes, {found} found: fetch it again")]
    Length { wanted: u64, found: u64 },
    #[error("checksum of the search index differs: the bytes are damaged, fetch them again")]
    Checksum,
    /// A number exceeds a limit of the format.
    #[error("{what} of a search index: {found}, the limit is {limit}")]
    Limit { what: &'static str, found: u64, limit: u64 },
    /// The index and the manifest are of different bakes.
    #[error("search index of another bake than city.json: copy all files of the city again, or bake it again")]
    OtherBake,
    /// A rule of the format is broken. The text says which.
    #[error("search index: {0}")]
    Invalid(&'static str),
}

/// Why an index is not written.
#[derive(Debug, thiserror::Error)]
pub enum SearchWriteError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The texts exceed a limit of the format.
    #[error(transparent)]
    Index(#[from] SearchError),
}
