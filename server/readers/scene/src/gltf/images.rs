//! Images: files, or bytes within the document. KTX2 is decoded, the rest stays as it is.

use super::buffers::Buffers;
use super::fault::Fault;
use super::ktx2;
use super::schema::Root;
use super::uri::{self, Target};
use insula_source::object::SourceImage;
use std::collections::HashMap;

/// The images of a document, each loaded once.
pub(super) struct Images<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    /// Put in front of names.
    label: &'a str,
    loads_files: bool,
    known: HashMap<usize, Result<SourceImage, Fault>>,
}

impl<'a> Images<'a> {
    pub(super) fn new(root: &'a Root, buffers: &'a Buffers<'a>, label: &'a str, loads_files: bool) -> Self {
        Self { root, buffers, label, loads_files, known: HashMap::new() }
    }

    pub(super) fn get(&mut self, index: usize) -> Result<SourceImage, Fault> {
        if let Some(known) = self.known.get(&index) {
            return known.clone();
        }
        let image = self.load(index);
        self.known.insert(index, image.clone());
        image
    }

    fn load(&self, index: usize) -> Result<SourceImage, Fault> {
        let image = self.root.images.get(index).ok_or_else(|| Fault::missing("image", index))?;
        let name = format!("{}, image {index}", self.label);
        let Some(uri) = &image.uri else {
            let view =
                image.buffer_view.ok_or_else(|| Fault::new("image without content", format!("image {index}")))?;
            return self.convert(index, name, self.buffers.view(view)?);
        };
        match uri::resolve(uri, |bytes| self.buffers.budget().take_bytes(bytes))? {
            Target::Content(bytes) => self.convert(index, name, &bytes),
            Target::File(path) if !self.loads_files && !path.to_ascii_lowercase().ends_with(".ktx2") => {
                Ok(SourceImage::File(path))
            }
            Target::File(path) => {
                let bytes = self.buffers.file(&path)?;
                self.convert(index, name, &bytes)
            }
        }
    }

    fn convert(&self, index: usize, name: String, bytes: &[u8]) -> Result<SourceImage, Fault> {
        if ktx2::is_ktx2(bytes) {
            let texels = ktx2::decode(bytes, self.buffers.budget())?;
            return Ok(SourceImage::Texels {
                name,
                width: texels.width,
                height: texels.height,
                rgba: texels.rgba.into(),
            });
        }
        let is_webp = bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP");
        if !is_webp && !bytes.starts_with(b"\x89PNG") && !bytes.starts_with(b"\xff\xd8") {
            return Err(Fault::new(
                "image format is not supported",
                format!("image {index} is no PNG, JPEG, WebP or KTX2"),
            ));
        }
        self.buffers.budget().take_bytes(bytes.len() as u64)?;
        Ok(SourceImage::Encoded { name, bytes: bytes.into() })
    }
}
