//! Options and shared state of reading.

use super::duplicates::DuplicateOption;
use super::facade_city::FacadeCity;
use super::proposal_options::ProposalOptions;
use super::scene_builder::{AnchoredBuilding, OpenObject, SceneBuilder, WorldTriangle};
use super::stone::{CityStone, mean_colour};
use super::texture::TextureLoader;
use crate::error::BakeError;
use crate::scene::ObjectKind;
use crate::scene::object_records::{RecordPlace, SourceRecord};
use crate::scene::scratch_scene::{ScratchScene, StoredMaterial};
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;
use insula_dress::facade::{FacadeMaker, FacadeOption, FacadeUse};
use insula_dress::map_store::MapStore;
use insula_dress::paint::PaintShape;
use insula_dress::palette::{BuildingLook, Palette, SurfaceFacts};
use insula_dress::polygon::Triangulator;
use insula_place::PlacingOptions;
use insula_place::local_frame::LocalFrame;
use insula_place::placement::{FirstShape, Placement, World};
use insula_protocol::blockmap::ground::GROUND_COLOUR;
use insula_protocol::manifest::MAX_STONES;
use insula_read_ground::elevation::{
    Drape, Elevation, FarModels, GroundPictures, LandColours, LandFacts, LevelGround, SurroundingsOptions,
    TerrainOptions, TerrainTile,
};
use insula_source::address_reader::AddressReader;
use insula_source::attributes::{Attributes, NamePatterns};
use insula_source::error::InputError;
use insula_source::object::{CrsReference, FeatureKind, KindFilter};
use insula_source::problems::{
    COARSE_TERRAIN, FAR_PICTURE, FAR_TERRAIN, MISSING_HEIGHTS, NO_CRS, ODD_ZEROS, OUTSIDE, PICTURE_ALONE,
};
use insula_source::report::{FacadeReport, ReadReport, SourceReport};
use insula_source::units::HeightUnit;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The vertical axis of an OBJ file. In the other formats it is always z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ObjUpAxis {
    /// x is east, y is north.
    #[default]
    Z,
    /// x is east, z is south, as modelling programs export.
    Y,
}

/// How to read, and the limits.
#[derive(Debug, Clone)]
pub struct ReadOptions {
    pub obj_up: ObjUpAxis,
    /// Images with more pixels are not decoded.
    pub max_texture_pixels: u64,
    /// Sources with more unpacked bytes are refused.
    pub max_source_bytes: u64,
    /// CityJSON documents with more unpacked bytes are refused: the text is in memory while it is read.
    pub max_document_bytes: u64,
    /// A scene whose triangles and texels take more bytes of memory is refused, where they are not in scratch files.
    pub max_held_bytes: u64,
    /// Longer lines of a CityJSONSeq or GeoJSON are skipped. A larger feature of a GeoJSON document is an error.
    pub max_line_bytes: u64,
    /// Colours of surfaces, and what is done with those of the source.
    pub palette: Palette,
    /// Folders from which textures and material libraries may be read besides the source's own.
    pub texture_roots: Vec<PathBuf>,
    /// Whether links in folders of inputs, and among the matches of patterns, are followed that lead out of them.
    pub follow_links: bool,
    /// Side of a leaf's column in metres: an object with too much surface for it is left out.
    pub cell_m: f64,
    /// What walls without a texture get.
    pub facades: FacadeOption,
    /// Whether inputs that cannot be read, or of which nothing is left, are left out instead of being errors.
    pub skip_bad_inputs: bool,
    /// Kinds of objects that are read.
    pub kinds: KindFilter,
    /// Where the objects are, and where they go.
    pub placing: PlacingOptions,
    /// Attribute that has the heights of footprints, before the usual ones.
    pub height_field: Option<String>,
    /// Unit of heights in attributes that do not tell it; `None` for metres.
    pub height_unit: Option<HeightUnit>,
    /// Value of elevation models that marks missing heights besides the declared one.
    pub nodata: Option<f64>,
    /// What becomes of objects that two sources have.
    pub duplicates: DuplicateOption,
    /// How elevation models become terrain.
    pub terrain: TerrainOptions,
    /// Whether flat areas and lines are painted on ground at the feet of the buildings where there is no elevation model.
    pub level_ground: bool,
    /// Sources of which only streets, water and green are taken: they are painted on the ground.
    pub streets: Vec<PathBuf>,
    /// The land around the city.
    pub surroundings: SurroundingsOptions,
    /// Reads inputs that are addresses; without it they are refused.
    pub addresses: Option<&'static dyn AddressReader>,
    /// Attributes that the baked city must not have.
    pub dropped_attributes: NamePatterns,
    /// File that places landmarks.
    pub landmarks: Option<PathBuf>,
    /// Whether the only source is the mesh of a monument without a city.
    pub is_monument: bool,
    /// JSON text of its stone.
    pub stone: Option<String>,
    /// What a proposal changes.
    pub proposal: Option<ProposalOptions>,
    /// Place to which the coordinates are relative; `None` for the middle of the city.
    pub origin: Option<[f64; 3]>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            obj_up: ObjUpAxis::Z,
            max_texture_pixels: 64 << 20,
            max_source_bytes: 8 << 30,
            max_document_bytes: 8 << 30,
            max_held_bytes: 2 << 30,
            max_line_bytes: 256 << 20,
            palette: Palette::default(),
            texture_roots: Vec::new(),
            follow_links: false,
            cell_m: 1.0,
            facades: FacadeOption::default(),
            skip_bad_inputs: false,
            kinds: KindFilter::default(),
            placing: PlacingOptions::default(),
            height_field: None,
            height_unit: None,
            nodata: None,
            duplicates: DuplicateOption::default(),
            terrain: TerrainOptions::default(),
            level_ground: false,
            streets: Vec::new(),
            surroundings: SurroundingsOptions::default(),
            addresses: None,
            dropped_attributes: NamePatterns::default(),
            landmarks: None,
            is_monument: false,
            stone: None,
            proposal: None,
            origin: None,
        }
    }
}

