//! The files of a folder of terrain tiles.

use crate::raster::TileFiles;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

/// Folders in folders: `{z}/{x}/{y}` below a version.
const MAX_DEPTH: usize = 8;
/// More files are refused: their names are in memory.
const MAX_FILES: usize = 1 << 24;

/// The files in the folder of a `layer.json` and below.
pub(super) struct TerrainFiles {
    folder: PathBuf,
}

impl TerrainFiles {
    pub(super) fn new(folder: &Path) -> Self {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        Self { folder: folder.to_owned() }
    }
}

impl TileFiles for TerrainFiles {
    fn names(&self) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        walk(&self.folder, "", 0, &mut names)?;
        Ok(names)
    }

    fn read(&self, name: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
        let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
        if !Path::new(name).components().all(|component| matches!(component, Component::Normal(_))) {
            return Err(invalid("its name leads out of the folder"));
        }
        let path = self.folder.join(name);
        // A link could lead anywhere.
        if !fs::symlink_metadata(&path)?.is_file() {
            return Err(invalid("not a plain file"));
        }
        let mut bytes = Vec::new();
        File::open(&path)?.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > max_bytes { Err(invalid("too large")) } else { Ok(bytes) }
    }
}

/// Adds the names of all plain files in a folder and below, without links.
fn walk(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        let Some(name) = entry.file_name().to_str().map(|name| format!("{prefix}{name}")) else { continue };
        if kind.is_dir() && depth < MAX_DEPTH {
            walk(&entry.path(), &format!("{name}/"), depth + 1, names)?;
        } else if kind.is_file() {
            names.push(name);
        }
        if names.len() > MAX_FILES {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "more than 16 million files"));
        }
    }
    Ok(())
}
