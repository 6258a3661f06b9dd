//! Numbers of objects: along the Hilbert curve of the leaves, so that a leaf has few and near ones.
//!
//! From the objects of a city, where they stand, and the numbers of the city that is updated come a number for each object with a shape,
//! and a row for each number. An object without a shape gets a number if it is the parent of one with a number.

use super::grid::CityGrid;
use super::object_records::RecordPlace;
use super::scratch_scene::{ObjectIdentity, ScratchScene};
use crate::error::BakeError;
use insula_protocol::blockmap::NO_OBJECT;
use insula_scratch::record_list::{RecordList, RecordScratch};
use insula_scratch::record_sorter::{RecordSorter, SortedRecords};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// What is known of a number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct NumberedObject {
    pub(crate) record: RecordPlace,
    /// Number of its parent.
    pub(crate) parent: Option<u32>,
    /// Lowest and highest corner relative to the scene's origin; `None` without a shape.
    pub(crate) bounds_m: Option<[[f32; 3]; 2]>,
}

/// The numbers of a city's objects.
#[derive(Debug, Default)]
pub(crate) struct ObjectNumbers {
    /// By index of the scene's objects; [`NO_OBJECT`] for generated ground.
    pub(crate) of_object: RecordList<u32>,
    /// By number; `None` for numbers of objects that an update has removed.
    pub(crate) rows: RecordList<Option<NumberedObject>>,
}

/// An identifier, and how many objects before had the same.
pub(crate) type IdentityKey = (u64, u32);

/// An object or a parent without a shape, while numbers are given.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct NumberCandidate {
    identity: ObjectIdentity,
    bounds_m: Option<[[f32; 3]; 2]>,
    /// Index in the scene, if it has a shape.
    object: Option<u32>,
    /// Index of its parent among the candidates.
    parent: Option<u32>,
    /// Place on the curve.
    place: Option<u64>,
}

impl ObjectNumbers {
    /// Numbers all objects that have a record. `known` are the numbers of the city that is updated: its objects keep them, new ones
    /// follow. Fails if the objects cannot be read.
    pub(crate) fn new(
        city: &ScratchScene,
        grid: &CityGrid,
        known: &HashMap<IdentityKey, u32>,
    ) -> Result<Self, BakeError> {
        let scratch = city.objects.scratch();
        let mut candidates = candidates(city, grid, &scratch)?;
        link_parents(&mut candidates, &scratch)?;
        place_parents(&mut candidates)?;
        let numbers = give_numbers(&candidates, known, &scratch)?;
        let mut of_object = RecordSorter::new(&scratch, |a: &(u32, u32), b: &(u32, u32)| a.0.cmp(&b.0));
        let mut rows =
            RecordSorter::new(&scratch, |a: &(u32, NumberedObject), b: &(u32, NumberedObject)| a.0.cmp(&b.0));
        candidates.try_for_each(|i, candidate| {
            let Some(number) = numbers.get(i)? else { return Ok(()) };
            if let Some(object) = candidate.object {
                of_object.push((object, number))?;
            }
            let parent = candidate.parent.map(|parent| numbers.get(parent as usize)).transpose()?.flatten();
            let (record, bounds_m) = (candidate.identity.record, candidate.bounds_m);
            rows.push((number, NumberedObject { record, parent, bounds_m }))
        })?;
        let mut out = Self { of_object: RecordList::new(&scratch), rows: RecordList::new(&scratch) };
        of_object.finish()?.try_for_each(|(object, number)| {
            while out.of_object.len() < object as usize {
                out.of_object.push(NO_OBJECT);
            }
            out.of_object.push(number);
            Ok::<_, BakeError>(())
        })?;
        while out.of_object.len() < city.objects.len() {
            out.of_object.push(NO_OBJECT);
        }
        rows.finish()?.try_for_each(|(number, row)| {
            while out.rows.len() < number as usize {
                out.rows.push(None);
            }
            out.rows.push(Some(row));
            Ok::<_, BakeError>(())
        })?;
        Ok(out)
    }
}

