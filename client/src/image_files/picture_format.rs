//! The formats of pictures, chosen by the extension of the file's name.

use super::PictureNotes;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use std::path::{Path, PathBuf};

/// Quality of JPEG files, of 100.
const JPEG_QUALITY: u8 = 92;

/// A format of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    /// Lossless.
    Png,
    /// With losses, at quality 92.
    Jpeg,
    /// Lossless.
    WebP,
}

impl PictureFormat {
    /// The format of a file's extension, in upper or lower case. Fails with the list of extensions if there is none.
    pub fn of(path: &Path) -> Result<Self, String> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match &*extension {
            "png" => Ok(Self::Png),
            "jpg" | "jpeg" => Ok(Self::Jpeg),
            "webp" => Ok(Self::WebP),
            _ => Err("expected a file name that ends in .png, .jpg, .jpeg or .webp".to_owned()),
        }
    }
}

/// Parses the path of a picture that is to be written, for the command line: fails before any work is done.
pub fn parse_picture_path(path: PathBuf) -> Result<PathBuf, String> {
    PictureFormat::of(&path).map(|_| path)
}

/// A file of the picture with its notes. Fails with the encoder's reason.
pub(super) fn encode(format: PictureFormat, image: &RgbImage, notes: &PictureNotes) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    match format {
        PictureFormat::Png => encode_png(image, notes, &mut bytes).map_err(|e| e.to_string())?,
        PictureFormat::Jpeg => {
            encode_with_exif(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY), image, notes)?;
        }
        PictureFormat::WebP => encode_with_exif(WebPEncoder::new_lossless(&mut bytes), image, notes)?,
    }
    Ok(bytes)
}

fn encode_png(image: &RgbImage, notes: &PictureNotes, out: &mut Vec<u8>) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(out, image.width(), image.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    for (keyword, text) in notes.texts() {
        // Fewer programs read the kind of chunk that holds more than Latin-1.
        if text.is_ascii() {
            encoder.add_text_chunk(keyword.to_owned(), text)?;
        } else {
            encoder.add_itxt_chunk(keyword.to_owned(), text)?;
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.as_raw())?;
    writer.finish()
}

fn encode_with_exif(mut encoder: impl ImageEncoder, image: &RgbImage, notes: &PictureNotes) -> Result<(), String> {
    if let Some(exif) = notes.exif() {
        encoder.set_exif_metadata(exif).map_err(|e| e.to_string())?;
    }
    encoder.write_image(image, image.width(), image.height(), ExtendedColorType::Rgb8).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::ImageFormat;

    fn notes() -> PictureNotes {
        PictureNotes {
            title: "千葉 Chiba".into(),
            credits: vec![],
            licences: vec!["CC BY 4.0".into()],
            copyright: "国土交通省 Project PLATEAU (CC BY 4.0)".into(),
            link: Some("insula://h/v1/cities/chiba?camera=1,2,3,4,5,60".into()),
            has_caption: false,
            legend: None,
        }
    }

    #[test]
    fn a_file_has_the_format_of_its_extension_or_is_refused() {
        let image = RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8 * 6, y as u8 * 8, 77]));
        for (name, expected) in [
            ("a.png", ImageFormat::Png),
            ("A.PNG", ImageFormat::Png),
            ("b.jpg", ImageFormat::Jpeg),
            ("b.x.JPEG", ImageFormat::Jpeg),
            ("c.webp", ImageFormat::WebP),
        ] {
            let path = parse_picture_path(name.into()).unwrap();
            for notes in [PictureNotes::default(), notes()] {
                let bytes = encode(PictureFormat::of(&path).unwrap(), &image, &notes).unwrap();
                assert_eq!(image::guess_format(&bytes).unwrap(), expected, "{name}");
                let decoded = image::load_from_memory(&bytes).unwrap().into_rgb8();
                assert_eq!(decoded.dimensions(), (40, 30));
                assert!(expected == ImageFormat::Jpeg || decoded == image, "{name}");
            }
        }
        for refused in ["a", "a.tiff", "png", ".png", "a.png/b", "a.png.", ""] {
            let error = parse_picture_path(refused.into()).unwrap_err();
            assert!([".png", ".jpg", ".jpeg", ".webp"].iter().all(|known| error.contains(known)), "{refused}: {error}");
        }
    }

    #[test]
    fn png_files_keep_the_notes_as_text() {
        let bytes = encode(PictureFormat::Png, &RgbImage::new(3, 2), &notes()).unwrap();
        let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let info = reader.info();
        let mut texts: Vec<(String, String)> = info
            .uncompressed_latin1_text
            .iter()
            .map(|chunk| (chunk.keyword.clone(), chunk.text.clone()))
            .chain(info.utf8_text.iter().map(|chunk| (chunk.keyword.clone(), chunk.get_text().unwrap())))
            .collect();
        texts.sort();
        let mut expected: Vec<(String, String)> = notes().texts().map(|(key, text)| (key.to_owned(), text)).collect();
        expected.sort();
        assert_eq!(texts, expected);
        assert!(expected.iter().any(|(key, text)| key == "Copyright" && text.contains("国土交通省")));
        assert!(expected.iter().any(|(key, text)| key == "Link" && text.starts_with("insula://")));
    }

    #[test]
    fn jpeg_and_webp_files_name_title_link_and_copyright() {
        for format in [PictureFormat::Jpeg, PictureFormat::WebP] {
            let bytes = encode(format, &RgbImage::new(16, 16), &notes()).unwrap();
            for text in ["千葉 Chiba", "国土交通省", "CC BY 4.0", "insula://h/v1/cities/chiba?camera=1,2,3,4,5,60"]
            {
                let found = bytes.windows(text.len()).any(|window| window == text.as_bytes());
                assert!(found, "{format:?}: {text}");
            }
        }
    }
}
