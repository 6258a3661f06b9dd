//! Passes the features of all vector formats on: identifier, kind, coordinate system, shape and filter by place.

use super::geometry::Geometry;
use super::layer::{Columns, Layer};
use super::rings;
use super::shape::{Facing, facing, shape_of};
use super::told::{guess, told};
use insula_dress::footprint::{HeightHints, IN_TUNNEL, is_hidden};
use insula_place::crs::is_geographic;
use insula_place::placement::FirstShape;
use insula_source::attributes::{AttributeValue, Attributes, MAX_ATTRIBUTES};
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{AxisOrder, CrsReference, FeatureKind, ObjectSink, Shape, SourceObject};
use insula_source::problems::{MISSING_GROUND, NO_CRS, OUTLINES_AND_PARTS, TREES_BY_COLUMN};
use insula_source::text::split_words;

/// What most formats mean by longitude and latitude.
pub(super) const DEGREES: &str = "OGC:CRS84";
/// Names of attributes that identify a feature, in lower case; the first that has a value counts.
const ID_NAMES: [&str; 15] = split_words(
    "id @id gml_id identificatie osm_id osm_way_id objectid fid ogc_fid feature_id gid building_id bldg_id globalid \
    uuid",
);
/// Attributes that hold further tags as one text.
const TAG_NAMES: [&str; 3] = ["other_tags", "all_tags", "tags"];
/// Beginning of the names of tags that are members of one attribute, as some programs write them.
const TAG_PREFIX: &str = "tags.";

/// Level polygons with heights that wait until it is known whether they are faces of bodies.
const MAX_WAITING: u64 = 256;
/// Features of a layer after which that is known. Shares of a source besides the first begin behind them.
pub(super) const MAX_DECISIVE: u64 = 4096;

/// A feature whose identifier is known.
pub(super) struct NamedFeature {
    pub(super) id: String,
    pub(super) attributes: Attributes,
    /// Or the reason for skipping it.
    pub(super) geometry: Result<Geometry, &'static str>,
    /// Those of its table, or its own.
    pub(super) columns: Columns,
}

/// A feature that is ready but for its shape.
struct Feature {
    id: String,
    is_mixed: bool,
    /// What its attributes or its layer say it is, or the reason for leaving it out.
    told: Result<Option<FeatureKind>, &'static str>,
    attributes: Attributes,
    geometry: Geometry,
}

/// What the level polygons with heights of a layer are.
enum LevelPolygons {
    /// Not yet known.
    Waiting(Vec<Feature>),
    Plans,
    /// Faces of bodies, because other features of the layer are walls.
    Faces,
}

/// Takes the features of a source.
pub(crate) struct FeatureWriter<'a> {
    pub(crate) sink: &'a mut dyn ObjectSink,
    layer: Layer,
    /// Name of the attribute that has the height, if the user gives it.
    height_field: Option<&'a str>,
    /// The last system that the sink was told; `None` if it was told none.
    crs: Option<CrsReference>,
    /// Whether the system is settled, named or guessed.
    is_placed: bool,
    /// That of the layer, if it is named, and whether features of it have named systems of their own.
    layer_crs: Option<String>,
    has_own_crs: bool,
    /// Wanted area, if features outside are left out.
    bbox_deg: Option<[f64; 4]>,
    is_in_degrees: bool,
    level_polygons: LevelPolygons,
    has_only_plans: bool,
    /// Features of the layer, and level polygons among them, until it is known what these are.
    decisive: [u64; 2],
    /// Guesses of kinds that were named for the layer.
    guesses: Vec<&'static str>,
    /// Whether there are outlines of buildings of OpenStreetMap, and parts of them.
    has_outlines: bool,
    has_parts: bool,
    count: u64,
}

impl<'a> FeatureWriter<'a> {
    pub(super) fn new(input: &Input<'a>, sink: &'a mut dyn ObjectSink) -> Self {
        // A box over the antimeridian is left to the sink.
        let bbox_deg = input.bbox_deg.filter(|[west, _, east, _]| west <= east);
        let layer = Layer::of_file(input.name, std::iter::empty());
        let level_polygons = LevelPolygons::Waiting(Vec::new());
        Self {
            sink,
            layer,
            height_field: input.height_field,
            crs: None,
            is_placed: false,
            layer_crs: None,
            has_own_crs: false,
            bbox_deg,
            is_in_degrees: false,
            level_polygons,
            has_only_plans: false,
            decisive: [0; 2],
            guesses: Vec::new(),
            has_outlines: false,
            has_parts: false,
            count: 0,
        }
    }