impl ObjectNumbers {
    /// Number and hash of the identifier of each object that has a number, in the order of the numbers. Fails if the objects cannot be
    /// read.
    pub(crate) fn identifiers(&self, city: &ScratchScene) -> Result<SortedRecords<(u32, u64)>, BakeError> {
        let scratch = city.objects.scratch();
        // By the place of the record, which rows and objects have in common.
        let mut hashes = RecordSorter::new(&scratch, |a: &(RecordPlace, u64), b: &(RecordPlace, u64)| a.0.cmp(&b.0));
        let mut push = |identity: &ObjectIdentity| hashes.push((identity.record, identity.id_hash));
        city.objects.try_for_each(|_, object| object.identity.as_ref().map_or(Ok(()), &mut push))?;
        city.parents.try_for_each(|_, identity| push(identity))?;
        let mut places = RecordSorter::new(&scratch, |a: &(RecordPlace, u32), b: &(RecordPlace, u32)| a.0.cmp(&b.0));
        self.rows.try_for_each(|number, row| row.map_or(Ok(()), |row| places.push((row.record, number as u32))))?;
        let mut found = RecordSorter::new(&scratch, |a: &(u32, u64), b: &(u32, u64)| a.0.cmp(&b.0));
        let mut hashes = hashes.finish()?;
        let mut next = hashes.read_next()?;
        places.finish()?.try_for_each(|(record, number)| {
            while next.is_some_and(|(known, _)| known < record) {
                next = hashes.read_next()?;
            }
            next.filter(|(known, _)| *known == record).map_or(Ok(()), |(_, hash)| found.push((number, hash)))
        })?;
        found.finish().map_err(BakeError::from)
    }
}

/// All candidates, in the order of the sources: a parent precedes its parts.
fn candidates(
    city: &ScratchScene,
    grid: &CityGrid,
    scratch: &RecordScratch,
) -> Result<RecordList<NumberCandidate>, BakeError> {
    let mut sorter = RecordSorter::new(scratch, |a: &NumberCandidate, b: &NumberCandidate| {
        a.identity.record.cmp(&b.identity.record)
    });
    city.objects.try_for_each(|i, object| {
        let Some(identity) = object.identity else { return Ok(()) };
        // The bounds of an object without triangles are inverted. It gets a number only as a parent.
        let bounds_m = Some(object.bounds_m).filter(|[low, high]| (0..3).all(|axis| low[axis] <= high[axis]));
        let place = bounds_m.map(|bounds_m| place_of(bounds_m, grid));
        sorter.push(NumberCandidate { identity, bounds_m, object: bounds_m.map(|_| i as u32), parent: None, place })
    })?;
    city.parents.try_for_each(|_, identity| {
        let (identity, bounds_m, object, parent, place) = (*identity, None, None, None, None);
        sorter.push(NumberCandidate { identity, bounds_m, object, parent, place })
    })?;
    let mut all = RecordList::new(scratch);
    sorter.finish()?.try_for_each(|candidate| {
        all.push(candidate);
        Ok::<_, BakeError>(())
    })?;
    Ok(all)
}

/// The leaf at the middle of a box, as its distance along the curve.
fn place_of([low, high]: [[f32; 3]; 2], grid: &CityGrid) -> u64 {
    let leaf_m = grid.node_side_m(grid.depth);
    let last = (1u32 << grid.depth) - 1;
    let [x, y] = [0, 1].map(|axis| {
        let middle = (f64::from(low[axis]) + f64::from(high[axis])) / 2.0 - grid.corner[axis];
        // The cast saturates.
        ((middle / leaf_m).max(0.0) as u32).min(last)
    });
    fast_hilbert::xy2h(x, y, grid.depth)
}

/// A candidate that has an identifier, or names it as its parent's.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct NamedCandidate {
    hash: u64,
    names_parent: bool,
    source: u32,
    candidate: u32,
}

