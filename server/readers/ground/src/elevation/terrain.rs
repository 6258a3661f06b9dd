//! Triangles of the ground in a region.

use super::Elevation;
use super::drape::{Drape, GroundPictures};
use super::lattice::MapGrid;
use super::level::LevelGround;
use insula_protocol::NODE_CELLS;
use insula_roam::{Borders, HeightSource, triangulate_region};
use insula_source::error::InputError;
use std::array;
use std::cell::RefCell;

/// More heights make the grid coarser.
const MAX_HEIGHTS: f64 = 4e8;
/// Pixels of a small file that are read, and for each byte of a larger one: a file of one height takes next to no bytes.
const MIN_PIXELS: u64 = 1 << 29;
const PIXELS_OF_BYTE: u64 = 64;
/// Steps along the side of a tile, if a raster's pixels are as large as its steps.
const TILE_STEPS: u32 = 1024;
const MIN_TILE_STEPS: u32 = 16;
/// Pixels along the side of a tile's window in a raster that is finer than the grid.
const MAX_TILE_PIXELS: f64 = 4096.0;
/// Steps of a grid from one of the model's points to the next, if it does not have the same points.
const STEPS_PER_PIXEL: f64 = 4.0;
/// Coarser steps, in cells, would miss the buildings that the ground meets.
const FIT_CELLS: f64 = 2.0;
/// Ground without elevation models reaches so far beyond the city at most.
const LEVEL_MARGIN_M: f64 = 32.0;
/// Longest side of a tile of it.
const LEVEL_TILE_M: f64 = 512.0;
/// Side, in leaves, of the squares of a tile, of which those without a picture are left to the generated ground: a block of leaves, which
/// are sampled together.
const LEVEL_SQUARE_LEAVES: f64 = 2.0;
/// Where land surrounds the city, its terrain ends at squares of this many leaves, at which that land begins.
pub const ALIGNED_LEAVES: f64 = 2.0;
/// It ends this far within them, so that no rounding makes it reach the next square.
const INSET_M: f64 = 0.01;

/// How terrain is made of elevation models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerrainOptions {
    /// Triangles are within this distance of the models' heights, in cells.
    pub error_cells: f64,
    /// Terrain reaches this far beyond the city.
    pub margin_m: f64,
    /// Side of the smallest texels of pictures from above.
    pub texel_m: f64,
    /// The ground is changed to meet buildings that have heights of their own and are at most this far above or below
    /// it; 0 leaves it as it is.
    pub tolerance_m: f64,
}

impl Default for TerrainOptions {
    /// A fifth of a cell cannot be seen where cells are a pixel. Half a kilometre hides the border from streets. Kerbs and
    /// marks of lanes need a quarter of a metre. Models of ground and of buildings differ by up to some metres.
    fn default() -> Self {
        Self { error_cells: 0.2, margin_m: 500.0, texel_m: 0.25, tolerance_m: 3.0 }
    }
}

/// A part of the terrain.
pub struct TerrainTile {
    /// Such as `terrain 3/4`.
    pub name: String,
    /// World positions, counter-clockwise seen from above.
    pub triangles: Vec<[[f64; 3]; 3]>,
    /// The picture on it.
    pub drape: Option<Drape>,
}

/// The grid over a region.
struct Region<'e> {
    elevation: &'e Elevation,
    /// World position of the south-western point.
    corner: [f64; 2],
    step_m: f64,
    /// The step without the limit of heights.
    wanted_step_m: f64,
    size: [u32; 2],
    /// Whether it has heights where no model has one: under a city, and in small gaps.
    is_extended: bool,
    /// Lowest and highest coordinates that vertices may have.
    limits: [[f64; 2]; 2],
    /// The part that was read last.
    part: RefCell<RegionPart>,
}

/// Heights of the columns and rows from `min`, by row.
#[derive(Default)]
struct RegionPart {
    min: [u32; 2],
    width: usize,
    heights: Vec<f32>,
}

