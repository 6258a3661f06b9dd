//! What every reader makes of a source: objects with geometry and attributes. The bake does the rest alike for all
//! formats: coordinates to the city's system, triangles, heights of footprints, colours, textures and the report.

use super::attributes::Attributes;
use crate::error::InputError;
pub use insula_objects::FeatureKind;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::rc::Rc;

/// Kinds of objects that are read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct KindFilter {
    /// Only these; all if empty.
    pub only: Vec<FeatureKind>,
    /// None of these.
    pub skip: Vec<FeatureKind>,
}

impl KindFilter {
    /// Whether objects of a kind are read. Parts belong to their buildings unless they are named.
    #[must_use]
    pub fn contains(&self, kind: FeatureKind) -> bool {
        let is_in = |kinds: &[FeatureKind]| {
            kinds.contains(&kind) || kind == FeatureKind::BuildingPart && kinds.contains(&FeatureKind::Building)
        };
        (self.only.is_empty() || is_in(&self.only)) && !is_in(&self.skip)
    }
}

/// Kind of an object. It decides the colour where the source gives none, and how columns are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum ObjectKind {
    /// Anything with a volume: a building, a bridge, furniture.
    #[default]
    Building,
    /// The ground. It is one-sided: its underside neither blocks rays nor is visible.
    Terrain,
    /// Terrain that no source gives.
    GeneratedGround,
}

impl ObjectKind {
    /// Whether it is ground, given or generated.
    #[must_use]
    pub fn is_terrain(self) -> bool {
        self != Self::Building
    }
}

/// One object of a source.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceObject {
    /// The source's own identifier: gml:id, CityJSON key, feature id. Never empty: a reader without one counts (`feature 7`).
    pub id: String,
    /// Identifier of the object that this is a part of.
    pub parent: Option<String>,
    pub kind: FeatureKind,
    /// The source's own name of the type, such as `bldg:Building` or `building=yes`, for the report.
    pub source_type: String,
    /// Level of detail of `shape`, if the source has levels.
    pub lod: Option<f32>,
    pub attributes: Attributes,
    pub shape: Shape,
}

/// Geometry of an object, in the coordinate system that was set last with [`ObjectSink::set_crs`].
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// The object only groups others or has attributes. With a level of detail, it has a shape of that level, which is left
    /// out because related objects have better ones.
    None,
    /// Surfaces in space.
    Surfaces { polygons: Vec<Surface>, meshes: Vec<TriangleMesh> },
    /// Areas on the map. Those of buildings are extruded, with height, roof and colours by the attributes; others are laid on
    /// the ground.
    Footprints(Vec<Footprint>),
    /// Lines with a width, laid on the ground: roads, rails, rivers.
    Strips(Vec<Strip>),
    /// Points on the ground: trees, street lamps.
    Points(Vec<PointOnGround>),
}

/// A planar polygon in space. Counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// The outer ring, then the holes, without the repeated last point of a closed ring.
    pub points: Vec<[f64; 3]>,
    /// Index of the first point of each hole, ascending.
    pub hole_starts: Vec<u32>,
    /// Texture coordinates with v up, one for each point; empty without a texture.
    pub uv: Vec<[f32; 2]>,
    /// Number returned by [`ObjectSink::add_material`].
    pub material: Option<u32>,
    pub role: SurfaceRole,
    /// What the surface is in CityJSON's words, such as `OuterFloorSurface`, where no role says it. Palettes may name it.
    pub semantic: Option<Rc<str>>,
    /// Line of the source, from 1, by which faults of the surface are reported; 0 for its object's identifier.
    pub line: u64,
}

/// Places of the rings among the points of a polygon: the outer one, then those of the holes.
pub fn ring_ranges(points: usize, hole_starts: &[u32]) -> impl Iterator<Item = Range<usize>> {
    let starts = hole_starts.iter().map(|start| *start as usize);
    let ends = starts.clone().chain([points]);
    [0].into_iter().chain(starts).zip(ends).map(|(start, end)| start..end)
}

/// Which part of a building a surface is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SurfaceRole {
    Roof,
    Wall,
    Ground,
    Window,
    Door,
    /// Not known; the slope decides.
    #[default]
    Other,
}

