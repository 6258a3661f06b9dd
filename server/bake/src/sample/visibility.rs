//! Which crossings and surfels are visible from outside: space carving with visibility maps (Vacca 2008, 3.4.1).
//!
//! A map is drawn for each direction, and every crossing and surfel that still needs a result is tested against it. The
//! directions come in three passes:
//!
//! 1. The first sky directions. All crossings and all surfels are tested until they have been visible.
//! 2. Directions below the horizon, for undersides and what stands under them. They are skipped if the block has none.
//! 3. The remaining sky directions, only for the occlusion of surfels that have been visible. The others lie inside of
//!    something and are dropped before.
//!
//! The share of the sky from which a surfel is visible is its ambient occlusion.

use super::crossings::{Crossing, Crossings, SURE_WEIGHT, UNSURE_WEIGHT};
use super::directions;
use super::floor::{Floor, WaysOut};
use super::ground::LocalGround;
use super::local_block::{LocalBlock, LocalTriangle, MIN_TOP_NORMAL_Z};
use super::settings::SampleSettings;
use super::surfels::{SKY_SUBSETS, Surfel};
use super::visibility_map::VisibilityMap;
use glam::Vec3;

/// Number of sky directions of the first pass.
const FIRST_SKY_DIRECTIONS: usize = 48;
/// Number of directions, in either of the first two passes, after which a back that was never visible is not tested
/// further.
const BACK_DIRECTIONS: usize = 16;

/// Counts from where the block's crossings, surfels and generated ground are visible, and drops surfels that never are.
pub(super) fn find_sightings(
    block: &LocalBlock,
    floor: &Floor,
    settings: &SampleSettings,
    crossings: &mut Crossings,
    surfels: &mut Vec<Surfel>,
    mut ground: Option<&mut LocalGround>,
) {
    let sky = directions::sky(settings.sky_directions);
    let (first, rest) = sky.split_at(FIRST_SKY_DIRECTIONS.min(sky.len()));
    let mut tests = VisibilityTests {
        block,
        map: VisibilityMap::new(settings.visibility),
        ways_out: None,
        groups: group_by_triangle(surfels),
    };
    let mut pending: Vec<u32> =
        (0..crossings.list.len() as u32).filter(|i| crossings.list[*i as usize].is_pending()).collect();
    for (i, direction) in first.iter().enumerate() {
        tests.map.draw(block, *direction);
        tests.test_crossings(crossings, &mut pending);
        let pass =
            SurfelTest { sky_subset: Some(i % SKY_SUBSETS), tests_unseen: true, tests_backs: i < BACK_DIRECTIONS };
        tests.test_surfels(surfels, pass);
        tests.test_ground(ground.as_deref_mut());
    }
    let has_undersides = block.triangles.iter().any(|triangle| may_have_space_below(block, floor, triangle));
    if has_undersides || !pending.is_empty() {
        for (i, direction) in directions::below_horizon(settings.low_directions).iter().enumerate() {
            tests.map.draw(block, *direction);
            tests.ways_out = Some(floor.ways_out(*direction));
            tests.test_crossings(crossings, &mut pending);
            if has_undersides {
                let pass = SurfelTest { sky_subset: None, tests_unseen: true, tests_backs: i < BACK_DIRECTIONS };
                tests.test_surfels(surfels, pass);
            }
        }
    }
    tests.ways_out = None;
    surfels.retain(Surfel::is_visible);
    tests.groups = group_by_triangle(surfels);
    for (i, direction) in rest.iter().enumerate() {
        tests.map.draw(block, *direction);
        let sky_subset = Some((FIRST_SKY_DIRECTIONS + i) % SKY_SUBSETS);
        tests.test_surfels(surfels, SurfelTest { sky_subset, tests_unseen: false, tests_backs: false });
        tests.test_ground(ground.as_deref_mut());
    }
}

/// Whether a viewer may see the triangle from below, or something under it.
fn may_have_space_below(block: &LocalBlock, floor: &Floor, triangle: &LocalTriangle) -> bool {
    let is_above_foot = || triangle.lowest_m() > triangle.object_bottom_m + 1.5 * block.cell_m;
    let is_in_air = || is_above_foot() || floor.is_below(triangle);
    !triangle.is_terrain && (!triangle.is_closed || (triangle.normal.z < -0.1 && is_in_air()))
}

#[derive(Debug)]
struct TriangleSurfels {
    /// Index into the block's triangles.
    triangle: u32,
    /// Index of the first surfel of each sky subset, and the end of the last.
    starts: [u32; SKY_SUBSETS + 1],
    /// Whether there are surfels whose front (or back) has not been visible yet.
    has_unseen: [bool; 2],
}

fn group_by_triangle(surfels: &[Surfel]) -> Vec<TriangleSurfels> {
    let mut begin = 0;
    let groups = surfels.chunk_by(|a, b| a.triangle == b.triangle).map(|group| {
        let start = |subset: usize| begin + group.partition_point(|s| usize::from(s.sky_subset) < subset) as u32;
        let starts = std::array::from_fn(start);
        begin += group.len() as u32;
        TriangleSurfels { triangle: group[0].triangle, starts, has_unseen: [true; 2] }
    });
    groups.collect()
}

