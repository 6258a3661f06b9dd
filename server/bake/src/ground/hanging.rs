//! Objects above others: decks on piers, roofs on posts, upper parts of buildings, houses over tunnels. Only one of both stands on
//! the ground: the lower one, unless the feet around tell that it is buried.

use super::grid::GroundGrid;
use super::low_foot::{LOWEST_M, LowFoot, MAX_WALL_NORMAL_Z, median_around};
use crate::error::BakeError;
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::{ObjectKind, SceneTriangle};
use glam::{Vec2, Vec3, Vec3Swizzles};
use std::collections::{HashMap, HashSet};

/// Least height above the foot of what is below.
const HANGING_M: f32 = 2.0;
/// How far what is below may reach into what is above it.
const INTO_M: f32 = 0.5;
/// Surfaces this far above the lowest point of their object are tops on which others may stand.
const TOP_M: f32 = 0.3;

/// What is above something else, or below the ground.
#[derive(Debug, Default)]
pub(super) struct InAir {
    /// The objects without feet on the ground: they hang in the air, or are buried.
    pub(super) objects: HashSet<u32>,
    /// Objects that stand on others. Not known, and empty, where nothing is over another object.
    pub(super) on_others: HashSet<u32>,
}

/// An object over the lowest foot of a square.
#[derive(Debug, Clone, Copy)]
struct Over {
    object: u32,
    square: u32,
    /// Height of its lowest surface there.
    z_m: f32,
}

/// Finds the objects whose lowest surfaces lie over the lowest foot of a square, where that foot's wall ends below them. `lowest`
/// has the lowest foot of each square. Fails if the triangles cannot be read.
pub(super) fn find(city: &ScratchScene, grid: &GroundGrid, lowest: &[LowFoot]) -> Result<InAir, BakeError> {
    let mut overs = Vec::new();
    for_each_surface(city, |surface, base_m| {
        if surface.highest_m() <= base_m + LOWEST_M {
            surface.for_each_square(grid, |square| overs.extend(surface.over(square as u32, &lowest[square])));
        }
    })?;
    if overs.is_empty() {
        return Ok(InAir::default());
    }
    let on_others = standing_on_others(city, grid)?;
    let involved: HashSet<u32> =
        overs.iter().flat_map(|over| [over.object, lowest[over.square as usize].object]).collect();
    let is_evidence =
        |foot: &LowFoot| foot.is_sure() && !involved.contains(&foot.object) && !on_others.contains(&foot.object);
    let mut streets_m = HashMap::new();
    let mut is_street_below = |over: &Over| {
        let street_m = *streets_m
            .entry(over.square)
            .or_insert_with(|| median_around(lowest, grid, over.square as usize, is_evidence));
        let foot_m = lowest[over.square as usize].z_m;
        street_m.is_none_or(|street_m| (street_m - foot_m).abs() <= (street_m - over.z_m).abs())
    };
    let mut objects: HashSet<u32> = overs.iter().filter(|over| is_street_below(over)).map(|over| over.object).collect();
    let under = |over: &Over| lowest[over.square as usize].object;
    let (hanging, standing): (Vec<Over>, Vec<Over>) =
        overs.iter().copied().partition(|over| objects.contains(&over.object));
    let on_ground: HashSet<u32> = hanging.iter().map(under).collect();
    objects.extend(standing.iter().map(under).filter(|object| !on_ground.contains(object)));
    Ok(InAir { objects, on_others })
}

/// The objects whose lowest surfaces lie over the lowest top in the middle of a square.
fn standing_on_others(city: &ScratchScene, grid: &GroundGrid) -> Result<HashSet<u32>, BakeError> {
    let mut tops = vec![(f32::INFINITY, 0); grid.len()];
    for_each_surface(city, |surface, base_m| {
        surface.for_each_square(grid, |square| {
            let height_m = surface.height_at(middle_of(grid, square));
            if let Some(z) = height_m.filter(|z| *z > base_m + TOP_M && *z < tops[square].0) {
                tops[square] = (z, surface.object);
            }
        });
    })?;
    let mut found = HashSet::new();
    for_each_surface(city, |surface, base_m| {
        if surface.highest_m() <= base_m + LOWEST_M {
            surface.for_each_square(grid, |square| {
                let (top_m, object) = tops[square];
                let height_m = surface.height_at(middle_of(grid, square));
                if object != surface.object && height_m.is_some_and(|z| top_m <= z + INTO_M) {
                    found.insert(surface.object);
                }
            });
        }
    })?;
    Ok(found)
}

