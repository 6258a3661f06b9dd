//! What blocks need to know of objects. Each block asks for its own objects, and a city has tens of millions.

use super::ObjectKind;
use crate::error::BakeError;
use insula_protocol::blockmap::NO_OBJECT;
use insula_scratch::record_list::RecordList;
use serde::{Deserialize, Serialize};

/// What a block needs to know of an object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct BlockObjectFacts {
    pub(crate) kind: ObjectKind,
    /// Height of the lowest vertex in metres above the scene's origin.
    pub(crate) base_z_m: f32,
    /// Number in the baked city; [`NO_OBJECT`] for generated ground.
    pub(crate) number: u32,
}

/// Those of some objects, in the order in which these are given. Fails if there is no such object, or if the list cannot be read.
pub(crate) fn facts_of(
    all: &RecordList<BlockObjectFacts>,
    objects: &[u32],
) -> Result<Vec<BlockObjectFacts>, BakeError> {
    // Neighbours in a source often are neighbours in the city: in the order of the list, they share its pages.
    let mut order: Vec<usize> = (0..objects.len()).collect();
    order.sort_unstable_by_key(|place| objects[*place]);
    let nothing = BlockObjectFacts { kind: ObjectKind::Building, base_z_m: 0.0, number: NO_OBJECT };
    let mut found = vec![nothing; objects.len()];
    for place in order {
        found[place] = all.get(objects[place] as usize)?;
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_scratch::record_list::RecordScratch;
    use insula_test_support::folder::TestFolder;
    use insula_test_support::rng::Rng;

    #[test]
    fn objects_are_found_in_any_order_in_memory_and_in_a_file() {
        let folder = TestFolder::new("object-facts");
        let kinds = [ObjectKind::Building, ObjectKind::Terrain, ObjectKind::GeneratedGround];
        let object = |i: u32| BlockObjectFacts {
            kind: kinds[i as usize % 3],
            base_z_m: i as f32 * -0.5,
            number: NO_OBJECT - 7 * i,
        };
        for scratch in [RecordScratch::default(), RecordScratch::in_folder(&folder.path)] {
            let mut all = RecordList::new(&scratch);
            (0..10_000).for_each(|i| all.push(object(i)));
            let mut rng = Rng::new(5);
            for count in [0, 1, 5, 300] {
                let wanted: Vec<u32> = (0..count).map(|_| rng.below(10_000) as u32).chain([9999, 0, 0]).collect();
                let expected: Vec<BlockObjectFacts> = wanted.iter().map(|i| object(*i)).collect();
                assert_eq!(facts_of(&all, &wanted).unwrap(), expected);
            }
            assert!(facts_of(&all, &[3, 10_000]).is_err());
        }
    }
}