impl HeightSource for Region<'_> {
    type Error = InputError;

    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn read(&self, min: [u32; 2], max: [u32; 2]) -> Result<Vec<f32>, InputError> {
        let corner = array::from_fn(|axis| self.corner[axis] + f64::from(min[axis]) * self.step_m);
        let size: [usize; 2] = array::from_fn(|axis| (max[axis] - min[axis]) as usize + 1);
        let grid = MapGrid { corner, step_m: self.step_m, size };
        let mut heights = self.elevation.read(&grid)?;
        if self.is_extended {
            for (index, height) in heights.iter_mut().enumerate().filter(|(_, height)| height.is_nan()) {
                let position = grid.position(index % size[0], index / size[0]);
                *height = self.elevation.extended_height_m(position)?.map_or(f32::NAN, |extended| extended as f32);
            }
        }
        self.elevation.fit_to_buildings(&grid, &mut heights)?;
        *self.part.borrow_mut() = RegionPart { min, width: size[0], heights: heights.clone() };
        Ok(heights)
    }
}

impl<'e> Region<'e> {
    /// The region around `city`, its lowest and highest corner, as far as there are models; without a city all models,
    /// except those of the land around it. `None` if they do not overlap.
    fn new(elevation: &'e Elevation, city: Option<[[f64; 2]; 2]>, cell_m: f64, margin_m: f64) -> Option<Self> {
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        let margin_m = if elevation.level.is_some() {
            // Without models there is ground everywhere, and beyond the city the plane goes on as it is there.
            (low, high) = ([f64::MIN; 2], [f64::MAX; 2]);
            margin_m.min(LEVEL_MARGIN_M)
        } else {
            margin_m
        };
        let models = elevation.models.iter().filter(|model| city.is_some() || !model.is_surroundings);
        for placed in models.filter_map(|model| model.placed.as_ref()) {
            low = array::from_fn(|axis| low[axis].min(placed.bounds[0][axis]));
            high = array::from_fn(|axis| high[axis].max(placed.bounds[1][axis]));
        }
        if let Some([city_low, city_high]) = city {
            // All of the city has ground under it.
            low = array::from_fn(|axis| low[axis].max(city_low[axis] - margin_m).min(city_low[axis]));
            high = array::from_fn(|axis| high[axis].min(city_high[axis] + margin_m).max(city_high[axis]));
        }
        if !(low[0] < high[0] && low[1] < high[1]) {
            return None;
        }
        let (wanted_step_m, aligned) = elevation.grid_step(cell_m);
        let mut step_m = wanted_step_m;
        while (0..2).map(|axis| (high[axis] - low[axis]) / step_m).product::<f64>() > MAX_HEIGHTS {
            step_m *= 2.0;
        }
        let mut limits = [[f64::MIN; 2], [f64::MAX; 2]];
        if elevation.has_surroundings() {
            let side_m = cell_m * NODE_CELLS as f64 * ALIGNED_LEAVES;
            step_m = side_m / libm::exp2(libm::log2(side_m / step_m).ceil());
            low = low.map(|along| (along / side_m).floor() * side_m);
            high = high.map(|along| (along / side_m).ceil() * side_m);
            limits = [low.map(|along| along + INSET_M), high.map(|along| along - INSET_M)];
        }
        let from = aligned.unwrap_or_default();
        let corner = array::from_fn(|axis| from[axis] + ((low[axis] - from[axis]) / step_m).floor() * step_m);
        let size = array::from_fn(|axis| ((high[axis] - corner[axis]) / step_m - 1e-6).ceil().min(1e8) as u32 + 1);
        let (is_extended, part) = (city.is_some(), RefCell::default());
        Some(Self { elevation, corner, step_m, wanted_step_m, size, is_extended, limits, part })
    }

