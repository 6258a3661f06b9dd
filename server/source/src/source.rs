//! A city file: its name, its kind, its bytes and its lines.

use super::files::EmbeddedFiles;
use super::input::{Input, Share, SourceFiles};
use super::packed::{unpacked, unpacked_name};
use super::text::in_utf8;
use crate::error::InputError;
use insula_archive::file::open_regular;
use std::cell::Cell;
use std::io::{self, BufRead, Read};
use std::path::Path;
use std::rc::Rc;

/// End of the name of a file that places a mesh file: see `local_frame`.
pub const PLACE_FILE: &str = ".place.json";
/// Name of a file that may place the mesh files in its folder and below.
pub const METADATA_FILE: &str = "metadata.xml";

/// Progress of reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadProgress {
    /// Bytes of the given files that are done, compressed if the files are.
    pub bytes_done: u64,
    /// Size of all given files.
    pub bytes_total: u64,
}

/// One city file.
pub struct CitySource<'a> {
    /// For messages and the report.
    pub label: String,
    /// Name within `files`.
    pub name: String,
    pub files: Rc<dyn SourceFiles + 'a>,
    pub bytes: u64,
    /// Found in a folder rather than named by the user. It is then ignored if it turns out not to be a city file.
    pub found: bool,
    /// Shows the land around the city, and is not a part of it.
    pub is_surroundings: bool,
    /// Whether only what can be painted on the ground is taken of it.
    pub is_streets: bool,
    /// What is read of it.
    pub share: Share,
}

impl<'a> CitySource<'a> {
    /// A whole source that the user named.
    pub fn new(label: String, name: String, files: Rc<dyn SourceFiles + 'a>, bytes: u64) -> Self {
        Self { label, name, files, bytes, found: false, is_surroundings: false, is_streets: false, share: Share::WHOLE }
    }
}

impl CitySource<'_> {
    /// The source as readers take it. Unpacked sources with more bytes than `max_bytes` are refused.
    pub fn input(&self, max_bytes: u64) -> Input<'_> {
        let Self { label, name, files, share, .. } = self;
        Input { share: *share, ..Input::new(label, name, &**files, max_bytes) }
    }
}

/// Kind of a source by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceKind {
    /// CityJSON, GeoJSON, a tileset or a scene layer: the content decides.
    Json,
    /// CityJSONSeq or GeoJSON in lines: the content decides.
    JsonLines,
    GeoJson,
    GeoJsonLines,
    Obj,
    /// CityGML, or any other XML.
    Xml,
    FlatGeobuf,
    GeoPackage,
    Shapefile,
    GeoParquet,
    Csv,
    OpenStreetMap,
    Gltf,
    Ply,
    Stl,
    Off,
    /// A single tile of 3D Tiles.
    Tile,
    /// Heights of the ground on a grid.
    Elevation,
}

/// The kind by extension, ignoring `.gz`.
pub fn kind_by_name(name: &str) -> Option<SourceKind> {
    let name = unpacked_name(name).to_ascii_lowercase();
    // Some servers and mail programs add it.
    let name =
        name.strip_suffix(".txt").filter(|name| name.ends_with("json") || name.ends_with(".csv")).unwrap_or(&name);
    let is_metadata = name.strip_suffix(METADATA_FILE).is_some_and(|folder| folder.is_empty() || folder.ends_with('/'));
    if is_metadata || name.ends_with(PLACE_FILE) {
        return None;
    }
    match name.rsplit_once('.')?.1 {
        "json" | "cityjson" => Some(SourceKind::Json),
        "jsonl" | "ndjson" => Some(SourceKind::JsonLines),
        "geojson" => Some(SourceKind::GeoJson),
        "geojsonl" | "geojsons" | "geojsonseq" | "geojsonlines" | "geojsonld" => Some(SourceKind::GeoJsonLines),
        "obj" => Some(SourceKind::Obj),
        "gml" | "citygml" | "xml" => Some(SourceKind::Xml),
        "fgb" => Some(SourceKind::FlatGeobuf),
        "gpkg" => Some(SourceKind::GeoPackage),
        "shp" => Some(SourceKind::Shapefile),
        "parquet" | "geoparquet" | "parq" | "pq" => Some(SourceKind::GeoParquet),
        "csv" | "tsv" => Some(SourceKind::Csv),
        "osm" | "pbf" => Some(SourceKind::OpenStreetMap),
        "gltf" | "glb" => Some(SourceKind::Gltf),
        "ply" => Some(SourceKind::Ply),
        "stl" => Some(SourceKind::Stl),
        "off" => Some(SourceKind::Off),
        "b3dm" | "i3dm" | "cmpt" | "pnts" => Some(SourceKind::Tile),
        "tif" | "tiff" | "hgt" | "asc" | "las" | "laz" => Some(SourceKind::Elevation),
        _ => None,
    }
}

