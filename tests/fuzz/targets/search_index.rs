//! Search indexes with a right checksum: queries of changed bytes, and of an index of the input.
#![no_main]

use insula_objects::search::{MAX_HITS, MAX_TEXT_BYTES, SearchIndex, SearchIndexBuilder};
use libfuzzer_sys::fuzz_target;

/// Bytes of the checksum at the end of an index.
const CHECKSUM: usize = 4;

fn query_all(index: &SearchIndex<&[u8]>, queries: &[&str]) {
    for query in queries {
        let hits = index.search(query, 50);
        assert!(hits.len() <= 50 && hits.iter().all(|hit| hit.text.len() <= MAX_TEXT_BYTES));
        assert_eq!(hits, index.search(query, 50));
    }
}

/// Lines of the input are texts. Each must be found by itself.
fn build(text: &str) {
    let lines: Vec<&str> = text.lines().take(64).collect();
    let mut builder = SearchIndexBuilder::new();
    lines.iter().zip(0..).for_each(|(line, object)| builder.add(line, object));
    let bytes = builder.finish().expect("a small index");
    let index = SearchIndex::open(&bytes[..]).expect("what was built opens");
    for (line, object) in lines.iter().zip(0..) {
        let hits = index.search(line, MAX_HITS);
        // Longer lines are cut as texts and as queries at different characters.
        let is_whole = line.len() <= 128;
        let has_word = line.chars().any(|c| c.is_ascii_alphanumeric());
        assert!(!is_whole || !has_word || hits.iter().any(|hit| hit.object == object), "{line:?}");
    }
    query_all(&index, &lines);
}

fuzz_target!(|input: &[u8]| {
    if let Ok(index) = SearchIndex::open(input) {
        query_all(&index, &["a"]);
    }
    if let Ok(text) = std::str::from_utf8(input) {
        build(text);
    }
    if let Some(end) = input.len().checked_sub(CHECKSUM) {
        let mut bytes = input.to_vec();
        let checksum = insula_protocol::codec::checksum(&bytes[..end]);
        bytes[end..].copy_from_slice(&checksum.to_le_bytes());
        if let Ok(index) = SearchIndex::open(&bytes[..]) {
            query_all(&index, &["d", "delft", "oude dleft 12", "muellerstrase 5", "丸の内1", "千代多区丸の内"]);
        }
    }
});
