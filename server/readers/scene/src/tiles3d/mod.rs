//! 3D Tiles 1.0 and 1.1: tilesets with explicit, implicit and external tiles, or single tiles.
//!
//! Positions are geocentric if the tileset is on the globe; metres of an unknown place otherwise. One tile is in memory at a time.

mod batch_column;
mod batch_table;
mod container;
mod content;
pub(crate) mod files;
mod globe;
mod hierarchy;
mod implicit;
mod instances;
pub(crate) mod kind;
mod objects;
mod reader;
mod subtree;
#[cfg(test)]
mod tests;
mod tile;
mod tileset;
pub(crate) mod uri;
mod volume;

use files::TileFiles;
use glam::DMat4;
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::ObjectSink;
use reader::{ContentFault, Parent, TileReader};
use tile::{Tile, UpAxis};

/// Reads a tileset (`tileset.json`), or a single tile (`.b3dm`, `.i3dm`, `.cmpt`). Fails if it cannot be read itself; tiles of a
/// tileset that cannot be read are skipped.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let mut reader = TileReader::new(TileFiles::new(*input), sink);
    if !matches!(uri::extension(input.name).as_str(), "b3dm" | "i3dm" | "cmpt" | "pnts" | "glb" | "gltf") {
        let parent = Parent { transform: DMat4::IDENTITY, adds: false, depth: 0 };
        return reader.read_tileset(input.name, parent)?.map(|_| ());
    }
    let bytes = reader.files.read(input.name).map_err(|cause| InputError::io(input.label, cause))?;
    let tile = Tile {
        name: input.name.to_owned(),
        transform: DMat4::IDENTITY,
        up: UpAxis::Y,
        attributes: Attributes::default(),
        kind: kind::kind_of_name(uri::stem(input.name)),
    };
    let added = reader.add_content(&tile, &bytes, 0);
    reader.sink.tick(reader.files.bytes_read());
    added.map(|_| ()).map_err(ContentFault::into_error)
}
