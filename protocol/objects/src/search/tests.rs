//! Queries of made-up cities, and damaged indexes.

use super::*;
use insula_test_support::tier;
use proptest::prelude::*;

const NAMES: [&str; 24] = [
    "Oude Delft 123",
    "Oude Delft 12",
    "Oude Delft 1",
    "Nieuwe Delft",
    "Delft",
    "Delftechpark 3",
    "’s-Gravenhage",
    "IJsselkade 7",
    "Ĳsselmeer",
    "Coolsingel 40",
    "Müllerstraße 5",
    "Mullerpier",
    "Muellerhof",
    "Königsallee 1",
    "Am Großen Wannsee",
    "Boerhaaveplein",
    "東京都千代田区丸の内1丁目",
    "東京都千代田区丸の内2丁目",
    "東京都千代田区大手町1丁目",
    "東京都庁舎",
    "서울특별시 중구 세종대로 110",
    "Αθήνα",
    "NL.IMBAG.Pand.0503100000012345",
    "NL.IMBAG.Pand.0503100000012346",
];

fn index_of<'a>(texts: impl IntoIterator<Item = &'a str>) -> SearchIndex<Vec<u8>> {
    SearchIndex::open(bytes_of(texts)).unwrap()
}

fn bytes_of<'a>(texts: impl IntoIterator<Item = &'a str>) -> Vec<u8> {
    let mut builder = SearchIndexBuilder::new();
    for (object, text) in texts.into_iter().enumerate() {
        builder.add(text, object as u32);
    }
    builder.finish().unwrap()
}

fn found(index: &SearchIndex<Vec<u8>>, query: &str, limit: usize) -> Vec<String> {
    index.search(query, limit).into_iter().map(|hit| hit.text).collect()
}

#[test]
fn people_find_names_by_what_they_type() {
    let index = index_of(NAMES);
    for (query, wanted) in [
        ("delft", &["Delft", "Delftechpark 3", "Oude Delft 1", "Nieuwe Delft", "Oude Delft 12", "Oude Delft 123"][..]),
        ("oude delft", &["Oude Delft 1", "Oude Delft 12", "Oude Delft 123"]),
        ("delft oude 12", &["Oude Delft 12", "Oude Delft 123"]),
        ("OUDE DELFT 123", &["Oude Delft 123"]),
        ("gravenhage", &["’s-Gravenhage"]),
        ("'s gravenh", &["’s-Gravenhage"]),
        ("ijssel", &["Ĳsselmeer", "IJsselkade 7"]),
        ("müller", &["Mullerpier", "Muellerhof", "Müllerstraße 5"]),
        ("muller", &["Mullerpier", "Müllerstraße 5"]),
        ("mueller", &["Muellerhof", "Müllerstraße 5"]),
        ("muellerstrasse 5", &["Müllerstraße 5"]),
        ("koenigsallee", &["Königsallee 1"]),
        ("grossen", &["Am Großen Wannsee"]),
        ("boer", &["Boerhaaveplein"]),
        ("丸の内", &["東京都千代田区丸の内1丁目", "東京都千代田区丸の内2丁目"]),
        ("丸の内2", &["東京都千代田区丸の内2丁目"]),
        ("千代田区丸の内１丁目", &["東京都千代田区丸の内1丁目"]),
        ("千代田 大手町", &["東京都千代田区大手町1丁目"]),
        ("都庁", &["東京都庁舎"]),
        ("東京都庁", &["東京都庁舎"]),
        ("特別", &[]),
        ("특별", &["서울특별시 중구 세종대로 110"]),
        ("세종 110", &["서울특별시 중구 세종대로 110"]),
        ("ΑΘΗΝΑ", &["Αθήνα"]),
        ("0503100000012346", &["NL.IMBAG.Pand.0503100000012346"]),
    ] {
        // A limit at the number of hits, so that no typos are looked for.
        assert_eq!(found(&index, query, wanted.len().max(1)), wanted, "{query}");
    }
}

