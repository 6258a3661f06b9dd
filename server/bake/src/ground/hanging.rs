//! Objects that hang over others: decks on piers, roofs on posts, upper parts of buildings. The ground is not at their feet.

use std::collections::HashSet;

use glam::{Vec2, Vec3, Vec3Swizzles};

use super::{
    feet::{LOWEST_M, LowFoot, MAX_WALL_NORMAL_Z},
    grid::GroundGrid,
};
use crate::{
    error::BakeError,
    scene::{ObjectKind, SceneTriangle, scratch_scene::ScratchScene},
};

/// Least height above the foot of what is below.
const HANGING_M: f32 = 2.0;
/// How far the walls below may reach into what hangs over them.
const INTO_M: f32 = 0.5;

/// The objects whose lowest surfaces lie over the lowest foot of a square, where that foot's wall ends below them. `lowest` has
/// the lowest foot of each square. Fails if the triangles cannot be read.
pub(super) fn find(city: &ScratchScene, grid: &GroundGrid, lowest: &[LowFoot]) -> Result<HashSet<u32>, BakeError> {
    let mut found = HashSet::new();
    let mut objects = city.objects.cursor();
    city.try_for_each(|triangle| {
        if found.contains(&triangle.object) {
            return Ok(());
        }
        let object = objects.get(triangle.object as usize)?;
        let is_solid = object.kind == ObjectKind::Building && !city.standing.contains(&triangle.object);
        if is_solid && is_over_a_foot(triangle, object.base_z_m, grid, lowest) {
            found.insert(triangle.object);
        }
        Ok(())
    })?;
    Ok(found)
}

