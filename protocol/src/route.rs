//! The server's addresses: parsed, built and classified in one place.
//!
//! Addresses are never percent-decoded. Names and numbers have one spelling each, so every resource has one address and
//! caches hold it once.

use crate::name::is_name;
use crate::object_tile::{self, SCHEMA_ID};
use crate::{TileGroup, TileId, TileKind, mesh_tile};
use std::borrow::Cow;
use std::fmt;

mod template;

pub use template::RouteTemplate;

/// The list of cities, and the prefix of all addresses of a city.
pub const CITIES: &str = "/v1/cities";
const OPENAPI: &str = "/v1/openapi.json";
const HEALTH: &str = "/healthz";
const READINESS: &str = "/readyz";
const METRICS: &str = "/metrics";
/// What precedes the files of a tileset in the format 3D Tiles.
const TILESETS: &str = "/3dtiles/";
const TILESET_FILE: &str = "tileset.json";
/// Stands for a block's number in the address of the objects' schema.
const SCHEMA: &str = "schema";
const PAGES: &str = "/cities";
/// What follows a city's version in the address of its search.
const SEARCH: &str = "search";
/// What follows a city's version in the address of a filter.
const FILTER: &str = "filter";
/// What follows a city's version in the address of a group.
const GROUPS: &str = "groups";
/// What follows a city in the address of its drawings.
const DRAW: &str = "draw";
/// What follows a city in the address of its analyses.
const ANALYSE: &str = "analyse";
/// What follows a city in the address of its proposals, and their file in a published city.
pub const PROPOSALS_FILE: &str = "proposals.json";
const ASSETS: &str = "/assets";
const SERVICE_WORKER: &str = "/service-worker.js";
/// Name of a city's picture, in its folder and after the address of its page.
pub const THUMBNAIL_FILE: &str = "thumbnail.jpg";
/// Most parts of a path between slashes.
const MAX_SEGMENTS: usize = 11;
/// Width and height of a city's picture in pixels.
pub const THUMBNAIL_PX: [u32; 2] = [1280, 720];

/// An address of the server. Its `Display` is the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Route<'a> {
    /// The page for people.
    Index,
    /// The description of the HTTP interface.
    OpenApi,
    /// Whether the server runs.
    Health,
    /// Whether it has cities to serve.
    Readiness,
    /// Its counters.
    Metrics,
    /// The list of cities.
    Cities,
    /// The manifest of a city.
    Manifest { city: &'a str },
    /// The page of a city for people.
    CityPage { city: &'a str },
    /// A small picture of a city.
    Thumbnail { city: &'a str },
    /// A file of the browser viewer ([`is_asset_name`]), immutable under the hash of all its files.
    Asset { hash: &'a str, file: &'a str },
    /// The script that keeps pages and tiles for use without a network. It must lie above all that it keeps.
    ServiceWorker,
    /// A tile of a city.
    Tile(TileRoute<'a>),
    /// Several tiles ([`crate::tile_group`]).
    Group { city: &'a str, version: &'a str, group: TileGroup },
    /// The search of a city's objects by their texts. The query has the text.
    Search { city: &'a str, version: &'a str },
    /// Which of a city's objects pass a filter. The query has the filter.
    Filter { city: &'a str, version: &'a str },
    /// Vector drawings of a city, which are made of the body of a POST request.
    Draw { city: &'a str },
    /// Analyses of a part of a city, which are made of the body of a POST request.
    Analyse { city: &'a str },
    /// What the proposals of a city add to it and remove from it.
    Proposals { city: &'a str },
    /// The root of a city's tileset in the format 3D Tiles.
    Tileset { city: &'a str },
    /// A file of such a tileset.
    TilesetFile { city: &'a str, version: &'a str, kind: TilesetFileKind, id: TileId },
}

/// A kind of file of a tileset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TilesetFileKind {
    /// Which tiles exist, `subtrees/{level}/{x}/{y}.subtree`.
    Subtree,
    /// The surfaces of a node, `content/{level}/{x}/{y}.glb`.
    Content,
}

impl TilesetFileKind {
    /// Folder and extension of its files.
    const fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Subtree => ("subtrees", ".subtree"),
            Self::Content => ("content", ".glb"),
        }
    }
}

/// The address of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TileRoute<'a> {
    pub city: &'a str,
    /// The city's version ([`crate::Manifest::version`]).
    pub version: &'a str,
    pub kind: TileKind,
    /// The tile's node; of a mesh, its leaf; of objects, their place in the archive ([`object_tile`]).
    pub id: TileId,
    /// Level of detail of a mesh, below [`mesh_tile::MAX_LODS`]; 0 for other kinds.
    pub lod: u8,
}

/// Why a path is not a [`Route`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RouteError {
    /// The path has the shape of no address.
    #[error("the path matches no route")]
    Unknown,
    /// The path has the shape of a tile's address, but its numbers are invalid.
    #[error(
        "level, x, y and block must be plain decimal numbers, level at most 20, x and y below 2^level, lod at most 3"
    )]
    InvalidTile,
    /// The city or version is not a valid name ([`is_name`]).
    #[error("city and version must be 1 to 64 characters of a-z, 0-9, _ and -")]
    InvalidName,
}

