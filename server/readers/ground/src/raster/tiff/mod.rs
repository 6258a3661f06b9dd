//! TIFF, BigTIFF, GeoTIFF and cloud-optimised GeoTIFF, read by tile or strip.

mod chunks;
mod colours;
mod directory;
mod gdal;
mod geo;
mod layout;
mod numbers;
mod picture_chunk;
mod unpack;

use self::chunks::{Chunks, TiffImage};
use self::colours::{Colours, alpha_band};
use self::directory::{Directory, TiffFile};
use self::gdal::{GdalTags, HeightRule};
use self::geo::GeoTags;
use self::layout::{Layout, PALETTE};
use super::error::RasterError;
use super::facts::{RasterCrs, RasterFacts, RasterLimits, RasterSize, SampleKind, Window};
use super::source::Source;
use std::collections::HashSet;

const SUBFILE_TYPE: u16 = 254;
const REDUCED: u64 = 1;
const MASK: u64 = 4;
const MAX_SAMPLE_VALUE: u16 = 281;
/// The brightest colours of 8, 10, 11, 12 and 14 bits, of which pictures have 16.
const BRIGHTEST: [f64; 5] = [255.0, 1023.0, 2047.0, 4095.0, 16_383.0];
/// Pixels along the side of a window of which the brightest is sought, and what a band means that the file does not explain.
const SAMPLED_PIXELS: u32 = 64;
/// The number of full alpha in bands of more than 8 bits, by the programs that do not say that it is alpha.
const FULL_ALPHA: [f64; 2] = [255.0, 65_535.0];
/// Files with more directories are refused.
const MAX_DIRECTORIES: usize = 1024;

/// Whether a file starts like a TIFF file.
pub(super) fn is_tiff(start: &[u8]) -> bool {
    matches!(start, [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..])
}

pub(super) struct TiffRaster {
    chunks: Chunks,
    /// The image, then its smaller copies.
    levels: Vec<TiffImage>,
    /// Images of 0 where the image, or its copy of the same size, has no value.
    masks: Vec<TiffImage>,
    /// Number of the images that are neither.
    unread_images: usize,
    pub(super) nodata: Option<f64>,
    /// The mark of missing heights that the user gives.
    pub(super) nodata_by_hand: Option<f64>,
    heights: HeightRule,
    /// The rule is that of the scale of pixels, which few writers mean.
    is_scaled: bool,
    /// The brightest colour, if it is not the largest number.
    brightest: Option<f64>,
    /// It is guessed by the pixels.
    is_brightest_guessed: bool,
    /// The bands with red, green and blue, if they have names.
    colours: Option<[u16; 3]>,
    /// The band that is alpha by its numbers alone.
    guessed_alpha: Option<u16>,
}

impl TiffRaster {
    pub(super) fn open(source: Source, limits: RasterLimits) -> Result<(Self, RasterFacts), RasterError> {
        let (mut file, first) = TiffFile::open(source)?;
        let first = file.directory(first)?;
        let main = TiffImage { number: 0, layout: Layout::read(&mut file, &first)? };
        let (tags, gdal) = (GeoTags::read(&mut file, &first)?, GdalTags::read(&mut file, &first, main.layout.sample)?);
        let crs = tags.crs();
        let mut facts = RasterFacts {
            bands: main.layout.bands,
            place: tags.place(),
            control_points: tags.control_points(),
            crs: RasterCrs { height_unit_m: gdal.height_unit_m.or(crs.height_unit_m), ..crs },
            unknown_unit: gdal.unknown_unit,
            odd_number: gdal.odd_number,
            nodata: gdal.nodata,
            ..RasterFacts::new(main.layout.size, main.layout.sample)
        };
        let (mut levels, masks, unread_images) = other_images(&mut file, first.next, &main.layout)?;
        levels.sort_by_key(|level| std::cmp::Reverse(level.layout.size.pixels()));
        if image_of_size(&masks, main.layout.size).is_some() {
            // A copy without a mask has values where the image has none.
            levels.retain(|level| image_of_size(&masks, level.layout.size).is_some());
        }
        levels.insert(0, main);
        facts.levels = levels.iter().map(|level| level.layout.size).collect();
        facts.has_mask = masks.iter().any(|mask| mask.layout.size == facts.size);
        let most =
            file.integer(&first, MAX_SAMPLE_VALUE).ok().flatten().filter(|most| *most > 0).map(|most| most as f64);
        let chunks = Chunks::new(file, limits);
        let scaled = tags.heights().filter(|_| gdal.heights.is_none());
        let heights = gdal.heights.or(scaled).unwrap_or(HeightRule::AS_IS);
        let mut raster = Self {
            chunks,
            levels,
            masks,
            unread_images,
            nodata: gdal.nodata,
            nodata_by_hand: None,
            heights,
            is_scaled: scaled.is_some(),
            brightest: None,
            is_brightest_guessed: false,
            colours: gdal.colours,
            guessed_alpha: None,
        };
        if facts.bands == 2 && facts.sample != SampleKind::U8 && raster.has_unnamed_alpha() == Some(true) {
            raster.guessed_alpha = Some(1);
        }
        if facts.bands > 2 && facts.sample == SampleKind::U16 && raster.has_all_bits() {
            raster.brightest = most.filter(|most| *most < f64::from(u16::MAX));
            if raster.brightest.is_none() {
                raster.guess_brightest(gdal.maximum);
            }
        }
        Ok((raster, facts))
    }

