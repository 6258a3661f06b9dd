//! The looks that an office gives its pages: name, logo, colour, imprint and first views.

use super::{SITE_TITLE, escape_html};
use crate::config::SiteConfig;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use insula_archive::file::read_limited;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Largest logo in bytes: it is part of each page.
const MAX_LOGO_BYTES: u64 = 48 << 10;

/// A site's looks, ready for pages.
#[derive(Debug, Clone, Default)]
pub(crate) struct Brand {
    site: SiteConfig,
    /// The logo as a `data:` address.
    logo: Option<String>,
    /// The folders of proposals, by city.
    proposals: BTreeMap<String, PathBuf>,
}

impl Brand {
    /// Reads the logo, and looks which cities have proposals: a folder that cannot be read is a warning. Fails if the logo cannot be read, is
    /// too large, or is no picture.
    pub(crate) fn load(site: &SiteConfig) -> io::Result<Self> {
        let read = |path: &std::path::PathBuf| {
            let bytes = read_limited(path, MAX_LOGO_BYTES)?;
            let media = media_of(&bytes).ok_or_else(|| io::Error::other("not an SVG, PNG, JPEG or WebP file"))?;
            Ok::<_, io::Error>(format!("data:{media};base64,{}", STANDARD.encode(&bytes)))
        };
        let logo = site.logo.as_ref().map(read).transpose()?;
        let proposals = site.proposals.as_deref().map(folders_in).transpose().unwrap_or_else(|error| {
            let folder = site.proposals.as_deref().unwrap_or(Path::new("")).display();
            tracing::warn!(%folder, %error, "cannot read the folder of site.proposals: no page shows proposals");
            None
        });
        Ok(Self { logo, site: site.clone(), proposals: proposals.unwrap_or_default() })
    }

    /// The folder of a city's proposals, if it has some.
    pub(crate) fn proposals_of(&self, city: &str) -> Option<&Path> {
        self.proposals.get(city).map(PathBuf::as_path)
    }

    pub(crate) fn title(&self) -> &str {
        if self.site.title.is_empty() { SITE_TITLE } else { &self.site.title }
    }

    /// The cities that have a first view.
    pub(crate) fn start_cities(&self) -> impl Iterator<Item = &str> {
        self.site.cities()
    }

    /// The camera with which the page of a city begins.
    pub(super) fn start_of(&self, city: &str) -> Option<&str> {
        self.site.start_of(city)
    }

    pub(super) fn logo(&self) -> Option<&str> {
        self.logo.as_deref()
    }

    pub(super) fn imprint(&self) -> Option<&str> {
        Some(self.site.imprint.as_str()).filter(|imprint| !imprint.is_empty())
    }

    /// Adds what the viewer's page shows of it.
    pub(super) fn push_meta(&self, out: &mut String) {
        let accent = Some(self.site.accent.as_str()).filter(|accent| !accent.is_empty());
        for (name, content) in [("logo", self.logo()), ("accent", accent), ("imprint", self.imprint())] {
            if let Some(content) = content {
                let _ = write!(out, "<meta name=\"insula-{name}\" content=\"{}\">", escape_html(content));
            }
        }
    }
}

fn folders_in(folder: &Path) -> io::Result<BTreeMap<String, PathBuf>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.path().is_dir() {
            found.insert(entry.file_name().to_string_lossy().into_owned(), entry.path());
        }
    }
    Ok(found)
}

/// The media type of a picture by its first bytes. Of SVG, browsers run no scripts in pictures.
fn media_of(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some("image/png"),
        [0xff, 0xd8, 0xff, ..] => Some("image/jpeg"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("image/webp"),
        _ => std::str::from_utf8(bytes).ok().filter(|text| text.contains("<svg")).map(|_| "image/svg+xml"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logo_is_a_small_picture() {
        let folder = tempfile::tempdir().unwrap();
        let load = |bytes: &[u8]| {
            let path = folder.path().join("logo");
            std::fs::write(&path, bytes).unwrap();
            Brand::load(&SiteConfig { logo: Some(path), ..SiteConfig::default() })
        };
        assert_eq!(load(b"<svg/>").unwrap().logo(), Some("data:image/svg+xml;base64,PHN2Zy8+"));
        assert!(load(b"\x89PNG\r\n").unwrap().logo().unwrap().starts_with("data:image/png;"));
        assert!(load(b"<html>").is_err() && load(&[b' '; MAX_LOGO_BYTES as usize + 1]).is_err());
        assert!(Brand::load(&SiteConfig::default()).unwrap().logo().is_none());
    }
}