    /// Begins a layer. Without a system, the first feature decides whether its coordinates are degrees. Fails if positions
    /// of the system cannot be placed.
    pub(super) fn begin(&mut self, layer: Layer, crs: Option<String>) -> Result<(), InputError> {
        self.finish()?;
        self.decisive = [0; 2];
        self.guesses.clear();
        self.layer = layer;
        (self.is_placed, self.has_own_crs) = (false, false);
        self.layer_crs.clone_from(&crs);
        match crs {
            Some(crs) => self.set_crs(crs),
            None => Ok(()),
        }
    }

    /// Sets the system of the following features, with east first, as the formats say and most writers have it. Fails if positions of
    /// it cannot be placed.
    pub(super) fn set_crs(&mut self, name: String) -> Result<(), InputError> {
        self.set_reference(mostly_east_first(name))
    }

    /// Sets the system that the next feature has for itself. Fails if positions of it cannot be placed.
    pub(super) fn set_own_crs(&mut self, crs: CrsReference) -> Result<(), InputError> {
        self.has_own_crs = true;
        self.set_reference(crs)
    }

    /// The same by a code of EPSG, if the next feature has one.
    pub(super) fn set_srid(&mut self, srid: Option<u32>) -> Result<(), InputError> {
        match srid.filter(|srid| *srid > 0) {
            Some(srid) => self.set_own_crs(mostly_east_first(format!("EPSG:{srid}"))),
            None => self.set_layer_crs(),
        }
    }

    /// Sets the system of the next feature, which has none for itself: that of the layer. That of the feature before is none of its own,
    /// and where nothing else is known, a guess. Fails if positions of it cannot be placed.
    pub(super) fn set_layer_crs(&mut self) -> Result<(), InputError> {
        if !self.has_own_crs {
            return Ok(());
        }
        match self.layer_crs.clone() {
            Some(crs) => self.set_crs(crs),
            None => {
                let what = "features without a system are taken in that of the feature before";
                self.sink.problem(NO_CRS, format!("{}: {what}", self.layer.name));
                Ok(())
            }
        }
    }

    /// As [`Self::set_crs`], with coordinates in the order of the reference.
    pub(super) fn set_reference(&mut self, crs: CrsReference) -> Result<(), InputError> {
        self.is_placed = true;
        if self.crs.as_ref() == Some(&crs) {
            return Ok(());
        }
        self.finish()?;
        // Whether an area is wanted is compared with longitudes first; the sink knows the others' order.
        self.is_in_degrees = crs.order != AxisOrder::Authority && is_geographic(&crs.name);
        self.sink.set_crs(&crs)?;
        self.crs = Some(crs);
        Ok(())
    }

    /// Level polygons with heights are plans, without a look at the other features.
    pub(super) fn take_level_polygons_as_plans(&mut self) {
        self.has_only_plans = true;
        self.level_polygons = LevelPolygons::Plans;
    }

    /// The wanted area in coordinates of the current system, if that is known to be in degrees.
    pub(super) fn wanted_deg(&self) -> Option<[f64; 4]> {
        self.bbox_deg.filter(|_| self.is_in_degrees)
    }

    /// Whether an extent (west, south, east, north) in the current system is outside of the wanted area.
    pub(super) fn is_unwanted(&self, extent: [f64; 4]) -> bool {
        self.wanted_deg().is_some_and(|wanted| are_apart(extent, wanted))
    }

    /// Counts a feature that is not read any further because it [`Self::is_unwanted`].
    #[cfg(any(feature = "parquet", feature = "sqlite"))]
    pub(super) fn pass_over(&mut self) {
        self.count += 1;
    }

    /// Goes on with the feature after the first `count` of the source.
    #[cfg(feature = "parquet")]
    pub(super) fn continue_after(&mut self, count: u64) {
        self.count = count;
    }

