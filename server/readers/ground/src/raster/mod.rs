//! Georeferenced rasters: heights of the ground and pictures from above, read by window without the whole file in
//! memory.

mod ascii_grid;
mod aux_file;
mod cache;
mod error;
mod facts;
mod geo_keys;
mod hgt;
#[cfg(feature = "jpeg2000")]
mod jpeg2000;
mod picture;
mod place;
#[cfg(feature = "laz")]
mod point_cloud;
mod quantized_mesh;
mod samples;
mod source;
#[cfg(test)]
mod tests;
mod tiff;
mod words;

use self::ascii_grid::AsciiGrid;
pub(crate) use self::aux_file::AuxFile;
pub(crate) use self::error::RasterError;
pub use self::facts::HEIGHTS_M;
pub(crate) use self::facts::{
    HEIGHTS_AND_DEPTHS_M, RasterCrs, RasterFacts, RasterLimits, RasterSize, SampleKind, Window,
};
use self::hgt::Hgt;
use self::picture::Picture;
pub(crate) use self::place::GeoPlace;
use self::point_cloud::PointCloud;
use self::quantized_mesh::QuantizedMesh;
pub(crate) use self::quantized_mesh::TileFiles;
pub(crate) use self::source::ReadSeek;
use self::source::Source;
use self::tiff::TiffRaster;
use insula_place::crs::is_undefined;

#[cfg(not(feature = "jpeg2000"))]
mod jpeg2000 {
    use super::error::RasterError;
    use super::facts::RasterFacts;

    pub(super) fn is_jpeg2000(start: &[u8]) -> bool {
        start.starts_with(b"\0\0\0\x0cjP  \r\n\x87\n") || start.starts_with(b"\xff\x4f\xff\x51")
    }

    pub(super) fn facts(_: &[u8]) -> Result<RasterFacts, RasterError> {
        Err(RasterError::unsupported(insula_source::error::left_out("jpeg2000")))
    }

    pub(super) fn rgba(_: &[u8]) -> Result<Vec<u8>, RasterError> {
        Err(RasterError::unsupported(insula_source::error::left_out("jpeg2000")))
    }
}

#[cfg(not(feature = "laz"))]
mod point_cloud {
    use super::error::RasterError;
    use super::facts::{RasterFacts, RasterLimits, Window};
    use super::source::Source;

    /// There is none.
    pub(super) enum PointCloud {}

    pub(super) fn is_point_cloud(start: &[u8]) -> bool {
        start.starts_with(b"LASF")
    }

    impl PointCloud {
        pub(super) fn open(_: Source, _: RasterLimits) -> Result<(Self, RasterFacts), RasterError> {
            Err(RasterError::unsupported(insula_source::error::left_out("laz")))
        }

        pub(super) fn warning(&self) -> Option<String> {
            match *self {}
        }

        pub(super) fn read_heights(&mut self, _: Window, _: usize) -> Result<Vec<f32>, RasterError> {
            match *self {}
        }
    }
}

/// Bytes by which formats are told apart.
const START_BYTES: u64 = 64;

/// Pixels along the side of a corner of a picture.
const CORNER_PIXELS: u32 = 8;

/// Words in names of files with heights.
const NAMES_OF_HEIGHTS: [&str; 13] =
    ["dem", "dtm", "dsm", "dgm", "mnt", "mns", "mne", "mdt", "mds", "height", "heights", "heightmap", "elevation"];
const TAKEN_AS_HEIGHTS: &str = "one band of 8 bits is taken as heights, as the name of the file says";
const TAKEN_AS_PICTURE: &str =
    "one band of 8 bits is taken as a picture; heights need a unit, or \"dem\" in the name of the file";

/// An opened raster.
pub(crate) struct Raster {
    facts: RasterFacts,
    limits: RasterLimits,
    content: Content,
    /// Factor and summand of heights, of formats that have none of their own.
    rule: Option<[f64; 2]>,
    /// The file beside the raster that tells which pixels have a value.
    mask: Option<Box<TiffRaster>>,
}

/// The formats.
enum Content {
    Tiff(Box<TiffRaster>),
    Hgt(Hgt),
    Ascii(AsciiGrid),
    Picture(Picture),
    QuantizedMesh(Box<QuantizedMesh>),
    PointCloud(Box<PointCloud>),
}