fn middle_of(grid: &GroundGrid, square: usize) -> Vec2 {
    let [x, y] = grid.place(square);
    let half_m = grid.step_m / 2.0;
    Vec2::from(grid.position(x, y).map(|v| (v + half_m) as f32))
}

/// Calls `visit` for all triangles that are no walls of what may stand on the ground, with the lowest point of their objects.
fn for_each_surface(city: &ScratchScene, mut visit: impl FnMut(&FlatTriangle, f32)) -> Result<(), BakeError> {
    let mut objects = city.objects.cursor();
    city.try_for_each(|triangle| {
        let Some(surface) = FlatTriangle::of(triangle) else { return Ok(()) };
        let object = objects.get(triangle.object as usize)?;
        if object.kind == ObjectKind::Building && !city.standing.contains(&triangle.object) {
            visit(&surface, object.base_z_m);
        }
        Ok(())
    })
}

/// A triangle that is no wall.
struct FlatTriangle {
    corners: [Vec3; 3],
    normal: Vec3,
    object: u32,
}

impl FlatTriangle {
    fn of(triangle: &SceneTriangle) -> Option<Self> {
        let corners @ [a, b, c] = triangle.corners.map(Vec3::from_array);
        let normal = (b - a).cross(c - a);
        let is_wall = normal.z.abs() <= MAX_WALL_NORMAL_Z * normal.length();
        (!is_wall).then_some(Self { corners, normal, object: triangle.object })
    }

    fn highest_m(&self) -> f32 {
        let [a, b, c] = self.corners;
        a.z.max(b.z).max(c.z)
    }

    /// Calls `visit` for the squares that its box touches.
    fn for_each_square(&self, grid: &GroundGrid, mut visit: impl FnMut(usize)) {
        let [a, b, c] = self.corners;
        let [[x0, y0], [x1, y1]] =
            [a.min(b).min(c), a.max(b).max(c)].map(|corner| grid.square(corner.x.into(), corner.y.into()));
        (y0..=y1).for_each(|y| (x0..=x1).for_each(|x| visit(grid.index(x, y))));
    }

    /// Height at a place on the map; `None` outside of it.
    fn height_at(&self, p: Vec2) -> Option<f32> {
        let [a, b, c] = self.corners;
        let side = |from: Vec3, to: Vec3| (to.xy() - from.xy()).perp_dot(p - from.xy());
        let sides = [side(a, b), side(b, c), side(c, a)];
        let is_within = sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
        let n = self.normal;
        is_within.then(|| a.z - (n.x * (p.x - a.x) + n.y * (p.y - a.y)) / n.z)
    }

    /// As what is over the lowest foot of a square, if it is.
    fn over(&self, square: u32, foot: &LowFoot) -> Option<Over> {
        let z_m = self.height_at(foot.behind.into())?;
        let is_over = foot.object != self.object && foot.z_m < z_m - HANGING_M && foot.wall_top_m <= z_m + INTO_M;
        is_over.then_some(Over { object: self.object, square, z_m })
    }
}

#[cfg(test)]
mod tests {
    use crate::ground::standing::height_at;
    use crate::ground::{GroundGrid, HeightSteps, Surface, mesh};
    use crate::scene::scratch_scene::ScratchScene;
    use crate::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};

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

    #[test]
    fn ground_does_not_fall_to_what_is_buried_under_houses() {
        let houses: Vec<Cuboid> =
            (0..16).map(|i| sized([18.0 * (i % 4) as f32, 18.0 * (i / 4) as f32, 0.0], [12.0, 12.0, 9.0])).collect();
        let tunnel = sized([38.0, -10.0, -14.0], [8.0, 100.0, 6.0]);
        let mut groups: Vec<Vec<Cuboid>> = houses.iter().map(|house| vec![*house]).collect();
        groups.push(vec![tunnel]);
        let low = highest_ground(&groups, &houses[8..12]);
        assert!((-0.1..=0.1).contains(&low), "{low}");
        let place = [sized([42.0, 30.0, 0.0], [0.1, 0.1, 0.0])];
        let over = highest_ground(&groups, &place);
        assert!((-0.1..=0.1).contains(&over), "{over}");
    }

    #[test]
    fn ground_does_not_rise_to_a_slab_with_nothing_below() {
        let slab = sized([40.0, 40.0, 9.0], [30.0, 20.0, 1.0]);
        let houses = [0.0, 110.0].map(|at| sized([at, at, 0.0], [6.0, 6.0, 5.0]));
        for groups in groupings(&[houses[0], houses[1], slab]) {
            let high = highest_ground(&groups, &[houses[0], houses[1], slab]);
            assert!(high <= 0.1, "{high} of {} objects", groups.len());
        }
    }
}
