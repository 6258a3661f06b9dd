//! What a proposal changes, on the map of a city.

use super::{AddTable, Proposal, ProposalError};
use crate::area_file::read_polygons;
use insula_analysis::proposal::Addition;
use insula_analysis::surface::{Building, CitySurface};
use insula_bake::read::{self, EarthPlace, PlacingOptions, ReadOptions};
use insula_export::selection::{Polygon, area_around, passing};
use insula_export::source::ExportSource;
use insula_objects::filter::Filter;
use insula_protocol::text::printable;
use roaring::RoaringBitmap;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// All of a model is so near to its place.
const FAR_M: f64 = 2000.0;
/// How far around what is added ground is looked for, where objects are removed.
const AROUND_GROUND_M: f64 = 50.0;
/// Most corners of all outlines and areas.
const MAX_CORNERS: usize = 1 << 18;
/// Most triangles of all models.
const MAX_TRIANGLES: usize = 1 << 22;
/// Most cells below the boxes of triangles, outlines and areas: each is compared with all above it.
const MAX_CELLS: f64 = 4e9;
/// What is so far above all below it has a wrong height, as one in feet.
const FAR_ABOVE_M: f64 = 100.0;
pub(super) const NOTHING_REMOVED: &str =
    "it changes nothing: no building passes its filters, and nothing stands in its polygons";

/// What is changed, on the map.
pub struct ProposedChange {
    pub(super) added: Vec<AddedShape>,
    /// Identifiers of buildings that are removed.
    pub(super) ids: BTreeSet<String>,
    /// Objects that pass the filters.
    pub(super) numbers: RoaringBitmap,
    /// Areas in which everything above the ground is removed.
    pub(super) areas: Vec<Polygon>,
}

/// A model or a block.
pub(super) struct AddedShape {
    pub(super) file: PathBuf,
    /// Of a model without coordinates of its own: longitude, latitude and height of its origin. The height is 0 unless it is known.
    pub(super) origin: Option<[f64; 3]>,
    pub(super) heading_deg: f64,
    /// At height 0, unless its base is known.
    pub(super) addition: Addition,
    base: Base,
    /// Of a block: from its base to its top. 0 for a model.
    pub(super) height_m: f64,
    /// What reading its file says to people.
    warnings: Vec<String>,
}

/// How much a proposal adds and removes, on the map of a city: the work of analyses.
struct Amounts {
    /// Lower and upper corner of the city on the map, and the side of its cells.
    city: [[f64; 2]; 2],
    cell_m: f64,
    corners: usize,
    triangles: usize,
    cells: f64,
}

impl Amounts {
    /// Fails with what is too much.
    fn add_area(&mut self, area: &Polygon) -> Result<(), String> {
        self.corners += area.iter().map(Vec::len).sum::<usize>();
        if self.corners > MAX_CORNERS {
            return Err(format!("its outlines and areas have more than {MAX_CORNERS} corners in all: simplify them"));
        }
        self.cells += around(area.iter().flatten().copied()).map_or(0.0, |bounds| self.cells_below(bounds));
        self.check_cells()
    }

    /// Fails with what is too much.
    fn add_model(&mut self, triangles: &[[[f64; 3]; 3]]) -> Result<(), String> {
        self.triangles += triangles.len();
        if self.triangles > MAX_TRIANGLES {
            return Err(format!("its models have more than {MAX_TRIANGLES} triangles in all: simplify them"));
        }
        let bounds = triangles.iter().filter_map(|triangle| around(triangle.iter().map(|[x, y, _]| [*x, *y])));
        self.cells += bounds.map(|bounds| self.cells_below(bounds)).sum::<f64>();
        self.check_cells()
    }

    fn check_cells(&self) -> Result<(), String> {
        match self.cells > MAX_CELLS {
            true => Err("it has too many large outlines, areas or triangles: make fewer or smaller ones".to_owned()),
            false => Ok(()),
        }
    }

    /// Number of the city's cells in a rectangle.
    fn cells_below(&self, [from, to]: [[f64; 2]; 2]) -> f64 {
        let [low, high] = self.city;
        let side = |axis: usize| {
            let [from, to] = [from, to].map(|corner| corner[axis].max(low[axis]).min(high[axis]));
            (to - from) / self.cell_m + 1.0
        };
        side(0) * side(1)
    }
}

/// What an addition stands on.
#[derive(PartialEq)]
enum Base {
    /// Heights are right.
    Known,
    /// The ground at a place.
    At([f64; 2]),
    /// The lowest ground along the outline, or below the model.
    Along,
}

