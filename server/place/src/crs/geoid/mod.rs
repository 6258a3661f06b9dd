//! Geoid models: how far the zero of heights is above the ellipsoid.

mod geotiff;
mod grid;
#[cfg(test)]
mod tests;

pub use grid::Grid;
use insula_source::error::InputError;
use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufReader, Cursor};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// File name of EGM96 in PROJ-data. A copy in the folder of grids is taken in place of the bundled grid.
pub const EGM96_FILE: &str = "us_nga_egm96_15.tif";
/// See `data/README.md`.
static EGM96_BYTES: &[u8] = include_bytes!("../../../data/egm96_15.tif");
/// Files beyond this number in the folder of grids are not looked at.
const MAX_FILES: usize = 20_000;
/// Depth of folders below the folder of grids: PROJ-data has one folder for each agency.
const MAX_DEPTH: usize = 2;

/// A geoid model, complete on the whole Earth.
#[derive(Debug, Clone)]
pub struct Geoid {
    /// `EGM96`, or the name of a file.
    pub name: String,
    grid: Arc<Grid>,
    /// For positions outside of `grid`.
    world: Arc<Grid>,
}

impl Geoid {
    /// EGM96 from the folder, or else the bundled one.
    pub fn egm96(folder: Option<&GridFolder>) -> Result<Self, InputError> {
        let grid = match folder.and_then(|folder| folder.path(EGM96_FILE)) {
            Some(path) => read_file(path)?,
            None => bundled()?,
        };
        Ok(Self { name: "EGM96".to_owned(), world: Arc::clone(&grid), grid })
    }

    /// The first of these files that is in the folder; `None` if it has none of them.
    pub fn from_folder(folder: &GridFolder, files: &[&str]) -> Result<Option<Self>, InputError> {
        let Some((name, path)) = files.iter().find_map(|name| Some((*name, folder.path(name)?))) else {
            return Ok(None);
        };
        let world = Self::egm96(Some(folder))?.grid;
        Ok(Some(Self { name: name.to_owned(), grid: read_file(path)?, world }))
    }

    /// Height of the geoid above the ellipsoid of WGS84 (or a modern one like it) in metres. Outside of the model's
    /// area that of EGM96. `None` if the position is not on Earth.
    pub fn undulation_m(&self, longitude_deg: f64, latitude_deg: f64) -> Option<f64> {
        let inside = self.grid.undulation_m(longitude_deg, latitude_deg);
        inside.or_else(|| self.world.undulation_m(longitude_deg, latitude_deg))
    }
}

/// Grid files by name, in a folder and its subfolders.
#[derive(Debug, Clone, Default)]
pub struct GridFolder {
    /// By the file name in lower case.
    files: BTreeMap<String, PathBuf>,
}

impl GridFolder {
    /// Lists a folder. Fails if it cannot be read.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        let mut folder = Self::default();
        folder.add(path, 0).map_err(|cause| InputError::io(&path.display().to_string(), cause))?;
        Ok(folder)
    }

    fn add(&mut self, path: &Path, depth: usize) -> io::Result<()> {
        for entry in fs::read_dir(path)? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().to_ascii_lowercase();
            if self.files.len() >= MAX_FILES {
                return Ok(());
            }
            if name.ends_with(".tif") {
                self.files.entry(name).or_insert_with(|| entry.path());
            } else if depth < MAX_DEPTH && entry.file_type()?.is_dir() {
                // A subfolder that cannot be read has no grids.
                let _ = self.add(&entry.path(), depth + 1);
            }
        }
        Ok(())
    }

    fn path(&self, name: &str) -> Option<&Path> {
        self.files.get(&name.to_ascii_lowercase()).map(PathBuf::as_path)
    }
}

fn read_file(path: &Path) -> Result<Arc<Grid>, InputError> {
    let label = path.display().to_string();
    let file = insula_archive::file::open_regular(path).map_err(|cause| InputError::io(&label, cause))?;
    let grid = geotiff::read(BufReader::new(file)).map_err(|what| InputError::damaged(&label, "geoid grid", what))?;
    Ok(Arc::new(grid))
}

fn bundled() -> Result<Arc<Grid>, InputError> {
    static EGM96: OnceLock<Result<Arc<Grid>, String>> = OnceLock::new();
    let grid = EGM96.get_or_init(|| geotiff::read(Cursor::new(EGM96_BYTES)).map(Arc::new));
    grid.clone().map_err(|what| InputError::damaged("EGM96", "bundled geoid grid", what))
}