impl Raster {
    /// Opens a raster and reads what is known of it before its pixels. `name` is the file's: SRTM tiles have their
    /// place in it.
    ///
    /// An ESRI ASCII grid is read once from start to end, because only this tells where its rows are.
    pub(crate) fn open(reader: Box<dyn ReadSeek>, name: &str, limits: RasterLimits) -> Result<Self, RasterError> {
        let mut source = Source::new(reader)?;
        let start = source.start(START_BYTES)?;
        let (content, facts) = if tiff::is_tiff(&start) {
            let (tiff, facts) = TiffRaster::open(source, limits)?;
            (Content::Tiff(Box::new(tiff)), facts)
        } else if picture::is_picture(&start) || jpeg2000::is_jpeg2000(&start) {
            let (picture, facts) = Picture::open(source, &start, limits)?;
            (Content::Picture(picture), facts)
        } else if point_cloud::is_point_cloud(&start) {
            let (cloud, facts) = PointCloud::open(source, limits)?;
            (Content::PointCloud(Box::new(cloud)), facts)
        } else if hgt::is_hgt(name) {
            let (hgt, facts) = Hgt::open(source, name)?;
            (Content::Hgt(hgt), facts)
        } else if ascii_grid::is_ascii_grid(&start) {
            let (grid, facts) = AsciiGrid::open(source, limits)?;
            (Content::Ascii(grid), facts)
        } else {
            return Err(RasterError::NotThisFormat);
        };
        Ok(Self { facts, limits, content, rule: None, mask: None })
    }

    /// Opens terrain of Cesium by its `layer.json` and the files beside it.
    pub(crate) fn open_quantized_mesh(
        layer_json: &[u8],
        tiles: Box<dyn TileFiles>,
        limits: RasterLimits,
    ) -> Result<Self, RasterError> {
        let (terrain, facts) = QuantizedMesh::open(layer_json, tiles, limits)?;
        let content = Content::QuantizedMesh(Box::new(terrain));
        Ok(Self { facts, limits, content, rule: None, mask: None })
    }

    /// Sets the value that marks missing heights besides the declared one, for formats that can have such.
    pub(crate) fn set_nodata(&mut self, nodata: f64) {
        match &mut self.content {
            Content::Tiff(tiff) => tiff.nodata_by_hand = Some(self.facts.sample.rounded(nodata)),
            Content::Ascii(grid) => grid.nodata_by_hand = Some(self.facts.sample.rounded(nodata)),
            Content::Hgt(hgt) => hgt.nodata_by_hand = Some(nodata),
            Content::Picture(_) | Content::QuantizedMesh(_) | Content::PointCloud(_) => {}
        }
    }

    /// Sets the number that marks missing pixels of a TIFF picture which declares none.
    pub(crate) fn set_missing_colour(&mut self, nodata: f64) {
        if let Content::Tiff(tiff) = &mut self.content {
            tiff.nodata = tiff.nodata.or(Some(self.facts.sample.rounded(nodata)));
        }
    }

    /// Takes what a file beside the raster tells, but for the mark of missing heights.
    pub(crate) fn set_aux(&mut self, aux: &AuxFile) {
        let facts = &mut self.facts;
        facts.place = aux.place.or(facts.place);
        if let Some(crs) = aux.crs.as_ref().filter(|crs| !is_undefined(crs)) {
            facts.crs = RasterCrs { horizontal: Some(crs.clone()), ..RasterCrs::default() };
        }
        if aux.unit.is_some() {
            facts.crs.height_unit_m = aux.unit_m();
            facts.unknown_unit = aux.unit.clone().filter(|_| aux.unit_m().is_none());
        }
        match (&mut self.content, aux.heights) {
            (Content::Tiff(tiff), Some(rule)) => tiff.set_rule(rule),
            (_, Some(rule)) => self.rule = Some(rule),
            (_, None) => {}
        }
    }

    /// Takes the mask of a file beside the raster: pixels that are 0 there have no value. Smaller copies of the raster of which the mask has
    /// no copy are not read. Fails if it is no TIFF file, or has another size.
    pub(crate) fn set_mask(&mut self, reader: Box<dyn ReadSeek>) -> Result<(), RasterError> {
        let (mask, facts) = TiffRaster::open(Source::new(reader)?, self.limits)?;
        if facts.size != self.facts.size {
            let [own, other] = [self.facts.size, facts.size].map(|size| format!("{} x {}", size.width, size.height));
            return Err(RasterError::unsupported(format!("a mask of {other} pixels for {own}")));
        }
        self.facts.levels.retain(|size| facts.levels.contains(size));
        if let Content::Tiff(tiff) = &mut self.content {
            tiff.keep_levels(&facts.levels);
        }
        self.mask = Some(Box::new(mask));
        Ok(())
    }

    /// What is inexact or guessed about the heights.
    pub(crate) fn warning(&self) -> Option<String> {
        match &self.content {
            Content::PointCloud(cloud) => cloud.warning(),
            Content::Tiff(tiff) => tiff.warning(),
            _ => None,
        }
    }

    /// Names of the first tiles that could not be read until now, and the number of all. Coarser ones are read instead.
    pub(crate) fn bad_tiles(&self) -> (&[String], usize) {
        match &self.content {
            Content::QuantizedMesh(terrain) => (terrain.bad_tiles(), terrain.bad_tile_count()),
            _ => (&[], 0),
        }
    }

