//! Coding of a list of texts: identifiers, or the distinct values of a column.
//!
//! Three codings, of which the encoder takes the smallest: the part that differs from the text before; the numbers in texts of
//! equal pattern, such as `NL.IMBAG.Pand.0503100000012869` or `2010-10-13T12:43:04Z`; or the identifiers of the same rows.

use super::numbers::{self, Coded, History};
use super::{BLOCK_OBJECTS, cost};
use crate::value::MAX_TEXT_BYTES;
use insula_protocol::codec::byte_reader::ByteReader;
use insula_protocol::codec::varint::push64;
use insula_protocol::error::{DecodeError, invalid_if};
use std::collections::BTreeMap;

/// Maximum bytes of all decoded texts of a block.
const MAX_BLOCK_TEXT_BYTES: usize = 16 << 20;
/// Maximum number of patterns of one list.
const MAX_PATTERNS: usize = 64;
/// Maximum number of runs of digits in a pattern.
const MAX_RUNS: usize = 16;
/// Maximum digits of a run, so that its number fits into 64 bits. Longer runs are split.
const MAX_DIGITS: usize = 18;

const FRONT_CODED: u8 = 0;
const PATTERNS: u8 = 1;
const IDENTIFIERS: u8 = 2;

#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct TextList {
    text: String,
    ends: Vec<u32>,
}

impl TextList {
    pub(super) fn push(&mut self, text: &str) {
        self.text.push_str(text);
        self.ends.push(self.text.len() as u32);
    }

    pub(super) fn get(&self, index: usize) -> Option<&str> {
        let start = index.checked_sub(1).map_or(Some(0), |before| self.ends.get(before).copied())?;
        self.text.get(start as usize..*self.ends.get(index)? as usize)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        (0..self.ends.len()).filter_map(|index| self.get(index))
    }

    pub(super) fn from_texts<'a>(texts: impl IntoIterator<Item = &'a str>) -> Self {
        let mut list = Self::default();
        texts.into_iter().for_each(|text| list.push(text));
        list
    }
}

/// Bytes that decoded texts may still take. One per block, because a short payload can repeat long texts.
#[derive(Debug)]
pub(super) struct TextBudget(usize);

impl TextBudget {
    pub(super) fn new() -> Self {
        Self(MAX_BLOCK_TEXT_BYTES)
    }

    /// Takes the bytes of one text. Fails if it is too long, or if too few are left.
    pub(super) fn take(&mut self, bytes: usize) -> Result<(), DecodeError> {
        let limit = |what, limit: usize| DecodeError::Limit { what, found: bytes as u64, limit: limit as u64 };
        if bytes > MAX_TEXT_BYTES {
            return Err(limit("the bytes of a text", MAX_TEXT_BYTES));
        }
        self.0 = self.0.checked_sub(bytes).ok_or(limit("the bytes of all texts of a block", MAX_BLOCK_TEXT_BYTES))?;
        Ok(())
    }
}

/// What a list can refer to: columns of numbers, and the rows of its texts with the identifiers of the block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Context<'a> {
    pub(super) history: &'a History,
    /// The row of each text, if the list has one text for each of some rows.
    pub(super) rows: Option<&'a [u16]>,
    /// The identifier of each row of the block; `None` while they are coded themselves.
    pub(super) identifiers: Option<&'a TextList>,
}

/// Columns of numbers that a list leaves for later columns to refer to: rows and values.
pub(super) type Runs = Vec<(Vec<u16>, Vec<i64>)>;

/// Encodes at most [`BLOCK_OBJECTS`] texts.
pub(super) fn encode(texts: &[&str], context: Context<'_>) -> (Coded, Runs) {
    if let (Some(rows), Some(identifiers)) = (context.rows, context.identifiers)
        && rows.iter().zip(texts).all(|(row, text)| identifiers.get(usize::from(*row)) == Some(*text))
    {
        return (Coded { bytes: vec![IDENTIFIERS], cost: cost::bits(8) }, Runs::new());
    }
    let front_coded = encode_front(texts, context.history);
    let with_tag = |tag: u8, coded: Coded| Coded { bytes: [vec![tag], coded.bytes].concat(), cost: coded.cost };
    match encode_patterns(texts, context) {
        Some((patterns, runs)) if patterns.cost < front_coded.cost => (with_tag(PATTERNS, patterns), runs),
        _ => (with_tag(FRONT_CODED, front_coded), Runs::new()),
    }
}

