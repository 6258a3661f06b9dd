//! What a bake may replace or remove: only folders whose every entry it recognises as its own.
//!
//! Entries are classified without following links, so a planted link is an unknown entry like any other file.

use super::files::{remove_file, remove_folder};
use super::{fingerprints, thumbnail};
use crate::config::BakeOptions;
use crate::error::BakeError;
use insula_archive::city::{MANIFEST_FILE, SEARCH_FILE};
use insula_archive::file::{open_regular, read_limited};
use insula_archive::places::{
    KeptFolder, SCRATCH_FILE as MARKER_FILE, canonical, has_manifest, kept_folder, kept_folder_above,
};
use insula_protocol::TileKind;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Content of [`MARKER_FILE`].
const MARKER: &[u8] = b"Insula keeps unfinished work of `bake` in this folder and removes it without asking.\n";

/// What is allowed in a folder.
type Rule = fn(&str, fs::FileType) -> bool;

fn is_city_file(name: &str) -> bool {
    name == MANIFEST_FILE
        || name == fingerprints::FILE_NAME
        || name == thumbnail::FILE_NAME
        || name == thumbnail::OLD_FILE_NAME
        || name == SEARCH_FILE
        || TileKind::ALL.iter().any(|kind| kind.file_name() == name)
}

/// Whether a name is so many numbers with `-` between them, and one of these extensions.
fn is_numbered(name: &str, count: usize, extensions: &[&str]) -> bool {
    let Some((numbers, extension)) = name.rsplit_once('.') else { return false };
    let is_number = |word: &str| !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit());
    extensions.contains(&extension) && numbers.split('-').count() == count && numbers.split('-').all(is_number)
}

fn in_city(name: &str, kind: fs::FileType) -> bool {
    let is_unfinished =
        |stem| ["jpg", "png", "bin", "json", "index"].iter().any(|end| is_city_file(&format!("{stem}.{end}")));
    kind.is_file() && (is_city_file(name) || name.strip_suffix(".tmp").is_some_and(is_unfinished))
}

fn in_published_city(name: &str, kind: fs::FileType) -> bool {
    kind.is_file() && is_city_file(name)
}

fn in_packs(name: &str, kind: fs::FileType) -> bool {
    // Earlier versions of the program kept meshes apart.
    kind.is_file() && is_numbered(name.strip_prefix("m-").unwrap_or(name), 3, &["pack", "tmp"])
}

fn in_scene(name: &str, kind: fs::FileType) -> bool {
    if kind.is_dir() { name == "buckets" } else { kind.is_file() && is_scene_file(name) }
}

fn is_scene_file(name: &str) -> bool {
    name == "triangles" || name == "names" || name == "records" || is_numbered(name, 1, &["rgb"])
}

fn in_buckets(name: &str, kind: fs::FileType) -> bool {
    kind.is_file() && is_numbered(name, 2, &["bucket"])
}

fn in_scratch(name: &str, kind: fs::FileType) -> bool {
    let is_folder = matches!(name, "packs" | "spool" | "city" | "replaced");
    // Earlier versions of the program kept a state.
    let is_file = matches!(name, MARKER_FILE | "lock" | "state.json" | "state.tmp");
    if kind.is_dir() { is_folder } else { kind.is_file() && is_file }
}

/// The first entry of a folder that `rule` does not allow; `None` also if there is no such folder.
fn unknown_entry(folder: &Path, rule: Rule) -> Result<Option<PathBuf>, BakeError> {
    let failed = |cause| BakeError::io(folder, "read", cause);
    let entries = match fs::read_dir(folder) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
        entries => entries.map_err(failed)?,
    };
    let mut unknown = Vec::new();
    for entry in entries {
        let entry = entry.map_err(failed)?;
        let kind = entry.file_type().map_err(failed)?;
        if !entry.file_name().to_str().is_some_and(|name| rule(name, kind)) {
            unknown.push(entry.path());
        }
    }
    Ok(unknown.into_iter().min())
}

fn refuse(path: &Path, what: &'static str) -> BakeError {
    BakeError::Out { path: path.to_owned(), what }
}

/// Kind of what has this path, without following a link; `None` if nothing has.
fn kind_of(path: &Path) -> Result<Option<fs::FileType>, BakeError> {
    match fs::symlink_metadata(path) {
        Ok(found) => Ok(Some(found.file_type())),
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(cause) => Err(BakeError::io(path, "read", cause)),
    }
}

