//! `--proposal`: a file of what is added to a city and removed from it, and what an analysis says of the change.

use super::{
    super::{area_file::read_polygons, error::CommandError},
    Answer,
};
use crate::args::Analysis;
use insula_analysis::{
    proposal::{Addition, SurfaceValues, change},
    surface::{Building, CitySurface},
};
use insula_archive::file::read_text;
use insula_bake::read::{self, EarthPlace, PlacingOptions, ReadOptions};
use insula_export::{
    selection::{Polygon, passing},
    source::ExportSource,
};
use insula_objects::filter::Filter;
use roaring::RoaringBitmap;
use serde::Deserialize;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

const MAX_BYTES: u64 = 1 << 20;
/// How far around a proposal values are computed.
pub(super) const AROUND_M: f64 = 500.0;
/// All of a model is so near to its place.
const FAR_M: f64 = 2000.0;

/// A file of `--proposal`. Files that it names are beside it.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Proposal {
    #[serde(default)]
    title: String,
    #[serde(default)]
    add: Vec<AddTable>,
    #[serde(default)]
    remove: Vec<RemoveTable>,
    #[serde(skip)]
    path: PathBuf,
}

/// A model, or all above an outline up to a height.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AddTable {
    /// A model that `bake` reads.
    file: Option<PathBuf>,
    /// Longitude and latitude of its origin, if it has no coordinates of its own.
    place: Option<Vec<f64>>,
    /// Clockwise from the file's north.
    #[serde(default)]
    heading_deg: f64,
    /// Polygons in a GeoJSON file, and the height above the base.
    outline: Option<PathBuf>,
    height_m: Option<f64>,
    /// Above sea level. By default the ground at the place, or the lowest ground along the outline.
    base_m: Option<f64>,
}

impl AddTable {
    /// Fails with what does not fit together.
    fn check(&self) -> Result<(), &'static str> {
        let Self { file, place, heading_deg, outline, height_m, base_m } = self;
        let is_height = |height: &f64| (0.1..=2000.0).contains(height);
        match (file, outline) {
            (Some(_), None) if height_m.is_some() => Err("height_m is of an outline: a file has its own height"),
            (Some(_), None) if place.is_none() && (base_m.is_some() || *heading_deg != 0.0) => {
                Err("base_m and heading_deg of a file need its place: a file with coordinates stands where they say")
            }
            (Some(_), None) if place.as_ref().is_some_and(|place| place.len() != 2) => {
                Err("a place is [longitude, latitude]; base_m is the height above sea level")
            }
            (Some(_), None) => Ok(()),
            (None, Some(_)) if place.is_some() || *heading_deg != 0.0 => {
                Err("an outline has its place and direction: place and heading_deg are of a file")
            }
            (None, Some(_)) if height_m.as_ref().is_some_and(is_height) => Ok(()),
            (None, Some(_)) => Err("an outline needs height_m in metres, up to 2000"),
            _ => Err("an [[add]] has a file or an outline"),
        }
    }
}

/// Objects that are removed.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RemoveTable {
    /// Identifiers of buildings.
    #[serde(default)]
    ids: Vec<String>,
    /// Buildings that pass a filter.
    filter: Option<String>,
    /// All that stands in the polygons of a GeoJSON file.
    polygon: Option<PathBuf>,
}

/// What is changed, on the map.
pub(super) struct Change {
    title: String,
    /// Models and outlines, with what is known of their bases.
    added: Vec<(Addition, Base)>,
    ids: BTreeSet<String>,
    numbers: RoaringBitmap,
    areas: Vec<Polygon>,
}

/// What an addition stands on.
enum Base {
    /// Heights are right.
    Known,
    /// The ground at a place.
    At([f64; 2]),
    /// The lowest ground along the outline, or below the model.
    Along,
}

impl Proposal {
    /// Reads a file. Fails with what is wrong in it.
    pub(super) fn read(path: &Path) -> Result<Self, CommandError> {
        let wrong = |reason: String| CommandError::Usage(format!("--proposal {}: {reason}", path.display()));
        let text = read_text(path, MAX_BYTES).map_err(|error| wrong(error.to_string()))?;
        let mut proposal: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        proposal.path = path.to_owned();
        if proposal.add.is_empty() && proposal.remove.is_empty() {
            return Err(wrong("it has neither an [[add]] nor a [[remove]]".to_owned()));
        }
        for added in &proposal.add {
            added.check().map_err(|reason| wrong(reason.to_owned()))?;
        }
        if proposal.remove.iter().any(|r| r.ids.is_empty() && r.filter.is_none() && r.polygon.is_none()) {
            return Err(wrong("a [[remove]] has ids, a filter or a polygon".to_owned()));
        }
        Ok(proposal)
    }

