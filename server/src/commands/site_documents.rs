//! What `publish` writes for other programs: documents by which catalogues and GIS find the cities, and tilesets.

use super::error::CommandError;
use super::site_folder::SiteFolder;
use crate::discovery::{self, CityRecord, city_files};
use crate::page::{Brand, CityFacts, description};
use crate::store::CityStore;
#[cfg(feature = "bake")]
use crate::{proposal::document, store::StoredCity};
use insula_archive::city::MANIFEST_FILE;
#[cfg(feature = "bake")]
use insula_bake::read::EarthPlace;
#[cfg(feature = "bake")]
use insula_export::{
    glb::ExportError,
    selection::ObjectSelection,
    tiles3d::{Tileset, TilesetForm, each_file},
};
#[cfg(feature = "bake")]
use insula_protocol::{route::PROPOSALS_FILE, text::printable};
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

/// What is to be said of a tileset without a place.
#[cfg(feature = "bake")]
pub(super) const NO_PLACE: &str = "the city's place on Earth is not known, and globes show its 3D Tiles at the centre of the Earth; bake it \
     with --crs, or with --at if it is a mesh";

/// Writes the documents, which list the files of cities that the site has by now. `url` is the site's address, if it is known.
pub(super) fn write_documents(
    site: &mut SiteFolder,
    cities: &[&Arc<CityStore>],
    title: &str,
    url: Option<&str>,
) -> Result<(), CommandError> {
    let records = cities.iter().map(|city| record(site, city)).collect::<Result<Vec<_>, _>>()?;
    for (path, document) in discovery::documents(title, &records, url) {
        site.write(&path, format!("{document:#}\n").as_bytes())?;
    }
    Ok(())
}

fn record<'c>(site: &SiteFolder, city: &'c CityStore) -> Result<CityRecord<'c>, CommandError> {
    let manifest = city.manifest();
    // Manifests do not say when they were made. A publish that is repeated gives the same documents.
    let path = city.folder().map_or_else(PathBuf::new, |folder| folder.join(MANIFEST_FILE));
    let time = fs::metadata(&path).and_then(|found| found.modified());
    let time = time.map_err(|error| CommandError::file(path, error))?;
    let mark = |name: &str| site.mark(&format!("cities/{}/{name}", manifest.name));
    Ok(CityRecord {
        manifest,
        description: description(CityFacts::of(city)),
        extent: discovery::extent(manifest),
        time,
        files: city_files().filter_map(|file| Some((file, mark(file.name)?))).collect(),
    })
}

/// Writes a city as plain 3D Tiles, which all viewers open, into its folder, with one tile in memory at a time. Fails if the city cannot be read, or has no surface.
#[cfg(feature = "bake")]
pub(super) fn write_tileset(site: &mut SiteFolder, city: &CityStore) -> Result<(), CommandError> {
    let failed = |reason: String| CommandError::file(city.location(), reason);
    let manifest = city.manifest();
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(manifest, &read).map_err(|error| failed(error.to_string()))?;
    let place =
        manifest.crs.as_deref().and_then(EarthPlace::of).map(|place| place.above_sea_level(manifest.heights.is_some()));
    let to_geocentric = |point: [f64; 3]| place.as_ref()?.geocentric(point);
    let everything = ObjectSelection::default();
    let tileset = Tileset::new(&source, &everything, &to_geocentric).map_err(|error| failed(error.to_string()))?;
    let tileset = tileset.in_form(TilesetForm::Plain);
    if !tileset.has_place() {
        eprintln!("note: {}: {NO_PLACE}", manifest.name);
    }
    let folder = format!("cities/{}/{}", manifest.name, discovery::TILESET_FOLDER);
    let mut take = |name: &str, bytes: &[u8]| {
        let written = site.write(&format!("{folder}/{name}"), bytes);
        let source = written.map_err(|error| std::io::Error::other(error.to_string()));
        source.map_err(|source| ExportError::Write { what: name.to_owned(), source })
    };
    each_file(&tileset, &mut take).map(|_| ()).map_err(|error| failed(error.to_string()))
}

/// Writes the proposals of a city into its folder, and returns whether there are some. Those that cannot be used are a warning. Fails if the
/// city cannot be read.
#[cfg(feature = "bake")]
pub(super) fn write_proposals(site: &mut SiteFolder, city: &CityStore, brand: &Brand) -> Result<bool, CommandError> {
    let name = &city.manifest().name;
    let Some(folder) = brand.proposals_of(name) else { return Ok(false) };
    let read = |kind, id| city.tile(kind, id);
    let source =
        StoredCity::open(city.manifest(), &read).map_err(|error| CommandError::file(city.location(), error))?;
    let (json, faults) = document(Some(folder), &source);
    faults.iter().for_each(|fault| eprintln!("warning: {}", printable(fault)));
    site.write(&format!("cities/{name}/{PROPOSALS_FILE}"), json.as_bytes())?;
    Ok(true)
}

/// Proposals are a part of the bake. Fails if there are some.
#[cfg(not(feature = "bake"))]
pub(super) fn write_proposals(_: &mut SiteFolder, city: &CityStore, brand: &Brand) -> Result<bool, CommandError> {
    brand.proposals_of(&city.manifest().name).map_or(Ok(false), |_| Err(can_only_serve("--proposals")))
}

/// Tilesets are a part of the bake.
#[cfg(not(feature = "bake"))]
pub(super) fn write_tileset(_: &mut SiteFolder, _: &CityStore) -> Result<(), CommandError> {
    Err(can_only_serve("--tileset"))
}

#[cfg(not(feature = "bake"))]
fn can_only_serve(option: &str) -> CommandError {
    CommandError::Bake(format!("{option}: this program can only serve; use one that was built with the feature `bake`"))
}
