//! Tests of solids in a city of four leaves.

use super::*;
use crate::cache::PackedTile;
use crate::cache::tests::NoAtlas;
use crate::scene::TileKey;
use crate::solids::MeshSolids;
use glam::dvec3;
use insula_protocol::blockmap::{COLUMNS, ColumnClip, CornerWall, MapColumn, OuterTop, WallStrip, strip_rows};
use insula_protocol::mesh::{Mesh, PositionGrid};
use insula_protocol::mesh_tile::cuboid;
use insula_protocol::{Texel, octahedral};
use insula_test_support::small_city::empty_manifest;

/// A city of four leaves of 64 m, 100 m above zero, with its ground plane at 100 m.
fn city() -> Manifest {
    Manifest { origin: [1000.0, 2000.0, 100.0], ground_z_m: 100.0, ..empty_manifest(1) }
}

fn leaf(x: u32, y: u32) -> TileId {
    TileId::new(1, x, y).unwrap()
}

fn cache_of(tiles: Vec<(TileKey, PackedTile)>) -> AtlasCache {
    let mut cache = AtlasCache::new(400);
    for (key, tile) in tiles {
        cache.insert(key, tile, &mut NoAtlas);
    }
    cache
}

/// Heights in codes, of which a metre has 16.
fn block_map(id: TileId, cell_m: f32, columns: &[([usize; 2], MapColumn)]) -> (TileKey, PackedTile) {
    let mut all = vec![None; COLUMNS];
    for ([x, y], column) in columns {
        all[y * 64 + x] = Some(column.clone());
    }
    (
        TileKey::block_map(id),
        PackedTile::node(&insula_protocol::BlockMap::from_columns(id, cell_m, 0, 0, &all).unwrap()),
    )
}

fn solid(z_min: u16, z_max: u16) -> MapColumn {
    MapColumn { z_min, z_max, ..MapColumn::default() }
}

fn walled(z_min: u16, z_max: u16) -> MapColumn {
    let texels = vec![Texel::new([9; 3], 63); usize::from(strip_rows(z_min, z_max, 0).1)];
    MapColumn { strip: Some(WallStrip { texels, azimuth: 0 }), ..solid(z_min, z_max) }
}

/// A point of the city, metres from its corner.
fn at(x: f64, y: f64, z: f64) -> DVec3 {
    dvec3(1000.0 + x, 2000.0 + y, 100.0 + z)
}

#[test]
fn columns_have_tops_slopes_gaps_and_walls() {
    let normal = octahedral::encode([-0.6, 0.0, 0.8]);
    let slope = MapColumn { inclined: true, roof_normal: normal, ..solid(0, 160) };
    let gap = MapColumn { gap: Some([64, 128]), ..walled(0, 320) };
    let outer = Some(OuterTop { z: 32, roof: Texel::new([9; 3], 63) });
    let wall = MapColumn { clip: Some(ColumnClip { offset: -32, corner: None, outer }), ..walled(0, 320) };
    let corner = Some(CornerWall { azimuth: 64, offset: 0, concave: true });
    let concave = MapColumn { clip: Some(ColumnClip { offset: 0, corner, outer: None }), ..walled(0, 320) };
    let columns = [([3, 4], solid(0, 320)), ([10, 4], slope), ([20, 4], gap), ([30, 4], wall), ([40, 4], concave)];
    let (manifest, cache) = (city(), cache_of(vec![block_map(leaf(0, 0), 1.0, &columns)]));
    let solids = CitySolids::new(&manifest, &cache);

    assert!(solids.is_inside(at(3.5, 4.5, 19.9)) && !solids.is_inside(at(3.5, 4.5, 20.1)));
    assert!(!solids.is_inside(at(4.01, 4.5, 10.0)));
    assert_eq!(solids.ground_below(at(3.5, 4.5, 30.0)), Some(120.0));
    assert_eq!(solids.ground_below(at(5.5, 4.5, 30.0)), Some(100.0), "the ground plane");
    assert_eq!(solids.ground_below(at(5.5, 4.5, -1.0)), None);
    assert_eq!(solids.ground_below(at(3.5, 4.5, 10.0)), None);
    assert_eq!(solids.free_height_above(at(3.5, 4.5, 10.0)), 120.0);
    assert_eq!(solids.free_height_above(at(5.5, 4.5, 10.0)), 110.0);

    let top = |x: f64| solids.ground_below(at(x, 4.5, 50.0)).unwrap() - 100.0;
    assert!(
        (top(10.5) - 10.0).abs() < 1e-9 && (top(10.9) - top(10.1) - 0.6).abs() < 0.01,
        "{} {}",
        top(10.1),
        top(10.9)
    );

    assert!(solids.is_inside(at(20.5, 4.5, 3.0)) && !solids.is_inside(at(20.5, 4.5, 6.0)));
    assert_eq!(solids.ground_below(at(20.5, 4.5, 6.0)), Some(104.0));
    assert_eq!(solids.free_height_above(at(20.5, 4.5, 3.0)), 104.0);
    assert_eq!(solids.free_height_above(at(20.5, 4.5, 9.0)), 120.0);

    assert!(solids.is_inside(at(30.2, 4.5, 10.0)) && !solids.is_inside(at(30.3, 4.5, 10.0)));
    assert!(solids.is_inside(at(30.3, 4.5, 1.0)), "beyond the wall it is 2 m high");
    assert_eq!(solids.ground_below(at(30.3, 4.5, 10.0)), Some(102.0));
    assert!(
        solids.is_inside(at(40.3, 4.7, 5.0)) != solids.is_inside(at(40.7, 4.7, 5.0)),
        "only the fourth quarter is free"
    );
    assert!(solids.is_inside(at(40.7, 4.3, 5.0)));
}