impl<'a> Route<'a> {
    /// Parses the path of a URL, without query. Fails as [`RouteError`] says; invalid numbers come before invalid
    /// names.
    pub fn parse(path: &'a str) -> Result<Self, RouteError> {
        match path {
            "/" => return Ok(Self::Index),
            OPENAPI => return Ok(Self::OpenApi),
            HEALTH => return Ok(Self::Health),
            READINESS => return Ok(Self::Readiness),
            METRICS => return Ok(Self::Metrics),
            CITIES => return Ok(Self::Cities),
            SERVICE_WORKER => return Ok(Self::ServiceWorker),
            _ => {}
        }
        let mut all = [""; MAX_SEGMENTS];
        let mut count = 0;
        for segment in path.strip_prefix('/').ok_or(RouteError::Unknown)?.split('/') {
            *all.get_mut(count).ok_or(RouteError::Unknown)? = segment;
            count += 1;
        }
        let (route, names) = match all[..count] {
            ["assets", hash, file] if is_name(hash) && is_asset_name(file) => return Ok(Self::Asset { hash, file }),
            ["cities", city] => (Self::CityPage { city }, [city; 2]),
            ["cities", city, THUMBNAIL_FILE] => (Self::Thumbnail { city }, [city; 2]),
            ["v1", "cities", city] => (Self::Manifest { city }, [city; 2]),
            ["v1", "cities", city, "3dtiles", TILESET_FILE] => (Self::Tileset { city }, [city; 2]),
            ["v1", "cities", city, "3dtiles", version, folder, level, x, y] => {
                let (kind, id) = parse_tileset_file(folder, [level, x, y])?;
                (Self::TilesetFile { city, version, kind, id }, [city, version])
            }
            ["v1", "cities", _, "3dtiles", ..] => return Err(RouteError::Unknown),
            ["v1", "cities", city, DRAW] => (Self::Draw { city }, [city; 2]),
            ["v1", "cities", city, ANALYSE] => (Self::Analyse { city }, [city; 2]),
            ["v1", "cities", city, PROPOSALS_FILE] => (Self::Proposals { city }, [city; 2]),
            ["v1", "cities", city, version, SEARCH] => (Self::Search { city, version }, [city, version]),
            ["v1", "cities", city, version, FILTER] => (Self::Filter { city, version }, [city, version]),
            ["v1", "cities", city, version, GROUPS, kind, level, x, y, nodes, lod] => {
                let group = parse_group(kind, [level, x, y], nodes, lod).ok_or(RouteError::InvalidTile)?;
                (Self::Group { city, version, group }, [city, version])
            }
            ["v1", "cities", city, version, kind, ref place @ ..] => {
                let (kind, id, lod) = parse_tile(kind, place)?;
                (Self::Tile(TileRoute { city, version, kind, id, lod }), [city, version])
            }
            _ => return Err(RouteError::Unknown),
        };
        if names.into_iter().all(is_name) { Ok(route) } else { Err(RouteError::InvalidName) }
    }

