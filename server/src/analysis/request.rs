//! A question about a part of a city as JSON, as clients of the server ask it, and its answer: GeoJSON, a sheet of paper, or what a place
//! sees of the sky.

use super::answer::{Answer, Progress, grown};
use super::colors::Colors;
use super::error::RequestError;
use super::evidence::SkyPlace;
use super::regions::{features, lon_lat};
use super::samples::Samples;
use super::sheet::AnalysisSheet;
use crate::args::Analysis;
use insula_analysis::buildings::sum_up;
use insula_analysis::clock::{Moment, TimeSystem};
use insula_analysis::rule::Rule;
use insula_analysis::sun::Site;
use insula_analysis::surface::CitySurface;
use insula_bake::read::EarthPlace;
use insula_draw::DrawLimits;
use insula_draw::file::{DrawingFormat, encode};
use insula_export::raster::CellExtent;
use insula_export::source::ExportSource;
use insula_export::table::attribution;
use insula_protocol::area::requested_area;
use serde::Deserialize;
use serde_json::json;

/// Largest area in square metres, and what a sum of its sides may be off.
const MAX_AREA_M2: f64 = 1_000_000.0;
const AREA_TOLERANCE: f64 = 1.001;
/// What stands so far around the area throws shadows and hides the sky.
const REACH_M: f64 = 500.0;
/// Beyond this, in absolute value, there is no city.
const MAX_COORDINATE_M: f64 = 1e9;
/// Most squares along a side of the answer.
const MAX_SQUARES: u32 = 160;

/// The sun's path of questions without a rule.
const USUAL_DAYS: &str = "title = \"the sun's path at the solstices and in March\"
source = \"days that studies of shadows have\"
days = [\"03-21\", \"06-21\", \"12-21\"]
";

/// What is asked, and where.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AnalysisRequest {
    kind: AskedKind,
    /// Name of a built-in rule, of `sun`.
    rule: Option<String>,
    /// Time of `shadow`.
    time: Option<String>,
    /// Of a time without an offset.
    time_zone: Option<String>,
    /// West, south, east and north in degrees.
    bbox: Option<[f64; 4]>,
    /// The same in metres of the city's coordinate system. The answer has these, too.
    bbox_metres: Option<[f64; 4]>,
    #[serde(default)]
    format: AnswerFormat,
    /// Longitude and latitude of the place of a PNG.
    point: Option<[f64; 2]>,
    /// The same in metres of the city's coordinate system.
    point_metres: Option<[f64; 2]>,
}

/// What the answer is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AnswerFormat {
    /// Areas of equal values, and numbers.
    #[default]
    GeoJson,
    /// A sheet of paper.
    Pdf,
    /// What a place sees of the sky.
    Png,
}

/// How much is read for an answer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AnswerLimits {
    /// Cells of the area with those around it.
    pub(crate) cells: u64,
    pub(crate) drawing: DrawLimits,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum AskedKind {
    Sun,
    Sky,
    Solar,
    Shadow,
}

/// What is asked, as it is computed.
enum AskedValues {
    Sun(Site, Box<Rule>),
    Sky,
    Solar(Site),
    Shadow(Site, Moment),
}

fn invalid<T>(text: impl Into<String>) -> Result<T, RequestError> {
    Err(RequestError::Invalid(text.into()))
}

impl AskedKind {
    fn analysis(self) -> Analysis {
        match self {
            Self::Sun => Analysis::Sun,
            Self::Sky => Analysis::Sky,
            Self::Solar => Analysis::Solar,
            Self::Shadow => Analysis::Shadow,
        }
    }
}

impl AnalysisRequest {
    /// Fails if it is not JSON, or has an unknown field.
    pub(crate) fn parse(json: &[u8]) -> Result<Self, RequestError> {
        serde_json::from_slice(json).map_err(|error| RequestError::Invalid(error.to_string()))
    }

    /// What the answer is.
    pub(crate) fn format(&self) -> AnswerFormat {
        self.format
    }

