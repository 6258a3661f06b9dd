//! Documents by which catalogues and GIS find the cities of a site: static STAC, and collections as OGC API - 3D GeoVolumes has them.
//!
//! ```text
//! catalog.json             STAC catalogue of the site
//! cities/NAME/item.json    STAC item of a city
//! collections.json         list of the cities for GeoVolumes
//! collections/NAME.json    a city of it
//! ```
//!
//! Links are relative, so that the documents are right wherever the site is.

mod geovolumes;
mod stac;
#[cfg(test)]
mod tests;

use insula_archive::city::{MANIFEST_FILE, SEARCH_FILE};
use insula_archive::owned::FileMark;
use insula_protocol::manifest::Attribution;
use insula_protocol::route::THUMBNAIL_FILE;
use insula_protocol::{Manifest, TileKind};
use serde_json::{Value, json};
use std::time::SystemTime;

/// Folder of a city's tileset in the folder of the city.
#[cfg(feature = "bake")]
pub(crate) const TILESET_FOLDER: &str = "3dtiles";
/// What of it programs open.
const TILESET_FILE: &str = "3dtiles/tileset.json";

/// A city as documents describe it.
#[derive(Debug)]
pub(crate) struct CityRecord<'a> {
    pub(crate) manifest: &'a Manifest,
    /// A sentence.
    pub(crate) description: String,
    /// See [`extent`].
    pub(crate) extent: Option<[f64; 6]>,
    /// When it was baked.
    pub(crate) time: SystemTime,
    /// Those of [`city_files`] that it has.
    pub(crate) files: Vec<(CityFile, FileMark)>,
}

/// A file of a city's folder.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CityFile {
    pub(crate) name: &'static str,
    /// Its key among the assets of an item.
    key: &'static str,
    title: &'static str,
    media_type: &'static str,
    role: &'static str,
}

/// The files that a city may have.
pub(crate) fn city_files() -> impl Iterator<Item = CityFile> {
    let archives = TileKind::ALL.into_iter().map(|kind| {
        let (key, title) = match kind {
            TileKind::Subtree => ("subtrees", "Which parts exist at which level of detail"),
            TileKind::BlockMap => ("blockmaps", "The city in columns, at all levels of detail"),
            TileKind::Mesh => ("meshes", "Surfaces for near views"),
            TileKind::Objects => ("objects", "Attributes of the city's objects"),
            TileKind::Visibility => ("visibility", "What can be seen from streets"),
        };
        CityFile { name: kind.file_name(), key, title, media_type: "application/vnd.pmtiles", role: "data" }
    });
    let file = |name, key, title, media_type, role| CityFile { name, key, title, media_type, role };
    let others = [
        file(MANIFEST_FILE, "manifest", "What viewers read first", "application/json", "metadata"),
        file(SEARCH_FILE, "search", "Index of names and addresses", "application/octet-stream", "metadata"),
        file(TILESET_FILE, "tileset", "3D Tiles 1.1", "application/json", "data"),
        file(THUMBNAIL_FILE, "thumbnail", "The city from above", "image/jpeg", "thumbnail"),
    ];
    archives.chain(others)
}

impl CityRecord<'_> {
    fn has(&self, name: &str) -> bool {
        self.files.iter().any(|(file, _)| file.name == name)
    }

    /// The extent as documents have it: without heights where nobody knows from what those of the city are measured.
    fn bbox(&self) -> Option<Vec<f64>> {
        let [west, south, lowest, east, north, highest] = self.extent?;
        Some(match self.manifest.heights {
            Some(_) => vec![west, south, lowest, east, north, highest],
            None => vec![west, south, east, north],
        })
    }
}

/// West, south, lowest, east, north and highest of a city: degrees, and metres above the ellipsoid, or from an unknown zero
/// if the manifest does not say from which. `None` if its coordinate system is not known, or not to this program.
#[cfg(feature = "bake")]
pub(crate) fn extent(manifest: &Manifest) -> Option<[f64; 6]> {
    let place =
        insula_bake::read::EarthPlace::of(manifest.crs.as_deref()?)?.above_sea_level(manifest.heights.is_some());
    let [west, south, lowest, east, north, highest] = place.extent(manifest.bounds)?;
    // To a centimetre, never less than the city.
    let down = |value: f64, unit: f64| (value * unit).floor() / unit;
    let up = |value: f64, unit: f64| (value * unit).ceil() / unit;
    let (degree, metre) = (1e7, 100.0);
    let low = [down(west, degree), down(south, degree), down(lowest, metre)];
    let high = [up(east, degree), up(north, degree), up(highest, metre)];
    Some([low[0], low[1], low[2], high[0], high[1], high[2]])
}

/// Coordinate systems are a part of the bake.
#[cfg(not(feature = "bake"))]
pub(crate) fn extent(_: &Manifest) -> Option<[f64; 6]> {
    None
}

/// The documents of a site's cities, by their paths in it. With `url`, the address that the site will have, they name their own.
pub(crate) fn documents(title: &str, cities: &[CityRecord<'_>], url: Option<&str>) -> Vec<(String, Value)> {
    let mut documents = vec![
        (stac::CATALOG_FILE.to_owned(), stac::catalog(title, cities, url)),
        (geovolumes::LIST_FILE.to_owned(), geovolumes::list(cities)),
    ];
    for city in cities {
        documents.push((stac::item_file(&city.manifest.name), stac::item(city, url)));
        documents.push((geovolumes::collection_file(&city.manifest.name), geovolumes::collection(city, "../")));
    }
    documents
}

fn link(rel: &str, media_type: &str, href: &str, title: &str) -> Value {
    json!({ "rel": rel, "type": media_type, "href": href, "title": title })
}

/// The web pages of the sources, which have their licences.
fn licence_links(manifest: &Manifest) -> impl Iterator<Item = Value> {
    let pages = manifest.attribution.iter().filter_map(|source| Some((source, web_address(source)?)));
    pages.map(|(source, url)| {
        let title = source.licence.as_ref().map_or_else(|| source.text.clone(), |l| format!("{}: {l}", source.text));
        link("license", "text/html", url, &title)
    })
}

/// The address of a source, unless it is anything but one of the web.
fn web_address(source: &Attribution) -> Option<&str> {
    source.url.as_deref().filter(|url| url.starts_with("https://") || url.starts_with("http://"))
}
