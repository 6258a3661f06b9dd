//! Ground beside given terrain, which must not cover its edge, nor lie far below it.

use super::UNDER_TERRAIN_M;
use super::grid::GroundGrid;

/// Steeper terrain, in metres per metre of a step, is a wall and does not go on.
const MAX_SLOPE: f64 = 1.0;
/// Directions to the neighbours of a vertex.
const NEIGHBOURS: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// Heights of vertices without terrain that have some beside them: below where the terrain would go on, as it ends somewhere on the
/// way there.
pub(super) fn beside(grid: &GroundGrid, terrain: &[f32]) -> Vec<Option<f32>> {
    let given = |[x, y]: [usize; 2], [dx, dy]: [isize; 2]| {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        let is_within = x < grid.size[0] && y < grid.size[1];
        is_within.then(|| terrain[grid.index(x, y)]).filter(|z| z.is_finite())
    };
    let height = |i: usize| {
        let place = grid.place(i);
        let going_on = NEIGHBOURS.into_iter().filter_map(|[dx, dy]| {
            let near = given(place, [dx, dy])?;
            let rise = given(place, [2 * dx, 2 * dy]).map_or(0.0, |far| near - far);
            Some(if f64::from(rise.abs()) <= MAX_SLOPE * grid.step_m { near + rise } else { near })
        });
        going_on.reduce(f32::min).map(|z| z - UNDER_TERRAIN_M)
    };
    (0..grid.len()).map(|i| if terrain[i].is_finite() { None } else { height(i) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::standing::height_at;
    use crate::ground::{HeightSteps, Surface, mesh};
    use crate::scene::scratch_scene::ScratchScene;
    use crate::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};

    /// Side of the terrain.
    const SIDE_M: f32 = 100.0;

    /// Checks that no generated ground rises over terrain of squares of 4 m with its south-west corner at a place.
    fn assert_below(name: &str, west_m: f32, height: impl Fn(f32, f32) -> f32) {
        let materials = vec![Material { rgb: [0; 3], texture: None, is_reflective: false }];
        let mut scene = Scene { materials, ..Scene::default() };
        scene.objects.push(SceneObject { id: "terrain".into(), kind: ObjectKind::Terrain, base_z_m: 0.0 });
        let side_m = SIDE_M / 25.0;
        for (column, row) in (0..25).flat_map(|row| (0..25).map(move |column| (column, row))) {
            let corner = |dx: i32, dy: i32| {
                let [x, y] = [column + dx, row + dy].map(|steps| steps as f32 * side_m);
                [west_m + x, y, height(x, y)]
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            for corners in [[a, b, c], [a, c, d]] {
                scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object: 0 });
            }
        }
        let city = ScratchScene::from_scene(scene).unwrap();
        let [min, max] = city.bounds.unwrap();
        let grid = GroundGrid::covering(min, max, city.origin, 64.0).unwrap();
        let steps = HeightSteps { step_m: 0.25, origin_m: 0.0 };
        let surface = Surface::build(&city, &grid, steps).unwrap().unwrap();
        let triangles = mesh::triangulate(&grid, &surface.field, &surface.range(), surface.plane_m);
        assert!(!triangles.is_empty(), "{name} has no ground");
        for (x, y) in (0..50).flat_map(|y| (0..50).map(move |x| (x as f32 * 2.0 + 1.0, y as f32 * 2.0 + 1.0))) {
            let ground_m = triangles.iter().filter_map(|corners| height_at(corners, [west_m + x, y]));
            let over_m = ground_m.fold(f32::MIN, f32::max) - height(x, y);
            assert!(over_m <= 0.0, "{name}: {over_m} m over the terrain at {x}, {y} from {west_m}");
        }
    }

    #[test]
    fn generated_ground_stays_below_the_edge_of_terrain() {
        for west_m in [0.5, 3.0, 7.5] {
            assert_below("to the west", west_m, |x, _| 50.0 + 0.2 * x);
            assert_below("to the east", west_m, |x, _| 50.0 - 0.2 * x);
            assert_below("to a corner", west_m, |x, y| 50.0 + 0.3 * x + 0.1 * y);
        }
    }

    #[test]
    fn walls_do_not_go_on_below_the_ground() {
        let grid = GroundGrid { corner: [0.0; 2], step_m: 8.0, size: [4, 1], skirt: 0 };
        let none = f32::NEG_INFINITY;
        let near = |terrain: [f32; 4], expected: f32| {
            let z = beside(&grid, &terrain)[1].unwrap();
            assert!((z - (expected - UNDER_TERRAIN_M)).abs() < 1e-4, "{terrain:?}: {z}");
        };
        near([none, none, 3.0, 5.0], 1.0);
        near([none, none, 3.0, 2.0], 4.0);
        near([none, none, 3.0, 30.0], 3.0);
        near([none, none, 3.0, none], 3.0);
        near([2.0, none, 3.0, none], 2.0);
        assert_eq!(beside(&grid, &[none, none, none, 1.0])[0], None);
        assert_eq!(beside(&grid, &[1.0; 4]), [None; 4]);
    }
}