fn is_over_a_foot(triangle: &SceneTriangle, base_m: f32, grid: &GroundGrid, lowest: &[LowFoot]) -> bool {
    let [a, b, c] = triangle.corners.map(Vec3::from_array);
    let normal = (b - a).cross(c - a);
    let is_wall = normal.z.abs() <= MAX_WALL_NORMAL_Z * normal.length();
    if is_wall || a.z.max(b.z).max(c.z) > base_m + LOWEST_M {
        return false;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let ([x0, y0], [x1, y1]) = (grid.square(low.x.into(), low.y.into()), grid.square(high.x.into(), high.y.into()));
    let is_below = |foot: &LowFoot| {
        let p = Vec2::from(foot.behind);
        let side = |from: Vec3, to: Vec3| (to.xy() - from.xy()).perp_dot(p - from.xy());
        let sides = [side(a, b), side(b, c), side(c, a)];
        let is_within = sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
        let z = a.z - (normal.x * (p.x - a.x) + normal.y * (p.y - a.y)) / normal.z;
        is_within && foot.object != triangle.object && foot.z_m < z - HANGING_M && foot.wall_top_m <= z + INTO_M
    };
    (y0..=y1).any(|y| (x0..=x1).any(|x| is_below(&lowest[grid.index(x, y)])))
}

#[cfg(test)]
mod tests {
    use crate::{
        ground::{GroundGrid, HeightSteps, Surface, mesh, standing::height_at},
        scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle, scratch_scene::ScratchScene},
    };

    type Cuboid = [[f32; 3]; 2];

    /// A city of boxes; those of a group are one object.
    fn city(groups: &[Vec<Cuboid>]) -> ScratchScene {
        const FACES: [[usize; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]];
        let materials = vec![Material { rgb: [0; 3], texture: None, is_reflective: false }];
        let mut scene = Scene { materials, ..Scene::default() };
        for (object, boxes) in groups.iter().enumerate() {
            let base_z_m = boxes.iter().map(|[low, _]| low[2]).fold(f32::INFINITY, f32::min);
            scene.objects.push(SceneObject { id: object.to_string(), kind: ObjectKind::Building, base_z_m });
            for ([low, high], [a, b, c, d]) in boxes.iter().flat_map(|one| FACES.map(|face| (one, face))) {
                let corner = |i: usize| std::array::from_fn(|axis| [low, high][i >> axis & 1][axis]);
                for face in [[a, b, c], [a, c, d]] {
                    let (corners, object) = (face.map(corner), object as u32);
                    scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object });
                }
            }
        }
        ScratchScene::from_scene(scene).unwrap()
    }

    /// The highest generated ground at the corners and in the middle of boxes.
    fn highest_ground(groups: &[Vec<Cuboid>], boxes: &[Cuboid]) -> f32 {
        let city = city(groups);
        let [min, max] = city.bounds.unwrap();
        let grid = GroundGrid::covering(min, max, city.origin, 64.0).unwrap();
        let steps = HeightSteps { step_m: 1.0 / 16.0, origin_m: 0.0 };
        let surface = Surface::build(&city, &grid, steps).unwrap().unwrap();
        let triangles = mesh::triangulate(&grid, &surface.field, &surface.range(), surface.plane_m);
        let places = boxes.iter().flat_map(|[low, high]| {
            [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.5]]
                .map(|share: [f32; 2]| [0, 1].map(|axis| low[axis] + share[axis] * (high[axis] - low[axis])))
        });
        places
            .flat_map(|at| triangles.iter().filter_map(move |corners| height_at(corners, at)))
            .fold(f32::MIN, f32::max)
    }

    /// A box from `[west, south, bottom]` of a size.
    fn sized(low: [f32; 3], size: [f32; 3]) -> Cuboid {
        [low, std::array::from_fn(|axis| low[axis] + size[axis])]
    }

    /// As many objects as boxes, and one object of all.
    fn groupings(boxes: &[Cuboid]) -> [Vec<Vec<Cuboid>>; 2] {
        [boxes.iter().map(|one| vec![*one]).collect(), vec![boxes.to_vec()]]
    }

    #[test]
    fn ground_does_not_rise_to_a_bridge_over_a_kiosk() {
        let kiosk = sized([50.0, 45.0, 0.0], [20.0, 10.0, 3.0]);
        let piers = [21.0, 78.0].map(|y| sized([58.0, y, 0.0], [4.0, 1.5, 6.0]));
        let deck = sized([55.0, 20.0, 6.0], [10.0, 60.0, 1.0]);
        let far = [0.0, 120.0].map(|at| sized([at, at, 0.0], [1.0, 1.0, 1.0]));
        for mut groups in groupings(&[deck, piers[0], piers[1]]) {
            groups.extend([vec![kiosk], vec![far[0]], vec![far[1]]]);
            let high = highest_ground(&groups, &[kiosk, piers[0], piers[1], deck]);
            assert!(high <= 0.1, "{high}");
        }
    }

    #[test]
    fn ground_does_not_rise_to_a_roof_on_posts_or_an_elevated_railway() {
        let roof = sized([0.0, 0.0, 5.0], [30.0, 20.0, 0.5]);
        let posts =
            [[0.0, 0.0], [29.6, 0.0], [0.0, 19.6], [29.6, 19.6]].map(|[x, y]| sized([x, y, 0.0], [0.4, 0.4, 5.0]));
        let mut pavilion = posts.to_vec();
        pavilion.push(roof);
        let spans = (0..8).map(|i| sized([40.0 * i as f32, 60.0, 8.0], [40.0, 9.0, 1.2]));
        let piers = (0..9).map(|i| sized([(40.0 * i as f32 - 1.0).max(0.0), 63.0, 0.0], [2.0, 3.0, 8.0]));
        let railway: Vec<Cuboid> = spans.chain(piers).collect();
        for boxes in [pavilion, railway] {
            for groups in groupings(&boxes) {
                let high = highest_ground(&groups, &boxes);
                assert!(high <= 0.1, "{high} of {} objects", groups.len());
            }
        }
    }

    #[test]
    fn ground_of_a_pier_with_houses_is_that_of_its_piles() {
        let mut boxes = vec![sized([0.0, 0.0, 4.0], [100.0, 60.0, 1.0])];
        let grid =
            |n: [usize; 2], step: f32| (0..n[0] * n[1]).map(move |i| [i % n[0], i / n[0]].map(|k| k as f32 * step));
        boxes.extend(grid([11, 7], 9.9).map(|[x, y]| sized([x.min(99.4), y.min(59.4), -3.0], [0.6, 0.6, 7.0])));
        boxes.extend(grid([6, 4], 15.0).map(|[x, y]| sized([x + 4.0, y + 3.0, 5.0], [8.0, 8.0, 6.0])));
        for groups in groupings(&boxes) {
            let high = highest_ground(&groups, &boxes);
            assert!(high <= -2.9, "{high} of {} objects", groups.len());
        }
    }

    #[test]
    fn hillside_houses_are_not_taken_for_hanging_ones() {
        // Each house stands at the foot of the next one, whose floor is above its roof.
        let houses: Vec<Vec<Cuboid>> =
            (0..6).map(|i| vec![sized([10.0 * i as f32, 0.0, 3.0 * i as f32], [10.0, 12.0, 2.8])]).collect();
        let city = city(&houses);
        let [min, max] = city.bounds.unwrap();
        let grid = GroundGrid::covering(min, max, city.origin, 64.0).unwrap();
        let feet = crate::ground::feet::find(&city, &grid).unwrap();
        let known = || (0..grid.len()).filter(|i| feet.low[*i] <= feet.high[*i]);
        assert_eq!(known().map(|i| feet.high[i]).fold(f32::MIN, f32::max), 15.0);
    }
}