    /// The files that it names.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let added = self.add.iter().flat_map(|added| added.file.iter().chain(&added.outline));
        added.chain(self.remove.iter().flat_map(|removed| &removed.polygon)).map(|file| self.beside(file)).collect()
    }

    fn beside(&self, file: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(file)
    }

    fn wrong(&self, reason: &str) -> CommandError {
        CommandError::Usage(format!("--proposal {}: {reason}", self.path.display()))
    }

    /// Reads the models, outlines and filters. Fails if one cannot be read, or has no place in the city.
    pub(super) fn change(&self, source: &dyn ExportSource, place: Option<&EarthPlace>) -> Result<Change, CommandError> {
        let city = source.manifest().bounds.map(|[x, y, _]| [x, y]);
        let option = format!("--proposal {}:", self.path.display());
        let polygons = |file: &Path| read_polygons(&option, &self.beside(file), city, place);
        let mut change = Change {
            title: self.title.clone(),
            added: Vec::new(),
            ids: BTreeSet::new(),
            numbers: RoaringBitmap::new(),
            areas: Vec::new(),
        };
        for added in &self.add {
            if let Some(file) = &added.file {
                change.added.push(self.model(added, &self.beside(file), source, place)?);
            }
            for outline in added.outline.iter().map(|file| polygons(file)).collect::<Result<Vec<_>, _>>()?.concat() {
                let top_m = added.base_m.unwrap_or(0.0) + added.height_m.unwrap_or(0.0);
                let base = if added.base_m.is_some() { Base::Known } else { Base::Along };
                change.added.push((Addition::Block { outline, top_m }, base));
            }
        }
        for removed in &self.remove {
            change.ids.extend(removed.ids.iter().cloned());
            if let Some(text) = &removed.filter {
                let filter = Filter::parse(text, source.schema());
                let filter = filter.map_err(|error| self.wrong(&format!("filter {text}: {error}")))?;
                change.numbers |= passing(source, &filter).map_err(|error| self.wrong(&error.to_string()))?;
            }
            if let Some(file) = &removed.polygon {
                change.areas.extend(polygons(file)?);
            }
        }
        Ok(change)
    }

    /// A model on the map of the city.
    fn model(
        &self,
        added: &AddTable,
        file: &Path,
        source: &dyn ExportSource,
        place: Option<&EarthPlace>,
    ) -> Result<(Addition, Base), CommandError> {
        let wrong = |reason: &str| self.wrong(&format!("{}: {reason}", file.display()));
        let degrees = added.place.as_ref().and_then(|place| Some([*place.first()?, *place.get(1)?]));
        let on_map = match degrees {
            Some(degrees) => {
                let place = place.ok_or_else(|| wrong("it is not known where on Earth this city lies"))?;
                Some(place.on_map(degrees).ok_or_else(|| wrong("its place is out of the city's coordinate system"))?)
            }
            None => None,
        };
        let at = degrees.map(|[lon, lat]| [lon, lat, added.base_m.unwrap_or(0.0)]);
        let placing = PlacingOptions { crs: source.manifest().crs.clone(), at, ..PlacingOptions::default() };
        let options = ReadOptions { placing, ..ReadOptions::default() };
        let (scene, report) =
            read::read(&[file.to_owned()], &options, &|_| ()).map_err(|error| self.wrong(&error.to_string()))?;
        report.warnings().for_each(|warning| eprintln!("warning: {warning}"));
        let (sin, cos) = (-added.heading_deg.to_radians()).sin_cos();
        let turned = |corner: [f32; 3]| {
            let corner: [f64; 3] = std::array::from_fn(|k| scene.origin[k] + f64::from(corner[k]));
            match on_map {
                Some([x, y]) if added.heading_deg != 0.0 => {
                    let [east, north] = [corner[0] - x, corner[1] - y];
                    [x + east * cos - north * sin, y + east * sin + north * cos, corner[2]]
                }
                _ => corner,
            }
        };
        let triangles: Vec<_> = scene.triangles.iter().map(|triangle| triangle.corners.map(turned)).collect();
        let corners = || triangles.iter().flatten();
        let is_far = |[x, y]: [f64; 2]| corners().all(|[cx, cy, _]| (cx - x).hypot(cy - y) > FAR_M);
        if on_map.is_some_and(is_far) {
            return Err(wrong("it has coordinates of its own, far from its place: leave place out"));
        }
        // Footprints without heights of their own are read at height 0.
        let lies_at_zero = corners().map(|[_, _, z]| *z).reduce(f64::min) == Some(0.0);
        let base = match on_map {
            Some(on_map) if added.base_m.is_none() => Base::At(on_map),
            None if lies_at_zero => Base::Along,
            _ => Base::Known,
        };
        Ok((Addition::Model(triangles), base))
    }
}