    /// The path of the address.
    pub fn path(&self) -> String {
        self.to_string()
    }

    /// The kind of address.
    pub const fn template(&self) -> RouteTemplate {
        match self {
            Self::Index => RouteTemplate::Index,
            Self::OpenApi => RouteTemplate::OpenApi,
            Self::Health => RouteTemplate::Health,
            Self::Readiness => RouteTemplate::Readiness,
            Self::Metrics => RouteTemplate::Metrics,
            Self::Cities => RouteTemplate::Cities,
            Self::Manifest { .. } => RouteTemplate::Manifest,
            Self::CityPage { .. } => RouteTemplate::CityPage,
            Self::Thumbnail { .. } => RouteTemplate::Thumbnail,
            Self::Asset { .. } => RouteTemplate::Asset,
            Self::ServiceWorker => RouteTemplate::ServiceWorker,
            Self::Tile(tile) => RouteTemplate::of_tile(tile.kind),
            Self::Search { .. } => RouteTemplate::Search,
            Self::Filter { .. } => RouteTemplate::Filter,
            Self::Group { .. } => RouteTemplate::Groups,
            Self::Draw { .. } => RouteTemplate::Draw,
            Self::Analyse { .. } => RouteTemplate::Analyse,
            Self::Proposals { .. } => RouteTemplate::Proposals,
            Self::Tileset { .. } => RouteTemplate::Tileset,
            Self::TilesetFile { .. } => RouteTemplate::TilesetFile,
        }
    }
}

impl fmt::Display for Route<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Index => f.write_str("/"),
            Self::OpenApi => f.write_str(OPENAPI),
            Self::Health => f.write_str(HEALTH),
            Self::Readiness => f.write_str(READINESS),
            Self::Metrics => f.write_str(METRICS),
            Self::Cities => f.write_str(CITIES),
            Self::Manifest { city } => write!(f, "{CITIES}/{city}"),
            Self::CityPage { city } => write!(f, "{PAGES}/{city}"),
            Self::Thumbnail { city } => write!(f, "{PAGES}/{city}/{THUMBNAIL_FILE}"),
            Self::Asset { hash, file } => write!(f, "{ASSETS}/{hash}/{file}"),
            Self::ServiceWorker => f.write_str(SERVICE_WORKER),
            Self::Search { city, version } => write!(f, "{CITIES}/{city}/{version}/{SEARCH}"),
            Self::Filter { city, version } => write!(f, "{CITIES}/{city}/{version}/{FILTER}"),
            Self::Draw { city } => write!(f, "{CITIES}/{city}/{DRAW}"),
            Self::Analyse { city } => write!(f, "{CITIES}/{city}/{ANALYSE}"),
            Self::Proposals { city } => write!(f, "{CITIES}/{city}/{PROPOSALS_FILE}"),
            Self::Tileset { city } => write!(f, "{CITIES}/{city}{TILESETS}{TILESET_FILE}"),
            Self::TilesetFile { city, version, kind, id } => {
                let (folder, extension) = kind.names();
                write!(f, "{CITIES}/{city}{TILESETS}{version}/{folder}/{id}{extension}")
            }
            Self::Group { city, version, group } => {
                let (kind, first) = (group.kind().path_segment(), group.first());
                write!(f, "{CITIES}/{city}/{version}/{GROUPS}/{kind}/{first}/{}/{}", group.node_count(), group.lod())
            }
            Self::Tile(TileRoute { city, version, kind, id, lod }) => {
                write!(f, "{CITIES}/{city}/{version}/{}/", kind.path_segment())?;
                if *kind == TileKind::Objects {
                    return match object_tile::block_number(*id) {
                        Some(block) => write!(f, "{block}"),
                        None => f.write_str(SCHEMA),
                    };
                }
                write!(f, "{id}")?;
                if *kind == TileKind::Mesh { write!(f, "/{lod}") } else { Ok(()) }
            }
        }
    }
}

