//! Why cities cannot be served. Each text is one line.

use insula_archive::CityError;
use std::path::PathBuf;

/// Why a city cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file or folder is missing or cannot be read.
    #[error("cannot read {}: {source}; is the path right?", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// Neither a city nor a folder of cities.
    #[error("no city in {}: there is no city.json in it or one folder below; make one with `insula-server bake`", .0.display())]
    NoCity(PathBuf),
    /// The city is damaged or of another version.
    #[error(transparent)]
    City(#[from] CityError),
    /// URLs could not tell two cities apart.
    #[error("two cities are named {name:?}: {first} and {second}; bake one with another --name")]
    SameName {
        /// The name.
        name: String,
        /// Path or address of one city.
        first: String,
        /// Path or address of the other.
        second: String,
    },
    /// An object store or web server has no city, or does not answer.
    #[error("cannot read {url}: {reason}; is the address right, and may this machine read it?")]
    Remote {
        /// Address of the city or of one of its files.
        url: String,
        /// What is wrong.
        reason: String,
    },
    /// The folder of the block cache cannot be used.
    #[error("cannot use cache.folder {}: {source}; give another one", path.display())]
    Cache {
        /// The folder.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// The city's files changed every time they were read.
    #[error("cannot open {place}: it keeps being replaced while it is read; try again")]
    Changing {
        /// The city's folder.
        place: String,
    },
}