impl Change {
    /// The rectangle on the map in which something is changed; `None` if it is known only with the city's objects.
    pub(super) fn area(&self) -> Option<[[f64; 2]; 2]> {
        if !self.ids.is_empty() || !self.numbers.is_empty() {
            return None;
        }
        let added = self.added.iter().flat_map(|(addition, _)| places_of(addition));
        let nothing = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        let bounds = added.chain(self.areas.iter().flatten().flatten().copied()).fold(nothing, |[low, high], place| {
            [[0, 1].map(|k| low[k].min(place[k])), [0, 1].map(|k| high[k].max(place[k]))]
        });
        (bounds[0][0] <= bounds[1][0]).then_some(bounds)
    }

    /// The surface after the change. Fails if a building is not there, or if an addition has no ground below it.
    pub(super) fn after(&self, proposal: &Proposal, surface: &CitySurface) -> Result<CitySurface, CommandError> {
        let known: BTreeSet<&str> = surface.buildings.iter().map(|building| &building.identifier[..]).collect();
        if let Some(id) = self.ids.iter().find(|id| !known.contains(&id[..])) {
            return Err(proposal.wrong(&format!("there is no building {id} in the city, or in the area of --bbox")));
        }
        let is_removed =
            |building: &Building| self.ids.contains(&building.identifier) || self.numbers.contains(building.number);
        let cleared = surface.without_objects(&is_removed, &self.areas);
        let no_ground = || proposal.wrong("there is no ground of the city below what is added");
        let mut additions = Vec::new();
        for (addition, base) in &self.added {
            let mut addition = addition.clone();
            let base_m = match (base, &addition) {
                (Base::At(place), _) => cleared.ground_at(*place).ok_or_else(no_ground)?,
                (Base::Along, addition) => {
                    let places = places_of(addition).into_iter();
                    let ground = places.filter_map(|place| cleared.ground_at(place));
                    ground.reduce(f64::min).ok_or_else(no_ground)?
                }
                (Base::Known, _) => 0.0,
            };
            match &mut addition {
                Addition::Model(triangles) => triangles.iter_mut().flatten().for_each(|corner| corner[2] += base_m),
                Addition::Block { top_m, .. } => *top_m += base_m,
            }
            additions.push(addition);
        }
        let after = cleared.with_additions(&additions);
        if after.changes_from(surface).is_none() {
            return Err(proposal.wrong(match self.added.is_empty() {
                true => "it changes nothing: no building passes its filters, and nothing stands in its polygons",
                false => "it changes nothing: the additions lie below existing objects, or outside the area",
            }));
        }
        Ok(after)
    }

    /// What an answer after the change is beside one before it.
    pub(super) fn between(
        &self,
        what: Analysis,
        [before, after]: [&CitySurface; 2],
        earlier: &Answer,
        later: Answer,
    ) -> Answer {
        let [before, after] = [(before, earlier), (after, &later)].map(|(surface, answer)| SurfaceValues {
            surface,
            tops: &answer.tops,
            points: &answer.points,
            walls: &answer.walls,
        });
        let (tops, points, walls) = change(before, after);
        let name = if self.title.is_empty() { "proposal" } else { &self.title };
        let mut notes = later.notes;
        let meaning = match what {
            Analysis::Shadow => "1 is new shadow, and -1 shadow that goes",
            Analysis::View => "1 is newly seen, and -1 no longer",
            _ => "what is below 0 is lost",
        };
        notes.push(format!("{name}: values are changes, after less before, up to {AROUND_M} m around it; {meaning}"));
        Answer {
            tops,
            points,
            walls,
            asked: None,
            title: format!("change of {} by {name}", later.title),
            notes,
            ..later
        }
    }
}

/// The corners on the map.
fn places_of(addition: &Addition) -> Vec<[f64; 2]> {
    match addition {
        Addition::Model(triangles) => triangles.iter().flatten().map(|[x, y, _]| [*x, *y]).collect(),
        Addition::Block { outline, .. } => outline.concat(),
    }
}
