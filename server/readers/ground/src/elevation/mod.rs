//! The ground from rasters: its height anywhere, terrain made of it, and pictures of it from above.
//!
//! | step | module |
//! |---|---|
//! | a raster with its place | `model` |
//! | where a grid's points lie in a raster | `lattice`, `pixel_finder` |
//! | triangles of a region | `terrain`, with [`insula_roam`] |
//! | heights under buildings that have their own | `fit` |
//! | heights where there is no raster | `level` |
//! | the picture on them | `drape` |
//! | the land around the city, read square by square while it is baked | `surroundings` |

mod drape;
mod fit;
mod lattice;
mod level;
mod missing;
mod model;
mod pixel_finder;
mod surroundings;
mod terrain;
mod terrain_files;

use super::raster::{AuxFile, GeoPlace, HEIGHTS_AND_DEPTHS_M, HEIGHTS_M, Raster, RasterError, RasterLimits};
pub use drape::{Drape, GroundPictures};
use fit::fit_to_bases;
use insula_dress::building_base::BuildingBase;
use insula_dress::map_store::MapStore;
use insula_place::crs::is_undefined;
use insula_place::placement::{Placement, World};
use insula_source::error::InputError;
use insula_source::input::LocalFile;
use insula_source::object::CrsReference;
use insula_source::packed::unpacked_name;
use insula_source::source::{CitySource, SourceKind, kind_by_name, read_all, read_sibling};
use lattice::MapGrid;
pub use level::LevelGround;
use lru::LruCache;
use model::PlacedRaster;
use std::cell::RefCell;
use std::fs::File;
use std::num::NonZeroUsize;
use std::path::Path;
pub use surroundings::{FarModels, LandColours, LandFacts, LandSquare, SurroundingsOptions};
pub use terrain::{ALIGNED_LEAVES, TerrainOptions, TerrainTile};
use terrain_files::TerrainFiles;

/// Points along the side of a block of heights that is read for single positions.
const BLOCK_POINTS: usize = 64;
/// Blocks that are kept: 16 KiB each.
const MAX_BLOCKS: usize = 1024;
/// Known heights are sought in these directions, at distances that double, and then nearer by halves.
const DIRECTIONS: [[f64; 2]; 8] =
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.7, 0.7], [-0.7, 0.7], [0.7, -0.7], [-0.7, -0.7]];
const MAX_DOUBLINGS: u32 = 10;
const HALVINGS: u32 = 5;
/// Models further from a place tell nothing of it.
const MAX_BEYOND_M: f64 = 5000.0;
/// Warning about a picture that is black at a corner.
const BLACK_CORNER: &str =
    "a corner of the picture is black, which is drawn; if it marks missing pixels, gdal_translate -a_nodata 0 tells so";
/// Larger files beside a raster are no world files or coordinate systems.
const MAX_SIDECAR_BYTES: u64 = 1 << 20;
/// A larger `layer.json` is refused. Lists of available tiles can be long.
const MAX_LAYER_BYTES: u64 = 64 << 20;

/// A block's height at each point, by row.
type Block = Box<[f32]>;

/// All rasters of a city. Where several overlap, the finest counts.
pub struct Elevation {
    /// Rasters of heights, from coarse to fine once they are settled.
    models: Vec<PlacedRaster>,
    /// Pictures from above, in the same order.
    pictures: Vec<PlacedRaster>,
    /// The ground without models.
    level: Option<LevelGround>,
    is_settled: bool,
    /// Bases of buildings that the ground meets.
    pub bases: MapStore<BuildingBase>,
    blocks: RefCell<LruCache<[i64; 2], Block>>,
}

impl Default for Elevation {
    fn default() -> Self {
        let capacity = NonZeroUsize::new(MAX_BLOCKS).unwrap_or(NonZeroUsize::MIN);
        Self {
            models: Vec::new(),
            pictures: Vec::new(),
            level: None,
            is_settled: false,
            bases: MapStore::new(Path::new(""), u64::MAX, 0),
            blocks: RefCell::new(LruCache::new(capacity)),
        }
    }
}

impl Elevation {
    /// Whether no height is known.
    pub fn is_empty(&self) -> bool {
        self.models.is_empty() && self.level.is_none()
    }

