//! Terrain and what stands on it, from files on disk.

use crate::read::{ReadOptions, ReadReport, SourceFormat, read};
use crate::scene::{ObjectKind, Scene};
use insula_source::testing::gzip;
use insula_test_support::folder::TestFolder;
use insula_test_support::map_files::{ascii_grid, feature_collection, rectangle};
use std::fs;

/// Origin of the test's maps, in EPSG:25832.
const EAST_M: f64 = 500_000.0;
const NORTH_M: f64 = 5_400_000.0;

/// The ground: a slope with a hill on it.
fn ground_m(x: f64, y: f64) -> f64 {
    let hill = (-((x - 200.0).powi(2) + (y - 150.0).powi(2)) / 5000.0).exp();
    100.0 + 0.1 * x + 30.0 * hill
}

/// An ASCII grid of `size` points with the south-western one at `corner` metres from the origin.
fn grid(corner: [f64; 2], size: [usize; 2], step_m: f64, height_m: impl Fn(f64, f64) -> f64) -> String {
    let [x0, y0] = corner;
    ascii_grid([EAST_M + x0, NORTH_M + y0], size, step_m, |x, y| height_m(x0 + x, y0 + y))
}

/// A square building of 10 m with its south-western corner at a place.
fn house([x, y]: [f64; 2]) -> String {
    let (x, y) = (EAST_M + x, NORTH_M + y);
    let house = rectangle(r#""properties":{"height":12}"#, [x, y, x + 10.0, y + 10.0]);
    feature_collection("EPSG:25832", &[house])
}

fn read_files(name: &str, files: &[(&str, &str)], options: &ReadOptions) -> (Scene, ReadReport) {
    let folder = TestFolder::new(&format!("elevation-{name}"));
    for (name, text) in files {
        fs::write(folder.path.join(name), text).unwrap();
        if let Some(stem) = name.strip_suffix(".asc") {
            fs::write(folder.path.join(format!("{stem}.prj")), "EPSG:25832").unwrap();
        }
    }
    read(std::slice::from_ref(&folder.path), options, &|_| {}).unwrap()
}

/// World corners of the triangles of one kind, from the origin of the test's maps.
fn corners(scene: &Scene, kind: ObjectKind) -> Vec<[[f64; 3]; 3]> {
    let of_kind = scene.triangles.iter().filter(|t| scene.objects[t.object as usize].kind == kind);
    let origin = [scene.origin[0] - EAST_M, scene.origin[1] - NORTH_M, scene.origin[2]];
    of_kind.map(|t| t.corners.map(|c| [0, 1, 2].map(|axis| f64::from(c[axis]) + origin[axis]))).collect()
}

/// Height of triangles at a place; `None` beside them.
fn height_at(triangles: &[[[f64; 3]; 3]], [x, y]: [f64; 2]) -> Option<f64> {
    triangles.iter().find_map(|[a, b, c]| {
        let cross = |p: &[f64; 3], q: &[f64; 3]| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
        let [w, u, v] = [cross(a, b), cross(b, c), cross(c, a)];
        let area = u + v + w;
        let is_inside = [u, v, w].iter().all(|part| part / area >= -1e-9);
        is_inside.then(|| (a[2] * u + b[2] * v + c[2] * w) / area)
    })
}

#[test]
fn terrain_follows_the_model_and_buildings_stand_on_it() {
    let dem = grid([-100.0, -100.0], [101, 81], 5.0, ground_m);
    let files = [("a.geojson", &*house([150.0, 120.0])), ("dem.asc", &dem)];
    let (scene, report) = read_files("follows", &files, &ReadOptions::default());
    let source = report.sources.iter().find(|source| source.format == SourceFormat::Elevation).unwrap();
    assert!(source.objects > 0 && source.terrain_triangles > 100, "{source:?}");
    assert_eq!(report.crs.as_deref(), Some("EPSG:25832"));
    let terrain = corners(&scene, ObjectKind::Terrain);
    assert!(terrain.len() < 2 * 100 * 80, "{}", terrain.len());
    for i in 0..400 {
        // Vertices of the model, from border to border.
        let [x, y] = [-100.0 + 5.0 * f64::from(i * 37 % 101), -100.0 + 5.0 * f64::from(i * 53 % 81)];
        let height = height_at(&terrain, [x, y]).unwrap_or_else(|| panic!("no terrain at {x} {y}"));
        assert!((height - ground_m(x, y)).abs() < 0.2 + 1e-3, "{x} {y}: {height} {}", ground_m(x, y));
    }
    let house = corners(&scene, ObjectKind::Building);
    let heights = || house.iter().flatten().map(|corner| corner[2]);
    let (low, high) = (heights().fold(f64::MAX, f64::min), heights().fold(f64::MIN, f64::max));
    let lowest = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0]]
        .map(|[x, y]: [f64; 2]| ground_m(150.0 + x, 120.0 + y))
        .into_iter()
        .fold(f64::MAX, f64::min);
    assert!((low - lowest).abs() < 0.3 && (high - low - 12.0).abs() < 1e-3, "{low} {high} {lowest}");
}

