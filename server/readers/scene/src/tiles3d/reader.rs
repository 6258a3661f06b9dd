//! Walks through the tree of a tileset and takes the finest contents.

use super::container::first_character;
use super::files::TileFiles;
use super::tile::{Tile, UpAxis};
use super::tileset::{ContentJson, TileJson, TilesetJson};
use super::volume::Volume;
use super::{kind, uri};
use crate::gltf::GltfScene;
use glam::DMat4;
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::json::attributes::flatten;
use insula_source::object::ObjectSink;
use insula_source::problems::{TILE_NOT_FETCHED, TILE_NOT_READ, TILE_UNREADABLE};
use std::collections::{BTreeSet, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::rc::Rc;

/// Tilesets with more tiles are refused.
const MAX_TILES: u64 = 1 << 25;
/// Tilesets of which more tiles cannot be read, and ten times more than can, are given up.
const MAX_FAULTS: u64 = 10_000;
/// External tilesets are nested at most this deep.
const MAX_TILESET_DEPTH: usize = 64;
/// External tilesets, subtrees and contents of implicit tiles may be read again this often, all together: they differ from
/// tile to tile, and a small file that names itself again would be read without end.
const MAX_REPEATS: u64 = 1000;
/// Explicit tiles may share contents, as those of trees do, but not for more bytes in all than this many times what one file may have.
const REPEATED_SIZES: u64 = 4;
/// Names that are kept to find such files; further ones count as new.
const MAX_SEEN: usize = 1 << 20;
/// As many tiles does an external tileset count, because it costs as much time.
const TILES_OF_TILESET: u64 = 32;
/// Tiles are nested at most this deep, over all external tilesets.
const MAX_TILE_DEPTH: u32 = 384;
/// Bytes of a content that tell whether it is an external tileset.
const SNIFFED_BYTES: u64 = 4096;

/// Where the objects of a tileset are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// Positions are geocentric.
    Globe,
    /// Positions are metres around a place that the tileset does not tell.
    Unknown,
}

/// Why a content is not read.
#[derive(Debug)]
pub(super) enum ContentFault {
    /// The content is faulty; others are read on.
    Tile(InputError),
    /// The whole run ends.
    End(InputError),
}

impl ContentFault {
    pub(super) fn tile(name: &str, what: impl Into<String>) -> Self {
        Self::Tile(InputError::damaged(name, "tile", what))
    }

    pub(super) fn unsupported(name: &str, what: &'static str) -> Self {
        Self::Tile(InputError::unsupported(name, what))
    }

    pub(super) fn into_error(self) -> InputError {
        match self {
            Self::Tile(error) | Self::End(error) => error,
        }
    }
}

/// What children take from their parent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parent {
    pub(super) transform: DMat4,
    pub(super) adds: bool,
    pub(super) depth: u32,
}

/// A tileset whose tiles are visited.
#[derive(Debug, Clone, Copy)]
pub(super) struct OpenTileset<'t> {
    pub(super) name: &'t str,
    pub(super) json: &'t TilesetJson,
}

/// Reads tiles and passes on their objects.
pub(super) struct TileReader<'a, 's> {
    pub(super) files: TileFiles<'a>,
    pub(super) sink: &'s mut dyn ObjectSink,
    /// Where the first object was.
    pub(super) place: Option<Place>,
    pub(super) copyrights: BTreeSet<String>,
    /// The last glTF that an i3dm named, with its name.
    pub(super) shared_scene: Option<(String, Rc<GltfScene>)>,
    tiles: u64,
    contents: u64,
    faults: u64,
    /// Names of external tilesets, and of subtrees and contents of implicit tiles.
    seen: HashSet<String>,
    repeats: u64,
    /// Hashes of the names of the contents of all tiles, and the bytes of those that were read again.
    contents_seen: HashSet<u64>,
    repeated_bytes: u64,
    /// Names of the tilesets that are open, from the root.
    open: Vec<String>,
}

impl<'a, 's> TileReader<'a, 's> {
    pub(super) fn new(files: TileFiles<'a>, sink: &'s mut dyn ObjectSink) -> Self {
        let (place, copyrights, shared_scene) = (None, BTreeSet::new(), None);
        let (tiles, contents, faults, repeats) = (0, 0, 0, 0);
        let (seen, contents_seen, repeated_bytes, open) = (HashSet::new(), HashSet::new(), 0, Vec::new());
        Self {
            files,
            sink,
            place,
            copyrights,
            shared_scene,
            tiles,
            contents,
            faults,
            seen,
            repeats,
            contents_seen,
            repeated_bytes,
            open,
        }
    }