/// Receives the number of bytes of the current source that are done.
pub(crate) type ByteProgress<'a> = &'a dyn Fn(u64);

/// The state that all sources of a city share.
pub(crate) struct ReadContext<'o> {
    pub(crate) options: &'o ReadOptions,
    pub(crate) builder: SceneBuilder,
    pub(crate) textures: TextureLoader,
    pub(crate) triangulator: Triangulator,
    /// Index of the current source.
    pub(crate) source: usize,
    /// The city's coordinate system.
    pub(crate) world: World,
    /// The ground's heights.
    pub(crate) elevation: Elevation,
    /// What is painted on terrain.
    pub(crate) shapes: MapStore<PaintShape>,
    /// Whether a source in degrees may choose the city's coordinate system, because no other source has one.
    pub(crate) is_last_resort: bool,
    /// Whether reading ends at the first place, because only the coordinate system is wanted.
    pub(crate) ends_at_place: bool,
    /// Whether the source is what a proposal adds. It has the place of the proposal, if that has one, and z points up.
    pub(crate) is_addition: bool,
    pub(crate) addition_place: Option<(CrsReference, LocalFrame)>,
    facades: FacadeMaker,
    stones: Vec<String>,
}

/// Terrain reaches so far beyond buildings for what is painted on it. Some areas and lines of extracts end far outside.
const PAINTED_REACH_M: f64 = 2000.0;
/// Beyond a city whose streets are from another source, which may be that of a country.
const STREETS_REACH_M: f64 = 100.0;
/// Problem of a building.
const OFF_GROUND: &str = "building above or below the elevation model by more than --terrain-tolerance";
/// Problem of a tile of terrain.
const BAD_TILE: &str = "terrain tile that cannot be read, a coarser one drawn";

/// An error while the ground was made.
fn no_ground(error: BakeError) -> InputError {
    match error {
        BakeError::Read(error) => error,
        error => InputError::io("the ground", std::io::Error::other(error)),
    }
}

/// The state before a source.
pub(crate) struct SourceMark {
    objects: usize,
    world: World,
}

impl<'o> ReadContext<'o> {
    /// Fails if the city's coordinate system is not known.
    pub(crate) fn new(
        options: &'o ReadOptions,
        triangles: TriangleStore,
        textures: TextureStore,
    ) -> Result<Self, InputError> {
        let PlacingOptions { crs, grids, .. } = &options.placing;
        Ok(Self {
            options,
            builder: SceneBuilder::new(triangles, options.cell_m),
            textures: TextureLoader::new(options.max_texture_pixels, textures),
            triangulator: Triangulator::new(),
            source: 0,
            world: World::new(crs.as_deref(), grids.clone())?.with_options(&options.placing, options.height_unit),
            elevation: Elevation::default(),
            shapes: MapStore::new(Path::new(""), u64::MAX, 0),
            is_last_resort: false,
            ends_at_place: false,
            is_addition: false,
            addition_place: None,
            facades: FacadeMaker::default(),
            stones: Vec::new(),
        })
    }

