//! Names of elements: namespace families, and what an element of a name means to the reader.

use std::collections::HashMap;

/// More different names are all [`NameId::UNKNOWN`].
const MAX_NAMES: usize = 1 << 16;

/// Namespaces of all versions of one standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Family {
    Gml,
    /// CityGML and its modules.
    CityGml,
    /// i-UR of Project PLATEAU, planning objects.
    Urf,
    /// Anything else: application domain extensions, addresses, metadata.
    Other,
    /// No namespace, or a prefix that is not declared: names may be of GML or of CityGML.
    Unknown,
}

impl Family {
    /// The family of a namespace by its URI.
    pub(super) fn of(uri: &str) -> Self {
        let rest = uri.trim().trim_start_matches("https://").trim_start_matches("http://");
        let rest = rest.strip_prefix("schemas.").or_else(|| rest.strip_prefix("www.")).unwrap_or(rest);
        if rest.starts_with("opengis.net/citygml") || rest.starts_with("citygml.org/citygml") {
            Self::CityGml
        } else if rest.starts_with("opengis.net/gml") {
            Self::Gml
        } else if rest.starts_with("geospatial.jp/iur/urf") {
            Self::Urf
        } else {
            Self::Other
        }
    }
}

/// Types of generic attributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GenericType {
    Text,
    Integer,
    Float,
    Date,
    Set,
}

/// What an element means to the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    CityModel,
    FeatureCollection,
    /// A property of the model with one or more objects.
    Member,
    /// A property with appearances.
    Appearance,
    BoundedBy,
    Envelope,
    /// A single planar surface with rings.
    Face,
    /// A face that is a triangle.
    Triangle,
    Ring,
    /// The outer ring of a face, or the outer shell of a solid.
    Exterior,
    /// An inner ring of a face, or an inner shell of a solid.
    Interior,
    Positions,
    Position,
    /// One position in the style of GML 2: an element for each number.
    Coordinate,
    /// Positions in the style of GML 2: `x,y,z x,y,z`.
    Coordinates,
    OrientableSurface,
    /// Curves and points, which have no surface.
    Lines,
    /// A piece of a curve through three positions, or several such pieces.
    Arc,
    /// A whole circle through three positions.
    Circle,
    /// A curve that may be run through backwards.
    OrientableCurve,
    /// A piece of a curve of another form.
    OtherCurve,
    ImplicitGeometry,
    Matrix,
    ReferencePoint,
    RelativeGeometry,
    LibraryObject,
    /// A property with geometry of a level of detail.
    Lod(u8),
    Footprint,
    RoofEdge,
    /// A property with lines or points of a level of detail.
    LodLines,
    /// The level of detail of a relief.
    ReliefLod,
    /// The triangles of a relief.
    Tin,
    /// Properties with thematic surfaces of an object.
    Boundary,
    /// Properties with windows and doors.
    Opening,
    /// Properties with objects whose surfaces are those of the object: traffic areas of a road, components of a relief.
    SameObject,
    /// Properties with objects that add to an object: chimneys, balconies, stairs.
    Installation,
    /// Properties with beams, slabs and columns, which are hidden in most buildings.
    Construction,
    /// Properties with parts, which are objects of their own.
    Part,
    /// Properties with logical subdivisions such as storeys.
    Subdivision,
    GroupMember,
    Generic(GenericType),
    /// A property of CityGML 3.0 with one generic attribute.
    GenericProperty,
    Address,
    /// Properties with rooms and what is in them, which are not read.
    Room,
    /// Not read at all: free spaces, metadata.
    Ignored,
    Other,
}

/// Number of an element's name within a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NameId(pub(super) u32);

impl NameId {
    const UNKNOWN: Self = Self(0);
}

/// A name of elements.
#[derive(Debug)]
pub(super) struct Name {
    pub(super) family: Family,
    pub(super) local: Box<str>,
    pub(super) class: Class,
}

#[derive(Debug)]
pub(super) struct Names {
    list: Vec<Name>,
    ids: HashMap<(Family, Box<str>), NameId>,
}

impl Names {
    pub(super) fn new() -> Self {
        let unknown = Name { family: Family::Other, local: "unknown".into(), class: Class::Other };
        Self { list: vec![unknown], ids: HashMap::new() }
    }

    pub(super) fn id_of(&mut self, family: Family, local: &str) -> NameId {
        let key = (family, Box::from(local));
        if let Some(id) = self.ids.get(&key) {
            return *id;
        }
        if self.list.len() >= MAX_NAMES {
            return NameId::UNKNOWN;
        }
        let id = NameId(self.list.len() as u32);
        self.list.push(Name { family, local: local.into(), class: class_of(family, local) });
        self.ids.insert(key, id);
        id
    }