impl SurfaceRole {
    /// The role of a semantic surface of CityJSON; `Other` for those that are no role.
    pub fn of_cityjson_semantic(name: &str) -> Self {
        let roles = [Self::Roof, Self::Wall, Self::Ground, Self::Window, Self::Door];
        roles.into_iter().find(|role| role.cityjson_semantic() == Some(name)).unwrap_or(Self::Other)
    }

    /// The semantic surface of CityJSON by which palettes name the role; `None` if the role is not known.
    pub fn cityjson_semantic(self) -> Option<&'static str> {
        match self {
            Self::Roof => Some("RoofSurface"),
            Self::Wall => Some("WallSurface"),
            Self::Ground => Some("GroundSurface"),
            Self::Window => Some("Window"),
            Self::Door => Some("Door"),
            Self::Other => None,
        }
    }
}

/// Triangles with shared vertices.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    pub positions: Vec<[f64; 3]>,
    /// Texture coordinates with v up, one for each position; empty without a texture.
    pub uv: Vec<[f32; 2]>,
    /// 8-bit sRGB, one for each position, multiplied with the material's; empty without.
    pub colours: Vec<[u8; 3]>,
    /// Indices into `positions`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Number returned by [`ObjectSink::add_material`].
    pub material: Option<u32>,
}

/// An area on the map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Footprint {
    /// The outer ring, then the holes, in any orientation, closed or not: the bake repairs rings.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// Height of the ground, of an area at its lowest corner, in the vertical system of the source; `None` if the source does not tell.
    pub ground: Option<f64>,
    /// Whether it stands on another object: a canopy then has no posts.
    pub is_supported: bool,
}

/// A point on the ground.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PointOnGround {
    pub place: [f64; 2],
    /// As [`Footprint::ground`].
    pub ground: Option<f64>,
}

impl From<[f64; 2]> for PointOnGround {
    fn from(place: [f64; 2]) -> Self {
        Self { place, ground: None }
    }
}

/// A line with a width.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Strip {
    pub points: Vec<[f64; 2]>,
    /// Heights of the points, in the vertical system of the source; empty if the source does not tell.
    pub heights: Vec<f64>,
    pub width_m: f64,
}

/// Colour and texture of surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceMaterial {
    /// The source's name of the material. Palettes may name it, and its words tell water, glass and openings.
    pub name: Option<Rc<str>>,
    /// 8-bit sRGB; multiplied with the texture if there is one.
    pub rgb: Option<[u8; 3]>,
    /// 8-bit sRGB of surfaces that do not show the texture, because it is missing or they have no place in it; `None` for `rgb`.
    pub untextured_rgb: Option<[u8; 3]>,
    pub texture: Option<SourceTexture>,
    /// 0 (invisible) to 1 (opaque).
    pub opacity: f32,
    /// Texels with less alpha than this are holes; `None` if the texture's alpha has no meaning.
    pub alpha_cutoff: Option<f32>,
    /// 0 (glass) to 1 (matt); `None` if the source does not tell.
    pub roughness: Option<f32>,
    /// 0 to 1; `None` if the source does not tell.
    pub metallic: Option<f32>,
    /// Whether no palette changes the colour.
    pub is_exact: bool,
}

impl Default for SourceMaterial {
    fn default() -> Self {
        Self {
            name: None,
            rgb: None,
            untextured_rgb: None,
            texture: None,
            opacity: 1.0,
            alpha_cutoff: None,
            roughness: None,
            metallic: None,
            is_exact: false,
        }
    }
}

/// A component of a colour from 0 to 1 as 8 bits.
pub fn unit_to_byte(component: f64) -> u8 {
    (component.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// An image, and what is outside of it.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceTexture {
    pub image: SourceImage,
    pub wrap: Wrap,
}

/// Where an image comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceImage {
    /// A file, by its path relative to the source (decoded: no `%20`), with `/`.
    File(String),
    /// An encoded image (PNG, JPEG, WebP) within the source, with a name that is unique in it.
    Encoded { name: String, bytes: Rc<[u8]> },
    /// Decoded texels, for formats that the bake does not decode (KTX2): `width * height` of 8-bit sRGB with alpha, from the top.
    Texels { name: String, width: u32, height: u32, rgba: Rc<[[u8; 4]]> },
}

/// Texels with less alpha are holes, where a format tells no other number.
pub const ALPHA_CUTOFF: f32 = 0.5;

