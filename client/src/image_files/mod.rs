//! Image files of a rendered frame: PNG, JPEG or WebP for colours, PFM for distances and radiances.

mod caption;
mod legend;
mod picture_format;

use crate::error::{ClientError, Result};
use image::{ImageFormat, RgbImage, RgbaImage};
use insula_archive::new_file::replace;
use insula_command_line::output::FileKind;
use insula_objects::color::Legend;
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::tone::decode_radiance;
pub use picture_format::{PictureFormat, parse_picture_path};
use std::io::Cursor;
use std::path::Path;

/// Writes the colours as PNG without a caption or notes, whatever the extension of `path`. For measurements. Fails if the file
/// cannot be written.
pub fn write_png(path: &Path, pixels: &Pixels) -> Result<()> {
    write_encoded(path, picture_format::encode(PictureFormat::Png, &rgb_image(path, pixels)?, &PictureNotes::default()))
}

/// Writes the colours in the format of `path`'s extension, with `notes` in the file and, if it is to have one, their caption in
/// the lower right corner. Fails if the extension is not that of a format, or if the file cannot be written.
pub fn write_picture(path: &Path, pixels: &Pixels, notes: &PictureNotes) -> Result<()> {
    let format = PictureFormat::of(path).map_err(ClientError::Usage)?;
    let mut image = rgb_image(path, pixels)?;
    if let Some(legend) = &notes.legend {
        legend::draw_legend(&mut image, legend);
    }
    if notes.has_caption {
        caption::draw_caption(&mut image, &notes.credits);
    }
    write_encoded(path, picture_format::encode(format, &image, notes))
}

fn write_encoded(path: &Path, encoded: Result<Vec<u8>, String>) -> Result<()> {
    let bytes = encoded.map_err(|e| cannot_write(path, &e))?;
    replace(path, &bytes).map_err(|e| cannot_write(path, &e))
}

fn cannot_write(path: &Path, reason: &dyn std::fmt::Display) -> ClientError {
    ClientError::Failed(format!("cannot write {}: {reason}: choose another path", path.display()))
}

fn rgb_image(path: &Path, pixels: &Pixels) -> Result<RgbImage> {
    let rgb = pixels.colour.iter().flat_map(|c| [*c as u8, (*c >> 8) as u8, (*c >> 16) as u8]).collect();
    let image = RgbImage::from_raw(pixels.width_px, pixels.height_px, rgb);
    image.ok_or_else(|| cannot_write(path, &"the frame has fewer pixels than its size says"))
}

/// Encodes the distances in metres as little-endian PFM: `Pf`, size, -1.0, then rows from bottom to top.
pub fn encode_pfm(pixels: &Pixels) -> Vec<u8> {
    let mut out = format!("Pf\n{} {}\n-1.0\n", pixels.width_px, pixels.height_px).into_bytes();
    let rows = pixels.distance.chunks_exact(pixels.width_px.max(1) as usize);
    for distance in rows.rev().flatten() {
        out.extend_from_slice(&distance.to_le_bytes());
    }
    out
}

/// Writes the radiances as little-endian colour PFM: `PF`, size, -1.0, then rows from bottom to top. Fails if the frame is not
/// lit or the file cannot be written.
pub fn write_radiance(path: &Path, pixels: &Pixels) -> Result<()> {
    if pixels.radiance.is_empty() {
        return Err(ClientError::Failed("only lit frames have light: use --radiance with --shading lit".into()));
    }
    let mut out = format!("PF\n{} {}\n-1.0\n", pixels.width_px, pixels.height_px).into_bytes();
    for word in pixels.radiance.chunks_exact(pixels.width_px.max(1) as usize).rev().flatten() {
        for component in decode_radiance(*word).to_array() {
            out.extend_from_slice(&component.to_le_bytes());
        }
    }
    replace(path, &out).map_err(ClientError::file(path))
}

