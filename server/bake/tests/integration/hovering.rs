//! What hovers above something else, or above the ground alone, is open below in every format.

use super::support::{BakedCity, FACES, obj_box, options};
use insula_bake::{BakeOptions, GroundOption};
use insula_protocol::BlockMap;
use insula_protocol::blockmap::{MapColumn, STEPS_PER_CELL, strip_rows};
use insula_test_support::folder::TestFolder;
use insula_test_support::map_files::{feature_collection, rectangle};
use std::fmt::Write;
use std::fs;
use std::path::Path;

type Cuboid = [[f64; 3]; 2];

/// Four slabs with 8 m between them.
const SLABS: [Cuboid; 4] = [
    [[10.0, 10.0, 0.0], [50.0, 40.0, 1.0]],
    [[10.0, 10.0, 9.0], [50.0, 40.0, 10.0]],
    [[10.0, 10.0, 18.0], [50.0, 40.0, 19.0]],
    [[10.0, 10.0, 27.0], [50.0, 40.0, 28.0]],
];
/// Small houses so far away that there are levels above the leaves.
const FAR: [Cuboid; 2] = [[[-70.0, -70.0, 0.0], [-64.0, -64.0, 3.0]], [[140.0, 140.0, 0.0], [146.0, 146.0, 3.0]]];
/// World position of the zero of the formats with coordinates.
const WORLD: [f64; 2] = [500_000.0, 5_400_000.0];

fn corners([low, high]: &Cuboid) -> [[f64; 3]; 8] {
    std::array::from_fn(|i| std::array::from_fn(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] }))
}

/// The slabs as objects of their own, or as one, and the houses.
fn objects(is_one: bool) -> Vec<Vec<Cuboid>> {
    let slabs = if is_one { vec![SLABS.to_vec()] } else { SLABS.map(|slab| vec![slab]).to_vec() };
    slabs.into_iter().chain(FAR.map(|house| vec![house])).collect()
}