    /// Whether numbers have all 16 bits of their type in the file. Writers may leave the upper ones empty.
    fn has_all_bits(&self) -> bool {
        self.levels.first().is_some_and(|image| image.layout.bits == 16)
    }

    /// Guesses how many bits colours have by the largest number, or by that of some pixels. Few depths count, so that the pictures of
    /// a flight are alike.
    fn guess_brightest(&mut self, maximum: Option<f64>) {
        let Some(maximum) = maximum.or_else(|| self.sampled_maximum()).filter(|maximum| *maximum > 0.0) else { return };
        self.brightest = BRIGHTEST.into_iter().find(|brightest| maximum <= *brightest);
        self.is_brightest_guessed = self.brightest.is_some();
    }

    /// The largest number of some pixels of the smallest copy. `None` if they cannot be read.
    fn sampled_maximum(&mut self) -> Option<f64> {
        let image = self.levels.last()?;
        let mut maximum = 0.0_f64;
        for window in sampled_windows(image.layout.size) {
            let nodata = self.nodata;
            let each = |_: usize, _: usize, number: f64| {
                if Some(number) != nodata {
                    maximum = maximum.max(number);
                }
            };
            self.chunks.visit(image, (&[0, 1, 2], window), 0.0, each).ok()?;
        }
        Some(maximum)
    }

    /// Whether the second band, of which the file does not say what it is, is alpha by some pixels of the smallest copy: it is full or 0,
    /// and where it is 0, all heights are the same. `None` if they cannot be read.
    fn has_unnamed_alpha(&mut self) -> Option<bool> {
        let image = self.levels.last().filter(|image| alpha_band(&image.layout).is_none())?;
        let (mut full, mut missing, mut is_alpha) = (None, None, true);
        for window in sampled_windows(image.layout.size) {
            let mut heights = vec![0.0; window.width as usize * window.height as usize];
            let each = |slot: usize, pixel: usize, number: f64| {
                if slot == 0 {
                    heights[pixel] = number;
                } else if number == 0.0 {
                    is_alpha &= same_bits(*missing.get_or_insert(heights[pixel]), heights[pixel]);
                } else {
                    is_alpha &= FULL_ALPHA.contains(&number) && *full.get_or_insert(number) == number;
                }
            };
            self.chunks.visit(image, (&[0, 1], window), 0.0, each).ok()?;
        }
        Some(is_alpha && full.is_some())
    }

    /// Bytes of the file, in which pixels may take next to none.
    pub(super) fn file_bytes(&self) -> u64 {
        self.chunks.file.source.len()
    }

    /// Leaves out the smaller copies of other sizes.
    pub(super) fn keep_levels(&mut self, sizes: &[RasterSize]) {
        self.levels.retain(|level| sizes.contains(&level.layout.size));
    }

    /// Calls `hide` with each pixel of a window of a level that has no value, of a file that is the mask of another. Its size is that of
    /// the level.
    pub(super) fn visit_hidden(
        &mut self,
        window: Window,
        size: RasterSize,
        mut hide: impl FnMut(usize),
    ) -> Result<(), RasterError> {
        let image = image_of_size(&self.levels, size).ok_or(RasterError::Outside)?;
        self.chunks.visit(image, (&[0], window), 0.0, |_, pixel, number| {
            if number == 0.0 {
                hide(pixel);
            }
        })
    }

    /// Makes numbers heights by another factor and summand.
    pub(super) fn set_rule(&mut self, [scale, offset]: [f64; 2]) {
        self.heights = HeightRule { scale, offset };
        self.is_scaled = false;
    }

    /// Whether the numbers stand for colours of a list.
    pub(super) fn has_palette(&self) -> bool {
        self.levels.first().is_some_and(|image| image.layout.photometric == PALETTE)
    }

    /// Whether the file says how numbers become heights.
    pub(super) fn has_rule(&self) -> bool {
        self.heights != HeightRule::AS_IS && !self.is_scaled
    }

    /// What is guessed about the heights, or the colours, and that there are more images.
    pub(super) fn warning(&self) -> Option<String> {
        let missing = "the second band, which is full or 0, is taken to mark missing heights";
        let unread = (self.unread_images > 0)
            .then(|| format!("only the first of its images is read, and not {} more", self.unread_images));
        let guesses = [self.guessed_alpha.map(|_| missing.to_owned()), self.guess_of_numbers(), unread];
        guesses.into_iter().flatten().reduce(|first, second| format!("{first}; {second}"))
    }