    /// Takes note of a feature at the start of the source, which another share passes on. Returns whether the next one has to be
    /// noted, too. Fails if positions of the system cannot be placed.
    pub(super) fn note(&mut self, geometry: Result<Geometry, &'static str>) -> Result<bool, InputError> {
        self.decisive[0] += 1;
        if let Ok(mut geometry) = geometry {
            geometry.fill_heights();
            self.settle_crs(&geometry)?;
            if let Some(settled) = self.settled_by(facing(&geometry)) {
                self.level_polygons = settled;
            }
        }
        Ok(matches!(self.level_polygons, LevelPolygons::Waiting(_)))
    }

    /// What the level polygons are, if it becomes known with this feature.
    fn settled_by(&mut self, facing: Facing) -> Option<LevelPolygons> {
        if !matches!(self.level_polygons, LevelPolygons::Waiting(_)) {
            return None;
        }
        let [features, level] = &mut self.decisive;
        *level += u64::from(facing == Facing::Level);
        match facing {
            _ if *features > MAX_DECISIVE || *level > MAX_WAITING => Some(LevelPolygons::Plans),
            Facing::Wall => Some(LevelPolygons::Faces),
            _ => None,
        }
    }

    /// Takes a feature, or skips it for the reason in `geometry`. `number` is the source's own, such as a row id. Fails if
    /// the whole bake must end.
    pub(super) fn add(
        &mut self,
        number: Option<String>,
        attributes: Attributes,
        geometry: Result<Geometry, &'static str>,
    ) -> Result<(), InputError> {
        let count = self.count + 1;
        let id = id_of(&attributes).or(number).unwrap_or_else(|| format!("feature {count}"));
        let columns = self.layer.columns;
        self.add_named(NamedFeature { id, attributes, geometry, columns })
    }

    /// As [`Self::add`].
    pub(super) fn add_named(&mut self, feature: NamedFeature) -> Result<(), InputError> {
        let NamedFeature { id, mut attributes, geometry, columns } = feature;
        self.count += 1;
        // Also those without a geometry, so that the share of a feature follows from its place in the file.
        self.decisive[0] += 1;
        let mut geometry = match geometry {
            Ok(geometry) => geometry,
            Err(reason) => {
                self.sink.skip(reason, id);
                return Ok(());
            }
        };
        self.settle_crs(&geometry)?;
        if let (Some(_), Some(bounds)) = (self.wanted_deg(), geometry.bounds())
            && self.is_unwanted(bounds)
        {
            return Ok(());
        }
        if let Some(mark) = geometry.fill_heights() {
            self.sink.problem(MISSING_GROUND, format!("{id}: {mark}"));
        }
        if rings::regroup(&mut geometry.polygons) {
            self.sink.problem("first ring does not enclose the others, rings grouped by containment", id.clone());
        }
        add_tags(&mut attributes);
        let told = told(&id, &attributes, &geometry, &self.layer, columns, self.hints());
        if let Ok(kind) = told {
            self.note_guess(kind, &attributes, &geometry, columns);
        }
        let facing = facing(&geometry);
        let feature = Feature { id, is_mixed: columns.is_mixed, told, attributes, geometry };
        if let Some(settled) = self.settled_by(facing) {
            self.settle_level_polygons(settled)?;
        }
        match (facing, &mut self.level_polygons) {
            (Facing::Level, LevelPolygons::Waiting(waiting)) => {
                waiting.push(feature);
                Ok(())
            }
            _ => self.pass_on(feature),
        }
    }

    /// Ends the layer: passes on all that waits.
    pub(crate) fn finish(&mut self) -> Result<(), InputError> {
        self.settle_level_polygons(LevelPolygons::Plans)?;
        if !self.has_only_plans {
            self.level_polygons = LevelPolygons::Waiting(Vec::new());
        }
        Ok(())
    }

    fn settle_level_polygons(&mut self, settled: LevelPolygons) -> Result<(), InputError> {
        match std::mem::replace(&mut self.level_polygons, settled) {
            LevelPolygons::Waiting(waiting) => waiting.into_iter().try_for_each(|feature| self.pass_on(feature)),
            LevelPolygons::Plans | LevelPolygons::Faces => Ok(()),
        }
    }

