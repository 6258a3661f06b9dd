//! Tiles one by one.

use super::super::*;
use super::{check, field, fractal};
use std::collections::{BTreeSet, HashMap};

/// Triangles by their corners' places, to compare meshes.
fn places(mesh: &TerrainMesh) -> BTreeSet<[Place; 3]> {
    mesh.triangles.iter().map(|t| t.map(|i| mesh.vertices[i as usize])).collect()
}

#[test]
fn tiles_share_their_borders() {
    for (seed, size, side) in [(1, [129, 129], 16), (2, [150, 90], 32), (3, [65, 65], 8), (4, [70, 34], 4)] {
        let mut heights = fractal(size, 80.0, seed);
        if seed == 2 {
            heights[40 * 150 + 64] = f32::NAN;
            heights[64 * 150 + 10] = f32::NAN;
        }
        let field = field(size, heights);
        for error in [0.1, 1.0, 3.0, 10.0] {
            let borders = Borders::survey(&field, side, error).unwrap();
            let mut joined = TerrainMesh::default();
            let mut numbers: HashMap<Place, u32> = HashMap::new();
            for tile in borders.tiling().tiles() {
                let part = triangulate_region(&field, &borders, tile).unwrap();
                let min = tile.map(|n| n * side);
                assert!(part.vertices.iter().all(|p| (0..2).all(|k| p[k] >= min[k] && p[k] <= min[k] + side)));
                for triangle in places(&part) {
                    joined.triangles.push(triangle.map(|place| {
                        *numbers.entry(place).or_insert_with(|| {
                            joined.vertices.push(place);
                            joined.vertices.len() as u32 - 1
                        })
                    }));
                }
            }
            assert!(check(&joined, &field) <= f64::from(error) + 1e-9);
        }
    }
}

#[test]
fn the_whole_surface_is_that_of_its_tiles() {
    let size = [2100, 1100];
    let field = field(size, fractal(size, 100.0, 5));
    let whole = triangulate(&field, 4.0);
    assert!(check(&whole, &field) <= 4.0 + 1e-9);
    let borders = Borders::survey(&field, TILE_STEPS, 4.0).unwrap();
    let tiles = borders.tiling().tiles().flat_map(|tile| places(&triangulate_region(&field, &borders, tile).unwrap()));
    assert_eq!(tiles.collect::<BTreeSet<_>>(), places(&whole));
}

#[test]
fn a_detail_in_one_tile_divides_borders_of_others() {
    // One peak beside the corner of four tiles.
    let mut heights = vec![0.0; 33 * 33];
    heights[15 * 33 + 15] = 10.0;
    let field = field([33, 33], heights);
    let borders = Borders::survey(&field, 16, 1.0).unwrap();
    let counts: Vec<usize> = borders
        .tiling()
        .tiles()
        .map(|tile| triangulate_region(&field, &borders, tile).unwrap().triangles.len())
        .collect();
    assert!(counts.iter().skip(1).all(|n| *n > 2 && *n < counts[0]), "{counts:?}");
}

#[test]
fn a_source_with_the_wrong_number_of_heights_has_holes() {
    struct Broken;
    impl HeightSource for Broken {
        type Error = String;
        fn size(&self) -> [u32; 2] {
            [40, 40]
        }
        fn read(&self, min: Place, _: Place) -> Result<Vec<f32>, String> {
            if min == [32, 32] { Err("no file".into()) } else { Ok(vec![1.0; 7]) }
        }
    }
    assert_eq!(Borders::survey(&Broken, 32, 1.0).unwrap_err(), "no file");
    let borders = Borders::survey(&Broken, 64, 1.0).unwrap();
    assert_eq!(triangulate_region(&Broken, &borders, [0, 0]).unwrap(), TerrainMesh::default());
    assert!(triangulate_region(&Broken, &borders, [5, 0]).unwrap().triangles.is_empty());
}
