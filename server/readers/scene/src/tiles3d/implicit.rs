//! Implicit tilings: quadtrees and octrees whose tiles are listed in subtree files.

use super::reader::{OpenTileset, Parent, TileReader, attributes_of};
use super::subtree::{Subtree, SubtreeShape};
use super::tileset::{ContentJson, TileJson};
use super::uri;
use super::volume::Volume;
use insula_source::error::InputError;
use insula_source::problems::SUBTREE_UNREADABLE;

/// Deeper levels are left out: at the equator, the tiles of this one are a centimetre wide.
const MAX_LEVELS: u32 = 32;

/// A tile with implicit children.
struct ImplicitRoot<'t> {
    tileset: OpenTileset<'t>,
    tile: &'t TileJson,
    contents: Vec<&'t ContentJson>,
    shape: SubtreeShape,
    levels: u32,
    subtrees: &'t str,
    own: Parent,
    volume: Option<Volume>,
}

/// A tile by its level and its place on it, in x, y and z.
#[derive(Debug, Clone, Copy)]
struct Coordinates {
    level: u32,
    at: [u64; 3],
}

/// A tile within its subtree: its level there and its number in Morton order.
#[derive(Debug, Clone, Copy)]
struct Local {
    level: u32,
    morton: u64,
}

impl Coordinates {
    /// Child number `child` in Morton order.
    fn child(self, child: u64, dimensions: u32) -> Self {
        let bit = |axis: u32| if axis < dimensions { child >> axis & 1 } else { 0 };
        let at = [0, 1, 2].map(|axis: usize| 2 * self.at[axis] + bit(axis as u32));
        Self { level: self.level + 1, at }
    }

    fn uri(self, template: &str) -> String {
        let [x, y, z] = self.at.map(|number| number.to_string());
        let level = self.level.to_string();
        template.replace("{level}", &level).replace("{x}", &x).replace("{y}", &y).replace("{z}", &z)
    }
}

impl TileReader<'_, '_> {
    /// Visits the implicit tiles of a tile. Returns whether there was content.
    pub(super) fn visit_implicit(
        &mut self,
        tileset: OpenTileset<'_>,
        tile: &TileJson,
        own: Parent,
        volume: Option<Volume>,
    ) -> Result<bool, InputError> {
        let Some(tiling) = tile.implicit() else { return Ok(false) };
        let dimensions = if tiling.subdivision_scheme.eq_ignore_ascii_case("OCTREE") { 3 } else { 2 };
        let levels = tiling.available_levels.or(tiling.maximum_level.map(|level| level.saturating_add(1)));
        let levels = levels.unwrap_or(MAX_LEVELS);
        let Some(shape) = SubtreeShape::new(dimensions, tiling.subtree_levels) else {
            let detail = format!("{}: subtrees of {} levels", tileset.name, tiling.subtree_levels);
            self.sink.skip("implicit tiling is malformed", detail);
            return Ok(false);
        };
        if levels > MAX_LEVELS {
            let detail = format!("{}: {levels} levels, of which {MAX_LEVELS} are read", tileset.name);
            self.sink.problem("implicit tiling has too many levels", detail);
        }
        let root = ImplicitRoot {
            tileset,
            tile,
            contents: tile.contents().collect(),
            shape,
            levels: levels.min(MAX_LEVELS),
            subtrees: &tiling.subtrees.uri,
            own,
            volume,
        };
        self.visit_subtree(&root, Coordinates { level: 0, at: [0; 3] })
    }

    fn visit_subtree(&mut self, root: &ImplicitRoot<'_>, coordinates: Coordinates) -> Result<bool, InputError> {
        let uri = coordinates.uri(root.subtrees);
        self.count_file(&uri)?;
        match self.load_subtree(root, &uri) {
            Ok(subtree) if subtree.has_tile(0, 0) => {
                self.visit_in(root, &subtree, coordinates, Local { level: 0, morton: 0 })
            }
            Ok(_) => Ok(false),
            Err(what) => {
                self.sink.skip(SUBTREE_UNREADABLE, format!("{}: {uri}: {what}", root.tileset.name));
                Ok(false)
            }
        }
    }

    fn load_subtree(&self, root: &ImplicitRoot<'_>, uri: &str) -> Result<Subtree, String> {
        let files = &self.files;
        let read = |folder: &str, uri: &str| {
            let name = uri::resolve(folder, uri, files.is_remote)?;
            files.read(&name).map(|bytes| (name, bytes)).map_err(|error| error.to_string())
        };
        let (name, bytes) = match uri::data_of(uri) {
            Some(data) => (root.tileset.name.to_owned(), data?),
            None => read(uri::folder_of(root.tileset.name), uri)?,
        };
        let folder = uri::folder_of(&name);
        Subtree::parse(&bytes, root.shape, &|uri| read(folder, uri).map(|(_, bytes)| bytes))
    }

    /// Visits a tile that exists and everything below, by the same rule as explicit tiles.
    fn visit_in(
        &mut self,
        root: &ImplicitRoot<'_>,
        subtree: &Subtree,
        coordinates: Coordinates,
        local: Local,
    ) -> Result<bool, InputError> {
        self.count_tile()?;
        let dimensions = root.shape.dimensions;
        if let (Some(volume), Some(bbox)) = (&root.volume, self.files.input.bbox_deg)
            && volume.part(coordinates.level, coordinates.at, dimensions == 3).is_outside(&root.own.transform, bbox)
        {
            return Ok(true);
        }
        let mut has_content = false;
        let child_count = if coordinates.level + 1 < root.levels { 1 << dimensions } else { 0 };
        for child in 0..child_count {
            let below = Local { level: local.level + 1, morton: local.morton << dimensions | child };
            let coordinates = coordinates.child(child, dimensions);
            if below.level == root.shape.levels {
                if subtree.has_child(below.morton) {
                    has_content |= self.visit_subtree(root, coordinates)?;
                }
            } else if subtree.has_tile(below.level, below.morton) {
                has_content |= self.visit_in(root, subtree, coordinates, below)?;
            }
        }
        if has_content && !root.own.adds {
            return Ok(true);
        }
        for (i, content) in root.contents.iter().enumerate() {
            let Some(template) = content.uri.as_ref().filter(|_| subtree.has_content(i, local.level, local.morton))
            else {
                continue;
            };
            let attributes = attributes_of(root.tileset.json, root.tile, content);
            let uri = coordinates.uri(template);
            self.count_file(&uri)?;
            has_content |= self.read_content(root.tileset, &uri, attributes, root.own)?;
        }
        Ok(has_content)
    }
}
