//! What the page shows over a frame: positions of markers and lines, the measured figure, the state of streaming.

use super::viewer::CityViewer;
use glam::{DVec2, DVec3};
use insula_shaders::layout::Shading;
use insula_viewer::camera::View;
use insula_viewer::camera_text;
use insula_viewer::interaction::camera_control::ControlMode;
use insula_viewer::interaction::measure::MeasureKind;
use insula_viewer::node_boxes::box_edges;
use insula_viewer::projection::{project, project_line};
use insula_viewer::source::REPLACED;
use insula_viewer::streamer::StreamStatus;
use insula_web_host::messages::{FrameMessage, MeasureMessage, StatusMessage};

/// Points nearer to a surface than this share of their distance are visible.
const VISIBLE_SHARE: f64 = 0.995;

impl CityViewer {
    /// The state of streaming.
    pub(crate) fn status_message(&self) -> StatusMessage {
        let (kind, text) = match self.streamer.stream_status(self.elapsed()) {
            StreamStatus::Ready => (None, String::new()),
            StreamStatus::Loading => (Some("loading"), String::new()),
            StreamStatus::Reconnecting => (Some("offline"), self.streamer.downloads().last_error().to_owned()),
            StreamStatus::Failed => {
                let text = self.streamer.check().err().map(|e| e.to_string()).unwrap_or_default();
                (Some(if text == REPLACED { "replaced" } else { "error" }), text)
            }
        };
        StatusMessage { op: "status", kind, text }
    }

    pub(crate) fn frame_message(&self) -> FrameMessage {
        let view = self.view();
        let camera = &view.camera;
        let pixels = |share: DVec2| share * DVec2::new(f64::from(view.width_px), f64::from(view.height_px));
        let marker = |point: &DVec3| match project(&view, *point) {
            Some(share) => (pixels(share).x, pixels(share).y, self.sees(*point)),
            None => (0.0, 0.0, false),
        };
        FrameMessage {
            op: "frame",
            camera: camera_text::format(camera),
            position: camera.position.to_array(),
            azimuth: camera.azimuth_deg(),
            pitch: camera.angles().1.to_degrees(),
            mode: match self.control.mode() {
                ControlMode::Orbit => "orbit",
                ControlMode::Fly => "fly",
                ControlMode::Walk => "walk",
            },
            collides: self.control.collides(),
            time: self.daylight.time_text(),
            meters_per_pixel: self.meters_per_pixel(&view),
            markers: self.markers.iter().map(marker).collect(),
            lines: self.lines.iter().map(|line| self.points_along(&view, line)).collect(),
            measure: self.measure_message(&view),
            boxes: self.box_lines(&view),
            missing: self.streamer.missing_tiles(),
            is_settled: self.streamer.is_settled(),
            tiles: {
                let counts = self.streamer.tile_counts();
                counts.blockmaps + counts.meshes
            },
        }
    }

    fn box_lines(&self, view: &View) -> Vec<[f64; 4]> {
        if self.shading != Shading::Bounds {
            return Vec::new();
        }
        let size = DVec2::new(f64::from(view.width_px), f64::from(view.height_px));
        let edges = box_edges(self.streamer.tree(), self.streamer.selection(), view);
        edges.into_iter().map(|[a, b]| flat(a * size, b * size)).collect()
    }

    fn measure_message(&self, view: &View) -> Option<MeasureMessage> {
        if !self.measure.is_active {
            return None;
        }
        let size = DVec2::new(f64::from(view.width_px), f64::from(view.height_px));
        let point = |p: &DVec3| project(view, *p).map(|share| (share * size).to_array());
        let line = |ends: [DVec3; 2]| project_line(view, ends).map(|[a, b]| flat(a * size, b * size));
        let kind = self.measure.kind();
        Some(MeasureMessage {
            kind: kind.word(),
            figures: self.measure.figures(),
            points: self.measure.points().iter().filter_map(point).collect(),
            lines: self.measure.lines().filter_map(line).collect(),
            closed: kind == MeasureKind::Area,
        })
    }

    /// Whether neither the city nor the ground around it is between the camera and a point.
    pub(crate) fn sees(&self, point: DVec3) -> bool {
        let eye = self.control.camera().position;
        let to = eye.lerp(point, VISIBLE_SHARE);
        self.solids().surface_on_way(eye, to).is_none()
    }

    /// Points along a line: places in pixels, and whether nothing hides them.
    fn points_along(&self, view: &View, line: &[DVec3]) -> Vec<(f64, f64, bool)> {
        const PARTS: u32 = 8;
        let size = DVec2::new(f64::from(view.width_px), f64::from(view.height_px));
        let parts = |ends: &[DVec3]| {
            let [a, b] = [ends[0], ends[1]];
            (0..PARTS).map(move |i| a.lerp(b, f64::from(i) / f64::from(PARTS)))
        };
        let points = line.windows(2).flat_map(parts).chain(line.last().copied());
        points
            .map(|point| match project(view, point).map(|share| share * size) {
                Some(at) => (at.x, at.y, self.sees(point)),
                None => (0.0, 0.0, false),
            })
            .collect()
    }

    /// Width of a pixel in metres at the surface in the middle of the view.
    fn meters_per_pixel(&self, view: &View) -> Option<f64> {
        let (_, distance_m) = self.surface_at(0.5, 0.5)?;
        Some(distance_m / view.focal_px())
    }
}

fn flat(a: DVec2, b: DVec2) -> [f64; 4] {
    [a.x, a.y, b.x, b.y]
}
