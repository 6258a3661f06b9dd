//! Readers of city files: any files give a scene or an error. Each format has a program, all of which are this file.
#![no_main]

use insula_bake::read::{ReadOptions, read_embedded};
use libfuzzer_sys::fuzz_target;

/// The programs, and the file that each reads. The second of two files follows after a line with its extension.
pub const READERS: [(&str, &[&str]); 17] = [
    ("citygml", &["a.gml"]),
    ("cityjson", &["a.city.json"]),
    ("cityjsonseq", &["a.city.jsonl"]),
    ("csv", &["a.csv"]),
    ("flatgeobuf", &["a.fgb"]),
    ("geojson", &["a.geojson"]),
    ("geopackage", &["a.gpkg"]),
    ("geoparquet", &["a.parquet"]),
    ("gltf", &["a.glb"]),
    ("obj", &["a.obj", "a.mtl"]),
    ("openstreetmap", &["a.osm.pbf"]),
    ("openstreetmap_xml", &["a.osm"]),
    ("ply", &["a.ply"]),
    ("shapefile", &["a.shp", "a.dbf"]),
    ("stl", &["a.stl"]),
    ("tile3d", &["a.b3dm"]),
    ("tileset", &["tileset.json"]),
];

/// Reads an input as the files of a program. Panics if the program is none of the list.
pub fn read(program: &str, bytes: &[u8]) {
    let options = ReadOptions { max_texture_pixels: 1 << 16, max_source_bytes: 64 << 20, ..ReadOptions::default() };
    let (_, names) = READERS.into_iter().find(|(name, _)| *name == program).expect("a program of the list");
    let files: Vec<(&str, &[u8])> = match names {
        [first, second] => {
            let line = format!("\n{}\n", second.trim_start_matches("a."));
            let cut = bytes.windows(line.len()).position(|found| found == line.as_bytes());
            let (before, after) = cut.map_or((bytes, &b""[..]), |at| (&bytes[..at], &bytes[at + line.len()..]));
            vec![(*first, before), (*second, after)]
        }
        _ => names.iter().map(|name| (*name, bytes)).collect(),
    };
    let _ = read_embedded(&files, &options, &|_| {});
}

fuzz_target!(|bytes: &[u8]| read(option_env!("CARGO_BIN_NAME").unwrap_or_default(), bytes));
