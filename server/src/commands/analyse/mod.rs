//! `analyse`: hours of sun, sky, shadows and views of a city.

mod checks;
mod files;
mod progress;
mod proposal;
mod shadow;
mod sheet;
mod sight;
mod sun;
mod view;
mod vista;

use super::error::CommandError;
use crate::{
    args::{AnalyseArgs, Analysis},
    proposal::Proposal,
    store::{CityStore, StoredCity, StoredObjects},
};
use checks::{check_options, check_outputs};
use files::write;
use insula_analysis::{sky::sky_view, solar::solar_year, sun::Site, surface::CitySurface, walls::WallPoint};
use insula_bake::read::EarthPlace;
use insula_export::{raster::CellExtent, source::ExportSource, table::ExportError};
use progress::AnalysisProgress;
use proposal::{AROUND_M, AfterProposal, between};
use std::path::PathBuf;

/// Heights above the ground at which walls look at the sky: an eye.
const SKY_HEIGHTS_M: [f64; 1] = [EYE_M];

/// Heights above the ground at which walls have the sun of a year.
const SOLAR_HEIGHTS_M: [f64; 1] = [5.0];
/// Of Linke: the clear air of a temperate country.
const TURBIDITY: f64 = 3.0;

/// Height of an eye above the ground.
const EYE_M: f64 = 1.6;

/// Values of a surface, and what they say.
struct Answer {
    tops: Vec<f32>,
    points: Vec<WallPoint>,
    walls: Vec<f32>,
    /// What the rule asks for.
    asked: Option<f64>,
    /// Of the values, for the name of a raster.
    title: String,
    /// A word for the names of columns.
    column: &'static str,
    /// A word for what a roof has in all, if that means something.
    total: Option<&'static str>,
    /// Sentences for people.
    notes: Vec<String>,
    /// Values above this make the areas of polygons.
    area_from: f32,
    /// What is written as table of buildings, in place of their values.
    table: Option<Vec<u8>>,
}

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
}

/// Runs `analyse`. Fails if the city cannot be read, an option does not fit, or an output cannot be written.
pub(super) fn run(args: &AnalyseArgs) -> Result<(), CommandError> {
    check_options(args)?;
    let city = CityStore::open(&args.city)?;
    let times = if args.what == Analysis::Shadow { shadow::files(args)? } else { Vec::new() };
    let proposal = args.proposal.as_deref().map(Proposal::read).transpose()?;
    let read = proposal.iter().flat_map(Proposal::files).collect();
    check_outputs(args, times.iter().map(|(_, files)| files.clone()).collect(), read)?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    let manifest = city.manifest();
    let place = manifest.crs.as_deref().and_then(EarthPlace::of);
    let failed = |error: ExportError| CommandError::Export { path: args.city.clone(), reason: error.to_string() };
    let area = args.area.world_box(|degrees| place.as_ref()?.box_on_map(degrees)).map_err(CommandError::Usage)?;
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
    let area = area.or_else(|| Some(grown(around?.area()?, AROUND_M)));
    let extent = CellExtent::of(manifest, area).map_err(failed)?;
    let mut surface = CitySurface::read(&source, area.map(|area| grown(area, args.reach))).map_err(failed)?;
    let mut question = Question { args, source: &source, place: place.as_ref(), extent, added: Vec::new() };
    let mut changed = None;
    if let (Some(proposal), Some(change)) = (&proposal, &change) {
        let after = change.after(proposal, &surface)?;
        let where_changed = after.changes_from(&surface).filter(|_| args.vista.is_none());
        if let (None, Some(where_changed)) = (area, where_changed) {
            question.extent = CellExtent::of(manifest, Some(grown(where_changed, AROUND_M))).map_err(failed)?;
        }
        if args.pdf.is_some() {
            question.added = after.borders_of_added(&surface, question.extent);
        }
        changed = Some((proposal, after));
    }
    if let (Some(path), Some((proposal, after))) = (&args.vista, &changed) {
        let answer = vista::vista(path, after, place.as_ref(), Some((*proposal, &surface)))?;
        return write(&question, after, answer, &Files::of(args));
    }
    for (moment, files) in &times {
        let site = question.site()?;
        let answer = beside(args.what, &mut surface, changed.as_mut(), |surface| shadow::at(surface, &site, moment))?;
        write(&question, &surface, answer, files)?;
    }
    match args.what {
        Analysis::Shadow => Ok(()),
        _ => {
            let answer = beside(args.what, &mut surface, changed.as_mut(), |surface| question.answer(surface))?;
            write(&question, &surface, answer, &Files::of(args))
        }
    }
}

