//! Objects of the city that a session views: attributes, colours, filters.

use crate::error::{ClientError, Result};
use crate::language;
use crate::proposal::AddedObjects;
use crate::stream::fetch::Http;
use insula_objects::Schema;
use insula_objects::search::SearchHit;
use insula_protocol::text::printable;
use insula_viewer::objects::{CityObjects, FilteredOut, ObjectDescription, RulesError, StyleRules, StyledObjects};
use insula_viewer::source::{FetchError, ObjectSource, WITHOUT_OBJECTS};
use std::sync::Arc;

/// The objects of a city, fetched while the caller waits.
#[derive(Debug)]
pub struct ObjectLookup {
    http: Arc<Http>,
    objects: CityObjects,
    /// Those that a proposal adds.
    added: AddedObjects,
}

/// What is asked of the objects on the command line.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ObjectStyleArgs {
    /// Colour objects by an attribute, or by `height` or `kind`. Palettes: viridis, cividis, magma, inferno, plasma, turbo, red-blue,
    /// brown-teal, spectral, classes.
    #[arg(long, value_name = "ATTRIBUTE[:PALETTE]")]
    pub color_by: Option<String>,
    /// Values of the two ends of the palette [default: the smallest and largest of the city].
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_range, allow_hyphen_values = true, requires = "color_by")]
    pub range: Option<[f64; 2]>,
    /// Objects that pass, as in 'height > 20'.
    #[arg(long, value_name = "EXPR")]
    pub filter: Option<String>,
    /// What becomes of the others: pale, not drawn, or as they are, with those that pass in yellow or in the colour of `--color-by`.
    #[arg(long, value_name = "HOW", value_parser = ["ghost", "hide", "keep"], default_value = "ghost", requires = "filter")]
    pub others: String,
}

/// Parses the values of both ends of a palette; they may be in falling order. Fails with what was expected.
pub(crate) fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]));
    ends.filter(|ends: &[f64; 2]| ends.iter().all(|end| end.is_finite()))
        .ok_or_else(|| "expected two numbers, separated by a comma, as in 1850,2020".to_owned())
}

/// Says that `--range` changes nothing, because colours by this attribute are classes.
pub(crate) fn warn_of_range(attribute: &str) {
    eprintln!(
        "warning: --range is not used: {} has texts or classes, and no gradient of numbers",
        printable(attribute)
    );
}

impl ObjectStyleArgs {
    /// Whether nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.color_by.is_none() && self.filter.is_none()
    }

    /// What is asked.
    pub fn rules(&self) -> StyleRules {
        StyleRules {
            attribute: self.color_by.clone().unwrap_or_default(),
            palette: String::new(),
            range: self.range,
            filter: self.filter.clone().unwrap_or_default(),
            filtered_out: match self.others.as_str() {
                "hide" => FilteredOut::Hide,
                "keep" => FilteredOut::Keep,
                _ => FilteredOut::Ghost,
            },
            up_to: None,
        }
    }
}

impl ObjectLookup {
    /// Fetches the schema. Fails if the city has no objects, or if they cannot be fetched.
    pub fn open(http: &Arc<Http>, source: Arc<dyn ObjectSource>, origin: [f64; 3]) -> Result<Self> {
        let place = source.location().to_owned();
        let reason = if source.opens_objects() { "the city has no objects: bake it again" } else { WITHOUT_OBJECTS };
        let opened = http.block_on(CityObjects::open(source, origin)).map_err(|error| fetch_error(&place, &error))?;
        let missing = || ClientError::Failed(format!("{place}: {reason}"));
        Ok(Self { http: Arc::clone(http), objects: opened.ok_or_else(missing)?, added: AddedObjects::default() })
    }

    /// The same objects, and those that a proposal adds.
    pub(crate) fn with_added(self, added: AddedObjects) -> Self {
        Self { added, ..self }
    }

    /// The attributes of all objects.
    pub fn schema(&self) -> &Schema {
        self.objects.schema()
    }

    /// The objects whose texts match `query`, the best first, at most `limit`; `None` if the city has no search. Fails if it cannot be
    /// searched.
    pub fn search(&self, query: &str, limit: usize) -> Result<Option<Vec<SearchHit>>> {
        self.http.block_on(self.objects.search(query, limit)).map_err(|error| fetch_error("search", &error))
    }

    /// An object with the names of its attributes. Fails if it cannot be fetched.
    pub fn describe(&self, id: u32) -> Result<Option<ObjectDescription>> {
        if let Some(added) = self.added.describe(id) {
            return Ok(Some(added));
        }
        let found = self.http.block_on(self.objects.describe(id));
        found.map_err(|error| fetch_error(&format!("object {id}"), &error))
    }