    pub(super) fn get(&self, id: NameId) -> &Name {
        self.list.get(id.0 as usize).unwrap_or(&self.list[0])
    }

    pub(super) fn class(&self, id: NameId) -> Class {
        self.get(id).class
    }

    /// Whether any name may be one of CityGML.
    pub(super) fn may_be_city_gml(&self) -> bool {
        self.list.iter().any(|name| matches!(name.family, Family::CityGml | Family::Urf | Family::Unknown))
    }

    pub(super) fn local(&self, id: NameId) -> &str {
        &self.get(id).local
    }
}

fn class_of(family: Family, local: &str) -> Class {
    let gml = matches!(family, Family::Gml | Family::Unknown).then(|| gml_class(local)).flatten();
    let feature = || (family != Family::Gml).then(|| feature_class(local)).flatten();
    match gml.or_else(feature) {
        Some(Class::CityModel) if !matches!(family, Family::CityGml | Family::Unknown) => Class::Other,
        class => class.unwrap_or(Class::Other),
    }
}

fn gml_class(local: &str) -> Option<Class> {
    Some(match local {
        "FeatureCollection" => Class::FeatureCollection,
        "featureMember" | "featureMembers" | "member" => Class::Member,
        "boundedBy" => Class::BoundedBy,
        "Envelope" | "EnvelopeWithTimePeriod" | "Box" => Class::Envelope,
        "Polygon" | "PolygonPatch" | "Rectangle" => Class::Face,
        "Triangle" => Class::Triangle,
        "LinearRing" | "Ring" => Class::Ring,
        "exterior" | "outerBoundaryIs" => Class::Exterior,
        "interior" | "innerBoundaryIs" => Class::Interior,
        "posList" => Class::Positions,
        "pos" | "lowerCorner" | "upperCorner" => Class::Position,
        "coord" => Class::Coordinate,
        "coordinates" => Class::Coordinates,
        "OrientableSurface" => Class::OrientableSurface,
        "MultiCurve" | "CompositeCurve" | "MultiPoint" | "MultiLineString" => Class::Lines,
        "Arc" | "ArcString" => Class::Arc,
        "Circle" => Class::Circle,
        "OrientableCurve" => Class::OrientableCurve,
        "ArcByBulge"
        | "ArcStringByBulge"
        | "ArcByCenterPoint"
        | "CircleByCenterPoint"
        | "Bezier"
        | "BSpline"
        | "CubicSpline"
        | "Clothoid"
        | "OffsetCurve" => Class::OtherCurve,
        "metaDataProperty" | "stopLines" | "breakLines" | "controlPoint" | "maxLength" => Class::Ignored,
        _ => return None,
    })
}

fn feature_class(local: &str) -> Option<Class> {
    lod_class(local).or_else(|| property_class(local)).or_else(|| space_class(local)).or_else(|| generic_class(local))
}

/// Properties that begin with their level of detail, such as `lod2Solid`.
fn lod_class(local: &str) -> Option<Class> {
    let (digit, content) = local.strip_prefix("lod")?.split_at_checked(1)?;
    let level: u8 = digit.parse().ok().filter(|level| *level <= 4)?;
    Some(match content {
        "FootPrint" | "Footprint" => Class::Footprint,
        "RoofEdge" => Class::RoofEdge,
        _ if content.starts_with("TerrainIntersection") => Class::Ignored,
        "MultiCurve" | "Curve" | "Network" | "Point" | "MultiPoint" => Class::LodLines,
        _ if ["Solid", "Surface", "Geometry", "Representation"].iter().any(|end| content.ends_with(end)) => {
            Class::Lod(level)
        }
        _ => return None,
    })
}

/// Properties between features.
fn property_class(local: &str) -> Option<Class> {
    Some(match local {
        "CityModel" => Class::CityModel,
        "FeatureCollection" => Class::FeatureCollection,
        "cityObjectMember" | "featureMember" | "featureMembers" | "member" => Class::Member,
        "appearanceMember" | "appearance" => Class::Appearance,
        "boundedBy" | "boundary" => Class::Boundary,
        "opening" | "filling" | "fillingSurface" => Class::Opening,
        "TexturedSurface" => Class::OrientableSurface,
        "ImplicitGeometry" => Class::ImplicitGeometry,
        "transformationMatrix" => Class::Matrix,
        "referencePoint" => Class::ReferencePoint,
        "relativeGMLGeometry" | "relativeGeometry" => Class::RelativeGeometry,
        "libraryObject" => Class::LibraryObject,
        "lod" => Class::ReliefLod,
        "tin" => Class::Tin,
        "groupMember" => Class::GroupMember,
        "address" => Class::Address,
        "reliefComponent"
        | "trafficArea"
        | "auxiliaryTrafficArea"
        | "trafficSpace"
        | "auxiliaryTrafficSpace"
        | "section"
        | "intersection" => Class::SameObject,
        _ => return None,
    })
}

