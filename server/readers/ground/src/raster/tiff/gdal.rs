//! Tags that GDAL adds to TIFF files: the value of missing pixels, how numbers become heights, and which bands are which colours.

use super::super::error::RasterError;
use super::super::facts::SampleKind;
use super::directory::{Directory, TiffFile};
use insula_source::decimal_mark::DecimalMark;
use insula_source::units::metres_of;

const METADATA: u16 = 42112;
const NODATA: u16 = 42113;

/// How the numbers of the first band become heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HeightRule {
    pub(super) scale: f64,
    pub(super) offset: f64,
}

/// What the tags of GDAL tell.
pub(super) struct GdalTags {
    pub(super) nodata: Option<f64>,
    /// `None` if they do not tell.
    pub(super) heights: Option<HeightRule>,
    /// Metres of one unit of height.
    pub(super) height_unit_m: Option<f64>,
    /// A unit of height that is not known.
    pub(super) unknown_unit: Option<String>,
    /// What to tell of a number that is none, and so does not count.
    pub(super) odd_number: Option<String>,
    /// The largest number of any band.
    pub(super) maximum: Option<f64>,
    /// The bands with red, green and blue, if each has its name.
    pub(super) colours: Option<[u16; 3]>,
}

impl GdalTags {
    pub(super) fn read(file: &mut TiffFile, directory: &Directory, sample: SampleKind) -> Result<Self, RasterError> {
        let mark = file.text(directory, NODATA)?.filter(|text| !text.trim().is_empty());
        let nodata = mark.as_deref().and_then(number_of);
        let metadata = file.text(directory, METADATA)?.unwrap_or_default();
        let number = |role: &str| number_of(item(&metadata, role)?).filter(|number| number.is_finite());
        let told = [("scale", item(&metadata, "scale")), ("offset", item(&metadata, "offset"))];
        let told = told.into_iter().chain([("mark of missing heights", mark.as_deref())]);
        let odd_number = told
            .filter_map(|(what, text)| Some((what, text?.trim())))
            .find(|(_, text)| number_of(text).is_none())
            .map(|(what, text)| format!("its {what} \"{text}\" is no number and does not count"));
        let unit = item(&metadata, "unittype").map(str::trim).filter(|unit| !unit.is_empty());
        Ok(Self {
            nodata: nodata.map(|number| sample.rounded(number)),
            heights: match (number("scale"), number("offset")) {
                (None, None) => None,
                (scale, offset) => Some(HeightRule { scale: scale.unwrap_or(1.0), offset: offset.unwrap_or(0.0) }),
            },
            height_unit_m: unit.and_then(metres_of),
            unknown_unit: unit.filter(|unit| metres_of(unit).is_none()).map(str::to_owned),
            odd_number,
            maximum: maximum(&metadata),
            colours: colours(&metadata),
        })
    }
}

/// A number, also with a comma before its decimals.
fn number_of(text: &str) -> Option<f64> {
    let text = text.trim();
    text.parse().ok().or_else(|| DecimalMark::Comma.number(text))
}

/// The text of an item of the first band, such as `<Item name="SCALE" sample="0" role="scale">0.1</Item>`.
fn item<'t>(metadata: &'t str, role: &str) -> Option<&'t str> {
    let role = format!("role=\"{role}\"");
    let items = metadata.split("<Item ").skip(1).filter_map(|item| item.split_once('>'));
    let (_, text) = items.into_iter().find(|(tag, _)| tag.contains(&role) && tag.contains("sample=\"0\""))?;
    text.split_once('<').map(|(text, _)| text)
}

/// The largest number in the statistics of all bands.
fn maximum(metadata: &str) -> Option<f64> {
    let items = metadata.split("<Item ").skip(1).filter_map(|item| item.split_once('>'));
    let of_maximum = items.filter(|(tag, _)| tag.contains("name=\"STATISTICS_MAXIMUM\""));
    of_maximum.filter_map(|(_, text)| text.split('<').next()?.trim().parse::<f64>().ok()).reduce(f64::max)
}

/// The bands of red, green and blue by items such as `<Item name="COLORINTERP" sample="2" role="colorinterp">Red</Item>`.
fn colours(metadata: &str) -> Option<[u16; 3]> {
    let band = |colour: &str| {
        let mut items = metadata.split("<Item ").skip(1).filter_map(|item| item.split_once('>'));
        let (tag, _) = items.find(|(tag, text)| {
            tag.contains("role=\"colorinterp\"")
                && text.split('<').next().is_some_and(|name| name.trim().eq_ignore_ascii_case(colour))
        })?;
        tag.split_once("sample=\"")?.1.split('"').next()?.parse::<u16>().ok()
    };
    Some([band("red")?, band("green")?, band("blue")?])
}

impl HeightRule {
    pub(super) const AS_IS: Self = Self { scale: 1.0, offset: 0.0 };

    /// The height of a number; NaN for missing ones, which one of the marks marks.
    pub(super) fn height(self, number: f64, sample: SampleKind, marks: [Option<f64>; 2]) -> f32 {
        let is_mark = |mark: &Option<f64>| mark.is_some_and(|mark| sample.is_mark(number, mark));
        if !number.is_finite() || marks.iter().any(is_mark) {
            return f32::NAN;
        }
        (number * self.scale + self.offset) as f32
    }
}
