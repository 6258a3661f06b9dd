//! Bays, storeys, gables, small buildings and damaged walls.

use super::*;
use insula_test_support::rng::Rng;

const PLAIN: [u8; 3] = [190, 180, 170];

/// What makes facades, with a plain material of number 0.
struct Setup {
    maker: FacadeMaker,
    materials: Materials,
}

/// Colours of plain materials, `None` for generated textures, and the height of the ground at a position from the houses.
struct Materials(Vec<Option<[u8; 3]>>, fn(f64, f64) -> Option<f64>);

impl Materials {
    fn add_plain(&mut self, rgb: [u8; 3]) -> u32 {
        self.0.push(Some(rgb));
        self.0.len() as u32 - 1
    }
}

impl FacadeMaterials for Materials {
    fn colour(&self, material: u32) -> [u8; 3] {
        self.0[material as usize].unwrap_or([255; 3])
    }

    fn add_pattern(&mut self, texels: Vec<[u8; 3]>) -> u32 {
        assert_eq!(texels.len() as u32, SIDE_TEXELS * SIDE_TEXELS);
        self.0.push(None);
        self.0.len() as u32 - 1
    }

    fn ground_m(&mut self, [x, y]: [f64; 2]) -> Option<f64> {
        (self.1)(x - 85_000.0, y - 447_000.0).map(|z_m| z_m + 2.0)
    }
}

impl Setup {
    fn new() -> Self {
        Self { maker: FacadeMaker::default(), materials: Materials(vec![Some(PLAIN)], |_, _| None) }
    }

    fn apply(&mut self, faces: &[WorldTriangle], facade_use: FacadeUse) -> Vec<WorldTriangle> {
        let mut faces = faces.to_vec();
        if self.maker.apply(&mut faces, facade_use, &mut self.materials) {
            self.maker.count_object();
        }
        faces
    }
}

fn windows_on(faces: &[WorldTriangle]) -> Vec<WorldTriangle> {
    Setup::new().apply(faces, FacadeUse::Home)
}

fn polygon(corners: &[[f64; 3]]) -> impl Iterator<Item = WorldTriangle> + '_ {
    (2..corners.len()).map(|k| WorldTriangle {
        corners: [corners[0], corners[k - 1], corners[k]],
        uv: [[0.0; 2]; 3],
        material: 0,
        is_facade: true,
    })
}

/// A prism over a convex footprint, far from the origin as maps are.
fn prism(footprint: &[[f64; 2]], height_m: f64) -> Vec<WorldTriangle> {
    let at = |[x, y]: [f64; 2], z: f64| [x + 85_000.0, y + 447_000.0, z + 2.0];
    let top: Vec<[f64; 3]> = footprint.iter().map(|p| at(*p, height_m)).collect();
    let bottom: Vec<[f64; 3]> = footprint.iter().rev().map(|p| at(*p, 0.0)).collect();
    let mut faces: Vec<WorldTriangle> = polygon(&top).chain(polygon(&bottom)).collect();
    for (i, from) in footprint.iter().enumerate() {
        let to = footprint[(i + 1) % footprint.len()];
        faces.extend(polygon(&[at(*from, 0.0), at(to, 0.0), at(to, height_m), at(*from, height_m)]));
    }
    faces
}

/// A rectangle that is turned by the angle of the triangle 3, 4, 5.
fn house(width_m: f64, depth_m: f64, height_m: f64) -> Vec<WorldTriangle> {
    let turned = |x: f64, y: f64| [0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y];
    prism(&[turned(0.0, 0.0), turned(width_m, 0.0), turned(width_m, depth_m), turned(0.0, depth_m)], height_m)
}

fn area_m2(face: &WorldTriangle) -> f64 {
    let [a, b, c] = face.corners.map(DVec3::from_array);
    (b - a).cross(c - a).length() / 2.0
}

fn has_windows(face: &WorldTriangle) -> bool {
    face.material != 0
}

#[test]
fn walls_have_whole_bays_from_corner_to_corner_and_whole_storeys() {
    let faces = windows_on(&house(10.4, 7.0, 8.9));
    assert_eq!(faces.len(), 12);
    let walls: Vec<_> = faces.iter().filter(|face| has_windows(face)).collect();
    assert_eq!(walls.len(), 8);
    for (face, (corner, uv)) in walls.iter().flat_map(|face| face.corners.iter().zip(&face.uv).map(move |c| (face, c)))
    {
        let [bays, storeys] = uv.map(|v| f64::from(v * pattern::CELLS as f32));
        let wall_m = [7.0, 10.4].into_iter().find(|side| (2.0 * area_m2(face) / 8.9 - side).abs() < 0.01).unwrap();
        let expected = [if wall_m == 7.0 { 2.0 } else { 3.0 }, if corner[2] > 3.0 { 3.0 } else { -parts::PLINTH }];
        assert!((bays - expected[0]).abs() < 1e-4 || bays.abs() < 1e-4, "{bays} of {expected:?}");
        assert!((storeys - expected[1]).abs() < 1e-4, "{storeys}");
    }
}