/// The kind and node of `{kind}/{level}/{x}/{y}` with the extension of the kind.
fn parse_tileset_file(folder: &str, [level, x, y]: [&str; 3]) -> Result<(TilesetFileKind, TileId), RouteError> {
    let of_folder = |kind: &TilesetFileKind| kind.names().0 == folder;
    let kind = [TilesetFileKind::Subtree, TilesetFileKind::Content].into_iter().find(of_folder);
    let kind = kind.ok_or(RouteError::Unknown)?;
    let y = y.strip_suffix(kind.names().1).ok_or(RouteError::Unknown)?;
    Ok((kind, parse_node(level, x, y).ok_or(RouteError::InvalidTile)?))
}

fn parse_node(level: &str, x: &str, y: &str) -> Option<TileId> {
    TileId::new(u8::try_from(parse_number(level)?).ok()?, parse_number(x)?, parse_number(y)?)
}

/// Whether a file of the browser viewer can have this name: 1 to 64 of `a-z`, `0-9`, `.`, `_` and `-`, not beginning with a dot.
pub fn is_asset_name(name: &str) -> bool {
    let is_allowed = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"._-".contains(&byte);
    (1..=64).contains(&name.len()) && !name.starts_with('.') && name.bytes().all(is_allowed)
}

/// The kind, node and level of detail of `{kind}/{level}/{x}/{y}`, with `/{lod}` for meshes, and of `objects/{block}`.
fn parse_tile(kind: &str, place: &[&str]) -> Result<(TileKind, TileId, u8), RouteError> {
    let kind = TileKind::from_path_segment(kind).ok_or(RouteError::Unknown)?;
    let (id, lod) = match (kind, place) {
        (TileKind::Objects, [SCHEMA]) => (Some(SCHEMA_ID), Some(0)),
        (TileKind::Objects, [block]) => (parse_number(block).and_then(object_tile::block_id), Some(0)),
        (TileKind::Mesh, [level, x, y, lod]) => (parse_node(level, x, y), parse_lod(lod)),
        (TileKind::Subtree | TileKind::BlockMap | TileKind::Visibility, [level, x, y]) => {
            (parse_node(level, x, y), Some(0))
        }
        _ => return Err(RouteError::Unknown),
    };
    let (id, lod) = id.zip(lod).ok_or(RouteError::InvalidTile)?;
    Ok((kind, id, lod))
}

fn parse_lod(text: &str) -> Option<u8> {
    parse_number(text).and_then(|lod| u8::try_from(lod).ok()).filter(|lod| *lod < mesh_tile::MAX_LODS)
}

fn parse_group(kind: &str, [level, x, y]: [&str; 3], nodes: &str, lod: &str) -> Option<TileGroup> {
    let nodes = parse_number(nodes).filter(|nodes| nodes.is_power_of_two())?;
    let (kind, lod) = (TileKind::from_path_segment(kind)?, u8::try_from(parse_number(lod)?).ok()?);
    TileGroup::new(kind, parse_node(level, x, y)?, nodes.trailing_zeros() as u8, lod)
}

/// Parses decimal digits without sign or leading zeros.
fn parse_number(text: &str) -> Option<u32> {
    let is_plain = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
    if is_plain { text.parse().ok() } else { None }
}

/// The path of a city's manifest.
pub fn manifest(city: &str) -> String {
    Route::Manifest { city }.path()
}

/// The path of a block of objects.
pub fn objects(city: &str, version: &str, block: u32) -> Option<String> {
    Some(tile(city, version, TileKind::Objects, object_tile::block_id(block)?))
}

/// The path of the schema of a city's objects.
pub fn schema(city: &str, version: &str) -> String {
    tile(city, version, TileKind::Objects, SCHEMA_ID)
}