/// Fails unless `out` does not exist, is an empty folder, or has a manifest and no files but those of a city:
/// nothing else is ever replaced.
pub(super) fn check_out(out: &Path) -> Result<(), BakeError> {
    match kind_of(out)? {
        None => return Ok(()),
        Some(kind) if kind.is_symlink() => return Err(refuse(out, "it is a link, which a bake does not follow")),
        Some(kind) if !kind.is_dir() => return Err(refuse(out, "a file with this name exists")),
        Some(_) => {}
    }
    if let Some(unknown) = unknown_entry(out, in_published_city)? {
        return Err(refuse(&unknown, "is not a file of a city, and the bake would remove it"));
    }
    for entry in fs::read_dir(out).map_err(|cause| BakeError::io(out, "read", cause))?.flatten() {
        if !begins_as_named(&entry.path()) {
            return Err(refuse(
                &entry.path(),
                "has the name of a city's file and another content, and the bake would remove it",
            ));
        }
    }
    let is_empty = fs::read_dir(out).map_err(|cause| BakeError::io(out, "read", cause))?.next().is_none();
    if is_empty || has_manifest(out) {
        return Ok(());
    }
    Err(refuse(&out.join(MANIFEST_FILE), "is not the manifest of a city, so the folder is not replaced"))
}

/// Whether a city's file begins as those of its name do, as far as it reaches: a copy may be cut short.
fn begins_as_named(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let first: &[u8] = match name {
        fingerprints::FILE_NAME => &fingerprints::MAGIC,
        thumbnail::OLD_FILE_NAME => thumbnail::OLD_SIGNATURE,
        SEARCH_FILE => b"INSX",
        _ if name.ends_with(".pmtiles") => b"PMTiles",
        // The manifest is read whole.
        _ => b"",
    };
    let is_picture = name == thumbnail::FILE_NAME;
    let bytes = if is_picture { thumbnail::HEAD_BYTES } else { first.len() };
    let mut head = Vec::new();
    let read = open_regular(path).and_then(|file| file.take(bytes as u64).read_to_end(&mut head));
    read.is_ok() && if is_picture { thumbnail::is_own(&head) } else { first.starts_with(&head) }
}

/// Removes a city that [`check_out`] accepts. Fails, and keeps the folder, if it contains anything else.
pub(super) fn remove_city(folder: &Path) -> Result<(), BakeError> {
    check_out(folder)?;
    remove_city_files(folder)
}

fn remove_city_files(folder: &Path) -> Result<(), BakeError> {
    let pictures = [thumbnail::FILE_NAME, thumbnail::OLD_FILE_NAME];
    let others = [fingerprints::FILE_NAME, SEARCH_FILE, MANIFEST_FILE];
    for name in TileKind::ALL.iter().map(|kind| kind.file_name()).chain(pictures).chain(others) {
        remove_file(&folder.join(name))?;
    }
    match fs::remove_dir(folder) {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(BakeError::io(folder, "removed", cause)),
        _ => Ok(()),
    }
}

/// Removes the files of a city that cannot be opened, whose manifest may be damaged. Does nothing if there is no such folder. Fails, and
/// removes nothing, if the folder contains anything but files with names of a city's.
pub fn remove_damaged_city(folder: &Path) -> Result<(), BakeError> {
    match kind_of(folder)? {
        None => return Ok(()),
        Some(kind) if !kind.is_dir() => return Err(refuse(folder, "a file or link with this name exists")),
        Some(_) => {}
    }
    if let Some(unknown) = unknown_entry(folder, in_published_city)? {
        return Err(refuse(&unknown, "is not a file of a city, and would be removed with it"));
    }
    remove_city_files(folder)
}

/// Creates the scratch folder, or checks that an existing one is an earlier bake's with nothing else in it.
pub(super) fn claim_scratch(root: &Path) -> Result<(), BakeError> {
    match kind_of(root)? {
        None => fs::create_dir(root).map_err(|cause| BakeError::io(root, "created", cause))?,
        Some(kind) if !kind.is_dir() => return Err(refuse(root, "a file or link with this name exists")),
        Some(_) => {}
    }
    let marker = root.join(MARKER_FILE);
    let is_marked = kind_of(&marker)?.is_some_and(|kind| kind.is_file())
        && read_limited(&marker, 4096).is_ok_and(|text| text == MARKER);
    // A bake that was killed before it wrote the marker left an empty folder, or an empty marker.
    let rule: Rule = if is_marked { in_scratch } else { |name, kind| name == MARKER_FILE && kind.is_file() };
    if let Some(unknown) = unknown_entry(root, rule)? {
        return Err(refuse(&unknown, "is not unfinished work of a bake, which needs the folder that it is in"));
    }
    if is_marked { check_scratch(root) } else { write_marker(&marker) }
}

