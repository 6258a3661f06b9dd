//! An open city, and the identity of its files, by which a replacement is noticed.

use super::error::StoreError;
use super::search::{CityIndex, SearchFile, SearchFileError};
use bytes::Bytes;
use insula_archive::BakedCity;
use insula_archive::city::{MANIFEST_FILE, SEARCH_FILE, first_city_in};
use insula_archive::file::open_regular;
use insula_archive::open_files::FileIdentity;
use insula_protocol::TileKind;
use insula_protocol::route::THUMBNAIL_FILE;
use std::fs;
use std::io::{self, Read};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Attempts to open a city that is replaced meanwhile.
const MAX_ATTEMPTS: usize = 5;
/// Larger pictures are not served: a bake writes a quarter of this.
const MAX_THUMBNAIL_BYTES: u64 = 2 << 20;
const JPEG_SIGNATURE: &[u8] = b"\xff\xd8\xff";

static NEXT_SERIAL: AtomicU64 = AtomicU64::new(0);

/// An open city; its methods are those of [`BakedCity`].
#[derive(Debug)]
pub struct CityStore {
    serial: u64,
    pub(super) stamp: CityStamp,
    city: BakedCity,
    /// `None` for a remote city. Its location is text, which the name of a folder need not be.
    folder: Option<PathBuf>,
    /// Whether the bake's picture was in the folder when it was opened.
    pub(crate) has_thumbnail: bool,
    search: Option<SearchFile>,
}

/// Identity of a city's files, which changes when they are replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum CityStamp {
    /// Of the manifest, each existing archive and the search index.
    Files(Box<[Option<FileIdentity>; 7]>),
    /// Hash of the manifest's text.
    Remote(blake3::Hash),
}

impl CityStore {
    /// Opens a folder with `city.json`, an archive per [`TileKind`], and a search index if there is one. All files are of one version, even if the city is replaced
    /// meanwhile. Fails if a file is missing, damaged, or inconsistent with the manifest.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        if folder.is_file() {
            return Err(StoreError::NotAFolder(folder.to_owned()));
        }
        for _ in 0..MAX_ATTEMPTS {
            let stamp = CityStamp::of(folder).map_err(|error| match first_city_in(folder) {
                Some(city) => StoreError::FolderOfCities { folder: folder.to_owned(), city },
                None => error,
            })?;
            let (city, search) = (BakedCity::open(folder), SearchFile::open(folder));
            if CityStamp::of(folder)? == stamp {
                let has_thumbnail = folder.join(THUMBNAIL_FILE).is_file();
                let search = search.map_err(|source| StoreError::Io { path: folder.join(SEARCH_FILE), source })?;
                let folder = Some(folder.to_owned());
                return Ok(Self { folder, has_thumbnail, search, ..Self::new(stamp, city?) });
            }
        }
        Err(StoreError::Changing { place: folder.display().to_string() })
    }

    pub(super) fn new(stamp: CityStamp, city: BakedCity) -> Self {
        let serial = NEXT_SERIAL.fetch_add(1, Ordering::Relaxed);
        Self { serial, stamp, city, folder: None, has_thumbnail: false, search: None }
    }

    pub(super) fn with_search(self, search: Option<SearchFile>) -> Self {
        Self { search, ..self }
    }

    /// A number that differs between all cities and versions that the process has opened.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    /// The folder that it was opened from; `None` if it is remote.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Whether the files in the folder are those that were opened. False if it is remote.
    pub(crate) fn is_unchanged(&self) -> bool {
        self.folder.as_ref().is_some_and(|folder| CityStamp::of(folder).is_ok_and(|stamp| stamp == self.stamp))
    }

    /// Reads the bake's picture. `None` if there is none, or it is none.
    pub(crate) fn read_thumbnail(&self) -> Option<Bytes> {
        let path = self.folder.as_ref().filter(|_| self.has_thumbnail)?.join(THUMBNAIL_FILE);
        let mut jpeg = Vec::new();
        open_regular(&path).ok()?.take(MAX_THUMBNAIL_BYTES + 1).read_to_end(&mut jpeg).ok()?;
        (jpeg.len() as u64 <= MAX_THUMBNAIL_BYTES && jpeg.starts_with(JPEG_SIGNATURE)).then(|| jpeg.into())
    }

    /// Whether the city has a search index.
    pub fn has_search(&self) -> bool {
        self.search.is_some()
    }

    /// The search index, which is read whole unless someone holds it. Fails if there is none, or it cannot be read, is damaged or of
    /// another bake.
    pub fn search_index(&self) -> Result<CityIndex, SearchFileError> {
        let none = || SearchFileError::None { place: self.location().to_owned() };
        self.search.as_ref().ok_or_else(none)?.index(self.manifest().marks)
    }
}

impl Deref for CityStore {
    type Target = BakedCity;

    fn deref(&self) -> &BakedCity {
        &self.city
    }
}

impl CityStamp {
    /// Fails if a file's metadata cannot be read, or one other than the meshes, objects and search index is missing.
    pub(super) fn of(folder: &Path) -> Result<Self, StoreError> {
        let file_stamp = |name: &str| {
            let path = folder.join(name);
            let metadata = fs::metadata(&path).map_err(|source| {
                // Of a folder that is missing, no file is named that nobody has asked for.
                let path = if folder.exists() { path } else { folder.to_owned() };
                StoreError::Io { path, source }
            })?;
            Ok(Some(FileIdentity::of(&metadata)))
        };
        let optional = |name: &str| match file_stamp(name) {
            Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
            found => found,
        };
        let [meshes, objects, visibility] =
            [TileKind::Mesh, TileKind::Objects, TileKind::Visibility].map(|kind| optional(kind.file_name()));
        let search = optional(SEARCH_FILE)?;
        let [subtrees, blockmaps] = [TileKind::Subtree, TileKind::BlockMap].map(|kind| file_stamp(kind.file_name()));
        let stamps = [file_stamp(MANIFEST_FILE)?, subtrees?, blockmaps?, meshes?, objects?, search, visibility?];
        Ok(Self::Files(Box::new(stamps)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_missing_is_named_itself() {
        let folder = tempfile::tempdir().unwrap();
        let of = |path: &Path| CityStore::open(path).unwrap_err().to_string();
        let missing = of(&folder.path().join("nofile.gml"));
        assert!(missing.contains("nofile.gml:") && !missing.contains(MANIFEST_FILE), "{missing}");
        assert!(of(folder.path()).contains(MANIFEST_FILE));
        fs::create_dir(folder.path().join("town")).unwrap();
        fs::write(folder.path().join("town").join(MANIFEST_FILE), "{}").unwrap();
        let cities = of(folder.path());
        assert!(cities.contains("folder of cities") && cities.ends_with("town"), "{cities}");
    }
}