    /// The answer for a city: GeoJSON with a feature for each class of values, and with numbers, notes and who must be named; the same as a
    /// sheet of paper; or what a place sees of the sky. Fails if a value is invalid, the area too large, or the city cannot be read, and once
    /// `progress` says so.
    pub(crate) fn answer(
        &self,
        source: &dyn ExportSource,
        limits: AnswerLimits,
        progress: Progress<'_>,
    ) -> Result<Vec<u8>, RequestError> {
        let manifest = source.manifest();
        let asked = self.asked(source)?;
        let place = manifest.crs.as_deref().and_then(EarthPlace::of);
        if self.format == AnswerFormat::Png {
            let sky_place = self.sky_place(place.as_ref())?;
            let (site, rule) = asked.sun_shown(source)?;
            return sky_place.picture(source, (&site, &rule), limits.cells, progress);
        }
        if self.point.is_some() || self.point_metres.is_some() {
            return invalid("point: only png has one");
        }
        let area = self.area(place.as_ref())?;
        let around = grown(area, REACH_M);
        let [extent, read] = [area, around].map(|area| CellExtent::of(manifest, Some(area)));
        let extent = extent.map_err(RequestError::of_export)?;
        if read.map_err(RequestError::of_export)?.len() > limits.cells {
            return Err(RequestError::TooLarge);
        }
        let mut surface = CitySurface::read(source, Some(around)).map_err(RequestError::of_export)?;
        let answer = asked.answer(&mut surface, progress)?;
        if !progress(1.0) {
            return Err(RequestError::Stopped);
        }
        let answer = answer.within(&surface, extent);
        let colors = Colors::of(self.kind.analysis(), &answer);
        if self.format == AnswerFormat::Pdf {
            let (answer, colors) = (&answer, &colors);
            let sheet =
                AnalysisSheet { source, surface: &surface, answer, colors, extent, added: &[], limits: limits.drawing };
            let drawing = sheet.draw(&|_, share| progress(share)).map_err(RequestError::of_draw)?;
            return Ok(encode(&drawing, DrawingFormat::Pdf));
        }
        self.geojson(source, place.as_ref(), &surface, extent, (&answer, &colors))
    }

    fn asked(&self, source: &dyn ExportSource) -> Result<AskedValues, RequestError> {
        let is_of = |kind| self.kind == kind;
        if self.rule.is_some() && !is_of(AskedKind::Sun) {
            return invalid("rule: only sun has one");
        }
        if (self.time.is_some() || self.time_zone.is_some()) && !is_of(AskedKind::Shadow) {
            return invalid("time: only shadow has one");
        }
        let site = || site_of(source);
        match self.kind {
            AskedKind::Sky => Ok(AskedValues::Sky),
            AskedKind::Solar => Ok(AskedValues::Solar(site()?)),
            AskedKind::Sun => {
                let rule = self.rule.as_deref().and_then(Rule::built_in);
                let names = || format!("rule: one of {}", Rule::names().collect::<Vec<_>>().join(", "));
                let rule = rule.ok_or_else(|| RequestError::Invalid(names()))?;
                Ok(AskedValues::Sun(site()?, Box::new(rule)))
            }
            AskedKind::Shadow => {
                let zone = self.time_zone.as_deref().map_or(Ok(TimeSystem::MeanSolar), TimeSystem::parse);
                let zone = zone.or_else(|reason| invalid(format!("time_zone: {reason}")))?;
                let Some(time) = &self.time else {
                    return invalid("shadow needs a time, as in 2025-12-21T10:00+01:00");
                };
                let moment = Moment::parse(time, &zone).or_else(|reason| invalid(format!("time: {reason}")))?;
                Ok(AskedValues::Shadow(site()?, moment))
            }
        }
    }

    /// The area in world metres.
    fn area(&self, place: Option<&EarthPlace>) -> Result<[[f64; 2]; 2], RequestError> {
        let area = requested_area(self.bbox, self.bbox_metres, &|degrees| place?.box_on_map(degrees));
        let Some([low, high]) = area.map_err(|reason| RequestError::Invalid(reason.to_owned()))? else {
            return invalid("write bbox or bbox_metres");
        };
        if (high[0] - low[0]) * (high[1] - low[1]) > MAX_AREA_M2 * AREA_TOLERANCE {
            return Err(RequestError::TooLarge);
        }
        Ok([low, high])
    }

    /// The place of a PNG.
    fn sky_place(&self, place: Option<&EarthPlace>) -> Result<SkyPlace, RequestError> {
        if self.bbox.is_some() || self.bbox_metres.is_some() {
            return invalid("bbox: png has a point in place of an area");
        }
        let at = match (self.point, self.point_metres) {
            (None, Some(metres)) => Some(metres),
            (Some([longitude, latitude]), None) if longitude.abs() <= 180.0 && latitude.abs() <= 90.0 => {
                place.and_then(|place| place.on_map([longitude, latitude]))
            }
            (Some(_), None) => None,
            _ => return invalid("png needs either point or point_metres"),
        };
        let at = at.filter(|at| at.iter().all(|metres| metres.abs() < MAX_COORDINATE_M));
        let Some(at) = at else { return invalid("point: out of the city's coordinate system") };
        let name = match place.and_then(|place| lon_lat(place, at)) {
            Some([longitude, latitude]) => format!("{longitude:.6}, {latitude:.6}"),
            None => "place".to_owned(),
        };
        Ok(SkyPlace { name, at, reach_m: REACH_M })
    }