/// Decodes `count` texts, at most [`BLOCK_OBJECTS`]. The inverse of [`encode`].
pub(super) fn decode(
    reader: &mut ByteReader<'_>,
    count: usize,
    context: Context<'_>,
    budget: &mut TextBudget,
) -> Result<(TextList, Runs), DecodeError> {
    match reader.u8()? {
        FRONT_CODED => Ok((decode_front(reader, count, context.history, budget)?, Runs::new())),
        PATTERNS => decode_patterns(reader, count, context, budget),
        IDENTIFIERS => {
            let mut list = TextList::default();
            let (rows, identifiers) = context.rows.zip(context.identifiers).ok_or(WRONG_REFERENCE)?;
            for row in rows {
                let text = identifiers.get(usize::from(*row)).ok_or(WRONG_REFERENCE)?;
                budget.take(text.len())?;
                list.push(text);
            }
            Ok((list, Runs::new()))
        }
        _ => Err(DecodeError::Invalid("a list of texts has an unknown coding")),
    }
}

const WRONG_REFERENCE: DecodeError = DecodeError::Invalid("a list of texts refers to identifiers that do not exist");
const NOT_UTF8: DecodeError = DecodeError::Invalid("a text is not UTF-8");

/// Lengths of the start shared with the text before, lengths of the rests, then the rests.
fn encode_front(texts: &[&str], history: &History) -> Coded {
    let mut before = "";
    let (mut shared, mut lengths, mut rests) = (Vec::new(), Vec::new(), Vec::new());
    for text in texts {
        let start = before.bytes().zip(text.bytes()).take_while(|(a, b)| a == b).count();
        let rest = text.as_bytes().get(start..).unwrap_or_default();
        shared.push(start as i64);
        lengths.push(rest.len() as i64);
        rests.extend_from_slice(rest);
        before = text;
    }
    let (shared, lengths) = (numbers::encode(&shared, None, history), numbers::encode(&lengths, None, history));
    let cost = shared.cost + lengths.cost + cost::of_text(&rests);
    Coded { bytes: [shared.bytes, lengths.bytes, rests].concat(), cost }
}

fn decode_front(
    reader: &mut ByteReader<'_>,
    count: usize,
    history: &History,
    budget: &mut TextBudget,
) -> Result<TextList, DecodeError> {
    let shared = numbers::decode(reader, count, None, history)?;
    let lengths = numbers::decode(reader, count, None, history)?;
    let mut list = TextList::default();
    let mut text = Vec::new();
    for (shared, length) in shared.into_iter().zip(lengths) {
        let (Ok(shared), Ok(length)) = (usize::try_from(shared), usize::try_from(length)) else {
            return Err(DecodeError::Invalid("a length is negative"));
        };
        invalid_if(shared > text.len(), "a text shares more than the text before it has")?;
        budget.take(shared.saturating_add(length))?;
        text.truncate(shared);
        text.extend_from_slice(reader.take(length)?);
        list.push(str::from_utf8(&text).map_err(|_| NOT_UTF8)?);
    }
    Ok(list)
}

/// The pattern of a text: every digit is replaced by 0.
fn pattern(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_digit() { '0' } else { c }).collect()
}

/// The runs of digits of a text, as ranges of bytes. All digits of a pattern are 0, so that a text and its pattern have equal runs.
fn runs(text: &str) -> Vec<std::ops::Range<usize>> {
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for (at, _) in text.bytes().enumerate().filter(|(_, byte)| byte.is_ascii_digit()) {
        match runs.last_mut() {
            Some(run) if run.end == at && run.len() < MAX_DIGITS => run.end = at + 1,
            _ => runs.push(at..at + 1),
        }
    }
    runs
}