/// A reader of a source's unpacked bytes, and the number of packed bytes read so far.
pub struct OpenSource<'a> {
    pub reader: Box<dyn BufRead + 'a>,
    pub bytes_read: Rc<Cell<u64>>,
}

/// Opens a source, and unpacks it if it is packed by gzip. Fails if the file cannot be opened.
pub fn open<'a>(source: &'a CitySource<'_>) -> Result<OpenSource<'a>, InputError> {
    let opened = source.input(u64::MAX).open()?;
    Ok(OpenSource { reader: opened.reader, bytes_read: opened.bytes_read })
}

/// Reads a whole source. Fails if it has more than `limit` unpacked bytes, before more are in memory.
pub fn read_all(source: &CitySource<'_>, limit: u64) -> Result<Vec<u8>, InputError> {
    let too_large = || InputError::TooLarge { path: source.label.clone(), what: "its size in bytes".to_owned(), limit };
    if source.bytes > limit {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    let opened = open(source)?;
    let mut reader = opened.reader.take(limit.saturating_add(1));
    reader.read_to_end(&mut bytes).map_err(|cause| InputError::io(&source.label, cause))?;
    if bytes.len() as u64 > limit { Err(too_large()) } else { Ok(bytes) }
}

/// Reads a plain file that is not a source. Fails if it has more than `limit` bytes.
pub fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, InputError> {
    let label = path.display().to_string();
    let mut bytes = Vec::new();
    let file = open_regular(path).map_err(|cause| InputError::io(&label, cause))?;
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|cause| InputError::io(&label, cause))?;
    if bytes.len() as u64 > limit {
        return Err(InputError::TooLarge { path: label, what: "its size in bytes".to_owned(), limit });
    }
    Ok(bytes)
}

/// Reads a file next to the source, as named or with `.gz` appended. A text is in UTF-8, without a mark. Fails if the file has more than
/// `limit` unpacked bytes.
pub fn read_sibling(files: &dyn SourceFiles, name: &str, limit: u64) -> io::Result<Vec<u8>> {
    let inner = files.open(name).or_else(|error| files.open(&format!("{name}.gz")).map_err(|_| error))?;
    let mut bytes = Vec::new();
    unpacked(inner)?.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(io::Error::other(format!("more than {limit} bytes")));
    }
    in_utf8(name, bytes)
}

/// Result of [`next_line`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextLine {
    Complete,
    /// The line was longer than the limit and is skipped.
    TooLong,
    EndOfFile,
}

/// Reads the next line into `line`, without its end; a line of more than `limit` bytes is skipped. Fails if the source
/// cannot be read.
pub fn next_line(reader: &mut dyn BufRead, line: &mut Vec<u8>, limit: usize) -> io::Result<NextLine> {
    line.clear();
    let (mut any, mut status) = (false, NextLine::Complete);
    loop {
        let buffer = reader.fill_buf()?;
        if buffer.is_empty() {
            return Ok(if any { status } else { NextLine::EndOfFile });
        }
        any = true;
        let end = buffer.iter().position(|&byte| byte == b'\n');
        let part = &buffer[..end.unwrap_or(buffer.len())];
        if line.len() + part.len() > limit {
            status = NextLine::TooLong;
            line.clear();
        } else if status == NextLine::Complete {
            line.extend_from_slice(part);
        }
        let used = part.len() + usize::from(end.is_some());
        reader.consume(used);
        if end.is_some() {
            if line.last() == Some(&b'\r') {
                line.pop();
            }
            return Ok(status);
        }
    }
}

