//! Which buildings of two cities are the same, and which were split or merged: by what their footprints share. Of several that share as
//! much, those with the same identifier are the same.

use super::pairs::{OverlapPair, overlapping};
use super::shapes::BuildingShapes;
use crate::table::ExportError;
use std::collections::HashMap;

/// Buildings with this overlap are the same one, and so are all parts of one together.
const SAME_BUILDING: f64 = 0.5;
/// The same, of buildings with the same identifier.
const SAME_NAME: f64 = 0.1;
/// What was split from a building, or merged into it, has this share of its area in it.
const WITHIN: f64 = 0.5;
/// Overlaps are compared in hundredths.
const STEPS: f64 = 100.0;
const NO_NUMBER: u32 = u32::MAX;

/// A group, and the index of a building in it.
type Member = (u32, u32);

/// The buildings of two cities in groups, each of which is one building, or the parts of one. A group of one city's only was built or
/// demolished.
#[derive(Debug)]
pub(super) struct ChangeGroups {
    /// Of the earlier city, by group.
    before: Vec<Member>,
    after: Vec<Member>,
    /// Of each group.
    overlaps: Vec<f64>,
}

impl ChangeGroups {
    /// Groups all buildings. Into one whose footprint is the same, which it is from an overlap of `same_footprint` on, nothing was merged.
    /// Fails if too many lie upon each other.
    pub(super) fn new(
        before: &BuildingShapes,
        after: &BuildingShapes,
        same_footprint: f64,
    ) -> Result<Self, ExportError> {
        let pairs = overlapping(before, after)?;
        let same = same_buildings(&pairs, before, after);
        let mut parts = parts(&pairs, &same, [before, after], same_footprint);
        let mut sets = BuildingSets::new(before, after);
        same.iter().chain(&parts).for_each(|pair| sets.join(pair));
        let mut sums: HashMap<u32, AreaSums> = HashMap::new();
        for pair in &parts {
            sums.entry(sets.of(pair)[0]).or_default();
        }
        for (node, shape) in (0u32..).zip(before.all.iter().chain(&after.all)) {
            if let Some(sum) = sums.get_mut(&sets.root(node)) {
                sum.all += shape.area;
            }
        }
        for pair in &pairs {
            let [a, b] = sets.of(pair);
            if let Some(sum) = sums.get_mut(&a).filter(|_| a == b) {
                sum.shared += pair.shared;
            }
        }
        // A shed in the place of a tower is no part of it.
        parts.retain(|pair| sums.get(&sets.of(pair)[0]).is_some_and(|sum| sum.overlap() >= SAME_BUILDING));
        let mut sets = BuildingSets::new(before, after);
        same.iter().chain(&parts).for_each(|pair| sets.join(pair));
        Ok(sets.groups(&pairs, before, after))
    }

    /// The buildings of each group in the earlier and in the later city, and their overlap.
    pub(super) fn iter(&self) -> impl Iterator<Item = ([&[Member]; 2], f64)> {
        let [mut before, mut after] = [&self.before[..], &self.after[..]];
        (0u32..).zip(&self.overlaps).map(move |(group, overlap)| {
            let own = [&mut before, &mut after].map(|rest| {
                let all = *rest;
                let (own, next) = all.split_at(all.iter().take_while(|(other, _)| *other == group).count());
                *rest = next;
                own
            });
            (own, *overlap)
        })
    }
}

/// Areas of buildings of both cities, and what they share.
#[derive(Debug, Clone, Copy, Default)]
struct AreaSums {
    all: f64,
    shared: f64,
}

impl AreaSums {
    fn overlap(&self) -> f64 {
        if self.all > self.shared { self.shared / (self.all - self.shared) } else { 0.0 }
    }
}

/// The pairs of the same building, of which each building has at most one.
fn same_buildings(pairs: &[OverlapPair], before: &BuildingShapes, after: &BuildingShapes) -> Vec<OverlapPair> {
    let of = |pair: &OverlapPair| (&before.all[pair.before as usize], &after.all[pair.after as usize]);
    let has_one_name = |pair: &OverlapPair| {
        let (a, b) = of(pair);
        a.name != 0 && a.name == b.name
    };
    let rise = |pair: &OverlapPair| {
        let (a, b) = of(pair);
        (b.height_m() - a.height_m()).abs()
    };
    let steps = |pair: &OverlapPair| (pair.overlap * STEPS).round() as u32;
    let is_enough = |pair: &&OverlapPair| pair.overlap >= if has_one_name(pair) { SAME_NAME } else { SAME_BUILDING };
    let mut order: Vec<&OverlapPair> = pairs.iter().filter(is_enough).collect();
    order.sort_by(|a, b| {
        let by_name = has_one_name(b).cmp(&has_one_name(a));
        let by_height = rise(a).total_cmp(&rise(b));
        let by_number = (a.before, a.after).cmp(&(b.before, b.after));
        steps(b).cmp(&steps(a)).then(by_name).then(by_height).then(by_number)
    });
    let (mut from, mut to) = (vec![false; before.all.len()], vec![false; after.all.len()]);
    let mut same = Vec::new();
    for pair in order {
        let [is_from_taken, is_to_taken] = [&mut from[pair.before as usize], &mut to[pair.after as usize]];
        if !*is_from_taken && !*is_to_taken {
            (*is_from_taken, *is_to_taken) = (true, true);
            same.push(*pair);
        }
    }
    same
}

