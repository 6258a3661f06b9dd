//! Writes all files of a tileset into a folder, or into an archive (`.3tz`, `.pmtiles`).

use super::archive::ArchiveWriter;
use super::{TILESET_JSON, Tileset, TilesetFile};
use crate::glb::{ExportError, ExportReport};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use insula_archive::file::open_regular;
use insula_archive::new_file::{NewFile, replace};
use insula_archive::places::canonical;
use insula_protocol::{Subtree, TileId};
use pmtiles::{Compression, PmTilesStreamWriter, PmTilesWriter, PmtError, TileCoord, TileType};
use serde_json::{Map, Value, json};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Names that are tried for the folder of unfinished files.
const MAX_TRIES: u32 = 10_000;

/// Where a tileset is written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Destination<'p> {
    /// A folder, which is created. Files of an earlier tileset are replaced, those of others are refused.
    Folder(&'p Path),
    /// A 3D Tiles archive, 3TZ 1.3: a ZIP file with stored entries and an index.
    Archive(&'p Path),
    /// A PMTiles archive, whose metadata have the tileset and its subtrees.
    PmTiles(&'p Path),
}

impl<'p> Destination<'p> {
    /// An archive if the name ends in `.3tz` or `.pmtiles`, else a folder.
    #[must_use]
    pub fn of(path: &'p Path) -> Self {
        let ends_in = |name| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(name));
        match (ends_in("3tz"), ends_in("pmtiles")) {
            (true, _) => Self::Archive(path),
            (_, true) => Self::PmTiles(path),
            _ => Self::Folder(path),
        }
    }
}

/// Writes a whole tileset, node by node, with one tile in memory at a time. Fails if the city cannot be read, if nothing is selected,
/// or if the destination cannot be written; an earlier tileset then stays.
pub fn write_tileset(tileset: &Tileset<'_>, destination: Destination<'_>) -> Result<ExportReport, ExportError> {
    let mut sink = match destination {
        Destination::Folder(folder) => Sink::Folder(FolderSink { folder: folder.to_owned(), ..FolderSink::default() }),
        Destination::Archive(path) => {
            let failed = || ExportError::writing(path.display().to_string());
            let new = NewFile::create(path).map_err(failed())?;
            let file = new.file().map_err(failed())?;
            Sink::Archive(Box::new(ArchiveWriter::new(io::BufWriter::new(file), path.display().to_string())), new)
        }
        Destination::PmTiles(path) => Sink::PmTiles(Box::new(TileArchive::create(path)?)),
    };
    let report = make_files(tileset, &mut |file, bytes, has_triangles| write(&mut sink, file, bytes, has_triangles))?;
    let (Destination::Folder(path) | Destination::Archive(path) | Destination::PmTiles(path)) = destination;
    let name = path.display().to_string();
    match sink {
        Sink::Folder(folder) => folder.finish().map(|()| report),
        Sink::Archive(archive, new) => {
            archive.finish()?;
            new.commit().map(|_| report).map_err(ExportError::writing(name))
        }
        Sink::PmTiles(archive) => archive.finish().map(|()| report),
    }
}

/// Takes the path of a file in the tileset, and its bytes.
type TakeBytes<'t> = dyn FnMut(&str, &[u8]) -> Result<(), ExportError> + 't;

/// Gives `take` the path in the tileset and the bytes of each file, one at a time. Fails as [`write_tileset`], or if `take` does.
pub fn each_file(tileset: &Tileset<'_>, take: &mut TakeBytes<'_>) -> Result<ExportReport, ExportError> {
    make_files(tileset, &mut |file, bytes, _| take(&file.to_string(), bytes))
}

/// Takes a file and its bytes, and whether this one or one before it has triangles.
type TakeFile<'t> = dyn FnMut(TilesetFile, &[u8], bool) -> Result<(), ExportError> + 't;

fn make_files(tileset: &Tileset<'_>, take: &mut TakeFile<'_>) -> Result<ExportReport, ExportError> {
    let mut report = ExportReport::default();
    give(take, &mut report, TilesetFile::Tileset, &tileset.tileset_json("")?)?;
    let mut roots = vec![TileId::ROOT];
    while let Some(root) = roots.pop() {
        make_subtree(tileset, root, take, &mut report, &mut roots)?;
    }
    if report.triangles == 0 {
        return Err(ExportError::Nothing(
            "the city has no surface in the selected area, or none of the selected objects",
        ));
    }
    Ok(report)
}

/// Makes the file of a subtree and the contents of its tiles, and adds the roots of child subtrees.
fn make_subtree(
    tileset: &Tileset<'_>,
    root: TileId,
    take: &mut TakeFile<'_>,
    report: &mut ExportReport,
    roots: &mut Vec<TileId>,
) -> Result<(), ExportError> {
    let Some(subtree) = tileset.subtree_with(root)? else { return Ok(()) };
    if let Some((file, bytes)) = tileset.tiles_file(root, &subtree)? {
        give(take, report, file, &bytes)?;
    }
    let end = root.level() + super::subtree::LEVELS;
    let is_below = |id: TileId| id.ancestor(root.level()) == Some(root) && tileset.is_selected(id);
    for node in subtree.nodes.iter().filter(|node| is_below(node.id)) {
        if node.id.level() == end && Subtree::is_root(node.id) {
            roots.push(node.id);
            continue;
        }
        if let Some(content) = tileset.node_content(node.id)? {
            report.triangles += content.triangles as u64;
            give(take, report, TilesetFile::Content(node.id), &content.bytes)?;
            report.files += 1;
            report.objects += content.objects as u64;
        }
    }
    Ok(())
}

fn give(
    take: &mut TakeFile<'_>,
    report: &mut ExportReport,
    file: TilesetFile,
    bytes: &[u8],
) -> Result<(), ExportError> {
    report.bytes += bytes.len() as u64;
    take(file, bytes, report.triangles > 0)
}

fn write(sink: &mut Sink, file: TilesetFile, bytes: &[u8], has_triangles: bool) -> Result<(), ExportError> {
    match sink {
        Sink::Archive(archive, _) => archive.add(&file.to_string(), bytes),
        Sink::PmTiles(archive) => archive.add(file, bytes),
        Sink::Folder(folder) => folder.write(file, bytes, has_triangles),
    }
}

/// A tileset in place of one that is being written: it shows nothing, and says why.
fn unfinished(tileset: &[u8]) -> Vec<u8> {
    let mut json: Value = serde_json::from_slice(tileset).unwrap_or_default();
    if let Some(root) = json["root"].as_object_mut() {
        root.retain(|name, _| !["implicitTiling", "content", "children"].contains(&name.as_str()));
    }
    json["asset"]["extras"]["title"] = "An unfinished export: run it again".into();
    json.to_string().into_bytes()
}

/// Whether there is no file of this path, or one as this file of a tileset begins.
fn is_replaceable(folder: &Path, path: &Path, file: TilesetFile) -> bool {
    let is_linked = path.is_symlink() || !canonical(path).starts_with(canonical(folder));
    let first: &[u8] = match file {
        TilesetFile::Tileset => b"{",
        TilesetFile::Tiles(_) => b"{\"asset\":",
        TilesetFile::Subtree(_) => b"subt",
        TilesetFile::Content(_) => b"glTF",
    };
    let mut head = vec![0; first.len()];
    let begins = |mut found: fs::File| io::Read::read_exact(&mut found, &mut head).is_ok() && head == first;
    !is_linked && (!path.exists() || open_regular(path).is_ok_and(begins))
}

enum Sink {
    Folder(FolderSink),
    Archive(Box<ArchiveWriter<io::BufWriter<fs::File>>>, NewFile),
    PmTiles(Box<TileArchive>),
}

/// A tileset in a folder. Its files get their names when all are written, so that a full disk leaves an earlier tileset.
#[derive(Default)]
struct FolderSink {
    folder: PathBuf,
    /// It gets its name last: with parts of an earlier one, it would show both.
    tileset: Vec<u8>,
    /// Files that wait for the first triangle: a tileset of nothing must not replace an earlier one.
    held: Vec<(TilesetFile, Vec<u8>)>,
    /// Folder of the files that are written: each is named by its number in `files`.
    waiting: Option<WaitingFolder>,
    files: Vec<TilesetFile>,
}

impl FolderSink {
    fn write(&mut self, file: TilesetFile, bytes: &[u8], has_triangles: bool) -> Result<(), ExportError> {
        if file == TilesetFile::Tileset {
            self.tileset = bytes.to_vec();
            return Ok(());
        }
        if !has_triangles {
            self.held.push((file, bytes.to_vec()));
            return Ok(());
        }
        for (file, bytes) in std::mem::take(&mut self.held) {
            self.keep(file, &bytes)?;
        }
        self.keep(file, bytes)
    }

    /// Writes a file that waits for its name.
    fn keep(&mut self, file: TilesetFile, bytes: &[u8]) -> Result<(), ExportError> {
        let path = self.folder.join(file.to_string());
        let failed = || ExportError::writing(path.display().to_string());
        if !is_replaceable(&self.folder, &path, file) {
            let what = "another file has the name of one of the tileset; write it elsewhere, or move the file away";
            return Err(failed()(io::Error::new(io::ErrorKind::AlreadyExists, what)));
        }
        let waiting = match self.waiting.take() {
            Some(waiting) => waiting,
            None => self.begin().map_err(failed())?,
        };
        let kept = self.waiting.insert(waiting).file(self.files.len());
        let written = fs::File::create_new(kept).and_then(|mut new| {
            new.write_all(bytes)?;
            new.sync_all()
        });
        written.map_err(failed())?;
        self.files.push(file);
        Ok(())
    }

    /// Creates the folders. A new one has a tileset at once, by which it is known if the export is killed.
    fn begin(&self) -> io::Result<WaitingFolder> {
        let waiting = WaitingFolder::create(&self.folder)?;
        let tileset = self.folder.join(TILESET_JSON);
        if !tileset.exists() {
            replace(&tileset, &unfinished(&self.tileset))?;
        }
        Ok(waiting)
    }

    /// Gives the files their names. Meanwhile the tileset shows nothing.
    fn finish(mut self) -> Result<(), ExportError> {
        let tileset = std::mem::take(&mut self.tileset);
        let count = self.files.len();
        self.keep(TilesetFile::Tileset, &unfinished(&tileset))?;
        self.keep(TilesetFile::Tileset, &tileset)?;
        let Some(waiting) = &self.waiting else { return Ok(()) };
        let paths: Vec<PathBuf> = self.files.iter().map(|file| self.folder.join(file.to_string())).collect();
        let failed = |path: &Path| ExportError::writing(path.display().to_string());
        // New names may take room on the disk, renames over old ones do not.
        for path in &paths {
            path.parent().map_or(Ok(()), fs::create_dir_all).map_err(failed(path))?;
        }
        for number in [count].into_iter().chain(0..count).chain([count + 1]) {
            fs::rename(waiting.file(number), &paths[number]).map_err(failed(&paths[number]))?;
        }
        Ok(())
    }
}

/// A folder within that of a tileset, for files without names. It is removed at the end; one that was killed leaves it.
struct WaitingFolder(PathBuf);

impl WaitingFolder {
    fn create(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        for number in 0..MAX_TRIES {
            let path = folder.join(format!(".insula-{}-{number}.tmp", std::process::id()));
            match fs::create_dir(&path) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                created => return created.map(|()| Self(path)),
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    fn file(&self, number: usize) -> PathBuf {
        self.0.join(number.to_string())
    }
}

impl Drop for WaitingFolder {
    fn drop(&mut self) {
        // This export created it. Nothing can be done about what cannot be removed.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Writes a tileset into one PMTiles archive, content by content: contents are its tiles, and everything else is in its metadata.
///
/// Tile `z/x/y` is `content/z/x/y.glb`, not compressed further. The metadata is a JSON object with `tileset`, the tileset's JSON, and
/// `subtrees`, the subtree files in Base64 by `level/x/y`. PMTiles has no type for such tiles: the header says "unknown".
pub(super) struct TileArchive {
    writer: PmTilesStreamWriter<File>,
    new: NewFile,
    tileset: Value,
    subtrees: Map<String, Value>,
    max_level: u8,
    /// The archive's, for errors.
    name: String,
}

impl TileArchive {
    /// Fails if the file cannot be created.
    pub(super) fn create(path: &Path) -> Result<Self, ExportError> {
        let name = path.display().to_string();
        let new = NewFile::create(path).map_err(ExportError::writing(name.clone()))?;
        let file = new.file().map_err(ExportError::writing(name.clone()))?;
        let writer = PmTilesWriter::new(TileType::Unknown).tile_compression(Compression::None).create(file);
        let writer = writer.map_err(|cause| failed(&name, cause))?;
        Ok(Self { writer, new, tileset: Value::Null, subtrees: Map::new(), max_level: 0, name })
    }

    /// Adds a file of the tileset. Fails if the archive cannot be written.
    pub(super) fn add(&mut self, file: TilesetFile, bytes: &[u8]) -> Result<(), ExportError> {
        match file {
            TilesetFile::Tileset => {
                self.tileset = serde_json::from_slice(bytes).map_err(|error| ExportError::Encode(error.to_string()))?;
            }
            TilesetFile::Subtree(root) => {
                self.subtrees.insert(root.to_string(), STANDARD.encode(bytes).into());
            }
            TilesetFile::Tiles(_) => {
                let reason = "this archive has no place for lists of tiles; write a folder, or a .3tz";
                return Err(ExportError::Encode(format!("{}: {reason}", self.name)));
            }
            TilesetFile::Content(node) => {
                self.max_level = self.max_level.max(node.level());
                let add = TileCoord::new(node.level(), node.x(), node.y())
                    .and_then(|place| self.writer.add_tile(place, bytes));
                add.map_err(|cause| failed(&self.name, cause))?;
            }
        }
        Ok(())
    }

    /// Writes metadata and directories. Fails if the archive cannot be written.
    pub(super) fn finish(mut self) -> Result<(), ExportError> {
        self.writer.set_zoom_range(0, self.max_level);
        self.writer.set_metadata(json!({ "tileset": self.tileset, "subtrees": self.subtrees }).to_string());
        self.writer.finalize().map(drop).map_err(|cause| failed(&self.name, cause))?;
        self.new.commit().map(drop).map_err(ExportError::writing(self.name))
    }
}

fn failed(name: &str, cause: PmtError) -> ExportError {
    match cause {
        PmtError::Reading(source) => ExportError::Write { what: name.to_owned(), source },
        other => ExportError::Encode(format!("{name}: {other}")),
    }
}
