//! The dictionary: an `fst` from each token to the start of its list of entries.
//!
//! Lists are in order of tokens, so the lists of all tokens with one prefix are one range of bytes.
//!
//! The crate `fst` trusts its bytes: it indexes them with addresses that it reads from them. [`check`] therefore visits every
//! node first. What it admits cannot make `fst` panic or run in circles: nodes fill the bytes without gaps, sizes are in
//! range, and each transition leads to the end of a node before it. Keys in wrong order only give wrong results.

use super::SearchError;
use fst::raw::{Fst, Node};
use std::ops::Range;

/// Bytes before the first node: the version and the type.
const HEADER: usize = 16;

/// Bytes after the root: the number of keys, the address of the root and a checksum.
const TRAILER: usize = 20;

/// The version of the format that [`check`] knows.
const VERSION: u64 = 3;

/// Nodes with more transitions have an index of 256 bytes.
const INDEX_THRESHOLD: usize = 32;

/// Most steps to the end of a key. Keys of this crate are shorter.
const MAX_STEPS: usize = 256;

/// Most nodes that one query visits to find tokens with a typo.
const MAX_VISITS: usize = 50_000;

/// Most prefixes with a typo of one word.
const MAX_PREFIXES: usize = 1024;

/// Fails unless `fst` can read `bytes` without a panic. The time and memory are in proportion to the bytes.
pub(super) fn check(bytes: &[u8]) -> Result<(), SearchError> {
    let invalid = SearchError::Invalid("the dictionary is damaged");
    if nodes_are_valid(bytes) == Some(true) { Ok(()) } else { Err(invalid) }
}

fn nodes_are_valid(bytes: &[u8]) -> Option<bool> {
    let number = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?));
    let end = bytes.len().checked_sub(TRAILER)?;
    let root = number(end + 8)?;
    if number(0)? != VERSION || end < HEADER {
        return None;
    }
    if root == 0 {
        // A dictionary without nodes, which has the empty key.
        return Some(end == HEADER);
    }
    if root != end as u64 - 1 {
        return None;
    }
    // One bit per byte: ends of nodes, and targets of transitions. Targets lie before their node.
    let mut ends = vec![0u64; bytes.len().div_ceil(64)];
    let mut targets = ends.clone();
    let mut next = end;
    while next > HEADER {
        let address = next - 1;
        mark(&mut ends, address);
        next = check_node(bytes, address, |target| mark(&mut targets, target))?;
    }
    Some(next == HEADER && ends.iter().zip(&targets).all(|(ends, targets)| targets & !ends == 0))
}

fn mark(bits: &mut [u64], at: usize) {
    bits[at / 64] |= 1 << (at % 64);
}

/// Checks the node whose last byte is at `address`, calls `target` with the addresses of its transitions, all of which are
/// below the node, and returns the start of the node. `None` if it is not a valid node.
fn check_node(bytes: &[u8], address: usize, mut target: impl FnMut(usize)) -> Option<usize> {
    let state = *bytes.get(address)?;
    let low = usize::from(state & 0x3f);
    let mut at = address;
    let mut previous = || {
        at = at.checked_sub(1).filter(|at| *at >= HEADER)?;
        bytes.get(at).copied().map(usize::from)
    };
    // One transition to the node before it, without an output.
    if state >> 6 == 0b11 {
        if low == 0 {
            previous()?;
        }
        target(at - 1);
        return Some(at);
    }
    let single = state >> 6 == 0b10;
    let transitions = match low {
        _ if single => 1,
        0 => match previous()? {
            1 => 256,
            n => n,
        },
        n => n,
    };
    if single && low == 0 {
        // The input, which single transitions have before their sizes.
        previous()?;
    }
    let sizes = previous()?;
    let (address_bytes, output_bytes) = (sizes >> 4, sizes & 15);
    if output_bytes > 8 || transitions > 0 && !(1..=8).contains(&address_bytes) {
        return None;
    }
    let final_outputs = usize::from(!single && state >> 6 == 0b01);
    let inputs = if single { 0 } else { transitions + if transitions > INDEX_THRESHOLD { 256 } else { 0 } };
    let addresses_end = at.checked_sub(inputs)?;
    let addresses_start = addresses_end.checked_sub(transitions * address_bytes)?;
    let start = addresses_start.checked_sub((transitions + final_outputs) * output_bytes).filter(|at| *at >= HEADER)?;
    if transitions > 0 {
        for delta in bytes[addresses_start..addresses_end].chunks_exact(address_bytes) {
            let delta = delta.iter().rev().fold(0u64, |number, byte| number << 8 | u64::from(*byte));
            // Zero is the address of the end of a key that has no output.
            if delta != 0 {
                let address = (start as u64).checked_sub(delta).filter(|address| *address >= HEADER as u64)?;
                target(address as usize);
            }
        }
    }
    Some(start)
}

/// A dictionary that [`check`] has admitted.
pub(super) struct Words<'a> {
    fst: Fst<&'a [u8]>,
    /// Bytes of all lists.
    lists: u64,
}

/// A node and the sum of the outputs on the way to it.
#[derive(Clone, Copy)]
struct Place<'a> {
    node: Node<'a>,
    value: u64,
}