/// The path of the search of a city's objects, without its query.
pub fn search(city: &str, version: &str) -> String {
    Route::Search { city, version }.path()
}

/// The path of a filter of a city's objects, without its query.
pub fn filter(city: &str, version: &str) -> String {
    Route::Filter { city, version }.path()
}

/// The path of the root of a city's tileset in the format 3D Tiles.
pub fn tileset(city: &str) -> String {
    Route::Tileset { city }.path()
}

/// The path of a city's page.
pub fn city_page(city: &str) -> String {
    Route::CityPage { city }.path()
}

/// The path of a city's picture.
pub fn thumbnail(city: &str) -> String {
    Route::Thumbnail { city }.path()
}

/// The path of the folder of the browser viewer's files.
pub fn assets(hash: &str) -> String {
    format!("{ASSETS}/{hash}/")
}

/// The path of a subtree or V-BlockMap tile; of a mesh, its finest level of detail.
pub fn tile(city: &str, version: &str, kind: TileKind, id: TileId) -> String {
    Route::Tile(TileRoute { city, version, kind, id, lod: 0 }).path()
}

/// The path of a group of tiles.
pub fn group(city: &str, version: &str, group: TileGroup) -> String {
    Route::Group { city, version, group }.path()
}

/// The path of one level of detail of a leaf's mesh.
pub fn mesh(city: &str, version: &str, leaf: TileId, lod: u8) -> String {
    Route::Tile(TileRoute { city, version, kind: TileKind::Mesh, id: leaf, lod }).path()
}

/// The path of a tile by its id in the archive of a city of `depth` levels. `None` if a mesh cannot have this id.
pub fn archive_tile(city: &str, version: &str, kind: TileKind, id: TileId, depth: u8) -> Option<String> {
    match kind {
        TileKind::Mesh => mesh_tile::from_archive_id(id, depth).map(|(leaf, lod)| mesh(city, version, leaf, lod)),
        TileKind::Subtree | TileKind::BlockMap | TileKind::Objects | TileKind::Visibility => {
            Some(tile(city, version, kind, id))
        }
    }
}

/// Whether two URLs, written as the URL standard normalises them, are of one host and port, or the second is the encrypted
/// one of the first. Clients follow redirects only between such addresses: a host could otherwise lead them to addresses
/// that it cannot reach itself, such as those of their own machine and private network.
pub fn is_same_host(from: &str, to: &str) -> bool {
    let (Some((from_scheme, from)), Some((to_scheme, to))) = (scheme_and_host(from), scheme_and_host(to)) else {
        return false;
    };
    let has_port = from.rsplit(']').next().is_some_and(|end| end.contains(':'));
    let is_upgrade = (from_scheme, to_scheme) == ("http", "https") && !has_port;
    from == to && (from_scheme == to_scheme || is_upgrade)
}

/// The host of a URL, with the port if there is one.
pub fn host_of(url: &str) -> Option<&str> {
    scheme_and_host(url).map(|(_, host)| host)
}

/// An address as people may see it: without user, password, query and fragment, which may be secrets.
pub fn without_secrets(url: &str) -> Cow<'_, str> {
    let Some((scheme, rest)) = url.split_once("://") else { return Cow::Borrowed(url) };
    let plain = rest.split(['?', '#']).next().unwrap_or(rest);
    let (authority, path) = plain.split_at(plain.find('/').unwrap_or(plain.len()));
    match authority.rsplit_once('@') {
        None => Cow::Borrowed(&url[..scheme.len() + 3 + plain.len()]),
        Some((_, host)) => Cow::Owned(format!("{scheme}://{host}{path}")),
    }
}

/// The scheme of a URL, and its host with the port if there is one.
fn scheme_and_host(url: &str) -> Option<(&str, &str)> {
    let (scheme, rest) = url.split_once("://")?;
    let authority = rest.split(['/', '?', '#']).next()?;
    Some((scheme, authority.rsplit('@').next()?))
}