    /// World position of a place in the part that was read last.
    fn position(&self, place: [u32; 2]) -> [f64; 3] {
        let part = self.part.borrow();
        let [column, row] = [0, 1].map(|axis| place[axis].wrapping_sub(part.min[axis]) as usize);
        let height = part.heights.get(row.wrapping_mul(part.width).wrapping_add(column)).copied().unwrap_or(0.0);
        let [x, y] = array::from_fn(|axis| {
            let along = self.corner[axis] + f64::from(place[axis]) * self.step_m;
            along.clamp(self.limits[0][axis], self.limits[1][axis])
        });
        [x, y, f64::from(height)]
    }

    /// Fails if a model has far more pixels in the region than its file has bytes.
    fn check_pixels(&self) -> Result<(), InputError> {
        let high = array::from_fn(|axis| self.corner[axis] + f64::from(self.size[axis]) * self.step_m);
        for model in &self.elevation.models {
            let Some([pixels, bytes]) = model.pixels_under([self.corner, high], self.step_m) else { continue };
            let limit = bytes.saturating_mul(PIXELS_OF_BYTE).max(MIN_PIXELS);
            if pixels > limit {
                let what = format!("the number of its pixels under the city, {pixels} in a file of {bytes} bytes,");
                return Err(InputError::TooLarge { path: model.label.clone(), what, limit });
            }
        }
        Ok(())
    }

    /// Steps along the side of a tile, a power of two. A tile is not wider than a picture of it.
    fn tile_steps(&self, picture_m: f64) -> u32 {
        let pixels_per_step = (self.step_m / self.elevation.step_m()).max(1.0);
        let steps = (MAX_TILE_PIXELS / pixels_per_step).min(picture_m / self.step_m);
        1 << (steps.clamp(f64::from(MIN_TILE_STEPS), f64::from(TILE_STEPS)) as u32).ilog2()
    }
}

impl Elevation {
    /// Distance of the grid's points, and the position of one if they are those of the finest model.
    ///
    /// A grid beside the model's points cuts off peaks between its own. So it is finer than them where they are farther
    /// apart than cells.
    fn grid_step(&self, cell_m: f64) -> (f64, Option<[f64; 2]>) {
        let pixel_m = self.step_m();
        let aligned = self.models.last().and_then(|model| model.placed.as_ref()?.aligned);
        let is_free = self.bases.is_empty() && !self.has_surroundings() && pixel_m >= cell_m / 2.0;
        if let Some(first) = aligned.filter(|_| is_free) {
            return (pixel_m, Some(first));
        }
        let finest_m = if self.bases.is_empty() { f64::INFINITY } else { cell_m * FIT_CELLS };
        ((pixel_m / STEPS_PER_PIXEL).max(cell_m).min(pixel_m).min(finest_m).max(cell_m / 2.0), None)
    }

    /// What to tell if the terrain around a city has a coarser grid than its models, because it would have too many heights; `None` if not.
    pub fn coarse_grid(&self, city: Option<[[f64; 2]; 2]>, cell_m: f64, options: TerrainOptions) -> Option<String> {
        let Region { step_m, wanted_step_m, .. } = Region::new(self, city, cell_m, options.margin_m)?;
        let is_level = self.level.as_ref().is_some_and(LevelGround::is_level);
        (step_m > wanted_step_m && !is_level).then(|| {
            let [step_m, wanted_m] = [step_m, wanted_step_m].map(|metres| (metres * 100.0).round() / 100.0);
            format!(
                "a height each {step_m} m in place of {wanted_m} m, as there would be more than {} million; bake a part \
                 with --bbox",
                MAX_HEIGHTS / 1e6
            )
        })
    }

