//! The folder of a published site: made beside its place, and renamed when it is complete.
//!
//! A publish works in the folder `.SITE.publish` beside the site, which it removes at the end. One that was killed leaves it, and the
//! next one restores or removes what is there:
//!
//! ```text
//! lock     marks the folder, and keeps a second publish out of it
//! files    a line for each file in `new`, written before the file: its length, hash and path
//! new/     the site in the making
//! old/     the site before, while the two change places
//! ```

use super::error::CommandError;
use insula_archive::file::read_limited;
use insula_archive::owned::{FileComparison, FileMark, OwnedFiles};
use insula_archive::places::{MAX_SITE_LIST_BYTES, SITE_FILE};
use serde_json::Value;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Content of the lock.
const MARKER: &[u8] = b"Insula keeps unfinished work of `publish` in this folder and removes it.\n";
const LOCK: &str = "lock";
const FILES: &str = "files";
const NEW: &str = "new";
const OLD: &str = "old";
/// What the marker has of a file besides its name and mark.
const LIST_BYTES_OF_FILE: u64 = 16;

/// A site in the making. It is removed unless it is published.
#[derive(Debug)]
pub(super) struct SiteFolder {
    out: PathBuf,
    /// The folder beside it.
    work: PathBuf,
    files: OwnedFiles,
    /// About as long as their list in the marker is.
    list_bytes: u64,
    /// Folders of the site in the making.
    folders: BTreeSet<PathBuf>,
    journal: File,
    /// Held until the end.
    lock: Option<File>,
}

impl SiteFolder {
    /// Creates the folder beside `out`, and ends what an earlier publish left there. Fails if `out` is anything but an empty folder or a
    /// site with nothing else in it, or if another publish is running.
    pub(super) fn create(out: &Path) -> Result<Self, CommandError> {
        check_out(out, out, FileComparison::Lengths)?;
        let work = work_folder(out)?;
        let lock = claim(&work)?;
        clear(&work, out)?;
        let (new, journal) = (work.join(NEW), work.join(FILES));
        fs::create_dir(&new).map_err(|error| CommandError::write(&new, error))?;
        let journal = File::create_new(&journal).map_err(|error| CommandError::write(&journal, error))?;
        let (files, folders) = (OwnedFiles::default(), BTreeSet::from([new]));
        Ok(Self { out: out.to_owned(), work, files, list_bytes: 0, folders, journal, lock: Some(lock) })
    }

