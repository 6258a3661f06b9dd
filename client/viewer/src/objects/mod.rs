//! Objects of a city: what is known of them, and how they are drawn.

mod catalog;
mod coloring;
mod style_rules;
mod styles;

use crate::source::FetchError;
pub use catalog::CityObjects;
pub use coloring::{FilteredOut, ObjectQuery, StyleBuilder};
use insula_objects::family::{PartValues, inherit};
use insula_objects::{FeatureKind, NamedValues, ObjectBounds};
use insula_protocol::object_tile::block_of_object;
use serde::Serialize;
pub use style_rules::{RulesError, StyleRules, StyledObjects};
pub use styles::{ObjectState, ObjectStyles};

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

    /// The same, with the attributes of its parent where it has none of its own, and else with those of its parts. Fails as [`CityObjects::block`] does.
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
        let whole = match record.bounds {
            Some(_) if !inherits => PartsOfObject::default(),
            bounds => self.parts(id, record.kind, bounds.is_some()).await?,
        };
        if inherits {
            parent.iter().for_each(|parent| inherit(&mut attributes, &parent.attributes));
            whole.values.complete(&mut attributes);
        }
        let attributes = NamedValues::new(self.schema(), attributes);
        let (identifier, kind, parent) =
            (record.identifier, record.kind.name(), parent.map(|parent| parent.identifier));
        let (parts, bounds) = match record.bounds {
            Some(bounds) => (Vec::new(), Some(bounds)),
            None => (whole.parts, whole.bounds),
        };
        let centre = bounds.map(|ObjectBounds { min, max }| {
            std::array::from_fn(|axis| self.origin()[axis] + (f64::from(min[axis]) + f64::from(max[axis])) / 20.0)
        });
        Ok(Some(ObjectDescription { id, identifier, parent, kind, attributes, centre, parts }))
    }

    /// The parts of an object. A parent without a shape is next to its first part, so only its block and those beside it are searched.
    /// Most objects with a shape have no parts, so only their own block is.
    async fn parts(&self, id: u32, kind: FeatureKind, has_shape: bool) -> Result<PartsOfObject, FetchError> {
        let mut found = PartsOfObject::default();
        let (own, reach) = (block_of_object(id), u32::from(!has_shape));
        for block in own.saturating_sub(reach)..self.block_count().min(own + reach + 1) {
            let Some(block) = self.block(block).await? else { continue };
            for &part in block.ids().iter().filter(|part| block.parent(**part) == Some(id)) {
                let Some(record) = block.record(part) else { continue };
                found.parts.push(part);
                found.bounds = match (found.bounds, record.bounds) {
                    (Some(all), Some(bounds)) => Some(all.union(bounds)),
                    (all, bounds) => all.or(bounds),
                };
                if record.kind.is_part_of(kind) {
                    found.values.add(record.attributes);
                }
            }
        }
        Ok(found)
    }
}

/// What is known of the parts of an object.
#[derive(Default)]
struct PartsOfObject {
    parts: Vec<u32>,
    /// Their common box.
    bounds: Option<ObjectBounds>,
    /// Of those that make up the object.
    values: PartValues,
}
