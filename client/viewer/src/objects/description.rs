//! What is known of an object, with the names of its attributes.

use super::CityObjects;
use crate::source::FetchError;
use insula_objects::{NamedValues, ObjectBounds, family::inherit};
use insula_protocol::object_tile::block_of_object;
use serde::Serialize;

/// An object for people and scripts.
#[derive(Debug, Serialize)]
pub struct ObjectDescription {
    pub id: u32,
    pub identifier: String,
    /// Identifier of its parent.
    pub parent: Option<String>,
    pub kind: &'static str,
    /// In the order in which they are shown.
    pub attributes: NamedValues,
    /// World coordinates of the middle of its box, in metres; that of its parts' if it has no shape.
    #[serde(skip)]
    pub centre: Option<[f64; 3]>,
    /// Parts of an object without a shape.
    #[serde(skip)]
    pub parts: Vec<u32>,
}

impl CityObjects {
    /// An object with the names of its attributes; `None` if there is none of this number. Fails as [`CityObjects::block`] does.
    pub async fn describe(&self, id: u32) -> Result<Option<ObjectDescription>, FetchError> {
        self.described(id, false).await
    }

    /// The same, with the attributes of its parent where it has none of its own. Fails as [`CityObjects::block`] does.
    pub async fn describe_with_parent(&self, id: u32) -> Result<Option<ObjectDescription>, FetchError> {
        self.described(id, true).await
    }

    async fn described(&self, id: u32, inherits: bool) -> Result<Option<ObjectDescription>, FetchError> {
        let Some(record) = self.object(id).await? else { return Ok(None) };
        let parent = match record.parent {
            Some(parent) => self.object(parent).await?,
            None => None,
        };
        let mut attributes = record.attributes;
        if inherits && let Some(parent) = &parent {
            inherit(&mut attributes, &parent.attributes);
        }
        let attributes = NamedValues::new(self.schema(), attributes);
        let (identifier, kind, parent) =
            (record.identifier, record.kind.name(), parent.map(|parent| parent.identifier));
        let (parts, bounds) = match record.bounds {
            Some(bounds) => (Vec::new(), Some(bounds)),
            None => self.parts(id).await?,
        };
        let centre = bounds.map(|ObjectBounds { min, max }| {
            std::array::from_fn(|axis| self.origin()[axis] + (f64::from(min[axis]) + f64::from(max[axis])) / 20.0)
        });
        Ok(Some(ObjectDescription { id, identifier, parent, kind, attributes, centre, parts }))
    }

    /// The parts of an object, and their common box. A parent without a shape is next to its first part, so only its block and
    /// those beside it are searched.
    async fn parts(&self, id: u32) -> Result<(Vec<u32>, Option<ObjectBounds>), FetchError> {
        let (mut parts, mut all) = (Vec::new(), None);
        let first = block_of_object(id);
        for block in first.saturating_sub(1)..self.block_count().min(first + 2) {
            let Some(block) = self.block(block).await? else { continue };
            for &part in block.ids().iter().filter(|part| block.parent(**part) == Some(id)) {
                parts.push(part);
                all = match (all, block.bounds(part)) {
                    (Some(all), Some(bounds)) => Some(union(all, bounds)),
                    (all, bounds) => all.or(bounds),
                };
            }
        }
        Ok((parts, all))
    }
}

fn union(a: ObjectBounds, b: ObjectBounds) -> ObjectBounds {
    let [min, max] = [[a.min, b.min], [a.max, b.max]];
    ObjectBounds {
        min: std::array::from_fn(|axis| min[0][axis].min(min[1][axis])),
        max: std::array::from_fn(|axis| max[0][axis].max(max[1][axis])),
    }
}
