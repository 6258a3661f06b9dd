//! Finds and decodes the images of textures. Each image is tried once and shared.

use crate::scene::SceneTexture;
use crate::scene::texture_store::{TextureFacts, TextureStore};
use image::{ImageReader, Limits};
use insula_dress::alpha_mask::AlphaGrid;
use insula_source::files::OUTSIDE;
use insula_source::problems::{
    TEXTURE_BROKEN, TEXTURE_MISSING, TEXTURE_ON_THE_WEB, TEXTURE_OUTSIDE, TEXTURE_TOO_LARGE, TEXTURE_UNREADABLE,
};
use insula_source::report::SourceReport;
use insula_source::source::{CitySource, read_sibling};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::{Cursor, ErrorKind};
use std::sync::Arc;

/// Allowed file size per allowed pixel: enough for any uncompressed image.
const FILE_BYTES_PER_PIXEL: u64 = 8;
/// Allowed file size besides pixels.
const FILE_BYTES_BASE: u64 = 1 << 20;

/// The alpha of further textures is ignored. One takes 16 KiB.
const MAX_ALPHA_GRIDS: usize = 4096;

/// Loads textures by name and remembers those that failed.
pub(crate) struct TextureLoader {
    by_name: HashMap<(String, String), Result<u32, TextureFault>>,
    max_pixels: u64,
    /// Folders of sources.
    sets: HashMap<String, u32>,
    /// By texture; `None` for a generated one.
    pub(crate) set_of_texture: Vec<Option<u32>>,
    /// Of textures that are not opaque.
    alpha: HashMap<u32, AlphaGrid>,
    pub(crate) textures: TextureStore,
}

struct TextureFault {
    kind: &'static str,
    detail: String,
}

/// A decoded image.
struct Decoded {
    texture: SceneTexture,
    /// `None` if it is opaque.
    alpha: Option<AlphaGrid>,
}

impl Decoded {
    fn new([width, height]: [u32; 2], rgba: impl ExactSizeIterator<Item = [u8; 4]> + Clone) -> Self {
        let alpha: Vec<u8> = rgba.clone().map(|[_, _, _, alpha]| alpha).collect();
        let rgb = rgba.map(|[r, g, b, _]| [r, g, b]).collect();
        Self {
            texture: SceneTexture { width, height, rgb, is_pattern: false },
            alpha: AlphaGrid::new(width as usize, height as usize, &alpha),
        }
    }
}

impl TextureLoader {
    pub(crate) fn new(max_pixels: u64, textures: TextureStore) -> Self {
        let (by_name, sets, alpha) = (HashMap::new(), HashMap::new(), HashMap::new());
        Self { by_name, max_pixels, sets, set_of_texture: Vec::new(), alpha, textures }
    }

    /// The set of a source's textures: those of its folder.
    pub(crate) fn set_of(&mut self, source: &CitySource<'_>) -> u32 {
        let next = self.sets.len() as u32;
        *self.sets.entry(source.files.location()).or_insert(next)
    }

    /// The alpha of a texture; `None` if it is opaque.
    pub(crate) fn alpha(&self, number: u32) -> Option<&AlphaGrid> {
        self.alpha.get(&number)
    }

    /// A set by a name that is no folder.
    pub(crate) fn set_named(&mut self, name: &str) -> u32 {
        let next = self.sets.len() as u32;
        *self.sets.entry(format!("<{name}>")).or_insert(next)
    }

    /// A set by one of [`Self::set_names`], of this loader or another.
    pub(crate) fn set_of_name(&mut self, name: &str) -> u32 {
        let next = self.sets.len() as u32;
        *self.sets.entry(name.to_owned()).or_insert(next)
    }

    /// Adds a texture whose texels another loader has written, and returns its number, that of an equal one if there is one.
    pub(crate) fn add_known(&mut self, facts: TextureFacts, set: Option<u32>) -> u32 {
        let number = self.textures.add_known(facts);
        if number as usize == self.set_of_texture.len() {
            self.set_of_texture.push(set);
        }
        number
    }

    /// Adds a photo that is no image of a source, and returns its number.
    pub(crate) fn add_picture(&mut self, texture: SceneTexture, set: u32) -> u32 {
        self.add(Arc::new(texture), Some(set))
    }