    /// Makes ground without elevation models. It replaces none.
    pub fn set_level(&mut self, ground: LevelGround) {
        self.level = Some(ground).filter(|_| self.models.is_empty());
    }

    /// Whether no elevation model tells the ground's heights.
    pub fn is_guessed(&self) -> bool {
        self.level.is_some()
    }

    /// Number of the report of the first picture of the city itself.
    pub fn first_picture(&self) -> Option<usize> {
        self.pictures.iter().filter(|picture| !picture.is_surroundings).map(|picture| picture.source).min()
    }

    /// Numbers of the reports of pictures of the city that lie outside of the rectangle from `low` to `high`.
    pub fn pictures_outside(&self, [low, high]: [[f64; 2]; 2]) -> impl Iterator<Item = usize> {
        let is_outside = move |picture: &&PlacedRaster| {
            let bounds = picture.placed.as_ref().map(|placed| placed.bounds);
            bounds.is_some_and(|[from, to]| (0..2).any(|axis| from[axis] > high[axis] || to[axis] < low[axis]))
        };
        let of_city = self.pictures.iter().filter(|picture| !picture.is_surroundings);
        of_city.filter(is_outside).map(|picture| picture.source)
    }

    /// Number of the first model's report, or of that which counts ground without models.
    pub fn first_source(&self) -> usize {
        let level = || self.level.as_ref().map_or(0, |level| level.source);
        self.models.iter().map(|model| model.source).min().unwrap_or_else(level)
    }

    /// Opens an elevation model or an orthophoto; `number` is that of its report. Returns what is inexact about it. Fails if it is neither, is damaged,
    /// or has no place.
    ///
    /// `nodata` marks missing heights besides what the file declares; heights that are none on land are missing without it.
    pub fn open(
        &mut self,
        source: &CitySource<'_>,
        number: usize,
        nodata: Option<f64>,
    ) -> Result<Vec<String>, InputError> {
        let file = source.input(u64::MAX).on_disk()?;
        let mut raster = if kind_by_name(&source.name) == Some(SourceKind::Json) {
            open_terrain(source, &file)?
        } else {
            let reader = File::open(&file.path).map_err(|cause| InputError::io(&source.label, cause))?;
            Raster::open(
                Box::new(std::io::BufReader::new(reader)),
                unpacked_name(&source.name),
                RasterLimits::default(),
            )
            .map_err(|error| raster_fault(&source.label, error))?
        };
        let aux = read_sibling(&*source.files, &format!("{}.aux.xml", unpacked_name(&source.name)), MAX_SIDECAR_BYTES);
        let aux = aux.map(|bytes| AuxFile::parse(&String::from_utf8_lossy(&bytes))).unwrap_or_default();
        raster.set_aux(&aux);
        if let Some(nodata) = nodata.or(aux.nodata) {
            raster.set_nodata(nodata);
        }
        let (mask, unread) = mask_beside(source, &mut raster);
        let (is_picture, guess) = raster.is_picture(unpacked_name(&source.name));
        if is_picture && let Some(nodata) = aux.nodata {
            raster.set_missing_colour(nodata);
        }
        let is_bordered = is_picture && raster.has_black_corner();
        let facts = raster.facts();
        let mut warnings: Vec<String> = raster.warning().into_iter().chain(unread).collect();
        warnings.extend(is_bordered.then(|| BLACK_CORNER.to_owned()));
        if let Some(unit) = &facts.unknown_unit {
            warnings.push(format!("the unit of heights \"{unit}\" is not known; they are taken in that of the system"));
        }
        warnings.extend(facts.odd_number.clone());
        warnings.extend(facts.crs.other_unit.clone());
        warnings.extend(guess.map(str::to_owned));
        let place = match facts.place {
            Some(place) => place,
            None => world_file(source, facts.control_points)?,
        };
        let crs = crs_of(source, &raster);
        self.is_settled = false;
        let list = if is_picture { &mut self.pictures } else { &mut self.models };
        let files = [file].into_iter().chain(mask).collect();
        let mut placed = PlacedRaster::new(&source.label, number, raster, place, crs, files);
        placed.is_surroundings = source.is_surroundings;
        placed.heights_m = if nodata.is_some() { HEIGHTS_AND_DEPTHS_M } else { HEIGHTS_M };
        list.push(placed);
        Ok(warnings)
    }