#[test]
fn one_typo_is_found_after_exact_hits() {
    let index = index_of(NAMES);
    let first = |query: &str| index.search(query, 10).first().map(|hit| (hit.text.clone(), hit.typos));
    for (query, text, typos) in [
        ("cooolsingel", "Coolsingel 40", 1),
        ("colsingel", "Coolsingel 40", 1),
        ("coolsignel", "Coolsingel 40", 1),
        ("xoolsingel", "Coolsingel 40", 1),
        ("oolsingel", "Coolsingel 40", 1),
        ("ocolsingel 40", "Coolsingel 40", 1),
        ("odue deflt 123", "Oude Delft 123", 2),
        ("mullerstrase", "Müllerstraße 5", 1),
        ("東京都千代多区丸の内1丁目", "東京都千代田区丸の内1丁目", 1),
        ("丸の肉1丁目", "東京都千代田区丸の内1丁目", 1),
        ("αθηνς", "Αθήνα", 1),
        ("delft", "Delft", 0),
    ] {
        assert_eq!(first(query), Some((text.to_owned(), typos)), "{query}");
    }
    assert_eq!(first("colsignel"), None, "two typos in a word");
    assert_eq!(first("dlf"), None, "no typo in three characters");
    let index = index_of(["Hofplein", "Hofpleim", "Hofpleiq 1"]);
    assert_eq!(found(&index, "hofpleim", 1), ["Hofpleim"]);
    assert_eq!(found(&index, "hofpleim", 9), ["Hofpleim", "Hofplein", "Hofpleiq 1"]);
}

#[test]
fn hits_are_in_order_of_their_rank() {
    let texts = ["Zeil 2", "An der Zeil", "Zeilweg", "Alte Zeil", "zeil", "Zeil", "Zeil 10"];
    let index = index_of(texts);
    let order: Vec<u32> = index.search("zeil", 100).iter().map(|hit| hit.object).collect();
    assert_eq!(order, [4, 5, 0, 6, 2, 3, 1]);
    assert_eq!(found(&index, "zeil", 3), ["zeil", "Zeil", "Zeil 2"]);
}

#[test]
fn objects_share_texts_and_have_several() {
    let mut builder = SearchIndexBuilder::default();
    for (text, object) in [("Schuur", 7), ("Schuur", 3), ("Schuur", 3), ("Kerk", 3), ("!?", 9), ("", 9)] {
        builder.add(text, object);
    }
    let index = SearchIndex::open(builder.finish().unwrap()).unwrap();
    assert_eq!((index.len(), index.is_empty()), (3, false));
    let hit = |text: &str, object| SearchHit { text: text.to_owned(), object, typos: 0 };
    assert_eq!(index.search("schuur", 10), [hit("Schuur", 3), hit("Schuur", 7)]);
    assert_eq!(index.search("kerk", 10), [hit("Kerk", 3)]);
}

#[test]
fn odd_queries_and_limits_are_answered() {
    let index = index_of(NAMES);
    let long = "delft ".repeat(1000);
    for query in
        ["", " ", "-", "'", "\u{301}", "\0", "\u{202e}", "𠀀", &"x".repeat(10_000), &"ü".repeat(500), &"oe".repeat(90)]
    {
        assert_eq!(found(&index, query, 10), Vec::<String>::new(), "{query}");
    }
    assert_eq!(found(&index, &long, 10).len(), 6);
    assert_eq!(found(&index, "delft", 0).len(), 0);
    let many: Vec<String> = (0..3000).map(|i| format!("Laan {i}")).collect();
    let index = index_of(many.iter().map(String::as_str));
    assert_eq!(index.search("laan", usize::MAX).len(), MAX_HITS);
    assert_eq!(found(&index, "2999", 1), ["Laan 2999"]);
    let empty = index_of([]);
    assert!(empty.is_empty() && empty.search("a", 10).is_empty());
}

#[test]
fn long_texts_are_cut_between_characters() {
    let long = format!("x{}", "é".repeat(200));
    let index = index_of([long.as_str(), &"ﷺ".repeat(100)]);
    let hits = index.search("xeee", 10);
    assert_eq!(hits[0].text.len(), 255);
    assert_eq!(index.search(&"ﷺ".repeat(5), 10).len(), 1);
    assert_eq!(index.search(&hits[0].text, 10).len(), 1);
}

#[test]
fn the_order_of_texts_does_not_change_the_bytes() {
    let mut builder = SearchIndexBuilder::new();
    NAMES.iter().enumerate().rev().chain([(0, &NAMES[0])]).for_each(|(object, text)| builder.add(text, object as u32));
    assert_eq!(builder.finish().unwrap(), bytes_of(NAMES));
}