/// Writes the number of each pixel's object, row by row from the top: a little-endian u32 a pixel, 4,294,967,295 where there is none. A
/// file that ends in `.png` gets the same bytes as red, green, blue and alpha. Fails if the file cannot be written.
pub fn write_objects(path: &Path, [width, height]: [u32; 2], objects: &[u32]) -> Result<()> {
    let bytes: Vec<u8> = objects.iter().flat_map(|object| object.to_le_bytes()).collect();
    if !is_png(path) {
        return replace(path, &bytes).map_err(ClientError::file(path));
    }
    let image = RgbaImage::from_raw(width, height, bytes);
    let image = image.ok_or_else(|| cannot_write(path, &"the frame has fewer pixels than its size says"))?;
    let mut png = Cursor::new(Vec::new());
    image.write_to(&mut png, ImageFormat::Png).map_err(|error| cannot_write(path, &error))?;
    replace(path, png.get_ref()).map_err(ClientError::file(path))
}

/// Whether a file of objects is a picture.
fn is_png(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
}

/// What a picture has that [`write_picture`] writes to this path.
pub fn picture_kind(path: &Path) -> FileKind {
    match PictureFormat::of(path) {
        Ok(PictureFormat::Jpeg) => FileKind::JPEG,
        Ok(PictureFormat::WebP) => FileKind::WEBP,
        _ => FileKind::PNG,
    }
}

/// What a file has that [`write_objects`] writes to this path.
pub fn objects_kind(path: &Path) -> FileKind {
    if is_png(path) { FileKind::PNG } else { FileKind::Unmarked("known to be an earlier one") }
}

/// Writes the distances as PFM. Fails if the file cannot be written.
pub fn write_pfm(path: &Path, pixels: &Pixels) -> Result<()> {
    replace(path, &encode_pfm(pixels)).map_err(ClientError::file(path))
}

/// Notes in a picture's file. They come from a manifest, so they are made printable.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PictureNotes {
    /// The city's name for people.
    pub title: String,
    /// Sources, each with its licence, one line each: the caption.
    pub credits: Vec<Attribution>,
    /// Licences, without repetitions.
    pub licences: Vec<String>,
    /// Sources with licences and addresses, in one line.
    pub copyright: String,
    /// Link to the view (`insula://...`), unless the city is on this machine only.
    pub link: Option<String>,
    /// Whether the sources are drawn in a corner of the picture.
    pub has_caption: bool,
    /// Colours of objects, drawn in another corner.
    pub legend: Option<Legend>,
}

impl PictureNotes {
    /// Notes of a picture of the manifest's city.
    pub fn new(manifest: &Manifest, link: Option<String>, has_caption: bool) -> Self {
        let clean = |text: &String| printable(text).into_owned();
        let credits: Vec<Attribution> = manifest
            .attribution
            .iter()
            .map(|source| Attribution {
                text: clean(&source.text),
                licence: source.licence.as_ref().map(clean),
                url: source.url.as_ref().map(clean),
            })
            .collect();
        let mut licences: Vec<String> = credits.iter().filter_map(|source| source.licence.clone()).collect();
        licences.sort();
        licences.dedup();
        let full = |source: &Attribution| source.texts().cloned().collect::<Vec<_>>().join(", ");
        let copyright = printable(&credits.iter().map(full).collect::<Vec<_>>().join("; ")).into_owned();
        Self { title: clean(&manifest.title), credits, licences, copyright, link, has_caption, legend: None }
    }

    /// Keywords and texts, without empty ones.
    fn texts(&self) -> impl Iterator<Item = (&'static str, String)> {
        let texts = [
            ("Title", self.title.clone()),
            ("Copyright", self.copyright.clone()),
            ("Licence", self.licences.join(", ")),
            ("Link", self.link.clone().unwrap_or_default()),
        ];
        texts.into_iter().filter(|(_, text)| !text.is_empty())
    }