    fn pass_on(&mut self, feature: Feature) -> Result<(), InputError> {
        let Feature { id, is_mixed, told, attributes, mut geometry } = feature;
        let told = match told {
            Ok(told) => told,
            Err(reason) => {
                self.sink.skip(reason, id);
                return Ok(());
            }
        };
        geometry.is_surface |=
            matches!(self.level_polygons, LevelPolygons::Faces) && facing(&geometry) == Facing::Level;
        let mut problems = Vec::new();
        let shape = shape_of(geometry, told, &attributes, self.hints(), &mut problems);
        problems.into_iter().for_each(|problem| self.sink.problem(problem, id.clone()));
        match shape {
            Ok(shape) => {
                let kind = told.unwrap_or(default_kind(&shape, is_mixed));
                match hidden_by(kind, &shape, &attributes) {
                    Some(reason) => {
                        self.sink.skip(reason, id);
                        Ok(())
                    }
                    None => {
                        self.note_parts(&id, kind, &attributes, &shape);
                        self.sink.add(self.object(id, kind, attributes, shape))
                    }
                }
            }
            Err(reason) => {
                self.sink.skip(reason, id);
                Ok(())
            }
        }
    }

    fn hints(&self) -> HeightHints<'a> {
        HeightHints { field: self.height_field, ..HeightHints::default() }
    }

    /// Names a guess at the kind of a feature, once for the layer.
    fn note_guess(
        &mut self,
        kind: Option<FeatureKind>,
        attributes: &Attributes,
        geometry: &Geometry,
        columns: Columns,
    ) {
        let Some(problem) = guess(kind, attributes, geometry, &self.layer, columns) else { return };
        if self.guesses.contains(&problem) {
            return;
        }
        self.guesses.push(problem);
        let by_name = self.layer.kind.map_or("generic", FeatureKind::name);
        let what_to_do = match kind {
            _ if problem == TREES_BY_COLUMN => "taken as trees; if they are none, leave the file out".to_owned(),
            Some(_) => format!("taken as {by_name}; if they are buildings, give them heights or rename the layer"),
            None => format!("not taken as {by_name}; if they are no buildings, rename the attribute of heights"),
        };
        self.sink.problem(problem, format!("{}: {what_to_do}", self.layer.name));
    }

    /// Names, once, that outlines are drawn besides their parts.
    fn note_parts(&mut self, id: &str, kind: FeatureKind, attributes: &Attributes, shape: &Shape) {
        if self.has_outlines && self.has_parts || !matches!(shape, Shape::Footprints(_)) {
            return;
        }
        let has = |key: &str| attributes.named(key).is_some();
        self.has_outlines |= kind == FeatureKind::Building && has("building");
        self.has_parts |= kind == FeatureKind::BuildingPart && has("building:part");
        if self.has_outlines && self.has_parts {
            self.sink.problem(OUTLINES_AND_PARTS, format!("{}: {id}", self.layer.name));
        }
    }

    fn object(&self, id: String, kind: FeatureKind, attributes: Attributes, shape: Shape) -> SourceObject {
        let parent = match attributes.get("building_id") {
            Some(parent) if kind == FeatureKind::BuildingPart => Some(parent.to_string()),
            _ => None,
        };
        SourceObject { id, parent, kind, source_type: self.layer.name.clone(), lod: None, attributes, shape }
    }

    /// Guesses the system of a source that names none: degrees, if the first feature can be so and is small.
    fn settle_crs(&mut self, geometry: &Geometry) -> Result<(), InputError> {
        if self.is_placed {
            return Ok(());
        }
        let Some(first) = FirstShape::of(geometry.positions().map(|[x, y, _]| [*x, *y])) else { return Ok(()) };
        self.is_placed = true;
        if first.looks_like_degrees() {
            let detail = format!("{}: coordinates look like degrees and are taken as WGS 84", self.layer.name);
            self.sink.problem(NO_CRS, detail);
            return self.set_crs(DEGREES.to_owned());
        }
        self.is_in_degrees = false;
        if self.crs.take().is_some() {
            // The system of another layer must not be taken for this one's.
            let detail = format!("{}: coordinates are taken in the system of the layer before", self.layer.name);
            self.sink.problem(NO_CRS, detail);
        }
        Ok(())
    }
}

/// A system with east first, as most writers have it.
pub(super) fn mostly_east_first(name: String) -> CrsReference {
    CrsReference { order: AxisOrder::MostlyEastFirst, ..CrsReference::east_first(name) }
}