/// Properties with parts, interiors and other spaces of an object.
fn space_class(local: &str) -> Option<Class> {
    Some(match local {
        "consistsOfBuildingPart"
        | "buildingPart"
        | "consistsOfBridgePart"
        | "bridgePart"
        | "consistsOfTunnelPart"
        | "tunnelPart" => Class::Part,
        "buildingSubdivision" | "buildingUnit" | "storey" => Class::Subdivision,
        "outerBuildingInstallation"
        | "buildingInstallation"
        | "outerBridgeInstallation"
        | "bridgeInstallation"
        | "outerTunnelInstallation"
        | "tunnelInstallation"
        | "outerBridgeConstruction"
        | "bridgeConstructiveElement"
        | "tunnelConstructiveElement" => Class::Installation,
        "buildingConstructiveElement" => Class::Construction,
        "interiorRoom"
        | "interiorFurniture"
        | "roomInstallation"
        | "interiorBuildingInstallation"
        | "interiorBridgeRoom"
        | "interiorBridgeInstallation"
        | "interiorHollowSpace"
        | "interiorTunnelInstallation"
        | "buildingRoom"
        | "buildingFurniture"
        | "bridgeRoom"
        | "bridgeFurniture"
        | "hollowSpace"
        | "tunnelFurniture" => Class::Room,
        "clearanceSpace"
        | "hole"
        | "marking"
        | "relatedTo"
        | "dynamizer"
        | "pointCloud"
        | "generalizesTo"
        | "extent"
        | "parent"
        | "versionMember"
        | "versionTransitionMember"
        | "engineeringCRS" => Class::Ignored,
        _ => return None,
    })
}

fn generic_class(local: &str) -> Option<Class> {
    Some(match local {
        "stringAttribute" | "StringAttribute" | "uriAttribute" | "UriAttribute" | "CodeAttribute" => {
            Class::Generic(GenericType::Text)
        }
        "intAttribute" | "IntAttribute" => Class::Generic(GenericType::Integer),
        "doubleAttribute" | "DoubleAttribute" | "measureAttribute" | "MeasureAttribute" => {
            Class::Generic(GenericType::Float)
        }
        "dateAttribute" | "DateAttribute" => Class::Generic(GenericType::Date),
        "genericAttributeSet" | "GenericAttributeSet" => Class::Generic(GenericType::Set),
        "genericAttribute" => Class::GenericProperty,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_independent_of_versions() {
        for uri in [
            "http://www.opengis.net/citygml/2.0",
            "https://www.opengis.net/citygml/bridge/3.0",
            "http://www.citygml.org/citygml/1/0/0",
        ] {
            assert_eq!(Family::of(uri), Family::CityGml);
        }
        assert_eq!(Family::of("http://www.opengis.net/gml/3.2"), Family::Gml);
        assert_eq!(Family::of("https://www.geospatial.jp/iur/urf/3.1"), Family::Urf);
        assert_eq!(Family::of("https://www.geospatial.jp/iur/uro/3.1"), Family::Other);
        assert_eq!(Family::of("http://www.opengis.net/kml/2.2"), Family::Other);
    }

    #[test]
    fn classes_follow_family_and_local_name() {
        let mut names = Names::new();
        let mut class = |family, local| {
            let id = names.id_of(family, local);
            names.class(id)
        };
        assert_eq!(class(Family::CityGml, "lod2Solid"), Class::Lod(2));
        assert_eq!(class(Family::Urf, "lod1MultiSurface"), Class::Lod(1));
        assert_eq!(class(Family::CityGml, "lod3TerrainIntersectionCurve"), Class::Ignored);
        assert_eq!(class(Family::CityGml, "interiorRoom"), Class::Room);
        assert_eq!(class(Family::Other, "lod1HeightType"), Class::Other);
        assert_eq!(class(Family::CityGml, "lod9Solid"), Class::Other);
        assert_eq!(class(Family::CityGml, "lodü"), Class::Other);
        assert_eq!(class(Family::CityGml, "boundedBy"), Class::Boundary);
        assert_eq!(class(Family::Gml, "boundedBy"), Class::BoundedBy);
        assert_eq!(class(Family::CityGml, "Polygon"), Class::Other);
        assert_eq!(class(Family::Unknown, "Polygon"), Class::Face);
    }

    #[test]
    fn names_are_limited() {
        let mut names = Names::new();
        for i in 0..MAX_NAMES + 10 {
            names.id_of(Family::Other, &format!("n{i}"));
        }
        assert_eq!(names.id_of(Family::Other, "one more"), NameId::UNKNOWN);
        assert_eq!(names.list.len(), MAX_NAMES);
    }
}
