//! Positions of the nodes that are needed: 16 bytes for each, by sorted identifiers.

use super::element::{Element, ElementFile, Pass, Position};
use insula_source::error::InputError;
use insula_source::object::ObjectSink;
use std::ops::ControlFlow;

/// No valid position.
const MISSING: Position = [i32::MIN; 2];

/// Nodes by their identifiers.
#[derive(Debug, Default)]
pub(super) struct NodeStore {
    ids: Vec<i64>,
    positions: Vec<Position>,
}

impl NodeStore {
    /// Reads the nodes of identifiers, in any order and with repetitions, from a file.
    pub(super) fn read(
        mut ids: Vec<i64>,
        file: &mut dyn ElementFile,
        sink: &mut dyn ObjectSink,
    ) -> Result<Self, InputError> {
        ids.sort_unstable();
        ids.dedup();
        ids.shrink_to_fit();
        let mut positions = vec![MISSING; ids.len()];
        let is_needed = |first: i64, last: i64| {
            let at = ids.partition_point(|id| *id < first);
            ids.get(at).is_some_and(|id| *id <= last)
        };
        let mut place = 0;
        file.read_through(Pass::Nodes(&is_needed), sink, &mut |element, _| {
            if let Element::Node { id, position, .. } = element {
                place = lower_bound(&ids, place, id);
                if ids.get(place) == Some(&id) {
                    positions[place] = position;
                }
            }
            Ok(ControlFlow::Continue(()))
        })?;
        Ok(Self { ids, positions })
    }

    /// Place of a node; `None` if the file lacks it. `near` is the place that was found last: nodes of a way have near
    /// identifiers.
    pub(super) fn place(&self, id: i64, near: &mut usize) -> Option<u32> {
        *near = lower_bound(&self.ids, *near, id);
        let is_found = self.ids.get(*near) == Some(&id) && self.positions.get(*near) != Some(&MISSING);
        u32::try_from(*near).ok().filter(|_| is_found)
    }

    pub(super) fn at(&self, place: u32) -> Position {
        self.positions.get(place as usize).copied().unwrap_or(MISSING)
    }

    /// Positions of the nodes of a way; `None` for those that the file lacks.
    pub(super) fn positions<'a>(&'a self, refs: &'a [i64]) -> impl Iterator<Item = Option<Position>> + 'a {
        let mut near = 0;
        refs.iter().map(move |id| self.place(*id, &mut near).map(|place| self.at(place)))
    }
}

/// Index of the first identifier that is not less than `id`, by growing steps from `from`.
fn lower_bound(ids: &[i64], from: usize, id: i64) -> usize {
    let is_less = |at: usize| ids.get(at).is_some_and(|known| *known < id);
    let (mut low, mut high) = (from.min(ids.len()), from.min(ids.len()));
    let mut step = 1;
    if is_less(low) {
        while is_less(high) {
            low = high;
            high = (high + step).min(ids.len());
            step *= 2;
        }
    } else {
        while low > 0 && !is_less(low) {
            high = low;
            low = low.saturating_sub(step);
            step *= 2;
        }
    }
    let end = (high + 1).min(ids.len());
    low + ids[low..end].partition_point(|known| *known < id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identifier_is_found_from_everywhere() {
        let ids: Vec<i64> = (0..50).map(|i| i * i - 300).collect();
        for from in [0, 1, 17, 49, 50, 1000] {
            for id in -310..2200 {
                assert_eq!(lower_bound(&ids, from, id), ids.partition_point(|known| *known < id), "{id} from {from}");
            }
        }
        assert_eq!(lower_bound(&[], 3, 7), 0);
    }
}
