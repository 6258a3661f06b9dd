//! Tests of terrains of Cesium. Tiles are made here by hand.

mod hostile;
mod layers;
mod writer;

use self::writer::{LAYER, Terrain, Tile};
use super::super::facts::{RasterLimits, Window};
use super::RasterError;
use insula_source::testing::gzip;

/// Degrees of a side of a tile of level 3.
const SIDE: f64 = 22.5;

#[test]
fn a_terrain_has_a_place_and_a_system() {
    let (_, facts) = Terrain::default().with("3/10/5.terrain", &Tile::flat(1.0)).open(LAYER).unwrap();
    assert_eq!([facts.size.width, facts.size.height], [64, 64]);
    let (place, step) = (facts.place.unwrap(), SIDE / 64.0);
    let corner = place.position(-0.5, -0.5);
    assert_eq!(corner, [-180.0 + 10.0 * SIDE, -90.0 + 6.0 * SIDE]);
    assert_eq!((place.column, place.row), ([step, 0.0], [0.0, -step]));
    assert_eq!(facts.crs.horizontal.as_deref(), Some("EPSG:4326"));
    assert!(facts.crs.is_ellipsoidal && facts.crs.vertical.is_none());
}

#[test]
fn pixels_have_the_heights_of_their_centres() {
    let east = Terrain::default().with("3/10/5.terrain", &Tile::grid(1, |x, _| x)).heights(LAYER);
    let north = Terrain::default().with("3/10/5.terrain", &Tile::grid(1, |_, y| y)).heights(LAYER);
    for row in 0..64 {
        for column in 0..64 {
            let at = |pixel: usize| (pixel as f32 + 0.5) / 64.0 * 32767.0;
            assert!((east[row][column] - at(column)).abs() < 0.01);
            assert!((north[row][column] - at(63 - row)).abs() < 0.01);
        }
    }
}

#[test]
fn rows_of_mercator_tiles_have_latitudes() {
    let layer = r#"{"format": "quantized-mesh-1.0", "projection": "EPSG:3857", "scheme": "slippyMap"}"#;
    let terrain = Terrain::default().with("1/1/0.terrain", &Tile::grid(1, |_, y| y));
    let (_, facts) = terrain.open(layer).unwrap();
    assert_eq!(facts.crs.horizontal.as_deref(), Some("EPSG:3857"));
    let place = facts.place.unwrap();
    let [west, north] = place.position(-0.5, -0.5);
    assert!(west == 0.0 && (north - 20_037_508.342_789_244).abs() < 1e-6);
    let latitude = |north_m: f64| 2.0 * (north_m / 6_378_137.0).exp().atan() - std::f64::consts::FRAC_PI_2;
    for (row, heights) in terrain.heights(layer).iter().enumerate() {
        // The southern edge is the equator.
        let expected = latitude(place.position(0.0, row as f64)[1]) / latitude(north) * 32767.0;
        assert!(heights.iter().all(|height| (f64::from(*height) - expected).abs() < 0.01), "row {row}");
    }
}

#[test]
fn rows_are_numbered_by_the_scheme() {
    let terrain = Terrain::default().with("3/4/0.terrain", &Tile::flat(1.0)).with("3/4/1.terrain", &Tile::flat(2.0));
    let slippy = LAYER.replace("{\"format", "{\"scheme\": \"slippyMap\", \"format");
    let ends = |rows: Vec<Vec<f32>>| [rows[0][0], rows[127][0]];
    assert_eq!(ends(terrain.heights(LAYER)), [2.0, 1.0]);
    assert_eq!(ends(terrain.heights(&slippy)), [1.0, 2.0]);
}

#[test]
fn a_missing_tile_is_read_from_the_coarser_ones() {
    let terrain = Terrain::default()
        .with("8/20/20.terrain", &Tile::grid(1, |x, _| x))
        .with("10/80/80.terrain", &Tile::flat(-1.0))
        .with("10/83/83.terrain", &Tile::flat(-2.0))
        .with("9/41/40.terrain", &Tile::flat(-3.0));
    let heights = terrain.heights(LAYER);
    assert_eq!(heights.len(), 4 * 64);
    assert_eq!([heights[255][0], heights[0][255]], [-1.0, -2.0]);
    assert_eq!([heights[255][128], heights[128][255]], [-3.0; 2]);
    // The rest is of level 8: west and east of the tile of level 9, and north of it.
    for (row, column) in [(255, 64), (128, 127), (127, 0), (64, 200), (127, 255)] {
        let expected = (column as f32 + 0.5) / 256.0 * 32767.0;
        assert!((heights[row][column] - expected).abs() < 0.01, "{row} {column}");
    }
}

#[test]
fn pixels_without_any_tile_have_no_height() {
    let terrain = Terrain::default().with("5/0/0.terrain", &Tile::flat(1.0)).with("5/1/1.terrain", &Tile::flat(2.0));
    let heights = terrain.heights(LAYER);
    assert_eq!([heights[127][0], heights[0][127]], [1.0, 2.0]);
    assert!(heights[0][0].is_nan() && heights[64][64].is_nan());
}

#[test]
fn what_a_mesh_leaves_open_is_read_from_the_coarser_tile() {
    let mut half = Tile::flat(5.0);
    half.triangles.truncate(1);
    let terrain = Terrain::default().with("4/3/3.terrain", &half).with("3/1/1.terrain", &Tile::flat(6.0));
    let heights = terrain.heights(LAYER);
    let count = |height: f32| heights.as_slice().concat().iter().filter(|number| **number == height).count();
    // The diagonal belongs to the triangle.
    assert_eq!([count(5.0), count(6.0)], [64 * 65 / 2, 64 * 63 / 2]);
}