impl<'a> Words<'a> {
    /// Requires that [`check`] has admitted `bytes`. `None` if `fst` refuses them.
    pub(super) fn new(bytes: &'a [u8], lists: usize) -> Option<Self> {
        Some(Self { fst: Fst::new(bytes).ok()?, lists: lists as u64 })
    }

    fn root(&self) -> Place<'_> {
        Place { node: self.fst.root(), value: 0 }
    }

    fn child<'n>(&'n self, place: Place<'n>, transition: usize) -> Place<'n> {
        let transition = place.node.transition(transition);
        // Sums of false outputs may overflow.
        Place { node: self.fst.node(transition.addr), value: place.value.wrapping_add(transition.out.value()) }
    }

    fn follow<'n>(&'n self, mut place: Place<'n>, text: &str) -> Option<Place<'n>> {
        for byte in text.bytes() {
            place = self.child(place, place.node.find_input(byte)?);
        }
        Some(place)
    }

    /// The value of the least key at or below `place`.
    fn least<'n>(&'n self, mut place: Place<'n>) -> Option<u64> {
        for _ in 0..MAX_STEPS {
            if place.node.is_final() {
                return Some(place.value.wrapping_add(place.node.final_output().value()));
            }
            if place.node.is_empty() {
                return None;
            }
            place = self.child(place, 0);
        }
        None
    }

    /// The range of the lists of tokens that start with `prefix`, or with `exact` of the token itself. Empty if there are none.
    pub(super) fn lists(&self, prefix: &str, exact: bool) -> Range<u64> {
        self.find_lists(prefix, exact)
            .filter(|range| range.start < range.end && range.end <= self.lists)
            .unwrap_or(0..0)
    }

    fn find_lists(&self, prefix: &str, exact: bool) -> Option<Range<u64>> {
        let mut place = self.root();
        // The lists of the next key after those with the prefix start where theirs end.
        let mut after = None;
        for byte in prefix.bytes() {
            let transition = place.node.find_input(byte)?;
            if transition + 1 < place.node.len() {
                after = Some(self.child(place, transition + 1));
            }
            place = self.child(place, transition);
        }
        let start = self.least(place)?;
        if exact {
            if !place.node.is_final() {
                return None;
            }
            if !place.node.is_empty() {
                after = Some(self.child(place, 0));
            }
        }
        let end = match after {
            Some(after) => self.least(after)?,
            None => self.lists,
        };
        Some(start..end)
    }

    /// The characters that continue `place`, each with its place.
    fn children<'n>(&'n self, place: Place<'n>, visits: &mut usize) -> Vec<(char, Place<'n>)> {
        let mut found = Vec::new();
        let mut open = vec![([0; 4], 0, place)];
        while let Some((bytes, length, place)) = open.pop() {
            for transition in 0..place.node.len() {
                *visits += 1;
                if *visits > MAX_VISITS {
                    return found;
                }
                let mut bytes: [u8; 4] = bytes;
                bytes[length] = place.node.transition(transition).inp;
                let child = self.child(place, transition);
                match std::str::from_utf8(&bytes[..=length]) {
                    Ok(text) => found.extend(text.chars().map(|c| (c, child))),
                    Err(error) if error.error_len().is_none() && length < 3 => open.push((bytes, length + 1, child)),
                    Err(_) => {}
                }
            }
        }
        found
    }

    /// The prefixes of tokens that become `word` by one typo: a character too many, one missing, one wrong or two swapped.
    /// Sorted, none a prefix of another.
    pub(super) fn prefixes_with_typo(&self, word: &str) -> Vec<String> {
        let starts: Vec<usize> = word.char_indices().map(|(at, _)| at).chain([word.len()]).collect();
        let mut found = Vec::new();
        let mut visits = 0;
        let mut place = self.root();
        for window in 0..starts.len() - 1 {
            let (head, here) = word.split_at(starts[window]);
            let (wrong, rest) = here.split_at(starts[window + 1] - starts[window]);
            let children = self.children(place, &mut visits);
            let mut try_path = |from: Place<'_>, middle: &str, rest: &str| {
                visits += rest.len() + 1;
                if visits <= MAX_VISITS && found.len() < MAX_PREFIXES && self.follow(from, rest).is_some() {
                    found.push([head, middle, rest].concat());
                }
            };
            try_path(place, "", rest);
            if let Some(second) = rest.chars().next() {
                let middle = [second.encode_utf8(&mut [0; 4]), wrong].concat();
                if let Some(from) = self.follow(place, &middle) {
                    try_path(from, &middle, &rest[second.len_utf8()..]);
                }
            }
            for (c, child) in children {
                let mut bytes = [0; 4];
                let middle = &*c.encode_utf8(&mut bytes);
                if middle != wrong {
                    try_path(child, middle, rest);
                }
                try_path(child, middle, here);
            }
            match self.follow(place, wrong) {
                Some(next) => place = next,
                None => break,
            }
        }
        found.sort_unstable();
        // In sorted order, those with a prefix follow it.
        found.dedup_by(|later, kept| later.starts_with(kept.as_str()));
        found
    }
}
