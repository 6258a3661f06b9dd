//! Tests with whole leaves of the bundled city, or of the cities that `INSULA_MESH_CITIES` lists.

use super::*;
use crate::read::{ReadOptions, read};
use glam::DVec3;
use insula_protocol::blockmap::Quality;
use insula_protocol::mesh_tile::MAX_LODS;
use insula_protocol::{MeshTile, TileId};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::OnceLock;

/// The cities with the meshes of their leaves, baked once for all tests.
fn cities() -> &'static [(Scene, CityGrid, Leaves)] {
    static CITIES: OnceLock<Vec<(Scene, CityGrid, Leaves)>> = OnceLock::new();
    CITIES.get_or_init(|| {
        let paths = match std::env::var_os("INSULA_MESH_CITIES") {
            Some(paths) => std::env::split_paths(&paths).collect(),
            None => vec![PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../client/demo/chiba"))],
        };
        let city = |path| {
            let (scene, grid) = open(path);
            let leaves = baked(&scene, &grid);
            (scene, grid, leaves)
        };
        paths.into_iter().map(city).collect()
    })
}

fn open(path: PathBuf) -> (Scene, CityGrid) {
    let (scene, _) = read(&[path], &ReadOptions::default(), &|_| {}).unwrap();
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for corner in scene.triangles.iter().flat_map(|triangle| triangle.corners) {
        for axis in 0..3 {
            (min[axis], max[axis]) = (min[axis].min(corner[axis].into()), max[axis].max(corner[axis].into()));
        }
    }
    let grid = CityGrid::covering(min, max, scene.origin, 1.0).unwrap();
    (scene, grid)
}

/// For each leaf that has any, the scene's triangles in or next to it.
fn leaves(scene: &Scene, grid: &CityGrid) -> Vec<(TileId, Scene)> {
    let side_m = grid.node_side_m(grid.depth);
    let mut found: BTreeMap<TileId, Scene> = BTreeMap::new();
    let part = Scene { triangles: Vec::new(), materials: scene.materials.clone(), ..Scene::default() };
    for triangle in &scene.triangles {
        let range = |axis: usize| {
            let along = triangle.corners.map(|corner| f64::from(corner[axis]) - grid.corner[axis]);
            let low = along.iter().copied().fold(f64::INFINITY, f64::min);
            let high = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            ((low / side_m).ceil() as u32).saturating_sub(1)..=(high / side_m) as u32
        };
        for y in range(1) {
            for id in range(0).filter_map(|x| TileId::new(grid.depth, x, y)) {
                found.entry(id).or_insert_with(|| part.clone()).triangles.push(*triangle);
            }
        }
    }
    found.into_iter().collect()
}

type Leaves = BTreeMap<TileId, Vec<(EncodedLod, MeshTile)>>;

fn baked(scene: &Scene, grid: &CityGrid) -> Leaves {
    let leaf = |(id, part): (TileId, Scene)| {
        let lods = leaf_lods(&part, grid, id, Quality::Decibels(36.0)).unwrap();
        let decoded = (0..).zip(lods).map(|(number, lod)| {
            let tile = MeshTile::decode(id, number, &lod.bytes).unwrap();
            (lod, tile)
        });
        (id, decoded.collect())
    };
    leaves(scene, grid).into_par_iter().map(leaf).collect()
}

fn area(tile: &MeshTile) -> f64 {
    let places: Vec<DVec3> = tile.mesh.positions_m().map(DVec3::from).collect();
    let corners = |t: &[u32; 3]| t.map(|vertex| places[vertex as usize]);
    tile.mesh.triangles.iter().map(corners).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
}

