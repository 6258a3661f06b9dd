//! The entries that may match a query, from the lists of its words.
//!
//! Each word gives a clause: the entries in some lists. Entries in all clauses are candidates, whose texts are then compared
//! with the query. A clause that is left out for its length only leaves more candidates.

use super::fold::{MAX_TOKEN_BYTES, cut, is_cjk, tokens};
use super::postings::{EntrySet, read_varint};
use super::query::{Query, QueryWord};
use super::words::Words;
use std::ops::Range;

/// Most clauses that narrow one query. Long words of CJK have one per character.
const MAX_CLAUSES: usize = 24;

/// So few candidates are compared at once, rather than narrowed further.
const FEW: usize = 128;

/// Most tokens by which a CJK word with a typo is found. Each takes one bit per entry of memory.
const MAX_TYPO_TOKENS: usize = 10;

/// Which entries a word of the query is in.
enum Clause {
    /// Those in at least one of the lists. Ranges of bytes in order and without overlap.
    Lists(Vec<Range<u64>>),
    /// Those with all tokens of a CJK word but the ones that one typo may have changed.
    Typo(Vec<TypoToken>),
}

/// A token of a CJK word that may have a typo.
struct TypoToken {
    lists: Range<u64>,
    /// The characters that make the token what it is.
    chars: Range<usize>,
}

impl Clause {
    fn lists(mut lists: Vec<Range<u64>>) -> Self {
        lists.retain(|range| !range.is_empty());
        lists.sort_unstable_by_key(|range| (range.start, range.end));
        // Ranges of prefixes are nested or apart.
        lists.dedup_by(|later, kept| {
            let nested = later.start < kept.end;
            kept.end = if nested { kept.end.max(later.end) } else { kept.end };
            nested
        });
        Self::Lists(lists)
    }

    fn ranges(&self) -> impl Iterator<Item = &Range<u64>> {
        let (lists, tokens): (&[Range<u64>], &[TypoToken]) = match self {
            Self::Lists(lists) => (lists, &[]),
            Self::Typo(tokens) => (&[], tokens),
        };
        lists.iter().chain(tokens.iter().map(|token| &token.lists))
    }

    fn bytes(&self) -> u64 {
        self.ranges().map(length).sum()
    }
}

fn length(range: &Range<u64>) -> u64 {
    range.end - range.start
}

fn word_clauses(word: &QueryWord, words: &Words<'_>, typos: bool, clauses: &mut Vec<Clause>) {
    let typos = typos && word.may_have_typo;
    if !word.has_cjk {
        // The dictionary has long words cut in the same way.
        let mut lists: Vec<_> =
            word.weak_spellings().map(|weak| words.lists(cut(&weak, MAX_TOKEN_BYTES), false)).collect();
        if typos {
            let prefixes = words.prefixes_with_typo(cut(&word.weak, MAX_TOKEN_BYTES));
            lists.extend(prefixes.iter().map(|prefix| words.lists(prefix, false)));
        }
        clauses.push(Clause::lists(lists));
        return;
    }
    let known = tokens(&word.weak).filter(|token| !token.implied);
    if !typos {
        clauses.extend(known.map(|token| Clause::lists(vec![words.lists(token.text, !token.last)])));
        return;
    }
    let found = known.map(|token| {
        let (start, count) = (word.weak[..token.at].chars().count(), token.text.chars().count());
        // What follows a single character or a word decides that it ends there.
        let pair = count == 2 && token.text.starts_with(is_cjk);
        let end = start + count + usize::from(!pair && !token.last);
        TypoToken { lists: words.lists(token.text, !token.last), chars: start..end }
    });
    clauses.push(Clause::Typo(found.collect()));
}

/// Reads lists into sets.
pub(super) struct Candidates<'a> {
    pub(super) lists: &'a [u8],
    pub(super) entries: u32,
    /// Bytes that may still be read.
    pub(super) left: u64,
}