#[test]
fn pattern_continues_over_all_faces_of_a_wall() {
    // A wall of four triangles that meet in its middle, two of them of another colour, with the other walls of a house.
    let mut setup = Setup::new();
    let other = setup.materials.add_plain([120, 90, 80]);
    let mut faces = house(12.0, 9.0, 6.0);
    let [a, b] = [faces[4].corners[0], faces[4].corners[1]];
    let [c, d] = [faces[5].corners[1], faces[5].corners[2]];
    let middle: [f64; 3] = std::array::from_fn(|axis| (a[axis] + c[axis]) / 2.0);
    faces.splice(
        4..6,
        [[a, b], [b, c], [c, d], [d, a]].iter().flat_map(|[p, q]| polygon(&[*p, *q, middle]).collect::<Vec<_>>()),
    );
    faces[5].material = other;
    let cut = setup.apply(&faces, FacadeUse::Home);
    assert_eq!(cut.len(), faces.len());
    let (east, centre, west) = (cut[4].uv[1], cut[4].uv[2], cut[4].uv[0]);
    for face in &cut[5..8] {
        assert_eq!(face.uv[2], centre);
    }
    assert_eq!((cut[5].uv[0], cut[7].uv[1]), (east, west));
    assert_eq!(centre[0], (east[0] + west[0]) / 2.0);
    // In the middle of a plinth and two storeys.
    assert!((f64::from(centre[1] * 4.0) - (2.0 - parts::PLINTH) / 2.0).abs() < 1e-5, "{centre:?}");
    assert_ne!(cut[4].material, cut[5].material);
}

#[test]
fn gables_and_steps_cut_no_window() {
    let at = |x: f64, z: f64| [x, 0.0, z];
    let gable = [at(0.0, 0.0), at(8.0, 0.0), at(8.0, 5.8), at(4.0, 9.0), at(0.0, 5.8)];
    let steps = [at(0.0, 0.0), at(12.0, 0.0), at(12.0, 5.8), at(7.0, 5.8), at(7.0, 2.9), at(0.0, 2.9)];
    let steps_as_triangles: Vec<_> = [[4, 5, 0], [4, 0, 1], [4, 1, 2], [4, 2, 3]]
        .iter()
        .flat_map(|t| polygon(&t.map(|i: usize| steps[i])).collect::<Vec<_>>())
        .collect();
    for (wall, windows_m2) in
        [(polygon(&gable).collect::<Vec<_>>(), 8.0 * 5.8), (steps_as_triangles, 7.0 * 2.9 + 5.0 * 5.8)]
    {
        let mut faces = house(9.0, 9.0, 5.8);
        faces.truncate(4);
        let rest = faces.len();
        faces.extend(wall);
        let [lowest, base] = [faces.iter().flat_map(|face| face.corners).map(|p| p[2]).fold(f64::MAX, f64::min), 0.0];
        assert!(lowest >= base);
        let before_m2: f64 = faces.iter().map(area_m2).sum();
        let cut = windows_on(&faces);
        assert!((cut.iter().map(area_m2).sum::<f64>() - before_m2).abs() < 1e-6);
        let found_m2: f64 = cut.iter().filter(|face| has_windows(face)).map(area_m2).sum();
        assert!((found_m2 - windows_m2).abs() < 0.1 * windows_m2, "{found_m2} of {windows_m2}");
        for face in cut[rest..].iter().filter(|face| has_windows(face)) {
            // Ends of bays lie at the ends of the wall or of a step.
            for (corner, uv) in face.corners.iter().zip(&face.uv) {
                let bays = f64::from(uv[0]) * 4.0;
                if [0.0, 7.0, 8.0, 12.0].iter().any(|end| (corner[0] - end).abs() < 1e-6) {
                    assert!((bays - bays.round()).abs() < 1e-4, "{bays} at {corner:?}");
                }
            }
        }
    }
}