#[test]
fn the_finest_model_counts_and_fades_into_the_coarser_one() {
    let coarse = grid([0.0, 0.0], [41, 41], 10.0, |_, _| 50.0);
    let fine = grid([100.0, 100.0], [201, 201], 1.0, |_, _| 53.0);
    let files = [("coarse.asc", &*coarse), ("fine.asc", &fine)];
    let (scene, _) = read_files("finest", &files, &ReadOptions::default());
    let terrain = corners(&scene, ObjectKind::Terrain);
    for (place, expected) in
        [([50.0, 50.0], 50.0), ([200.0, 200.0], 53.0), ([380.0, 20.0], 50.0), ([120.0, 280.0], 53.0)]
    {
        let height = height_at(&terrain, place).unwrap();
        assert!((height - expected).abs() < 0.21, "{place:?}: {height}");
    }
    let steepest = terrain.iter().map(|[a, b, c]| {
        let rise = [a, b, c].map(|p| p[2]);
        let length = (b[0] - a[0]).hypot(b[1] - a[1]).min((c[0] - a[0]).hypot(c[1] - a[1]));
        (rise.iter().copied().fold(f64::MIN, f64::max) - rise.iter().copied().fold(f64::MAX, f64::min)) / length
    });
    let steepest = steepest.fold(0.0, f64::max);
    assert!(steepest > 0.1 && steepest < 1.0, "a slope, no cliff: {steepest}");
}

#[test]
fn degrees_and_holes_are_placed() {
    // SRTM's tile at 48 degrees north and 9 degrees east, whose heights grow to the east by a metre a sample.
    let samples = (0..1201 * 1201_i32).flat_map(|i| {
        let (column, row) = (i % 1201, i / 1201);
        let is_hole = (600..640).contains(&column) && (600..640).contains(&row);
        (if is_hole { -32768 } else { column as i16 }).to_be_bytes()
    });
    let folder = TestFolder::new("elevation-degrees");
    fs::write(folder.path.join("N48E009.hgt"), samples.collect::<Vec<u8>>()).unwrap();
    // 9.5 degrees east, 48.75 degrees north, by pyproj: on the sample in column 600 and row 300.
    let place = [536_753.89, 5_399_785.65];
    fs::write(folder.path.join("a.geojson"), house([place[0] - EAST_M, place[1] - NORTH_M])).unwrap();
    let (scene, report) = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap();
    assert_eq!(report.crs.as_deref(), Some("EPSG:25832"));
    let house = corners(&scene, ObjectKind::Building);
    let low = house.iter().flatten().map(|corner| corner[2]).fold(f64::MAX, f64::min);
    assert!((low - 600.0).abs() < 0.3, "{low}");
    let terrain = corners(&scene, ObjectKind::Terrain);
    let near = [place[0] - EAST_M + 300.0, place[1] - NORTH_M + 200.0];
    // A sample is 61.2 m wide there.
    let height = height_at(&terrain, near).unwrap();
    assert!((height - (600.0 + 300.0 / 61.25)).abs() < 0.5, "{height}");
}