impl Candidates<'_> {
    /// The entries that may match `query`. `None` if a word is in no text.
    pub(super) fn find(mut self, query: &Query, words: &Words<'_>, typos: bool) -> Option<EntrySet> {
        let mut clauses = Vec::new();
        for word in &query.words {
            word_clauses(word, words, typos, &mut clauses);
        }
        clauses.sort_by_cached_key(|clause| clause.ranges().map(|range| self.estimate(range)).sum::<u64>());
        let mut candidates: Option<EntrySet> = None;
        for clause in clauses.iter().take(MAX_CLAUSES) {
            let bytes = clause.bytes();
            if bytes == 0 {
                return None;
            }
            if candidates.as_ref().is_some_and(|set| set.len() <= FEW) {
                break;
            }
            // The first one is read in part if it is too long, and leaves some for others, which may be short and frequent. A
            // later one read in part would drop texts that match.
            let kept = if candidates.is_none() { self.left / 4 } else { 0 };
            if candidates.is_some() && bytes > self.left {
                continue;
            }
            self.left -= kept;
            let set = match clause {
                Clause::Lists(lists) => self.union(lists),
                Clause::Typo(tokens) => self.all_but_typo(tokens),
            };
            self.left += kept;
            match &mut candidates {
                Some(candidates) => candidates.intersect(&set),
                None => candidates = Some(set),
            }
        }
        candidates
    }

    /// The entries in at least one list, as far as they may be read.
    fn union(&mut self, ranges: &[Range<u64>]) -> EntrySet {
        let mut set = EntrySet::new(self.entries);
        for range in ranges {
            let end = range.end.min(range.start.saturating_add(self.left));
            set.insert_lists(self.lists.get(range.start as usize..end as usize).unwrap_or_default());
            self.left -= end - range.start;
        }
        set
    }

    /// About how many entries are in the lists: those of the first list, or one per two bytes.
    fn estimate(&self, range: &Range<u64>) -> u64 {
        let mut list = self.lists.get(range.start as usize..range.end as usize).unwrap_or_default();
        u64::from(read_varint(&mut list).unwrap_or(0)).max(length(range) / 2)
    }

    /// The entries with all tokens before or behind a typo, for each place where it may be.
    fn all_but_typo(&mut self, tokens: &[TypoToken]) -> EntrySet {
        // The typo has changed all tokens that are in no text.
        let (mut tokens, absent): (Vec<_>, Vec<_>) = tokens.iter().partition(|token| !token.lists.is_empty());
        tokens.sort_by_key(|token| self.estimate(&token.lists));
        tokens.truncate(MAX_TYPO_TOKENS);
        // One that is too frequent to be read would hardly narrow the others.
        tokens.retain(|token| length(&token.lists) <= self.left / 4);
        tokens.sort_by_key(|token| token.chars.start);
        let sets: Vec<EntrySet> = tokens.iter().map(|token| self.union(std::slice::from_ref(&token.lists))).collect();
        // `behind[i]` has all tokens from the one at `i` on.
        let mut behind = sets.clone();
        for at in (1..behind.len()).rev() {
            let (head, tail) = behind.split_at_mut(at);
            head[at - 1].intersect(&tail[0]);
        }
        let end = tokens.last().map_or(0, |token| token.chars.end);
        let mut found = EntrySet::new(self.entries);
        let mut before: Option<EntrySet> = None;
        let (mut first, mut tried) = (0, None);
        for place in 0..=end {
            while tokens.get(first).is_some_and(|token| token.chars.end <= place) {
                match &mut before {
                    Some(before) => before.intersect(&sets[first]),
                    None => before = Some(sets[first].clone()),
                }
                first += 1;
            }
            // Two swapped characters are the longest typo.
            let next = tokens.partition_point(|token| token.chars.start < place + 2);
            if absent.iter().any(|token| token.chars.end <= place || token.chars.start >= place + 2)
                || tried.replace((first, next)) == Some((first, next))
            {
                continue;
            }
            match (&before, behind.get(next)) {
                (Some(before), Some(behind)) => found.unite_both(before, behind),
                (Some(one), None) | (None, Some(one)) => found.unite_both(one, one),
                (None, None) => {}
            }
        }
        found
    }
}
