//! What is drawn, as JSON: the options of `insula draw` for clients of a server.

use crate::error::DrawError;
use crate::file::DrawingFormat;
use crate::limits::DrawLimits;
use crate::paint::over_heights;
use crate::request::DrawRequest;
use crate::sheet::Paper;
use crate::style::{Stylesheet, parse_look};
use crate::view::DrawView;
use insula_export::camera::ExportCamera;
use insula_export::selection::{ObjectSelection, passing};
use insula_export::source::ExportSource;
use insula_objects::ColorBy;
use insula_objects::filter::{Filter, MAX_FILTER_BYTES};
use insula_protocol::area::requested_area;
use serde::Deserialize;

/// Largest coordinate in metres.
const MAX_M: f64 = 1e9;
const MAX_TITLE_BYTES: usize = 256;

/// The options of a drawing. All but the format have defaults.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrawingOptions {
    pub format: DrawingFormat,
    /// A perspective view. At most one of `view`, `plan` and `axonometric`; a plan if there is none.
    view: Option<ExportCamera>,
    /// Whether an eye inside of a building or below the ground stays there, instead of being lifted out.
    #[serde(default)]
    pub keep_camera: bool,
    #[serde(default)]
    plan: bool,
    /// Azimuth and elevation in degrees.
    axonometric: Option<[f64; 2]>,
    /// West, south, east and north in degrees.
    bbox: Option<[f64; 4]>,
    /// The same in metres of the city's coordinate system.
    bbox_metres: Option<[f64; 4]>,
    filter: Option<String>,
    /// `ATTRIBUTE` or `ATTRIBUTE:PALETTE`.
    color_by: Option<String>,
    /// `1:N`.
    scale: Option<String>,
    paper: Option<String>,
    style: Option<Stylesheet>,
    title: Option<String>,
    #[serde(default)]
    bare: bool,
    /// DXF as a sheet of paper in millimetres, instead of metres of the city.
    #[serde(default)]
    sheet: bool,
    /// `model` or `paper`.
    look: Option<String>,
    #[serde(default)]
    shadows: bool,
    /// Azimuth and altitude of the sun in degrees.
    sun: Option<[f64; 2]>,
}

fn invalid<T>(text: impl Into<String>) -> Result<T, DrawError> {
    Err(DrawError::Invalid(text.into()))
}

impl DrawingOptions {
    /// Reads options. Fails if they are not JSON, or have an unknown field.
    pub fn parse(json: &[u8]) -> Result<Self, DrawError> {
        serde_json::from_slice(json).map_err(|error| DrawError::Invalid(error.to_string()))
    }

    /// Names the part of the city that is drawn, and its detail: drawings of one name may share a [`DrawnPart`](crate::DrawnPart).
    #[must_use]
    pub fn part_name(&self) -> String {
        format!("{:?} {:?} {:?} {:?}", self.bbox, self.bbox_metres, self.scale, self.filter)
    }

    /// How a city is drawn, without the [selection](Self::selection), which takes longer. Fails if a value is out of range.
    pub fn request(&self, source: &dyn ExportSource, limits: DrawLimits) -> Result<DrawRequest, DrawError> {
        let view = self.view()?;
        let scale = self.scale.as_deref().map(parse_scale).transpose()?;
        if scale.is_some() && self.view.is_some() {
            return invalid("scale: a perspective view has none");
        }
        if self.title.as_ref().is_some_and(|title| title.len() > MAX_TITLE_BYTES) {
            return invalid(format!("title: longer than {MAX_TITLE_BYTES} bytes"));
        }
        let paper = self.paper.as_deref().map_or(Ok(Paper::default()), Paper::parse)?;
        let mut style = self.style.clone().map_or_else(|| Ok(Stylesheet::default()), Stylesheet::completed)?;
        style.shadows |= self.shadows;
        if let Some(word) = &self.look {
            style.look = parse_look(word).map_err(|error| DrawError::Invalid(format!("look: {error}")))?;
        }
        if let Some([azimuth, altitude]) = self.sun {
            if azimuth.abs() > 360.0 || !(0.0..=90.0).contains(&altitude) {
                return invalid("sun: expected degrees from north, and degrees above the horizon from 0 to 90");
            }
            style.sun = [azimuth, altitude];
        }
        let color_by = match &self.color_by {
            Some(text) => match ColorBy::parse(text, source.schema()) {
                Ok(color_by) => Some(over_heights(color_by, source)?),
                Err(error) => return invalid(format!("color_by: {error}")),
            },
            None => None,
        };
        Ok(DrawRequest {
            view,
            paper,
            scale,
            is_bare: self.bare,
            title: self.title.clone(),
            style,
            is_sheet: self.sheet,
            color_by,
            limits,
            ..DrawRequest::default()
        })
    }

