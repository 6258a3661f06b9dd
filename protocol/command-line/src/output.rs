//! What a command may write: nothing that it reads, nothing of the folders that the programs keep, and no file of another kind.

use insula_archive::file::open_regular;
use insula_archive::new_file::NewFile;
use insula_archive::places::{KeptFolder, canonical, kept_folder, kept_folder_above};
use serde_json::Value;
use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest JSON file that is taken for an earlier output.
const MAX_JSON_BYTES: u64 = 64 << 20;
/// Of other files, so many bytes are looked at.
const HEAD_BYTES: u64 = 64 << 10;

/// Ends of the names of models, and the extensions of files beside or below them without which they are not whole: materials, buffers
/// and textures.
const NEEDED_FILES: [(&[&str], &[&str]); 3] = [
    (&[".obj"], &["mtl", "png", "jpg", "jpeg", "webp", "tga", "bmp"]),
    (&[".gltf"], &["bin", "png", "jpg", "jpeg", "webp", "ktx2"]),
    (&[".gml", ".xml", ".city.json", ".city.jsonl"], &["xml", "png", "jpg", "jpeg", "webp", "tif", "tiff"]),
];

/// Option of all commands that write files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::Args)]
pub struct OverwriteArgs {
    /// Replace existing files of other kinds, too
    #[arg(long)]
    pub overwrite: bool,
}