#[test]
fn rasters_without_a_place_are_refused() {
    let folder = TestFolder::new("elevation-nowhere");
    let path = folder.path.join("dem.tif");
    fs::write(&path, b"II*\0\x08\0\0\0\0\0\0\0\0\0").unwrap();
    assert!(read(std::slice::from_ref(&path), &ReadOptions::default(), &|_| {}).is_err());
    fs::write(&path, b"no raster at all").unwrap();
    let error = read(&[path], &ReadOptions::default(), &|_| {}).unwrap_err().to_string();
    assert!(error.contains("dem.tif"), "{error}");
}

#[test]
fn pictures_lie_where_they_belong() {
    // Squares of 10 m, each of its own colour, with pixels of half a metre.
    let colour = |x: f64, y: f64| [(x / 10.0).floor() as u8 * 12, (y / 10.0).floor() as u8 * 12, 77];
    let mut pixels = Vec::new();
    for row in 0..300 {
        for column in 0..400 {
            let (x, y) = (f64::from(column) * 0.5 + 0.25, 150.0 - f64::from(row) * 0.5 - 0.25);
            pixels.extend(colour(x, y));
        }
    }
    let mut picture = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut picture).unwrap();
    encoder.write_image::<tiff::encoder::colortype::RGB8>(400, 300, &pixels).unwrap();
    let folder = TestFolder::new("elevation-pictures");
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path.join(name), bytes).unwrap();
    write("photo.tif", picture.get_ref());
    write("photo.prj", b"EPSG:25832");
    write("photo.tfw", format!("0.5\n0\n0\n-0.5\n{}\n{}\n", EAST_M + 0.25, NORTH_M + 149.75).as_bytes());
    write("dem.asc", grid([-50.0, -50.0], [61, 51], 5.0, |x, y| 0.3 * x + 0.1 * y).as_bytes());
    write("dem.prj", b"EPSG:25832");
    let (scene, report) = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap();
    assert!(report.sources.iter().all(|source| source.problems.is_empty()), "{:?}", report.sources);
    let origin = [scene.origin[0] - EAST_M, scene.origin[1] - NORTH_M];
    let mut checked = 0;
    for triangle in &scene.triangles {
        let material = &scene.materials[triangle.material as usize];
        let texture = material.texture.as_ref().expect("a picture");
        let at = |weights: [f64; 3]| {
            let mix = |values: [f64; 3]| values.iter().zip(weights).map(|(value, weight)| value * weight).sum::<f64>();
            let position = [0, 1].map(|axis| mix(triangle.corners.map(|c| f64::from(c[axis]))) + origin[axis]);
            let uv = [0, 1].map(|axis| mix(triangle.uv.map(|uv| f64::from(uv[axis]))));
            (position, uv)
        };
        for weights in [[0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]] {
            let ([x, y], [u, v]) = at(weights);
            let is_near_edge = [x, y].iter().any(|c| (c / 10.0 - (c / 10.0).round()).abs() * 10.0 < 0.5);
            let is_inside = x > 1.0 && y > 1.0 && x < 199.0 && y < 149.0;
            if is_inside && !is_near_edge {
                let column = (u * f64::from(texture.width)) as usize;
                let row = ((1.0 - v) * f64::from(texture.height)) as usize;
                let found = texture.rgb[row * texture.width as usize + column];
                let [r, g, _] = colour(x, y);
                // Level with lit materials, so only the order of brightness is that of the file.
                let expected = [r, g];
                let gain = f64::from(found[2]) / 77.0;
                for (found, expected) in found.iter().zip(expected) {
                    let wanted = f64::from(expected) * gain;
                    assert!((f64::from(*found) - wanted).abs() < 6.0 + 0.05 * wanted, "{x} {y}: {found} {wanted}");
                }
                checked += 1;
            }
        }
    }
    assert!(checked >= 6, "{checked}");
}

/// A picture of one colour, 100 m wide, with its south-western corner at a place.
fn write_picture(folder: &TestFolder, [x, y]: [f64; 2]) {
    let mut picture = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut picture).unwrap();
    let pixels = [[20, 200, 90]; 10_000].concat();
    encoder.write_image::<tiff::encoder::colortype::RGB8>(100, 100, &pixels).unwrap();
    let place = format!("1\n0\n0\n-1\n{}\n{}\n", EAST_M + x + 0.5, NORTH_M + y + 99.5);
    for (name, bytes) in
        [("photo.tif", &picture.get_ref()[..]), ("photo.prj", b"EPSG:25832"), ("photo.tfw", place.as_bytes())]
    {
        fs::write(folder.path.join(name), bytes).unwrap();
    }
}