    /// Reads a tileset and everything below. Returns whether it has contents. Fails only if the whole run must end; a
    /// tileset that cannot be read is the error inside.
    pub(super) fn read_tileset(&mut self, name: &str, parent: Parent) -> Result<Result<bool, InputError>, InputError> {
        let label = if self.open.is_empty() { self.files.input.label.to_owned() } else { name.to_owned() };
        let text = match self.files.read(name) {
            Ok(text) => text,
            Err(cause) => return Ok(Err(InputError::io(&label, cause))),
        };
        let json = match TilesetJson::parse(&label, &text) {
            Ok(json) => json,
            Err(error) => return Ok(Err(error)),
        };
        drop(text);
        self.sink.tick(self.files.bytes_read());
        if let Some(text) = json.asset.as_ref().and_then(|asset| asset.copyright.as_deref()) {
            self.note_copyright(text);
        }
        self.open.push(name.to_owned());
        let has_content = self.visit(OpenTileset { name, json: &json }, &json.root, parent);
        self.open.pop();
        has_content.map(Ok)
    }

    /// Visits a tile and everything below, the children first. Returns whether there was content.
    ///
    /// The rule: of a tile that replaces (`refine` is `REPLACE`), the content is taken only if nothing below it has content:
    /// the finest content of each branch wins, and a branch without content below stays empty, as in viewers. Of a tile that
    /// adds, all contents are taken. Tiles outside of the wanted part count as if they had content.
    fn visit(&mut self, tileset: OpenTileset<'_>, tile: &TileJson, parent: Parent) -> Result<bool, InputError> {
        self.count_tile()?;
        let Some(own) = self.own_state(tileset, tile, parent) else { return Ok(false) };
        let volume = tile.bounding_volume.as_ref().and_then(Volume::new);
        if let (Some(volume), Some(bbox)) = (&volume, self.files.input.bbox_deg)
            && volume.is_outside(&own.transform, bbox)
        {
            return Ok(true);
        }
        if tile.implicit().is_some() {
            return self.visit_implicit(tileset, tile, own, volume);
        }
        let mut has_content = false;
        for child in tile.children.iter().flatten() {
            has_content |= self.visit(tileset, child, own)?;
        }
        if has_content && !own.adds {
            return Ok(true);
        }
        for content in tile.contents() {
            let Some(uri) = &content.uri else { continue };
            let attributes = attributes_of(tileset.json, tile, content);
            has_content |= self.read_content(tileset, uri, attributes, own)?;
        }
        Ok(has_content)
    }

    /// The tile's transform and refinement. `None` if the tile cannot be read, which is reported.
    fn own_state(&mut self, tileset: OpenTileset<'_>, tile: &TileJson, parent: Parent) -> Option<Parent> {
        let mut transform = parent.transform;
        if let Some(numbers) = &tile.transform {
            let numbers = <&[f64; 16]>::try_from(numbers.as_slice()).ok();
            let Some(own) = numbers.map(DMat4::from_cols_array).filter(DMat4::is_finite) else {
                self.sink.skip("transform of a tile is malformed", format!("{}: tile {}", tileset.name, self.tiles));
                return None;
            };
            transform *= own;
        }
        if parent.depth >= MAX_TILE_DEPTH {
            self.sink.skip("tiles are nested too deeply", format!("{}: tile {}", tileset.name, self.tiles));
            return None;
        }
        let adds = match tile.refine.as_deref() {
            Some(refine) if refine.eq_ignore_ascii_case("ADD") => true,
            Some(refine) if refine.eq_ignore_ascii_case("REPLACE") => false,
            _ => parent.adds,
        };
        Some(Parent { transform, adds, depth: parent.depth + 1 })
    }

    /// Counts a visited tile. Fails beyond the limit.
    pub(super) fn count_tile(&mut self) -> Result<(), InputError> {
        self.tiles += 1;
        if self.tiles > MAX_TILES {
            let path = self.files.input.label.to_owned();
            return Err(InputError::TooLarge { path, what: "its number of tiles".to_owned(), limit: MAX_TILES });
        }
        Ok(())
    }

    /// Notes a file that should be read once. Fails if too many are read again.
    pub(super) fn count_file(&mut self, name: &str) -> Result<(), InputError> {
        if self.seen.contains(name) {
            self.repeats += 1;
        } else if self.seen.len() < MAX_SEEN {
            self.seen.insert(name.to_owned());
        }
        if self.repeats > MAX_REPEATS {
            let path = self.files.input.label.to_owned();
            let what = format!("the number of tiles that share a tileset, a subtree or a content such as {name}");
            return Err(InputError::TooLarge { path, what, limit: MAX_REPEATS });
        }
        Ok(())
    }

    /// Notes a content and its bytes. Fails if those that are read again have too many.
    fn count_content(&mut self, name: &str, bytes: u64) -> Result<(), InputError> {
        let mut hasher = DefaultHasher::new();
        name.hash(&mut hasher);
        let hash = hasher.finish();
        if self.contents_seen.contains(&hash) {
            self.repeated_bytes = self.repeated_bytes.saturating_add(bytes);
        } else if self.contents_seen.len() < MAX_SEEN {
            self.contents_seen.insert(hash);
        }
        let limit = self.files.input.max_bytes.saturating_mul(REPEATED_SIZES);
        if self.repeated_bytes > limit {
            let path = self.files.input.label.to_owned();
            let what = format!("the bytes of contents that tiles share, such as {name}");
            return Err(InputError::TooLarge { path, what, limit });
        }
        Ok(())
    }