/// Writes the right checksum of changed bytes, as an attacker would.
fn seal(bytes: &mut [u8]) {
    let end = bytes.len() - 4;
    let checksum = insula_protocol::codec::checksum(&bytes[..end]);
    bytes[end..].copy_from_slice(&checksum.to_le_bytes());
}

fn query_all(bytes: &[u8]) {
    let Ok(index) = SearchIndex::open(bytes) else { return };
    for query in ["d", "delft", "oude dleft 12", "muellerstrase", "丸の内1", "千代多区丸の", "0503", "특"] {
        for hit in index.search(query, 20) {
            assert!(hit.text.len() <= MAX_TEXT_BYTES);
        }
    }
}

#[test]
fn truncated_and_damaged_bytes_are_refused() {
    let bytes = bytes_of(NAMES);
    for length in 0..bytes.len() {
        assert!(SearchIndex::open(&bytes[..length]).is_err(), "{length}");
    }
    assert!(SearchIndex::open([&bytes[..], &[0]].concat()).is_err());
    for at in 0..bytes.len() * 8 {
        let mut bytes = bytes.clone();
        bytes[at / 8] ^= 1 << (at % 8);
        assert!(SearchIndex::open(&bytes).is_err(), "bit {at}");
    }
}

#[test]
fn hostile_bytes_with_a_valid_checksum_do_no_harm() {
    let bytes = bytes_of(NAMES);
    let changes = [1, 0x10, 0x40, 0x80, 0xff];
    // A smaller step than there are changes, so that every byte has one, and they take turns.
    let step = if tier::is_full() { 1 } else { changes.len() - 1 };
    for i in (0..(bytes.len() - 4) * changes.len()).step_by(step) {
        let mut bytes = bytes.clone();
        bytes[i / changes.len()] ^= changes[i % changes.len()];
        seal(&mut bytes);
        query_all(&bytes);
    }
    let mut huge = bytes.clone();
    huge[8..12].fill(0xff);
    seal(&mut huge);
    assert!(matches!(SearchIndex::open(&huge), Err(SearchError::Limit { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(tier::cases()))]

    #[test]
    fn several_changes_with_a_valid_checksum_do_no_harm(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
    ) {
        let mut bytes = bytes_of(NAMES);
        for (at, byte) in changes {
            let at = at.index(bytes.len() - 4);
            bytes[at] = byte;
        }
        seal(&mut bytes);
        query_all(&bytes);
    }

    /// The index finds what a comparison of all texts finds.
    #[test]
    fn the_index_finds_all_texts_that_match(
        texts in proptest::collection::vec("[abéü丸の1 -]{0,8}", 1..40),
        query in "[abeü丸の1 ]{1,6}",
    ) {
        let index = index_of(texts.iter().map(String::as_str));
        let query_folded = query::Query::new(&query);
        let mut wanted: Vec<u32> = Vec::new();
        for (object, text) in texts.iter().enumerate() {
            let mut glyphs = Vec::new();
            fold::fold(text.trim(), &mut glyphs);
            if !query_folded.words.is_empty() && !glyphs.is_empty() && query_folded.rank(&glyphs, false).is_some() {
                wanted.push(object as u32);
            }
        }
        let hits = index.search(&query, MAX_HITS);
        let mut exact: Vec<u32> = hits.iter().filter(|hit| hit.typos == 0).map(|hit| hit.object).collect();
        exact.sort_unstable();
        prop_assert_eq!(exact, wanted);
    }

    /// Words with one typo are found, whatever the typo is.
    #[test]
    fn the_index_finds_typos(word in "[a-e]{5,9}", at in 0usize..9, kind in 0u8..4, c in "[a-e]") {
        let index = index_of([word.as_str(), "zzz", "Zaal 3"]);
        let mut typed: Vec<char> = word.chars().collect();
        let at = at.min(typed.len() - 2);
        match kind {
            0 => typed[at] = c.chars().next().unwrap_or('a'),
            1 => typed.insert(at, c.chars().next().unwrap_or('a')),
            2 => drop(typed.remove(at)),
            _ => typed.swap(at, at + 1),
        }
        let typed: String = typed.into_iter().collect();
        prop_assert_eq!(found(&index, &typed, 10), [word]);
    }
}