fn cityjson(objects: &[Vec<Cuboid>]) -> String {
    let (mut listed, mut vertices) = (Vec::new(), Vec::new());
    for (i, boxes) in objects.iter().enumerate() {
        let mut faces = Vec::new();
        for one in boxes {
            let first = vertices.len();
            faces.extend(FACES.map(|face| format!("[{:?}]", face.map(|k| first + k))));
            vertices.extend(corners(one).map(|corner| format!("{:?}", corner.map(|v| (v * 1000.0) as i64))));
        }
        let geometry = format!(r#"{{"type":"MultiSurface","lod":"2","boundaries":[{}]}}"#, faces.join(","));
        listed.push(format!(r#""b{i}":{{"type":"Building","geometry":[{geometry}]}}"#));
    }
    let transform = r#"{"scale":[0.001,0.001,0.001],"translate":[500000,5400000,0]}"#;
    format!(
        r#"{{"type":"CityJSON","version":"1.1","transform":{transform},"CityObjects":{{{}}},"vertices":[{}]}}"#,
        listed.join(","),
        vertices.join(",")
    )
}

fn obj(objects: &[Vec<Cuboid>]) -> String {
    let (mut text, mut vertices) = (String::new(), 0);
    for (i, boxes) in objects.iter().enumerate() {
        writeln!(text, "o b{i}").unwrap();
        for [low, high] in boxes {
            text += &obj_box(vertices, *low, *high);
            vertices += 8;
        }
    }
    text
}

fn citygml(objects: &[Vec<Cuboid>]) -> String {
    let mut text = String::from(
        r#"<CityModel xmlns="http://www.opengis.net/citygml/2.0" xmlns:gml="http://www.opengis.net/gml"
 xmlns:bldg="http://www.opengis.net/citygml/building/2.0"><gml:boundedBy><gml:Envelope srsName="urn:ogc:def:crs:EPSG::25832"
 srsDimension="3"><gml:lowerCorner>499900 5399900 0</gml:lowerCorner><gml:upperCorner>500200 5400200 28</gml:upperCorner>
</gml:Envelope></gml:boundedBy>"#,
    );
    for (i, boxes) in objects.iter().enumerate() {
        write!(text, r#"<cityObjectMember><bldg:Building gml:id="b{i}"><bldg:lod2MultiSurface><gml:MultiSurface>"#)
            .unwrap();
        for (corners, face) in boxes.iter().flat_map(|one| FACES.map(|face| (corners(one), face))) {
            let ring = [0, 1, 2, 3, 0].map(|k: usize| corners[face[k]]);
            let positions = ring.map(|[x, y, z]| format!("{} {} {z}", x + WORLD[0], y + WORLD[1])).join(" ");
            write!(
                text,
                "<gml:surfaceMember><gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>{positions}</gml:posList>\
                 </gml:LinearRing></gml:exterior></gml:Polygon></gml:surfaceMember>"
            )
            .unwrap();
        }
        text.push_str("</gml:MultiSurface></bldg:lod2MultiSurface></bldg:Building></cityObjectMember>");
    }
    text + "</CityModel>"
}

/// A binary glTF with a mesh for each object, with y up.
fn glb(objects: &[Vec<Cuboid>]) -> Vec<u8> {
    let (mut binary, mut count) = (Vec::new(), 0);
    let (mut views, mut accessors, mut meshes, mut nodes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (i, boxes) in objects.iter().enumerate() {
        let (offset, first) = (binary.len(), count);
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        for (corners, [a, b, c, d]) in boxes.iter().flat_map(|one| FACES.map(|face| (corners(one), face))) {
            for [x, y, z] in [a, b, c, a, c, d].map(|k| corners[k]) {
                let position = [x as f32, z as f32, -y as f32];
                low = std::array::from_fn(|axis| low[axis].min(position[axis]));
                high = std::array::from_fn(|axis| high[axis].max(position[axis]));
                binary.extend(position.into_iter().flat_map(f32::to_le_bytes));
                count += 1;
            }
        }
        let (bytes, n) = (binary.len() - offset, count - first);
        views.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{bytes}}}"#));
        accessors.push(format!(
            r#"{{"bufferView":{i},"componentType":5126,"count":{n},"type":"VEC3","min":{low:?},"max":{high:?}}}"#
        ));
        meshes.push(format!(r#"{{"primitives":[{{"attributes":{{"POSITION":{i}}}}}]}}"#));
        nodes.push(format!(r#"{{"mesh":{i},"name":"b{i}"}}"#));
    }
    let roots: Vec<usize> = (0..objects.len()).collect();
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":{roots:?}}}],"nodes":[{}],"meshes":[{}],"accessors":[{}],"bufferViews":[{}],"buffers":[{{"byteLength":{}}}]}}"#,
        nodes.join(","),
        meshes.join(","),
        accessors.join(","),
        views.join(","),
        binary.len()
    );
    json.extend(std::iter::repeat_n(' ', json.len().next_multiple_of(4) - json.len()));
    let chunk = |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes()[..], &kind[..], bytes].concat();
    let chunks = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", &binary)].concat();
    let length = chunks.len() as u32 + 12;
    [&b"glTF"[..], &2u32.to_le_bytes()[..], &length.to_le_bytes()[..], &chunks[..]].concat()
}

/// Each box as a way with its heights as tags.
fn osm(objects: &[Vec<Cuboid>]) -> String {
    const METRES_PER_DEGREE: [f64; 2] = [74_600.0, 111_200.0];
    let (mut nodes, mut ways, mut id) = (String::new(), String::new(), 0);
    for [low, high] in objects.iter().flatten() {
        let mut refs = Vec::new();
        for [x, y] in [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]] {
            id += 1;
            let [lon, lat] = [9.0 + x / METRES_PER_DEGREE[0], 48.0 + y / METRES_PER_DEGREE[1]];
            write!(nodes, r#"<node id="{id}" lat="{lat:.8}" lon="{lon:.8}" version="1"/>"#).unwrap();
            refs.push(format!(r#"<nd ref="{id}"/>"#));
        }
        refs.push(refs[0].clone());
        let base = if low[2] > 0.0 { format!(r#"<tag k="min_height" v="{}"/>"#, low[2]) } else { String::new() };
        write!(
            ways,
            r#"<way id="{id}" version="1">{}<tag k="building" v="yes"/>{base}<tag k="height" v="{}"/></way>"#,
            refs.concat(),
            high[2]
        )
        .unwrap();
    }
    format!(r#"<?xml version="1.0"?><osm version="0.6">{nodes}{ways}</osm>"#)
}

/// Each box as a polygon with its heights as properties.
fn geojson(objects: &[Vec<Cuboid>]) -> String {
    let feature = |[low, high]: &Cuboid| {
        let base = if low[2] > 0.0 { format!(r#""min_height":{},"#, low[2]) } else { String::new() };
        let members = format!(r#""properties":{{{base}"height":{}}}"#, high[2]);
        rectangle(&members, [WORLD[0] + low[0], WORLD[1] + low[1], WORLD[0] + high[0], WORLD[1] + high[1]])
    };
    let features: Vec<String> = objects.iter().flatten().map(feature).collect();
    feature_collection("EPSG:25832", &features)
}

fn bake_file(name: &str, content: &[u8], ground: GroundOption) -> BakedCity {
    let folder = TestFolder::new(&format!("hovering-{name}"));
    fs::write(folder.path.join(name), content).unwrap();
    let options =
        BakeOptions { inputs: vec![name.into()], ground, cell_m: 1.0, meshes: false, ..options(Path::new(""), 2) };
    BakedCity::bake_files(&folder.path, options)
}

/// Full and open height codes of a column.
fn full_and_open(column: &MapColumn, z_shift: u8) -> [u32; 2] {
    let codes_per_row = STEPS_PER_CELL >> z_shift;
    let (first, _) = strip_rows(column.z_min, column.z_max, z_shift);
    let is_open = |code: &u16| {
        let is_in_gap = column.gap.is_some_and(|[low, high]| (low..high).contains(code));
        let row = usize::from(code / codes_per_row - first);
        is_in_gap || column.strip.as_ref().is_some_and(|strip| strip.texels[row].is_open())
    };
    let open = (column.z_min..column.z_max).filter(is_open).count() as u32;
    [u32::from(column.z_max - column.z_min) - open, open]
}

/// The share that is open of columns higher than 5 m, and the number of columns, at a level.
fn open_share(city: &BakedCity, level: u8) -> (f64, usize) {
    let (mut full_codes, mut open_codes, mut count) = (0, 0, 0);
    for map in city.maps().into_values().filter(|map| map.id.level() == level).map(BlockMap::stand_on_ground) {
        let is_high = |column: &&MapColumn| f32::from(column.z_max - column.z_min) * map.z_step_m() > 5.0;
        for column in map.columns().iter().flatten().filter(is_high) {
            let [full, open] = full_and_open(column, map.z_shift);
            (full_codes, open_codes, count) = (full_codes + full, open_codes + open, count + 1);
        }
    }
    (f64::from(open_codes) / f64::from(full_codes + open_codes), count)
}

fn leaf_level(city: &BakedCity) -> u8 {
    city.nodes().keys().map(|id| id.level()).max().unwrap()
}

#[test]
fn slabs_above_one_another_are_open_between_in_every_format() {
    let [one, sep] = [true, false].map(objects);
    let reference = bake_file("one.city.json", cityjson(&one).as_bytes(), GroundOption::Auto);
    let leaves = leaf_level(&reference);
    let expected: Vec<(f64, usize)> = (0..3).map(|up| open_share(&reference, leaves - up)).collect();
    assert!(expected[0].0 > 0.8 && expected[2].0 > 0.4, "{expected:?}");
    let formats = [
        ("sep.city.json", cityjson(&sep).into_bytes()),
        ("sep.obj", obj(&sep).into_bytes()),
        ("sep.gml", citygml(&sep).into_bytes()),
        ("sep.glb", glb(&sep)),
        ("sep.osm", osm(&sep).into_bytes()),
        ("sep.geojson", geojson(&sep).into_bytes()),
    ];
    for (name, content) in formats {
        let city = bake_file(name, &content, GroundOption::Auto);
        let leaves = leaf_level(&city);
        for (up, (share, count)) in (0..).zip(&expected) {
            let (found, found_count) = open_share(&city, leaves - up);
            assert!((found - share).abs() < 0.01, "{name}, {up} above the leaves: {found} instead of {share}");
            assert!(found_count.abs_diff(*count) <= count / 5, "{name}: {found_count} instead of {count} columns");
        }
    }
}

#[test]
fn a_lonely_roof_is_open_below() {
    let roof = [[20.0, 20.0, 8.0], [44.0, 40.0, 9.0]];
    let houses = [[[-20.0, -20.0, 0.0], [-14.0, -14.0, 3.0]], [[70.0, 70.0, 0.0], [76.0, 76.0, 3.0]]];
    let all = [roof, houses[0], houses[1]].map(|one| vec![one]);
    for ground in [GroundOption::Auto, GroundOption::None] {
        for (name, content) in
            [("roof.osm", osm(&[vec![roof]])), ("roofs.osm", osm(&all)), ("roofs.city.json", cityjson(&all))]
        {
            let city = bake_file(name, content.as_bytes(), ground);
            let (leaves, origin_m) = (leaf_level(&city), city.manifest().origin[2]);
            let mut count = 0;
            for map in city.maps().into_values().filter(|map| map.id.level() == leaves).map(BlockMap::stand_on_ground) {
                let z_m = |code: u16| origin_m + map.z_base_m() + f64::from(f32::from(code) * map.z_step_m());
                let is_roof = |column: &&MapColumn| z_m(column.z_max) > 8.9;
                for column in map.columns().iter().flatten().filter(is_roof) {
                    let [full, _] = full_and_open(column, map.z_shift);
                    assert!(full as f32 * map.z_step_m() < 2.6, "{name} {ground:?}: {column:?}");
                    let lowest_m = z_m(column.z_min);
                    let is_right = if ground == GroundOption::Auto { lowest_m < 0.1 } else { lowest_m > 7.9 };
                    assert!(is_right, "{name} {ground:?}: {lowest_m}");
                    count += 1;
                }
            }
            assert!(count > 400, "{name} {ground:?}: {count}");
        }
    }
}