#[test]
fn coarser_tiles_without_finer_ones_widen_the_raster() {
    let terrain = Terrain::default()
        .with("0/0/0.terrain", &Tile::flat(0.0))
        .with("0/1/0.terrain", &Tile::flat(0.0))
        .with("8/20/20.terrain", &Tile::flat(1.0))
        .with("8/21/20.terrain", &Tile::flat(2.0))
        .with("9/40/40.terrain", &Tile::flat(3.0));
    let heights = terrain.heights(LAYER);
    // The other tile of level 0 is too coarse.
    assert_eq!([heights[0].len(), heights.len()], [4 * 64, 2 * 64]);
    assert_eq!([heights[127][0], heights[127][64], heights[0][0], heights[0][255]], [3.0, 1.0, 1.0, 2.0]);
}

#[test]
fn no_pixel_is_lost_between_triangles() {
    let mut random = Random(1);
    for cells in [1, 3, 7, 16, 64, 100] {
        let mut tile = Tile::grid(cells, |x, _| x);
        let reach = 32767 / i32::from(cells) / 3;
        for vertex in &mut tile.vertices {
            for axis in 0..2 {
                if !matches!(vertex[axis], 0 | 32767) {
                    let step = random.below(2 * reach as usize + 1) as i32 - reach;
                    vertex[axis] = (i32::from(vertex[axis]) + step) as u16;
                }
            }
            vertex[2] = vertex[0];
        }
        let heights = Terrain::default().with("2/0/0.terrain", &tile).heights(LAYER);
        for (column, height) in heights.iter().flat_map(|row| row.iter().enumerate()) {
            let expected = (column as f32 + 0.5) / heights.len() as f32 * 32767.0;
            assert!((height - expected).abs() < 0.01, "{cells} cells, column {column}: {height}");
        }
    }
}

#[test]
fn indices_have_32_bits_for_more_than_65536_vertices() {
    for cells in [255, 256] {
        let tile = Tile::grid(cells, |x, _| x);
        assert_eq!(tile.vertices.len() > 65536, cells == 256);
        let heights = Terrain::default().with("2/0/0.terrain", &tile).heights(LAYER);
        assert_eq!(heights.len(), 256);
        assert!(heights.iter().all(|row| (row[100] - 100.5 / 256.0 * 32767.0).abs() < 0.01));
    }
}

#[test]
fn packed_tiles_are_read() {
    let bytes = gzip(&Tile::flat(4.0).bytes());
    assert_eq!(Terrain::default().with_bytes("2/0/0.terrain", &bytes).heights(LAYER)[0][0], 4.0);
}

#[test]
fn pixels_are_not_larger_than_the_distances_of_vertices() {
    let side = |cells: u16| Terrain::default().with("2/0/0.terrain", &Tile::grid(cells, |_, _| 0)).heights(LAYER).len();
    assert_eq!([1, 64, 66, 128, 200].map(side), [64, 64, 128, 128, 256]);
    // Many small triangles at a border do not count.
    let mut fan = Tile { vertices: vec![[32767, 0, 0]], ..Tile::flat(0.0) };
    fan.vertices.extend((0..=50).map(|step| [0, step * 655, 0]));
    fan.triangles = (1..=50).map(|index| [0, index, index + 1]).collect();
    assert_eq!(Terrain::default().with("2/0/0.terrain", &fan).heights(LAYER).len(), 64);
}

#[test]
fn windows_have_the_pixels_of_the_whole_raster() {
    let mut terrain = Terrain::default();
    for x in 0..3_u16 {
        for y in 0..3_u16 {
            terrain =
                terrain.with(&format!("6/{x}/{y}.terrain"), &Tile::grid(2, |a, b| a / 9 + b / 9 + x * 99 + y * 5));
        }
    }
    let all = terrain.heights(LAYER);
    // No more than a tile is kept.
    let limits = RasterLimits { cache_bytes: 1, ..RasterLimits::default() };
    let (mut mesh, _) = terrain.open_with(LAYER, limits).unwrap();
    for [x, y, width, height] in [[0, 0, 1, 1], [63, 60, 2, 70], [64, 64, 64, 64], [191, 0, 1, 192], [10, 150, 180, 20]]
    {
        let window = Window { x, y, width, height };
        let heights = mesh.read_heights(window, (width * height) as usize).unwrap();
        let rows = &all[y as usize..(y + height) as usize];
        let expected: Vec<f32> = rows.iter().flat_map(|row| &row[x as usize..(x + width) as usize]).copied().collect();
        assert_eq!(heights, expected);
    }
    for window in [[192, 0, 1, 1], [0, 0, 193, 1], [0, 0, 0, 1], [u32::MAX, 0, 1, 1], [1, 0, u32::MAX, 1]] {
        let [x, y, width, height] = window;
        let result = mesh.read_heights(Window { x, y, width, height }, 1);
        assert!(matches!(result, Err(RasterError::Outside)), "{window:?}");
    }
    let wrong_len = mesh.read_heights(Window { x: 0, y: 0, width: 2, height: 1 }, 1);
    assert!(matches!(wrong_len, Err(RasterError::Outside)));
}

/// A generator of numbers that are the same in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end
    }
}
