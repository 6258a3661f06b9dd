//! Where the resources of a layer lie: in a package, in a folder or on a server.

use crate::tiles3d::files::TileFiles;
use crate::tiles3d::uri;
use insula_source::json::without_bom;
use serde::de::DeserializeOwned;
use std::cell::Cell;
use std::io;

/// What a resource is: it decides the extensions that its file may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Resource {
    Json,
    Binary,
    /// An image of this format.
    Image(&'static [&'static str]),
}

/// How the files of a source are named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Naming {
    /// `geometries/0.bin`, mostly packed: packages.
    Extension,
    /// `geometries/0`: servers.
    Bare,
    /// `geometries/0/index.bin`: folders that servers were saved to.
    Index,
}

/// Finds the files of a layer.
pub(super) struct Resources<'f, 'a> {
    pub(super) files: &'f TileFiles<'a>,
    /// Folder of the layer, without a `/` at the end.
    pub(super) folder: String,
    /// The naming that worked last.
    naming: Cell<Naming>,
}

impl<'f, 'a> Resources<'f, 'a> {
    pub(super) fn new(files: &'f TileFiles<'a>, folder: String) -> Self {
        Self { files, folder, naming: Cell::new(Naming::Extension) }
    }

    /// Reads a resource by its path within the layer, such as `nodes/3/geometries/0`, unpacked. Fails if no name fits.
    pub(super) fn read(&self, path: &str, resource: Resource) -> io::Result<(String, Vec<u8>)> {
        let name =
            uri::join(&self.folder, path).map_err(|reason| io::Error::new(io::ErrorKind::PermissionDenied, reason))?;
        let extensions: &[&str] = match resource {
            Resource::Json => &["json"],
            Resource::Binary => &["bin"],
            Resource::Image(extensions) => extensions,
        };
        let last = self.naming.get();
        let mut namings = [Naming::Extension, Naming::Bare, Naming::Index];
        namings.sort_by_key(|naming| *naming != last);
        let mut first_error = None;
        for naming in namings {
            let names: Vec<String> = match naming {
                Naming::Extension => extensions.iter().map(|extension| format!("{name}.{extension}")).collect(),
                Naming::Bare => vec![name.clone()],
                Naming::Index => extensions.iter().map(|extension| format!("{name}/index.{extension}")).collect(),
            };
            for name in names {
                match self.files.read(&name) {
                    Ok(bytes) => {
                        self.naming.set(naming);
                        return Ok((name, bytes));
                    }
                    Err(error) => {
                        first_error.get_or_insert(error);
                    }
                }
            }
        }
        Err(first_error.unwrap_or_else(|| io::ErrorKind::NotFound.into()))
    }

    /// Reads a JSON resource. Fails with what is wrong.
    pub(super) fn json<T: DeserializeOwned>(&self, path: &str) -> Result<T, String> {
        let (name, bytes) = self.read(path, Resource::Json).map_err(|error| format!("{path}: {error}"))?;
        serde_json::from_slice(without_bom(&bytes)).map_err(|error| format!("{name}: {error}"))
    }
}
