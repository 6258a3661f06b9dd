//! Paints flat areas and lines on terrain, or on level ground, instead of making triangles of them.

use super::SceneSink;
use insula_dress::map_store::MapStoreError;
use insula_dress::paint::{
    AreaClass, LineClass, LineLook, PaintArea, PaintLine, PaintShape, Sidewalks, area_look, is_zebra, line_look,
};
use insula_source::attributes::AttributeValue;
use insula_source::error::InputError;
use insula_source::object::{FeatureKind, Footprint, Shape, SourceObject, Strip};

/// Values of `man_made` of what stands in water.
const WATERSIDE: [&str; 2] = ["pier", "breakwater"];

/// The attributes of an object as texts, by which its look is found.
struct Tags(Vec<(String, String)>);

impl Tags {
    fn of(object: &SourceObject) -> Self {
        Self(object.attributes.iter().map(|(name, value)| (name.to_owned(), value.to_string())).collect())
    }

    fn get(&self, key: &str) -> Option<&str> {
        let value = |key: &str| self.0.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str());
        let is_overture = |subtype| value("subtype") == Some(subtype);
        match key {
            // Overture's classes of roads and rails are those of OpenStreetMap.
            "highway" if is_overture("road") => value(key).or_else(|| value("class")),
            "railway" if is_overture("rail") => value(key).or_else(|| value("class")),
            _ => value(key),
        }
    }

    /// Whether the object is above the ground, or above water.
    fn is_raised(&self) -> bool {
        self.get("bridge").is_some_and(|value| value != "no")
    }
}

/// Whether an object stands in water, which would cover what is painted.
pub(super) fn stands_in_water(object: &SourceObject) -> bool {
    object.attributes.get("man_made").and_then(AttributeValue::as_str).is_some_and(|value| WATERSIDE.contains(&value))
}

/// Kinds of what lies flat on the ground.
pub(super) fn is_painted(kind: FeatureKind) -> bool {
    matches!(
        kind,
        FeatureKind::LandUse | FeatureKind::Vegetation | FeatureKind::Road | FeatureKind::Rail | FeatureKind::Water
    )
}

/// How a line of which only the kind is known is painted.
fn plain_look(kind: FeatureKind) -> Option<LineLook> {
    let class = match kind {
        FeatureKind::Road => LineClass::Service,
        FeatureKind::Rail => LineClass::Rail,
        FeatureKind::Water => LineClass::Waterway,
        _ => return None,
    };
    Some(LineLook { class, lanes: None, is_one_way: false, sidewalks: Sidewalks::None, surfacing: None })
}

impl SceneSink<'_, '_, '_> {
    /// Paints an object if it lies flat on terrain that is made of elevation models, or on level ground, and returns whether it did.
    /// Water stays a surface of its own, because it reflects, except that of sources of streets, whose heights are not known. Fails if
    /// the shapes cannot be kept.
    pub(super) fn paint(&mut self, object: &SourceObject, shape: &Shape) -> Result<bool, InputError> {
        let is_of_streets = self.source.is_streets;
        let is_flat = is_painted(object.kind) && (is_of_streets || object.kind != FeatureKind::Water);
        if !is_flat || !self.context.is_painting() {
            return Ok(false);
        }
        let tags = Tags::of(object);
        if !is_of_streets && (tags.is_raised() || stands_in_water(object)) {
            return Ok(false);
        }
        let (shapes, has_fault) = match shape {
            Shape::Footprints(footprints) => self.painted_areas(object, &tags, footprints),
            Shape::Strips(strips) => self.painted_lines(object.kind, &tags, strips),
            _ => return Ok(false),
        };
        if shapes.is_empty() {
            return Ok(false);
        }
        if has_fault {
            self.report.problem("coordinate not a number or out of range", || object.id.clone());
        }
        for shape in shapes {
            self.context.shapes.push(shape).map_err(|error| self.no_store(error))?;
        }
        self.report.painted += 1;
        Ok(true)
    }

    /// The areas of an object, and whether one has invalid positions.
    fn painted_areas(&self, object: &SourceObject, tags: &Tags, footprints: &[Footprint]) -> (Vec<PaintShape>, bool) {
        let look = area_look(|key| tags.get(key));
        let class = look.map(|look| look.class).or_else(|| AreaClass::of_object_type(object.kind.cityjson_type()));
        let is_wanted = |class: &AreaClass| self.source.is_streets || *class != AreaClass::Water;
        let Some(class) = class.filter(is_wanted) else { return (Vec::new(), false) };
        let surfacing = look.and_then(|look| look.surfacing);
        let mut has_fault = false;
        let areas = footprints.iter().filter_map(|footprint| {
            let ring = |ring: &Vec<[f64; 2]>| ring.iter().map(|point| self.place_on_map(*point)).collect();
            let rings: Option<Vec<Vec<[f64; 2]>>> = footprint.rings.iter().map(ring).collect();
            has_fault |= rings.is_none();
            Some(PaintShape::Area(PaintArea { rings: rings?, class, surfacing }))
        });
        (areas.collect(), has_fault)
    }

    /// The lines of an object, and whether one has invalid positions.
    fn painted_lines(&self, kind: FeatureKind, tags: &Tags, strips: &[Strip]) -> (Vec<PaintShape>, bool) {
        let Some(look) = line_look(|key| tags.get(key)).or_else(|| plain_look(kind)) else {
            return (Vec::new(), false);
        };
        let is_zebra = is_zebra(|key| tags.get(key));
        let (mut lines, mut has_fault) = (Vec::new(), false);
        for strip in strips {
            let points: Option<Vec<[f64; 2]>> = strip.points.iter().map(|point| self.place_on_map(*point)).collect();
            let Some(points) = points else {
                has_fault = true;
                continue;
            };
            if is_zebra {
                lines.push(PaintShape::Line(PaintLine::new(LineClass::Zebra, points.clone())));
            }
            lines.push(PaintShape::Line(PaintLine {
                points,
                class: look.class,
                width_m: strip.width_m,
                lanes: look.lanes,
                is_one_way: look.is_one_way,
                sidewalks: look.sidewalks,
                surfacing: look.surfacing,
            }));
        }
        (lines, has_fault)
    }

    fn no_store(&self, error: MapStoreError) -> InputError {
        InputError::io(&self.source.label, std::io::Error::other(error))
    }
}
