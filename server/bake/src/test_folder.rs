//! A temporary folder for unit tests.

use std::{fs, path::PathBuf};

/// An empty folder, removed when dropped.
pub(crate) struct TestFolder {
    pub(crate) path: PathBuf,
}

impl TestFolder {
    /// `name` must differ between tests, which run in parallel.
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("insula-bake-{name}-{}", std::process::id()));
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