    /// Whether the raster is a picture and no heights, and what is guessed about it. Heights have one band, and hardly ever 8 bits.
    /// A mark of missing values tells nothing, because grey pictures have one, too.
    pub(crate) fn is_picture(&self, name: &str) -> (bool, Option<&'static str>) {
        let facts = &self.facts;
        let is_bytes = facts.sample == SampleKind::U8;
        let tiff = match &self.content {
            Content::Tiff(tiff) if is_bytes && facts.bands == 1 && !tiff.has_palette() => tiff,
            _ => return (facts.bands > 2 || is_bytes, None),
        };
        let RasterCrs { vertical, is_ellipsoidal, height_unit_m, .. } = &facts.crs;
        let has_unit = height_unit_m.is_some() || facts.unknown_unit.is_some();
        if has_unit || vertical.is_some() || *is_ellipsoidal || tiff.has_rule() {
            return (false, None);
        }
        let file = name.rsplit(['/', '\\']).next().unwrap_or(name).to_lowercase();
        let is_of_heights = file.split(|c: char| !c.is_alphabetic()).any(|word| NAMES_OF_HEIGHTS.contains(&word));
        (!is_of_heights, Some(if is_of_heights { TAKEN_AS_HEIGHTS } else { TAKEN_AS_PICTURE }))
    }

    /// What is known of the raster.
    pub(crate) fn facts(&self) -> &RasterFacts {
        &self.facts
    }

    /// Heights of a window of a level by row, from the first band; NaN where there are none. Level 0 is the
    /// raster itself.
    ///
    /// Fails if the window is not within the level.
    pub(crate) fn read_heights(&mut self, window: Window, level: usize) -> Result<Vec<f32>, RasterError> {
        let len = self.window_len(window, level)?;
        let mut heights = match &mut self.content {
            Content::Tiff(tiff) => tiff.read_heights(window, level, len),
            Content::Hgt(hgt) => hgt.read_heights(window, len),
            Content::Ascii(grid) => grid.read_heights(window, len),
            Content::QuantizedMesh(terrain) => terrain.read_heights(window, len),
            Content::PointCloud(cloud) => cloud.read_heights(window, len),
            Content::Picture(_) => Err(RasterError::unsupported("colours in place of heights")),
        }?;
        if let Some([scale, offset]) = self.rule {
            heights.iter_mut().for_each(|height| *height = (f64::from(*height) * scale + offset) as f32);
        }
        if let (Some(mask), Some(size)) = (&mut self.mask, self.facts.levels.get(level)) {
            mask.visit_hidden(window, *size, |pixel| heights[pixel] = f32::NAN)?;
        }
        Ok(heights)
    }

    /// Red, green, blue and alpha of a window of a level by row, of 8 bits. Alpha is 0 where there is no
    /// value.
    ///
    /// Fails if the window is not within the level.
    pub(crate) fn read_colours(&mut self, window: Window, level: usize) -> Result<Vec<[u8; 4]>, RasterError> {
        let len = self.window_len(window, level)?;
        let mut pixels = match &mut self.content {
            Content::Tiff(tiff) => tiff.read_colours(window, level, len),
            Content::Picture(picture) => picture.read_colours(window, len),
            Content::Hgt(_) | Content::Ascii(_) | Content::QuantizedMesh(_) | Content::PointCloud(_) => {
                Err(RasterError::unsupported("heights in place of colours"))
            }
        }?;
        if let (Some(mask), Some(size)) = (&mut self.mask, self.facts.levels.get(level)) {
            mask.visit_hidden(window, *size, |pixel| pixels[pixel][3] = 0)?;
        }
        Ok(pixels)
    }

    /// Bytes of a file whose pixels may take next to none; `None` of formats in which each takes some, or is read at once.
    pub(crate) fn packed_bytes(&self) -> Option<u64> {
        match &self.content {
            Content::Tiff(tiff) => Some(tiff.file_bytes()),
            _ => None,
        }
    }

    /// Whether a TIFF picture is black at one of its corners, as those are that do not say where they have no value.
    pub(crate) fn has_black_corner(&mut self) -> bool {
        let RasterSize { width, height } = self.facts.size;
        if !matches!(self.content, Content::Tiff(_)) || width < 2 * CORNER_PIXELS || height < 2 * CORNER_PIXELS {
            return false;
        }
        let corners = [0, width - CORNER_PIXELS].into_iter().flat_map(|x| [[x, 0], [x, height - CORNER_PIXELS]]);
        let windows = corners.map(|[x, y]| Window { x, y, width: CORNER_PIXELS, height: CORNER_PIXELS });
        let is_black = |pixels: Vec<[u8; 4]>| pixels.iter().all(|pixel| *pixel == [0, 0, 0, 255]);
        windows.into_iter().any(|window| self.read_colours(window, 0).is_ok_and(is_black))
    }

    fn window_len(&self, window: Window, level: usize) -> Result<usize, RasterError> {
        let size = self.facts.levels.get(level).ok_or(RasterError::Outside)?;
        window.checked_len(*size, &self.limits)
    }
}
