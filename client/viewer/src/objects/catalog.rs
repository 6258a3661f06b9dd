//! The objects of a city from the source of its tiles: schema and blocks, fetched when they are needed and kept in bounds.

use crate::scene::TileKey;
use crate::source::{FetchError, ObjectSource, TileSource};
use insula_objects::filter::FilteredObjects;
use insula_objects::search::SearchHit;
use insula_objects::{ObjectBlock, ObjectRecord, Schema};
use insula_protocol::DecodeError;
use insula_protocol::object_tile::{self, SCHEMA_ID, block_of_object};
use lru::LruCache;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, PoisonError};

/// Decoded blocks that are kept. A block has up to 512 objects.
const KEPT_BLOCKS: NonZeroUsize = NonZeroUsize::new(256).unwrap();

/// The objects of one city.
pub struct CityObjects {
    source: Arc<dyn ObjectSource>,
    schema: Schema,
    /// World coordinates of the city's origin, in metres.
    origin: [f64; 3],
    blocks: Mutex<LruCache<u32, Option<Arc<ObjectBlock>>>>,
}

impl CityObjects {
    /// Fetches the schema of the city whose origin has the world coordinates `origin`. `None` if the city has no objects. Fails if
    /// it cannot be fetched or is damaged.
    pub async fn open(source: Arc<dyn ObjectSource>, origin: [f64; 3]) -> Result<Option<Self>, FetchError> {
        let Some(content) = fetch(&*source, TileKey::objects(SCHEMA_ID)).await? else { return Ok(None) };
        let schema: Schema = serde_json::from_slice(&content)
            .map_err(|_| FetchError::Damaged(DecodeError::Invalid("the schema of the objects is not JSON")))?;
        schema.check().map_err(FetchError::Damaged)?;
        Ok(Some(Self { source, schema, origin, blocks: Mutex::new(LruCache::new(KEPT_BLOCKS)) }))
    }

    /// The attributes of all objects.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// World coordinates of the city's origin, in metres.
    pub(super) fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// Number of blocks.
    pub fn block_count(&self) -> u32 {
        self.schema.objects.div_ceil(object_tile::BLOCK_OBJECTS)
    }

    /// A block; `None` if none of its numbers is in use. Fails if it cannot be fetched or is damaged.
    pub async fn block(&self, block: u32) -> Result<Option<Arc<ObjectBlock>>, FetchError> {
        if let Some(known) = self.blocks.lock().unwrap_or_else(PoisonError::into_inner).get(&block) {
            return Ok(known.clone());
        }
        let Some(id) = object_tile::block_id(block) else { return Ok(None) };
        let content = fetch(&*self.source, TileKey::objects(id)).await?;
        let decode = |content: Vec<u8>| ObjectBlock::decode(block, &content, &self.schema).map(Arc::new);
        let decoded = content.map(decode).transpose().map_err(FetchError::Damaged)?;
        self.blocks.lock().unwrap_or_else(PoisonError::into_inner).put(block, decoded.clone());
        Ok(decoded)
    }

    /// The objects whose texts match `query`, the best first, at most `limit`; `None` if the city has no search. Fails if it cannot be
    /// searched.
    pub async fn search(&self, query: &str, limit: usize) -> Result<Option<Vec<SearchHit>>, FetchError> {
        self.source.search(query, limit).await
    }

    /// The result of a filter, if the source evaluates it; `None` if that is left to the blocks. Fails if the source fails.
    pub(super) async fn filter(&self, text: &str) -> Result<Option<FilteredObjects>, FetchError> {
        self.source.filter(text).await
    }

    /// An object; `None` if there is none of this number. Fails as [`Self::block`] does.
    pub async fn object(&self, id: u32) -> Result<Option<ObjectRecord>, FetchError> {
        Ok(self.block(block_of_object(id)).await?.and_then(|block| block.record(id)))
    }
}

impl std::fmt::Debug for CityObjects {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CityObjects").field("objects", &self.schema.objects).finish_non_exhaustive()
    }
}

/// The content of an object tile; `None` if there is no such tile.
async fn fetch(source: &dyn TileSource, key: TileKey) -> Result<Option<Vec<u8>>, FetchError> {
    match source.tile(key).await {
        Ok(bytes) => object_tile::decode(key.id, &bytes).map(Some).map_err(FetchError::Damaged),
        Err(FetchError::Missing) => Ok(None),
        Err(error) => Err(error),
    }
}