/// The city files among the given ones, sorted by name. All files are available as images and material libraries.
pub fn embedded<'a>(files: &'a [(&'a str, &'a [u8])]) -> Vec<CitySource<'a>> {
    let store: Rc<dyn SourceFiles + 'a> = Rc::new(EmbeddedFiles { files });
    let mut cities: Vec<_> = files.iter().filter(|(name, _)| kind_by_name(name).is_some()).collect();
    cities.sort_by_key(|(name, _)| *name);
    let source = |(name, bytes): &(&str, &[u8])| {
        CitySource::new((*name).to_owned(), (*name).to_owned(), Rc::clone(&store), bytes.len() as u64)
    };
    cities.into_iter().map(source).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kind_is_known_by_the_extension() {
        assert_eq!(kind_by_name("a.city.json"), Some(SourceKind::Json));
        assert_eq!(kind_by_name("A.CITY.JSONL.GZ"), Some(SourceKind::JsonLines));
        assert_eq!(kind_by_name("b.obj.gz"), Some(SourceKind::Obj));
        assert_eq!(kind_by_name("c.geojson.gz"), Some(SourceKind::GeoJson));
        for name in ["c.geojsonl", "c.geojsonseq", "c.GeoJSONLD.gz"] {
            assert_eq!(kind_by_name(name), Some(SourceKind::GeoJsonLines), "{name}");
        }
        assert_eq!((kind_by_name("c.geojson.txt"), kind_by_name("c.txt")), (Some(SourceKind::GeoJson), None));
        assert_eq!((kind_by_name("json.txt"), kind_by_name("a_json.txt")), (None, None));
        assert_eq!(kind_by_name("c.parq"), Some(SourceKind::GeoParquet));
        assert_eq!(kind_by_name("c.OSM.PBF"), Some(SourceKind::OpenStreetMap));
        assert_eq!(kind_by_name("c.gml"), Some(SourceKind::Xml));
        assert_eq!((kind_by_name("a_metadata.xml"), kind_by_name("a/metadata.xml")), (Some(SourceKind::Xml), None));
        assert_eq!(kind_by_name("b.mtl"), None);
        assert_eq!(kind_by_name("json"), None);
    }

    #[test]
    fn lines_have_any_ending_and_long_ones_are_skipped() {
        let mut text: &[u8] = b"one\r\ntwo is too long\n\nlast";
        let mut line = Vec::new();
        let mut seen = Vec::new();
        loop {
            match next_line(&mut text, &mut line, 5).unwrap() {
                NextLine::EndOfFile => break,
                status => seen.push((String::from_utf8(line.clone()).unwrap(), status)),
            }
        }
        let expected = [
            ("one", NextLine::Complete),
            ("", NextLine::TooLong),
            ("", NextLine::Complete),
            ("last", NextLine::Complete),
        ];
        assert_eq!(seen, expected.map(|(line, status)| (line.to_owned(), status)));
    }

    #[test]
    fn embedded_cities_are_sorted_and_other_files_are_siblings() {
        let files: [(&str, &[u8]); 3] = [("b.obj", b"2"), ("a.mtl", b"m"), ("a.obj", b"1")];
        let sources = embedded(&files);
        assert_eq!(sources.iter().map(|source| source.name.as_str()).collect::<Vec<_>>(), ["a.obj", "b.obj"]);
        assert_eq!(read_sibling(&*sources[0].files, "a.mtl", 10).unwrap(), b"m");
        assert!(read_sibling(&*sources[0].files, "a.mtl", 0).is_err());
        assert!(matches!(read_all(&sources[0], 0), Err(InputError::TooLarge { .. })));
        assert_eq!(read_all(&sources[0], 1).unwrap(), b"1");
    }
}
