//! Numbers of objects: along the Hilbert curve of the leaves, so that a leaf has few and near ones.
//!
//! From the objects of a city, where they stand, and the numbers of the city that is updated come a number for each object with a shape,
//! and a row for each number. An object without a shape gets a number if it is the parent of one with a number.

use std::collections::{HashMap, HashSet};

use insula_protocol::blockmap::NO_OBJECT;
use serde::{Deserialize, Serialize};

use super::{
    grid::CityGrid,
    object_records::RecordPlace,
    scratch_scene::{ObjectIdentity, ScratchScene},
};

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
    pub(crate) of_object: Vec<u32>,
    /// By number; `None` for numbers of objects that an update has removed.
    pub(crate) rows: Vec<Option<NumberedObject>>,
}

/// An identifier, and how many objects before had the same.
pub(crate) type IdentityKey = (u64, u32);

/// An object or a parent without a shape, while numbers are given.
struct NumberCandidate {
    identity: ObjectIdentity,
    bounds_m: Option<[[f32; 3]; 2]>,
    /// Index in the scene, if it has a shape.
    object: Option<usize>,
    /// Index of its parent among the candidates.
    parent: Option<usize>,
    /// Place on the curve.
    place: Option<u64>,
}

impl ObjectNumbers {
    /// Numbers all objects that have a record. `known` are the numbers of the city that is updated: its objects keep them, new ones
    /// follow.
    pub(crate) fn new(city: &ScratchScene, grid: &CityGrid, known: &HashMap<IdentityKey, u32>) -> Self {
        let mut candidates = candidates(city, grid);
        link_parents(&mut candidates);
        place_parents(&mut candidates);
        let mut order: Vec<usize> = (0..candidates.len()).filter(|i| candidates[*i].place.is_some()).collect();
        order.sort_by_key(|i| (candidates[*i].place, *i));
        let numbers = give_numbers(&candidates, &order, known);
        let mut out = Self { of_object: vec![NO_OBJECT; city.objects.len()], rows: Vec::new() };
        out.rows.resize(numbers.iter().flatten().map(|number| *number as usize + 1).max().unwrap_or(0), None);
        for (candidate, number) in candidates.iter().zip(&numbers) {
            let Some(number) = number else { continue };
            if let Some(object) = candidate.object {
                out.of_object[object] = *number;
            }
            let parent = candidate.parent.and_then(|parent| numbers[parent]);
            let (record, bounds_m) = (candidate.identity.record, candidate.bounds_m);
            out.rows[*number as usize] = Some(NumberedObject { record, parent, bounds_m });
        }
        out
    }
}