/// What texture coordinates outside of 0 to 1 mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Wrap {
    #[default]
    Repeat,
    Mirror,
    Clamp,
    /// The surface has no texture there.
    None,
}

impl Wrap {
    /// By the mode that CityGML and CityJSON name.
    pub fn of_citygml(mode: &str) -> Self {
        match mode {
            "mirror" => Self::Mirror,
            "clamp" => Self::Clamp,
            "none" | "border" => Self::None,
            _ => Self::Repeat,
        }
    }
}

/// The least alpha of what is drawn of an image of a city model. PNG files have holes where leaves and fences end, of which CityGML and
/// CityJSON say nothing.
pub fn png_cutoff(image: &str) -> Option<f32> {
    image.to_ascii_lowercase().ends_with(".png").then_some(ALPHA_CUTOFF)
}

/// Order of the coordinates of the positions that a reader passes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisOrder {
    /// As the EPSG registry defines the system, such as latitude first for EPSG:4326 and EPSG:6697. For GML.
    Authority,
    /// East (or longitude) first, whatever the registry says. For OpenStreetMap and rasters.
    EastFirst,
    /// East (or longitude) first as most writers have it, although some follow the registry. For vector formats, and CityJSON in
    /// projected systems.
    MostlyEastFirst,
}

impl AxisOrder {
    /// Whether all writers of the format have this order.
    pub fn is_fixed(self) -> bool {
        self == Self::EastFirst
    }
}

/// A coordinate system as a source names it.
#[derive(Debug, Clone, PartialEq)]
pub struct CrsReference {
    /// `EPSG:7415`, a URN, a URL, WKT, PROJJSON or the name of an agency; `ECEF` for geocentric WGS84 in metres.
    pub name: String,
    pub order: AxisOrder,
    /// Metres in a unit of heights, if the source tells it besides the system.
    pub height_unit_m: Option<f64>,
}

impl CrsReference {
    /// A system whose coordinates are in the order of the registry.
    pub fn authority(name: impl Into<String>) -> Self {
        Self { name: name.into(), order: AxisOrder::Authority, height_unit_m: None }
    }

    /// A system whose coordinates are east (or longitude) first.
    pub fn east_first(name: impl Into<String>) -> Self {
        Self { name: name.into(), order: AxisOrder::EastFirst, height_unit_m: None }
    }
}

/// Text of a source about itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Description {
    Title,
    Attribution,
    Licence,
}

/// The building of which an object is a part, at any depth. All its parts look alike.
#[derive(Debug, Clone, Copy)]
pub struct WholeBuilding<'a> {
    pub id: &'a str,
    /// They tell its use.
    pub attributes: &'a Attributes,
}

/// Receives what a reader finds.
pub trait ObjectSink {
    /// Sets the coordinate system of all following objects. Readers call it before the first object, and again when it changes.
    /// Without a call, positions are metres of an unknown place. Fails if positions of it cannot be placed.
    fn set_crs(&mut self, crs: &CrsReference) -> Result<(), InputError>;

    /// Number of a material. Equal ones may be added again.
    fn add_material(&mut self, material: SourceMaterial) -> u32;

    /// Takes an object. Fails only if the whole bake must end.
    fn add(&mut self, object: SourceObject) -> Result<(), InputError>;

    /// As [`Self::add`], of an object that looks as a whole building does. Of others, the parent is the whole, if there is one,
    /// and the object's own attributes tell the use.
    fn add_part(&mut self, object: SourceObject, _: WholeBuilding<'_>) -> Result<(), InputError> {
        self.add(object)
    }

    /// Counts an object that is left out. `detail` starts with its identifier, or its place such as `line 7`.
    fn skip(&mut self, reason: &'static str, detail: String);

    /// Counts an object that became a part of another one. `detail` is its identifier.
    fn merge(&mut self, reason: &'static str, detail: String) {
        self.problem(reason, detail);
    }

    /// Counts a fault that costs only a part of an object, such as a polygon or a texture.
    fn problem(&mut self, kind: &'static str, detail: String);

    /// Notes a text of the source about itself.
    fn describe(&mut self, what: Description, text: &str);

    /// Reports progress: bytes of the source's file that are done. Cheap; call it now and then.
    fn tick(&mut self, bytes_done: u64);
}