/// What a file has, by which an earlier output of the same kind is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// First bytes, one of these.
    Begins(&'static str, &'static [&'static [u8]]),
    /// Text with all of these words in its first 64 KiB.
    Has(&'static str, &'static [&'static str]),
    /// Lines, of which the first that is no comment begins with one of these words.
    Lines(&'static str, &'static [&'static str]),
    /// A table whose first line ends in a column of this name.
    LastColumn(&'static str, &'static str),
    /// JSON with all of these members, or a list of such objects.
    Json(&'static str, &'static [&'static str]),
    /// Nothing that tells it from other files, so that an earlier output is not known, either.
    Unmarked(&'static str),
}

impl FileKind {
    /// PNG images.
    pub const PNG: Self = Self::Begins("a PNG image", &[b"\x89PNG"]);
    /// JPEG images.
    pub const JPEG: Self = Self::Begins("a JPEG image", &[b"\xff\xd8\xff"]);
    /// WebP images.
    pub const WEBP: Self = Self::Begins("a WebP image", &[b"RIFF"]);
    /// Grey and coloured PFM images.
    pub const PFM: Self = Self::Begins("a PFM image", &[b"Pf\n", b"PF\n"]);
    /// PLY files.
    pub const PLY: Self = Self::Begins("a PLY file", &[b"ply\n", b"ply\r"]);
    /// OFF files.
    pub const OFF: Self = Self::Begins("an OFF file", &[b"OFF\n", b"OFF\r", b"OFF ", b"COFF", b"NOFF", b"STOFF"]);
    /// OBJ files.
    pub const OBJ: Self = Self::Lines("an OBJ file", &["v", "vn", "vt", "f", "o", "g", "s", "mtllib", "usemtl"]);
    /// STL files: texts, and binary ones of our own. Those of other programs begin with any text.
    pub const STL: Self = Self::Begins("an STL file", &[b"solid", b"STL, "]);
    /// Compressed meshes.
    pub const COMPRESSED_MESH: Self = Self::Begins("a file of `compress`", &[b"INSM"]);
    /// GLB files.
    pub const GLB: Self = Self::Begins("a GLB file", &[b"glTF"]);
    /// TIFF files of either byte order.
    pub const TIFF: Self = Self::Begins("a TIFF file", &[b"II*\0", b"II+\0", b"MM\0*", b"MM\0+"]);
    /// Parquet files.
    pub const PARQUET: Self = Self::Begins("a Parquet file", &[b"PAR1"]);
    /// FlatGeobuf files.
    pub const FLATGEOBUF: Self = Self::Begins("a FlatGeobuf file", &[b"fgb"]);
    /// ZIP archives.
    pub const ZIP: Self = Self::Begins("a ZIP archive", &[b"PK\x03\x04"]);
    /// PMTiles archives.
    pub const PMTILES: Self = Self::Begins("a PMTiles archive", &[b"PMTiles"]);
    /// PDF files.
    pub const PDF: Self = Self::Begins("a PDF file", &[b"%PDF"]);
    /// DXF files, with either end of lines.
    pub const DXF: Self =
        Self::Begins("a DXF file", &[b"0\nSECTION\n", b"0\r\nSECTION\r", b"  0\nSECTION\n", b"  0\r\nSECTION\r"]);
    /// SVG files.
    pub const SVG: Self = Self::Has("an SVG file", &["<svg"]);
    /// GeoJSON files.
    pub const GEOJSON: Self = Self::Begins(
        "a GeoJSON file of a city or of an analysis",
        &[b"{\"type\":\"FeatureCollection\",\"name\":", b"{\"attribution\":"],
    );
    /// CityJSON text sequences.
    pub const CITYJSON_SEQUENCE: Self = Self::Has("a CityJSON text sequence", &["\"CityJSON\"", "\"type\""]);
    /// Tables of objects.
    pub const TABLE: Self = Self::LastColumn("a table of objects", "wkt");
    /// Tables of an analysis: of buildings, of points, of lines of sight, and of vistas.
    pub const ANALYSIS_TABLE: Self = Self::Begins(
        "a table of an analysis",
        &[
            b"object,identifier,roof_cells", b"id,x,y,z,hours", b"id,x,y,z,percent", b"from,to,length_m",
            b"vista,object,identifier",
        ],
    );
    /// Man pages.
    pub const MAN_PAGE: Self = Self::Has("a man page", &[".TH "]);
    /// Everything begins with no bytes.
    pub const ANY: Self = Self::Begins("a file", &[b""]);

    /// With its article, for messages.
    fn name(self) -> &'static str {
        match self {
            Self::Begins(name, _) | Self::Has(name, _) | Self::Lines(name, _) | Self::Json(name, _) => name,
            Self::LastColumn(name, _) | Self::Unmarked(name) => name,
        }
    }

    /// Whether a file is of this kind. A file without content is of any kind.
    pub fn is_of(self, path: &Path) -> bool {
        let Ok(mut file) = open_regular(path) else { return false };
        let length = file.metadata().map_or(0, |found| found.len());
        if length == 0 {
            return true;
        }
        let mut head = Vec::new();
        let limit = if matches!(self, Self::Json(..)) { MAX_JSON_BYTES } else { HEAD_BYTES };
        if file.by_ref().take(limit).read_to_end(&mut head).is_err() {
            return false;
        }
        let text = String::from_utf8_lossy(&head);
        match self {
            Self::Begins(_, all) => all.iter().any(|first| head.starts_with(first)),
            Self::Has(_, words) => !head.contains(&0) && words.iter().all(|word| text.contains(word)),
            Self::Lines(_, words) => {
                let line = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
                line.and_then(|line| line.split_whitespace().next()).is_some_and(|word| words.contains(&word))
            }
            Self::LastColumn(_, column) => {
                !head.contains(&0) && text.lines().next().is_some_and(|line| line.rsplit(',').next() == Some(column))
            }
            Self::Json(_, members) => {
                serde_json::from_slice::<Value>(&head).is_ok_and(|json| has_members(&json, members))
            }
            Self::Unmarked(_) => false,
        }
    }
}

fn has_members(json: &Value, members: &[&str]) -> bool {
    match json {
        Value::Array(list) => list.iter().all(|entry| entry.is_object() && has_members(entry, members)),
        json => members.iter().all(|member| json.get(member).is_some()),
    }
}

/// The files that a command reads and writes.
#[derive(Debug, Default)]
pub struct Outputs {
    inputs: Vec<PathBuf>,
    outputs: Vec<PathBuf>,
    /// Folders that the command creates before it writes the files.
    created: Vec<PathBuf>,
    may_overwrite: bool,
}

impl Outputs {
    /// Of a command with this option.
    pub fn new(args: OverwriteArgs) -> Self {
        Self { may_overwrite: args.overwrite, ..Self::default() }
    }

    /// Adds files and folders that the command reads. Addresses are none.
    #[must_use]
    pub fn reading<P: AsRef<Path>>(mut self, inputs: impl IntoIterator<Item = P>) -> Self {
        self.inputs.extend(inputs.into_iter().map(|input| input.as_ref().to_owned()));
        self
    }

    /// Adds a folder that the command creates, with those above it, before it writes files.
    #[must_use]
    pub fn creating(mut self, folder: &Path) -> Self {
        self.created.push(canonical(folder));
        self
    }

    /// Adds a file that the command writes. Fails, with what to do, if it is an input or another output, lies in a city, a site or a work
    /// store, is a link to nothing, or exists and is of another kind or write-protected, or if its folder does not exist or cannot be
    /// written to. A file of another kind that may belong to an input, such as its materials, is not replaced in any case. Nothing is
    /// written yet.
    pub fn file(&mut self, path: &Path, kind: FileKind) -> Result<(), String> {
        let refuse = |reason: String| Err(format!("{}: {reason}", path.display()));
        if path.as_os_str() == "-" {
            return refuse("standard output is not written; give the name of a file".to_owned());
        }
        let found = fs::metadata(path).ok();
        if found.as_ref().is_some_and(is_stream) {
            return Ok(());
        }
        if found.as_ref().is_some_and(|found| !found.is_file()) {
            return refuse("it is a folder or a device; give the name of a file".to_owned());
        }
        if found.is_none() && path.is_symlink() {
            return refuse("it is a link to nothing; give another name".to_owned());
        }
        self.check_place(path)?;
        for input in &self.inputs {
            let is_inside = || found.is_some() && input.is_dir() && canonical(path).starts_with(canonical(input));
            // An earlier report in a folder of inputs is none of them.
            let is_report = || matches!(kind, FileKind::Json(..)) && kind.is_of(path);
            if is_same(path, input) || is_inside() && !is_report() {
                return refuse(format!("it is, or lies in, the input {}; give another name", input.display()));
            }
        }
        if found.is_some() && !kind.is_of(path) {
            if let Some(input) = self.inputs.iter().find(|input| may_belong_to(path, input)) {
                return refuse(format!("it may belong to the input {}; give another name", input.display()));
            }
            if !self.may_overwrite {
                return refuse(format!("it exists and is not {}; give another name, or --overwrite", kind.name()));
            }
        }
        if found.is_some_and(|found| found.permissions().readonly()) && !self.may_overwrite {
            return refuse("it is write-protected; give another name, or --overwrite".to_owned());
        }
        let place = canonical(path);
        match place.parent().filter(|folder| !folder.exists()) {
            None => try_file(path)?,
            Some(folder) if self.created.iter().any(|created| created.starts_with(folder)) => {
                try_folder(folder, folder)?
            }
            Some(folder) => {
                return refuse(format!("there is no folder {}; create it, or give another name", folder.display()));
            }
        }
        self.take(path)
    }

    /// Adds a folder that the command writes files into. Fails as [`Self::file`], if it is or contains an input, if the programs keep it for
    /// anything but `own`, if it has files and `is_own` does not know it, or if it cannot be written to.
    pub fn folder(
        &mut self,
        path: &Path,
        own: Option<KeptFolder>,
        is_own: impl FnOnce(&Path) -> bool,
    ) -> Result<(), String> {
        let refuse = |reason: String| Err(format!("{}: {reason}", path.display()));
        self.check_place(path)?;
        if let Some(kind) = kept_folder(path).filter(|kind| Some(*kind) != own) {
            return refuse(format!("it is {kind}; write elsewhere"));
        }
        // The path may lead through folders that are still to be created.
        let place = canonical(path);
        for input in &self.inputs {
            if canonical(input).starts_with(&place) {
                return refuse(format!("it is, or contains, the input {}; write elsewhere", input.display()));
            }
        }
        match fs::metadata(&place) {
            Ok(found) if !found.is_dir() => {
                return refuse("a file or link with this name exists; give another name".to_owned());
            }
            Ok(_) => {
                let is_empty = fs::read_dir(&place).is_ok_and(|mut entries| entries.next().is_none());
                if !is_empty && !self.may_overwrite && !is_own(&place) {
                    return refuse(
                        "it has files that this command did not write; give another name, or --overwrite".to_owned(),
                    );
                }
            }
            Err(_) => {}
        }
        // A folder that the programs keep is replaced by another.
        try_folder(path, place.parent().filter(|_| own.is_some()).unwrap_or(&place))?;
        self.take(path)
    }

    /// Fails if the path lies in a folder that the programs keep.
    fn check_place(&self, path: &Path) -> Result<(), String> {
        match kept_folder_above(path) {
            Some((folder, kind)) => {
                let (path, folder) = (path.display(), folder.display());
                Err(format!("{path}: it lies in {kind}, {folder}; write it elsewhere"))
            }
            None => Ok(()),
        }
    }

    fn take(&mut self, path: &Path) -> Result<(), String> {
        if self.outputs.iter().any(|other| is_same(path, other)) {
            return Err(format!("{}: two outputs have this name; give them different ones", path.display()));
        }
        self.outputs.push(path.to_owned());
        Ok(())
    }
}

/// Fails if the file cannot be created. After the work, that would lose it.
fn try_file(path: &Path) -> Result<(), String> {
    let refuse = |error| format!("{}: it cannot be written: {error}; give another name", path.display());
    NewFile::create(path).map(drop).map_err(refuse)
}

/// Fails if no file can be created in the folder `place`, or in the innermost one above it that exists; `path` is what the user gave.
fn try_folder(path: &Path, place: &Path) -> Result<(), String> {
    let existing = place.ancestors().find(|folder| folder.exists()).unwrap_or(place);
    NewFile::create(&existing.join(".insula-output")).map(drop).map_err(|error| {
        let given = canonical(path);
        let path = path.display();
        match existing == given {
            true => format!("{path}: no file can be created in it: {error}; give another name"),
            false => {
                let folder = existing.display();
                format!("{path}: the folder cannot be created in {folder}: {error}; give another name")
            }
        }
    })
}

/// Fails if a folder that a command replaces, or creates with those above it, cannot be created. After the work, that would lose it.
pub fn check_new_folder(path: &Path) -> Result<(), String> {
    let place = canonical(path);
    try_folder(path, place.parent().unwrap_or(&place))
}

/// Whether output is read by somebody, or dropped, as it is written.
#[cfg(unix)]
fn is_stream(found: &fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    let kind = found.file_type();
    kind.is_char_device() || kind.is_fifo()
}

#[cfg(not(unix))]
fn is_stream(_: &fs::Metadata) -> bool {
    false
}

/// Whether a file may be one that an input needs: it lies beside the input, with the same name but for the extension, or is of those that
/// models of the input's format name.
fn may_belong_to(path: &Path, input: &Path) -> bool {
    let [path, input] = [path, input].map(canonical);
    let name = |path: &Path| path.file_name().and_then(OsStr::to_str).map(str::to_lowercase).unwrap_or_default();
    let (own, its) = (name(&path), name(&input));
    let stem = |name: &str| name.split_once('.').map_or(name.to_owned(), |(stem, _)| stem.to_owned());
    let Some(folder) = input.parent() else { return false };
    let has_name = path.parent() == Some(folder) && stem(&own) == stem(&its);
    let is_needed = || {
        let of_format = NEEDED_FILES.iter().filter(|(ends, _)| ends.iter().any(|end| its.ends_with(end)));
        let extension = own.rsplit_once('.').map_or("", |(_, extension)| extension);
        of_format.flat_map(|(_, extensions)| extensions.iter()).any(|known| *known == extension)
    };
    has_name || path.starts_with(folder) && is_needed()
}

/// Whether two paths are of one file, by whatever names.
fn is_same(a: &Path, b: &Path) -> bool {
    canonical(a) == canonical(b) || is_hard_link(a, b)
}

#[cfg(unix)]
fn is_hard_link(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |path: &Path| fs::metadata(path).ok().map(|found| (found.dev(), found.ino()));
    identity(a).is_some() && identity(a) == identity(b)
}

#[cfg(not(unix))]
fn is_hard_link(_: &Path, _: &Path) -> bool {
    false
}

/// A new file with the first unused number: `stem-0001.extension`, `stem-0002.extension`, ... Fails if there is none, or if the folder is
/// one that the programs keep.
pub fn unused_file(folder: &Path, stem: &str, extension: &str) -> Result<PathBuf, String> {
    let name = |number: u32| folder.join(format!("{stem}-{number:04}.{extension}"));
    Outputs::default().check_place(&name(1))?;
    let unused = (1..10_000).map(name).find(|path| path.symlink_metadata().is_err());
    unused.ok_or_else(|| format!("{}: it has 10000 files {stem}-N.{extension}; move them away", folder.display()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn inputs_other_outputs_and_files_of_other_kinds_are_refused_by_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("sub/city")).unwrap();
        fs::write(path("a.ply"), "ply\n").unwrap();
        fs::write(path("b.ply"), "ply\n").unwrap();
        fs::write(path("sub/c.ply"), "ply\n").unwrap();
        fs::write(path("thesis.ply"), "dear").unwrap();
        fs::write(path("empty.ply"), "").unwrap();
        let manifest = r#"{"format_version":1,"tile_version":1,"version":"a","root_side_m":64.0,"settings":""}"#;
        fs::write(path("sub/city/city.json"), manifest).unwrap();
        let check = |name: &str, overwrite: bool| {
            let mut outputs = Outputs::new(OverwriteArgs { overwrite }).reading([path("a.ply"), path("sub")]);
            outputs.file(&path("taken.ply"), FileKind::PLY).unwrap();
            outputs.file(&path(name), FileKind::PLY)
        };
        for allowed in ["b.ply", "empty.ply", "new.ply", "sub/new.ply"] {
            check(allowed, false).unwrap();
        }
        // In a folder of inputs, only an earlier report may be replaced.
        fs::write(path("sub/report.json"), r#"{"bytes":1}"#).unwrap();
        fs::write(path("sub/part.geojson"), r#"{"type":"FeatureCollection"}"#).unwrap();
        let mut outputs = Outputs::new(OverwriteArgs { overwrite: true }).reading([path("sub")]);
        let report = FileKind::Json("a report", &["bytes"]);
        outputs.file(&path("sub/report.json"), report).unwrap();
        assert!(outputs.file(&path("sub/part.geojson"), report).unwrap_err().contains("the input"));
        for refused in
            ["a.ply", "sub/../a.ply", "sub/c.ply", "taken.ply", "sub", "sub/city/new.ply", "sub/city/city.json"]
        {
            for overwrite in [false, true] {
                assert!(check(refused, overwrite).unwrap_err().contains(refused), "{refused}");
            }
        }
        assert!(check("thesis.ply", false).unwrap_err().contains("--overwrite"));
        check("thesis.ply", true).unwrap();
        // Nor does a report replace what an input needs.
        fs::create_dir_all(path("textures")).unwrap();
        for (name, is_needed) in [
            ("town.txt", true),
            ("roofs.MTL", true),
            ("textures/wall.png", true),
            ("a.txt", false),
            ("notes.txt", false),
        ] {
            fs::write(path(name), "mine").unwrap();
            let mut outputs =
                Outputs::new(OverwriteArgs { overwrite: true }).reading([path("town.obj"), path("p.json")]);
            let refused = outputs.file(&path(name), report).err();
            assert_eq!(refused.is_some_and(|error| error.contains("may belong to")), is_needed, "{name}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(path("a.ply"), path("link.ply")).unwrap();
            fs::hard_link(path("a.ply"), path("hard.ply")).unwrap();
            assert!(check("link.ply", true).is_err() && check("hard.ply", true).is_err());
            std::os::unix::fs::symlink(path("none.ply"), path("lost.ply")).unwrap();
            assert!(check("lost.ply", true).unwrap_err().contains("nothing"));
            std::fs::set_permissions(path("b.ply"), std::os::unix::fs::PermissionsExt::from_mode(0o444)).unwrap();
            assert!(check("b.ply", false).unwrap_err().contains("write-protected") && check("b.ply", true).is_ok());
            assert!(check("/dev/null", false).is_ok());
        }
    }

    #[test]
    fn outputs_that_cannot_be_written_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("a"), "dear").unwrap();
        let file = |name: &str| Outputs::default().creating(&path("new/city")).file(&path(name), FileKind::PLY);
        assert!(file("none/b.ply").unwrap_err().contains("there is no folder"));
        assert!(file("a/b.ply").is_err(), "below a file");
        file("b.ply").unwrap();
        file("new/b.ply").unwrap();
        let check = |name: &str| Outputs::default().folder(&path(name), None, |_| true);
        // The message has the name that was given, and none of ours.
        let error = check("a/b").unwrap_err();
        let expected = format!("{}: the folder cannot be created in {}: ", path("a/b").display(), path("a").display());
        assert!(error.starts_with(&expected) && !error.contains(".insula"), "{error}");
        assert!(check_new_folder(&path("a/b")).is_err() && check_new_folder(&path("none/b")).is_ok());
        check("none/b").unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing stays");
    }

    #[test]
    fn folders_of_others_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("mine/in")).unwrap();
        fs::create_dir_all(path("empty")).unwrap();
        fs::create_dir_all(path("site")).unwrap();
        fs::write(path("site/insula-site.json"), "{}").unwrap();
        let check = |name: &str, is_own: bool| {
            Outputs::default().reading([path("mine/in")]).folder(&path(name), None, |_| is_own)
        };
        assert!(check("empty", false).is_ok() && check("new", false).is_ok() && check("mine/in/new", false).is_ok());
        fs::write(path("empty/a"), "dear").unwrap();
        assert!(check("empty", false).is_err() && check("empty", true).is_ok());
        for refused in ["mine", "site", "site/new", "site/insula-site.json", "none/../mine", "none/../site/new"] {
            assert!(check(refused, true).is_err(), "{refused}");
        }
        assert!(check("none/../empty", false).is_err() && check("none/../other", false).is_ok());
    }

    #[test]
    fn kinds_are_known_by_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let report = FileKind::Json("a report", &["blocks", "bytes"]);
        for (text, kind, is_of) in [
            ("# mesh\n\nv 1 2 3\n", FileKind::OBJ, true),
            ("very dear\n", FileKind::OBJ, false),
            (r#"{"bytes":1,"blocks":2,"more":3}"#, report, true),
            (r#"{"bytes":1}"#, report, false),
            (r#"[{"bytes":1,"blocks":2}]"#, report, true),
            ("[1]", report, false),
            ("12345678", FileKind::Unmarked("words"), false),
            ("id,name,wkt\r\n1,a,POINT (1 2)\r\n", FileKind::TABLE, true),
            ("wkt\n", FileKind::TABLE, true),
            ("what is a wkt?\n", FileKind::TABLE, false),
            ("id,of wkt\n1,wkt\n", FileKind::TABLE, false),
            ("0\nSECTION\n2\nHEADER\n", FileKind::DXF, true),
            ("  0\r\nSECTION\r\n", FileKind::DXF, true),
            ("THE SECTION OF THE LAW\n", FileKind::DXF, false),
            (r#"{"type":"FeatureCollection","name":"Delft","attribution":"a""#, FileKind::GEOJSON, true),
            (r#"{"attribution":"a","features":[]}"#, FileKind::GEOJSON, true),
            (r#"{"type":"FeatureCollection","features":[]}"#, FileKind::GEOJSON, false),
            ("<?xml?>\n<svg>", FileKind::SVG, true),
        ] {
            fs::write(&path, text).unwrap();
            assert_eq!(kind.is_of(&path), is_of, "{text}");
        }
    }
}
