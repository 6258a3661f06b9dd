//! Files that a program wrote, told from those of others.
//!
//! Whoever writes a folder that a later run replaces keeps a list of its files with it. Only a file that is on the list and has its
//! bytes is ever removed: all others are somebody else's, or were changed by somebody else.

use crate::file::open_regular;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

/// Length and BLAKE3 hash of what was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileMark {
    pub bytes: u64,
    pub hash: blake3::Hash,
}

impl FileMark {
    /// The mark of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, hash: blake3::hash(bytes) }
    }

    /// The mark of a regular file, which is read. Fails if it cannot be.
    pub fn of_file(path: &Path) -> io::Result<Self> {
        let mut counted = Counted { inner: open_regular(path)?, bytes: 0 };
        let hash = blake3::Hasher::new().update_reader(&mut counted)?.finalize();
        Ok(Self { bytes: counted.bytes, hash })
    }

    /// As text: length and hash, separated by a space.
    pub fn to_text(&self) -> String {
        format!("{} {}", self.bytes, self.hash.to_hex())
    }

    /// The mark of a text; `None` if it is none.
    pub fn parse(text: &str) -> Option<Self> {
        let (bytes, hash) = text.split_once(' ')?;
        Some(Self { bytes: bytes.parse().ok()?, hash: blake3::Hash::from_hex(hash).ok()? })
    }
}

struct Counted<R> {
    inner: R,
    bytes: u64,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.bytes += read as u64;
        Ok(read)
    }
}

/// How closely files are compared with a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileComparison {
    /// By names and lengths, which takes no time.
    Lengths,
    /// By all bytes.
    Bytes,
}

/// The files that a program wrote into a folder, by their paths in it, with `/` between words.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct OwnedFiles(BTreeMap<String, FileMark>);

impl OwnedFiles {
    /// Adds a file, in place of one of the same name.
    pub fn add(&mut self, name: impl Into<String>, mark: FileMark) {
        self.0.insert(name.into(), mark);
    }

    /// The mark of a file on the list.
    pub fn get(&self, name: &str) -> Option<FileMark> {
        self.0.get(name).copied()
    }

    /// Number of files.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Length of all files in bytes.
    pub fn bytes(&self) -> u64 {
        self.0.values().map(|mark| mark.bytes).sum()
    }

    /// As JSON: a member for each file.
    pub fn to_json(&self) -> Value {
        self.0
            .iter()
            .map(|(name, mark)| (name.clone(), json!(mark.to_text())))
            .collect::<serde_json::Map<_, _>>()
            .into()
    }

    /// The list that [`Self::to_json`] gave; `None` if it is none, or if a name leads out of the folder.
    pub fn from_json(json: &Value) -> Option<Self> {
        let is_inside = |name: &str| Path::new(name).components().all(|word| matches!(word, Component::Normal(_)));
        let file = |(name, mark): (&String, &Value)| {
            is_inside(name).then_some((name.clone(), FileMark::parse(mark.as_str()?)?))
        };
        json.as_object()?.iter().map(file).collect::<Option<_>>().map(Self)
    }

    /// The entries that the list does not account for: files of others, changed files, links, and folders without a listed file.
    /// `besides` is a file that is not on the list, too. Fails if the folder cannot be read.
    pub fn foreign(&self, root: &Path, besides: &str, comparison: FileComparison) -> io::Result<Vec<PathBuf>> {
        let mut foreign = Vec::new();
        walk(root, &mut |name, path, kind| {
            let is_own = match kind {
                FoundKind::Folder => continue_into(self, name),
                FoundKind::File if name == besides => true,
                FoundKind::File => self.is_unchanged(name, path, comparison)?,
                FoundKind::Other => false,
            };
            if !is_own {
                foreign.push(path.to_owned());
            }
            Ok(is_own)
        })?;
        foreign.sort();
        Ok(foreign)
    }