/// The patterns, the pattern of each text, then for each run of digits the numbers of the texts that have it. `None` if there
/// are too many patterns or runs, or no digits.
fn encode_patterns(texts: &[&str], context: Context<'_>) -> Option<(Coded, Runs)> {
    let mut patterns: Vec<String> = Vec::new();
    let mut known = BTreeMap::new();
    let mut indices = Vec::new();
    let mut columns: Vec<(Vec<u16>, Vec<i64>)> = Vec::new();
    for (i, text) in texts.iter().enumerate() {
        let pattern = pattern(text);
        let index = *known.entry(pattern.clone()).or_insert(patterns.len());
        if index == patterns.len() {
            patterns.push(pattern);
        }
        let runs = runs(text);
        if patterns.len() > MAX_PATTERNS || runs.len() > MAX_RUNS {
            return None;
        }
        indices.push(index as i64);
        columns.resize(columns.len().max(runs.len()), Default::default());
        for (run, (rows, values)) in runs.into_iter().zip(&mut columns) {
            rows.push(context.rows.map_or(Some(i as u16), |rows| rows.get(i).copied())?);
            values.push(text.get(run)?.parse().ok()?);
        }
    }
    if columns.is_empty() {
        return None;
    }
    let list: Vec<&str> = patterns.iter().map(String::as_str).collect();
    let mut bytes = Vec::new();
    push64(&mut bytes, patterns.len() as u64);
    let mut parts = vec![encode_front(&list, context.history), numbers::encode(&indices, None, context.history)];
    for (rows, values) in &columns {
        parts.push(numbers::encode(values, context.rows.map(|_| rows.as_slice()), context.history));
    }
    parts.iter().for_each(|part| bytes.extend_from_slice(&part.bytes));
    let cost = parts.iter().map(|part| part.cost).sum();
    let runs = if context.rows.is_some() { columns } else { Runs::new() };
    Some((Coded { bytes, cost }, runs))
}

fn decode_patterns(
    reader: &mut ByteReader<'_>,
    count: usize,
    context: Context<'_>,
    budget: &mut TextBudget,
) -> Result<(TextList, Runs), DecodeError> {
    let pattern_count = reader.count("the number of patterns of texts", MAX_PATTERNS.min(BLOCK_OBJECTS))?;
    let patterns = decode_front(reader, pattern_count, context.history, budget)?;
    let pattern_runs: Vec<_> = patterns.iter().map(runs).collect();
    let run_count = pattern_runs.iter().map(Vec::len).max().unwrap_or(0);
    if run_count > MAX_RUNS {
        return Err(DecodeError::Limit {
            what: "the number of runs of digits",
            found: run_count as u64,
            limit: MAX_RUNS as u64,
        });
    }
    let lookup = |index: i64| usize::try_from(index).ok().filter(|index| *index < pattern_runs.len());
    let indices = numbers::decode(reader, count, None, context.history)?.into_iter().map(lookup);
    let indices: Vec<usize> = indices.collect::<Option<_>>().ok_or(DecodeError::Invalid("a text has no pattern"))?;
    let mut columns = Runs::new();
    for run in 0..run_count {
        let has_run =
            |i: &usize| indices.get(*i).and_then(|index| pattern_runs.get(*index)).is_some_and(|runs| runs.len() > run);
        let texts = (0..count).filter(has_run);
        let rows = texts.map(|i| context.rows.map_or(Some(i as u16), |rows| rows.get(i).copied()));
        let rows: Vec<u16> = rows.collect::<Option<_>>().ok_or(WRONG_REFERENCE)?;
        let values = numbers::decode(reader, rows.len(), context.rows.map(|_| rows.as_slice()), context.history)?;
        columns.push((rows, values));
    }
    let list = fill_patterns(&patterns, &pattern_runs, &indices, &columns, budget)?;
    Ok((list, if context.rows.is_some() { columns } else { Runs::new() }))
}