#[test]
fn a_way_ends_at_the_first_column_in_any_direction() {
    let outer = Some(OuterTop { z: 32, roof: Texel::new([9; 3], 63) });
    let wall = MapColumn { clip: Some(ColumnClip { offset: -32, corner: None, outer }), ..walled(0, 320) };
    let columns = [([30, 30], wall), ([50, 30], MapColumn { gap: Some([64, 128]), ..walled(0, 320) })];
    let (manifest, cache) = (city(), cache_of(vec![block_map(leaf(0, 0), 1.0, &columns)]));
    let solids = CitySolids::new(&manifest, &cache);
    let hit = |from: DVec3, to: DVec3| solids.hit_on_way(from, to).map(|p| p - at(0.0, 0.0, 0.0));
    let near = |found: Option<DVec3>, expected: [f64; 3]| {
        let found = found.unwrap();
        assert!(found.distance(expected.into()) < 1e-6, "{found} {expected:?}");
    };
    near(hit(at(20.0, 30.5, 10.0), at(60.0, 30.5, 10.0)), [30.0, 30.5, 10.0]);
    near(hit(at(40.0, 30.5, 10.0), at(20.0, 30.5, 10.0)), [30.25, 30.5, 10.0]);
    near(hit(at(40.0, 30.5, 1.0), at(20.0, 30.5, 1.0)), [31.0, 30.5, 1.0]);
    near(hit(at(30.1, 30.5, 40.0), at(30.1, 30.5, 0.0)), [30.1, 30.5, 20.0]);
    near(hit(at(30.1, 60.5, 10.0), at(30.1, 0.5, 10.0)), [30.1, 31.0, 10.0]);
    near(hit(at(20.0, 20.0, 10.0), at(41.0, 41.0, 10.0)), [30.0, 30.0, 10.0]);
    near(hit(at(-500.0, 30.5, 10.0), at(500.0, 30.5, 10.0)), [30.0, 30.5, 10.0]);
    near(hit(at(500.0, 30.5, 30.0), at(-500.0, 30.5, -30.0)), [51.0, 30.5, 3.06]);
    assert_eq!(hit(at(40.0, 30.5, 6.0), at(60.0, 30.5, 6.0)), None, "through the gap");
    assert_eq!(hit(at(20.0, 30.5, 21.0), at(60.0, 30.5, 21.0)), None);
    near(hit(at(30.1, 30.5, 5.0), at(60.0, 30.5, 5.0)), [30.1, 30.5, 5.0]);
    assert_eq!(hit(at(20.0, 30.5, 10.0), at(f64::INFINITY, 30.5, 10.0)), None);
    assert_eq!(hit(at(20.0, 30.5, 10.0), at(20.0, 30.5, 10.0)), None);
}