    /// Adds a texture that no source has, and returns its number.
    pub(crate) fn add_generated(&mut self, texture: Arc<SceneTexture>) -> u32 {
        self.add(texture, None)
    }

    /// A texture that equals an earlier one keeps the set of that.
    fn add(&mut self, texture: Arc<SceneTexture>, set: Option<u32>) -> u32 {
        let number = self.textures.add(texture);
        if number as usize == self.set_of_texture.len() {
            self.set_of_texture.push(set);
        }
        number
    }

    /// The sets by number.
    pub(crate) fn set_names(&self) -> Vec<String> {
        let mut names: Vec<_> = self.sets.iter().collect();
        names.sort_unstable_by_key(|(_, number)| **number);
        names.into_iter().map(|(name, _)| name.clone()).collect()
    }

    /// The texture's number; `None` if it cannot be loaded, with the reason in the report.
    pub(crate) fn load(&mut self, source: &CitySource<'_>, name: &str, report: &mut SourceReport) -> Option<u32> {
        let max_pixels = self.max_pixels;
        let name = name.replace('\\', "/");
        self.load_by(source, in_folder(source, &name), report, || find(source, &name, max_pixels))
    }

    /// As [`Self::load`], of an encoded image within the source with a name of its own.
    pub(crate) fn load_encoded(
        &mut self,
        source: &CitySource<'_>,
        name: &str,
        bytes: &[u8],
        report: &mut SourceReport,
    ) -> Option<u32> {
        let max_pixels = self.max_pixels;
        self.load_by(source, format!("{}#{name}", source.name), report, || decode(bytes.to_vec(), max_pixels))
    }

    /// As [`Self::load`], of decoded texels within the source.
    pub(crate) fn add_texels(
        &mut self,
        source: &CitySource<'_>,
        name: &str,
        [width, height]: [u32; 2],
        rgba: &[[u8; 4]],
        report: &mut SourceReport,
    ) -> Option<u32> {
        let is_whole = u64::from(width) * u64::from(height) == rgba.len() as u64 && !rgba.is_empty();
        self.load_by(source, format!("{}#{name}", source.name), report, || match is_whole {
            true => Ok(Decoded::new([width, height], rgba.iter().copied())),
            false => Err(TextureFault { kind: TEXTURE_BROKEN, detail: format!("{width} x {height} texels expected") }),
        })
    }

    fn load_by(
        &mut self,
        source: &CitySource<'_>,
        name: String,
        report: &mut SourceReport,
        find: impl FnOnce() -> Result<Decoded, TextureFault>,
    ) -> Option<u32> {
        let set = self.set_of(source);
        let loaded = match self.by_name.entry((source.files.location(), name.clone())) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(vacant) => {
                let found = find();
                report.textures += u64::from(found.is_ok());
                vacant.insert(found.map(|Decoded { texture, alpha }| {
                    let number = self.textures.add(Arc::new(texture));
                    if number as usize == self.set_of_texture.len() {
                        self.set_of_texture.push(Some(set));
                    }
                    if self.alpha.len() < MAX_ALPHA_GRIDS {
                        self.alpha.extend(alpha.map(|alpha| (number, alpha)));
                    }
                    number
                }))
            }
        };
        match loaded {
            Ok(number) => Some(*number),
            Err(fault) => {
                report.problem(fault.kind, || format!("{name}: {}", fault.detail));
                None
            }
        }
    }
}

/// Name of a file next to the source among the source's files.
fn in_folder(source: &CitySource<'_>, name: &str) -> String {
    match source.name.rsplit_once('/') {
        Some((folder, _)) => format!("{folder}/{name}"),
        None => name.to_owned(),
    }
}

/// Reads and decodes an image next to the source.
fn find(source: &CitySource<'_>, name: &str, max_pixels: u64) -> Result<Decoded, TextureFault> {
    if name.contains("://") {
        return Err(TextureFault {
            kind: TEXTURE_ON_THE_WEB,
            detail: "remote images are not fetched, put the image next to the file".to_owned(),
        });
    }
    let limit = max_pixels.saturating_mul(FILE_BYTES_PER_PIXEL).saturating_add(FILE_BYTES_BASE);
    let bare = name.rsplit('/').next().unwrap_or(name);
    let read = |name: &str| read_sibling(&*source.files, &in_folder(source, name), limit);
    // Files often have absolute paths of the machine that exported them. The image is then mostly next to the source.
    let bytes = read(name).or_else(|error| if bare == name { Err(error) } else { read(bare).map_err(|_| error) });
    let bytes = bytes.map_err(|error| {
        let kind = match error.kind() {
            ErrorKind::NotFound => TEXTURE_MISSING,
            ErrorKind::PermissionDenied if error.to_string() == OUTSIDE => TEXTURE_OUTSIDE,
            _ => TEXTURE_UNREADABLE,
        };
        TextureFault { kind, detail: error.to_string() }
    })?;
    decode(bytes, max_pixels)
}