#[test]
fn pictures_without_a_model_lie_on_generated_ground() {
    for (place, level_ground, problem) in [
        ([-40.0, -40.0], true, None),
        ([-40.0, -40.0], false, Some("picture without an elevation model, not drawn")),
        ([5000.0, 0.0], true, Some("picture from above far from the city, not drawn")),
    ] {
        let folder = TestFolder::new("elevation-picture-only");
        write_picture(&folder, place);
        fs::write(folder.path.join("house.geojson"), house([0.0, 0.0])).unwrap();
        let options = ReadOptions { level_ground, ..ReadOptions::default() };
        let (scene, report) = read(std::slice::from_ref(&folder.path), &options, &|_| {}).unwrap();
        let problems: Vec<&str> =
            report.sources.iter().flat_map(|source| source.problems.keys()).map(String::as_str).collect();
        assert_eq!(problems, Vec::from_iter(problem));
        assert_eq!(report.warnings().count(), problem.iter().count());
        let textured = |t: &&crate::scene::SceneTriangle| scene.materials[t.material as usize].texture.is_some();
        assert_eq!(scene.triangles.iter().filter(textured).count() > 0, problem.is_none());
        if problem.is_none() {
            let ground = corners(&scene, ObjectKind::Terrain);
            assert!((height_at(&ground, [5.0, 20.0]).unwrap()).abs() < 1e-3);
        }
    }
}

#[test]
fn packed_models_are_read_under_any_name() {
    let dem = grid([-50.0, -50.0], [31, 31], 5.0, |_, _| 30.0);
    for name in ["dem.asc", "dem.asc.gz"] {
        let folder = TestFolder::new("elevation-packed");
        fs::write(folder.path.join(name), gzip(dem.as_bytes())).unwrap();
        fs::write(folder.path.join("dem.prj"), "EPSG:25832").unwrap();
        fs::write(folder.path.join("house.geojson"), gzip(house([0.0, 0.0]).as_bytes())).unwrap();
        let (scene, _) = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap();
        let house = corners(&scene, ObjectKind::Building);
        let low = house.iter().flatten().map(|corner| corner[2]).fold(f64::INFINITY, f64::min);
        assert!((low - 30.0).abs() < 0.1, "{name}: {low}");
    }
}

/// A tile of quantized-mesh: a square with one height.
fn flat_tile(height_m: f32) -> Vec<u8> {
    let mut bytes = vec![0; 88];
    bytes[24..28].copy_from_slice(&height_m.to_le_bytes());
    bytes[28..32].copy_from_slice(&height_m.to_le_bytes());
    bytes.extend(4_u32.to_le_bytes());
    // Zigzag steps of u, v and the height.
    let vertices: [u16; 12] = [0, 65534, 65533, 65534, 0, 0, 65534, 0, 0, 0, 0, 0];
    bytes.extend(vertices.iter().flat_map(|number| number.to_le_bytes()));
    bytes.extend(2_u32.to_le_bytes());
    let codes: [u16; 6] = [0, 0, 0, 2, 0, 2];
    bytes.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
    bytes.extend([0; 16]);
    bytes
}

