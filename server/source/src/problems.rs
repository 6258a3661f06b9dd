//! Kinds of problems that readers, the bake and the report name.

/// Kind of the problem that places are less exact than they could be.
pub const INEXACT: &str = "coordinates less exact than possible";
/// Kind of the problem that an elevation model has heights that are none on land.
pub const MISSING_HEIGHTS: &str = "heights out of range, taken as missing";
/// Kind of the problem that an elevation model is too large to be read at all of its points.
pub const COARSE_TERRAIN: &str = "elevation model too large, its terrain is coarser";
/// Kind of the problem that an elevation model has heights of exactly 0 far below all others.
pub const ODD_ZEROS: &str = "heights of exactly 0 far below all others, taken as heights";
/// Kind of the problem that flat areas have heights of exactly 0 everywhere, as sources write it that know none.
pub const ZERO_HEIGHTS: &str = "flat areas at a height of exactly 0 laid on the ground";
/// Kind of the problem that a position of a map has a height that is none on land.
pub const MISSING_GROUND: &str = "height of the ground out of range, taken as missing";
/// Kind of the problem that a source names no coordinate system.
pub const NO_CRS: &str = "coordinate system not given";
/// Kind of the problem that an object has surfaces in several coordinate systems.
pub const SEVERAL_SYSTEMS: &str = "surfaces of one object in several coordinate systems, all taken in the first one";
/// Reason for leaving out objects that are too far from the others.
pub const FAR: &str = "far from the city";
/// Reason for leaving out objects that a proposal removes.
pub const REMOVED: &str = "removed by the proposal";
/// Kind of the problem that few objects make the city wide.
pub const WIDE: &str = "few objects far away that make the city more than twice as wide";
/// Kind of the problem that coordinates are in another order than declared.
pub const SWAPPED: &str = "coordinates in another order than declared";
/// Kind of the problem that coordinates may be in either order.
pub const EITHER_ORDER: &str = "order of coordinates assumed, both are plausible";
/// Kind of the problem that an order was assumed in which bodies are a mirror image.
pub const MIRRORED: &str = "bodies inside out in the order that is assumed, the other one is likely";
/// Kind of the problem that coordinates do not fit the system.
pub const OUTSIDE: &str = "position outside of the area of use of the coordinate system";
/// Reason for leaving out an area of which no ring has three corners far enough apart.
pub const FEW_CORNERS: &str = "ring of fewer than three corners";
/// Note of a height of which nothing is known.
pub const GUESSED: &str = "height guessed";
/// Note of a value that should be a height, and is none.
pub const NOT_UNDERSTOOD: &str = "height not understood";
/// Note of a base that is not below the top.
pub const BASE_ABOVE_TOP: &str = "base not below the top, taken as 0";
/// Note of an attribute with several values, of which one is wanted.
pub const SEVERAL_VALUES: &str = "several values in one attribute, the first counts";
/// Note of a height by storeys.
pub const GUESSED_FROM_LEVELS: &str = "height guessed from levels";
/// Note of a height whose unit is not told.
pub const UNIT_GUESSED: &str = "unit of heights guessed";
/// Note of the base of a building that only a cut name tells.
pub const CUT_NAME: &str = "base of a building by a name that a Shapefile has cut";
/// Note of a height above sea level without that of the ground.
pub const NO_GROUND_HEIGHT: &str = "height above sea level without that of the ground, taken as above the ground";
/// Kind of the problem that heights are above a ground that the source does not tell.
pub const RELATIVE_HEIGHTS: &str = "heights relative to the ground, taken as above sea level";
/// Kinds of the problems of a coastline: the map is too wide for it.
pub const TOO_WIDE: &str = "coast of a map that is wider than 1 degree, no sea made: give --bbox";
/// It has a gap.
pub const GAP: &str = "gap in the coastline, closed by a straight line";
/// It ends within the map.
pub const OPEN_END: &str = "coastline ends within the map, drawn straight on to the border";
/// Both of its sides are alike.
pub const CONTRADICTION: &str = "coastline with land on both sides, or water, left out";
/// It has too many nodes.
pub const TOO_MANY: &str = "coastline with too many nodes, no sea made";
/// Reason for leaving out a coastline in a format of which no sea is made.
pub const NO_SEA: &str =
    "coastline of a GIS format, no sea made: give the map of OpenStreetMap itself (.osm, .osm.pbf)";