fn candidates(city: &ScratchScene, grid: &CityGrid) -> Vec<NumberCandidate> {
    let with_shape = city.objects.iter().enumerate().filter_map(|(i, object)| {
        let identity = object.identity?;
        // The bounds of an object without triangles are inverted. It gets a number only as a parent.
        let bounds_m = Some(object.bounds_m).filter(|[low, high]| (0..3).all(|axis| low[axis] <= high[axis]));
        let place = bounds_m.map(|bounds_m| place_of(bounds_m, grid));
        Some(NumberCandidate { identity, bounds_m, object: bounds_m.map(|_| i), parent: None, place })
    });
    let parents = city.parents.iter().map(|identity| NumberCandidate {
        identity: *identity,
        bounds_m: None,
        object: None,
        parent: None,
        place: None,
    });
    let mut all: Vec<NumberCandidate> = with_shape.chain(parents).collect();
    // In the order of the sources: a parent precedes its parts.
    all.sort_by_key(|candidate| candidate.identity.record);
    all
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

/// Finds each candidate's parent: in its own source, else in any. An object is not its own parent.
fn link_parents(candidates: &mut [NumberCandidate]) {
    // Only those that are parents: most cities have none, and a country has millions of others.
    let wanted: HashSet<u64> = candidates.iter().filter_map(|candidate| candidate.identity.parent_hash).collect();
    let (mut in_source, mut anywhere) = (HashMap::new(), HashMap::new());
    for (i, candidate) in candidates.iter().enumerate() {
        let ObjectIdentity { source, id_hash, .. } = candidate.identity;
        if !wanted.contains(&id_hash) {
            continue;
        }
        in_source.entry((source, id_hash)).or_insert(i);
        anywhere.entry(id_hash).or_insert(i);
    }
    for i in 0..candidates.len() {
        let ObjectIdentity { source, parent_hash, .. } = candidates[i].identity;
        let Some(hash) = parent_hash else { continue };
        let found = in_source.get(&(source, hash)).or_else(|| anywhere.get(&hash));
        candidates[i].parent = found.copied().filter(|parent| *parent != i);
    }
}

/// Gives parents without a shape the first place of their parts. Chains of parents are followed to a limited depth.
fn place_parents(candidates: &mut [NumberCandidate]) {
    const MAX_DEPTH: usize = 8;
    for i in 0..candidates.len() {
        let Some(place) = candidates[i].place.filter(|_| candidates[i].object.is_some()) else { continue };
        let mut next = candidates[i].parent;
        for _ in 0..MAX_DEPTH {
            let Some(parent) = next else { break };
            if candidates[parent].object.is_none() {
                let first = candidates[parent].place.map_or(place, |known| known.min(place));
                candidates[parent].place = Some(first);
            }
            next = candidates[parent].parent;
        }
    }
}

/// The number of each candidate, those of `order` in this order. Known objects keep theirs.
fn give_numbers(
    candidates: &[NumberCandidate],
    order: &[usize],
    known: &HashMap<IdentityKey, u32>,
) -> Vec<Option<u32>> {
    let mut numbers = vec![None; candidates.len()];
    let mut next = known.values().max().map_or(0, |last| last + 1);
    // Occurrences are counted in the order of the numbers, as a reader of the city counts them.
    let mut occurrences: HashMap<u64, u32> = HashMap::new();
    for &i in order {
        let hash = candidates[i].identity.id_hash;
        let count = occurrences.entry(hash).or_default();
        numbers[i] = Some(known.get(&(hash, *count)).copied().unwrap_or_else(|| {
            next += 1;
            next - 1
        }));
        *count += 1;
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{
        ObjectKind, Scene,
        object_records::{ObjectRecords, SourceRecord},
        scratch_scene::StoredObject,
    };
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
        city.parents = parents.iter().map(|hash| identity(*hash, None)).collect();
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
        ObjectNumbers::new(&city, &grid, &known)
    }

    #[test]
    fn objects_of_a_leaf_have_neighbouring_numbers() {
        let objects: Vec<_> = (0..640u64).map(|i| (i, None, [(i * 37 % 512) as f32, (i * 91 % 512) as f32])).collect();
        let found = numbers(&objects, &[], &[]);
        let mut of_leaf: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        for ((.., [x, y]), number) in objects.iter().zip(&found.of_object) {
            of_leaf.entry([x, y].map(|at| ((at + 1.0) as u32 / 64).min(7))).or_default().push(*number);
        }
        for mut list in of_leaf.into_values() {
            list.sort_unstable();
            assert_eq!((list[list.len() - 1] - list[0]) as usize, list.len() - 1);
        }
        assert!(found.rows.iter().all(Option::is_some) && found.rows.len() == 640);
    }

    #[test]
    fn parents_without_a_shape_precede_their_parts_and_unused_ones_have_no_number() {
        let objects = [(10, Some(1), [500.0, 500.0]), (11, Some(1), [10.0, 10.0]), (12, None, [10.0, 12.0])];
        let found = numbers(&objects, &[1, 2], &[]);
        assert_eq!(found.rows.len(), 4);
        let first = found.rows[0].unwrap();
        assert_eq!((first.bounds_m, first.parent), (None, None));
        assert_eq!(found.of_object[1], 1);
        assert_eq!([0, 1].map(|i| found.rows[found.of_object[i] as usize].unwrap().parent), [Some(0); 2]);
    }

    #[test]
    fn an_object_without_triangles_has_a_number_only_as_a_parent() {
        let objects = [(11, None, [0.0; 2]), (10, Some(11), [1.0, 1.0]), (12, None, [0.0; 2])];
        let (mut city, grid) = city(&objects, &[]);
        for object in [0, 2] {
            city.objects[object].bounds_m = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        }
        let found = ObjectNumbers::new(&city, &grid, &HashMap::new());
        assert_eq!(found.of_object, [NO_OBJECT, 1, NO_OBJECT]);
        assert_eq!(found.rows[1].unwrap().parent, Some(0));
        assert_eq!(found.rows[0].unwrap().bounds_m, None);
    }

    #[test]
    fn known_objects_keep_their_numbers_and_new_ones_follow() {
        let objects = [(10, None, [1.0, 1.0]), (11, None, [300.0, 1.0]), (12, None, [300.0, 300.0])];
        let found = numbers(&objects, &[], &[(12, 0), (10, 4)]);
        assert_eq!(found.of_object, [4, 5, 0]);
        assert_eq!(found.rows.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, false, false, true, true]);
    }
}