/// The pairs of a building that is no other one's same, and what it was perhaps split from or merged into.
fn parts(
    pairs: &[OverlapPair],
    same: &[OverlapPair],
    cities: [&BuildingShapes; 2],
    same_footprint: f64,
) -> Vec<OverlapPair> {
    // 0 of a building that is no other one's same.
    let mut overlaps = cities.map(|city| vec![0.0; city.all.len()]);
    for pair in same {
        overlaps[0][pair.before as usize] = pair.overlap;
        overlaps[1][pair.after as usize] = pair.overlap;
    }
    let is_part = |pair: &&OverlapPair| {
        let indices = [pair.before, pair.after].map(|index| index as usize);
        let known = [0, 1].map(|k| overlaps[k][indices[k]]);
        let shares = [0, 1].map(|k| pair.shared / cities[k].all[indices[k]].area);
        (0..2).any(|k| known[k] <= 0.0 && shares[k] >= WITHIN && known[1 - k] < same_footprint)
    };
    pairs.iter().filter(is_part).copied().collect()
}

/// Sets of buildings. Those of the later city are numbered behind those of the earlier one.
struct BuildingSets {
    parents: Vec<u32>,
    first_after: u32,
}

impl BuildingSets {
    /// Each building is a set.
    fn new(before: &BuildingShapes, after: &BuildingShapes) -> Self {
        let first_after = before.all.len() as u32;
        Self { parents: (0..first_after + after.all.len() as u32).collect(), first_after }
    }

    fn root(&mut self, mut node: u32) -> u32 {
        while self.parents[node as usize] != node {
            let above = self.parents[self.parents[node as usize] as usize];
            self.parents[node as usize] = above;
            node = above;
        }
        node
    }

    /// The sets of the buildings of a pair.
    fn of(&mut self, pair: &OverlapPair) -> [u32; 2] {
        [pair.before, self.first_after + pair.after].map(|node| self.root(node))
    }