    /// The notes as an EXIF block: title and link as the image's description, sources as its copyright. `None` if all are empty.
    fn exif(&self) -> Option<Vec<u8>> {
        const DESCRIPTION: u16 = 0x010e;
        const COPYRIGHT: u16 = 0x8298;
        let separator = if self.title.is_empty() || self.link.is_none() { "" } else { ", " };
        let description = format!("{}{separator}{}", self.title, self.link.as_deref().unwrap_or_default());
        let fields = [(DESCRIPTION, &description), (COPYRIGHT, &self.copyright)];
        let fields: Vec<(u16, &String)> = fields.into_iter().filter(|(_, text)| !text.is_empty()).collect();
        (!fields.is_empty()).then(|| encode_exif(&fields))
    }
}

/// A little-endian TIFF header with one directory of texts. Tags must be in ascending order.
fn encode_exif(fields: &[(u16, &String)]) -> Vec<u8> {
    const TEXT: u16 = 2;
    const HEADER_BYTES: usize = 8;
    let mut out = b"II\x2a\0\x08\0\0\0".to_vec();
    let mut values = Vec::new();
    let values_at = HEADER_BYTES + 2 + fields.len() * 12 + 4;
    out.extend_from_slice(&(fields.len() as u16).to_le_bytes());
    for (tag, text) in fields {
        // Up to four bytes lie in the directory itself, so a shorter text is filled up.
        let mut value = text.as_bytes().to_vec();
        value.resize((value.len() + 1).max(5), 0);
        out.extend_from_slice(&tag.to_le_bytes());
        out.extend_from_slice(&TEXT.to_le_bytes());
        out.extend_from_slice(&(value.len() as u32).to_le_bytes());
        out.extend_from_slice(&((values_at + values.len()) as u32).to_le_bytes());
        values.append(&mut value);
    }
    out.extend_from_slice(&[0; 4]);
    out.append(&mut values);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_rows_go_from_bottom_to_top() {
        let distance = vec![1.0, 2.0, 3.0, f32::INFINITY];
        let pixels = Pixels { width_px: 2, height_px: 2, colour: vec![0; 4], distance, ..Pixels::default() };
        let bytes = encode_pfm(&pixels);
        let (head, body) = bytes.split_at(bytes.len() - 16);
        assert_eq!(head, b"Pf\n2 2\n-1.0\n");
        let values: Vec<f32> = body.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(values, [3.0, f32::INFINITY, 1.0, 2.0]);
    }

    #[test]
    fn notes_repeat_no_licence_and_hold_no_control_character() {
        let mut manifest = insula_test_support::small_city::empty_manifest(0);
        let source = |text: &str, url: Option<&str>| Attribution {
            text: text.into(),
            licence: Some("CC BY 4.0".into()),
            url: url.map(str::to_owned),
        };
        manifest.attribution = vec![source("3DBAG\u{1b}[2J", Some("https://3dbag.nl")), source("PDOK", None)];
        let notes = PictureNotes::new(&manifest, None, true);
        assert_eq!(notes.licences, ["CC BY 4.0"]);
        assert_eq!(notes.copyright, "3DBAG\\u{1b}[2J, CC BY 4.0, https://3dbag.nl; PDOK, CC BY 4.0");
        assert!(notes.texts().all(|(key, text)| key != "Link" && !text.contains('\u{1b}')));
    }

    #[test]
    fn exif_texts_lie_where_their_fields_say() {
        let (a, b) = ("x".to_owned(), "sources".to_owned());
        let block = encode_exif(&[(0x010e, &a), (0x8298, &b)]);
        let word = |at: usize| u32::from_le_bytes(block[at..at + 4].try_into().unwrap()) as usize;
        for (field, text) in [(10, "x\0\0\0\0"), (22, "sources\0")] {
            let (len, at) = (word(field + 4), word(field + 8));
            assert_eq!(&block[at..at + len], text.as_bytes());
        }
        assert_eq!(PictureNotes::default().exif(), None);
    }
}