    /// Moves faces to an object that is open in the builder. If facades are generated, walls get them by the building's
    /// use.
    pub(crate) fn push(&mut self, open: &mut OpenObject, faces: &mut Vec<WorldTriangle>, facade_use: FacadeUse) {
        if self.options.facades == FacadeOption::Windows {
            let has_facade = {
                // Terrain is made to meet buildings with heights of their own.
                let stands = !open.has_own_base && !self.elevation.is_empty();
                let ground = stands.then_some((&mut self.elevation, &mut self.world));
                let mut city = FacadeCity { builder: &mut self.builder, textures: &mut self.textures, ground };
                self.facades.apply(faces, facade_use, &mut city)
            };
            if has_facade && !std::mem::replace(&mut open.has_facade, true) {
                self.facades.count_object();
            }
        }
        self.builder.push(open, faces);
        faces.clear();
    }

    /// Keeps what a source says of an object. Attributes that the options drop are left out.
    pub(crate) fn record_of(&mut self, id: &str, kind: FeatureKind, attributes: &Attributes) -> RecordPlace {
        let kept = attributes.iter().filter(|(name, _)| !self.options.dropped_attributes.contains(name));
        let attributes = kept.map(|(name, value)| (name.to_owned(), value.into())).collect();
        self.builder.add_record(SourceRecord { identifier: id.to_owned(), kind, attributes })
    }

    /// Number and mean colour of a stone, by the JSON text of its parameters. Fails if it is no stone, or one too many.
    pub(crate) fn add_stone(&mut self, label: &str, text: &str) -> Result<CityStone, InputError> {
        let rgb = mean_colour(label, text)?;
        let known = self.stones.iter().position(|stone| stone == text);
        let number = known.unwrap_or(self.stones.len());
        if number >= MAX_STONES {
            return Err(InputError::unsupported(label, format!("a city has at most {MAX_STONES} stones")));
        }
        if known.is_none() {
            self.stones.push(text.to_owned());
        }
        Ok(CityStone { number: number as u8, rgb })
    }

    /// Moves landmarks without a height of their own to the ground. Fails if an elevation model or the triangles cannot be read.
    pub(crate) fn stand_landmarks(&mut self) -> Result<(), InputError> {
        let failed = |error| InputError::io("the ground", std::io::Error::other(error));
        let places = self.builder.landmarks_without_ground().map_err(failed)?;
        if places.is_empty() {
            return Ok(());
        }
        let heights_m = if self.elevation.is_empty() {
            self.builder.ground_heights(&places).map_err(failed)?
        } else {
            places.iter().map(|place| self.ground_m(*place)).collect::<Result<_, _>>()?
        };
        self.builder.stand_landmarks(&heights_m).map_err(failed)
    }

    /// The generated facades so far; `None` without.
    pub(crate) fn take_facades(&mut self) -> Option<FacadeReport> {
        std::mem::take(&mut self.facades).into_report()
    }

    /// The state before the next source.
    pub(crate) fn mark(&self) -> SourceMark {
        SourceMark { objects: self.builder.len(), world: self.world.clone() }
    }

    /// Leaves out a source that failed, as far as it was read since the mark. Fails if the objects cannot be read or written.
    pub(crate) fn abandon_source(&mut self, SourceMark { objects, world }: SourceMark) -> Result<(), InputError> {
        self.world = world;
        let failed = |error| InputError::io("the objects so far", std::io::Error::other(error));
        self.builder.abandon_since(objects).map_err(failed)
    }

    /// Gives a placement the city's system. Fails with [`InputError::NoProjection`] if the system has to follow from
    /// `first`, a shape in degrees, although another source may name a projected one.
    pub(crate) fn settle(
        &mut self,
        placement: &mut Placement,
        label: &str,
        first: impl Into<FirstShape>,
    ) -> Result<(), InputError> {
        if placement.needs_world() && !self.world.is_settled() && !self.is_last_resort {
            return Err(InputError::NoProjection { path: label.to_owned() });
        }
        placement.settle(&mut self.world, label, first)?;
        if self.ends_at_place { Err(InputError::Settled { path: label.to_owned() }) } else { Ok(()) }
    }

    /// Whether flat areas and lines are painted on terrain, because there will be some.
    pub(crate) fn is_painting(&self) -> bool {
        (self.options.level_ground || !self.elevation.is_empty()) && self.options.kinds.contains(FeatureKind::Relief)
    }

