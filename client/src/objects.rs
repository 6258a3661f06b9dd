//! Objects of the city that a session views: attributes, colours, filters.

use crate::{
    error::{ClientError, Result},
    stream::fetch::Http,
};
use insula_objects::{
    ObjectBlock, ObjectBounds, ObjectRecord, Schema, Value,
    color::{ColorBy, Legend},
    filter::Filter,
    search::SearchHit,
};
use insula_protocol::object_tile::block_of_object;
use insula_viewer::{
    objects::{CityObjects, FilteredOut, ObjectQuery, ObjectStyles, StyleBuilder},
    source::TileSource,
    streamer::FetchError,
};
use serde::Serialize;
use serde_json::{Map, json};
use std::sync::Arc;

/// The objects of a city, fetched while the caller waits.
#[derive(Debug)]
pub struct ObjectLookup {
    http: Arc<Http>,
    objects: CityObjects,
    /// World coordinates of the city's origin, in metres.
    origin: [f64; 3],
}

/// An object as JSON.
#[derive(Debug, Serialize)]
pub struct ObjectJson {
    pub id: u32,
    pub identifier: String,
    /// Identifier of its parent.
    pub parent: Option<String>,
    pub kind: &'static str,
    pub attributes: Map<String, serde_json::Value>,
    /// World coordinates of the middle of its box, in metres; that of its parts' if it has no shape.
    #[serde(skip)]
    pub centre: Option<[f64; 3]>,
    /// Parts of an object without a shape.
    #[serde(skip)]
    pub parts: Vec<u32>,
    /// Pixels of a picture that show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels: Option<u64>,
}

/// What is asked of the objects on the command line.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ObjectStyleArgs {
    /// Colour objects by an attribute, or by `height` or `kind`. Palettes: viridis, cividis, magma, inferno, plasma, turbo, red-blue,
    /// brown-teal, spectral, classes.
    #[arg(long, value_name = "ATTRIBUTE[:PALETTE]")]
    pub color_by: Option<String>,
    /// Values of the two ends of the palette [default: the smallest and largest of the city].
    #[arg(
        long,
        value_name = "LOW,HIGH",
        value_delimiter = ',',
        num_args = 2,
        allow_hyphen_values = true,
        requires = "color_by"
    )]
    pub range: Vec<f64>,
    /// Objects that pass, as in 'yearOfConstruction < 1900 && height > 20'.
    #[arg(long, value_name = "EXPR")]
    pub filter: Option<String>,
    /// What becomes of the others.
    #[arg(long, value_name = "HOW", value_parser = ["ghost", "hide", "keep"], default_value = "ghost", requires = "filter")]
    pub others: String,
}

impl ObjectStyleArgs {
    /// Whether nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.color_by.is_none() && self.filter.is_none()
    }
}

/// Styles, and what explains them.
#[derive(Debug)]
pub struct StyledObjects {
    pub styles: ObjectStyles,
    pub legend: Option<Legend>,
    /// Number of objects that pass the filter.
    pub passing: usize,
}

impl ObjectLookup {
    /// Fetches the schema. Fails if the city has no objects, or if they cannot be fetched.
    pub fn open(http: &Arc<Http>, source: Arc<dyn TileSource>, origin: [f64; 3]) -> Result<Self> {
        let place = source.location().to_owned();
        let opened = http.block_on(CityObjects::open(source)).map_err(|error| fetch_error(&place, &error))?;
        let missing = || ClientError::Failed(format!("{place}: the city has no objects: bake it again"));
        Ok(Self { http: Arc::clone(http), objects: opened.ok_or_else(missing)?, origin })
    }

    /// The attributes of all objects.
    pub fn schema(&self) -> &Schema {
        self.objects.schema()
    }

    /// A block; `None` if none of its numbers is in use.
    fn block(&self, block: u32) -> Result<Option<Arc<ObjectBlock>>> {
        let found = self.http.block_on(self.objects.block(block));
        found.map_err(|error| fetch_error(&format!("objects/{block}"), &error))
    }

    /// An object; `None` if there is none of this number. Fails if its block cannot be fetched.
    pub fn object(&self, id: u32) -> Result<Option<ObjectRecord>> {
        let found = self.http.block_on(self.objects.object(id));
        found.map_err(|error| fetch_error(&format!("object {id}"), &error))
    }

    /// The objects whose texts match `query`, the best first, at most `limit`; `None` if the city has no search. Fails if it cannot be
    /// searched.
    pub fn search(&self, query: &str, limit: usize) -> Result<Option<Vec<SearchHit>>> {
        self.http.block_on(self.objects.search(query, limit)).map_err(|error| fetch_error("search", &error))
    }

    /// An object with the names of its attributes. Fails as [`Self::object`] does.
    pub fn describe(&self, id: u32) -> Result<Option<ObjectJson>> {
        let Some(record) = self.object(id)? else { return Ok(None) };
        let parent = match record.parent {
            Some(parent) => self.object(parent)?.map(|parent| parent.identifier),
            None => None,
        };
        let named = |(attribute, value): (u32, Value)| {
            let info = self.schema().attributes.get(attribute as usize)?;
            Some((info.name.clone(), json!(value)))
        };
        let attributes = record.attributes.into_iter().filter_map(named).collect();
        let (identifier, kind) = (record.identifier, record.kind.name());
        let (parts, bounds) = match record.bounds {
            Some(bounds) => (Vec::new(), Some(bounds)),
            None => self.parts(id)?,
        };
        let centre = bounds.map(|ObjectBounds { min, max }| {
            std::array::from_fn(|axis| self.origin[axis] + (f64::from(min[axis]) + f64::from(max[axis])) / 20.0)
        });
        Ok(Some(ObjectJson { id, identifier, parent, kind, attributes, centre, parts, pixels: None }))
    }