    /// Reads a content, which may be an external tileset. Returns whether it has objects. Fails only if the run must end.
    pub(super) fn read_content(
        &mut self,
        tileset: OpenTileset<'_>,
        uri: &str,
        attributes: Attributes,
        own: Parent,
    ) -> Result<bool, InputError> {
        let up = tileset.json.asset.as_ref().and_then(|asset| asset.gltf_up_axis.as_deref());
        let mut tile =
            Tile { name: String::new(), transform: own.transform, up: UpAxis::new(up), attributes, kind: None };
        let bytes = if let Some(data) = uri::data_of(uri) {
            // The name looks like a file beside the tileset, for URIs within the content.
            tile.name = format!("{}#tile{}", tileset.name, self.tiles);
            data.map_err(str::to_owned)
        } else {
            match uri::resolve(uri::folder_of(tileset.name), uri, self.files.is_remote) {
                Ok(name) => tile.name = name,
                Err(reason) => {
                    self.sink.skip(TILE_NOT_FETCHED, format!("{}: {uri}: {reason}", tileset.name));
                    return Ok(false);
                }
            }
            if self.is_tileset(&tile.name) {
                return self.read_external(&tile.name, own);
            }
            let read = self.files.read(&tile.name).map_err(|error| error.to_string());
            if let Ok(bytes) = &read {
                self.count_content(&tile.name, bytes.len() as u64)?;
            }
            read
        };
        let root = self.open.first().map_or("", |root| uri::folder_of(root));
        tile.kind = kind::kind_of_name(tile.name.strip_prefix(root).unwrap_or(&tile.name));
        let added = match bytes {
            Ok(bytes) => self.add_content(&tile, &bytes, 0),
            Err(what) => Err(ContentFault::tile(&tile.name, what)),
        };
        self.sink.tick(self.files.bytes_read());
        match added {
            Ok(count) => {
                self.contents += 1;
                Ok(count > 0)
            }
            Err(fault) => self.skip_content(&tile.name, fault).map(|()| false).map_err(ContentFault::into_error),
        }
    }

    /// Reads an external tileset. Returns whether it has contents.
    fn read_external(&mut self, name: &str, own: Parent) -> Result<bool, InputError> {
        if self.open.iter().any(|open| open == name) {
            self.sink.skip("external tileset contains itself", name.to_owned());
            return Ok(false);
        }
        if self.open.len() >= MAX_TILESET_DEPTH {
            self.sink.skip("external tilesets are nested too deeply", name.to_owned());
            return Ok(false);
        }
        self.count_file(name)?;
        self.tiles += TILES_OF_TILESET;
        match self.read_tileset(name, own)? {
            Ok(has_content) => Ok(has_content),
            Err(error) => {
                self.skip_content(name, ContentFault::Tile(error)).map(|()| false).map_err(ContentFault::into_error)
            }
        }
    }

    /// Reports a content that is left out. Fails if the run must end.
    pub(super) fn skip_content(&mut self, name: &str, fault: ContentFault) -> Result<(), ContentFault> {
        let error = match fault {
            ContentFault::Tile(error) => error,
            end => return Err(end),
        };
        let (reason, detail) = match error {
            InputError::Unsupported { what, .. } => (TILE_NOT_READ, what),
            InputError::Damaged { what, .. } => (TILE_UNREADABLE, what),
            error => (TILE_UNREADABLE, error.to_string()),
        };
        self.sink.skip(reason, format!("{name}: {detail}"));
        self.faults += 1;
        if self.faults > MAX_FAULTS.max(10 * self.contents) {
            let what = format!("{} tiles cannot be read", self.faults);
            return Err(ContentFault::End(InputError::damaged(self.files.input.label, "tiles", what)));
        }
        Ok(())
    }

    /// Whether a content is an external tileset: by its name, or by its first bytes if the name has no known extension.
    fn is_tileset(&self, name: &str) -> bool {
        match uri::extension(name).as_str() {
            "b3dm" | "i3dm" | "cmpt" | "pnts" | "glb" | "gltf" | "vctr" | "geom" => false,
            "json" => true,
            _ => {
                let Ok(start) = self.files.read_start(name, SNIFFED_BYTES) else { return false };
                // A glTF has its members at the root, a tileset has them below `root`.
                let text = String::from_utf8_lossy(&start);
                first_character(&start) == Some(b'{')
                    && !["\"meshes\"", "\"accessors\"", "\"bufferViews\""].iter().any(|member| text.contains(member))
            }
        }
    }
}

/// The metadata of a content, its group and its tile.
pub(super) fn attributes_of(tileset: &TilesetJson, tile: &TileJson, content: &ContentJson) -> Attributes {
    let mut attributes = Attributes::default();
    let own = content.metadata.as_ref().and_then(|metadata| metadata.properties.as_ref());
    let group = content.group.and_then(|group| tileset.group(group));
    let of_tile = tile.metadata.as_ref().and_then(|metadata| metadata.properties.as_ref());
    for members in [own, group, of_tile].into_iter().flatten() {
        flatten(members, &mut attributes);
    }
    attributes
}
