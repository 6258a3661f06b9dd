//! `analyse`: hours of sun, sky, shadows and views of a city.

mod checks;
mod files;
mod progress;
mod proposal;
mod shadow;
mod sheet;
mod sight;
mod sun;
mod tile_file;
mod tiles;
mod view;
mod vista;

use super::error::CommandError;
use super::output::print_result;
use crate::analysis::answer::{Answer, Progress, grown};
use crate::area_file::polygons_in_city;
use crate::args::{AnalyseArgs, Analysis};
use crate::proposal::Proposal;
use crate::store::{CityStore, StoredCity, StoredObjects};
use checks::{check_options, check_outputs};
use files::write;
use insula_analysis::solar::YearOfSky;
use insula_analysis::sun::Site;
use insula_analysis::surface::CitySurface;
use insula_analysis::weather::WeatherYear;
use insula_archive::file::read_limited;
use insula_bake::read::EarthPlace;
use insula_export::raster::CellExtent;
use insula_export::selection::{SelectedArea, area_around};
use insula_export::source::ExportSource;
use insula_export::table::ExportError;
use progress::AnalysisProgress;
use proposal::{AROUND_M, AfterProposal, between};
use serde_json::json;
use shadow::ShadowSum;
use std::path::{Path, PathBuf};
use tiles::TileGrid;

/// Largest file of weather. A year has 1.5 MB.
const MAX_WEATHER_BYTES: u64 = 16 << 20;
const MAX_GARDENS: usize = 100_000;

/// Where an answer is written.
#[derive(Debug, Clone)]
struct Files {
    out: PathBuf,
    pdf: Option<PathBuf>,
}

impl Files {
    fn of(args: &AnalyseArgs) -> Self {
        Self { out: args.out.clone(), pdf: args.pdf.clone() }
    }
}

/// What is asked, and of which city.
struct Question<'a> {
    args: &'a AnalyseArgs,
    source: &'a dyn ExportSource,
    place: Option<&'a EarthPlace>,
    /// The cells of the result. Those around them are only in the way.
    extent: CellExtent,
    /// Borders of what a proposal adds, for the sheet.
    added: Vec<Vec<[f64; 2]>>,
    /// In place of a year without clouds.
    weather: Option<WeatherYear>,
    /// Of a polygon each.
    gardens: Vec<SelectedArea>,
}

/// Runs `analyse`. Fails if the city cannot be read, an option does not fit, or an output cannot be written.
pub(super) fn run(args: &AnalyseArgs) -> Result<(), CommandError> {
    check_options(args)?;
    let city = CityStore::open(&args.city)?;
    let times = if args.what == Analysis::Shadow { shadow::files(args)? } else { Vec::new() };
    let proposal = args.proposal.as_deref().map(Proposal::read).transpose()?;
    let read = proposal.iter().flat_map(Proposal::files).collect();
    check_outputs(args, times.iter().map(|(_, files)| files.clone()).collect(), read)?;
    let weather = args.weather.as_deref().map(weather_of).transpose()?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    let manifest = city.manifest();
    let place = manifest.crs.as_deref().and_then(EarthPlace::of);
    let failed = |error: ExportError| CommandError::file(&args.city, error);
    let corners = manifest.bounds.map(|[x, y, _]| [x, y]);
    let on_map = |degrees| place.as_ref()?.box_on_map(degrees);
    let area = args.area.box_in_city(corners, on_map, &|at| place.as_ref()?.lon_lat(at));
    let area = area.map_err(CommandError::Usage)?;
    let gardens = gardens_of(args, corners, place.as_ref())?;
    let change = proposal.as_ref().map(|proposal| proposal.change(&source, place.as_ref())).transpose()?;
    let both = proposal.as_ref().zip(change.as_ref());
    let after = || both.map(|(proposal, change)| AfterProposal::new(proposal, change, &source)).transpose();
    if let Some(points) = &args.points {
        return sun::sun_at(args, points, &source, place.as_ref(), after()?.as_ref());
    }
    if let [from, to] = &args.between[..] {
        return sight::between(args, [from, to], &source, place.as_ref(), after()?.as_ref());
    }
    // Corridors are whole.
    let around = change.as_ref().filter(|_| args.vista.is_none());
    let area = area.or_else(|| area_of(&gardens)).or_else(|| Some(grown(around?.area()?, AROUND_M)));
    let extent = CellExtent::of(manifest, area).map_err(failed)?;
    let (place, added) = (place.as_ref(), Vec::new());
    let mut question = Question { args, source: &source, place, extent, added, weather, gardens };
    if change.is_none()
        && let Some(grid) = TileGrid::of(&question, area)?
    {
        return tiles::run(&question, grid, &times);
    }
    let mut surface = CitySurface::read(&source, area.map(|area| grown(area, args.reach))).map_err(failed)?;
    let mut changed = None;
    if let (Some(proposal), Some(change)) = (&proposal, &change) {
        let after = change.after(proposal, &surface)?;
        let where_changed = after.changes_from(&surface).filter(|_| args.vista.is_none());
        if let (None, Some(where_changed)) = (area, where_changed) {
            question.extent = CellExtent::of(manifest, Some(grown(where_changed, AROUND_M))).map_err(failed)?;
        }
        if args.pdf.is_some() {
            question.added = after.borders_of_added(&surface, question.extent, &change.added_on_map());
        }
        changed = Some((proposal, after));
    }
    if let (Some(path), Some((proposal, after))) = (&args.vista, &changed) {
        let answer = vista::vista(path, after, place, Some((*proposal, &surface)))?;
        return write(&question, after, answer, &Files::of(args));
    }
    let mut sum = ShadowSum::default();
    for (moment, files) in &times {
        let site = question.site()?;
        let answer = beside(args.what, &mut surface, changed.as_mut(), |surface| shadow::at(surface, &site, moment))?;
        if args.pdf.is_some() {
            sum.add(&answer);
        }
        write(&question, &surface, answer, files)?;
    }
    match args.what {
        Analysis::Shadow => write_day(&question, &surface, sum, times.len()),
        _ => {
            let answer = beside(args.what, &mut surface, changed.as_mut(), |surface| question.shown_answer(surface))?;
            write(&question, &surface, answer, &Files::of(args))
        }
    }
}

