//! Cameras as JSON files and for the ray-caster.

use anyhow::{Context, Result};
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};
use insula_shaders::layout::{FrameUniform, Light, Shading};
use insula_shaders::light::Air;
use insula_shaders::look::Look;
use serde::{Deserialize, Serialize};

/// A camera in the source's coordinates: the JSON of `insula snapshot --camera`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    pub position: [f64; 3],
    pub target: [f64; 3],
    pub up: [f64; 3],
    pub fov_y_deg: f64,
}

/// Size and contents of a frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameSpec {
    pub width_px: u32,
    pub height_px: u32,
    pub shading: Shading,
    pub samples: u32,
}

/// Axes of a camera. `forward` has length 1; `right` and `up` reach from the centre to the edges of the frame.
#[derive(Debug, Clone, Copy)]
pub struct Axes {
    pub forward: DVec3,
    pub right: DVec3,
    pub up: DVec3,
}

impl Axes {
    /// The direction through the centre of a pixel.
    pub fn ray(&self, spec: &FrameSpec, x: u32, y: u32) -> DVec3 {
        let ndc_x = (f64::from(x) + 0.5) / f64::from(spec.width_px) * 2.0 - 1.0;
        let ndc_y = (f64::from(y) + 0.5) / f64::from(spec.height_px) * 2.0 - 1.0;
        (self.forward + self.right * ndc_x - self.up * ndc_y).normalize_or(DVec3::X)
    }
}

impl Camera {
    /// A camera with a vertical field of view of 60 degrees.
    pub fn looking(position: DVec3, target: DVec3) -> Self {
        Self { position: position.into(), target: target.into(), up: [0.0, 0.0, 1.0], fov_y_deg: 60.0 }
    }

    /// The same camera for a session. Fails without a valid direction.
    pub fn to_viewer(&self) -> Result<insula_viewer::camera::Camera> {
        let [position, target, up] = [self.position, self.target, self.up].map(DVec3::from);
        let camera = insula_viewer::camera::Camera::look_at(position, target, up, self.fov_y_deg.to_radians());
        camera.with_context(|| format!("no valid view direction: {self:?}"))
    }

    /// Axes for a frame. If the camera looks along its `up`, north is up.
    pub fn axes(&self, spec: &FrameSpec) -> Axes {
        let forward = (DVec3::from(self.target) - DVec3::from(self.position)).normalize_or(DVec3::Y);
        let mut right = forward.cross(self.up.into());
        if right.length() < 1e-9 {
            right = forward.cross(DVec3::Y);
        }
        let right = right.normalize_or(DVec3::X);
        let up = right.cross(forward);
        let tan_y = (self.fov_y_deg.to_radians() / 2.0).tan();
        let aspect = f64::from(spec.width_px) / f64::from(spec.height_px);
        Axes { forward, right: right * tan_y * aspect, up: up * tan_y }
    }

    pub fn ray(&self, spec: &FrameSpec, x: u32, y: u32) -> DVec3 {
        self.axes(spec).ray(spec, x, y)
    }

    /// The ray-caster's uniforms, without those of the city.
    pub fn frame(&self, spec: &FrameSpec) -> FrameUniform {
        let axes = self.axes(spec);
        let sun = Vec3::new(0.45, -0.55, 0.704).normalize_or(Vec3::Z);
        FrameUniform {
            forward: axes.forward.as_vec3().into(),
            width_px: spec.width_px,
            right: axes.right.as_vec3().into(),
            height_px: spec.height_px,
            up: axes.up.as_vec3().into(),
            sun: sun.into(),
            light: Light::of_sun(sun, Air::default()),
            // Fixed, because an exposure by the frame's mean would change with every pixel.
            exposure: 1.2,
            shading: spec.shading as u32,
            samples: spec.samples,
            ..FrameUniform::zeroed()
        }
    }
}

/// A frame of a city of 100 m in a look, which begins 50 m to the west of the camera and ends there to the east.
pub fn in_look(frame: FrameUniform, look: Look) -> FrameUniform {
    let [lines, contact] = look.edges();
    let (fog, city) = ([40.0, 1.0 / 300.0, 1.0 / 30.0, 0.0], [-50.0, -50.0, 50.0, 50.0]);
    FrameUniform {
        light: look.grade(frame.light, frame.sun.into()),
        edges: [lines, contact, 0.0, 0.0],
        fog: if look.has_fog() { fog } else { [0.0; 4] },
        city,
        ..frame
    }
}