/// Decodes an image if its header announces an acceptable size.
fn decode(bytes: Vec<u8>, max_pixels: u64) -> Result<Decoded, TextureFault> {
    let broken = |error: &dyn std::fmt::Display| TextureFault { kind: TEXTURE_BROKEN, detail: one_line(error) };
    let bytes = Cursor::new(bytes);
    let header = ImageReader::new(bytes.clone()).with_guessed_format().map_err(|error| broken(&error))?;
    let (width, height) = header.into_dimensions().map_err(|error| broken(&error))?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > max_pixels {
        let detail = format!("{width} x {height} pixels, more than the limit of {max_pixels} in all");
        return Err(TextureFault { kind: TEXTURE_TOO_LARGE, detail });
    }
    let mut reader = ImageReader::new(bytes).with_guessed_format().map_err(|error| broken(&error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_pixels.saturating_mul(FILE_BYTES_PER_PIXEL).saturating_add(FILE_BYTES_BASE));
    reader.limits(limits);
    let image = reader.decode().map_err(|error| broken(&error))?;
    if image.color().has_alpha() {
        return Ok(Decoded::new([width, height], image.into_rgba8().pixels().map(|pixel| pixel.0)));
    }
    let rgb = image.into_rgb8().pixels().map(|pixel| pixel.0).collect();
    Ok(Decoded { texture: SceneTexture { width, height, rgb, is_pattern: false }, alpha: None })
}

fn one_line(error: &dyn std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use insula_source::report::SourceFormat;
    use insula_source::source::embedded;

    /// Encodes a PNG of one colour.
    pub(crate) fn png(width: u32, height: u32, rgb: [u8; 3]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let pixels = image::RgbImage::from_pixel(width, height, image::Rgb(rgb));
        pixels.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    fn load(files: &[(&str, &[u8])], name: &str, max_pixels: u64) -> (Option<Arc<SceneTexture>>, SourceReport) {
        let sources = embedded(files);
        let mut report = SourceReport::new("a.obj", SourceFormat::Obj, 0);
        let mut loader = TextureLoader::new(max_pixels, TextureStore::in_memory());
        let number = loader.load(&sources[0], name, &mut report);
        (number.map(|number| loader.textures.get(number).unwrap()), report)
    }

    #[test]
    fn image_is_found_next_to_the_file_even_by_a_foreign_absolute_path() {
        let png = png(3, 2, [10, 20, 30]);
        let files: [(&str, &[u8]); 2] = [("a.obj", b""), ("wall.png", &png)];
        for name in ["wall.png", "C:\\export\\wall.png", "/export/wall.png"] {
            let (texture, report) = load(&files, name, 100);
            let texture = texture.unwrap();
            assert_eq!((texture.width, texture.height, texture.rgb[5]), (3, 2, [10, 20, 30]));
            assert_eq!((report.textures, report.problems.len()), (1, 0));
        }
    }

    #[test]
    fn missing_broken_oversized_and_remote_images_are_reported() {
        let png = png(3, 2, [10, 20, 30]);
        let cut = &png[..png.len() - 20];
        let files: [(&str, &[u8]); 4] =
            [("a.obj", b""), ("wall.png", &png), ("cut.png", cut), ("odd.jpg", b"no image")];
        let cases = [
            ("none.png", "texture missing"),
            ("cut.png", "texture broken"),
            ("odd.jpg", "texture broken"),
            ("wall.png", "texture too large"),
            ("https://example.org/wall.png", "texture on the web"),
        ];
        for (name, kind) in cases {
            // 5 pixels are one less than 3 x 2.
            let (texture, report) = load(&files, name, if name == "wall.png" { 5 } else { 100 });
            assert!(texture.is_none(), "{name}");
            assert_eq!((report.problems[kind].count, report.textures), (1, 0), "{name}");
        }
    }
}