#[test]
fn heights_of_terrain_tiles_are_above_the_ellipsoid() {
    // The tiles at 9 degrees east and 48.75 degrees north.
    let layers = [("EPSG:4326", "8/268/197.terrain"), ("EPSG:3857", "9/268/335.terrain")];
    let heights = layers.map(|(projection, tile)| {
        let folder = TestFolder::new(&format!("elevation-tiles-{}", &projection[5..]));
        let tile = folder.path.join("terrain").join(tile);
        fs::create_dir_all(tile.parent().unwrap()).unwrap();
        fs::write(tile, flat_tile(150.0)).unwrap();
        let layer = format!(
            r#"{{"format": "quantized-mesh-1.0", "projection": "{projection}", "tiles": ["{{z}}/{{x}}/{{y}}.terrain"]}}"#
        );
        fs::write(folder.path.join("terrain/layer.json"), layer).unwrap();
        fs::write(folder.path.join("a.geojson"), house([0.0, 0.0])).unwrap();
        let (scene, report) = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap();
        assert!(report.sources.iter().any(|source| source.format == SourceFormat::Elevation));
        height_at(&corners(&scene, ObjectKind::Terrain), [40.0, 30.0]).unwrap()
    });
    // EGM96 is about 48 m above the ellipsoid there.
    assert!(heights.iter().all(|height| (100.0..104.0).contains(height)), "{heights:?}");
    assert!((heights[0] - heights[1]).abs() < 0.01, "{heights:?}");
}

#[test]
fn ground_goes_on_under_the_city_and_in_gaps() {
    let plane = |x: f64, y: f64| 50.0 + 0.02 * x + 0.01 * y;
    let with_gap = |x: f64, y: f64| {
        let is_gap = (60.0..90.0).contains(&x) && (60.0..90.0).contains(&y);
        if is_gap { -9999.0 } else { plane(x, y) }
    };
    let dem = grid([0.0, 0.0], [41, 41], 5.0, with_gap);
    // One house on the model, and one 60 m beyond it.
    let files = [("a.geojson", &*house([20.0, 20.0])), ("b.geojson", &house([260.0, 100.0])), ("dem.asc", &dem)];
    let (scene, _) = read_files("extended", &files, &ReadOptions::default());
    let terrain = corners(&scene, ObjectKind::Terrain);
    let gap = height_at(&terrain, [75.0, 75.0]).expect("ground in the gap");
    assert!((gap - plane(75.0, 75.0)).abs() < 1.0, "{gap}");
    let beyond = height_at(&terrain, [265.0, 105.0]).expect("ground under the house");
    assert!((beyond - 54.5).abs() < 1.5, "{beyond}");
}

