//! Pictures: found, checked, decoded once, shared.
//!
//! In: names from material libraries and appearances. Out: numbers of [`TextureStore`]. Next: `builder`.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::Cursor;
use std::sync::Arc;

use image::{ImageReader, Limits};

use super::report::SourceReport;
use super::source::{CitySource, read_beside};
use crate::scene::SceneTexture;
use crate::scene::scratch_scene::TextureStore;

/// A picture's file may have this many bytes for each pixel that is allowed: enough for any uncompressed one.
const FILE_BYTES_PER_PIXEL: u64 = 8;
/// And this many for everything that is no pixel.
const FILE_BYTES_ASIDE: u64 = 1 << 20;

/// All pictures so far, with those that failed, so that each is tried once.
pub(crate) struct TextureLoader {
    by_name: HashMap<(String, String), Result<u32, TextureFault>>,
    max_pixels: u64,
    pub(crate) pictures: TextureStore,
}

struct TextureFault {
    kind: &'static str,
    detail: String,
}

impl TextureLoader {
    pub(crate) fn new(max_pixels: u64, pictures: TextureStore) -> Self {
        Self { by_name: HashMap::new(), max_pixels, pictures }
    }

    /// The picture's number, or `None` after noting in the report why there is none.
    pub(crate) fn load(&mut self, source: &CitySource<'_>, name: &str, report: &mut SourceReport) -> Option<u32> {
        let key = (source.files.place(), name.to_owned());
        let picture = match self.by_name.entry(key) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(vacant) => {
                let found = find(source, name, self.max_pixels);
                report.textures += u64::from(found.is_ok());
                vacant.insert(found.map(|texture| self.pictures.add(Arc::new(texture))))
            }
        };
        match picture {
            Ok(number) => Some(*number),
            Err(fault) => {
                report.problem(fault.kind, || format!("{name}: {}", fault.detail));
                None
            }
        }
    }
}

/// Reads and decodes a picture beside the source.
fn find(source: &CitySource<'_>, name: &str, max_pixels: u64) -> Result<SceneTexture, TextureFault> {
    if name.contains("://") {
        return Err(TextureFault {
            kind: "texture on the web",
            detail: "not fetched, put it beside the file".to_owned(),
        });
    }
    let name = name.replace('\\', "/");
    let limit = max_pixels.saturating_mul(FILE_BYTES_PER_PIXEL).saturating_add(FILE_BYTES_ASIDE);
    let bare = name.rsplit('/').next().unwrap_or(&name);
    let folder = source.name.rsplit_once('/').map_or("", |(folder, _)| folder);
    let beside = |name: &str| if folder.is_empty() { name.to_owned() } else { format!("{folder}/{name}") };
    let read = |name: &str| read_beside(&*source.files, &beside(name), limit);
    // Absolute paths of the machine that exported the file are common: the picture then mostly lies beside it.
    let bytes = read(&name).or_else(|error| if bare == name { Err(error) } else { read(bare).map_err(|_| error) });
    let bytes = bytes.map_err(|error| {
        let missing = error.kind() == std::io::ErrorKind::NotFound;
        TextureFault { kind: if missing { "texture missing" } else { "texture unreadable" }, detail: error.to_string() }
    })?;
    decode(bytes, max_pixels)
}

/// Decodes a picture after its header has been found acceptable.
fn decode(bytes: Vec<u8>, max_pixels: u64) -> Result<SceneTexture, TextureFault> {
    let broken = |error: &dyn std::fmt::Display| TextureFault { kind: "texture broken", detail: one_line(error) };
    let bytes = Cursor::new(bytes);
    let header = ImageReader::new(bytes.clone()).with_guessed_format().map_err(|error| broken(&error))?;
    let (width, height) = header.into_dimensions().map_err(|error| broken(&error))?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > max_pixels {
        let detail = format!("{width} x {height} pixels, allowed are {max_pixels} in all");
        return Err(TextureFault { kind: "texture too large", detail });
    }
    let mut reader = ImageReader::new(bytes).with_guessed_format().map_err(|error| broken(&error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_pixels.saturating_mul(FILE_BYTES_PER_PIXEL).saturating_add(FILE_BYTES_ASIDE));
    reader.limits(limits);
    let rgb = reader.decode().map_err(|error| broken(&error))?.into_rgb8();
    let rgb = rgb.into_raw().chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
    Ok(SceneTexture { width, height, rgb })
}

fn one_line(error: &dyn std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::report::SourceFormat;
    use super::super::source::embedded;
    use super::*;

    /// A PNG of one colour.
    pub(crate) fn png(width: u32, height: u32, rgb: [u8; 3]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let picture = image::RgbImage::from_pixel(width, height, image::Rgb(rgb));
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    fn load(files: &[(&str, &[u8])], name: &str, max_pixels: u64) -> (Option<Arc<SceneTexture>>, SourceReport) {
        let sources = embedded(files);
        let mut report = SourceReport::new("a.obj", SourceFormat::Obj, 0);
        let mut store = TextureLoader::new(max_pixels, TextureStore::in_memory());
        let number = store.load(&sources[0], name, &mut report);
        (number.map(|number| store.pictures.get(number).unwrap()), report)
    }

    #[test]
    fn a_picture_is_found_beside_the_file_even_by_a_foreign_absolute_path() {
        let picture = png(3, 2, [10, 20, 30]);
        let files: [(&str, &[u8]); 2] = [("a.obj", b""), ("wall.png", &picture)];
        for name in ["wall.png", "C:\\export\\wall.png", "/export/wall.png"] {
            let (texture, report) = load(&files, name, 100);
            let texture = texture.unwrap();
            assert_eq!((texture.width, texture.height, texture.rgb[5]), (3, 2, [10, 20, 30]));
            assert_eq!((report.textures, report.problems.len()), (1, 0));
        }
    }

    #[test]
    fn missing_broken_oversized_and_remote_pictures_are_reported() {
        let picture = png(3, 2, [10, 20, 30]);
        let cut = &picture[..picture.len() - 20];
        let files: [(&str, &[u8]); 4] =
            [("a.obj", b""), ("wall.png", &picture), ("cut.png", cut), ("odd.jpg", b"no picture")];
        let cases = [
            ("none.png", "texture missing"),
            ("cut.png", "texture broken"),
            ("odd.jpg", "texture broken"),
            ("wall.png", "texture too large"),
            ("https://example.org/wall.png", "texture on the web"),
        ];
        for (name, kind) in cases {
            // 3 x 2 is one pixel too many for the whole picture alone.
            let (texture, report) = load(&files, name, if name == "wall.png" { 5 } else { 100 });
            assert!(texture.is_none(), "{name}");
            assert_eq!((report.problems[kind].count, report.textures), (1, 0), "{name}");
        }
    }
}