    fn join(&mut self, pair: &OverlapPair) {
        let [a, b] = self.of(pair);
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// The sets as groups, in the order of the later city's buildings. Those that it does not have are the last.
    fn groups(mut self, pairs: &[OverlapPair], before: &BuildingShapes, after: &BuildingShapes) -> ChangeGroups {
        let mut numbers = vec![NO_NUMBER; self.parents.len()];
        let mut sums: Vec<AreaSums> = Vec::new();
        let mut members = [Vec::new(), Vec::new()];
        let shapes = [&before.all, &after.all];
        for (city, first) in [(1, self.first_after), (0, 0)] {
            for (index, shape) in (0u32..).zip(shapes[city]) {
                let number = &mut numbers[self.root(first + index) as usize];
                if *number == NO_NUMBER {
                    *number = sums.len() as u32;
                    sums.push(AreaSums::default());
                }
                sums[*number as usize].all += shape.area;
                members[city].push((*number, index));
            }
        }
        for pair in pairs {
            let [a, b] = self.of(pair);
            if a == b {
                sums[numbers[a as usize] as usize].shared += pair.shared;
            }
        }
        members.iter_mut().for_each(|members| members.sort_unstable());
        let [before, after] = members;
        ChangeGroups { before, after, overlaps: sums.iter().map(AreaSums::overlap).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_shapes::city;
    use super::*;
    use insula_test_support::rng::Rng;
    use std::collections::BTreeSet;

    type Boxes<'a> = &'a [(&'a str, [i32; 4], i32)];

    /// The groups as the indices of the earlier and the later buildings, and hundredths of overlap.
    fn groups(before: Boxes<'_>, after: Boxes<'_>) -> Vec<(Vec<u32>, Vec<u32>, u32)> {
        let groups = ChangeGroups::new(&city(before), &city(after), 0.9).unwrap();
        let indices = |members: &[Member]| -> Vec<u32> { members.iter().map(|(_, index)| *index).collect() };
        groups.iter().map(|([a, b], overlap)| (indices(a), indices(b), (overlap * 100.0).round() as u32)).collect()
    }

    fn group(before: &[u32], after: &[u32], overlap: u32) -> (Vec<u32>, Vec<u32>, u32) {
        (before.to_vec(), after.to_vec(), overlap)
    }

    #[test]
    fn buildings_are_the_same_by_their_places() {
        let house = [("a", [0, 0, 10, 10], 9)];
        let apart = [group(&[], &[0], 0), group(&[0], &[], 0)];
        assert_eq!(groups(&house, &[("b", [0, 0, 10, 10], 30)]), [group(&[0], &[0], 100)], "another name and height");
        assert_eq!(groups(&house, &[("b", [2, 0, 12, 10], 9)]), [group(&[0], &[0], 67)], "moved a little");
        assert_eq!(groups(&house, &[("a", [50, 0, 60, 10], 9)]), apart, "moved far");
        assert_eq!(groups(&house, &[]), [group(&[0], &[], 0)]);
        assert_eq!(groups(&[], &house), [group(&[], &[0], 0)]);
        // A third of both together is too little, unless the name says more.
        assert_eq!(groups(&house, &[("b", [5, 0, 15, 10], 9)]), apart);
        assert_eq!(groups(&house, &[("a", [5, 0, 15, 10], 9)]), [group(&[0], &[0], 33)]);
    }

    #[test]
    fn parts_are_in_the_group_of_their_whole() {
        let whole = [("a", [0, 0, 30, 10], 9)];
        let thirds = [("b", [0, 0, 10, 10], 9), ("c", [10, 0, 20, 10], 9), ("d", [20, 0, 30, 10], 9)];
        assert_eq!(groups(&whole, &thirds), [group(&[0], &[0, 1, 2], 100)]);
        assert_eq!(groups(&thirds, &whole), [group(&[0, 1, 2], &[0], 100)]);
        let unequal = [("b", [0, 0, 20, 10], 9), ("c", [20, 0, 30, 10], 9)];
        assert_eq!(groups(&unequal, &whole), [group(&[0, 1], &[0], 100)]);
        // A shed that a tower replaces, and one within a house that stays.
        let shed = ("s", [4, 4, 6, 6], 3);
        let apart = [group(&[], &[0], 0), group(&[0], &[], 0)];
        assert_eq!(groups(&[shed], &[("t", [0, 0, 50, 50], 90)]), apart);
        let stays = [group(&[0], &[0], 100), group(&[1], &[], 0)];
        assert_eq!(groups(&[thirds[0], shed], &[thirds[0]]), stays);
    }

    #[test]
    fn of_buildings_above_each_other_identifiers_and_heights_tell_which_is_which() {
        let stacked = [("a", [0, 0, 10, 10], 9), ("b", [0, 0, 10, 10], 20)];
        let turned = [("b", [0, 0, 10, 10], 9), ("a", [0, 0, 10, 10], 20)];
        assert_eq!(groups(&stacked, &turned), [group(&[1], &[0], 100), group(&[0], &[1], 100)]);
        let unnamed = [("", [0, 0, 10, 10], 20), ("", [0, 0, 10, 10], 9)];
        assert_eq!(groups(&stacked, &unnamed), [group(&[1], &[0], 100), group(&[0], &[1], 100)]);
    }

    /// All edits are found, and no others: precision and recall are 1.
    #[test]
    fn known_edits_of_a_town_are_found() {
        let mut rng = Rng::new(11);
        let (mut before, mut after) = (Vec::new(), Vec::new());
        let mut expected = BTreeSet::new();
        for slot in 0..2500 {
            let [x, y] = [slot % 50 * 30, slot / 50 * 30];
            let house = [x, y, x + 12, y + 10];
            let halves = [[x, y, x + 6, y + 10], [x + 6, y, x + 12, y + 10]];
            let (old, new, is_one) = match rng.below(10) {
                0 => (vec![], vec![house], true),
                1 => (vec![house], vec![], true),
                2 => (vec![house], halves.to_vec(), true),
                3 => (halves.to_vec(), vec![house], true),
                4 => (vec![house], vec![[x + 2, y, x + 14, y + 10]], true),
                5 => (vec![house], vec![[x, y, x + 12, y + 16]], true),
                6 => (vec![[x + 2, y + 2, x + 5, y + 5]], vec![[x, y, x + 25, y + 25]], false),
                7 => (vec![house], vec![[x + 13, y, x + 25, y + 10]], false),
                _ => (vec![house], vec![house], true),
            };
            let add = |all: &mut Vec<(&str, [i32; 4], i32)>, boxes: Vec<[i32; 4]>| -> Vec<u32> {
                let first = all.len() as u32;
                all.extend(boxes.into_iter().map(|bounds| ("", bounds, 9)));
                (first..all.len() as u32).collect()
            };
            let (old, new) = (add(&mut before, old), add(&mut after, new));
            match is_one {
                true => expected.extend([(old, new)]),
                false => expected.extend([(old, Vec::new()), (Vec::new(), new)]),
            }
        }
        let found: Vec<_> = groups(&before, &after).into_iter().map(|(old, new, _)| (old, new)).collect();
        assert!(expected.len() > 2500 && found.len() == expected.len());
        assert_eq!(found.into_iter().collect::<BTreeSet<_>>(), expected);
    }
}
