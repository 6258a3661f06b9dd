//! Reads camera and camera path files.

use crate::error::{ClientError, Result};
use insula_viewer::camera::{Camera, CameraFile, CameraPath};
use std::path::Path;

/// Reads a camera file. Fails if it cannot be read or holds no valid camera.
pub fn read_camera(path: &Path) -> Result<Camera> {
    read(path, CameraFile::parse)
}

/// Reads a camera path file. Fails if it cannot be read or holds no valid path.
pub fn read_path(path: &Path) -> Result<CameraPath> {
    read(path, CameraPath::parse)
}

fn read<T>(path: &Path, parse: impl Fn(&str) -> Result<T, String>) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(ClientError::file(path))?;
    parse(&text).map_err(|e| ClientError::Usage(format!("{}: {e}", path.display())))
}
