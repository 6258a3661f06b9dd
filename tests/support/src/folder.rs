//! Temporary folders.

use std::{fs, path::PathBuf};

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
