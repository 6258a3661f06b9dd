//! Errors of opening a city. Each text is one line: what failed, where, and what to do.

use insula_archive::CityError;
use std::path::PathBuf;

/// Why a city cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("cannot read {}: {source}; check the path", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error("cannot read {}: its file system does not respond; check the disk or the network share", .0.display())]
    NoResponse(PathBuf),
    #[error("{} is a file, not the folder of a city; make a city of it with `insula-server bake`", .0.display())]
    NotAFolder(PathBuf),
    #[error("no city in {}: neither it nor a folder in it contains city.json; make a city with `insula-server bake`", .0.display())]
    NoCity(PathBuf),
    #[error("{} is a folder of cities, not a city; name one of them, such as {}", folder.display(), city.display())]
    FolderOfCities { folder: PathBuf, city: PathBuf },
    /// The city is damaged, inconsistent, or of another version.
    #[error(transparent)]
    City(#[from] CityError),
    #[error("two cities are named {name:?}: {first} and {second}; bake one with another --name")]
    SameName { name: String, first: String, second: String },
    #[error("cannot read {url}: {reason}; check the URL and this machine's access to it")]
    Remote { url: String, reason: String },
    #[error("cannot use cache.folder {}: {source}; set another one", path.display())]
    Cache { path: PathBuf, source: std::io::Error },
    /// Every attempt to open the city found it replaced meanwhile.
    #[error("cannot open {place}: it is being replaced repeatedly; try again")]
    Changing { place: String },
}
