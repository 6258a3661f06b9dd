//! Colours of shapes by kind, light or object.

use crate::{
    face::FacePlane,
    style::{FillMode, Rgb, Stylesheet},
};
use glam::DVec3;
use insula_export::leaves::{LeafObject, is_land};
use insula_protocol::mesh_tile::NO_OBJECT;

/// Steps of light. Faces of one step have one colour, so that they are one shape.
const STEPS: f64 = 24.0;
/// Land has fewer, because its small slopes are not what a drawing of a city shows.
const LAND_STEPS: f64 = 6.0;
/// Light of faces that the sun does not reach.
const AMBIENT: f64 = 0.55;

/// Gives colours to faces.
#[derive(Debug, Clone)]
pub(crate) struct Tones<'a> {
    style: &'a Stylesheet,
    towards_sun: DVec3,
}

impl<'a> Tones<'a> {
    pub(crate) fn new(style: &'a Stylesheet) -> Self {
        Self { style, towards_sun: towards_sun(style) }
    }

    /// The colour of a face of an object that may have a colour of its own; `None` if it is not filled.
    pub(crate) fn color(&self, object: &LeafObject, own: Option<Rgb>, plane: &FacePlane) -> Option<Rgb> {
        let color = own.unwrap_or_else(|| self.style.color(object.kind));
        match self.style.fill {
            FillMode::None => None,
            FillMode::Kind => Some(color),
            FillMode::Object if object.number == NO_OBJECT => Some([255; 3]),
            FillMode::Object => Some([16, 8, 0].map(|shift| (object.number >> shift & 0xff) as u8)),
            FillMode::Light => {
                let direct = plane.normal.dot(self.towards_sun).max(0.0);
                let steps = if is_land(object.kind) { LAND_STEPS } else { STEPS };
                let light = AMBIENT + (1.0 - AMBIENT) * (direct * steps).round() / steps;
                Some(color.map(|v| (f64::from(v) * light).round() as u8))
            }
        }
    }
}

/// Unit vector to the sun.
pub(crate) fn towards_sun(style: &Stylesheet) -> DVec3 {
    let [azimuth, altitude] = style.sun.map(f64::to_radians);
    DVec3::new(azimuth.sin() * altitude.cos(), azimuth.cos() * altitude.cos(), altitude.sin())
}