/// Which surfels are tested against a direction.
#[derive(Debug, Clone, Copy)]
struct SurfelTest {
    /// The subset of the sky that the direction belongs to; `None` for a direction below the horizon.
    sky_subset: Option<usize>,
    /// Whether surfels of other subsets are tested as long as they have not been visible.
    tests_unseen: bool,
    /// Whether this includes backs.
    tests_backs: bool,
}

/// The map of the current direction, and the surfels that it is tested against.
struct VisibilityTests<'a> {
    block: &'a LocalBlock,
    map: VisibilityMap,
    /// For a direction below the horizon.
    ways_out: Option<WaysOut<'a>>,
    groups: Vec<TriangleSurfels>,
}

impl VisibilityTests<'_> {
    fn test_ground(&self, ground: Option<&mut LocalGround>) {
        if let Some(ground) = ground {
            ground.add_direction(self.block, &self.map);
        }
    }

    /// Tests the `pending` crossings and removes those that need no more sightings.
    fn test_crossings(&self, crossings: &mut Crossings, pending: &mut Vec<u32>) {
        pending.retain(|i| {
            let crossing = crossings.list[*i as usize];
            let sighting = self.crossing_sighting(&crossing, crossings.position(&crossing));
            let crossing = &mut crossings.list[*i as usize];
            if let Some((from_above, weight)) = sighting {
                crossing.add_sighting(from_above, weight);
            }
            crossing.is_pending()
        });
    }

    /// Whether the crossing is seen from above, and the weight of the sighting; `None` if it is not visible.
    fn crossing_sighting(&self, crossing: &Crossing, position: Vec3) -> Option<(bool, u8)> {
        let triangle = &self.block.triangles[crossing.triangle as usize];
        let direction = self.map.direction();
        let up = if triangle.normal.z > 0.0 { triangle.normal } else { -triangle.normal };
        let from_above = up.dot(direction) > 0.0;
        let is_tested = crossing.needs_sightings(from_above)
            && (from_above || self.ways_out.as_ref().is_none_or(|ways| ways.lead_from(position)));
        let normal = if from_above { up } else { -up };
        if !is_tested || !self.map.is_visible(self.block, position, normal, crossing.triangle) {
            return None;
        }
        let is_sure = from_above || self.map.shows_surface(self.block, position, triangle);
        Some((from_above, if is_sure { SURE_WEIGHT } else { UNSURE_WEIGHT }))
    }

    fn test_surfels(&mut self, surfels: &mut [Surfel], test: SurfelTest) {
        let (block, map, ways_out) = (self.block, &self.map, self.ways_out.as_ref());
        for group in &mut self.groups {
            let triangle = &block.triangles[group.triangle as usize];
            // Tops are visible from the sky. Directions below the horizon are for undersides, and walls under roofs.
            if test.sky_subset.is_none() && (triangle.is_terrain || triangle.normal.z > MIN_TOP_NORMAL_Z) {
                continue;
            }
            let cos = triangle.normal.dot(map.direction());
            let side = usize::from(cos < 0.0);
            if side == 1 && (triangle.is_terrain || triangle.is_closed) {
                continue;
            }
            let normal = if side == 1 { -triangle.normal } else { triangle.normal };
            let index = group.triangle;
            let is_visible = |surfel: &Surfel| {
                ways_out.is_none_or(|ways| ways.lead_from(surfel.position))
                    && map.is_visible(block, surfel.position, normal, index)
            };
            if test.tests_unseen && group.has_unseen[side] && (side == 0 || test.tests_backs) {
                let all = &mut surfels[group.starts[0] as usize..group.starts[SKY_SUBSETS] as usize];
                group.has_unseen[side] = test_unseen(all, side, test.sky_subset, is_visible);
            }
            let Some(subset) = test.sky_subset else { continue };
            let of_subset = &mut surfels[group.starts[subset] as usize..group.starts[subset + 1] as usize];
            for surfel in of_subset {
                let is_given_up = side == 1 && surfel.sightings[1] == 0 && !test.tests_backs;
                if !is_given_up && is_visible(surfel) {
                    surfel.sightings[side] += 1;
                    surfel.sky_cosines[side] += cos.abs();
                }
            }
        }
    }
}

/// Tests the surfels of a triangle that have not been visible yet, except those of `own_subset`, which are tested
/// anyway. Returns whether there are still some that have not been visible.
fn test_unseen(
    surfels: &mut [Surfel],
    side: usize,
    own_subset: Option<usize>,
    is_visible: impl Fn(&Surfel) -> bool,
) -> bool {
    let mut has_unseen = false;
    for surfel in surfels.iter_mut().filter(|surfel| surfel.sightings[side] == 0) {
        let is_tested_anyway = own_subset == Some(usize::from(surfel.sky_subset));
        if !is_tested_anyway && is_visible(surfel) {
            surfel.sightings[side] += 1;
        }
        has_unseen |= surfel.sightings[side] == 0;
    }
    has_unseen
}