/// Replaces the runs of digits of each text's pattern by its numbers.
fn fill_patterns(
    patterns: &TextList,
    pattern_runs: &[Vec<std::ops::Range<usize>>],
    indices: &[usize],
    columns: &Runs,
    budget: &mut TextBudget,
) -> Result<TextList, DecodeError> {
    const INCOMPLETE: DecodeError = DecodeError::Invalid("a text lacks a number");
    let mut values: Vec<_> = columns.iter().map(|(_, values)| values.iter()).collect();
    let mut list = TextList::default();
    for index in indices {
        let (pattern, runs) = patterns.get(*index).zip(pattern_runs.get(*index)).ok_or(INCOMPLETE)?;
        budget.take(pattern.len())?;
        let mut text = pattern.to_owned();
        for (run, values) in runs.iter().zip(&mut values) {
            let value = *values.next().ok_or(INCOMPLETE)?;
            let digits = format!("{value:0width$}", width = run.len());
            // A number that is negative or too long has another length.
            invalid_if(value < 0 || digits.len() != run.len(), "a number does not fit into its text")?;
            text.replace_range(run.clone(), &digits);
        }
        list.push(&text);
    }
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(texts: &[&str], context: Context<'_>) -> (usize, Runs) {
        let (coded, runs) = encode(texts, context);
        let mut reader = ByteReader::new(&coded.bytes);
        let (list, decoded_runs) = decode(&mut reader, texts.len(), context, &mut TextBudget::new()).unwrap();
        reader.finish().unwrap();
        assert!(list.iter().eq(texts.iter().copied()));
        assert_eq!(runs, decoded_runs);
        for length in 0..coded.bytes.len() {
            let mut reader = ByteReader::new(&coded.bytes[..length]);
            assert!(decode(&mut reader, texts.len(), context, &mut TextBudget::new()).is_err(), "{length}");
        }
        (coded.bytes.len(), runs)
    }

    #[test]
    fn lists_round_trip_in_each_coding() {
        let history = History::new(300);
        let alone = Context { history: &history, rows: None, identifiers: None };
        let names = ["Amalienstraße", "Amalienstraße 3", "", "Ämter", "Ämtern", "Ärzte"];
        assert_eq!(encode(&names, alone).0.bytes[0], FRONT_CODED);
        round_trip(&names, alone);
        round_trip(&[], alone);
        let times: Vec<String> =
            (0..300).map(|i| format!("2010-10-{:02}T{:02}:{:02}:00Z", i % 28 + 1, i % 24, i % 60)).collect();
        let times: Vec<&str> = times.iter().map(String::as_str).collect();
        let rows: Vec<u16> = (0..300).collect();
        assert_eq!(encode(&times, alone).0.bytes[0], PATTERNS);
        assert!(round_trip(&times, alone).1.is_empty());
        let (bytes, runs) = round_trip(&times, Context { rows: Some(&rows), ..alone });
        assert!(bytes < 1000 && runs.len() == 6, "{bytes} {}", runs.len());
        round_trip(&["0503100000012869000000000000000001-0", "99999999999999999999", "7", "-", "٣3"], alone);
    }

    #[test]
    fn identifiers_as_an_attribute_take_one_byte() {
        let history = History::new(3);
        let identifiers = TextList::from_texts(["a", "b", "c"]);
        let context = Context { history: &history, rows: Some(&[0, 2]), identifiers: Some(&identifiers) };
        assert_eq!(round_trip(&["a", "c"], context).0, 1);
        assert!(round_trip(&["a", "b"], context).0 > 1);
    }

    #[test]
    fn long_texts_from_short_payloads_are_refused() {
        let history = History::new(0);
        let context = Context { history: &history, rows: None, identifiers: None };
        let long = "x".repeat(MAX_TEXT_BYTES);
        let (coded, _) = encode(&vec![long.as_str(); 512], context);
        let mut budget = TextBudget::new();
        for _ in 0..8 {
            assert!(decode(&mut ByteReader::new(&coded.bytes), 512, context, &mut budget).is_ok());
        }
        assert!(decode(&mut ByteReader::new(&coded.bytes), 512, context, &mut budget).is_err());
        let (coded, _) = encode(&[&format!("{long}x")], context);
        assert!(decode(&mut ByteReader::new(&coded.bytes), 1, context, &mut TextBudget::new()).is_err());
    }
}
