//! Kinds of addresses, for the router and for metrics.

use super::{
    ANALYSE, CITIES, DRAW, FILTER, GROUPS, HEALTH, METRICS, OPENAPI, READINESS, SEARCH, SERVICE_WORKER, THUMBNAIL_FILE,
    TILESET_FILE,
};
use crate::TileKind;

/// A kind of address. As a metrics label it is bounded, whatever clients request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RouteTemplate {
    Subtrees,
    BlockMaps,
    Meshes,
    Objects,
    Visibility,
    Search,
    Filter,
    Groups,
    Draw,
    Analyse,
    Tileset,
    TilesetFile,
    Manifest,
    Cities,
    Index,
    OpenApi,
    Health,
    Readiness,
    Metrics,
    CityPage,
    Thumbnail,
    Asset,
    ServiceWorker,
    /// All paths without a route.
    Other,
}

impl RouteTemplate {
    /// All templates, in the order of their discriminants.
    pub const ALL: [Self; 24] = [
        Self::Subtrees,
        Self::BlockMaps,
        Self::Meshes,
        Self::Objects,
        Self::Visibility,
        Self::Search,
        Self::Filter,
        Self::Groups,
        Self::Draw,
        Self::Analyse,
        Self::Tileset,
        Self::TilesetFile,
        Self::Manifest,
        Self::Cities,
        Self::Index,
        Self::OpenApi,
        Self::Health,
        Self::Readiness,
        Self::Metrics,
        Self::CityPage,
        Self::Thumbnail,
        Self::Asset,
        Self::ServiceWorker,
        Self::Other,
    ];

    /// Classifies any path by its shape alone. Unlike [`super::Route::parse`] it also classifies addresses with invalid names
    /// or numbers, and counts everything below a tile kind as that kind, and everything below a search or filter as such.
    pub fn of_path(path: &str) -> Self {
        let mut segments = path.strip_prefix('/').unwrap_or(path).splitn(6, '/');
        let mut segment = || segments.next();
        match (segment(), segment(), segment(), segment(), segment()) {
            (Some("v1"), Some("cities"), Some(_), Some("3dtiles"), Some(TILESET_FILE)) => Self::Tileset,
            (Some("v1"), Some("cities"), Some(_), Some("3dtiles"), Some(_)) => Self::TilesetFile,
            (Some("v1"), Some("cities"), Some(_), Some(_), Some(SEARCH)) => Self::Search,
            (Some("v1"), Some("cities"), Some(_), Some(_), Some(FILTER)) => Self::Filter,
            (Some("v1"), Some("cities"), Some(_), Some(_), Some(GROUPS)) => Self::Groups,
            (Some("v1"), Some("cities"), Some(_), Some(_), Some(kind)) => {
                TileKind::from_path_segment(kind).map_or(Self::Other, Self::of_tile)
            }
            (Some("v1"), Some("cities"), Some(_), Some(DRAW), None) => Self::Draw,
            (Some("v1"), Some("cities"), Some(_), Some(ANALYSE), None) => Self::Analyse,
            (Some("v1"), Some("cities"), Some(_), None, None) => Self::Manifest,
            (Some("v1"), Some("cities"), None, None, None) => Self::Cities,
            (Some("v1"), Some("openapi.json"), None, None, None) => Self::OpenApi,
            (Some(""), None, None, None, None) => Self::Index,
            (Some("healthz"), None, None, None, None) => Self::Health,
            (Some("readyz"), None, None, None, None) => Self::Readiness,
            (Some("metrics"), None, None, None, None) => Self::Metrics,
            (Some("cities"), Some(_), None, None, None) => Self::CityPage,
            (Some("cities"), Some(_), Some(THUMBNAIL_FILE), None, None) => Self::Thumbnail,
            (Some("assets"), Some(_), Some(_), None, None) => Self::Asset,
            (Some("service-worker.js"), None, None, None, None) => Self::ServiceWorker,
            _ => Self::Other,
        }
    }

    pub(super) const fn of_tile(kind: TileKind) -> Self {
        match kind {
            TileKind::Subtree => Self::Subtrees,
            TileKind::BlockMap => Self::BlockMaps,
            TileKind::Mesh => Self::Meshes,
            TileKind::Objects => Self::Objects,
            TileKind::Visibility => Self::Visibility,
        }
    }

    /// The value of the `route` label in metrics.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Subtrees => "subtrees",
            Self::BlockMaps => "blockmaps",
            Self::Meshes => "meshes",
            Self::Objects => "objects",
            Self::Visibility => "visibility",
            Self::Search => SEARCH,
            Self::Filter => FILTER,
            Self::Groups => GROUPS,
            Self::Draw => DRAW,
            Self::Analyse => ANALYSE,
            Self::Tileset => "tileset",
            Self::TilesetFile => "tileset-files",
            Self::Manifest => "manifest",
            Self::Cities => "cities",
            Self::Index => "index",
            Self::OpenApi => "openapi",
            Self::Health => "healthz",
            Self::Readiness => "readyz",
            Self::Metrics => "metrics",
            Self::CityPage => "page",
            Self::Thumbnail => "thumbnail",
            Self::Asset => "asset",
            Self::ServiceWorker => "service-worker",
            Self::Other => "other",
        }
    }

    /// The path with its variable segments in braces; `None` for [`RouteTemplate::Other`].
    pub const fn pattern(self) -> Option<&'static str> {
        Some(match self {
            Self::Subtrees => "/v1/cities/{city}/{version}/subtrees/{level}/{x}/{y}",
            Self::BlockMaps => "/v1/cities/{city}/{version}/blockmaps/{level}/{x}/{y}",
            Self::Meshes => "/v1/cities/{city}/{version}/meshes/{level}/{x}/{y}/{lod}",
            Self::Objects => "/v1/cities/{city}/{version}/objects/{block}",
            Self::Visibility => "/v1/cities/{city}/{version}/visibility/{level}/{x}/{y}",
            Self::Search => "/v1/cities/{city}/{version}/search",
            Self::Filter => "/v1/cities/{city}/{version}/filter",
            Self::Groups => "/v1/cities/{city}/{version}/groups/{kind}/{level}/{x}/{y}/{count}/{lod}",
            Self::Draw => "/v1/cities/{city}/draw",
            Self::Analyse => "/v1/cities/{city}/analyse",
            Self::Tileset => "/v1/cities/{city}/3dtiles/tileset.json",
            Self::TilesetFile => "/v1/cities/{city}/3dtiles/{version}/{kind}/{level}/{x}/{y}",
            Self::Manifest => "/v1/cities/{city}",
            Self::Cities => CITIES,
            Self::Index => "/",
            Self::OpenApi => OPENAPI,
            Self::Health => HEALTH,
            Self::Readiness => READINESS,
            Self::Metrics => METRICS,
            Self::CityPage => "/cities/{city}",
            Self::Thumbnail => "/cities/{city}/thumbnail.jpg",
            Self::Asset => "/assets/{hash}/{file}",
            Self::ServiceWorker => SERVICE_WORKER,
            Self::Other => return None,
        })
    }

    /// Whether the address is for operators. These stay available under load and have no rate limit.
    pub const fn is_operational(self) -> bool {
        matches!(self, Self::Health | Self::Readiness | Self::Metrics)
    }
}
