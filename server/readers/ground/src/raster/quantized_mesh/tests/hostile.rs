//! Tiles that are damaged by accident or on purpose.

use super::super::super::facts::Window;
use super::super::mesh::read_triangles;
use super::writer::{LAYER, Terrain, Tile};
use super::{Random, RasterError, RasterLimits};
use insula_source::testing::gzip;
use std::panic::catch_unwind;

const MAX_BYTES: u64 = 1 << 20;
/// Offset of the number of vertices.
const VERTICES: usize = 88;

fn is_damaged(bytes: &[u8]) -> bool {
    matches!(read_triangles(bytes, MAX_BYTES), Err(RasterError::Damaged(_)))
}

/// A tile with some bytes replaced.
fn changed(tile: &Tile, offset: usize, bytes: &[u8]) -> Vec<u8> {
    let mut all = tile.bytes();
    all[offset..offset + bytes.len()].copy_from_slice(bytes);
    all
}

#[test]
fn absurd_numbers_are_refused() {
    let tile = Tile::grid(2, |x, y| x / 2 + y / 2);
    let triangles = VERTICES + 4 + 9 * 6;
    assert!(read_triangles(&tile.bytes(), MAX_BYTES).is_ok());
    for heights_m in [[f32::NAN, 0.0], [0.0, f32::NAN], [f32::NEG_INFINITY, 0.0], [0.0, 1e6], [1.0, 0.0]] {
        assert!(is_damaged(&Tile { heights_m, ..tile.clone() }.bytes()), "{heights_m:?}");
    }
    for count in [0, 8, 10, u32::MAX, u32::MAX / 6 + 1] {
        assert!(is_damaged(&changed(&tile, VERTICES, &count.to_le_bytes())), "{count} vertices");
    }
    for count in [0, 8 * 9 + 1, u32::MAX, u32::MAX / 6 + 1] {
        assert!(is_damaged(&changed(&tile, triangles, &count.to_le_bytes())), "{count} triangles");
    }
    // The first code of a triangle must be that of a new vertex; others are at most the number of those before.
    for (offset, code) in [(0, 1_u16), (2, 2), (0, u16::MAX)] {
        assert!(is_damaged(&changed(&tile, triangles + 4 + offset, &code.to_le_bytes())), "code {code}");
    }
    // Steps to -1 and to 32768.
    for step in [1_u16, u16::MAX, u16::MAX - 1] {
        assert!(is_damaged(&changed(&tile, VERTICES + 4, &step.to_le_bytes())), "step {step}");
    }
}

#[test]
fn vertices_that_do_not_exist_are_refused() {
    let mut tile = Tile::grid(1, |_, _| 0);
    let unknown = [0_u16; 6].map(u16::to_le_bytes).concat();
    let bytes = changed(&tile, VERTICES + 4 + 4 * 6 + 4, &unknown);
    assert!(is_damaged(&bytes));
    tile.triangles = vec![[0, 1, 1], [2, 2, 3]];
    assert!(is_damaged(&tile.bytes()), "no triangle has an area");
}

#[test]
fn meshes_that_cover_a_tile_many_times_are_refused() {
    let mut tile = Tile::flat(1.0);
    tile.triangles = [tile.triangles.clone(), tile.triangles].concat();
    assert!(read_triangles(&tile.bytes(), MAX_BYTES).is_ok());
    tile.triangles = [[[0, 1, 3]; 9], [[3, 2, 0]; 9]].concat();
    assert!(is_damaged(&tile.bytes()));
}

#[test]
fn many_slivers_are_refused() {
    let slivers = |count: u32| {
        // From the south to the north, a unit wide.
        let corners =
            (0..count).flat_map(|index| [[index as u16, 0, 0], [index as u16 + 1, 0, 0], [index as u16, 32767, 0]]);
        let triangles = (0..count).map(|index| [0, 1, 2].map(|corner| 3 * index + corner)).collect();
        Tile { heights_m: [0.0; 2], vertices: corners.collect(), triangles }.bytes()
    };
    assert!(read_triangles(&slivers(4000), MAX_BYTES).is_ok());
    assert!(is_damaged(&slivers(4200)));
}

#[test]
fn tiles_that_end_early_are_refused() {
    let bytes = Tile::grid(3, |x, _| x).bytes();
    let end = VERTICES + 4 + 16 * 6 + 4 + 18 * 6;
    for length in 0..bytes.len() {
        assert_eq!(is_damaged(&bytes[..length]), length < end, "{length} bytes");
    }
    let packed = gzip(&bytes);
    for length in 0..packed.len() {
        assert!(is_damaged(&packed[..length]), "{length} packed bytes");
    }
}