    /// Removes the files of the list that have their bytes, then folders that are empty, `root` among them. Returns what stays. Fails if
    /// something cannot be read or removed.
    pub fn remove(&self, root: &Path) -> io::Result<Vec<PathBuf>> {
        let (mut kept, mut folders) = (Vec::new(), vec![root.to_owned()]);
        walk(root, &mut |name, path, kind| {
            match kind {
                FoundKind::Folder if continue_into(self, name) => {
                    folders.push(path.to_owned());
                    return Ok(true);
                }
                FoundKind::File if self.is_unchanged(name, path, FileComparison::Bytes)? => fs::remove_file(path)?,
                _ => kept.push(path.to_owned()),
            }
            Ok(false)
        })?;
        // Those below a folder come after it.
        for folder in folders.iter().rev() {
            match fs::remove_dir(folder) {
                Err(error) if !matches!(error.kind(), io::ErrorKind::DirectoryNotEmpty | io::ErrorKind::NotFound) => {
                    return Err(error);
                }
                _ => {}
            }
        }
        kept.sort();
        Ok(kept)
    }

    fn is_unchanged(&self, name: &str, path: &Path, comparison: FileComparison) -> io::Result<bool> {
        let Some(mark) = self.0.get(name) else { return Ok(false) };
        let has_length = fs::symlink_metadata(path)?.len() == mark.bytes;
        Ok(has_length && (comparison == FileComparison::Lengths || FileMark::of_file(path)? == *mark))
    }
}

/// Calls `visit` with each entry of a folder. If the entry is a folder and `visit` returned true, its entries follow. Links are not followed.
fn walk(root: &Path, visit: &mut dyn FnMut(&str, &Path, FoundKind) -> io::Result<bool>) -> io::Result<()> {
    let mut open = vec![(String::new(), root.to_owned())];
    while let Some((prefix, folder)) = open.pop() {
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let kind = entry.file_type()?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            let what = match kind {
                kind if kind.is_dir() => FoundKind::Folder,
                kind if kind.is_file() => FoundKind::File,
                _ => FoundKind::Other,
            };
            let goes_on = visit(&name, &entry.path(), what)?;
            if goes_on && kind.is_dir() {
                open.push((name + "/", entry.path()));
            }
        }
    }
    Ok(())
}

/// What has a path.
enum FoundKind {
    Folder,
    File,
    /// A link, a device or a pipe.
    Other,
}

/// Whether a folder is one that files of the list are in.
fn continue_into(list: &OwnedFiles, folder: &str) -> bool {
    let inside = format!("{folder}/");
    list.0.range(inside.clone()..).next().is_some_and(|(name, _)| name.starts_with(&inside))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path, text: &str) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    #[test]
    fn only_what_is_listed_and_unchanged_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("site");
        let mut list = OwnedFiles::default();
        for name in ["index.html", "a/one.js", "a/two.js", "b/c/three.js"] {
            write(&root.join(name), name);
            list.add(name, FileMark::of(name.as_bytes()));
        }
        assert_eq!(OwnedFiles::from_json(&list.to_json()).unwrap(), list);
        assert!(list.foreign(&root, "", FileComparison::Bytes).unwrap().is_empty());
        // Of the same length, but not the same bytes.
        write(&root.join("a/two.js"), "a/TWO.js");
        for name in ["a/mine.png", "mine/index.html", "list.json"] {
            write(&root.join(name), "dear");
        }
        let mut expected = vec![root.join("a/mine.png"), root.join("mine")];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path(), root.join("b/link")).unwrap();
            expected.insert(1, root.join("b/link"));
        }
        assert_eq!(list.foreign(&root, "list.json", FileComparison::Lengths).unwrap(), expected);
        expected.insert(1, root.join("a/two.js"));
        assert_eq!(list.foreign(&root, "list.json", FileComparison::Bytes).unwrap(), expected);
        expected.push(root.join("list.json"));
        expected.sort();
        assert_eq!(list.remove(&root).unwrap(), expected);
        assert!(!root.join("index.html").exists() && !root.join("b/c").exists());
        assert!(expected.iter().all(|path| path.symlink_metadata().is_ok()));
        fs::remove_dir_all(&root).unwrap();
        write(&root.join("index.html"), "index.html");
        assert!(list.remove(&root).unwrap().is_empty() && !root.exists());
    }

    #[test]
    fn lists_that_lead_out_of_the_folder_are_none() {
        let mark = FileMark::of(b"x").to_text();
        assert!(OwnedFiles::from_json(&json!({ "a/b": mark })).is_some());
        for bad in [json!({ "../b": mark }), json!({ "/etc/passwd": mark }), json!({ "a": "1 xyz" }), json!([1])] {
            assert_eq!(OwnedFiles::from_json(&bad), None, "{bad}");
        }
    }
}
