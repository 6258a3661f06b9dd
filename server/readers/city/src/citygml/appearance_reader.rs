//! Reads the appearances of a file.

use super::appearance::Appearances;
use super::coordinates::numbers;
use super::names::Names;
use super::paths::relative_to;
use super::tree::{AttributeKind, Tree, hash_of_reference};
use super::tree_builder::{BuildContext, Built, build, start_tree};
use super::xml::{Event, XmlReader};
use insula_source::error::InputError;
use insula_source::object::{ObjectSink, SourceImage, SourceMaterial, SourceTexture, Wrap, png_cutoff};
use insula_source::problems::{TEXTURE_NOT_MAPPED, TEXTURE_ON_THE_WEB};
use memchr::memmem::Finder;

/// Bytes before a match of [`Scan`] in which the tag begins.
const TAG_BYTES: usize = 64;

/// Looks for elements with appearances in chunks of a file, without reading its XML.
pub(super) struct Scan {
    finder: Finder<'static>,
    /// The end of the last chunk.
    tail: Vec<u8>,
}

impl Scan {
    pub(super) fn new() -> Self {
        Self { finder: Finder::new("ppearance"), tail: Vec::new() }
    }

    /// Whether the file has such an element up to this chunk.
    pub(super) fn finds(&mut self, chunk: &[u8]) -> bool {
        // A tag may begin in the last chunk and end in this one.
        let seam = chunk.len().min(TAG_BYTES);
        self.tail.extend_from_slice(&chunk[..seam]);
        let found = self.finds_in(&self.tail) || self.finds_in(chunk);
        if seam == chunk.len() {
            let excess = self.tail.len().saturating_sub(2 * TAG_BYTES);
            self.tail.drain(..excess);
        } else {
            self.tail.clear();
            self.tail.extend_from_slice(&chunk[chunk.len() - TAG_BYTES..]);
        }
        found
    }

    fn finds_in(&self, bytes: &[u8]) -> bool {
        self.finder.find_iter(bytes).any(|start| is_tag_of_appearance(bytes, start))
    }
}

/// Whether the bytes from one before `start` are the local name `appearance`, `Appearance` or `appearanceMember` of a
/// tag.
fn is_tag_of_appearance(bytes: &[u8], start: usize) -> bool {
    let after = &bytes[start + "ppearance".len()..];
    let after = after.strip_prefix(b"Member").unwrap_or(after);
    let before = bytes[..start].strip_suffix(b"a").or_else(|| bytes[..start].strip_suffix(b"A"));
    let Some(before) =
        before.filter(|_| after.first().is_none_or(|byte| matches!(byte, b'>' | b'/') || byte.is_ascii_whitespace()))
    else {
        return false;
    };
    let is_prefix = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-' | b'.') || !byte.is_ascii();
    let before = match before.strip_suffix(b":") {
        Some(before) => &before[..before.iter().rposition(|byte| !is_prefix(byte)).map_or(0, |index| index + 1)],
        None => before,
    };
    before.last() == Some(&b'<')
}

pub(super) fn read_appearances(
    reader: &mut XmlReader<'_>,
    sink: &mut dyn ObjectSink,
    appearances: &mut Appearances,
) -> Result<(), InputError> {
    let (mut tree, mut theme, mut is_theme) = (Tree::default(), 0, false);
    let context = BuildContext { dimension: None, has_appearance: &|_| true };
    loop {
        let data = match reader.next()? {
            Event::Start { name, element, is_empty, .. } => {
                let local = element.local_name();
                is_theme = local.as_ref() == "theme" && !is_empty;
                if local.as_ref() == "Appearance" {
                    theme = appearances.theme("");
                }
                let is_data = matches!(local.as_ref(), "surfaceDataMember" | "surfaceData") && !is_empty;
                if is_data {
                    start_tree(&mut tree, name, &element);
                }
                is_data
            }
            Event::Text(text) if is_theme => {
                theme = appearances.theme(text.trim());
                is_theme = false;
                false
            }
            Event::EndOfFile => return Ok(()),
            _ => false,
        };
        if data {
            match build(reader, &mut tree, &context)? {
                Built::Complete => {
                    let mut data = SurfaceData { tree: &tree, names: &reader.names, theme, sink };
                    data.read(appearances);
                }
                _ => sink.problem("surface data too large", format!("byte {}", reader.position())),
            }
        }
    }
}

/// A texture or material with its targets.
struct SurfaceData<'d> {
    tree: &'d Tree,
    names: &'d Names,
    theme: u32,
    sink: &'d mut dyn ObjectSink,
}

