//! Formats of city models that are not read, and the program that converts each.

use crate::error::InputError;
use crate::source::{SourceKind, kind_by_name};
use flate2::read::GzDecoder;
use insula_archive::file::open_regular;
use insula_protocol::text::shell_word;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// How a file becomes one that is read.
enum Conversion {
    /// A command, with `IN` and `OUT` in place of the file's path and of its path with this extension.
    Command { command: &'static str, extension: &'static str },
    /// Anything else to do.
    Advice(&'static str),
    /// It is read under a name with this extension.
    Rename(&'static str),
}
use Conversion::{Advice, Command, Rename};

const TO_OBJ: Conversion = Command { command: "assimp export IN OUT", extension: "obj" };
/// GeoPackage has several layers, and keeps the coordinate system and surfaces in space.
const TO_GPKG: Conversion = Command { command: "ogr2ogr -f GPKG OUT IN", extension: "gpkg" };
const FROM_POINTS: Conversion =
    Advice("points have no surfaces: roofer (github.com/3DBAG/roofer) makes CityJSONSeq of them and of footprints");
const FROM_TEXT: Conversion = Advice(
    "gdal_translate makes an elevation model (.tif) of a grid of heights, and PDAL a point cloud (.laz) of other points",
);
const FROM_CAD: Conversion =
    Advice("export its bodies as OBJ or STL, in metres, from the program that made it; --at places meshes");
const FROM_SKETCHUP: Conversion =
    Advice("export it from SketchUp as glTF (.glb), or as OBJ in metres; --at places meshes");
const FROM_RHINO: Conversion = Advice("export it from Rhino as OBJ, in metres and with z up; --at places meshes");
const FROM_REVIT: Conversion =
    Advice("export it from Revit as IFC, and convert that with: IfcConvert MODEL.ifc MODEL.obj; --at places meshes");
const FROM_BLENDER: Conversion = Advice("export it from Blender as glTF (.glb); --at places meshes");
const FROM_3DS_MAX: Conversion =
    Advice("export it from 3ds Max as glTF (.glb), or as OBJ in metres; --at places meshes");
const TO_GEOTIFF: Conversion = Command { command: "gdal_translate IN OUT", extension: "tif" };
const FROM_HISTORY: Conversion = Advice("osmium time-filter makes a map of one day (.osm.pbf) of it");
const FROM_CHANGES: Conversion = Advice("osmium apply-changes makes a map (.osm.pbf) of one and its changes");
const FROM_PAGE: Conversion = Advice("see what it says, and fetch the file again");
const FROM_OVERPASS: Conversion = Advice("ask the API for XML ([out:xml]), and name the file .osm");
const TO_OSM: Conversion = Command { command: "osmium cat IN -o OUT", extension: "osm.pbf" };
const TO_CSV: Conversion = Command { command: "ogr2ogr -f CSV OUT IN", extension: "csv" };
/// Its world file tells no coordinate system.
const TO_PLACED_TIF: Conversion = Command { command: "gdal_translate -a_srs EPSG:N IN OUT", extension: "tif" };
const FROM_DATABASE: Conversion =
    Advice("convert the folder .gdb that it is of with: ogr2ogr -f GPKG OUT.gpkg FOLDER.gdb");
const UNPACK: Conversion = Advice("unpack it and give the files in it, or pack them as .zip");
const FROM_TILES_3D: Conversion = Advice("export the city again, as a folder or a .3tz: these are read");
const JOIN: Conversion = Advice("put its parts together, as 7z x NAME.zip.001 does, and give the files in it");
const UNPACK_OUTER: Conversion = Advice("unpack the outer archive and give its files");

/// Extensions, without `.gz`, with the name of the format.
const FORMATS: &[(&[&str], &str, Conversion)] = &[
    (&["kml", "kmz"], "KML", TO_GPKG),
    (&["gdb", "mdb"], "Esri geodatabase", TO_GPKG),
    (&["gdbtable"], "a table of an Esri geodatabase", FROM_DATABASE),
    (&["tab", "mif"], "MapInfo", TO_GPKG),
    (&["sqlite"], "SpatiaLite", TO_GPKG),
    (&["mbtiles", "pmtiles"], "vector tiles", TO_GPKG),
    (&["gpx"], "GPX", TO_GPKG),
    (&["xlsx", "ods"], "spreadsheets", TO_CSV),
    (&["ifc"], "IFC", Command { command: "IfcConvert IN OUT", extension: "obj" }),
    (&["fbx"], "FBX", TO_OBJ),
    (&["3ds"], "3DS", TO_OBJ),
    (&["dae"], "COLLADA", TO_OBJ),
    (&["x3d"], "X3D", TO_OBJ),
    (&["wrl", "vrml"], "VRML", TO_OBJ),
    (&["usd", "usda", "usdc", "usdz"], "USD", FROM_BLENDER),
    (&["step", "stp", "iges", "igs"], "bodies of CAD programs", FROM_CAD),
    (&["topojson"], "TopoJSON", TO_GPKG),
    (&["dwg", "dxf", "dgn"], "CAD drawings", FROM_CAD),
    (&["skp"], "SketchUp", FROM_SKETCHUP),
    (&["3dm"], "Rhino", FROM_RHINO),
    (&["rvt"], "Revit", FROM_REVIT),
    (&["max"], "3ds Max", FROM_3DS_MAX),
    (&["blend"], "Blender", FROM_BLENDER),
    (&["e57"], "point clouds", FROM_POINTS),
    (&["xyz"], "points as text", FROM_TEXT),
    (
        &["vrt", "img", "dem", "bil", "flt", "ecw", "jp2", "nc", "grd", "sdat", "dt0", "dt1", "dt2"],
        "rasters",
        TO_GEOTIFF,
    ),
    (&["o5m", "opl"], "OpenStreetMap in another form", TO_OSM),
    (&["osh"], "histories of OpenStreetMap", FROM_HISTORY),
    (&["osc"], "changes of OpenStreetMap", FROM_CHANGES),
    (&["7z", "rar", "tar", "tgz", "zst", "bz2", "xz"], "packed files", UNPACK),
    (&["001", "z01"], "a part of an archive", JOIN),
    (&["zip", "3tz", "slpk", "shz"], "an archive inside an archive", UNPACK_OUTER),
];

/// Pictures from above that are no GeoTIFF. In folders, they are textures.
const PICTURES: (&[&str], &str, Conversion) =
    (&["jpg", "jpeg", "png"], "a picture without a coordinate system", TO_PLACED_TIF);

/// First bytes of formats that are read under other names.
const BYTES: &[(&[u8], &str, Conversion)] = &[
    (b"SQLite format 3\0", "a GeoPackage or another database of SQLite", Rename("gpkg")),
    (b"PK\x03\x04", "a ZIP archive", Rename("zip")),
    (b"fgb\x03", "FlatGeobuf", Rename("fgb")),
    (b"PAR1", "Parquet", Rename("parquet")),
    (b"glTF", "glTF", Rename("glb")),
    (b"II*\0", "TIFF", Rename("tif")),
    (b"MM\0*", "TIFF", Rename("tif")),
    (b"LASF", "a point cloud", Rename("las")),
    (b"\0\0\x27\x0a", "a Shapefile", Rename("shp")),
];

/// Texts at the start of files that are read under other names, as in [`CONTENTS`].
const TEXTS: &[(&[&str], &str, Conversion)] = &[
    (&["\"type\"", "\"featurecollection\""], "GeoJSON", Rename("geojson")),
    (&["\"type\"", "\"feature\""], "GeoJSON", Rename("geojson")),
    (&["\"type\"", "\"cityjson\""], "CityJSON", Rename("city.json")),
    (&["<osm"], "OpenStreetMap", Rename("osm")),
    (&["<", "citymodel"], "CityGML", Rename("gml")),
];

/// Texts at the start of files whose content is of another format than their name says, and that format. A file must have all texts of a
/// row: JSON in its first bytes, others in the first tag or line.
const CONTENTS: &[(&[&str], &str, Conversion)] = &[
    (&["<!doctype html"], "a web page", FROM_PAGE),
    (&["<html"], "a web page", FROM_PAGE),
    (&["exceptionreport"], "the error of a web service", FROM_PAGE),
    (&["<serviceexception"], "the error of a web service", FROM_PAGE),
    (&["version https://git-lfs"], "a pointer of Git LFS", Advice("git lfs pull fetches the file that it stands for")),
    (&["<kml"], "KML", TO_GPKG),
    (&["<gpx"], "GPX", TO_GPKG),
    (&["\"geometrytype\"", "\"esrigeometry"], "Esri JSON", TO_GPKG),
    (&["\"type\"", "\"topology\"", "\"arcs\""], "TopoJSON", TO_GPKG),
    (&["\"elements\"", "\"nodes\""], "an answer of the Overpass API as JSON", FROM_OVERPASS),
    (&["\"elements\"", "\"osm3s\""], "an answer of the Overpass API as JSON", FROM_OVERPASS),
];
/// Bytes at the start of a file by which [`by_content`] knows its format.
pub const CONTENT_BYTES: u64 = 4096;

fn extension(name: &str) -> Option<String> {
    let name = name.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    Some(name.rsplit_once('.')?.1.to_owned())
}

fn find(name: &str) -> Option<&'static (&'static [&'static str], &'static str, Conversion)> {
    let extension = extension(name)?;
    FORMATS.iter().find(|(extensions, ..)| extensions.contains(&extension.as_str()))
}

/// Name of the format of a city model, or of something that becomes one, that is not read; `None` for any other file.
pub fn format_of(name: &str) -> Option<&'static str> {
    find(name).map(|(_, format, _)| *format)
}

/// The error of a file whose name is not that of a city file: how to convert it, if that is known.
pub fn refusal(path: &str) -> InputError {
    let is_picture = || extension(path).is_some_and(|extension| PICTURES.0.contains(&extension.as_str()));
    match find(path) {
        Some((_, format, conversion)) => not_read(path, format, conversion),
        None if is_picture() => not_read(path, PICTURES.1, &PICTURES.2),
        None => InputError::unknown_format(path, "its name is not that of a city file"),
    }
}

/// The same as [`refusal`], by the content of a file whose name tells nothing.
pub fn refusal_of_file(path: &Path) -> InputError {
    let label = path.display().to_string();
    let mut start = Vec::new();
    let read = |file: File| file.take(CONTENT_BYTES).read_to_end(&mut start);
    let is_read = find(&label).is_none() && open_regular(path).and_then(read).is_ok();
    let by_content = if is_read { by_content(&label, &start) } else { None };
    if open_regular(path).is_ok_and(|file| has_tileset(file).unwrap_or(false)) {
        return not_read(&label, "3D Tiles in PMTiles", &FROM_TILES_3D);
    }
    by_content.unwrap_or_else(|| refusal(&label))
}

/// Whether a file is an archive of PMTiles with a tileset in its metadata, as an export writes it. Fails if it is too short for one.
fn has_tileset(mut file: File) -> io::Result<bool> {
    /// Where the header has the position and the length of the metadata.
    const METADATA_AT: usize = 24;
    /// Where it has the type of the tiles: zero for one that PMTiles does not know.
    const TYPE_AT: usize = 99;
    let mut header = [0; TYPE_AT + 1];
    file.read_exact(&mut header)?;
    if !header.starts_with(b"PMTiles\x03") || header[TYPE_AT] != 0 {
        return Ok(false);
    }
    let number = |at: usize| header[at..at + 8].iter().rev().fold(0_u64, |all, byte| (all << 8) | u64::from(*byte));
    file.seek(SeekFrom::Start(number(METADATA_AT)))?;
    let mut start = Vec::new();
    GzDecoder::new(file.take(number(METADATA_AT + 8))).take(CONTENT_BYTES).read_to_end(&mut start)?;
    let text = String::from_utf8_lossy(&start);
    Ok(text.starts_with("{\"tileset\":") || text.starts_with("{\"subtrees\":"))
}

/// As [`refusal`], of a file in an archive, which programs do not find by its path.
pub fn refusal_in_archive(archive: &str, name: &str) -> InputError {
    let path = format!("{archive}/{name}");
    match find(name) {
        Some((_, format, conversion @ Command { .. })) => {
            let advice = format!("unpack {}, and {}", shell_word(archive), advice(name, conversion));
            InputError::NotRead { path, format, advice }
        }
        Some((_, format, conversion)) => not_read(&path, format, conversion),
        None => refusal(&path),
    }
}

/// The error of a file that could not be read and begins as one of another format; `None` if that is not known.
pub fn by_content(path: &str, start: &[u8]) -> Option<InputError> {
    let own = kind_by_name(path);
    let is_other = |conversion: &Conversion| match conversion {
        Rename(extension) => {
            let kind = kind_by_name(&format!("a.{extension}"));
            let are = |is_of: fn(SourceKind) -> bool| own.is_some_and(is_of) && kind.is_some_and(is_of);
            kind.is_none() || own != kind && !are(is_json) && !are(is_xml)
        }
        _ => true,
    };
    if let Some((_, format, conversion)) =
        BYTES.iter().find(|(bytes, _, conversion)| start.starts_with(bytes) && is_other(conversion))
    {
        return Some(not_read(path, format, conversion));
    }
    let start = String::from_utf8_lossy(start).to_lowercase();
    let start = start.trim_start_matches('\u{feff}').trim_start();
    let start = start.strip_prefix("<?xml").and_then(|rest| rest.split_once("?>")).map_or(start, |(_, rest)| rest);
    let is_json = start.starts_with('{');
    let start = if is_json { start } else { start.trim_start().split(['>', '\n']).next().unwrap_or_default() };
    let is_of_json = |text: &str| text.starts_with('"');
    let begins = |texts: &[&str]| texts.iter().all(|text| is_of_json(text) == is_json && start.contains(text));
    let mut rows = CONTENTS.iter().chain(TEXTS);
    let (_, format, conversion) = rows.find(|(texts, _, conversion)| begins(texts) && is_other(conversion))?;
    Some(not_read(path, format, conversion))
}

fn is_json(kind: SourceKind) -> bool {
    matches!(kind, SourceKind::Json | SourceKind::JsonLines | SourceKind::GeoJson | SourceKind::GeoJsonLines)
}

fn is_xml(kind: SourceKind) -> bool {
    matches!(kind, SourceKind::Xml | SourceKind::OpenStreetMap)
}

/// The error of a GML file without an element of CityGML: maps of agencies, downloads of web feature services.
pub fn plain_gml(path: &str) -> InputError {
    not_read(path, "GML without elements of CityGML", &TO_GPKG)
}

fn not_read(path: &str, format: &'static str, conversion: &Conversion) -> InputError {
    InputError::NotRead { path: path.to_owned(), format, advice: advice(path, conversion) }
}

/// How to make a file that is read of the one at `path`.
fn advice(path: &str, conversion: &Conversion) -> String {
    let renamed = |extension: &str| {
        let file = path.rfind('/').map_or(0, |slash| slash + 1);
        let end = path.strip_suffix(".gz").unwrap_or(path).rfind('.').filter(|end| *end > file).unwrap_or(path.len());
        format!("{}.{extension}", &path[..end])
    };
    match conversion {
        Advice(advice) => (*advice).to_owned(),
        Rename(extension) => format!("rename it to {}", renamed(extension)),
        Command { command, extension } => {
            let out = renamed(extension);
            let words = command.split(' ').map(|word| match word {
                "IN" => shell_word(path).into_owned(),
                "OUT" => shell_word(&out).into_owned(),
                word => word.to_owned(),
            });
            format!("convert it with: {}", words.collect::<Vec<_>>().join(" "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::gzip;
    use insula_test_support::folder::TestFolder;
    use std::fs;

    #[test]
    fn refusals_name_a_command_that_can_be_pasted() {
        let message = |path: &str| refusal(path).to_string();
        assert_eq!(
            message("in/my town.kml"),
            "in/my town.kml: KML: not read; convert it with: ogr2ogr -f GPKG 'in/my town.gpkg' 'in/my town.kml'"
        );
        assert!(message("x.y/a.ifc").ends_with("IfcConvert x.y/a.ifc x.y/a.obj"));
        for (name, tool) in [
            ("a.dwg", "CAD drawings: not read; export its bodies as OBJ or STL, in metres"),
            ("a.skp", "SketchUp: not read; export it from SketchUp as glTF"),
            ("a.3dm", "Rhino: not read; export it from Rhino as OBJ"),
            ("a.rvt", "Revit: not read; export it from Revit as IFC"),
            ("a.blend", "Blender: not read; export it from Blender as glTF"),
        ] {
            assert!(message(name).contains(tool) && message(name).contains("--at"), "{}", message(name));
        }
        assert!(message("a.e57").contains("roofer"));
        assert!(message("notes.txt").contains("supported are CityGML"), "any other file");
        assert!(message("none").contains("supported are CityGML"));
        assert!(message("a/town.gdb").ends_with("ogr2ogr -f GPKG a/town.gpkg a/town.gdb"));
        assert!(
            message("a.zip.001")
                .ends_with("put its parts together, as 7z x NAME.zip.001 does, and give the files in it")
        );
        assert_eq!((format_of("A.USDZ"), format_of("a.stp")), (Some("USD"), Some("bodies of CAD programs")));
        assert!(message("a.dt2").ends_with("rasters: not read; convert it with: gdal_translate a.dt2 a.tif"));
        assert!(message("a.o5m").ends_with("osmium cat a.o5m -o a.osm.pbf"));
        assert!(message("a.jpg").ends_with("gdal_translate -a_srs EPSG:N a.jpg a.tif"));
        assert_eq!(format_of("a.jpg"), None, "a texture");
    }

    #[test]
    fn contents_of_other_formats_are_known() {
        let message = |start: &str| by_content("a.geojson", start.as_bytes()).map(|error| error.to_string());
        for (start, format) in [
            ("\u{feff}\n<!DOCTYPE HTML><html>", "a web page: not read; see what it says"),
            ("<?xml version=\"1.0\"?><ows:ExceptionReport>", "the error of a web service"),
            ("version https://git-lfs.github.com/spec/v1\noid", "git lfs pull"),
            (
                r#"{"displayFieldName": "", "geometryType": "esriGeometryPolygon"}"#,
                "Esri JSON: not read; convert it with",
            ),
            (r#"{"type":"Topology","arcs":[]}"#, "TopoJSON"),
            (r#"{"version": 0.6, "elements": [{"type": "way", "nodes": [1]}]}"#, "[out:xml]"),
        ] {
            assert!(message(start).is_some_and(|text| text.contains(format)), "{start}: {:?}", message(start));
        }
        for start in
            [r#"{"type": "FeatureCollection", "note": "<html>"#, "<gml:FeatureCollection>\n<!-- <kml> -->", "nodes"]
        {
            assert_eq!(message(start), None, "{start}");
        }
    }

    #[test]
    fn formats_under_wrong_names_are_known_by_their_start() {
        let message = |path: &str, start: &[u8]| by_content(path, start).map(|error| error.to_string());
        let database = b"SQLite format 3\0\x10";
        let named = message("d.x/a.geojson", database).unwrap();
        assert!(named.ends_with("another database of SQLite: not read; rename it to d.x/a.gpkg"), "{named}");
        assert!(message("d.x/a", b"PAR1").unwrap().ends_with("rename it to d.x/a.parquet"));
        let lines = b"{\"type\": \"Feature\"}\n";
        assert!(message("a.dat", lines).unwrap().ends_with("GeoJSON: not read; rename it to a.geojson"));
        assert!(
            message("a.bin", b"<?xml version=\"1.0\"?>\n<core:CityModel xmlns=\"x\">").unwrap().contains("CityGML")
        );
        for (path, start) in
            [("a.gpkg", &database[..]), ("a.json", &lines[..]), ("a.xml", &b"<osm>"[..]), ("a.txt", &b"osm"[..])]
        {
            assert_eq!(message(path, start), None, "{path}");
        }
        let text = InputError::not_utf8("in/my town.json").to_string();
        assert!(text.ends_with("iconv -f WINDOWS-1252 -t UTF-8 'in/my town.json' > 'in/utf8-my town.json'"), "{text}");
    }

    #[test]
    fn a_tileset_in_an_archive_is_no_vector_tiles() {
        let folder = TestFolder::new("pmtiles");
        let path = folder.path.join("town.pmtiles");
        let metadata = gzip(br#"{"subtrees":{},"tileset":{}}"#);
        let mut archive = b"PMTiles\x03".to_vec();
        archive.resize(127, 0);
        archive[24..32].copy_from_slice(&127_u64.to_le_bytes());
        archive[32..40].copy_from_slice(&(metadata.len() as u64).to_le_bytes());
        archive.extend(&metadata);
        let message = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            refusal_of_file(&path).to_string()
        };
        assert!(message(&archive).contains("town.pmtiles: 3D Tiles in PMTiles: not read; export the city again"));
        archive[99] = 1;
        for other in [&archive[..], &archive[..50], &archive[..0]] {
            assert!(message(other).contains("vector tiles: not read; convert it with: ogr2ogr"));
        }
    }

    #[test]
    fn files_in_archives_are_unpacked_before() {
        let message = |name: &str| refusal_in_archive("my town.zip", name).to_string();
        assert_eq!(
            message("a/doc.kml"),
            "my town.zip/a/doc.kml: KML: not read; unpack 'my town.zip', and convert it with: ogr2ogr -f GPKG a/doc.gpkg a/doc.kml"
        );
        assert_eq!(
            message("b.zip"),
            "my town.zip/b.zip: an archive inside an archive: not read; unpack the outer archive and give its files"
        );
    }
}