#[test]
fn flat_areas_are_painted_and_water_stays_a_surface() {
    // About 9 degrees east, 48.75301 degrees north: the origin of the test's maps. A degree is 73.5 km and 111.2 km long.
    let node = |id: i64, x: f64, y: f64| {
        format!(r#"<node id="{id}" lat="{}" lon="{}"/>"#, 48.753_010 + y / 111_200.0, 9.0 + x / 73_500.0)
    };
    let square = |first: i64, x: f64, y: f64, side: f64, tags: &str| {
        let corners = [[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
        let nodes: String = corners.iter().zip(first..).map(|([x, y], id)| node(id, *x, *y)).collect();
        let refs: String = [0, 1, 2, 3, 0].map(|i| format!(r#"<nd ref="{}"/>"#, first + i)).concat();
        (nodes, format!(r#"<way id="{first}">{refs}{tags}</way>"#))
    };
    let parts = [
        square(10, 0.0, 0.0, 100.0, r#"<tag k="landuse" v="forest"/>"#),
        square(20, 150.0, 0.0, 60.0, r#"<tag k="natural" v="water"/>"#),
        square(30, 0.0, 150.0, 15.0, r#"<tag k="building" v="yes"/><tag k="height" v="9"/>"#),
    ];
    let bridge =
        r#"<way id="40"><nd ref="21"/><nd ref="23"/><tag k="highway" v="primary"/><tag k="bridge" v="yes"/></way>"#;
    let osm = format!(
        r#"<osm version="0.6">{}{}{bridge}</osm>"#,
        parts.each_ref().map(|(nodes, _)| nodes.as_str()).concat(),
        parts.each_ref().map(|(_, way)| way.as_str()).concat()
    );
    let dem = grid([-300.0, -300.0], [81, 81], 10.0, |_, _| 20.0);
    let mut options = ReadOptions::default();
    options.placing.crs = Some("EPSG:25832".to_owned());
    let (scene, report) = read_files("painted", &[("a.osm", &*osm), ("dem.asc", &dem)], &options);
    let source = report.sources.iter().find(|source| source.format == SourceFormat::OpenStreetMap).unwrap();
    assert_eq!((source.painted, source.objects), (1, 3), "{source:?}");
    let water = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].is_reflective);
    assert!(water.count() >= 2, "water reflects");
    // The colour of terrain at a place, from the texture of the triangle there.
    let origin = [scene.origin[0] - EAST_M, scene.origin[1] - NORTH_M];
    let colour_at = |x: f64, y: f64| {
        scene.triangles.iter().find_map(|triangle| {
            let texture = scene.materials[triangle.material as usize].texture.as_ref()?;
            let [a, b, c] = triangle.corners.map(|c| [f64::from(c[0]) + origin[0], f64::from(c[1]) + origin[1]]);
            let cross = |p: [f64; 2], q: [f64; 2]| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
            let parts = [cross(b, c), cross(c, a), cross(a, b)];
            let area: f64 = parts.iter().sum();
            let weights = parts.map(|part| part / area);
            if weights.iter().any(|weight| *weight < 0.0) {
                return None;
            }
            let uv = [0, 1].map(|axis| (0..3).map(|i| f64::from(triangle.uv[i][axis]) * weights[i]).sum::<f64>());
            let column = (uv[0] * f64::from(texture.width)) as usize;
            let row = ((1.0 - uv[1]) * f64::from(texture.height)) as usize;
            Some(texture.rgb[row * texture.width as usize + column])
        })
    };
    let [r, g, b] = colour_at(50.0, 50.0).expect("a picture");
    assert!(g > r && g > b && g < 160, "forest: {r} {g} {b}");
    let [r, g, b] = colour_at(-100.0, -100.0).expect("a picture");
    assert!(g.abs_diff(r) < 10 && b <= r, "bare ground: {r} {g} {b}");
}

/// A CityJSON document of boxes with heights of their own: south-western corner, bottom, and side.
fn boxes(all: &[([f64; 3], f64)]) -> String {
    let (mut objects, mut vertices) = (Vec::new(), Vec::new());
    for (number, ([x, y, z], side)) in all.iter().enumerate() {
        let first = vertices.len();
        for k in 0..8 {
            let corner = [
                EAST_M + x + f64::from(k & 1) * side,
                NORTH_M + y + f64::from(k >> 1 & 1) * side,
                z + f64::from(k >> 2) * 8.0,
            ];
            vertices.push(format!("{:?}", corner.map(|v| (v * 1000.0).round() as i64)));
        }
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
        let faces: Vec<String> = faces.iter().map(|face| format!("[{:?}]", face.map(|k| first + k))).collect();
        objects.push(format!(
            r#""b{number}": {{"type": "Building", "geometry": [{{"type": "MultiSurface", "lod": "1", "boundaries": [{}]}}]}}"#,
            faces.join(", ")
        ));
    }
    format!(
        r#"{{"type": "CityJSON", "version": "2.0", "metadata": {{"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832"}},
        "transform": {{"scale": [0.001, 0.001, 0.001], "translate": [0, 0, 0]}},
        "CityObjects": {{{}}}, "vertices": [{}]}}"#,
        objects.join(", "),
        vertices.join(", ")
    )
}

#[test]
fn terrain_meets_buildings_that_have_heights() {
    let dem = grid([-100.0, -100.0], [21, 21], 25.0, |x, _| 100.0 + 0.1 * x);
    // The ground is at 111 m under the first one's middle, at 121 m under the second one's, at 131 m under the third
    // one's.
    let places = [([104.0, 100.0, 109.5], 12.0), ([204.0, 100.0, 123.0], 12.0), ([304.0, 100.0, 140.0], 12.0)];
    let files = [("a.city.json", &*boxes(&places)), ("dem.asc", &dem)];
    let read_with = |tolerance_m: f64| {
        let mut options = ReadOptions::default();
        options.terrain.tolerance_m = tolerance_m;
        read_files(&format!("fit-{tolerance_m}"), &files, &options)
    };
    let (scene, report) = read_with(3.0);
    let source = report.sources.iter().find(|source| source.format != SourceFormat::Elevation).unwrap();
    assert_eq!(source.terrain_fitted, 2);
    let fault = &source.problems["building above or below the elevation model by more than --terrain-tolerance"];
    assert_eq!((fault.count, fault.first.clone()), (1, vec!["b2: 9.0 m above".to_owned()]));
    let terrain = corners(&scene, ObjectKind::Terrain);
    let beside =
        |[x, y, _]: [f64; 3]| [[x + 6.0, y - 0.1], [x - 0.1, y + 6.0], [x + 12.1, y + 6.0], [x + 6.0, y + 12.1]];
    for (place, _) in &places[..2] {
        for position in beside(*place) {
            let height = height_at(&terrain, position).unwrap();
            assert!((height - place[2]).abs() < 0.5, "{position:?}: {height} instead of {}", place[2]);
        }
    }
    for [x, y] in [[90.0, 106.0], [150.0, 106.0], [110.0, 130.0], [303.5, 106.0], [310.0, 106.0]] {
        let height = height_at(&terrain, [x, y]).unwrap();
        assert!((height - (100.0 + 0.1 * x)).abs() < 0.21, "{x} {y}: {height}");
    }
    let (unchanged, report) = read_with(0.0);
    assert!(report.sources.iter().all(|source| source.terrain_fitted == 0 && source.problems.is_empty()));
    let terrain = corners(&unchanged, ObjectKind::Terrain);
    assert!((height_at(&terrain, [110.0, 106.0]).unwrap() - 111.0).abs() < 0.21);
}

#[test]
fn peaks_of_a_model_beside_the_grid_are_kept() {
    let mut random = insula_test_support::rng::Rng::new(3);
    let noise: Vec<f64> = (0..21 * 17).map(|_| random.range(-3.0, 3.0)).collect();
    let corner = [-103.7, -98.2];
    let at = |x: f64, y: f64| {
        noise[((y - corner[1]) / 25.0).round() as usize * 21 + ((x - corner[0]) / 25.0).round() as usize]
    };
    let dem = grid(corner, [21, 17], 25.0, at);
    let turned = {
        // The same model in another system: its rows do not run along the axes of the map.
        let mut options = ReadOptions::default();
        options.placing.crs = Some("EPSG:25833".into());
        options
    };
    for (name, options) in [("aligned", ReadOptions::default()), ("turned", turned)] {
        let (scene, _) = read_files(name, &[("dem.asc", &*dem)], &options);
        let z: Vec<f64> = corners(&scene, ObjectKind::Terrain).iter().flatten().map(|corner| corner[2]).collect();
        let highest = noise.iter().copied().fold(f64::MIN, f64::max);
        let found = z.iter().copied().fold(f64::MIN, f64::max);
        assert!((found - highest).abs() < 0.5, "{name}: {found} {highest}");
    }
    let (scene, _) = read_files("on-grid", &[("dem.asc", &*dem)], &ReadOptions::default());
    let terrain = corners(&scene, ObjectKind::Terrain);
    for i in 0..200 {
        let [x, y] = [corner[0] + 25.0 * f64::from(1 + i * 7 % 19), corner[1] + 25.0 * f64::from(1 + i * 5 % 15)];
        let height = height_at(&terrain, [x, y]).unwrap();
        assert!((height - at(x, y)).abs() < 0.21, "{x} {y}: {height} {}", at(x, y));
    }
}

#[test]
fn buildings_beyond_a_small_fine_model_stand_at_the_height_of_its_border() {
    let dem = grid([0.0, 0.0], [41, 46], 1.0, |_, _| 500.0);
    for place in [[30.0, 90.0], [-300.0, 700.0], [2000.0, 20.0]] {
        let files = [("a.geojson", house(place)), ("dem.asc", dem.clone())];
        let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
        let (scene, _) = read_files("beyond", &files, &ReadOptions::default());
        let heights: Vec<f64> =
            corners(&scene, ObjectKind::Building).iter().flatten().map(|corner| corner[2]).collect();
        assert!(heights.iter().all(|height| (499.0..513.0).contains(height)), "{place:?}: {heights:?}");
    }
}

#[test]
fn heights_that_are_none_on_land_are_missing_and_counted() {
    let hole = |x: f64, y: f64| (40.0..70.0).contains(&x) && (40.0..70.0).contains(&y);
    let dem = |mark: f64| grid([-100.0, -100.0], [61, 61], 5.0, |x, y| if hole(x, y) { mark } else { 500.0 });
    let files = |dem: String| [("a.geojson", house([150.0, 120.0])), ("dem.asc", dem)];
    let missing = |files: &[(&str, String)], options: &ReadOptions| {
        let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
        let (scene, report) = read_files("missing", &files, options);
        let heights: Vec<f64> = corners(&scene, ObjectKind::Terrain).iter().flatten().map(|corner| corner[2]).collect();
        assert!(heights.iter().all(|height| (height - 500.0).abs() < 0.1), "{heights:?}");
        report.guess_warnings().filter(|text| text.contains("taken as missing")).collect::<Vec<_>>()
    };
    let options = ReadOptions::default();
    let found = missing(&files(dem(-32768.0)), &options);
    assert!(found.len() == 1 && found[0].contains("36 pixels of -32768 taken as missing"), "{found:?}");
    // Esri's mark, in a file that does not tell it.
    let undeclared = dem(-9999.0).replace("NODATA_value -9999\n", "");
    assert_eq!(missing(&files(undeclared), &options), Vec::<String>::new());
    let by_hand = ReadOptions { nodata: Some(499.0), ..ReadOptions::default() };
    assert_eq!(missing(&files(dem(499.0)), &by_hand), Vec::<String>::new());
    let (_, report) = read_files("zeros", &[("a.geojson", &house([150.0, 120.0])), ("dem.asc", &dem(0.0))], &options);
    let warnings: Vec<String> = report.guess_warnings().collect();
    assert!(warnings.len() == 1 && warnings[0].contains("36 pixels of 0, others from 500 to 500"), "{warnings:?}");
}

#[test]
fn a_model_without_a_system_is_placed_by_the_option_or_by_its_degrees() {
    let dem = "ncols 3\nnrows 3\nxllcorner 9.0\nyllcorner 48.7\ncellsize 0.0005\n\
        500 500 500\n500 500 500\n500 500 500\n";
    let folder = TestFolder::new("elevation-no-system");
    fs::write(folder.path.join("dem.asc"), dem).unwrap();
    let (scene, report) = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap();
    assert_eq!(scene.crs.as_deref(), Some("EPSG:32632"));
    assert!(report.guess_warnings().any(|text| text.contains("look like degrees")));
}

#[test]
fn files_of_gdal_beside_a_model_tell_its_place_and_its_unit() {
    let dem = grid([-100.0, -100.0], [41, 41], 5.0, |x, y| ground_m(x, y) * 10.0 / 0.3048);
    let (x, y) = (EAST_M - 102.5, NORTH_M + 102.5);
    let aux = format!(
        "<PAMDataset><SRS>EPSG:25832</SRS><GeoTransform>{x}, 5, 0, {y}, 0, -5</GeoTransform><PAMRasterBand band=\"1\">\
         <UnitType>ft</UnitType><Scale>0.1</Scale></PAMRasterBand></PAMDataset>"
    );
    let moved = dem.replace("xllcenter 499900", "xllcenter 0");
    let files = [("a.geojson", &*house([-20.0, 20.0])), ("dem.asc", &moved), ("dem.asc.aux.xml", &aux)];
    let (scene, _) = read_files("aux", &files, &ReadOptions::default());
    let terrain = corners(&scene, ObjectKind::Terrain);
    for place in [[-50.0, -50.0], [0.0, 0.0], [50.0, 25.0]] {
        let found = height_at(&terrain, place).unwrap();
        assert!((found - ground_m(place[0], place[1])).abs() < 0.3, "{place:?}: {found}");
    }
}

#[test]
fn a_mask_beside_a_model_that_cannot_be_read_is_named() {
    let dem = grid([-100.0, -100.0], [41, 41], 5.0, ground_m);
    let files = [("a.geojson", &*house([-20.0, 20.0])), ("dem.asc", &dem), ("dem.asc.msk", "")];
    let (_, report) = read_files("mask", &files, &ReadOptions::default());
    assert!(report.placing_warnings().any(|text| text.starts_with("dem.asc.msk hides pixels and cannot be read")));
}
