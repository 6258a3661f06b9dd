//! Writes all files of a tileset into a folder, or into an archive (`.3tz`, `.pmtiles`).

use super::{Tileset, archive::ArchiveWriter, pmtiles::TileArchive, tileset_file::TilesetFile};
use crate::glb::{ExportError, ExportReport};
use insula_archive::{
    file::open_regular,
    new_file::{NewFile, replace},
    places::canonical,
};
use insula_protocol::{Subtree, TileId};
use serde_json::Value;
use std::{
    fs, io,
    path::{Path, PathBuf},
};

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
/// or if the destination cannot be written; in a folder, what was written then stays, with a tileset that shows nothing.
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
    let mut report = ExportReport::default();
    write(&mut sink, &mut report, TilesetFile::Tileset, &tileset.tileset_json("")?)?;
    let mut roots = vec![TileId::ROOT];
    while let Some(root) = roots.pop() {
        write_subtree(tileset, root, &mut sink, &mut report, &mut roots)?;
    }
    if report.triangles == 0 {
        return Err(ExportError::Nothing(
            "the city has no surface in the selected area, or none of the selected objects",
        ));
    }
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

/// Writes the file of a subtree and the contents of its tiles, and adds the roots of child subtrees.
fn write_subtree(
    tileset: &Tileset<'_>,
    root: TileId,
    sink: &mut Sink,
    report: &mut ExportReport,
    roots: &mut Vec<TileId>,
) -> Result<(), ExportError> {
    let Some(file) = tileset.subtree(root.level(), root.x(), root.y())? else { return Ok(()) };
    write(sink, report, TilesetFile::Subtree(root), &file)?;
    let Some(subtree) = tileset.subtree_with(root)? else { return Ok(()) };
    let end = root.level() + super::subtree::LEVELS;
    let is_below = |id: TileId| id.ancestor(root.level()) == Some(root) && tileset.is_selected(id);
    for node in subtree.nodes.iter().filter(|node| is_below(node.id)) {
        if node.id.level() == end && Subtree::is_root(node.id) {
            roots.push(node.id);
            continue;
        }
        if let Some(content) = tileset.node_content(node.id)? {
            report.triangles += content.triangles as u64;
            write(sink, report, TilesetFile::Content(node.id), &content.bytes)?;
            report.files += 1;
            report.objects += content.objects as u64;
        }
    }
    Ok(())
}

fn write(sink: &mut Sink, report: &mut ExportReport, file: TilesetFile, bytes: &[u8]) -> Result<(), ExportError> {
    report.bytes += bytes.len() as u64;
    match sink {
        Sink::Archive(archive, _) => archive.add(&file.to_string(), bytes),
        Sink::PmTiles(archive) => archive.add(file, bytes),
        Sink::Folder(folder) => folder.write(file, bytes, report.triangles > 0),
    }
}

/// A tileset in place of one that is being written: it shows nothing, and says why.
fn unfinished(tileset: &[u8]) -> Vec<u8> {
    let mut json: Value = serde_json::from_slice(tileset).unwrap_or_default();
    if let Some(root) = json["root"].as_object_mut() {
        root.retain(|name, _| name != "implicitTiling" && name != "content");
    }
    json["asset"]["extras"]["title"] = "An unfinished export: run it again".into();
    json.to_string().into_bytes()
}

fn write_file(folder: &Path, file: TilesetFile, bytes: &[u8]) -> Result<(), ExportError> {
    let path = folder.join(file.to_string());
    let failed = || ExportError::writing(path.display().to_string());
    if !is_replaceable(folder, &path, file) {
        let what = "another file has the name of one of the tileset; write it elsewhere, or move the file away";
        return Err(failed()(io::Error::new(io::ErrorKind::AlreadyExists, what)));
    }
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(failed())?;
    }
    replace(&path, bytes).map_err(failed())
}

/// Whether there is no file of this path, or one as this file of a tileset begins.
fn is_replaceable(folder: &Path, path: &Path, file: TilesetFile) -> bool {
    let is_linked = path.is_symlink() || !canonical(path).starts_with(canonical(folder));
    let first: &[u8] = match file {
        TilesetFile::Tileset => b"{",
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

#[derive(Default)]
struct FolderSink {
    folder: PathBuf,
    /// It waits for the end: with parts of an earlier one, it would show both.
    tileset: Vec<u8>,
    /// Files that wait for the first triangle: a tileset of nothing must not replace an earlier one.
    held: Vec<(TilesetFile, Vec<u8>)>,
    is_begun: bool,
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
        if !self.is_begun {
            write_file(&self.folder, TilesetFile::Tileset, &unfinished(&self.tileset))?;
            self.is_begun = true;
        }
        for (file, bytes) in std::mem::take(&mut self.held) {
            write_file(&self.folder, file, &bytes)?;
        }
        write_file(&self.folder, file, bytes)
    }

    fn finish(self) -> Result<(), ExportError> {
        write_file(&self.folder, TilesetFile::Tileset, &self.tileset)
    }
}