/// Fails if a folder of the scratch folder contains anything that no bake wrote.
pub(super) fn check_scratch(root: &Path) -> Result<(), BakeError> {
    let rules: [(&str, Rule); 4] =
        [("packs", in_packs), ("spool", in_scene), ("spool/buckets", in_buckets), ("city", in_city)];
    for (folder, rule) in rules {
        if let Some(unknown) = unknown_entry(&root.join(folder), rule)? {
            return Err(refuse(&unknown, "is not unfinished work of a bake, which would remove it"));
        }
    }
    check_out(&root.join("replaced"))
}

fn write_marker(marker: &Path) -> Result<(), BakeError> {
    remove_file(marker)?;
    let written = fs::File::create_new(marker).and_then(|mut file| io::Write::write_all(&mut file, MARKER));
    match written {
        // A second bake that starts at the same moment; the lock decides between the two.
        Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        written => written.map_err(|cause| BakeError::io(marker, "written", cause)),
    }
}

/// Removes a scratch folder that [`claim_scratch`] accepts. Fails if it contains anything else, which stays.
pub(super) fn remove_scratch(root: &Path) -> Result<(), BakeError> {
    if let Some(unknown) = unknown_entry(root, in_scratch)? {
        return Err(refuse(&unknown, "is not unfinished work of a bake, so its folder stays"));
    }
    check_scratch(root)?;
    remove_city(&root.join("replaced"))?;
    for folder in ["packs", "spool", "city"] {
        remove_folder(&root.join(folder))?;
    }
    // The marker last: a removal that is interrupted can be repeated.
    for file in ["state.json", "state.tmp", "lock", MARKER_FILE] {
        remove_file(&root.join(file))?;
    }
    fs::remove_dir(root).map_err(|cause| BakeError::io(root, "removed", cause))
}

/// Fails if a folder lies in one that the programs keep, or is one of another kind than `own`. `option` names it.
pub(crate) fn check_place(folder: &Path, option: &'static str, own: KeptFolder) -> Result<(), BakeError> {
    let is_other = kept_folder(folder).filter(|kind| *kind != own).map(|kind| format!("it is {kind}"));
    let lies_in = kept_folder_above(folder).map(|(other, kind)| format!("it lies in {kind}, {}", other.display()));
    match is_other.or(lies_in) {
        Some(what) => {
            let advice = format!("{what}; choose another folder");
            Err(BakeError::Option { option, value: folder.display().to_string(), advice })
        }
        None => Ok(()),
    }
}

/// Fails if something that the bake reads is, or lies in, one of the folders, which `option` names and the bake removes.
pub(crate) fn check_inputs(folders: &[PathBuf], option: &'static str, options: &BakeOptions) -> Result<(), BakeError> {
    let folders: Vec<PathBuf> = folders.iter().map(|folder| canonical(folder)).collect();
    for input in options.read_paths() {
        let found = canonical(&input);
        if let Some(place) = folders.iter().find(|folder| found.starts_with(folder)) {
            return Err(BakeError::Inside { input, place: place.clone(), option });
        }
    }
    Ok(())
}

/// Fails if the folder cannot be renamed because a file system is mounted on it. That would show only after the bake.
pub(super) fn check_mount(folder: &Path) -> Result<(), BakeError> {
    if kind_of(folder)?.is_some() && is_mount_point(folder) {
        return Err(refuse(
            folder,
            "a file system is mounted on it, so it cannot be replaced as a whole; name a folder in it",
        ));
    }
    Ok(())
}

#[cfg(unix)]
fn is_mount_point(folder: &Path) -> bool {
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::MetadataExt;
    let folder = canonical(folder);
    let device = |path: &Path| fs::symlink_metadata(path).ok().map(|found| found.dev());
    if folder.parent().is_some_and(|parent| device(parent) != device(&folder)) {
        return true;
    }
    // A bind mount has the device of its source. Blanks in a path are `\040` in the list.
    let escaped: Vec<u8> = folder.as_os_str().as_bytes().iter().flat_map(|byte| escape_mount_byte(*byte)).collect();
    let mounts = fs::read("/proc/self/mountinfo").unwrap_or_default();
    mounts.split(|byte| *byte == b'\n').any(|line| line.split(|byte| *byte == b' ').nth(4) == Some(&escaped))
}

#[cfg(unix)]
fn escape_mount_byte(byte: u8) -> Vec<u8> {
    if matches!(byte, b' ' | b'\t' | b'\n' | b'\\') { format!("\\{byte:03o}").into_bytes() } else { vec![byte] }
}

#[cfg(not(unix))]
fn is_mount_point(_: &Path) -> bool {
    false
}