    /// Writes a file, given by its path in the site.
    pub(super) fn write(&mut self, name: &str, bytes: &[u8]) -> Result<(), CommandError> {
        let path = self.place(name, FileMark::of(bytes))?;
        let written = File::create(&path).and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        });
        written.map_err(|error| CommandError::write(&path, error))
    }

    /// Gives a file a second name in the site, or copies it where that is not possible.
    pub(super) fn link(&mut self, from: &Path, name: &str) -> Result<(), CommandError> {
        // A link to a symbolic link would be one, too.
        let from = fs::canonicalize(from).map_err(|error| CommandError::file(from, error))?;
        let mark = FileMark::of_file(&from).map_err(|error| CommandError::file(&from, error))?;
        let path = self.place(name, mark)?;
        if fs::hard_link(&from, &path).is_err() {
            fs::copy(&from, &path).map_err(|error| CommandError::write(&path, error))?;
        }
        sync(&path).map_err(|error| CommandError::write(&path, error))
    }

    /// Length and hash of a file of the site in the making; `None` if it has no such file.
    pub(super) fn mark(&self, name: &str) -> Option<FileMark> {
        self.files.get(name)
    }

    /// Notes a file, and returns its path. Fails if the list of files would be longer than the next publish reads.
    fn place(&mut self, name: &str, mark: FileMark) -> Result<PathBuf, CommandError> {
        let line = format!("{} {name}\n", mark.to_text());
        self.list_bytes += line.len() as u64 + LIST_BYTES_OF_FILE;
        if self.list_bytes > MAX_SITE_LIST_BYTES {
            let reason = "a site of so many files could not be told from others again; publish fewer cities, or without --tileset";
            return Err(CommandError::file(&self.out, reason));
        }
        self.journal.write_all(line.as_bytes()).map_err(|error| CommandError::write(self.work.join(FILES), error))?;
        self.files.add(name, mark);
        let path = self.work.join(NEW).join(name);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|error| CommandError::write(folder, error))?;
            let new = self.work.join(NEW);
            self.folders.extend(folder.ancestors().take_while(|folder| folder.starts_with(&new)).map(Path::to_owned));
        }
        Ok(path)
    }

    /// Adds the list of files to what the site says `about` itself, and puts the site into its place. Returns the number of its files and
    /// their bytes. Fails if the old one cannot be replaced, and then restores it. The old one is removed after the new one is on disk with
    /// its names, so that one of them survives a power failure.
    pub(super) fn publish(mut self, mut about: Value) -> Result<(u64, u64), CommandError> {
        about["files"] = self.files.to_json();
        self.write(SITE_FILE, format!("{about:#}\n").as_bytes())?;
        let (new, old) = (self.work.join(NEW), self.work.join(OLD));
        let failed = |error: io::Error| CommandError::write(&self.out, error);
        check_out(&self.out, &self.out, FileComparison::Lengths)?;
        self.folders.iter().for_each(|folder| sync_names(folder));
        let exists = self.out.exists();
        if exists {
            fs::rename(&self.out, &old).map_err(failed)?;
            // Here nothing is put into it any more: what is not as it was written stays.
            if let Err(error) = check_out(&old, &self.out, FileComparison::Bytes) {
                let _ = fs::rename(&old, &self.out);
                return Err(error);
            }
        }
        if let Err(error) = fs::rename(&new, &self.out) {
            // The first error is the one to report.
            let _ = fs::rename(&old, &self.out);
            return Err(failed(error));
        }
        if exists {
            sync_names(&self.work);
            sync_names(self.work.parent().unwrap_or(Path::new(".")));
            remove_site(&old)?;
        }
        Ok((self.files.len() as u64, self.files.bytes()))
    }
}

impl Drop for SiteFolder {
    fn drop(&mut self) {
        // What cannot be removed now, the next publish names: it knows the folder by the lock.
        let is_clear = clear(&self.work, &self.out).is_ok();
        // Held meanwhile, so that no other publish begins in the folder. Windows does not remove an open file.
        let lock = self.lock.take().filter(|_| cfg!(unix));
        if is_clear {
            let _ = fs::remove_file(self.work.join(LOCK));
            let _ = fs::remove_dir(&self.work);
        }
        drop(lock);
    }
}

/// Waits until a file or a folder is on disk. Windows does that for what is open for writing only.
fn sync(path: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(path)?.sync_all() } else { Ok(()) }
}

/// Waits until the names in a folder are on disk. Some file systems cannot; the files are there nevertheless.
fn sync_names(folder: &Path) {
    let _ = sync(folder);
}

/// The hidden folder beside a site.
fn work_folder(out: &Path) -> Result<PathBuf, CommandError> {
    let absolute = std::path::absolute(out).map_err(|error| CommandError::write(out, error))?;
    let Some(name) = absolute.file_name() else {
        return Err(CommandError::file(out, "it is not the name of a folder"));
    };
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(".publish");
    Ok(absolute.with_file_name(hidden))
}