/// Writes the sheet of several times together, beside that of each. Fails if it cannot be written.
fn write_day(question: &Question, surface: &CitySurface, sum: ShadowSum, times: usize) -> Result<(), CommandError> {
    let Some(path) = question.args.pdf.as_ref().filter(|_| times > 1) else { return Ok(()) };
    let answer = sum.answer().within(surface, question.extent);
    sheet::write(question, &answer, surface, path)?;
    let pdf = path.display().to_string();
    let text = format!("wrote {pdf} ({})\n", answer.title);
    print_result(question.args.json, &json!({ "pdf": pdf, "title": answer.title }), &text);
    Ok(())
}

/// The answer of a surface, or what it is less after a change. Fails as `ask` does.
fn beside(
    what: Analysis,
    surface: &mut CitySurface,
    changed: Option<&mut (&Proposal, CitySurface)>,
    ask: impl Fn(&mut CitySurface) -> Result<Answer, CommandError>,
) -> Result<Answer, CommandError> {
    let answer = ask(surface)?;
    match changed {
        Some((proposal, after)) => {
            let later = ask(after)?;
            Ok(between(proposal, what, [surface, after], &answer, later))
        }
        None => Ok(answer),
    }
}

impl Question<'_> {
    /// Computes what is asked for, but shadows, and shows how far it is.
    fn shown_answer(&self, surface: &mut CitySurface) -> Result<Answer, CommandError> {
        let shown = AnalysisProgress::start();
        let progress = |share: f64| {
            shown.at(share);
            true
        };
        let answer = self.answer(surface, &progress)?;
        shown.clear();
        Ok(answer)
    }

    /// The same. `progress` gets the share that is done.
    fn answer(&self, surface: &mut CitySurface, progress: Progress<'_>) -> Result<Answer, CommandError> {
        let (args, heights) = (self.args, &self.args.wall_heights);
        Ok(match args.what {
            Analysis::Sun => sun::sun(args, surface, &self.site()?, progress)?,
            Analysis::View => view::view(args, surface, self.place, progress)?,
            Analysis::Solar => {
                let sky = self.weather.as_ref().map(YearOfSky::Weather).or(args.turbidity.map(YearOfSky::Clear));
                Answer::of_solar(surface, &self.site()?, sky, heights, progress)
            }
            Analysis::Sky | Analysis::Shadow => Answer::of_sky(surface, heights, progress),
        })
    }

    /// Where the city lies. Fails if that is not known.
    fn site(&self) -> Result<Site, CommandError> {
        site_of(self.source)
    }
}

/// The gardens of `--gardens` on the map of a city between two corners. Fails with what is wrong with their file.
fn gardens_of(
    args: &AnalyseArgs,
    city: [[f64; 2]; 2],
    place: Option<&EarthPlace>,
) -> Result<Vec<SelectedArea>, CommandError> {
    let Some(path) = &args.gardens else { return Ok(Vec::new()) };
    let polygons = polygons_in_city(path, city, place);
    let polygons = polygons.map_err(|reason| CommandError::Usage(format!("--gardens {reason}")))?;
    if polygons.len() > MAX_GARDENS {
        let reason = format!("{} polygons, of which {MAX_GARDENS} fit in one run", polygons.len());
        return Err(CommandError::Usage(format!("--gardens {}: {reason}", path.display())));
    }
    Ok(polygons.into_iter().map(|polygon| SelectedArea::new(vec![polygon])).collect())
}

/// The rectangle around gardens; `None` without any.
fn area_of(gardens: &[SelectedArea]) -> Option<[[f64; 2]; 2]> {
    let points = gardens.iter().flat_map(SelectedArea::polygons).flatten().flatten().copied();
    (!gardens.is_empty()).then(|| area_around(points))
}

/// The weather of a file. Fails with what is wrong with it.
fn weather_of(path: &Path) -> Result<WeatherYear, CommandError> {
    let wrong = |reason: String| CommandError::Usage(format!("--weather {}: {reason}", path.display()));
    let bytes = read_limited(path, MAX_WEATHER_BYTES).map_err(|error| wrong(error.to_string()))?;
    // Names of places may have letters of other encodings than UTF-8.
    WeatherYear::parse(&String::from_utf8_lossy(&bytes)).map_err(wrong)
}

/// Where a city lies. Fails if that is not known.
fn site_of(source: &dyn ExportSource) -> Result<Site, CommandError> {
    Site::of(source.manifest()).ok_or_else(|| {
        CommandError::Usage("it is not known where on Earth this city lies: bake it with --crs or --at".to_owned())
    })
}
