//! Camera and camera path files.

use crate::error::{ClientError, Result};
use insula_archive::file::read_text;
use insula_archive::new_file::replace;
use insula_command_line::output::unused_file;
use insula_viewer::camera::{Camera, CameraFile, CameraPath};
use insula_viewer::camera_text;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Larger files are refused. A path of an hour has some megabytes.
const MAX_BYTES: u64 = 64 << 20;

/// The camera of an option: the text of a camera as view links have it, or a camera file. Fails if a file cannot be read or holds no valid
/// camera.
pub fn read_camera(text_or_file: &Path) -> Result<Camera> {
    Ok(read_camera_file(text_or_file)?.1)
}

/// The same with what a file says, digit by digit.
pub fn read_camera_file(text_or_file: &Path) -> Result<(CameraFile, Camera)> {
    let text = text_or_file.to_string_lossy();
    // A copied link or address has the text in it.
    let (_, of_link) = text.split_once("camera=").unwrap_or(("", &text));
    let camera = of_link.split(['&', '#']).next().unwrap_or_default().replace("%2C", ",");
    match camera_text::parse(&camera) {
        Some(camera) => Ok((CameraFile::from_camera(&camera), camera)),
        None if camera.contains(',') && !text_or_file.exists() => Err(ClientError::Usage(format!(
            "--camera {camera}: write X,Y,Z,AZIMUTH,PITCH,FOV in metres and degrees, with a field of view of 1 to 170, or name a camera file"
        ))),
        None => read(text_or_file, CameraFile::parse),
    }
}

/// Reads a camera path file. Fails if it cannot be read or holds no valid path.
pub fn read_path(path: &Path) -> Result<CameraPath> {
    read(path, CameraPath::parse)
}

/// Writes a camera or a path into `folder` under the first unused number, and returns the file. Fails if it cannot be written.
pub fn write_new(value: &impl Serialize, folder: &Path, stem: &str) -> Result<PathBuf> {
    let json = serde_json::to_string(value)
        .map_err(|e| ClientError::Failed(format!("{stem} cannot be written as JSON: {e}")))?;
    let file = unused_file(folder, stem, "json").map_err(ClientError::Failed)?;
    replace(&file, (json + "\n").as_bytes()).map_err(ClientError::file(&file))?;
    Ok(file)
}

fn read<T>(path: &Path, parse: impl Fn(&str) -> Result<T, String>) -> Result<T> {
    let text = read_text(path, MAX_BYTES).map_err(ClientError::file(path))?;
    parse(&text).map_err(|e| ClientError::Usage(format!("{}: {e}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_of_a_file_stay_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.json");
        let json = r#"{"position":[85013.7,446900.3,61.1],"target":[85047.1,446931.9,11.3],"fov_y_deg":57.3}"#;
        std::fs::write(&path, json).unwrap();
        let (file, camera) = read_camera_file(&path).unwrap();
        assert_eq!((file.target, file.up, file.fov_y_deg), ([85_047.1, 446_931.9, 11.3], [0.0, 0.0, 1.0], 57.3));
        assert_ne!(CameraFile::from_camera(&camera).target, file.target, "that is a hundred metres away");
        assert_eq!(read_camera(&path).unwrap(), camera);
    }
}
