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
use insula_viewer::{
    objects::{CityObjects, FilteredOut, ObjectQuery, ObjectStyles, StyleBuilder},
    source::TileSource,
    streamer::FetchError,
};
use serde::Serialize;
use serde_json::{Map, Number};
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
    /// World coordinates of the middle of its box, in metres.
    #[serde(skip)]
    pub centre: Option<[f64; 3]>,
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
            Some((info.name.clone(), to_json(value)))
        };
        let attributes = record.attributes.into_iter().filter_map(named).collect();
        let (identifier, kind) = (record.identifier, record.kind.name());
        let centre = record.bounds.map(|ObjectBounds { min, max }| {
            std::array::from_fn(|axis| self.origin[axis] + (f64::from(min[axis]) + f64::from(max[axis])) / 20.0)
        });
        Ok(Some(ObjectJson { id, identifier, parent, kind, attributes, centre, pixels: None }))
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

fn fetch_error(what: &str, error: &FetchError) -> ClientError {
    ClientError::Failed(format!("{what}: {error}"))
}

/// A value as JSON; dates are texts.
fn to_json(value: Value) -> serde_json::Value {
    match value {
        Value::Text(text) => text.into(),
        Value::Integer(value) => value.into(),
        Value::Float(value) => Number::from_f64(value).map_or(serde_json::Value::Null, Into::into),
        Value::Bool(value) => value.into(),
        date @ Value::Date(_) => date.to_string().into(),
    }
}