/// Creates the work folder, or checks that an earlier publish did, and locks it. Fails if it has anything else in it.
fn claim(work: &Path) -> Result<File, CommandError> {
    const FOREIGN: &str = "is not unfinished work of `publish`, which needs the folder that it is in; move it away";
    let failed = |error: io::Error| CommandError::write(work, error);
    match kind_of(work)? {
        None => fs::create_dir_all(work).map_err(failed)?,
        Some(kind) if !kind.is_dir() => return Err(CommandError::file(work, FOREIGN)),
        Some(_) => {}
    }
    let lock = work.join(LOCK);
    let text = fs::symlink_metadata(&lock).is_ok_and(|found| found.is_file()).then(|| read_limited(&lock, 4096));
    // A publish that was killed before it wrote the marker left an empty folder, or an empty lock.
    let is_marked = text.as_ref().is_some_and(|text| text.as_ref().is_ok_and(|text| text == MARKER));
    let is_begun = text.is_some_and(|text| text.is_ok_and(|text| text.is_empty()));
    for entry in fs::read_dir(work).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name();
        let is_own = |own: &str| name.to_str() == Some(own);
        let is_known =
            is_own(LOCK) && (is_marked || is_begun) || is_marked && [FILES, NEW, OLD].into_iter().any(is_own);
        if !is_known {
            return Err(CommandError::file(entry.path(), FOREIGN));
        }
    }
    let opened = File::options().write(true).create(true).truncate(false).open(&lock);
    let mut file = opened.map_err(|error| CommandError::write(&lock, error))?;
    if let Err(fs::TryLockError::WouldBlock) = file.try_lock() {
        return Err(CommandError::file(work, "another `publish` is writing this site; wait until it has finished"));
    }
    if !is_marked {
        file.write_all(MARKER).map_err(|error| CommandError::write(&lock, error))?;
    }
    Ok(file)
}

/// Ends what a publish left in its work folder: the site before gets its place again if that is free. Fails if there are files that no
/// publish wrote, which stay, or if the site before has no place.
fn clear(work: &Path, out: &Path) -> Result<(), CommandError> {
    let (new, old, journal) = (work.join(NEW), work.join(OLD), work.join(FILES));
    if kind_of(&old)?.is_some() {
        // It fails for a folder that is not empty.
        let _ = fs::remove_dir(out);
        if kind_of(out)?.is_none() {
            fs::rename(&old, out).map_err(|error| CommandError::write(out, error))?;
        } else if out.join(SITE_FILE).is_file() {
            check_out(&old, &old, FileComparison::Bytes)?;
            remove_site(&old)?;
        } else {
            let reason = "it is the site before, whose place has other files; move these away";
            return Err(CommandError::file(&old, reason));
        }
    }
    if kind_of(&new)?.is_some() {
        let list = read_journal(&journal)?;
        let failed = |error: io::Error| CommandError::write(&new, error);
        let kept = list.remove(&new).map_err(failed)?;
        for path in kept {
            let name = path.strip_prefix(&new).unwrap_or(&path).to_string_lossy().replace('\\', "/");
            let is_cut = |mark: FileMark| {
                fs::symlink_metadata(&path).is_ok_and(|found| found.is_file() && found.len() < mark.bytes)
            };
            if !list.get(&name).is_some_and(is_cut) {
                return Err(CommandError::file(&path, "`publish` did not write it; move it away"));
            }
            // It was being written.
            fs::remove_file(&path).map_err(failed)?;
        }
        if kind_of(&new)?.is_some() {
            list.remove(&new).map_err(failed)?;
        }
    }
    match fs::remove_file(&journal) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(CommandError::write(&journal, error)),
        _ => Ok(()),
    }
}

/// The files that a publish has begun to write. A last line that is cut short is of none.
fn read_journal(path: &Path) -> Result<OwnedFiles, CommandError> {
    let mut list = OwnedFiles::default();
    let bytes = match read_limited(path, MAX_SITE_LIST_BYTES) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(list),
        read => read.map_err(|error| CommandError::file(path, error))?,
    };
    for line in String::from_utf8_lossy(&bytes).split_inclusive('\n').filter_map(|line| line.strip_suffix('\n')) {
        let parts = line.match_indices(' ').nth(1).map(|(at, _)| line.split_at(at));
        let file = parts.and_then(|(mark, name)| Some((name.get(1..)?, FileMark::parse(mark)?)));
        let (name, mark) = file.ok_or_else(|| CommandError::file(path, "it is damaged; move the folder away"))?;
        list.add(name, mark);
    }
    Ok(list)
}

