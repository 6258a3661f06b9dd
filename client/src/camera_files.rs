//! Reads camera and camera path files.

use crate::error::{ClientError, Result};
use insula_archive::file::read_text;
use insula_viewer::camera::{Camera, CameraFile, CameraPath};
use std::path::Path;

/// Larger files are refused. A path of an hour has some megabytes.
const MAX_BYTES: u64 = 64 << 20;

/// Reads a camera file. Fails if it cannot be read or holds no valid camera.
pub fn read_camera(path: &Path) -> Result<Camera> {
    read(path, CameraFile::parse)
}

/// Reads a camera path file. Fails if it cannot be read or holds no valid path.
pub fn read_path(path: &Path) -> Result<CameraPath> {
    read(path, CameraPath::parse)
}

fn read<T>(path: &Path, parse: impl Fn(&str) -> Result<T, String>) -> Result<T> {
    let text = read_text(path, MAX_BYTES).map_err(ClientError::file(path))?;
    parse(&text).map_err(|e| ClientError::Usage(format!("{}: {e}", path.display())))
}
