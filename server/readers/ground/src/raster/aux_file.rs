//! What GDAL notes about a raster in a file beside it, `dem.tif.aux.xml`: its place, its system, and how numbers become heights.

use super::place::GeoPlace;
use insula_source::units::metres_of;

/// What a file beside a raster tells; it counts before what the raster itself tells, as in GDAL.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct AuxFile {
    pub(super) place: Option<GeoPlace>,
    /// Well-known text.
    pub(super) crs: Option<String>,
    pub(crate) nodata: Option<f64>,
    /// A number becomes a height by this factor and this summand.
    pub(super) heights: Option<[f64; 2]>,
    /// The name of the unit of heights.
    pub(super) unit: Option<String>,
}

impl AuxFile {
    /// Reads the text of a file. What is malformed is not told.
    pub(crate) fn parse(text: &str) -> Self {
        // Bands follow the dataset. Heights are in the first.
        let (dataset, bands) = text.split_once("<PAMRasterBand").unwrap_or((text, ""));
        let first = bands.split("</PAMRasterBand>").next().unwrap_or_default();
        let number = |name: &str| element(first, name)?.trim().parse::<f64>().ok();
        let (scale, offset) = (number("Scale"), number("Offset"));
        let is_finite = |values: &[f64; 2]| values.iter().all(|value| value.is_finite());
        let heights = (scale.is_some() || offset.is_some()).then(|| [scale.unwrap_or(1.0), offset.unwrap_or(0.0)]);
        Self {
            place: element(dataset, "GeoTransform").and_then(|text| place(&text)),
            crs: element(dataset, "SRS").map(|text| text.trim().to_owned()).filter(|text| !text.is_empty()),
            nodata: number("NoDataValue"),
            heights: heights.filter(is_finite),
            unit: element(first, "UnitType").map(|unit| unit.trim().to_owned()).filter(|unit| !unit.is_empty()),
        }
    }

    /// Metres of the unit of heights, if it is known.
    pub(super) fn unit_m(&self) -> Option<f64> {
        metres_of(self.unit.as_deref()?)
    }
}

/// The text of the first element of a name.
fn element(text: &str, name: &str) -> Option<String> {
    let tag = format!("<{name}");
    let start = text.match_indices(&tag).map(|(at, tag)| at + tag.len());
    let mut contents = start.filter_map(|end| {
        let rest = &text[end..];
        let is_whole_name = rest.starts_with(|c: char| c == '>' || c.is_ascii_whitespace());
        rest.split_once('>').filter(|_| is_whole_name).map(|(_, content)| content)
    });
    let content = contents.next()?.split('<').next()?;
    let plain = content.replace("&quot;", "\"").replace("&apos;", "'").replace("&lt;", "<").replace("&gt;", ">");
    Some(plain.replace("&amp;", "&"))
}

/// Six numbers: the corner's x, its steps by column and row, then the same of y.
fn place(text: &str) -> Option<GeoPlace> {
    let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    let [x, x_of_column, x_of_row, y, y_of_column, y_of_row] = numbers[..] else { return None };
    GeoPlace::from_corner([x, y], [x_of_column, y_of_column], [x_of_row, y_of_row])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn place_system_and_rule_of_heights_are_read() {
        let text = r#"<PAMDataset>
            <SRS dataAxisToSRSAxisMapping="1,2">PROJCS[&quot;a &amp; b&quot;]</SRS>
            <GeoTransform> 5.0e+05, 2.0, 0.0, 5.4e+06, 0.0, -2.0</GeoTransform>
            <PAMRasterBand band="1"><NoDataValue>-9.99900000000000000E+03</NoDataValue>
            <UnitType>ft</UnitType><Offset>100</Offset><Scale>0.1</Scale></PAMRasterBand>
            <PAMRasterBand band="2"><NoDataValue>7</NoDataValue></PAMRasterBand></PAMDataset>"#;
        let aux = AuxFile::parse(text);
        assert_eq!(aux.place, GeoPlace::from_corner([5e5, 5.4e6], [2.0, 0.0], [0.0, -2.0]));
        assert_eq!((aux.crs.as_deref(), aux.nodata), (Some("PROJCS[\"a & b\"]"), Some(-9999.0)));
        assert_eq!((aux.heights, aux.unit_m()), (Some([0.1, 100.0]), Some(0.3048)));
        for text in
            ["", "<SRS>", "<GeoTransform>1, 2</GeoTransform>", "<PAMRasterBand><Scale>x</Scale>", "<SRSS>a</SRSS>"]
        {
            assert_eq!(AuxFile::parse(text), AuxFile::default(), "{text}");
        }
    }
}