/// Finds each candidate's parent: in its own source, else in any. An object is not its own parent.
fn link_parents(candidates: &mut RecordList<NumberCandidate>, scratch: &RecordScratch) -> Result<(), BakeError> {
    let mut has_parents = false;
    candidates.try_for_each(|_, candidate| {
        has_parents |= candidate.identity.parent_hash.is_some();
        Ok::<_, BakeError>(())
    })?;
    if !has_parents {
        return Ok(());
    }
    // Of each identifier, those that have it come before those that name it.
    let mut named = RecordSorter::new(scratch, |a: &NamedCandidate, b: &NamedCandidate| {
        (a.hash, a.names_parent, a.candidate).cmp(&(b.hash, b.names_parent, b.candidate))
    });
    candidates.try_for_each(|i, candidate| {
        let ObjectIdentity { source, id_hash, parent_hash, .. } = candidate.identity;
        let candidate = i as u32;
        named.push(NamedCandidate { hash: id_hash, names_parent: false, source, candidate })?;
        let Some(hash) = parent_hash else { return Ok(()) };
        named.push(NamedCandidate { hash, names_parent: true, source, candidate })
    })?;
    let mut links = RecordSorter::new(scratch, |a: &(u32, u32), b: &(u32, u32)| a.0.cmp(&b.0));
    let (mut hash, mut anywhere, mut in_source) = (None, None, HashMap::new());
    named.finish()?.try_for_each(|named| {
        if hash != Some(named.hash) {
            (hash, anywhere) = (Some(named.hash), None);
            in_source.clear();
        }
        if !named.names_parent {
            in_source.entry(named.source).or_insert(named.candidate);
            anywhere.get_or_insert(named.candidate);
            return Ok(());
        }
        let found = in_source.get(&named.source).copied().or(anywhere).filter(|parent| *parent != named.candidate);
        found.map_or(Ok(()), |parent| links.push((named.candidate, parent)))
    })?;
    links
        .finish()?
        .try_for_each(|(candidate, parent)| {
            candidates.update(candidate as usize, |candidate| candidate.parent = Some(parent))
        })
        .map_err(BakeError::from)
}

/// Gives parents without a shape the first place of their parts. Chains of parents are followed to a limited depth.
fn place_parents(candidates: &mut RecordList<NumberCandidate>) -> Result<(), BakeError> {
    const MAX_DEPTH: usize = 8;
    for i in 0..candidates.len() {
        let NumberCandidate { place, object: Some(_), parent: mut next, .. } = candidates.get(i)? else { continue };
        let Some(place) = place else { continue };
        for _ in 0..MAX_DEPTH {
            let Some(number) = next else { break };
            let parent = candidates.get(number as usize)?;
            if parent.object.is_none() {
                let first = parent.place.map_or(place, |known| known.min(place));
                candidates.update(number as usize, |parent| parent.place = Some(first))?;
            }
            next = parent.parent;
        }
    }
    Ok(())
}