/// A random way meets a column where a walk in small steps first finds itself inside of one.
#[test]
fn ways_agree_with_points() {
    let mut state = 7u64;
    let mut random = |n: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % n
    };
    let mut columns = Vec::new();
    for _ in 0..400 {
        let z = 40 + random(300) as u16;
        let mut column = walled(random(30) as u16, z);
        column.gap = (random(3) == 0).then_some([33, 38]);
        column.inclined = random(3) == 0;
        column.roof_normal = octahedral::encode([0.3, -0.4, 0.866]);
        let corner = (random(2) == 0).then(|| CornerWall {
            azimuth: random(256) as u8,
            offset: random(80) as i8 - 40,
            concave: random(2) == 0,
        });
        column.clip = (random(2) == 0).then(|| ColumnClip { offset: random(80) as i8 - 40, corner, outer: None });
        columns.push(([random(64) as usize, random(64) as usize], column));
    }
    let (manifest, cache) = (city(), cache_of(vec![block_map(leaf(0, 0), 1.0, &columns)]));
    let solids = CitySolids::new(&manifest, &cache);
    let mut hits = 0;
    for _ in 0..300 {
        let mut point = || at(random(6400) as f64 / 100.0, random(6400) as f64 / 100.0, random(2000) as f64 / 100.0);
        let (from, to) = (point(), point());
        let steps = 20_000;
        let place = |i: u32| from.lerp(to, f64::from(i) / f64::from(steps));
        let first = (0..=steps).map(place).find(|p| solids.is_inside(*p));
        let found = solids.hit_on_way(from, to);
        hits += u32::from(found.is_some());
        match (first, found) {
            // The walk may step over the corner of a column.
            (None, Some(hit)) => assert!(solids.is_inside(hit + (to - from).normalize() * 1e-4), "{from} {to} {hit}"),
            (Some(inside), Some(hit)) => {
                assert!(hit.distance(from) <= inside.distance(from) + 1e-6, "{from} {to} {hit} {inside}")
            }
            (Some(inside), None) => panic!("{from} {to} {inside}"),
            (None, None) => {}
        }
        if let (Some(inside), Some(hit)) = (first, found) {
            let is_same = hit.distance(inside) < 0.01 || solids.is_inside(hit + (to - from).normalize() * 1e-4);
            assert!(is_same, "{from} {to} {hit} {inside}");
        }
    }
    assert!(hits > 100, "{hits}");
}

#[test]
fn a_mesh_counts_before_columns_and_a_finer_tile_before_a_coarser() {
    let house = cuboid([10.0, 10.0, 0.0], [20.0, 20.0, 7.0], [9; 3], None).mesh;
    let tower = cuboid([12.0, 12.0, 7.0], [15.0, 15.0, 30.0], [9; 3], None).mesh;
    let everything: Vec<_> = (0..64).flat_map(|y| (0..64).map(move |x| ([x, y], solid(0, 16)))).collect();
    let tiles = vec![
        block_map(TileId::ROOT, 2.0, &everything),
        block_map(leaf(0, 0), 1.0, &[([15, 15], solid(0, 80))]),
        (TileKey::mesh(leaf(0, 0), 1), PackedTile::mesh(&joined(&house, &tower), None, &[], &[]).unwrap()),
    ];
    let (manifest, cache) = (city(), cache_of(tiles));
    let solids = CitySolids::new(&manifest, &cache);
    let close = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 0.02, "{a:?} {b}");
    close(solids.ground_below(at(11.0, 11.0, 50.0)), 107.0);
    close(solids.ground_below(at(13.0, 13.0, 50.0)), 130.0);
    close(solids.ground_below(at(30.0, 30.0, 50.0)), 100.0);
    close(solids.ground_below(at(100.0, 30.0, 50.0)), 102.0);
    for z in [1.0, 6.5, 7.5, 29.5] {
        assert!(solids.is_inside(at(13.0, 13.0, z)), "{z}");
    }
    assert!(!solids.is_inside(at(11.0, 11.0, 7.5)) && !solids.is_inside(at(9.9, 11.0, 3.0)));
    close(Some(solids.free_height_above(at(13.0, 13.0, 1.0))), 130.0);
    let hit = solids.hit_on_way(at(5.0, 13.0, 20.0), at(40.0, 13.0, 20.0)).unwrap();
    assert!(hit.distance(at(12.0, 13.0, 20.0)) < 0.02, "{hit}");
    let hit = solids.hit_on_way(at(5.0, 30.0, 0.5), at(100.0, 30.0, 0.5)).unwrap();
    assert!(hit.distance(at(64.0, 30.0, 0.5)) < 0.01, "in the next leaf, only the root's columns are resident: {hit}");
    let below = solids.surface_on_way(at(30.0, 30.0, 50.0), at(30.0, 30.0, -10.0)).unwrap();
    assert!(below.distance(at(30.0, 30.0, 0.0)) < 0.02, "the ground plane, where no tile is: {below}");
    assert_eq!(solids.surface_on_way(at(30.0, 30.0, 50.0), at(30.0, 30.0, 1.0)), None);
    let tower = solids.surface_on_way(at(5.0, 13.0, 20.0), at(40.0, 13.0, -20.0)).unwrap();
    assert!(tower.distance(at(12.0, 13.0, 12.0)) < 0.02, "before the plane: {tower}");
}

