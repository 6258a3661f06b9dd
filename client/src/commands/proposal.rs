//! `--proposal`: what a file adds to a city and removes from it.

#[cfg(feature = "embedded")]
use super::city_tiles::fetch_tile;
use crate::error::{ClientError, Result};
use crate::proposal::ShownProposal;
use crate::stream::city::OpenedCity;
use crate::stream::fetch::Http;
#[cfg(feature = "embedded")]
use insula_bake::read::EarthPlace;
#[cfg(feature = "embedded")]
use insula_export::source::ExportSource;
#[cfg(feature = "embedded")]
use insula_server::{
    proposal::{Proposal, ProposalError},
    store::StoredCity,
};
#[cfg(feature = "embedded")]
use insula_viewer::{additions::AddedObject, source::WITHOUT_OBJECTS};
use std::path::{Path, PathBuf};

/// The file of the option and those that it names. Fails with what is wrong in it.
#[cfg(feature = "embedded")]
pub(super) fn files(path: Option<&Path>) -> Result<Vec<PathBuf>> {
    let Some(path) = path else { return Ok(Vec::new()) };
    let mut files = read(path)?.files();
    files.push(path.to_owned());
    Ok(files)
}

/// Fails if there is such an option.
#[cfg(not(feature = "embedded"))]
pub(super) fn files(path: Option<&Path>) -> Result<Vec<PathBuf>> {
    path.map_or(Ok(Vec::new()), |_| {
        let reason = "--proposal: this program was built without the embedded server, which reads such files";
        Err(ClientError::Usage(reason.to_owned()))
    })
}

/// What the option changes in a city. Blocks while the city's objects and ground are read. Fails if the file, or what it names, cannot be
/// used in this city.
#[cfg(feature = "embedded")]
pub(super) fn open(path: Option<&Path>, http: &Http, city: &mut OpenedCity) -> Result<Option<ShownProposal>> {
    let Some(path) = path else { return Ok(None) };
    let proposal = read(path)?;
    let shown = in_city(&proposal, http, city)?;
    // The sets were made with the buildings that are removed: what these hide would stay coarse.
    city.manifest.street_sets &= !proposal.removes();
    Ok(Some(shown))
}

/// Fails as [`files`] does.
#[cfg(not(feature = "embedded"))]
pub(super) fn open(path: Option<&Path>, _: &Http, _: &mut OpenedCity) -> Result<Option<ShownProposal>> {
    files(path).map(|_| None)
}

#[cfg(feature = "embedded")]
fn in_city(proposal: &Proposal, http: &Http, city: &OpenedCity) -> Result<ShownProposal> {
    let read = |kind, id| fetch_tile(http, city, kind, id);
    let source = StoredCity::open(&city.manifest, &read).map_err(|error| ClientError::Failed(error.to_string()))?;
    if proposal.removes() && source.schema().objects == 0 && !city.source.opens_objects() {
        return Err(ClientError::Usage(format!("--proposal: {WITHOUT_OBJECTS}")));
    }
    let place = city.manifest.crs.as_deref().and_then(EarthPlace::of);
    let change = proposal.change(&source, place.as_ref()).map_err(|error| wrong(&error))?;
    let found = change.objects(proposal, &source).map_err(|error| wrong(&error))?;
    let added = found.added.into_iter();
    let added: Vec<_> = added.map(|of| AddedObject { name: of.name, triangles: of.triangles }).collect();
    ShownProposal::new(proposal.name().to_owned(), &added, found.removed)
}

#[cfg(feature = "embedded")]
fn read(path: &Path) -> Result<Proposal> {
    Proposal::read(path).map_err(|error| wrong(&error))
}

#[cfg(feature = "embedded")]
fn wrong(error: &ProposalError) -> ClientError {
    ClientError::Usage(error.to_string())
}