    fn guess_of_numbers(&self) -> Option<String> {
        if let Some(brightest) = self.brightest.filter(|_| self.is_brightest_guessed) {
            return Some(format!(
                "colours of 16 bits are taken to be at most {brightest}, as no sampled one is larger"
            ));
        }
        let HeightRule { scale, offset } = self.heights;
        self.is_scaled
            .then(|| format!("heights are taken as {scale} times the numbers plus {offset}, by ModelPixelScale"))
    }

    /// Heights of a window that is within the level; NaN where there are none.
    pub(super) fn read_heights(&mut self, window: Window, level: usize, len: usize) -> Result<Vec<f32>, RasterError> {
        let image = level_of(&self.levels, level)?;
        let mut heights = vec![f32::NAN; len];
        let bands: Vec<u16> = [0].into_iter().chain(alpha_band(&image.layout).or(self.guessed_alpha)).collect();
        let (rule, nodata, sample) = (self.heights, self.nodata, image.layout.sample);
        let marks = [nodata, self.nodata_by_hand];
        self.chunks.visit(image, (&bands, window), nodata.unwrap_or(0.0), |slot, pixel, number| {
            if slot == 0 {
                heights[pixel] = rule.height(number, sample, marks);
            } else if number == 0.0 {
                heights[pixel] = f32::NAN;
            }
        })?;
        if let Some(mask) = image_of_size(&self.masks, image.layout.size) {
            self.chunks.visit(mask, (&[0], window), 0.0, |_, pixel, number| {
                if number == 0.0 {
                    heights[pixel] = f32::NAN;
                }
            })?;
        }
        Ok(heights)
    }

    /// Red, green, blue and alpha of a window that is within the level.
    pub(super) fn read_colours(
        &mut self,
        window: Window,
        level: usize,
        len: usize,
    ) -> Result<Vec<[u8; 4]>, RasterError> {
        let image = level_of(&self.levels, level)?;
        let colours = Colours::new(&image.layout, self.nodata, self.brightest, self.colours)?;
        let mut pixels = vec![colours.start(); len];
        self.chunks.visit(image, (&colours.bands, window), self.nodata.unwrap_or(0.0), |slot, pixel, number| {
            colours.add(&mut pixels[pixel], slot, number);
        })?;
        if let Some(mask) = image_of_size(&self.masks, image.layout.size) {
            self.chunks.visit(mask, (&[0], window), 0.0, |_, pixel, number| {
                if number == 0.0 {
                    pixels[pixel][3] = 0;
                }
            })?;
        }
        Ok(pixels)
    }
}

/// Where a picture of another format is, by the TIFF file without pixels that it contains (GeoJP2).
#[cfg(feature = "jpeg2000")]
pub(super) fn read_geo(source: Source) -> Result<(Option<super::place::GeoPlace>, RasterCrs), RasterError> {
    let (mut file, first) = TiffFile::open(source)?;
    let directory = file.directory(first)?;
    let tags = GeoTags::read(&mut file, &directory)?;
    Ok((tags.place(), tags.crs()))
}

/// The smaller copies of an image, the masks, and the number of other images, such as further pages, which are left out.
fn other_images(
    file: &mut TiffFile,
    mut next: u64,
    main: &Layout,
) -> Result<(Vec<TiffImage>, Vec<TiffImage>, usize), RasterError> {
    let (mut levels, mut masks, mut others, mut seen) = (Vec::new(), Vec::new(), 0, HashSet::new());
    while next > 0 {
        if !seen.insert(next) || seen.len() > MAX_DIRECTORIES {
            return Err(RasterError::damaged("it has too many images, or a circle of them"));
        }
        let directory: Directory = file.directory(next)?;
        next = directory.next;
        let kind = file.integer(&directory, SUBFILE_TYPE)?.unwrap_or(0);
        if kind & (REDUCED | MASK) == 0 {
            others += 1;
            continue;
        }
        let image = TiffImage { number: seen.len(), layout: Layout::read(file, &directory)? };
        let is_smaller = image.layout.size.pixels() < main.size.pixels();
        let is_same_kind = image.layout.bands == main.bands && image.layout.sample == main.sample;
        if kind & MASK != 0 {
            masks.push(image);
        } else if is_smaller && is_same_kind {
            levels.push(image);
        }
    }
    Ok((levels, masks, others))
}

/// Windows of some pixels at the corners, the middles of the sides and the middle of an image.
fn sampled_windows(RasterSize { width, height }: RasterSize) -> impl Iterator<Item = Window> {
    let side = |length: u32| length.min(SAMPLED_PIXELS);
    let [width_px, height_px] = [side(width), side(height)];
    let [right, down] = [(width - width_px) / 2, (height - height_px) / 2];
    (0..9).map(move |place| Window {
        x: right * (place % 3),
        y: down * (place / 3),
        width: width_px,
        height: height_px,
    })
}

/// Whether numbers are equal, or both none.
fn same_bits(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits()
}

fn level_of(levels: &[TiffImage], level: usize) -> Result<&TiffImage, RasterError> {
    levels.get(level).ok_or(RasterError::Outside)
}

fn image_of_size(images: &[TiffImage], size: RasterSize) -> Option<&TiffImage> {
    images.iter().find(|image| image.layout.size == size)
}