impl Proposal {
    /// Reads the models, outlines and filters. Fails if one cannot be read, or lies outside of the city.
    pub fn change(
        &self,
        source: &dyn ExportSource,
        place: Option<&EarthPlace>,
    ) -> Result<ProposedChange, ProposalError> {
        let city = source.manifest().bounds.map(|[x, y, _]| [x, y]);
        let polygons =
            |file: &Path| read_polygons(&self.beside(file), city, place).map_err(|reason| self.wrong(&reason));
        let inside = |file: &Path, places: Vec<[f64; 2]>| match around(places.into_iter()) {
            Some([low, high]) if (0..2).all(|k| low[k] <= city[1][k] && city[0][k] <= high[k]) => Ok(()),
            _ => Err(self.wrong(&format!("{} lies outside of the city: check its place", name_of(file)))),
        };
        let cell_m = source.manifest().cell_m;
        let mut amounts = Amounts { city, cell_m, corners: 0, triangles: 0, cells: 0.0 };
        let mut change = ProposedChange {
            added: Vec::new(),
            ids: BTreeSet::new(),
            numbers: RoaringBitmap::new(),
            areas: Vec::new(),
        };
        for added in &self.add {
            if let Some(file) = &added.file {
                let model = self.model(added, &self.beside(file), source, place)?;
                inside(file, model.places())?;
                if let Addition::Model(triangles) = &model.addition {
                    amounts.add_model(triangles).map_err(|reason| self.wrong(&reason))?;
                }
                change.added.push(model);
            }
            let Some(file) = &added.outline else { continue };
            let height_m = added.height_m.unwrap_or(0.0);
            for outline in polygons(file)? {
                inside(file, outline.concat())?;
                amounts.add_area(&outline).map_err(|reason| self.wrong(&reason))?;
                let addition = Addition::Block { outline, top_m: added.base_m.unwrap_or(0.0) + height_m };
                let base = if added.base_m.is_some() { Base::Known } else { Base::Along };
                let (file, warnings) = (self.beside(file), Vec::new());
                let shape = AddedShape { file, origin: None, heading_deg: 0.0, addition, base, height_m, warnings };
                change.added.push(shape);
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
                let areas = polygons(file)?;
                inside(file, areas.iter().flatten().flatten().copied().collect())?;
                areas.iter().try_for_each(|area| amounts.add_area(area)).map_err(|reason| self.wrong(&reason))?;
                change.areas.extend(areas);
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
    ) -> Result<AddedShape, ProposalError> {
        let wrong = |reason: &str| self.wrong(&format!("{}: {reason}", file.display()));
        let degrees = added.place.as_ref().and_then(|place| Some([*place.first()?, *place.get(1)?]));
        let on_map = match degrees {
            Some(degrees) => {
                let place = place.ok_or_else(|| wrong("it is not known where on Earth this city lies"))?;
                Some(place.on_map(degrees).ok_or_else(|| wrong("its place is out of the city's coordinate system"))?)
            }
            None => None,
        };
        let origin = degrees.map(|[lon, lat]| [lon, lat, added.base_m.unwrap_or(0.0)]);
        let placing = PlacingOptions { crs: source.manifest().crs.clone(), at: origin, ..PlacingOptions::default() };
        let options = ReadOptions { placing, ..ReadOptions::default() };
        let (scene, report) = read::read(&[file.to_owned()], &options, &|_| ())
            .map_err(|error| self.wrong(&without_options(&error.to_string())))?;
        let warnings = report.warnings().map(|warning| format!("warning: {}", without_options(&warning))).collect();
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
        Ok(AddedShape {
            file: file.to_owned(),
            origin,
            heading_deg: added.heading_deg,
            addition: Addition::Model(triangles),
            base,
            height_m: 0.0,
            warnings,
        })
    }
}

impl ProposedChange {
    /// The rectangle on the map in which something is changed; `None` if it is known only with the city's objects.
    pub fn area(&self) -> Option<[[f64; 2]; 2]> {
        if !self.ids.is_empty() || !self.numbers.is_empty() {
            return None;
        }
        let added = self.added.iter().flat_map(AddedShape::places);
        around(added.chain(self.areas.iter().flatten().flatten().copied()))
    }

    /// What is added, for its places on the map: heights may be above its ground.
    pub fn added_on_map(&self) -> Vec<&Addition> {
        self.added.iter().map(|shape| &shape.addition).collect()
    }

    /// The surface after the change. Fails if a building is not there, or if an addition has no ground below it.
    pub fn after(&self, proposal: &Proposal, surface: &CitySurface) -> Result<CitySurface, ProposalError> {
        let known: BTreeSet<&str> = surface.buildings.iter().map(|building| &building.identifier[..]).collect();
        if let Some(id) = self.ids.iter().find(|id| !known.contains(&id[..])) {
            return Err(proposal.wrong(&format!("there is no building {id} in the city, or in the area of --bbox")));
        }
        let cleared = self.cleared(surface);
        let additions = self.raised(&self.lifts(proposal, &cleared)?);
        let after = cleared.with_additions(&additions);
        if after.changes_from(surface).is_none() {
            return Err(proposal.wrong(match self.added.is_empty() {
                true => NOTHING_REMOVED,
                false => "it changes nothing: the additions lie below existing objects, or outside the area",
            }));
        }
        self.say(&self.odd_heights(&additions, &cleared));
        Ok(after)
    }

    /// Says what people should know of what is added, when nothing is wrong with it.
    pub(super) fn say(&self, notes: &[String]) {
        let warnings = self.added.iter().flat_map(|shape| &shape.warnings);
        warnings.chain(notes).for_each(|line| eprintln!("{}", printable(line)));
    }

    /// What stands below the ground of a surface, or far above all that is below it.
    fn odd_heights(&self, additions: &[Addition], surface: &CitySurface) -> Vec<String> {
        let note = |(shape, addition): (&AddedShape, &Addition)| {
            let [low, high] = shape.heights(addition)?;
            let places = shape.places();
            let ground = places.iter().filter_map(|place| surface.ground_at(*place)).reduce(f64::min);
            let top = places.iter().filter_map(|place| surface.top_at(*place)).reduce(f64::max);
            let what = match (ground, top) {
                (Some(ground), _) if high < ground => format!("lies {:.1} m below the ground", ground - high),
                (_, Some(top)) if low > top + FAR_ABOVE_M => {
                    format!("is {:.0} m above all that is below it", low - top)
                }
                _ => return None,
            };
            Some(format!("note: {} {what}: check base_m, or the heights of its file", name_of(&shape.file)))
        };
        self.added.iter().zip(additions).filter_map(note).collect()
    }

    /// The surface without what is removed.
    pub fn cleared(&self, surface: &CitySurface) -> CitySurface {
        let is_removed =
            |building: &Building| self.ids.contains(&building.identifier) || self.numbers.contains(building.number);
        surface.without_objects(&is_removed, &self.areas)
    }

    /// By how much what is added is raised to stand on the ground of a surface. Fails if an addition has no ground below it.
    fn lifts(&self, proposal: &Proposal, cleared: &CitySurface) -> Result<Vec<f64>, ProposalError> {
        let on_ground = |shape: &AddedShape| {
            let base_m = match &shape.base {
                Base::At(place) => cleared.ground_at(*place),
                Base::Along => {
                    let ground = shape.places().into_iter().filter_map(|place| cleared.ground_at(place));
                    ground.reduce(f64::min)
                }
                Base::Known => Some(0.0),
            };
            base_m.ok_or_else(|| proposal.wrong("there is no ground of the city below what is added"))
        };
        self.added.iter().map(on_ground).collect()
    }

    /// What is added, raised by so much.
    fn raised(&self, lifts: &[f64]) -> Vec<Addition> {
        self.added.iter().zip(lifts).map(|(shape, by_m)| shape.raised(*by_m)).collect()
    }

    /// By how much what is added is raised to stand on the ground of a city after the change, and what stands oddly on it. Fails if an
    /// addition has no ground below it, or if tiles cannot be read.
    pub(super) fn lifts_in(
        &self,
        proposal: &Proposal,
        source: &dyn ExportSource,
    ) -> Result<(Vec<f64>, Vec<String>), ProposalError> {
        let cleared = |[low, high]: [[f64; 2]; 2]| {
            let area = [low.map(|v| v - AROUND_GROUND_M), high.map(|v| v + AROUND_GROUND_M)];
            CitySurface::read(source, Some(area)).map(|surface| self.cleared(&surface))
        };
        let on_ground = self.added.iter().filter(|shape| shape.base != Base::Known);
        if let Some(area) = around(on_ground.flat_map(AddedShape::places)) {
            let cleared = cleared(area).map_err(|error| proposal.wrong(&error.to_string()))?;
            let lifts = self.lifts(proposal, &cleared)?;
            let notes = self.odd_heights(&self.raised(&lifts), &cleared);
            return Ok((lifts, notes));
        }
        let lifts = vec![0.0; self.added.len()];
        // Nothing needs the ground: where it cannot be read, there are no notes.
        let cleared = around(self.added.iter().flat_map(AddedShape::places)).and_then(|area| cleared(area).ok());
        let notes = cleared.map(|cleared| self.odd_heights(&self.raised(&lifts), &cleared)).unwrap_or_default();
        Ok((lifts, notes))
    }
}

impl AddedShape {
    /// The corners on the map.
    pub(super) fn places(&self) -> Vec<[f64; 2]> {
        match &self.addition {
            Addition::Model(triangles) => triangles.iter().flatten().map(|[x, y, _]| [*x, *y]).collect(),
            Addition::Block { outline, .. } => outline.concat(),
        }
    }

    /// The lowest and the highest, of this where it stands; `None` without any.
    fn heights(&self, standing: &Addition) -> Option<[f64; 2]> {
        match standing {
            Addition::Block { top_m, .. } => Some([top_m - self.height_m, *top_m]),
            Addition::Model(triangles) => {
                let heights = || triangles.iter().flatten().map(|[_, _, z]| *z);
                Some([heights().reduce(f64::min)?, heights().reduce(f64::max)?])
            }
        }
    }

    /// Some metres higher.
    pub(super) fn raised(&self, by_m: f64) -> Addition {
        let mut addition = self.addition.clone();
        match &mut addition {
            Addition::Model(triangles) => triangles.iter_mut().flatten().for_each(|corner| corner[2] += by_m),
            Addition::Block { top_m, .. } => *top_m += by_m,
        }
        addition
    }
}

/// A file's name with its end: a model has one of the same name in another format beside it.
pub(super) fn name_of(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The rectangle around places; `None` without any.
fn around(places: impl Iterator<Item = [f64; 2]>) -> Option<[[f64; 2]; 2]> {
    let bounds = area_around(places);
    (bounds[0][0] <= bounds[1][0]).then_some(bounds)
}

/// What a bake says of a file, whose advice is of options that proposals lack.
fn without_options(text: &str) -> String {
    let text = text.replace("(--crs)", "(the city's)");
    let mut clauses = text.split("; ");
    let first = clauses.next().unwrap_or_default().to_owned();
    let own = |clause: &str| {
        let ways: Vec<&str> = clause.split(", or ").filter(|way| !way.contains("--")).collect();
        match () {
            () if !ways.is_empty() => Some(ways.join(", or ")),
            () if clause.contains("--height-field") => Some("give them in metres as the attribute height".to_owned()),
            () if clause.contains("--crs") => {
                Some("write them in the city's coordinate system, or give a place".to_owned())
            }
            () => None,
        }
    };
    [first].into_iter().chain(clauses.filter_map(own)).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_files_that_ask_for_much_work_are_refused() {
        let amounts = || {
            let city = [[0.0; 2], [4000.0; 2]];
            Amounts { city, cell_m: 0.5, corners: 0, triangles: 0, cells: 0.0 }
        };
        let area: Polygon = vec![vec![[1.0, 1.0]; 1000]];
        let mut corners = amounts();
        let taken = (0..1000).take_while(|_| corners.add_area(&area).is_ok()).count();
        assert_eq!(taken, MAX_CORNERS / 1000);
        // A house of 500 triangles, and as many that reach over the whole city, each above all of its 64 million cells.
        let triangle = |side: f64| [[0.0, 0.0, 1.0], [side, 0.0, 1.0], [0.0, side, 9.0]];
        assert_eq!(amounts().add_model(&vec![triangle(20.0); 500]), Ok(()));
        assert!(amounts().add_model(&vec![triangle(1e6); 500]).unwrap_err().contains("too many large"));
        let mut triangles = Amounts { triangles: MAX_TRIANGLES - 1, ..amounts() };
        assert_eq!(triangles.add_model(&[triangle(1.0)]), Ok(()));
        assert!(triangles.add_model(&[triangle(1.0)]).unwrap_err().contains("in all"));
        let mut blocks = amounts();
        let whole: Polygon = vec![vec![[-9.0, -9.0], [9e3, -9.0], [9e3, 9e3]]];
        assert!((0..500).any(|_| blocks.add_area(&whole).is_err()));
    }

    #[test]
    fn advice_is_of_what_proposals_have() {
        for (said, expected) in [
            (
                "a--b.geojson: 3 of 3 heights of buildings are guessed; attributes with numbers: h; name the one that has the heights with \
                 --height-field",
                "a--b.geojson: 3 of 3 heights of buildings are guessed; attributes with numbers: h; give them in metres as the attribute \
                 height",
            ),
            (
                "a.obj: coordinates such as 1, 2 are taken as metres of an unknown place; give their system with --crs",
                "a.obj: coordinates such as 1, 2 are taken as metres of an unknown place; write them in the city's coordinate system, or give a place",
            ),
            (
                "a.obj: coordinates are taken in EPSG:28992 (--crs)",
                "a.obj: coordinates are taken in EPSG:28992 (the city's)",
            ),
            (
                "a.gml: not known; reproject the file with ogr2ogr -t_srs EPSG:..., or give its system with --crs",
                "a.gml: not known; reproject the file with ogr2ogr -t_srs EPSG:...",
            ),
            ("a.gml: too large; split the file", "a.gml: too large; split the file"),
        ] {
            assert_eq!(without_options(said), expected);
        }
    }
}
