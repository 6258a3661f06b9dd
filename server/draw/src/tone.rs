//! Colours of shapes by kind, light or object.

use crate::face::FacePlane;
use crate::style::{FillMode, Rgb, Stylesheet};
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};
use insula_export::leaves::{LeafObject, is_land};
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_shaders::cpu::shade::{SurfaceSample, linear_of, shade};
use insula_shaders::layout::{FrameUniform, Light, Shading};
use insula_shaders::light::Air;
use insula_shaders::tone::graded_colour;

/// Steps of light. Faces of one step have one colour, so that they are one shape.
const STEPS: f32 = 24.0;
/// Land has fewer, because its small slopes are not what a drawing of a city shows.
const LAND_STEPS: f32 = 6.0;

/// Gives colours to faces.
#[derive(Debug, Clone)]
pub(crate) struct Tones<'a> {
    style: &'a Stylesheet,
    /// The light of the sheet's look, as pictures have it.
    frame: FrameUniform,
}

impl<'a> Tones<'a> {
    pub(crate) fn new(style: &'a Stylesheet) -> Self {
        let sun = towards_sun(style).as_vec3();
        let frame = FrameUniform {
            sun: sun.to_array(),
            shading: Shading::Lit as u32,
            // Faces that the sun does not reach are told by their shadows, not by what they see of the sky.
            shadow_m: 1.0,
            light: style.look.grade(Light::of_sun(sun, Air::default()), sun),
            ..FrameUniform::zeroed()
        };
        Self { style, frame }
    }

    /// Light of a white face in the open, 1 for a value of white.
    fn light(&self, normal: DVec3) -> f32 {
        let normal = normal.as_vec3();
        // What is turned to the ground sees no sky, and a wall half of it.
        let surface = SurfaceSample { albedo: Vec3::ONE, ao: 0.5 + 0.5 * normal.z, normal, flags: 0, level: 0 };
        let light = shade(&self.frame, &surface);
        // Green is nearly all of the luminance, and the light of looks has little colour.
        (light.sky.y + light.sun.y) * self.frame.light.grade[0]
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
                let steps = if is_land(object.kind) { LAND_STEPS } else { STEPS };
                let light = (self.light(plane.normal) * steps).round() / steps;
                let [r, g, b, _] =
                    graded_colour(linear_of(u32::from_le_bytes([color[0], color[1], color[2], 0])) * light)
                        .to_le_bytes();
                Some([r, g, b])
            }
        }
    }
}

/// Unit vector to the sun.
pub(crate) fn towards_sun(style: &Stylesheet) -> DVec3 {
    let [azimuth, altitude] = style.sun.map(f64::to_radians);
    DVec3::new(azimuth.sin() * altitude.cos(), azimuth.cos() * altitude.cos(), altitude.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_shaders::look::Look;

    #[test]
    fn faces_have_the_light_of_the_look() {
        let light = |look: Look| {
            let style = Stylesheet { look, sun: [180.0, 45.0], ..Stylesheet::default() };
            let tones = Tones::new(&style);
            [DVec3::Z, DVec3::NEG_Y, DVec3::Y].map(|normal| tones.light(normal))
        };
        let [roof, sunny, shady] = light(Look::Model);
        assert!((1.0..1.25).contains(&roof) && sunny > 2.0 * shady && shady > 0.2, "{roof} {sunny} {shady}");
        // On paper, the sides of a house differ a little, and nothing is dark.
        let [roof, sunny, shady] = light(Look::Paper);
        assert!((roof - sunny).abs() < 0.1 && sunny > shady && shady > 0.6 && roof <= 1.0, "{roof} {sunny} {shady}");
    }
}