/// The number of each candidate that has a place, in the order of places. Known objects keep theirs.
fn give_numbers(
    candidates: &RecordList<NumberCandidate>,
    known: &HashMap<IdentityKey, u32>,
    scratch: &RecordScratch,
) -> Result<RecordList<Option<u32>>, BakeError> {
    /// Place, candidate, hash of its identifier.
    type PlacedCandidate = (u64, u32, u64);
    let mut order = RecordSorter::new(scratch, |a: &PlacedCandidate, b: &PlacedCandidate| (a.0, a.1).cmp(&(b.0, b.1)));
    candidates.try_for_each(|i, candidate| {
        let placed = candidate.place.map(|place| (place, i as u32, candidate.identity.id_hash));
        placed.map_or(Ok(()), |placed| order.push(placed))
    })?;
    let mut next = known.values().max().map_or(0, |last| last + 1);
    // Occurrences are counted in the order of the numbers, as a reader of the city counts them.
    let mut occurrences: HashMap<u64, u32> = HashMap::new();
    let mut given = RecordSorter::new(scratch, |a: &(u32, u32), b: &(u32, u32)| a.0.cmp(&b.0));
    order.finish()?.try_for_each(|(_, candidate, hash)| {
        let known_number = (!known.is_empty()).then(|| {
            let count = occurrences.entry(hash).or_default();
            *count += 1;
            known.get(&(hash, *count - 1)).copied()
        });
        let number = known_number.flatten().unwrap_or_else(|| {
            next += 1;
            next - 1
        });
        given.push((candidate, number))
    })?;
    let mut numbers = RecordList::new(scratch);
    given.finish()?.try_for_each(|(candidate, number)| {
        while numbers.len() < candidate as usize {
            numbers.push(None);
        }
        numbers.push(Some(number));
        Ok::<_, BakeError>(())
    })?;
    while numbers.len() < candidates.len() {
        numbers.push(None);
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::object_records::{ObjectRecords, SourceRecord};
    use crate::scene::scratch_scene::StoredObject;
    use crate::scene::{ObjectKind, Scene};
    use insula_objects::FeatureKind;

    /// A city of 8 x 8 leaves of 64 m; objects at places, some with a parent, and a building without a shape.
    fn city(objects: &[(u64, Option<u64>, [f32; 2])], parents: &[u64]) -> (ScratchScene, CityGrid) {
        let mut city = ScratchScene::from_scene(Scene::default()).unwrap();
        let mut records = ObjectRecords::Memory(Vec::new());
        let mut identity = |id_hash: u64, parent_hash| {
            let identifier = id_hash.to_string();
            let record = SourceRecord { identifier, kind: FeatureKind::Building, attributes: Vec::new() };
            ObjectIdentity { record: records.push(record), source: 0, id_hash, parent_hash }
        };
        city.parents = parents.iter().map(|hash| identity(*hash, None)).collect::<Vec<_>>().into();
        for (hash, parent, [x, y]) in objects {
            let bounds_m = [[*x, *y, 0.0], [x + 2.0, y + 2.0, 9.0]];
            let identity = Some(identity(*hash, *parent));
            city.objects.push(StoredObject { kind: ObjectKind::Building, base_z_m: 0.0, bounds_m, identity });
        }
        (city, CityGrid { corner: [0.0; 3], depth: 3, cell_m: 1.0 })
    }

    fn numbers(objects: &[(u64, Option<u64>, [f32; 2])], parents: &[u64], known: &[(u64, u32)]) -> ObjectNumbers {
        let (city, grid) = city(objects, parents);
        let known = known.iter().map(|(hash, number)| ((*hash, 0), *number)).collect();
        ObjectNumbers::new(&city, &grid, &known).unwrap()
    }

    #[test]
    fn objects_of_a_leaf_have_neighbouring_numbers() {
        let objects: Vec<_> = (0..640u64).map(|i| (i, None, [(i * 37 % 512) as f32, (i * 91 % 512) as f32])).collect();
        let found = numbers(&objects, &[], &[]);
        let mut of_leaf: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        for ((.., [x, y]), number) in objects.iter().zip(found.of_object.in_memory()) {
            of_leaf.entry([x, y].map(|at| ((at + 1.0) as u32 / 64).min(7))).or_default().push(*number);
        }
        for mut list in of_leaf.into_values() {
            list.sort_unstable();
            assert_eq!((list[list.len() - 1] - list[0]) as usize, list.len() - 1);
        }
        assert!(found.rows.in_memory().iter().all(Option::is_some) && found.rows.len() == 640);
    }

    #[test]
    fn parents_without_a_shape_precede_their_parts_and_unused_ones_have_no_number() {
        let objects = [(10, Some(1), [500.0, 500.0]), (11, Some(1), [10.0, 10.0]), (12, None, [10.0, 12.0])];
        let found = numbers(&objects, &[1, 2], &[]);
        assert_eq!(found.rows.len(), 4);
        let (rows, of_object) = (found.rows.in_memory(), found.of_object.in_memory());
        let first = rows[0].unwrap();
        assert_eq!((first.bounds_m, first.parent), (None, None));
        assert_eq!(of_object[1], 1);
        assert_eq!([0, 1].map(|i| rows[of_object[i] as usize].unwrap().parent), [Some(0); 2]);
    }

    #[test]
    fn an_object_without_triangles_has_a_number_only_as_a_parent() {
        let objects = [(11, None, [0.0; 2]), (10, Some(11), [1.0, 1.0]), (12, None, [0.0; 2])];
        let (mut city, grid) = city(&objects, &[]);
        for object in [0, 2] {
            let inverted = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
            city.objects.update(object, |object| object.bounds_m = inverted).unwrap();
        }
        let found = ObjectNumbers::new(&city, &grid, &HashMap::new()).unwrap();
        assert_eq!(found.of_object.in_memory(), [NO_OBJECT, 1, NO_OBJECT]);
        let rows = found.rows.in_memory();
        assert_eq!((rows[1].unwrap().parent, rows[0].unwrap().bounds_m), (Some(0), None));
    }

    #[test]
    fn known_objects_keep_their_numbers_and_new_ones_follow() {
        let objects = [(10, None, [1.0, 1.0]), (11, None, [300.0, 1.0]), (12, None, [300.0, 300.0])];
        let found = numbers(&objects, &[], &[(12, 0), (10, 4)]);
        assert_eq!(found.of_object.in_memory(), [4, 5, 0]);
        assert_eq!(
            found.rows.in_memory().iter().map(Option::is_some).collect::<Vec<_>>(),
            [true, false, false, false, true, true]
        );
    }
}