    fn view(&self) -> Result<DrawView, DrawError> {
        match (self.view, self.plan, self.axonometric) {
            (None, _, None) => Ok(DrawView::Plan),
            (None, false, Some([azimuth_deg, elevation_deg])) => {
                if azimuth_deg.abs() > 360.0 || !(0.0..=90.0).contains(&elevation_deg) {
                    return invalid(
                        "axonometric: expected degrees from north, and degrees above the horizon from 0 to 90",
                    );
                }
                Ok(DrawView::Axonometric { azimuth_deg, elevation_deg })
            }
            (Some(camera), false, None) => {
                let points = camera.position.iter().chain(&camera.target).chain(&camera.up);
                if points.into_iter().any(|v| v.abs() > MAX_M) {
                    return invalid("view: a coordinate is out of range");
                }
                Ok(DrawView::Perspective(camera))
            }
            _ => invalid("at most one of view, plan and axonometric"),
        }
    }

    /// Corners on the map of the area that is drawn; `None` for all of the city.
    fn area(&self, on_map: &dyn Fn([f64; 4]) -> Option<[[f64; 2]; 2]>) -> Result<Option<[[f64; 2]; 2]>, DrawError> {
        requested_area(self.bbox, self.bbox_metres, on_map).map_err(|reason| DrawError::Invalid(reason.to_owned()))
    }

    /// What is drawn of a city: with a filter, after reading all of its objects. `on_map` gives the corners on the city's map of an area
    /// in degrees, or `None` if these are not known. Fails if the objects cannot be read, or a value is invalid.
    pub fn selection(
        &self,
        source: &dyn ExportSource,
        on_map: &dyn Fn([f64; 4]) -> Option<[[f64; 2]; 2]>,
    ) -> Result<ObjectSelection, DrawError> {
        let bbox = self.area(on_map)?;
        let objects = match &self.filter {
            Some(text) if text.len() > MAX_FILTER_BYTES => {
                return invalid(format!("filter: longer than {MAX_FILTER_BYTES} bytes"));
            }
            Some(text) => match Filter::parse(text, source.schema()) {
                Ok(filter) => Some(passing(source, &filter)?),
                Err(error) => return invalid(format!("filter: {error}")),
            },
            None => None,
        };
        Ok(ObjectSelection { bbox, objects, ..ObjectSelection::default() })
    }
}

fn parse_scale(text: &str) -> Result<f64, DrawError> {
    let number = text.strip_prefix("1:").and_then(|number| number.parse().ok());
    match number.filter(|scale| (1.0..=10_000_000.0).contains(scale)) {
        Some(scale) => Ok(scale),
        None => invalid("scale: expected 1:1 to 1:10000000"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(json: &str) -> Result<DrawView, DrawError> {
        DrawingOptions::parse(json.as_bytes())?.view()
    }

    #[test]
    fn options_have_one_view() {
        assert_eq!(view(r#"{"format":"svg"}"#).unwrap(), DrawView::Plan);
        let axonometric = DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 35.0 };
        assert_eq!(view(r#"{"format":"pdf","axonometric":[30,35]}"#).unwrap(), axonometric);
        let camera = r#"{"format":"dxf","view":{"position":[0,0,9],"target":[0,9,0]}}"#;
        let DrawView::Perspective(camera) = view(camera).unwrap() else { panic!("another view") };
        assert_eq!((camera.up, camera.fov_y_deg), ([0.0, 0.0, 1.0], 60.0));
        for wrong in [
            "",
            "{}",
            r#"{"format":"png"}"#,
            r#"{"format":"svg","plan":true,"axonometric":[0,0]}"#,
            r#"{"format":"svg","axonometric":[0,-1]}"#,
            r#"{"format":"svg","axonometric":[1e999,0]}"#,
            r#"{"format":"svg","view":{"position":[1e300,0,9],"target":[0,9,0]}}"#,
            r#"{"format":"svg","style":{"fil":"light"}}"#,
            r#"{"format":"svg","out":"/etc/passwd"}"#,
        ] {
            assert!(view(wrong).is_err(), "{wrong}");
        }
        let area = |json: &str| {
            DrawingOptions::parse(json.as_bytes())?
                .area(&|[west, ..]| (west >= 0.0).then_some([[1.0, 2.0], [3.0, 4.0]]))
        };
        assert_eq!(area(r#"{"format":"svg"}"#).unwrap(), None);
        assert_eq!(area(r#"{"format":"svg","bbox":[4,52,5,53]}"#).unwrap(), Some([[1.0, 2.0], [3.0, 4.0]]));
        let metres = area(r#"{"format":"svg","bbox_metres":[84500,446150,84900,446500]}"#).unwrap();
        assert_eq!(metres, Some([[84_500.0, 446_150.0], [84_900.0, 446_500.0]]));
        for (wrong, words) in [
            (r#"{"format":"svg","bbox":[84500,446150,84900,446500]}"#, "bbox_metres takes metres"),
            (r#"{"format":"svg","bbox":[-4,52,5,53]}"#, "not known where"),
            (r#"{"format":"svg","bbox_metres":[5,5,1,9]}"#, "in metres"),
            (r#"{"format":"svg","bbox":[4,52,5,53],"bbox_metres":[1,2,3,4]}"#, "at most one"),
        ] {
            let error = area(wrong).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert!(parse_scale("1:500").is_ok() && parse_scale("1:nan").is_err() && parse_scale("500").is_err());
    }
}