/// The edges on one side of a leaf: on axis 0 or 1, at its lower or upper end. Their ends are in steps along the border
/// and upwards. The value says whether an odd number of triangles meets at the edge, so that the surface goes on next
/// door.
fn border(tile: &MeshTile, axis: usize, upper: bool) -> BTreeMap<[[i64; 2]; 2], bool> {
    let grid = tile.mesh.grid;
    let z_offset = (grid.min[2] / grid.step).round() as i64;
    let at = if upper { leaf_surface::STEPS } else { 0 };
    let mut count: HashMap<[u32; 2], u32> = HashMap::new();
    for [a, b, c] in &tile.mesh.triangles {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            *count.entry([*p.min(q), *p.max(q)]).or_default() += 1;
        }
    }
    let place = |vertex: u32| {
        let p = tile.mesh.positions[vertex as usize];
        (p[axis] == at).then(|| [i64::from(p[1 - axis]), i64::from(p[2]) + z_offset])
    };
    let edge = |([p, q], count): ([u32; 2], u32)| {
        let mut edge = [place(p)?, place(q)?];
        edge.sort_unstable();
        Some((edge, count % 2 == 1))
    };
    count.into_iter().filter_map(edge).collect()
}

#[test]
fn finest_level_has_the_whole_surface_and_levels_get_smaller() {
    for (scene, grid, leaves) in cities() {
        let source: f64 = scene
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.corners.map(|corner| DVec3::from(corner.map(f64::from)));
                (b - a).cross(c - a).length() / 2.0
            })
            .sum();
        let (mut gathered, mut distinct) = (0.0, 0.0);
        for (id, part) in self::leaves(scene, grid) {
            let Some(surface) = leaf_surface::LeafSurface::gather(&part, grid, id) else { continue };
            let model = &surface.model;
            let mut seen = BTreeSet::new();
            for triangle in &model.triangles {
                let [a, b, c] = triangle.map(|vertex| DVec3::from(model.positions[vertex as usize]));
                let area = (b - a).cross(c - a).length() / 2.0 * surface.points.step.powi(2);
                gathered += area;
                let first = (0..3).min_by_key(|k| triangle[*k]).unwrap();
                distinct += if seen.insert([0, 1, 2].map(|k| triangle[(first + k) % 3])) { area } else { 0.0 };
            }
        }
        assert!((0.995..1.005).contains(&(gathered / source)), "{gathered} of {source} square metres");
        // The codec stores duplicate triangles once.
        let finest: f64 = leaves.values().filter_map(|lods| lods.first()).map(|(_, tile)| area(tile)).sum();
        assert!((0.999..1.001).contains(&(finest / distinct)), "{finest} of {distinct} square metres");
        for (id, lods) in leaves {
            assert!(lods.len() <= usize::from(MAX_LODS));
            for [(finer, _), (coarser, _)] in lods.array_windows() {
                assert!(finer.info.error_m <= coarser.info.error_m && finer.bytes.len() > coarser.bytes.len(), "{id}");
            }
            for (lod, tile) in lods {
                assert!(lod.info.error_m < 0.867 * grid.cell_m as f32);
                assert_eq!(lod.info.bytes as usize, lod.bytes.len());
                assert_eq!(lod.info.texture_px, tile.texture.as_ref().map_or(0, |texture| texture.pixels()));
            }
        }
        let count = |k: usize| leaves.values().filter(|lods| lods.len() > k).count();
        println!("{} leaves, levels of detail: {:?}", leaves.len(), [0, 1, 2, 3].map(count));
    }
}

#[test]
fn neighbouring_leaves_meet_at_any_two_levels_of_detail() {
    for (_, _, leaves) in cities() {
        let (mut edges, mut missing) = (0, Vec::new());
        for (id, lods) in leaves {
            for (axis, [x, y]) in [[1, 0], [0, 1]].into_iter().enumerate() {
                let neighbour = TileId::new(id.level(), id.x() + x, id.y() + y).and_then(|id| leaves.get(&id));
                let Some(neighbour) = neighbour else { continue };
                for (_, here) in lods {
                    for (_, there) in neighbour {
                        let (one, other) = (border(here, axis, true), border(there, axis, false));
                        for (this, that) in [(&one, &other), (&other, &one)] {
                            let open = this.iter().filter(|(_, is_border)| **is_border).map(|(edge, _)| *edge);
                            edges += open.clone().count();
                            missing.extend(open.filter(|edge| !that.contains_key(edge)).map(|edge| (*id, axis, edge)));
                        }
                    }
                }
            }
        }
        println!(
            "{edges} edges, {} not on both sides: {:?}",
            missing.len(),
            missing.iter().take(20).collect::<Vec<_>>()
        );
        assert!(edges > 100 && missing.is_empty());
    }
}