/// Kinds of the problems that attributes or features are lost with the table that they are in: there is none.
pub const NO_ATTRIBUTES: &str = "no attributes";
/// It cannot be read.
pub const DAMAGED_ATTRIBUTES: &str = "damaged attributes";
/// It ends early.
pub const FEWER_ATTRIBUTES: &str = "fewer attributes than shapes";
/// The file of its memo columns is missing or damaged.
pub const NO_MEMOS: &str = "texts of memo columns not read";
/// A column of it is of a type that is not read.
pub const NO_COLUMN: &str = "column of a type that is not read";
/// It is none of features that may be read.
pub const NO_TABLE: &str = "view, virtual or missing table not read";
/// Kind of the problem that texts are in an encoding that nothing tells.
pub const ENCODING_GUESSED: &str = "encoding of texts guessed";
/// Kind of the problem that a comma in numbers may be before decimals, or between groups of digits.
pub const MARK_GUESSED: &str = "comma in numbers guessed";
/// Kind of the problem that a picture from above has nothing to lie on.
pub const PICTURE_ALONE: &str = "picture without an elevation model, not drawn";
/// Kind of the problem that it is of another place.
pub const FAR_PICTURE: &str = "picture from above far from the city, not drawn";
/// Kind of the problem that an elevation model is of another place.
pub const FAR_TERRAIN: &str = "elevation model far from the city, no terrain made";
/// Kind of the problem that the kind of areas is known only from the name of their layer or file.
pub const KIND_BY_NAME: &str = "kind of areas guessed by the name of their layer, which no attribute confirms";
/// Kind of the problem that areas have heights, but the name of their layer tells another kind.
pub const KIND_AGAINST_NAME: &str = "areas with heights taken as buildings, against the name of their layer";
/// Kind of the problem that only a column tells that points are trees, and it may be that of other plants or of animals.
pub const TREES_BY_COLUMN: &str = "points taken as trees by a column of species";
/// Kind of the problem that points are neither trees nor told to be anything else.
pub const UNKNOWN_POINT: &str = "point of unknown kind, not drawn: only those of trees are";
/// Kind of the problem that a tree is lower or higher than trees are.
pub const TREE_HEIGHT: &str = "height of a tree out of range, taken as unknown";
/// Kind of the problem that a mesh is in another unit than metres, as a comment or its size suggest.
pub const MESH_UNIT: &str = "coordinates of a mesh may not be in metres";
/// Kind of the problem that vertices of CityJSON are the numbers before a transform that the file lacks.
pub const NO_TRANSFORM: &str = "vertices look as if a transform were missing, taken as metres";
/// Kind of the problem that a mesh whose z axis is taken to point up looks as if y did.
pub const MESH_UP: &str = "mesh looks as if its y axis points up";
/// Kind of the problem that a glTF, whose y axis points up, looks as if z did.
pub const GLTF_UP: &str = "glTF looks as if its z axis points up";
/// Kind of the problem, and reason, that the interior of buildings, bridges and tunnels is left out.
pub const INTERIOR: &str = "rooms and what is in them left out";
/// Kind of the problem that a table is not read, because another one has its objects in more detail.
pub const COARSER_TABLE: &str = "table not read, another one has the same in more detail";
/// Kind of the problem that a model has parts of a kind that is not read.
pub const PART_NOT_READ: &str = "part of a model not read";
/// Kind of the problem that a program has not yet written its changes to a database.
pub const UNSAVED: &str = "changes beside a database not read";
/// Kind of the problem that a GIS format has outlines of buildings of OpenStreetMap and their parts, of which only its own files tell which
/// belong together.
pub const OUTLINES_AND_PARTS: &str =
    "outlines of buildings drawn through their parts: give the map of OpenStreetMap itself (.osm, .osm.pbf)";

/// Kinds of the problems that an image of a texture is not read: there is none.
pub const TEXTURE_MISSING: &str = "texture missing";
/// It lies in another folder.
pub const TEXTURE_OUTSIDE: &str = "texture outside of the source's folder";
/// Its file cannot be read.
pub const TEXTURE_UNREADABLE: &str = "texture unreadable";
/// It is no image.
pub const TEXTURE_BROKEN: &str = "texture broken";
/// It has too many pixels.
pub const TEXTURE_TOO_LARGE: &str = "texture too large";
/// It is not fetched.
pub const TEXTURE_ON_THE_WEB: &str = "texture on the web";
/// What part of it belongs to which surface is told in a way that is not read.
pub const TEXTURE_NOT_MAPPED: &str = "texture of a kind that is not read";
/// Kind of the problem that the materials of an OBJ are lost.
pub const LIBRARY_MISSING: &str = "material library missing";
/// Reasons for leaving out a tile of a tileset: it cannot be read.
pub const TILE_UNREADABLE: &str = "tile cannot be read";
/// It is of another format.
pub const TILE_NOT_READ: &str = "tile has a format that is not read";
/// It lies elsewhere.
pub const TILE_NOT_FETCHED: &str = "tile is not fetched";
/// Those of a subtree cannot be read.
pub const SUBTREE_UNREADABLE: &str = "subtree cannot be read";

/// What is guessed, and worth a warning.
pub(crate) const GUESSES: &[&str] = &[
    SWAPPED, MIRRORED, OUTSIDE, NO_CRS, SEVERAL_SYSTEMS, UNIT_GUESSED, CUT_NAME, BASE_ABOVE_TOP, RELATIVE_HEIGHTS,
    SEVERAL_VALUES, ENCODING_GUESSED, MARK_GUESSED, NO_GROUND_HEIGHT, MISSING_HEIGHTS, COARSE_TERRAIN, ODD_ZEROS,
    ZERO_HEIGHTS, MISSING_GROUND, KIND_BY_NAME, KIND_AGAINST_NAME, TREES_BY_COLUMN, TREE_HEIGHT, NO_TRANSFORM,
    MESH_UNIT, MESH_UP, GLTF_UP, OUTLINES_AND_PARTS,
];
/// What is lost as a whole.
pub(crate) const LOSSES: &[&str] = &[
    NO_ATTRIBUTES, DAMAGED_ATTRIBUTES, FEWER_ATTRIBUTES, NO_MEMOS, NO_COLUMN, NO_TABLE, UNSAVED, UNKNOWN_POINT, NO_SEA,
    COARSER_TABLE, PART_NOT_READ, PICTURE_ALONE, FAR_PICTURE, FAR_TERRAIN, TEXTURE_MISSING, TEXTURE_OUTSIDE, INTERIOR,
    TEXTURE_UNREADABLE, TEXTURE_BROKEN, TEXTURE_TOO_LARGE, TEXTURE_ON_THE_WEB, LIBRARY_MISSING, TILE_UNREADABLE,
    TILE_NOT_READ, TILE_NOT_FETCHED, SUBTREE_UNREADABLE, TEXTURE_NOT_MAPPED,
];