/// Whether an extent is outside of a wanted area, in degrees. Its longitudes may be those of 0 to 360 degrees. Those that are no numbers
/// may be anywhere.
pub(super) fn are_apart([west, south, east, north]: [f64; 4], [w, s, e, n]: [f64; 4]) -> bool {
    let is_beside = |turn: f64| west + turn > e || east + turn < w;
    [-360.0, 0.0, 360.0].into_iter().all(is_beside) || south > n || north < s
}

/// The kind of a feature that nothing tells: an area is a building (unless the layer tells which are), all else is generic.
fn default_kind(shape: &Shape, is_mixed: bool) -> FeatureKind {
    let is_body = matches!(shape, Shape::Footprints(_) | Shape::Surfaces { .. });
    if is_body && !is_mixed { FeatureKind::Building } else { FeatureKind::Generic }
}

/// The reason why a shape on the map cannot be seen from above; `None` if it can. Surfaces in space have their own heights.
fn hidden_by(kind: FeatureKind, shape: &Shape, attributes: &Attributes) -> Option<&'static str> {
    match shape {
        Shape::Surfaces { .. } | Shape::None => None,
        Shape::Strips(_) if kind == FeatureKind::Tunnel => Some(IN_TUNNEL),
        _ => is_hidden(kind, attributes),
    }
}

/// The identifier that attributes tell. Programs fill the column `Id` with 0, which identifies nothing.
fn id_of(attributes: &Attributes) -> Option<String> {
    let text = |value: &AttributeValue| match value {
        AttributeValue::Text(text) if matches!(text.trim(), "" | "0") => None,
        AttributeValue::Integer(0) | AttributeValue::Float(0.0) => None,
        AttributeValue::Text(text) => Some(text.trim().to_owned()),
        AttributeValue::Integer(_) => Some(value.to_string()),
        AttributeValue::Float(number) if number.fract() == 0.0 && number.abs() < 1e15 => Some(format!("{number:.0}")),
        _ => None,
    };
    ID_NAMES.iter().find_map(|known| {
        attributes.iter().filter(|(name, _)| name.eq_ignore_ascii_case(known)).find_map(|(_, value)| text(value))
    })
}

/// Adds the tags of OpenStreetMap that are within an attribute: as one text (`"key"=>"value"`, or a JSON object), as GDAL leaves them, or
/// as its members.
fn add_tags(attributes: &mut Attributes) {
    // Items of lists have numbers.
    let is_key = |key: &&str| !key.starts_with(|first: char| first.is_ascii_digit());
    let tag = |(name, value): (&str, &AttributeValue)| {
        let key = name.strip_prefix(TAG_PREFIX).filter(is_key)?;
        Some((key.to_owned(), value.as_str().map_or_else(|| value.clone(), AttributeValue::from_untyped)))
    };
    let nested: Vec<(String, AttributeValue)> = attributes.iter().filter_map(tag).collect();
    nested.into_iter().for_each(|(key, value)| attributes.push(&key, value));
    for name in TAG_NAMES {
        let Some(text) = attributes.get(name).and_then(AttributeValue::as_str).map(str::to_owned) else { continue };
        if text.starts_with('{') {
            if let Ok(serde_json::Value::Object(tags)) = serde_json::from_str(&text) {
                for (key, value) in tags {
                    if let Some(value) = value.as_str() {
                        attributes.push(&key, AttributeValue::from_untyped(value));
                    }
                }
            }
            continue;
        }
        let mut texts = quoted_texts(&text);
        while let (Some(key), Some(value)) = (texts.next(), texts.next()) {
            if attributes.len() >= MAX_ATTRIBUTES {
                break;
            }
            attributes.push(&key, AttributeValue::from_untyped(&value));
        }
    }
}

/// The texts in quotation marks, with `\` before marks and itself.
fn quoted_texts(text: &str) -> impl Iterator<Item = String> + '_ {
    let mut chars = text.chars();
    std::iter::from_fn(move || {
        chars.find(|c| *c == '"')?;
        let mut found = String::new();
        loop {
            match chars.next()? {
                '"' => return Some(found),
                '\\' => found.extend(chars.next()),
                c => found.push(c),
            }
        }
    })
}
