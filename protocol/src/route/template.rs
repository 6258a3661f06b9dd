//! Kinds of addresses, for the router and for metrics.

use super::{
    ANALYSE, CITIES, DRAW, FILTER, GROUPS, HEALTH, METRICS, OPENAPI, PROPOSALS_FILE, READINESS, SEARCH, SERVICE_WORKER,
    THUMBNAIL_FILE, TILESET_FILE,
};
use crate::TileKind;

/// Declares each kind of address once: its name, its label in metrics, its path with variable segments in braces.
macro_rules! templates {
    ($($name:ident $label:expr, $pattern:expr;)*) => {
        /// A kind of address. As a metrics label it is bounded, whatever clients request.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum RouteTemplate {
            $($name,)*
            /// All paths without a route.
            Other,
        }

        impl RouteTemplate {
            /// All templates, in the order of their discriminants.
            pub const ALL: [Self; 25] = [$(Self::$name,)* Self::Other];

            /// The value of the `route` label in metrics.
            pub const fn label(self) -> &'static str {
                match self {
                    $(Self::$name => $label,)*
                    Self::Other => "other",
                }
            }

            /// The path with its variable segments in braces; `None` for [`RouteTemplate::Other`].
            pub const fn pattern(self) -> Option<&'static str> {
                match self {
                    $(Self::$name => Some($pattern),)*
                    Self::Other => None,
                }
            }
        }
    };
}

templates! {
    Subtrees "subtrees", "/v1/cities/{city}/{version}/subtrees/{level}/{x}/{y}";
    BlockMaps "blockmaps", "/v1/cities/{city}/{version}/blockmaps/{level}/{x}/{y}";
    Meshes "meshes", "/v1/cities/{city}/{version}/meshes/{level}/{x}/{y}/{lod}";
    Objects "objects", "/v1/cities/{city}/{version}/objects/{block}";
    Visibility "visibility", "/v1/cities/{city}/{version}/visibility/{level}/{x}/{y}";
    Search SEARCH, "/v1/cities/{city}/{version}/search";
    Filter FILTER, "/v1/cities/{city}/{version}/filter";
    Groups GROUPS, "/v1/cities/{city}/{version}/groups/{kind}/{level}/{x}/{y}/{count}/{lod}";
    Draw DRAW, "/v1/cities/{city}/draw";
    Analyse ANALYSE, "/v1/cities/{city}/analyse";
    Proposals "proposals", "/v1/cities/{city}/proposals.json";
    Tileset "tileset", "/v1/cities/{city}/3dtiles/tileset.json";
    TilesetFile "tileset-files", "/v1/cities/{city}/3dtiles/{version}/{kind}/{level}/{x}/{y}";
    Manifest "manifest", "/v1/cities/{city}";
    Cities "cities", CITIES;
    Index "index", "/";
    OpenApi "openapi", OPENAPI;
    Health "healthz", HEALTH;
    Readiness "readyz", READINESS;
    Metrics "metrics", METRICS;
    CityPage "page", "/cities/{city}";
    Thumbnail "thumbnail", "/cities/{city}/thumbnail.jpg";
    Asset "asset", "/assets/{hash}/{file}";
    ServiceWorker "service-worker", SERVICE_WORKER;
}

impl RouteTemplate {
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
            (Some("v1"), Some("cities"), Some(_), Some(PROPOSALS_FILE), None) => Self::Proposals,
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

    /// Whether the address is for operators. These stay available under load and have no rate limit.
    pub const fn is_operational(self) -> bool {
        matches!(self, Self::Health | Self::Readiness | Self::Metrics)
    }
}