    /// Places the models in the world. Fails if one has no place in it.
    pub fn settle(&mut self, world: &mut World) -> Result<(), InputError> {
        if self.is_settled {
            return Ok(());
        }
        let pixel_m = |raster: &PlacedRaster| raster.placed.as_ref().map_or(0.0, |placed| placed.pixel_m);
        for list in [&mut self.models, &mut self.pictures] {
            for raster in list.iter_mut() {
                raster.settle(world)?;
            }
            list.sort_by(|a, b| pixel_m(b).total_cmp(&pixel_m(a)));
        }
        self.is_settled = true;
        Ok(())
    }

    /// Tiles of terrain that could not be read: the number of the terrain's report, the first names, and the number of
    /// all.
    pub fn bad_tiles(&self) -> impl Iterator<Item = (usize, Vec<String>, usize)> {
        self.models.iter().map(|model| {
            let (names, count) = model.bad_tiles();
            (model.source, names, count)
        })
    }

    /// Heights of models that were taken as missing because they are none on land: the number of the model's report, and
    /// what to tell.
    pub fn missing(&self) -> impl Iterator<Item = (usize, Vec<String>)> {
        self.models.iter().map(|model| (model.source, model.missing()))
    }

    /// Heights of 0 that may be missing ones: the number of the model's report, and what to tell.
    pub fn odd_zeros(&self) -> impl Iterator<Item = (usize, String)> {
        self.models.iter().filter_map(|model| Some((model.source, model.odd_zeros()?)))
    }

    /// The placed rasters: the number of each one's report, its placement, and how its system was guessed.
    pub fn placements(&self) -> impl Iterator<Item = (usize, &Placement, Option<&String>)> {
        let all = self.models.iter().chain(&self.pictures);
        all.filter_map(|raster| Some((raster.source, &raster.placed.as_ref()?.placement, raster.guess.as_ref())))
    }

    /// Heights of a grid; NaN where no model has one. Fails if a raster cannot be read.
    fn read(&self, grid: &MapGrid) -> Result<Vec<f32>, InputError> {
        let mut heights = vec![f32::NAN; grid.size[0] * grid.size[1]];
        if let Some(level) = &self.level {
            for (index, height) in heights.iter_mut().enumerate() {
                *height = level.height_m(grid.position(index % grid.size[0], index / grid.size[0]));
            }
        }
        for model in &self.models {
            let found = model.heights(grid).map_err(|error| raster_fault(&model.label, error))?;
            for (height, finer) in heights.iter_mut().zip(found) {
                let Some(finer) = finer else { continue };
                *height = match height.is_nan() {
                    true => finer.height_m,
                    false => *height + (finer.height_m - *height) * finer.weight,
                };
            }
        }
        Ok(heights)
    }

    /// Changes the heights of a grid so that the ground meets the bases of buildings. Fails if these cannot be read.
    fn fit_to_buildings(&self, grid: &MapGrid, heights: &mut [f32]) -> Result<(), InputError> {
        if self.bases.is_empty() {
            return Ok(());
        }
        let high = grid.position(grid.size[0].saturating_sub(1), grid.size[1].saturating_sub(1));
        let bases = self.bases.shapes_in([grid.corner, high]);
        let bases = bases.map_err(|error| InputError::io("the ground", std::io::Error::other(error)))?;
        fit_to_bases(grid, heights, &bases);
        Ok(())
    }

    /// Mean height of the ground under a building; `None` where no model has one. Fails if a raster cannot be read.
    pub fn ground_under_m(&self, base: &BuildingBase) -> Result<Option<f64>, InputError> {
        base.mean_ground_m(|position| self.height_m(position))
    }

    /// Distance of the points of a block: that of the finest model's pixels.
    pub fn step_m(&self) -> f64 {
        let level = || self.level.as_ref().map_or(1.0, |level| level.step_m);
        self.models.last().and_then(|model| model.placed.as_ref()).map_or_else(level, |placed| placed.pixel_m)
    }

