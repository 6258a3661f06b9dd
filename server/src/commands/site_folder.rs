//! The folder of a published site: made beside its place, and renamed when it is complete.

use super::error::CommandError;
use insula_archive::city::SEARCH_FILE;
use serde::Deserialize;
use std::{
    ffi::OsString,
    fs, io,
    path::{Path, PathBuf},
};

/// Marks a published site.
pub(super) const SITE_FILE: &str = "insula-site.json";

/// A site in the making. It is removed unless it is published.
#[derive(Debug)]
pub(super) struct SiteFolder {
    out: PathBuf,
    new: PathBuf,
    files: u64,
    bytes: u64,
}

impl SiteFolder {
    /// Creates a folder beside `out`. Fails if `out` is anything but an empty folder or a site, which it will replace.
    pub(super) fn create(out: &Path) -> Result<Self, CommandError> {
        check_out(out)?;
        let new = beside(out, "new")?;
        if let Some(parent) = new.parent() {
            fs::create_dir_all(parent).map_err(|error| write_error(parent, &error))?;
        }
        fs::create_dir(&new).map_err(|error| write_error(&new, &error))?;
        Ok(Self { out: out.to_owned(), new, files: 0, bytes: 0 })
    }

    /// Writes a file, given by its path in the site.
    pub(super) fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), CommandError> {
        let path = self.place(path)?;
        fs::write(&path, bytes).map_err(|error| write_error(&path, &error))?;
        (self.files, self.bytes) = (self.files + 1, self.bytes + bytes.len() as u64);
        Ok(())
    }

    /// Gives a file a second name in the site, or copies it where that is not possible.
    pub(super) fn link(&mut self, from: &Path, path: &str) -> Result<(), CommandError> {
        let path = self.place(path)?;
        // A link to a symbolic link would be one, too.
        let from = fs::canonicalize(from).map_err(|error| read_error(from, &error))?;
        if fs::hard_link(&from, &path).is_err() {
            fs::copy(&from, &path).map_err(|error| write_error(&path, &error))?;
        }
        let length = fs::metadata(&path).map_err(|error| read_error(&path, &error))?.len();
        (self.files, self.bytes) = (self.files + 1, self.bytes + length);
        Ok(())
    }

    fn place(&self, path: &str) -> Result<PathBuf, CommandError> {
        let path = self.new.join(path);
        let folder = path.parent().unwrap_or(&self.new);
        fs::create_dir_all(folder).map_err(|error| write_error(folder, &error))?;
        Ok(path)
    }

    /// Puts the site into its place. Returns the number of its files and their bytes. Fails if the old one cannot be replaced, and then
    /// restores it.
    pub(super) fn publish(self) -> Result<(u64, u64), CommandError> {
        check_out(&self.out)?;
        let old = beside(&self.out, "old")?;
        let failed = |error: io::Error| write_error(&self.out, &error);
        let exists = self.out.exists();
        if exists {
            fs::rename(&self.out, &old).map_err(failed)?;
        }
        if let Err(error) = fs::rename(&self.new, &self.out) {
            // The first error is the one to report.
            let _ = fs::rename(&old, &self.out);
            return Err(failed(error));
        }
        if exists {
            fs::remove_dir_all(&old).map_err(|error| write_error(&old, &error))?;
        }
        Ok((self.files, self.bytes))
    }
}

impl Drop for SiteFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.new);
    }
}

/// A hidden name beside a path.
fn beside(out: &Path, what: &str) -> Result<PathBuf, CommandError> {
    let absolute = std::path::absolute(out).map_err(|error| write_error(out, &error))?;
    let Some(name) = absolute.file_name() else { return Err(refuse(out, "it is not the name of a folder")) };
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(format!(".{what}-{}.tmp", std::process::id()));
    Ok(absolute.with_file_name(hidden))
}

/// Fails unless `out` does not exist, is an empty folder, or has the marker of a site and nothing that `publish` would not write.
fn check_out(out: &Path) -> Result<(), CommandError> {
    let kind = match fs::symlink_metadata(out) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        found => found.map_err(|error| read_error(out, &error))?.file_type(),
    };
    if !kind.is_dir() {
        return Err(refuse(out, "a file or link with this name exists"));
    }
    let is_empty = fs::read_dir(out).map_err(|error| read_error(out, &error))?.next().is_none();
    if is_empty {
        return Ok(());
    }
    if !has_marker(out) {
        return Err(refuse(out, "it is not empty and not a published site; give another --out"));
    }
    match unknown_entry(out, 0).map_err(|error| read_error(out, &error))? {
        Some(unknown) => Err(refuse(&unknown, "`publish` did not write it and would remove it")),
        None => Ok(()),
    }
}

fn has_marker(folder: &Path) -> bool {
    /// Members that other JSON does not have.
    #[derive(Deserialize)]
    #[expect(dead_code, reason = "only their presence and types matter")]
    struct SiteMembers {
        assets: String,
        cities: Vec<String>,
    }
    fs::read(folder.join(SITE_FILE)).is_ok_and(|json| serde_json::from_slice::<SiteMembers>(&json).is_ok())
}

/// The first entry that no site has, without following links. `depth` is the number of folders above `folder` in the site.
fn unknown_entry(folder: &Path, depth: usize) -> io::Result<Option<PathBuf>> {
    let mut entries: Vec<_> = fs::read_dir(folder)?.collect::<io::Result<_>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let (kind, name) = (entry.file_type()?, entry.file_name());
        let name = name.to_string_lossy();
        let is_known = match depth {
            0 if kind.is_dir() => matches!(&*name, "assets" | "cities"),
            0 => kind.is_file() && matches!(&*name, "index.html" | "service-worker.js" | SITE_FILE),
            1 => kind.is_dir(),
            _ => kind.is_file() && is_site_file(&name),
        };
        if !is_known {
            return Ok(Some(entry.path()));
        }
        if kind.is_dir()
            && let Some(unknown) = unknown_entry(&entry.path(), depth + 1)?
        {
            return Ok(Some(unknown));
        }
    }
    Ok(None)
}

/// Whether a file of this kind may lie among assets or a city's files.
fn is_site_file(name: &str) -> bool {
    const SUFFIXES: [&str; 11] =
        ["js", "wasm", "css", "json", "webmanifest", "html", "svg", "png", "woff2", "br", "gz"];
    name == SEARCH_FILE
        || name.ends_with(".pmtiles")
        || name.rsplit_once('.').is_some_and(|(_, suffix)| SUFFIXES.contains(&suffix))
}

fn refuse(path: &Path, reason: &str) -> CommandError {
    CommandError::Publish { path: path.to_owned(), reason: reason.to_owned() }
}

fn write_error(path: &Path, error: &io::Error) -> CommandError {
    CommandError::Write { path: path.to_owned(), reason: error.to_string() }
}

fn read_error(path: &Path, error: &io::Error) -> CommandError {
    CommandError::Publish { path: path.to_owned(), reason: error.to_string() }
}
