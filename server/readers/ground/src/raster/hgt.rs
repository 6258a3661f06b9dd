//! SRTM tiles (`N52E004.hgt`): a square degree of big-endian heights, whose place is in the file's name.

use super::error::RasterError;
use super::facts::{RasterFacts, RasterSize, SampleKind, Window};
use super::place::GeoPlace;
use super::source::Source;

const NODATA: i16 = -32768;
/// Rows and columns: three seconds of arc, one, and half a second.
const SIDES: [u32; 3] = [1201, 3601, 7201];

/// An SRTM tile.
pub(super) struct Hgt {
    source: Source,
    side: u32,
    /// The mark of missing heights that the user gives.
    pub(super) nodata_by_hand: Option<f64>,
}

/// Whether a name is that of an SRTM tile.
pub(super) fn is_hgt(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".hgt")
}

impl Hgt {
    pub(super) fn open(source: Source, name: &str) -> Result<(Self, RasterFacts), RasterError> {
        let side = SIDES.into_iter().find(|side| u64::from(*side).pow(2) * 2 == source.len());
        let side = side.ok_or_else(|| RasterError::damaged("its size is not that of an SRTM tile"))?;
        let [west, south] = corner(name)
            .ok_or_else(|| RasterError::damaged("its name does not start with its place, such as N52E004"))?;
        let step = 1.0 / f64::from(side - 1);
        let mut facts = RasterFacts::new(RasterSize { width: side, height: side }, SampleKind::I16);
        facts.place = GeoPlace::checked([west, south + 1.0], [step, 0.0], [0.0, -step]);
        facts.crs.horizontal = Some("EPSG:4326".to_owned());
        // EGM96, as the products say.
        facts.crs.vertical = Some("EPSG:5773".to_owned());
        facts.crs.height_unit_m = Some(1.0);
        facts.nodata = Some(f64::from(NODATA));
        Ok((Self { source, side, nodata_by_hand: None }, facts))
    }

    pub(super) fn read_heights(&mut self, window: Window, len: usize) -> Result<Vec<f32>, RasterError> {
        let mut heights = Vec::with_capacity(len);
        for row in window.y..window.y + window.height {
            let first = u64::from(row) * u64::from(self.side) + u64::from(window.x);
            let bytes = self.source.read_at(first * 2, u64::from(window.width) * 2)?;
            let numbers = bytes.as_chunks().0.iter().map(|bytes| i16::from_be_bytes(*bytes));
            let is_missing = |number: i16| number == NODATA || self.nodata_by_hand == Some(f64::from(number));
            heights.extend(numbers.map(|number| if is_missing(number) { f32::NAN } else { f32::from(number) }));
        }
        Ok(heights)
    }
}

/// Longitude and latitude of the south-western corner by a file's name.
fn corner(name: &str) -> Option<[f64; 2]> {
    let name = name.rsplit(['/', '\\']).next()?.to_ascii_uppercase();
    let (latitude, longitude) = (name.get(..3)?, name.get(3..7)?);
    let degrees = |text: &str, positive: char, negative: char, max: f64| {
        let sign = match text.chars().next()? {
            first if first == positive => 1.0,
            first if first == negative => -1.0,
            _ => return None,
        };
        let digits = text.get(1..).filter(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))?;
        digits.parse::<f64>().ok().filter(|degrees| *degrees <= max).map(|degrees| sign * degrees)
    };
    Some([degrees(longitude, 'E', 'W', 180.0)?, degrees(latitude, 'N', 'S', 90.0)?])
}
