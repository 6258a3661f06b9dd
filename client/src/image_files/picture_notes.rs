//! What a saved picture says about itself: title, sources, licences, link to its view.

use insula_objects::color::Legend;
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use insula_protocol::text::printable;

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
    pub(super) fn texts(&self) -> impl Iterator<Item = (&'static str, String)> {
        let texts = [
            ("Title", self.title.clone()),
            ("Copyright", self.copyright.clone()),
            ("Licence", self.licences.join(", ")),
            ("Link", self.link.clone().unwrap_or_default()),
        ];
        texts.into_iter().filter(|(_, text)| !text.is_empty())
    }

    /// The notes as an EXIF block: title and link as the image's description, sources as its copyright. `None` if all are empty.
    pub(super) fn exif(&self) -> Option<Vec<u8>> {
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