    /// The same, with the attributes of its parent where it has none of its own. Fails as [`Self::describe`] does.
    pub fn describe_with_parent(&self, id: u32) -> Result<Option<ObjectDescription>> {
        if let Some(added) = self.added.describe(id) {
            return Ok(Some(added));
        }
        let found = self.http.block_on(self.objects.describe_with_parent(id));
        found.map_err(|error| fetch_error(&format!("object {id}"), &error))
    }

    /// How all objects are drawn. Fetches all blocks. Fails if an expression is invalid, or if a block cannot be fetched.
    pub fn styles(&self, rules: &StyleRules) -> Result<StyledObjects> {
        let mut styled = self.http.block_on(self.objects.styles(rules)).map_err(|error| match error {
            RulesError::Fetch(error) => fetch_error("objects", &error),
            invalid => ClientError::Usage(invalid.to_string()),
        })?;
        if rules.range.is_some() && styled.legend.as_ref().is_some_and(|legend| legend.ramp.is_none()) {
            warn_of_range(&rules.attribute);
        }
        styled.legend = styled.legend.map(|legend| legend.in_language(&language::of_environment()));
        Ok(styled)
    }
}

fn fetch_error(what: &str, error: &FetchError) -> ClientError {
    ClientError::Failed(format!("{what}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use insula_objects::schema::SchemaBuilder;
    use insula_objects::{FeatureKind, ObjectBounds, ObjectRecord, Value, block};
    use insula_protocol::object_tile::{self, SCHEMA_ID, block_id};
    use insula_viewer::scene::TileKey;
    use insula_viewer::source::{PendingTile, TileSource};

    /// A building of two parts, which alone have shapes and roofs, and a year.
    struct House {
        schema: Schema,
    }

    impl TileSource for House {
        fn tile(&self, key: TileKey) -> PendingTile<'_> {
            let tile = match key.id {
                SCHEMA_ID => object_tile::encode(key.id, &serde_json::to_vec(&self.schema).unwrap()).unwrap(),
                id if Some(id) == block_id(0) => {
                    let bounds = |x: i32| Some(ObjectBounds { min: [x, 0, 0], max: [x + 100, 200, 300] });
                    let record = |identifier: &str, kind, parent, bounds: Option<ObjectBounds>| {
                        let roof = bounds.map(|bounds| (1, Value::Float(f64::from(bounds.min[0]))));
                        let attributes = vec![roof.unwrap_or((0, Value::Integer(1650)))];
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

    impl ObjectSource for House {}

    /// What a link for an area opens.
    struct Area;

    impl TileSource for Area {
        fn tile(&self, _: TileKey) -> PendingTile<'_> {
            Box::pin(async { Err(FetchError::Missing) })
        }

        fn location(&self) -> &str {
            "area"
        }
    }

    impl ObjectSource for Area {
        fn opens_objects(&self) -> bool {
            false
        }
    }

    #[test]
    fn a_link_for_an_area_is_no_fault_of_the_bake() {
        let http = Arc::new(Http::new(None).unwrap());
        let error = ObjectLookup::open(&http, Arc::new(Area), [0.0; 3]).unwrap_err().to_string();
        assert_eq!(error, format!("area: {WITHOUT_OBJECTS}"));
    }

    #[test]
    fn a_building_without_a_shape_has_the_place_of_its_parts() {
        let mut schema = SchemaBuilder::default();
        schema.add("year", &Value::Integer(1650));
        [0.0, 300.0].iter().for_each(|roof| schema.add("roof", &Value::Float(*roof)));
        let http = Arc::new(Http::new(None).unwrap());
        let house = Arc::new(House { schema: schema.finish(3) });
        let objects = ObjectLookup::open(&http, house, [1000.0, 0.0, 0.0]).unwrap();
        let house = objects.describe(0).unwrap().unwrap();
        assert_eq!((house.parts, house.centre), (vec![1, 2], Some([1020.0, 10.0, 15.0])));
        let part = objects.describe(2).unwrap().unwrap();
        assert_eq!((part.parts, part.centre), (Vec::new(), Some([1035.0, 10.0, 15.0])));
        assert_eq!(part.parent.as_deref(), Some("house"));
        assert!(objects.describe(3).unwrap().is_none());
        // Panels show what building and parts know of each other.
        for (id, roof) in [(0, 300.0), (1, 0.0), (2, 300.0)] {
            let shown = objects.describe_with_parent(id).unwrap().unwrap().attributes;
            let found = ["year", "roof"].map(|name| shown.get(name).cloned());
            assert_eq!(found, [Some(Value::Integer(1650)), Some(Value::Float(roof))], "{id}");
        }
    }
}