    /// The parts of an object, and their common box. A parent without a shape is next to its first part, so only its block and
    /// those beside it are searched.
    fn parts(&self, id: u32) -> Result<(Vec<u32>, Option<ObjectBounds>)> {
        let (mut parts, mut all) = (Vec::new(), None);
        let first = block_of_object(id);
        for block in first.saturating_sub(1)..self.objects.block_count().min(first + 2) {
            let Some(block) = self.block(block)? else { continue };
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

    /// The same, with the attributes of its parent where it has none of its own. Fails as [`Self::object`] does.
    pub fn describe_with_parent(&self, id: u32) -> Result<Option<ObjectJson>> {
        let Some(mut object) = self.describe(id)? else { return Ok(None) };
        let parent = self.object(id)?.and_then(|record| record.parent);
        if let Some(parent) = parent.map(|parent| self.describe(parent)).transpose()?.flatten() {
            for (name, value) in parent.attributes {
                object.attributes.entry(name).or_insert(value);
            }
        }
        Ok(Some(object))
    }

    /// How all objects are drawn. Fetches all blocks. Fails if an expression is invalid, or if a block cannot be fetched.
    pub fn styles(&self, args: &ObjectStyleArgs) -> Result<StyledObjects> {
        let usage = |what: String| ClientError::Usage(what);
        let color = match &args.color_by {
            Some(text) => {
                Some(ColorBy::parse(text, self.schema()).map_err(|e| usage(format!("--color-by {text}: {e}")))?)
            }
            None => None,
        };
        let color = match (color, args.range.as_slice()) {
            (Some(color), &[low, high]) => Some(color.with_range([low, high])),
            (color, _) => color,
        };
        let filter = match &args.filter {
            Some(text) => Some(Filter::parse(text, self.schema()).map_err(|e| usage(format!("--filter {text}: {e}")))?),
            None => None,
        };
        let filtered_out = match args.others.as_str() {
            "hide" => FilteredOut::Hide,
            "keep" => FilteredOut::Keep,
            _ => FilteredOut::Ghost,
        };
        let legend = color.as_ref().map(ColorBy::legend);
        let query = ObjectQuery { color, filter, filtered_out };
        let mut builder = StyleBuilder::default();
        for block in 0..self.objects.block_count() {
            if let Some(block) = self.block(block)? {
                builder.add(&block, &query);
            }
        }
        let (styles, passing) = builder.finish(&query);
        Ok(StyledObjects { styles, legend, passing })
    }
}

fn union(a: ObjectBounds, b: ObjectBounds) -> ObjectBounds {
    let [min, max] = [[a.min, b.min], [a.max, b.max]];
    ObjectBounds {
        min: std::array::from_fn(|axis| min[0][axis].min(min[1][axis])),
        max: std::array::from_fn(|axis| max[0][axis].max(max[1][axis])),
    }
}

fn fetch_error(what: &str, error: &FetchError) -> ClientError {
    ClientError::Failed(format!("{what}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use insula_objects::{FeatureKind, block, schema::SchemaBuilder};
    use insula_protocol::object_tile::{self, SCHEMA_ID, block_id};
    use insula_viewer::{scene::TileKey, source::PendingTile};

    /// A building of two parts, which alone have shapes, and the first part's year.
    struct House {
        schema: Schema,
    }

    impl TileSource for House {
        fn tile(&self, key: TileKey) -> PendingTile<'_> {
            let tile = match key.id {
                SCHEMA_ID => object_tile::encode(key.id, &serde_json::to_vec(&self.schema).unwrap()).unwrap(),
                id if Some(id) == block_id(0) => {
                    let bounds = |x: i32| Some(ObjectBounds { min: [x, 0, 0], max: [x + 100, 200, 300] });
                    let record = |identifier: &str, kind, parent, bounds| {
                        let attributes = vec![(0, Value::Integer(1650))];
                        Some(ObjectRecord { identifier: identifier.to_owned(), kind, parent, bounds, attributes })
                    };
                    let records = [
                        record("house", FeatureKind::Building, None, None),
                        record("house-0", FeatureKind::BuildingPart, Some(0), bounds(0)),
                        record("house-1", FeatureKind::BuildingPart, Some(0), bounds(300)),
                    ];
                    object_tile::encode(id, &block::encode(0, &records, &self.schema).unwrap()).unwrap()
                }
                _ => return Box::pin(async { Err(FetchError::Missing) }),
            };
            Box::pin(std::future::ready(Ok(Bytes::from(tile))))
        }

        fn location(&self) -> &str {
            "house"
        }
    }

    #[test]
    fn a_building_without_a_shape_has_the_place_of_its_parts() {
        let mut schema = SchemaBuilder::default();
        (0..3).for_each(|_| schema.add("year", &Value::Integer(1650)));
        let http = Arc::new(Http::new(None).unwrap());
        let house = Arc::new(House { schema: schema.finish(3) });
        let objects = ObjectLookup::open(&http, house, [1000.0, 0.0, 0.0]).unwrap();
        let house = objects.describe(0).unwrap().unwrap();
        assert_eq!((house.parts, house.centre), (vec![1, 2], Some([1020.0, 10.0, 15.0])));
        let part = objects.describe(2).unwrap().unwrap();
        assert_eq!((part.parts, part.centre), (Vec::new(), Some([1035.0, 10.0, 15.0])));
        assert_eq!(part.parent.as_deref(), Some("house"));
        assert!(objects.describe(3).unwrap().is_none());
    }
}