    /// World height of the ground at a position on the map; where none is known, one between the nearest that are, in
    /// all directions. `None` if there is none far around. Fails if a raster cannot be read.
    pub fn extended_height_m(&self, position: [f64; 2]) -> Result<Option<f64>, InputError> {
        if let Some(height) = self.height_m(position)? {
            return Ok(Some(height));
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for direction in DIRECTIONS {
            let Some((height, distance_m)) = self.first_height_m(position, direction)? else { continue };
            let weight = (distance_m * distance_m).recip();
            (sum, weights) = (sum + height * weight, weights + weight);
        }
        Ok((weights > 0.0).then(|| sum / weights))
    }

    /// World height of the ground at the border of the nearest model, for a place that is so far beyond that
    /// [`Self::extended_height_m`] knows none; `None` if all models are elsewhere. Fails if a raster cannot be read.
    pub fn border_height_m(&self, position: [f64; 2]) -> Result<Option<f64>, InputError> {
        let beside = |model: &PlacedRaster| {
            let placed = model.placed.as_ref()?;
            let [low, high] = placed.bounds;
            let inner = [0, 1].map(|axis| {
                let middle = (low[axis] + high[axis]) / 2.0;
                let [first, last] = [low[axis] + placed.pixel_m, high[axis] - placed.pixel_m];
                if first < last { position[axis].clamp(first, last) } else { middle }
            });
            let distance_m = libm::hypot(inner[0] - position[0], inner[1] - position[1]);
            (distance_m <= MAX_BEYOND_M).then_some((distance_m, inner))
        };
        let mut places: Vec<(f64, [f64; 2])> = self.models.iter().filter_map(beside).collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, place) in places {
            if let Some(height_m) = self.extended_height_m(place)? {
                return Ok(Some(height_m));
            }
        }
        Ok(None)
    }

    /// About the nearest known height in a direction, and its distance. Fails if a raster cannot be read.
    fn first_height_m(&self, from: [f64; 2], direction: [f64; 2]) -> Result<Option<(f64, f64)>, InputError> {
        let height_at = |distance_m: f64| self.height_m([0, 1].map(|axis| from[axis] + direction[axis] * distance_m));
        let (mut unknown_m, mut found) = (0.0, None);
        for doubling in 0..MAX_DOUBLINGS {
            let distance_m = self.step_m() * f64::from(1_u32 << doubling);
            if let Some(height) = height_at(distance_m)? {
                found = Some((height, distance_m));
                break;
            }
            unknown_m = distance_m;
        }
        let Some((mut height, mut known_m)) = found else { return Ok(None) };
        for _ in 0..HALVINGS {
            let middle_m = (unknown_m + known_m) / 2.0;
            match height_at(middle_m)? {
                Some(nearer) => (height, known_m) = (nearer, middle_m),
                None => unknown_m = middle_m,
            }
        }
        Ok(Some((height, known_m)))
    }

    /// World height of the ground at a position on the map; `None` where no model has one. Fails if a raster cannot be
    /// read.
    fn height_m(&self, [x, y]: [f64; 2]) -> Result<Option<f64>, InputError> {
        let step_m = self.step_m();
        let side_m = step_m * BLOCK_POINTS as f64;
        let block = [x, y].map(|along| (along / side_m).floor());
        let key = block.map(|number| number as i64);
        let corner = block.map(|number| number * side_m);
        let mut blocks = self.blocks.borrow_mut();
        if !blocks.contains(&key) {
            let size = [BLOCK_POINTS + 1; 2];
            let heights = self.read(&MapGrid { corner, step_m, size })?;
            blocks.put(key, heights.into());
        }
        let Some(heights) = blocks.get(&key) else { return Ok(None) };
        let [fx, fy] = [(x - corner[0]) / step_m, (y - corner[1]) / step_m];
        let [x0, y0] = [fx, fy].map(|f| (f.floor().max(0.0) as usize).min(BLOCK_POINTS - 1));
        let at = |x: usize, y: usize| f64::from(heights[y * (BLOCK_POINTS + 1) + x]);
        let (sx, sy) = (fx - x0 as f64, fy - y0 as f64);
        let south = at(x0, y0) * (1.0 - sx) + at(x0 + 1, y0) * sx;
        let north = at(x0, y0 + 1) * (1.0 - sx) + at(x0 + 1, y0 + 1) * sx;
        let height = south * (1.0 - sy) + north * sy;
        Ok(height.is_finite().then_some(height))
    }
}