/// An area and what lies around it.
fn grown([min, max]: [[f64; 2]; 2], metres: f64) -> [[f64; 2]; 2] {
    [min.map(|v| v - metres), max.map(|v| v + metres)]
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
    /// Computes what is asked for, but shadows.
    fn answer(&self, surface: &mut CitySurface) -> Result<Answer, CommandError> {
        let shown = AnalysisProgress::start();
        let progress = |share: f64| shown.at(share);
        let answer = match self.args.what {
            Analysis::Sun => sun::sun(self.args, surface, &self.site()?, &progress)?,
            Analysis::View => view::view(self.args, surface, self.place, &progress)?,
            Analysis::Solar => self.solar(surface, &progress)?,
            Analysis::Sky | Analysis::Shadow => {
                let heights = &self.args.wall_heights;
                let sky = sky_view(surface, if heights.is_empty() { &SKY_HEIGHTS_M } else { heights }, &progress);
                Answer {
                    tops: sky.tops,
                    points: sky.wall_points,
                    walls: sky.walls,
                    title: "sky view factor".to_owned(),
                    column: "sky",
                    notes: vec!["values of walls are vertical sky components in percent, at most 39.6".to_owned()],
                    ..Answer::default()
                }
            }
        };
        shown.clear();
        Ok(answer)
    }

    /// Irradiation of a year.
    fn solar(&self, surface: &mut CitySurface, progress: &(dyn Fn(f64) + Sync)) -> Result<Answer, CommandError> {
        let (turbidity, heights) = (self.args.turbidity.unwrap_or(TURBIDITY), &self.args.wall_heights);
        let heights = if heights.is_empty() { &SOLAR_HEIGHTS_M } else { &heights[..] };
        let year = solar_year(surface, &self.site()?, turbidity, heights, progress);
        Ok(Answer {
            tops: year.tops,
            points: year.wall_points,
            walls: year.walls,
            title: "kWh/m2 a year under a clear sky".to_owned(),
            column: "kwh_m2",
            total: Some("kwh"),
            notes: vec![format!(
                "sun and sky of a year without clouds (Ineichen and Perez 2002, Linke turbidity {turbidity}), on each surface as it is \
                 inclined; clouds and panels leave less"
            )],
            ..Answer::default()
        })
    }

    /// Where the city lies. Fails if that is not known.
    fn site(&self) -> Result<Site, CommandError> {
        site_of(self.source)
    }
}

/// Where a city lies. Fails if that is not known.
fn site_of(source: &dyn ExportSource) -> Result<Site, CommandError> {
    Site::of(source.manifest()).ok_or_else(|| {
        CommandError::Usage("it is not known where on Earth this city lies: bake it with --crs or --at".to_owned())
    })
}

impl Default for Answer {
    fn default() -> Self {
        Self {
            tops: Vec::new(),
            points: Vec::new(),
            walls: Vec::new(),
            asked: None,
            title: String::new(),
            column: "",
            total: None,
            notes: Vec::new(),
            area_from: 0.5,
            table: None,
        }
    }
}

impl Answer {
    /// 1 where something is true, else 0, and no value where nothing was baked.
    fn of_places(surface: &CitySurface, places: &[bool], title: String) -> Self {
        let value = |(index, place): (usize, &bool)| match surface.is_known(index) {
            true => f32::from(u8::from(*place)),
            false => f32::NAN,
        };
        let tops = places.iter().enumerate().map(value).collect();
        Self { tops, title, column: "share", ..Self::default() }
    }

    /// The values of a part of the surface; what lies around it was only there to be in the way.
    fn within(mut self, surface: &CitySurface, part: CellExtent) -> Self {
        let all = surface.extent;
        if part == all {
            return self;
        }
        let has = |index: u32| {
            let cell = [all.min[0] + index % all.size[0], all.min[1] + index / all.size[0]];
            (0..2).all(|k| (part.min[k]..part.min[k] + part.size[k]).contains(&cell[k]))
        };
        for (index, value) in (0u32..).zip(&mut self.tops) {
            if !has(index) {
                *value = f32::NAN;
            }
        }
        let kept: Vec<bool> = self.points.iter().map(|point| has(point.cell)).collect();
        let mut keep = kept.iter();
        self.points.retain(|_| keep.next().is_some_and(|kept| *kept));
        let mut keep = kept.iter();
        self.walls.retain(|_| keep.next().is_some_and(|kept| *kept));
        self
    }
}