    /// Passes the terrain around a city to `add`, tile by tile, with pictures of the ground. The models must be
    /// settled. Fails if a raster cannot be read.
    pub fn make_terrain(
        &self,
        city: Option<[[f64; 2]; 2]>,
        cell_m: f64,
        options: TerrainOptions,
        ground: &GroundPictures<'_>,
        add: &mut dyn FnMut(TerrainTile),
    ) -> Result<(), InputError> {
        let Some(region) = Region::new(self, city, cell_m, options.margin_m) else { return Ok(()) };
        let picture_m = if self.pictures.is_empty() && !ground.is_painted() { f64::INFINITY } else { ground.side_m() };
        if self.level.as_ref().is_some_and(LevelGround::is_level) {
            return self.make_level_terrain(&region, cell_m, picture_m, ground, add);
        }
        region.check_pixels()?;
        let tile_steps = region.tile_steps(picture_m);
        let borders = Borders::survey(&region, tile_steps, (options.error_cells * cell_m) as f32)?;
        for tile in borders.tiling().tiles() {
            let mesh = triangulate_region(&region, &borders, tile)?;
            let positions: Vec<[f64; 3]> = mesh.vertices.iter().map(|place| region.position(*place)).collect();
            let triangles: Vec<[[f64; 3]; 3]> =
                mesh.triangles.iter().map(|corners| corners.map(|corner| positions[corner as usize])).collect();
            if triangles.is_empty() {
                continue;
            }
            let drape = self.drape(bounds_on_map(&triangles), ground)?;
            add(TerrainTile { name: format!("terrain {}/{}", tile[0], tile[1]), triangles, drape });
        }
        Ok(())
    }

    /// Passes level ground to `add`, where it has a picture. On a map of roads over a country, these are few places.
    fn make_level_terrain(
        &self,
        region: &Region<'_>,
        cell_m: f64,
        picture_m: f64,
        ground: &GroundPictures<'_>,
        add: &mut dyn FnMut(TerrainTile),
    ) -> Result<(), InputError> {
        let longest_m = picture_m.min(LEVEL_TILE_M);
        let square_m = (cell_m * NODE_CELLS as f64 * LEVEL_SQUARE_LEAVES).min(longest_m);
        let along = (longest_m / square_m) as u32;
        let tile_m = square_m * f64::from(along);
        let ends = [region.position([0; 2]), region.position(region.size.map(|points| points - 1))];
        let clip = |[low, high]: [[f64; 2]; 2]| {
            let [first, last] =
                [low, high].map(|corner| array::from_fn(|axis| corner[axis].clamp(ends[0][axis], ends[1][axis])));
            (0..2).all(|axis| first[axis] < last[axis]).then_some([first, last])
        };
        // On the world's grid, as leaves are, if they are small.
        let start: [f64; 2] =
            array::from_fn(|axis| if along > 1 { (ends[0][axis] / tile_m).floor() * tile_m } else { ends[0][axis] });
        let count = array::from_fn(|axis| ((ends[1][axis] - start[axis]) / tile_m).ceil() as u32);
        for [x, y] in places(count) {
            let corner: [f64; 2] = array::from_fn(|axis| start[axis] + f64::from([x, y][axis]) * tile_m);
            let Some(tile) = clip([corner, corner.map(|low| low + tile_m)]) else { continue };
            let Some(picture) = self.picture(tile, ground)? else { continue };
            let squares = places([along; 2]).filter_map(|place| {
                let low: [f64; 2] = array::from_fn(|axis| corner[axis] + f64::from(place[axis]) * square_m);
                Some((place, clip([low, low.map(|low| low + square_m)])?))
            });
            let mut squares: Vec<_> = squares.collect();
            let all = squares.len();
            squares.retain(|(_, square)| picture.shows(*square));
            if squares.len() == all {
                squares = vec![([0; 2], tile)];
            }
            for ([column, row], bounds) in squares {
                let name = format!("terrain {}/{}", x * along + column, y * along + row);
                let drape = Some(picture.part(bounds, ground));
                add(TerrainTile { name, triangles: level_square(bounds), drape });
            }
        }
        Ok(())
    }
}

/// Columns and rows, row by row.
fn places([columns, rows]: [u32; 2]) -> impl Iterator<Item = [u32; 2]> {
    (0..rows).flat_map(move |y| (0..columns).map(move |x| [x, y]))
}

