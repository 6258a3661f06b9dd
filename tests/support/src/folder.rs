//! Temporary folders.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// An empty folder, removed when dropped.
pub struct TestFolder {
    pub path: PathBuf,
}

impl TestFolder {
    /// `name` must differ between tests, which run in parallel.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("insula-test-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self { path }
    }
}

impl Drop for TestFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// All files and folders below a folder, links not followed, with the content of files.
pub fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let kind = entry.file_type().unwrap();
        found.insert(entry.path(), if kind.is_file() { fs::read(entry.path()).unwrap() } else { Vec::new() });
        if kind.is_dir() {
            found.extend(tree(&entry.path()));
        }
    }
    found
}