#[test]
fn a_tile_is_not_unpacked_beyond_the_limit() {
    let mut bytes = Tile::flat(1.0).bytes();
    bytes.resize(1000, 0);
    let tile = gzip(&bytes);
    assert!(read_triangles(&tile, 1000).is_ok());
    assert!(matches!(read_triangles(&tile, 999), Err(RasterError::TooLarge { limit: 999, .. })));
    assert!(matches!(read_triangles(&gzip(&vec![0; 1 << 24]), MAX_BYTES), Err(RasterError::TooLarge { .. })));
}

#[test]
fn a_bad_tile_is_read_from_the_coarser_one() {
    let huge = RasterLimits { max_chunk_bytes: 4000, ..RasterLimits::default() };
    for bad in [&b"no tile"[..], &[1; 5000], &[0x1f, 0x8b, 8, 0]] {
        let terrain = Terrain::default()
            .with("5/2/2.terrain", &Tile::flat(1.0))
            .with("5/3/2.terrain", &Tile::flat(2.0))
            .with_bytes("5/3/2.terrain", bad)
            .with("4/1/1.terrain", &Tile::flat(7.0));
        let (mut mesh, facts) = terrain.open_with(LAYER, huge).unwrap();
        let heights = mesh.read_heights(Window::all_of(facts.size), facts.size.pixels() as usize).unwrap();
        let row = &heights[heights.len() - 128..];
        assert_eq!([row[0], row[63], row[64], row[127]], [1.0, 1.0, 7.0, 7.0]);
        assert_eq!((mesh.bad_tiles(), mesh.bad_tile_count()), (&["5/3/2.terrain".to_owned()][..], 1));
    }
}

#[test]
fn names_of_bad_tiles_are_bounded() {
    let mut terrain = Terrain::default();
    for x in 0..8 {
        for y in 0..8 {
            terrain = terrain.with_bytes(&format!("6/{x}/{y}.terrain"), b"bad");
        }
    }
    let (mut mesh, facts) = terrain.open(LAYER).unwrap();
    let window = Window::all_of(facts.size);
    for _ in 0..2 {
        let heights = mesh.read_heights(window, facts.size.pixels() as usize).unwrap();
        assert!(heights.iter().all(|height| height.is_nan()));
        assert_eq!((mesh.bad_tiles().len(), mesh.bad_tile_count()), (16, 64));
    }
}

#[test]
fn files_that_cannot_be_read_fail() {
    let terrain = Terrain::default().with_bytes("5/2/2.terrain", b"");
    assert!(matches!(terrain.open(LAYER), Err(RasterError::Io(_))));
}

/// No damage of a tile leads to a panic, to heights beyond those of its header, or to many bytes.
#[test]
fn damaged_tiles_do_not_panic() {
    let mut random = Random(5);
    let tiles = [Tile::grid(6, |x, y| x / 3 + y / 2), Tile::grid(30, |x, y| (x ^ y) & 0x7fff)].map(|tile| tile.bytes());
    let mut read = 0;
    for round in 0..2000 {
        let mut bytes = tiles[round % 2].clone();
        for _ in 0..=random.below(4) {
            let at = random.below(bytes.len());
            match random.below(4) {
                0 => bytes[at] = random.below(256) as u8,
                1 => bytes[at] ^= 1 << random.below(8),
                2 => bytes.truncate(at.max(1)),
                _ => drop(bytes.splice(at..at, (0..random.below(5)).map(|byte| byte as u8)).collect::<Vec<_>>()),
            }
        }
        let bytes = if round % 5 == 0 { gzip(&bytes) } else { bytes };
        let terrain = Terrain::default().with_bytes("5/2/2.terrain", &bytes).with("4/1/1.terrain", &Tile::flat(7.0));
        let result = catch_unwind(|| {
            let (mut mesh, facts) = terrain.open(LAYER).unwrap();
            let heights = mesh.read_heights(Window::all_of(facts.size), facts.size.pixels() as usize).unwrap();
            (heights, mesh.bad_tile_count())
        });
        let (heights, bad) = result.unwrap_or_else(|_| panic!("round {round}"));
        assert!(heights.iter().all(|height| height.abs() <= 1e5));
        read += usize::from(bad == 0);
    }
    // Many changes leave a valid tile, others do not.
    assert!((100..1900).contains(&read), "{read}");
}
