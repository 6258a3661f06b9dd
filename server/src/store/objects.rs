//! The objects of an opened city on disk: their schema, and blocks that are read and decoded as needed.

use insula_archive::BakedCity;
use insula_objects::family::{PartValues, inherit};
use insula_objects::{ObjectBlock, ObjectRecord, Schema, Value};
use insula_protocol::TileKind;
use insula_protocol::object_tile::{self, SCHEMA_ID, block_of_object};
use lru::LruCache;
use std::cell::RefCell;
use std::num::NonZeroUsize;
use std::sync::Arc;

const KEPT_BLOCKS: NonZeroUsize = NonZeroUsize::new(64).unwrap();

/// Why objects cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    #[error("{place}: the city has no objects; bake it again")]
    None { place: String },
    #[error("{place}/objects/{tile}: {reason}; bake the city again, or copy it again from an intact source")]
    Damaged { place: String, tile: String, reason: String },
}

/// Reads the objects of a city.
pub struct StoredObjects<'a> {
    city: &'a BakedCity,
    schema: Schema,
    blocks: RefCell<LruCache<u32, Option<Arc<ObjectBlock>>>>,
}

impl<'a> StoredObjects<'a> {
    /// Reads the schema. Fails if the city has none, or a damaged one.
    pub fn open(city: &'a BakedCity) -> Result<Self, ObjectError> {
        let content = read(city, SCHEMA_ID, "schema")?;
        let content = content.ok_or_else(|| ObjectError::None { place: city.location().to_owned() })?;
        let damaged = |reason: String| damaged(city, "schema", reason);
        let schema: Schema = serde_json::from_slice(&content).map_err(|error| damaged(error.to_string()))?;
        schema.check().map_err(|error| damaged(error.to_string()))?;
        Ok(Self { city, schema, blocks: RefCell::new(LruCache::new(KEPT_BLOCKS)) })
    }

    /// The attributes of all objects.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Number of blocks, of which some may be missing.
    pub fn block_count(&self) -> u32 {
        self.schema.objects.div_ceil(object_tile::BLOCK_OBJECTS)
    }

    /// A block; `None` if none of its numbers is in use.
    pub fn block(&self, block: u32) -> Result<Option<Arc<ObjectBlock>>, ObjectError> {
        if let Some(known) = self.blocks.borrow_mut().get(&block) {
            return Ok(known.clone());
        }
        let Some(id) = object_tile::block_id(block) else { return Ok(None) };
        let decode = |content: Vec<u8>| {
            let decoded = ObjectBlock::decode(block, &content, &self.schema);
            decoded.map(Arc::new).map_err(|error| damaged(self.city, &block.to_string(), error.to_string()))
        };
        let decoded = read(self.city, id, &block.to_string())?.map(decode).transpose()?;
        self.blocks.borrow_mut().put(block, decoded.clone());
        Ok(decoded)
    }

    /// An object; `None` if there is none of this number.
    pub fn object(&self, id: u32) -> Result<Option<ObjectRecord>, ObjectError> {
        Ok(self.block(block_of_object(id))?.and_then(|block| block.record(id)))
    }

    /// The values of an object, with those of its parent where it has none of its own, and else those of its parts: see
    /// [`insula_objects::family`]. Parts are looked for in its block and those beside it, where they mostly are.
    pub fn with_family(&self, id: u32, record: &ObjectRecord) -> Result<Vec<(u32, Value)>, ObjectError> {
        let mut attributes = record.attributes.clone();
        if let Some(parent) = record.parent.map(|parent| self.object(parent)).transpose()?.flatten() {
            inherit(&mut attributes, &parent.attributes);
        }
        let mut of_parts = PartValues::default();
        let own = block_of_object(id);
        for block in own.saturating_sub(1)..self.block_count().min(own.saturating_add(2)) {
            let Some(block) = self.block(block)? else { continue };
            let parts = block.ids().iter().filter(|part| block.parent(**part) == Some(id));
            let parts = parts.filter_map(|part| block.record(*part)).filter(|part| part.kind.is_part_of(record.kind));
            parts.for_each(|part| of_parts.add(part.attributes));
        }
        of_parts.complete(&mut attributes);
        Ok(attributes)
    }

    /// An object's identifier; `None` if there is no object of this number.
    pub fn identifier(&self, id: u32) -> Result<Option<String>, ObjectError> {
        Ok(self.block(block_of_object(id))?.and_then(|block| block.identifier(id).map(str::to_owned)))
    }
}

/// The content of an object tile; `None` if there is no such tile.
fn read(city: &BakedCity, id: insula_protocol::TileId, name: &str) -> Result<Option<Vec<u8>>, ObjectError> {
    let bytes = city.tile(TileKind::Objects, id).map_err(|error| damaged(city, name, error.to_string()))?;
    let content = bytes.map(|bytes| object_tile::decode(id, &bytes)).transpose();
    content.map_err(|error| damaged(city, name, error.to_string()))
}

fn damaged(city: &BakedCity, tile: &str, reason: String) -> ObjectError {
    ObjectError::Damaged { place: city.location().to_owned(), tile: tile.to_owned(), reason }
}