/// Opens terrain of Cesium. Fails if it is damaged, or if its tiles are in an archive.
fn open_terrain(source: &CitySource<'_>, file: &LocalFile) -> Result<Raster, InputError> {
    let Some(folder) = file.path.parent().filter(|_| file.copy.is_none()) else {
        let what = "terrain tiles in an archive: unpack it and give the folder";
        return Err(InputError::unsupported(&source.label, what));
    };
    let layer = read_all(source, MAX_LAYER_BYTES)?;
    let tiles = Box::new(TerrainFiles::new(folder));
    let opened = Raster::open_quantized_mesh(&layer, tiles, RasterLimits::default());
    opened.map_err(|error| raster_fault(&source.label, error))
}

/// Gives a raster the mask of GDAL that lies beside it, `dem.tif.msk`. Returns the file, if there is one, and what to warn of if it cannot be
/// read.
fn mask_beside(source: &CitySource<'_>, raster: &mut Raster) -> (Option<LocalFile>, Option<String>) {
    let name = format!("{}.msk", unpacked_name(&source.name));
    if source.files.len(&name).is_err() {
        return (None, None);
    }
    let opened = source.files.on_disk(&name).map_err(RasterError::Io).and_then(|file| {
        raster.set_mask(Box::new(std::io::BufReader::new(File::open(&file.path)?)))?;
        Ok(file)
    });
    match opened {
        Ok(file) => (Some(file), None),
        Err(error) => {
            let advice =
                "write it into the file with gdal_translate --config GDAL_TIFF_INTERNAL_MASK YES, or give --nodata";
            (None, Some(format!("{name} hides pixels and cannot be read: {error}; {advice}")))
        }
    }
}

/// Where a raster without a place of its own is: what the world file beside it says.
fn world_file(source: &CitySource<'_>, control_points: usize) -> Result<GeoPlace, InputError> {
    let stem = stem_of(source);
    let extensions =
        ["tfw", "tifw", "tiffw", "wld", "jgw", "jpgw", "jpegw", "pgw", "pngw", "wpw", "webpw", "j2w", "jp2w"];
    let found = extensions
        .iter()
        .find_map(|extension| read_sibling(&*source.files, &format!("{stem}.{extension}"), MAX_SIDECAR_BYTES).ok());
    let Some(bytes) = found else {
        let what = match control_points {
            0 => "it has no position, and no world file beside it (.tfw)".to_owned(),
            count => format!(
                "only {count} of its pixels have a position (control points); gdalwarp makes a file of it that has one"
            ),
        };
        return Err(InputError::unsupported(&source.label, what));
    };
    GeoPlace::from_world_file(&String::from_utf8_lossy(&bytes)).map_err(|error| raster_fault(&source.label, error))
}

/// The name of a source without its extensions.
fn stem_of<'s>(source: &'s CitySource<'_>) -> &'s str {
    let name = unpacked_name(&source.name);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// The coordinate system of a raster: its own, or that of a `.prj` file beside it.
fn crs_of(source: &CitySource<'_>, raster: &Raster) -> Option<CrsReference> {
    let crs = &raster.facts().crs;
    let beside = || {
        let stem = stem_of(source);
        let bytes = read_sibling(&*source.files, &format!("{stem}.prj"), MAX_SIDECAR_BYTES).ok()?;
        Some(String::from_utf8_lossy(&bytes).into_owned())
    };
    let named = [crs.horizontal.clone(), beside(), crs.citation.clone()];
    let horizontal = named.into_iter().flatten().find(|name| !is_undefined(name))?;
    let name = crs.with_vertical(horizontal);
    Some(CrsReference { height_unit_m: crs.height_unit_m, ..CrsReference::east_first(name) })
}

fn raster_fault(label: &str, error: RasterError) -> InputError {
    match error {
        RasterError::Io(cause) => InputError::io(label, cause),
        RasterError::NotThisFormat => InputError::unknown_format(label, "it is no raster that is read"),
        RasterError::Unsupported(_) => InputError::unsupported(label, error.to_string()),
        error => InputError::damaged(label, "raster", error.to_string()),
    }
}