#[test]
fn windows_begin_above_the_ground() {
    let lowest = |faces: &[WorldTriangle]| {
        let windows = faces.iter().filter(|face| has_windows(face)).flat_map(|face| face.corners);
        windows.map(|corner| corner[2] - 2.0).fold(f64::MAX, f64::min)
    };
    let on = |ground: fn(f64, f64) -> Option<f64>, faces: &[WorldTriangle]| {
        let mut setup = Setup::new();
        setup.materials.1 = ground;
        setup.apply(faces, FacadeUse::Home)
    };
    let walls = prism(&[[0.0, 0.0], [40.0, 0.0], [40.0, 9.0], [0.0, 9.0]], 10.2);
    // A storey less, from the ground up.
    let level = on(|_, _| Some(1.2), &walls);
    assert!((lowest(&level) - 1.2).abs() < 1e-6, "{}", lowest(&level));
    let storeys = level.iter().flat_map(|face| &face.uv).map(|uv| uv[1] * 4.0).fold(0.0, f32::max);
    assert!((storeys - 3.0).abs() < 1e-4, "{storeys}");
    // Up to three metres above the floor in the east.
    let slope = on(|x, _| Some(x * 3.0 / 40.0), &walls);
    let top = slope.iter().flat_map(|face| &face.uv).map(|uv| f64::from(uv[1] * 4.0)).fold(0.0, f64::max);
    for face in slope.iter().filter(|face| has_windows(face)) {
        for ([x, _, z], uv) in face.corners.iter().zip(&face.uv) {
            let (storey, depth_m) = (f64::from(uv[1] * 4.0), (x - 85_000.0) * 3.0 / 40.0 - (z - 2.0));
            // A window's sill is 9 of 32 texels above the floor.
            let ground = storey + depth_m * top / 10.2;
            assert!(ground < storey.round() + 0.28, "{ground} at {x}, {z}");
        }
    }
    assert!(lowest(&slope) < 0.1);
    // Ground that is lower, or that nobody knows, changes nothing.
    assert_eq!(on(|_, _| Some(-3.0), &walls), on(|_, _| None, &walls));
    // A house in the ground.
    assert!(!on(|_, _| Some(12.0), &walls).iter().any(has_windows));
}

#[test]
fn borders_of_cells_show_only_wall() {
    for facade_use in [FacadeUse::Home, FacadeUse::Office] {
        let texels = pattern::draw(facade_use, PLAIN);
        let side = SIDE_TEXELS;
        let cell = side / pattern::CELLS;
        let window = (0..side * side).filter(|i| texels[*i as usize] != PLAIN).collect::<Vec<_>>();
        assert!(window.len() as u32 > side * side / 8);
        for i in window {
            let from_border = [i % side % cell, i / side % cell].map(|v| v.min(cell - 1 - v));
            assert!(from_border[0] >= 2 && from_border[1] >= 5, "{facade_use:?}: {from_border:?}");
        }
    }
}

#[test]
fn small_flat_and_photographed_things_stay_plain() {
    let plain = |faces: &[WorldTriangle], facade_use| Setup::new().apply(faces, facade_use) == faces;
    assert!(plain(&house(10.0, 8.0, 3.5), FacadeUse::Home));
    assert!(plain(&house(4.0, 4.0, 9.0), FacadeUse::Home));
    assert!(plain(&house(30.0, 30.0, 9.0), FacadeUse::Windowless));
    let photos: Vec<_> =
        house(10.0, 8.0, 9.0).into_iter().map(|face| WorldTriangle { is_facade: false, ..face }).collect();
    assert!(plain(&photos, FacadeUse::Home));
    assert!(plain(&[], FacadeUse::Home));
    // Columns of a portico: each side is narrower than a bay.
    let narrow = [house(1.5, 1.5, 9.0), house(40.0, 1.5, 0.1)].concat();
    assert!(plain(&narrow, FacadeUse::Home));
    let office = Setup::new().apply(&house(10.8, 7.2, 7.2), FacadeUse::Office);
    assert!(office.iter().flat_map(|face| face.uv).all(|[_, v]| v <= 0.5 + 1e-5));
}

#[test]
fn textures_are_few_however_many_colours_there_are() {
    let mut setup = Setup::new();
    for i in 0..300u32 {
        let material = setup.materials.add_plain([100 + (i % 20) as u8, 100 + (i / 20) as u8, 90]);
        let faces: Vec<_> = house(9.0, 9.0, 9.0).into_iter().map(|face| WorldTriangle { material, ..face }).collect();
        let cut = setup.apply(&faces, FacadeUse::Home);
        assert_eq!(cut.iter().filter(|face| face.material != material).count(), 8);
    }
    let office = setup.apply(&house(9.0, 9.0, 9.0), FacadeUse::Office);
    assert!(office.iter().all(|face| !has_windows(face)));
    let report = setup.maker.into_report().unwrap();
    assert_eq!((report.textures, report.objects, report.generated), (MAX_TEXTURES as u64, 301, true));
}

#[test]
fn tangled_and_degenerate_walls_are_survived() {
    let mut rng = Rng::new(1);
    let mut faces = house(20.0, 20.0, 20.0);
    for i in 0..4000 {
        let mut corner =
            || [rng.range(0.0, 100.0), if i % 2 == 0 { 0.0 } else { rng.range(0.0, 1e9) }, rng.range(0.0, 100.0)];
        let corners = [corner(), corner(), corner()];
        faces.push(WorldTriangle { corners, ..faces[0] });
    }
    for z in [f64::MIN_POSITIVE, 1e9] {
        faces.push(WorldTriangle { corners: [[1.0, 0.0, 0.0], [1.0, 0.0, z], [1.0, 0.0, 0.0]], ..faces[0] });
    }
    let cut = windows_on(&faces);
    assert!(cut.len() <= (MAX_GROWTH + 1) * faces.len() + 400, "{}", cut.len());
    assert!(cut.iter().flat_map(|face| face.uv).flatten().all(f32::is_finite));
}