    /// Makes ground for what the sources paint, and for pictures from above, if there is no elevation model: as high as the buildings
    /// stand. Fails if scratch files fail.
    pub(crate) fn level_ground(&mut self, sources: &[SourceReport]) -> Result<(), InputError> {
        let picture = self.elevation.first_picture();
        let is_needed = picture.is_some() || !self.shapes.is_empty();
        if !self.is_painting() || !self.elevation.is_empty() || !is_needed {
            return Ok(());
        }
        let Some(bounds) = self.terrain_bounds()? else { return Ok(()) };
        let source = sources.iter().position(|source| source.painted > 0).or(picture).unwrap_or(0);
        let mut ground = LevelGround::new(source, bounds);
        let visited = self.builder.for_each_base(&mut |building| {
            ground.add(&building.base);
            Ok(())
        });
        visited.map_err(no_ground)?;
        self.elevation.set_level(ground.finished());
        Ok(())
    }

    /// World height of the ground at a position on the map, or near it; 0 if no elevation model has one there. Fails if
    /// a model cannot be read, or cannot be placed.
    pub(crate) fn ground_m(&mut self, position: [f64; 2]) -> Result<f64, InputError> {
        if self.elevation.is_empty() {
            return Ok(0.0);
        }
        self.elevation.settle(&mut self.world)?;
        Ok(match self.elevation.extended_height_m(position)? {
            Some(height_m) => height_m,
            None => self.elevation.border_height_m(position)?.unwrap_or(0.0),
        })
    }

    /// Notes the buildings that terrain has to meet: those with heights of their own that are near the ground. The others
    /// are reported. Fails if an elevation model cannot be read or placed, or if scratch files fail.
    pub(crate) fn fit_ground(&mut self, sources: &mut [SourceReport]) -> Result<(), InputError> {
        let tolerance_m = self.options.terrain.tolerance_m;
        if self.elevation.is_empty() || !self.is_painting() || tolerance_m <= 0.0 {
            return Ok(());
        }
        self.elevation.settle(&mut self.world)?;
        let elevation = &mut self.elevation;
        let visited = self.builder.for_each_base(&mut |AnchoredBuilding { id, source, base }| {
            let Some(ground_m) = elevation.ground_under_m(&base)? else { return Ok(()) };
            let Some(report) = sources.get_mut(source) else { return Ok(()) };
            let above_m = base.height_m - ground_m;
            if above_m.abs() <= tolerance_m {
                report.terrain_fitted += 1;
                let stored = elevation.bases.push(base);
                return stored.map_err(|error| InputError::io("the ground", std::io::Error::other(error)).into());
            }
            if elevation.is_guessed() {
                return Ok(());
            }
            let side = if above_m > 0.0 { "above" } else { "below" };
            report.problem(OFF_GROUND, || format!("{id}: {:.1} m {side}", above_m.abs()));
            Ok(())
        });
        visited.map_err(no_ground)
    }