/// Fails unless `folder` does not exist, is an empty folder, or has the marker of a site and its files alone. Errors name the files as
/// if they were in `shown`.
fn check_out(folder: &Path, shown: &Path, comparison: FileComparison) -> Result<(), CommandError> {
    let failed = |error: io::Error| CommandError::file(shown, error);
    match kind_of(folder)? {
        None => return Ok(()),
        Some(kind) if !kind.is_dir() => return Err(CommandError::file(shown, "a file or link with this name exists")),
        Some(_) => {}
    }
    if fs::read_dir(folder).map_err(failed)?.next().is_none() {
        return Ok(());
    }
    let files = site_files(folder, shown)?;
    let foreign = files.foreign(folder, SITE_FILE, comparison).map_err(failed)?;
    let Some(first) = foreign.first() else { return Ok(()) };
    let first = shown.join(first.strip_prefix(folder).unwrap_or(first));
    let more = if foreign.len() > 1 { format!(" (and {} more)", foreign.len() - 1) } else { String::new() };
    let reason =
        format!("`publish` did not write it as it is{more}, and would remove it; move it away, or give another --out");
    Err(CommandError::file(first, reason))
}

/// The list in the marker of a site.
fn site_files(folder: &Path, shown: &Path) -> Result<OwnedFiles, CommandError> {
    let text = read_limited(&folder.join(SITE_FILE), MAX_SITE_LIST_BYTES);
    let about = text.ok().and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    let is_site = |about: &Value| about["assets"].is_string() && about["cities"].is_array();
    let Some(about) = about.filter(is_site) else {
        return Err(CommandError::file(shown, "it is not empty and not a published site; give another --out"));
    };
    OwnedFiles::from_json(&about["files"]).ok_or_else(|| {
        let reason = "its list of files is missing or damaged, so that they cannot be told from others; give another --out, or remove it";
        CommandError::file(shown.join(SITE_FILE), reason)
    })
}

/// Removes a site that [`check_out`] accepts.
fn remove_site(folder: &Path) -> Result<(), CommandError> {
    let failed = |error: io::Error| CommandError::write(folder, error);
    if fs::read_dir(folder).map_err(failed)?.next().is_some() {
        let kept = site_files(folder, folder)?.remove(folder).map_err(failed)?;
        if let Some(path) = kept.iter().find(|path| **path != folder.join(SITE_FILE)) {
            return Err(CommandError::file(path, "`publish` did not write it, so it stays; move it away"));
        }
        fs::remove_file(folder.join(SITE_FILE)).map_err(failed)?;
    }
    match fs::remove_dir(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(failed(error)),
        _ => Ok(()),
    }
}

/// Kind of what has this path, without following a link; `None` if nothing has.
fn kind_of(path: &Path) -> Result<Option<fs::FileType>, CommandError> {
    match fs::symlink_metadata(path) {
        Ok(found) => Ok(Some(found.file_type())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(CommandError::file(path, error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_whose_list_would_not_be_read_again_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("site");
        let mut site = SiteFolder::create(&out).unwrap();
        let (mark, name) = (FileMark::of(b"a"), "x".repeat(240));
        let refused =
            (0..MAX_SITE_LIST_BYTES / 240).find_map(|number| site.place(&format!("{name}{number}"), mark).err());
        assert!(refused.unwrap().to_string().contains("without --tileset"));
        assert!(serde_json::to_vec_pretty(&site.files.to_json()).unwrap().len() as u64 <= MAX_SITE_LIST_BYTES);
        drop(site);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing stays");
    }
}
