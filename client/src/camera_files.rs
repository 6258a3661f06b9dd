//! Cameras of options, and files of cameras and camera paths.

use crate::error::{ClientError, Result};
use insula_archive::file::read_text;
use insula_archive::new_file::replace;
use insula_command_line::camera::{EarthCamera, GivenCamera, degrees_fault};
use insula_command_line::output::unused_file;
use insula_protocol::Manifest;
use insula_viewer::camera::{Camera, CameraFile, CameraPath};
use insula_viewer::camera_text;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Larger files are refused. A path of an hour has some megabytes.
const MAX_BYTES: u64 = 64 << 20;

/// The camera of an option or of a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlacedCamera {
    /// In metres of the city, with what a file says of it, digit by digit.
    InCity(CameraFile, Camera),
    /// In degrees: its metres need the city.
    OnEarth(EarthCamera),
}

impl PlacedCamera {
    /// The camera, if it needs no city.
    pub fn known(self) -> Option<Camera> {
        match self {
            Self::InCity(_, camera) => Some(camera),
            Self::OnEarth(_) => None,
        }
    }

    /// The camera in a city. Fails if it is far from it, or if a file or a link has degrees.
    pub fn in_city(self, manifest: &Manifest) -> Result<(CameraFile, Camera)> {
        match self {
            Self::InCity(file, camera) => {
                let [x, y, _] = file.position;
                degrees_fault(manifest, [x, y]).map_or(Ok((file, camera)), |fault| Err(ClientError::Usage(fault)))
            }
            Self::OnEarth(typed) => {
                let camera = camera_of(typed.in_city(manifest).map_err(ClientError::Usage)?)?;
                Ok((CameraFile::from_camera(&camera), camera))
            }
        }
    }
}

impl From<Camera> for PlacedCamera {
    fn from(camera: Camera) -> Self {
        Self::InCity(CameraFile::from_camera(&camera), camera)
    }
}

/// The camera of `--camera`. Fails if it is neither a camera nor a file, or if the file cannot be read or holds no valid camera.
pub fn given_camera(value: &Path) -> Result<PlacedCamera> {
    match GivenCamera::parse(value).map_err(ClientError::Usage)? {
        GivenCamera::OnEarth(camera) => Ok(PlacedCamera::OnEarth(camera)),
        GivenCamera::InCity(numbers) => Ok(camera_of(numbers)?.into()),
        GivenCamera::File(path) => {
            let (file, camera) = read(&path, CameraFile::parse)?;
            Ok(PlacedCamera::InCity(file, camera))
        }
    }
}

fn camera_of(numbers: [f64; 6]) -> Result<Camera> {
    camera_text::of_numbers(numbers).ok_or_else(|| ClientError::Usage("--camera is out of range".to_owned()))
}

/// Reads a camera file. Fails if it cannot be read or holds no valid camera.
pub fn read_camera(path: &Path) -> Result<Camera> {
    Ok(read(path, CameraFile::parse)?.1)
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
        let PlacedCamera::InCity(file, camera) = given_camera(&path).unwrap() else { panic!("no camera in metres") };
        assert_eq!((file.target, file.up, file.fov_y_deg), ([85_047.1, 446_931.9, 11.3], [0.0, 0.0, 1.0], 57.3));
        assert_ne!(CameraFile::from_camera(&camera).target, file.target, "that is a hundred metres away");
        assert_eq!(read_camera(&path).unwrap(), camera);
    }
}