    /// Adds terrain around all objects so far, if there are elevation models. Fails if one cannot be read, or cannot be
    /// placed.
    pub(crate) fn add_terrain(&mut self, sources: &mut [SourceReport]) -> Result<(), InputError> {
        let kind = FeatureKind::Relief;
        if self.elevation.is_empty()
            && let Some(report) = self.elevation.first_picture().and_then(|number| sources.get_mut(number))
        {
            let path = report.path.clone();
            report.problem(PICTURE_ALONE, || path);
        }
        if self.elevation.is_empty() || !self.options.kinds.contains(kind) {
            return Ok(());
        }
        self.elevation.settle(&mut self.world)?;
        for (number, placement, guess) in self.elevation.placements() {
            let Some(report) = sources.get_mut(number) else { continue };
            placement.note_in(report);
            if let Some(guess) = guess {
                report.problem(NO_CRS, || guess.clone());
            }
        }
        // Ground without a model passes into the generated ground. One step apart, they stay two materials, in steps, too.
        let rgb = if self.elevation.is_guessed() { GROUND_COLOUR.map(|v| v - 1) } else { self.colour_of(kind) };
        let city = self.terrain_bounds()?;
        let (builder, textures, source) = (&mut self.builder, &mut self.textures, self.elevation.first_source());
        let (set, Some(report)) = (textures.set_named("pictures from above"), sources.get_mut(source)) else {
            return Ok(());
        };
        let (cell_m, options) = (self.options.cell_m, self.options.terrain);
        let ground = GroundPictures::new(&self.shapes, rgb, cell_m, options.texel_m)
            .map_err(|error| InputError::io(&report.path, std::io::Error::other(error)))?;
        if let Some(text) = self.elevation.coarse_grid(city, cell_m, options) {
            report.problem(COARSE_TERRAIN, || text);
        }
        let mut tiles = 0_u64;
        let made = self.elevation.make_terrain(city, cell_m, options, &ground, &mut |tile| {
            let TerrainTile { name, triangles, drape } = tile;
            let drape = drape.map(|Drape { texture, place, has_photo }| {
                let number = match has_photo {
                    true => textures.add_picture(texture, set),
                    false => textures.add_generated(Arc::new(texture)),
                };
                (number, place)
            });
            let texture = drape.map(|(texture, _)| texture);
            let colour = if texture.is_some() { [255; 3] } else { rgb };
            let material = builder.material(StoredMaterial::matt(colour, texture));
            let uv = |corner: [f64; 3]| drape.map_or([0.0; 2], |(_, place)| place.uv(corner));
            let face = |corners: &[[f64; 3]; 3]| WorldTriangle {
                corners: *corners,
                uv: corners.map(uv),
                material,
                is_facade: false,
            };
            let faces: Vec<WorldTriangle> = triangles.iter().map(face).collect();
            let mut open = OpenObject::new(ObjectKind::Terrain);
            builder.push(&mut open, &faces);
            report.found += 1;
            tiles += 1;
            *report.objects_by_kind.entry(kind).or_default() += 1;
            builder.close(source, &name, open, report);
        });
        self.report_far_pictures(city, sources);
        // Guessed ground without a picture is left to the generated ground.
        if tiles == 0
            && !self.elevation.is_guessed()
            && let Some(report) = sources.get_mut(source)
        {
            let path = report.path.clone();
            report.problem(FAR_TERRAIN, || path);
        }
        self.report_odd_heights(sources);
        for (number, names, count) in self.elevation.bad_tiles() {
            let Some(report) = sources.get_mut(number) else { continue };
            for index in 0..count {
                report.problem(BAD_TILE, || names.get(index).cloned().unwrap_or_default());
            }
        }
        made
    }

    /// Reports the heights of elevation models that were taken as missing, or may be missing ones.
    fn report_odd_heights(&self, sources: &mut [SourceReport]) {
        for (number, missing) in self.elevation.missing() {
            let Some(report) = sources.get_mut(number) else { continue };
            missing.into_iter().for_each(|text| report.problem(MISSING_HEIGHTS, || text));
        }
        for (number, zeros) in self.elevation.odd_zeros() {
            let Some(report) = sources.get_mut(number) else { continue };
            report.problem(ODD_ZEROS, || zeros);
        }
    }

    /// Reports the pictures that lie beyond the terrain of a city.
    fn report_far_pictures(&self, city: Option<[[f64; 2]; 2]>, sources: &mut [SourceReport]) {
        let Some([low, high]) = city else { return };
        let reach_m = self.options.terrain.margin_m;
        for number in self.elevation.pictures_outside([low.map(|v| v - reach_m), high.map(|v| v + reach_m)]) {
            if let Some(report) = sources.get_mut(number) {
                let path = report.path.clone();
                report.problem(FAR_PICTURE, || path);
            }
        }
    }

    /// Lowest and highest corner on the map of what needs ground: the objects, and what is painted near them, within the
    /// wanted area if there is one. `None` without all of these.
    fn terrain_bounds(&mut self) -> Result<Option<[[f64; 2]; 2]>, InputError> {
        let failed = |error| InputError::io("the ground", std::io::Error::other(error));
        let reach_m = if self.options.streets.is_empty() { PAINTED_REACH_M } else { STREETS_REACH_M };
        let bounds = match (self.builder.bounds_on_map().map_err(failed)?, self.shapes.bounds()) {
            (Some([low, high]), Some([painted_low, painted_high])) => Some([
                [0, 1].map(|axis| low[axis].min(painted_low[axis].max(low[axis] - reach_m))),
                [0, 1].map(|axis| high[axis].max(painted_high[axis].min(high[axis] + reach_m))),
            ]),
            (objects, painted) => objects.or(painted),
        };
        let wanted = self.wanted_area();
        let (Some([low, high]), Some([wanted_low, wanted_high])) = (bounds, wanted) else {
            return Ok(bounds.or(wanted));
        };
        let low: [f64; 2] = [0, 1].map(|axis| low[axis].max(wanted_low[axis]));
        let high: [f64; 2] = [0, 1].map(|axis| high[axis].min(wanted_high[axis]));
        let overlaps = (0..2).all(|axis| low[axis] < high[axis]);
        Ok(if overlaps { Some([low, high]) } else { wanted })
    }