    fn geojson(
        &self,
        source: &dyn ExportSource,
        place: Option<&EarthPlace>,
        surface: &CitySurface,
        extent: CellExtent,
        (answer, colors): (&Answer, &Colors),
    ) -> Result<Vec<u8>, RequestError> {
        let samples = Samples::of(extent, MAX_SQUARES);
        // Millimetres, or decimals of degrees as those of the command.
        let metres = |at: [f64; 2]| Some(at.map(|metres| (metres * 1000.0).round() / 1000.0));
        let degrees = |at: [f64; 2]| lon_lat(place?, at);
        let features = match self.bbox {
            Some(_) => features(answer, surface, &samples, colors, &degrees),
            None => features(answer, surface, &samples, colors, &metres),
        };
        let Some(features) = features else { return invalid("the area is out of the city's coordinate system") };
        let values = sum_up(surface, &answer.tops, &answer.points, &answer.walls, answer.asked);
        let collection = json!({
            "type": "FeatureCollection",
            "title": answer.title,
            "unit": answer.column,
            "asked": answer.asked,
            "notes": answer.notes,
            "reach_m": REACH_M,
            "square_m": f64::from(samples.every) * surface.cell_m,
            "roofs": answer.numbers(&values.roofs),
            "walls": answer.numbers(&values.walls),
            "ground": answer.numbers(&values.ground),
            "attribution": attribution(source.manifest()),
            "features": features,
        });
        Ok(collection.to_string().into_bytes())
    }
}

impl AskedValues {
    fn answer(self, surface: &mut CitySurface, progress: Progress<'_>) -> Result<Answer, RequestError> {
        Ok(match self {
            Self::Sun(site, rule) => Answer::of_sun(surface, &site, *rule, progress),
            Self::Sky => Answer::of_sky(surface, &[], progress),
            Self::Solar(site) => Answer::of_solar(surface, &site, None, &[], progress),
            Self::Shadow(site, moment) => match Answer::of_shadow(surface, &site, &moment) {
                Some(answer) => answer,
                None => return invalid(format!("time: {moment}: the sun's place is not known")),
            },
        })
    }

    /// The sun's path that a picture of the sky shows, and what counts of it. Fails if it is not known where the city lies.
    fn sun_shown(self, source: &dyn ExportSource) -> Result<(Site, Rule), RequestError> {
        let usual = || Rule::parse(USUAL_DAYS).map_err(|error| RequestError::Invalid(error.to_string()));
        Ok(match self {
            Self::Sun(site, rule) => (site, *rule),
            Self::Sky => (site_of(source)?, usual()?),
            Self::Solar(site) => (site, usual()?),
            Self::Shadow(site, moment) => {
                let title = "the sun's path on the day of the shadow".to_owned();
                (site, Rule { title, days: vec![moment.at.date()], ..usual()? })
            }
        })
    }
}

/// Where a city lies. Fails if that is not known.
fn site_of(source: &dyn ExportSource) -> Result<Site, RequestError> {
    let unknown = "it is not known where on Earth this city lies: bake it with --crs or --at";
    Site::of(source.manifest()).ok_or_else(|| RequestError::Invalid(unknown.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(fields: &str) -> Result<AnalysisRequest, RequestError> {
        AnalysisRequest::parse(format!("{{{fields}}}").as_bytes())
    }

    #[test]
    fn an_area_is_at_most_a_square_kilometre() {
        let area = |fields: &str| parse(&format!(r#""kind":"sky"{fields}"#))?.area(None);
        assert_eq!(area(r#","bbox_metres":[-500,0,500,1000]"#).unwrap(), [[-500.0, 0.0], [500.0, 1000.0]]);
        assert!(matches!(area(r#","bbox_metres":[0,0,1001,1001]"#), Err(RequestError::TooLarge)));
        for (fields, words) in [
            ("", "write bbox"),
            (r#","bbox":[4,52,5,53]"#, "not known where"),
            (r#","bbox_metres":[5,5,1,9]"#, "metres"),
        ] {
            let error = area(fields).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert!(Rule::parse(USUAL_DAYS).is_ok_and(|rule| rule.days.len() == 3));
        for unknown in [r#""kind":"view""#, r#""kind":"sun","out":"/etc/passwd""#, ""] {
            assert!(parse(unknown).is_err(), "{unknown}");
        }
    }
}