#[test]
fn eyes_are_lifted_out_of_houses_and_of_the_earth() {
    let (manifest, cache) = (city(), cache_of(vec![block_map(leaf(0, 0), 1.0, &[([15, 15], solid(0, 80))])]));
    let solids = CitySolids::new(&manifest, &cache);
    for (eye, expected) in [
        (at(15.5, 15.5, 2.0), Some(106.7)),
        (at(15.5, 15.5, -150.0), Some(106.7)),
        (at(15.5, 15.5, 5.5), None),
        (at(30.0, 30.0, -150.0), Some(101.7)),
        (at(30.0, 30.0, 1.0), None),
    ] {
        let lifted = solids.lifted_eye_z(eye);
        assert_eq!(lifted.map(|z| (z * 10.0).round()), expected.map(|z: f64| (z * 10.0).round()), "{eye}");
    }
}

#[test]
fn eyes_are_lifted_out_of_the_earth_below_terrain() {
    // A sheet of a metre, 5 m above the plane.
    let cache = cache_of(vec![block_map(leaf(0, 0), 1.0, &[([15, 15], solid(80, 96))])]);
    let lifted = |has_terrain: bool, eye: DVec3| {
        let manifest = Manifest { has_terrain, ..city() };
        CitySolids::new(&manifest, &cache).lifted_eye_z(eye).map(|z| (z * 10.0).round() / 10.0)
    };
    // Below a bridge, where there is no terrain.
    assert_eq!(lifted(false, at(15.5, 15.5, 2.0)), None);
    assert_eq!(lifted(true, at(15.5, 15.5, 2.0)), Some(107.7));
    assert_eq!(lifted(true, at(15.5, 15.5, 7.0)), None);
    assert_eq!(lifted(true, at(30.0, 30.0, 2.0)), None);
}

#[test]
fn open_meshes_are_buildings_bridges_and_sheets() {
    // A house without a floor, a bridge of 1 m, and a sheet with two sides.
    let roof = |side: f64, z: f64, is_up: bool| {
        let corners = [[0.0, 0.0, z], [side, 0.0, z], [side, side, z], [0.0, side, z]];
        (corners, if is_up { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] })
    };
    for (surfaces, inside, outside) in [
        (vec![roof(20.0, 8.0, true)], vec![1.0, 7.0], vec![8.5]),
        (vec![roof(20.0, 8.0, true), roof(20.0, 7.0, false)], vec![7.5], vec![1.0, 6.5, 8.5]),
        (vec![roof(20.0, 8.0, true), roof(20.0, 8.0, false)], vec![], vec![1.0, 7.0, 8.5]),
        (vec![roof(20.0, 8.0, false)], vec![], vec![1.0, 7.0, 8.5]),
    ] {
        let corners: Vec<[f64; 3]> = surfaces.iter().flat_map(|(corners, _)| *corners).collect();
        let triangles = surfaces.iter().enumerate();
        let triangles = triangles.flat_map(|(i, (_, two))| two.map(|t| t.map(|v: u32| v + 4 * i as u32))).collect();
        let grid = PositionGrid::enclosing(&corners, 14);
        let positions = corners.iter().map(|corner| grid.nearest(*corner)).collect();
        let mesh = MeshSolids::new(&Mesh { grid, positions, triangles, attributes: Vec::new() });
        let intervals = mesh.intervals_at(DVec2::new(5.0, 5.0));
        let is_inside = |z: f64| intervals.iter().any(|solid| solid.bottom < z && z < solid.top);
        assert!(inside.iter().all(|z| is_inside(*z)) && !outside.iter().any(|z| is_inside(*z)), "{intervals:?}");
        assert_eq!(mesh.intervals_at(DVec2::new(21.0, 5.0)), []);
        let hit = mesh.first_hit(dvec3(5.0, 5.0, 0.0), dvec3(0.0, 0.0, 10.0), [0.0, 1.0]).unwrap();
        assert!((7.0..8.01).contains(&(hit * 10.0)), "{hit}");
    }
}

/// Both meshes as one, on a grid that holds them.
fn joined(a: &Mesh, b: &Mesh) -> Mesh {
    let corners: Vec<[f64; 3]> = a.positions_m().chain(b.positions_m()).collect();
    let grid = PositionGrid::enclosing(&corners, 16);
    let shift = a.positions.len() as u32;
    let triangles = a.triangles.iter().copied().chain(b.triangles.iter().map(|t| t.map(|v| v + shift))).collect();
    let attributes = vec![insula_protocol::mesh::Attribute {
        corners: a.attributes[0].corners.iter().chain(&b.attributes[0].corners).copied().collect(),
        ..a.attributes[0].clone()
    }];
    Mesh { positions: corners.iter().map(|corner| grid.nearest(*corner)).collect(), grid, triangles, attributes }
}