    /// Colour of the ground of a kind, 8-bit sRGB.
    fn colour_of(&self, kind: FeatureKind) -> [u8; 3] {
        let facts = SurfaceFacts { semantic: None, object_type: kind.cityjson_type(), material: None, normal_z: 1.0 };
        self.options.palette.resolve(None, &facts, &BuildingLook::PLAIN).0
    }

    fn land_colours(&self) -> LandColours {
        LandColours { land: self.colour_of(FeatureKind::Relief), water: self.colour_of(FeatureKind::Water) }
    }

    /// The land around the city, as it was measured. Fails if a model cannot be placed.
    pub(crate) fn into_land(mut self, facts: LandFacts) -> Result<FarModels, InputError> {
        self.elevation.settle(&mut self.world)?;
        let colours = self.land_colours();
        Ok(FarModels::known(self.elevation, colours, facts))
    }

    /// The land around the city; `None` if none is wanted or known. Fails if an elevation model cannot be read.
    pub(crate) fn take_surroundings(&mut self) -> Result<Option<FarModels>, InputError> {
        let colours = self.land_colours();
        let failed = |error| InputError::io("the land", std::io::Error::other(error));
        let city = self.builder.bounds_on_map().map_err(failed)?;
        let elevation = std::mem::take(&mut self.elevation);
        FarModels::new(elevation, city, &self.options.surroundings, colours)
    }

    /// The city of all sources, without what is left out: objects outside of the wanted area, duplicates, and what is
    /// too far away. Corrects the reports. Fails if the stored triangles cannot be read.
    pub(crate) fn finish(mut self, report: &mut ReadReport) -> Result<ScratchScene, BakeError> {
        let sources = &mut report.sources;
        if let Some([low, high]) = self.wanted_area() {
            self.builder.drop_outside(low, high, sources)?;
        }
        // Before a proposal, they are left out already: what it adds is no duplicate.
        if report.proposal.is_none() {
            self.builder.drop_duplicates(self.options.duplicates, sources)?;
        }
        let mut city = self.builder.finish_at(self.options.origin, self.textures.textures, sources)?;
        if let Some([low, high]) = city.bounds {
            let middle = [0, 1].map(|axis: usize| city.origin[axis] + (low[axis] + high[axis]) / 2.0);
            if let (Some(text), Some(source)) =
                (self.world.far_text(middle), sources.iter_mut().find(|source| source.objects > 0))
            {
                source.problem(OUTSIDE, || text);
            }
        }
        city.crs = self.world.crs_name();
        report.vertical_datum = self.world.vertical();
        report.geoid = self.world.geoid();
        report.stones = self.stones;
        Ok(city)
    }

    /// Lowest and highest corner on the map of the area that the options name; `None` without one, or if the city's system does not
    /// have it.
    pub(crate) fn wanted_area(&mut self) -> Option<[[f64; 2]; 2]> {
        match (self.options.placing.bbox_deg, self.options.placing.bbox_m) {
            (Some(degrees), _) => self.area_on_map(degrees),
            (None, metres) => metres.map(|[west, south, east, north]| [[west, south], [east, north]]),
        }
    }

    /// The box on the map around an area in degrees; `None` if the city's system does not have it.
    fn area_on_map(&mut self, [west, south, east, north]: [f64; 4]) -> Option<[[f64; 2]; 2]> {
        /// Points along each side: the sides are curves on the map.
        const STEPS: u32 = 16;
        let degrees = CrsReference::east_first("OGC:CRS84");
        let placement = self.world.place("--bbox", &degrees).ok()?;
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for i in 0..=STEPS {
            for j in 0..=STEPS {
                let at = |from: f64, to: f64, step: u32| from + (to - from) * f64::from(step) / f64::from(STEPS);
                let [x, y, _] = placement.position([at(west, east, i), at(south, north, j), 0.0])?;
                for (axis, value) in [x, y].into_iter().enumerate() {
                    low[axis] = low[axis].min(value);
                    high[axis] = high[axis].max(value);
                }
            }
        }
        Some([low, high])
    }
}
