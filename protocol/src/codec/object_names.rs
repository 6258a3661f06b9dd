//! Numbers of objects in a tile: a list of all of them, and for each part of the tile which one it is.

use super::range::{BitCoder, BitModel};
use crate::error::{DecodeError, check_limit};

/// Number that stands for no object, such as generated ground.
pub const NO_OBJECT: u32 = u32::MAX;

/// Most objects that a part is compared with before it is named by its place in the list.
const CANDIDATES: usize = 6;
const CONTEXTS: usize = 12;
/// Kinds of parts that have models of their own.
const PARTS: usize = 3;

/// Codes an ascending list of objects by their differences. Fails if it is empty, longer than `limit`, or has a number that does not
/// exist.
pub(crate) fn code_list<C: BitCoder>(coder: &mut C, list: Vec<u32>, limit: usize) -> Result<Vec<u32>, DecodeError> {
    let mut models = [[BitModel::NEW; 63]; 2];
    let count = code_magnitude(coder, &mut models[0], list.len() as u32) as usize;
    check_limit("the number of a tile's objects", count, limit)?;
    let (mut out, mut next) = (Vec::with_capacity(count), 0u32);
    for i in 0..count {
        let value = list.get(i).copied().unwrap_or(0);
        let step = code_magnitude(coder, &mut models[1], value.wrapping_sub(next));
        let object = next.checked_add(step).filter(|object| *object != NO_OBJECT);
        out.push(object.ok_or(DecodeError::Invalid("an object's number is out of range"))?);
        next = out[i] + 1;
    }
    if out.is_empty() { Err(DecodeError::Invalid("a section of objects without any")) } else { Ok(out) }
}

/// Codes a number by its count of binary digits and its digits below the highest.
fn code_magnitude<C: BitCoder>(coder: &mut C, models: &mut [BitModel; 63], value: u32) -> u32 {
    // A count above 32, which no writer makes, counts as 32.
    let digits = coder.choice(models, 32 - value.leading_zeros()).min(32);
    let mut out = u32::from(digits > 0);
    for digit in (0..digits.saturating_sub(1)).rev() {
        out = out << 1 | u32::from(coder.bit(&mut BitModel::NEW.clone(), value >> digit & 1 != 0));
    }
    out
}

/// Names objects one after the other.
pub(crate) struct Naming<'a, C> {
    coder: &'a mut C,
    /// Ascending.
    list: &'a [u32],
    /// The objects that were named last, the latest first.
    recent: Vec<u32>,
    models: Box<NamingModels>,
}

/// Whether a candidate is the object, by part, context and place among the candidates; and whether a part that is none of them has no
/// object.
struct NamingModels {
    is_candidate: [[[BitModel; CANDIDATES]; CONTEXTS]; PARTS],
    is_none: [BitModel; PARTS],
}

impl Default for NamingModels {
    fn default() -> Self {
        Self { is_candidate: [[[BitModel::NEW; CANDIDATES]; CONTEXTS]; PARTS], is_none: [BitModel::NEW; PARTS] }
    }
}

impl<'a, C: BitCoder> Naming<'a, C> {
    /// `list` as [`code_list`] gave it.
    pub(crate) fn new(coder: &'a mut C, list: &'a [u32]) -> Self {
        Self { coder, list, recent: Vec::new(), models: Box::default() }
    }

    /// Codes one object of a part below 3 in a context below 12: the first of the candidates and then of the recent ones that it is, else its place in the list.
    pub(crate) fn name(
        &mut self,
        part: usize,
        context: usize,
        candidates: impl Iterator<Item = u32>,
        value: u32,
    ) -> u32 {
        let mut tried: [u32; CANDIDATES] = [0; CANDIDATES];
        let mut count = 0;
        let mut found = None;
        for candidate in candidates.chain(self.recent.iter().copied()) {
            if tried[..count].contains(&candidate) {
                continue;
            }
            if count == CANDIDATES {
                break;
            }
            tried[count] = candidate;
            let model = &mut self.models.is_candidate[part][context.min(CONTEXTS - 1)][count];
            if self.coder.bit(model, value == candidate) {
                found = Some(candidate);
                break;
            }
            count += 1;
        }
        if let Some(object) = found {
            return self.remember(object);
        }
        if self.coder.bit(&mut self.models.is_none[part], value == NO_OBJECT) {
            return self.remember(NO_OBJECT);
        }
        let place = self.list.partition_point(|object| *object < value);
        let last = self.list.len() - 1;
        let mut found = 0usize;
        for digit in (0..usize::BITS - last.leading_zeros()).rev() {
            found = found << 1 | usize::from(self.coder.bit(&mut BitModel::NEW.clone(), place >> digit & 1 != 0));
        }
        // A place past the end, which no writer makes, is the last one.
        self.remember(self.list[found.min(last)])
    }

    fn remember(&mut self, object: u32) -> u32 {
        if self.recent.first() == Some(&object) {
            return object;
        }
        if let Some(at) = self.recent.iter().position(|recent| *recent == object) {
            self.recent.remove(at);
        }
        self.recent.insert(0, object);
        self.recent.truncate(CANDIDATES);
        object
    }
}