/// Two triangles at the height 0.
fn level_square([low, high]: [[f64; 2]; 2]) -> Vec<[[f64; 3]; 3]> {
    let [a, b, c, d] = [low, [high[0], low[1]], high, [low[0], high[1]]].map(|[x, y]| [x, y, 0.0]);
    vec![[a, b, c], [a, c, d]]
}

/// Lowest and highest corner on the map.
fn bounds_on_map(triangles: &[[[f64; 3]; 3]]) -> [[f64; 2]; 2] {
    triangles.iter().flatten().fold([[f64::MAX; 2], [f64::MIN; 2]], |[low, high], corner| {
        [[0, 1].map(|axis| low[axis].min(corner[axis])), [0, 1].map(|axis| high[axis].max(corner[axis]))]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_place::placement::World;
    use insula_source::source::embedded;

    /// A model of 16 bits in tiles that are left out of the file, with pixels of 1 m.
    fn empty_tiff(side: u32) -> Vec<u8> {
        let tile = side / 2;
        let data = 8 + 2 + 12 * 12 + 4;
        let entries: [(u16, u16, u32, u32); 12] = [
            (256, 4, 1, side),
            (257, 4, 1, side),
            (258, 3, 1, 16),
            (259, 3, 1, 8),
            (262, 3, 1, 1),
            (322, 4, 1, tile),
            (323, 4, 1, tile),
            (324, 4, 4, data),
            (325, 4, 4, data),
            (339, 3, 1, 2),
            (33550, 12, 3, data + 16),
            (33922, 12, 6, data + 40),
        ];
        let mut bytes = b"II*\0\x08\0\0\0\x0c\0".to_vec();
        for (tag, kind, count, value) in entries {
            bytes.extend([tag, kind].iter().flat_map(|number| number.to_le_bytes()));
            bytes.extend([count, value].iter().flat_map(|number| number.to_le_bytes()));
        }
        bytes.resize(data as usize + 16, 0);
        let places = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 500_000.0, 5_400_000.0, 0.0_f64];
        bytes.extend(places.iter().flat_map(|number| number.to_le_bytes()));
        bytes
    }

    #[test]
    fn models_of_far_more_pixels_than_bytes_are_refused() {
        let check = |side: u32, city: Option<[[f64; 2]; 2]>| {
            let bytes = empty_tiff(side);
            let mut elevation = Elevation::default();
            elevation.open(&embedded(&[("dem.tif", &bytes[..])])[0], 0, None).unwrap();
            elevation.settle(&mut World::new(Some("EPSG:25832"), None).unwrap()).unwrap();
            Region::new(&elevation, city, 1.0, 500.0).unwrap().check_pixels()
        };
        let error = check(32_768, None).unwrap_err().to_string();
        assert!(error.contains("dem.tif: the number of its pixels under the city, 107374182"), "{error}");
        assert!(check(16_384, None).is_ok());
        let city = [[510_000.0, 5_390_000.0], [511_000.0, 5_391_000.0]];
        assert!(check(32_768, Some(city)).is_ok(), "a part of it");
    }

    #[test]
    fn a_grid_that_the_limit_makes_coarser_is_told() {
        let grid =
            |at: u32| format!("ncols 3\nnrows 3\nxllcorner {at}\nyllcorner {at}\ncellsize 1\n1 1 1\n1 1 1\n1 1 1\n");
        let (near, far) = (grid(500_000), grid(530_000));
        let files = [("a.asc", near.as_bytes()), ("b.asc", far.as_bytes())];
        let mut elevation = Elevation::default();
        for (number, source) in embedded(&files).iter().enumerate() {
            elevation.open(source, number, None).unwrap();
        }
        elevation.settle(&mut World::new(Some("EPSG:25832"), None).unwrap()).unwrap();
        let options = TerrainOptions::default();
        let text = elevation.coarse_grid(None, 1.0, options).unwrap();
        assert!(text.starts_with("a height each 2") && text.contains("in place of 1"), "{text}");
        let city = [[500_000.0; 2], [500_100.0; 2]];
        assert_eq!(elevation.coarse_grid(Some(city), 1.0, options), None);
    }
}