impl SurfaceData<'_> {
    fn read(&mut self, appearances: &mut Appearances) {
        for data in self.tree.children(0) {
            let text_is = |local, expected| self.child_text(data, local).is_some_and(|text| text == expected);
            if text_is("isFront", "false") || text_is("isFront", "0") {
                continue;
            }
            match self.local(data) {
                "X3DMaterial" => self.read_material(appearances, data),
                "ParameterizedTexture" => self.read_texture(appearances, data),
                "GeoreferencedTexture" => self.problem(TEXTURE_NOT_MAPPED, "georeferenced", data),
                _ => {}
            }
        }
    }

    fn local(&self, node: u32) -> &str {
        self.names.local(self.tree.node(node).name)
    }

    fn child_text(&self, node: u32, local: &str) -> Option<&str> {
        self.tree.text_of(self.tree.child_named(self.names, node, local)?)
    }

    /// Reports a fault of a texture; `what` may be empty.
    fn problem(&mut self, kind: &'static str, what: &str, data: u32) {
        let id = self.tree.attribute(data, AttributeKind::Id).or_else(|| self.child_text(data, "imageURI"));
        let separator = if what.is_empty() { "" } else { ": " };
        let detail = format!("{}{separator}{what}", id.unwrap_or("appearance"));
        self.sink.problem(kind, detail);
    }

    fn read_material(&self, appearances: &mut Appearances, data: u32) {
        let colour = self.child_text(data, "diffuseColor").and_then(colour);
        let transparency = self.child_text(data, "transparency").and_then(|text| text.parse::<f32>().ok());
        let transparency = transparency.filter(|value| value.is_finite()).unwrap_or(0.0);
        let opacity = 1.0 - transparency.clamp(0.0, 1.0);
        if colour.is_none() && opacity >= 1.0 {
            return;
        }
        let material = appearances.add_material(SourceMaterial { rgb: colour, opacity, ..SourceMaterial::default() });
        for target in self.tree.children(data).filter(|child| self.local(*child) == "target") {
            if let Some(reference) = self.reference(target) {
                appearances.add_surface(self.theme, hash_of_reference(reference), material);
            }
        }
    }

    /// The reference that an element has as text or attribute.
    fn reference(&self, node: u32) -> Option<&str> {
        let kinds = [AttributeKind::Href, AttributeKind::Uri, AttributeKind::Ring];
        let of_attribute = || kinds.iter().find_map(|kind| self.tree.attribute(node, *kind));
        self.tree.text_of(node).or_else(of_attribute).filter(|reference| !reference.is_empty())
    }

    fn read_texture(&mut self, appearances: &mut Appearances, data: u32) {
        let Some(uri) = self.child_text(data, "imageURI").filter(|uri| !uri.is_empty()) else {
            return self.problem("texture without an image", "", data);
        };
        if uri.contains("://") && !uri.starts_with("file://") {
            return self.problem(TEXTURE_ON_THE_WEB, "", data);
        }
        let image = relative_to("", uri);
        let wrap = self.child_text(data, "wrapMode").map_or(Wrap::Repeat, Wrap::of_citygml);
        let alpha_cutoff = png_cutoff(&image);
        let texture = Some(SourceTexture { image: SourceImage::File(image), wrap });
        let material = appearances.add_material(SourceMaterial { texture, alpha_cutoff, ..SourceMaterial::default() });
        let (mut is_by_matrix, mut is_by_reference, mut is_full) = (false, false, false);
        for node in self.tree.subtree(data) {
            match self.local(node) {
                "TexCoordList" => is_full |= !self.read_coordinates(appearances, node, material),
                "TexCoordGen" => is_by_matrix = true,
                "target" => is_by_reference |= self.tree.attribute(node, AttributeKind::Href).is_some(),
                _ => {}
            }
        }
        for (is_so, kind, what) in [
            (is_by_matrix, TEXTURE_NOT_MAPPED, "texture coordinates by a matrix"),
            (is_by_reference, TEXTURE_NOT_MAPPED, "shared texture coordinates"),
            (is_full, "too many texture coordinates", ""),
        ] {
            if is_so {
                self.problem(kind, what, data);
            }
        }
    }

    /// Reads a list of texture coordinates: in CityGML 3.0 a `ring` follows each `textureCoordinates`, in older
    /// versions it is their attribute. Returns whether there was room for them.
    fn read_coordinates(&self, appearances: &mut Appearances, list: u32, material: u32) -> bool {
        let mut rings = self.tree.children(list).filter(|child| self.local(*child) == "ring");
        let mut has_room = true;
        for coordinates in self.tree.children(list).filter(|child| self.local(*child) == "textureCoordinates") {
            let ring = self.tree.attribute(coordinates, AttributeKind::Ring);
            let ring = ring.or_else(|| rings.next().and_then(|ring| self.reference(ring)));
            let (Some(ring), Some(text)) = (ring, self.tree.text_of(coordinates)) else { continue };
            let mut numbers = numbers(text).map(|number| number as f32);
            let uv = std::iter::from_fn(|| Some([numbers.next()?, numbers.next()?]));
            has_room &= appearances.add_ring(self.theme, hash_of_reference(ring), material, uv);
        }
        has_room
    }
}

/// A colour of three numbers from 0 to 1.
fn colour(text: &str) -> Option<[u8; 3]> {
    let mut parts = numbers(text).map(|part| part.is_finite().then(|| (part.clamp(0.0, 1.0) * 255.0).round() as u8));
    Some([parts.next()??, parts.next()??, parts.next()??])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scan_finds_tags_and_nothing_else() {
        let finds = |text: &str| Scan::new().finds(text.as_bytes());
        assert!(finds("<a><app:appearanceMember>"));
        assert!(finds("<appearance >"));
        assert!(finds("x<app:Appearance/>"));
        assert!(!finds("xmlns:app=\"http://www.opengis.net/citygml/appearance/2.0\""));
        assert!(!finds("<uro:appearanceSrcDesc>"));
        assert!(!finds("</app:appearance>"));
        assert!(!finds("the appearance of"));
    }

    #[test]
    fn scan_finds_tags_across_chunks() {
        let text = "x".repeat(100) + "<app:appearanceMember>" + &"y".repeat(100);
        for split in 0..text.len() {
            let mut scan = Scan::new();
            let (first, second) = text.as_bytes().split_at(split);
            let found = scan.finds(first);
            assert!(scan.finds(second) || found, "{split}");
        }
        let mut scan = Scan::new();
        assert!(text.as_bytes().chunks(1).any(|chunk| scan.finds(chunk)));
    }

    #[test]
    fn colours() {
        assert_eq!(colour("1 0.5 0"), Some([255, 128, 0]));
        assert_eq!(colour("1 0.5"), None);
        assert_eq!(colour("1 nan 0"), None);
    }
}
