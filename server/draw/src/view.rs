//! From points of the scene to places on the page.

use crate::bsp::Eye;
use crate::convex::{PagePoint, PageRect};
use crate::error::DrawError;
use crate::face::FacePlane;
use crate::volume::ViewVolume;
use glam::{DVec2, DVec3};
use insula_export::camera::ExportCamera;

/// Nothing nearer to the eye than this is drawn, in metres.
const NEAR_M: f64 = 0.1;
/// Shapes reach this far over the frame until they are clipped exactly, in millimetres.
const OVERLAP_MM: f64 = 1.0;
/// Denominators of scales, times powers of ten.
const SCALES: [f64; 6] = [1.0, 1.25, 2.0, 2.5, 5.0, 7.5];

/// From where a drawing shows the city.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum DrawView {
    /// From above, north at the top.
    #[default]
    Plan,
    /// Parallel rays. The view looks towards `azimuth_deg`, clockwise from the grid's north, from `elevation_deg` above the horizon
    /// (0 to 90).
    Axonometric { azimuth_deg: f64, elevation_deg: f64 },
    /// The vertical field of view is the height of the frame.
    Perspective(ExportCamera),
}

/// A rectangle of the paper in millimetres from its lower left corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperRect {
    pub min: [f64; 2],
    pub max: [f64; 2],
}

impl PaperRect {
    /// Width and height.
    #[must_use]
    pub fn size(&self) -> [f64; 2] {
        [0, 1].map(|k| self.max[k] - self.min[k])
    }
}

/// The paper and its grid of whole coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperGrid {
    /// Width and height in millimetres.
    pub size_mm: [f64; 2],
    /// A power of two, so that the longer side has at most 2^30 units.
    pub(crate) units_per_mm: f64,
}

impl PaperGrid {
    pub(crate) fn new(size_mm: [f64; 2]) -> Self {
        let longer = size_mm[0].max(size_mm[1]);
        let exponent = (f64::from(1u32 << 30) / longer).log2().floor();
        Self { size_mm, units_per_mm: exponent.exp2() }
    }

    /// The nearest place of the grid, whose origin is the middle of the paper.
    pub(crate) fn point(&self, mm: DVec2) -> PagePoint {
        let at = |v: f64, k: usize| ((v - 0.5 * self.size_mm[k]) * self.units_per_mm).round() as i32;
        PagePoint::new(at(mm.x, 0), at(mm.y, 1))
    }

    /// Millimetres from the lower left corner.
    pub(crate) fn mm(&self, point: PagePoint) -> [f64; 2] {
        let at = |v: i32, k: usize| f64::from(v) / self.units_per_mm + 0.5 * self.size_mm[k];
        [at(point.x, 0), at(point.y, 1)]
    }

    pub(crate) fn rect(&self, rect: &PaperRect) -> PageRect {
        PageRect { min: self.point(DVec2::from(rect.min)), max: self.point(DVec2::from(rect.max)) }
    }
}

/// The place of a sheet of paper in metres along the axes of the view: those of the city's coordinate system for a plan, from the city's
/// origin for others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MetreFrame {
    /// Metres of a millimetre on paper.
    pub per_mm: f64,
    /// Of the lower left corner of the paper.
    pub at_zero: [f64; 2],
}

impl MetreFrame {
    /// Metres of a place of the paper in millimetres.
    #[must_use]
    pub fn place(&self, mm: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| self.at_zero[k] + mm[k] * self.per_mm)
    }
}

/// The axes of a view, before the scale is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewAxes {
    pub(crate) right: DVec3,
    pub(crate) up: DVec3,
    /// Away from the eye.
    pub(crate) forward: DVec3,
    /// Metres from the scene's origin; `None` for parallel rays.
    pub(crate) position: Option<DVec3>,
    /// Tangent of half of the vertical field of view; 0 for parallel rays.
    tan_y: f64,
}

impl ViewAxes {
    /// Fails if the view has no direction or a value is out of range.
    pub(crate) fn new(view: &DrawView, origin: [f64; 3]) -> Result<Self, DrawError> {
        let invalid = |text: &str| DrawError::Invalid(text.to_owned());
        match *view {
            DrawView::Plan => {
                Ok(Self { right: DVec3::X, up: DVec3::Y, forward: DVec3::NEG_Z, position: None, tan_y: 0.0 })
            }
            DrawView::Axonometric { azimuth_deg, elevation_deg } => {
                if !azimuth_deg.is_finite() || !(0.0..=90.0).contains(&elevation_deg) {
                    return Err(invalid("an axonometric view needs an azimuth, and an elevation from 0 to 90 degrees"));
                }
                let (sin_az, cos_az) = azimuth_deg.to_radians().sin_cos();
                let (sin_el, cos_el) = elevation_deg.to_radians().sin_cos();
                let forward = DVec3::new(sin_az * cos_el, cos_az * cos_el, -sin_el);
                let right = DVec3::new(cos_az, -sin_az, 0.0);
                Ok(Self { right, up: right.cross(forward), forward, position: None, tan_y: 0.0 })
            }
            DrawView::Perspective(camera) => {
                let axes = camera.axes().ok_or_else(|| {
                    invalid("the camera needs a target beside its position, and a field of view from 1 to 170")
                })?;
                let tan_y = (0.5 * camera.fov_y_deg).to_radians().tan();
                let position = Some(DVec3::from(camera.position) - DVec3::from(origin));
                let [right, up, forward] = [axes.x_axis, axes.y_axis, axes.z_axis];
                Ok(Self { right, up, forward, position, tan_y })
            }
        }
    }

    /// Parallel rays along a direction.
    pub(crate) fn towards(forward: DVec3) -> Self {
        let across = [DVec3::Z, DVec3::Y].map(|up| forward.cross(up)).into_iter().find(|right| right.length() > 1e-6);
        let right = across.and_then(DVec3::try_normalize).unwrap_or(DVec3::X);
        Self { right, up: right.cross(forward), forward, position: None, tan_y: 0.0 }
    }

    pub(crate) fn eye(&self) -> Eye {
        self.position.map_or(Eye::Direction(-self.forward), Eye::Point)
    }
}

/// From the scene to the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Projection {
    pub(crate) axes: ViewAxes,
    pub(crate) frame: PaperRect,
    /// Millimetres on paper of a metre; of the tangent 1 in a perspective.
    factor: f64,
    /// The point in the middle of the frame, in metres along the axes.
    middle: DVec2,
    /// The scale is one to this; `None` for a perspective.
    pub(crate) scale: Option<f64>,
    /// The largest round scale at which all is in the frame, if that of the drawing is too large for it.
    pub(crate) fitting_scale: Option<f64>,
}

impl Projection {
    /// Projects into `frame`. Of parallel rays, `points` are in the middle, with the given scale or the largest round one at which
    /// all are in the frame.
    pub(crate) fn new(
        axes: ViewAxes,
        frame: PaperRect,
        scale: Option<f64>,
        points: impl Iterator<Item = DVec3>,
    ) -> Self {
        let [width, height] = frame.size();
        if axes.position.is_some() {
            let factor = 0.5 * height / axes.tan_y;
            return Self { axes, frame, factor, middle: DVec2::ZERO, scale: None, fitting_scale: None };
        }
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for point in points {
            let at = DVec2::new(point.dot(axes.right), point.dot(axes.up));
            (low, high) = (low.min(at), high.max(at));
        }
        let size = (high - low).max(DVec2::splat(1.0));
        let fitting = 1000.0 * (size.x / width).max(size.y / height);
        let scale = scale.unwrap_or_else(|| round_scale(fitting));
        let fitting_scale = (scale < fitting).then(|| round_scale(fitting));
        Self { axes, frame, factor: 1000.0 / scale, middle: 0.5 * (low + high), scale: Some(scale), fitting_scale }
    }

    /// Millimetres on paper of a metre across the view; in a perspective, at a distance of a metre.
    pub(crate) fn mm_per_m(&self) -> f64 {
        self.factor
    }

    /// Millimetres from the lower left corner of the paper.
    pub(crate) fn project(&self, point: DVec3) -> DVec2 {
        let p = self.axes.position.map_or(point, |eye| point - eye);
        let at = DVec2::new(p.dot(self.axes.right), p.dot(self.axes.up));
        let divisor = if self.axes.position.is_some() { p.dot(self.axes.forward).max(NEAR_M) } else { 1.0 };
        let middle =
            DVec2::new(0.5 * (self.frame.min[0] + self.frame.max[0]), 0.5 * (self.frame.min[1] + self.frame.max[1]));
        middle + (at / divisor - self.middle) * self.factor
    }

    /// How the paper lies along the axes of parallel rays, for a scene at `origin`: in world metres if they are those of the world, else in
    /// metres from `origin`, because then the numbers say nothing but have many digits. `None` for a perspective, which has no scale.
    pub(crate) fn metres(&self, origin: [f64; 3]) -> Option<MetreFrame> {
        self.scale?;
        let is_plan = self.axes.right.abs_diff_eq(DVec3::X, 1e-9) && self.axes.up.abs_diff_eq(DVec3::Y, 1e-9);
        let origin = if is_plan { DVec3::from(origin) } else { DVec3::ZERO };
        let corner = DVec2::from([0, 1].map(|k| 0.5 * (self.frame.min[k] + self.frame.max[k]))) / self.factor;
        let at_zero = DVec2::new(origin.dot(self.axes.right), origin.dot(self.axes.up)) + self.middle - corner;
        Some(MetreFrame { per_mm: 1.0 / self.factor, at_zero: at_zero.to_array() })
    }

    /// The point of a plane that parallel rays project to a place of the paper.
    pub(crate) fn lift(&self, mm: DVec2, plane: &FacePlane) -> DVec3 {
        let frame_middle = DVec2::from([0, 1].map(|k| 0.5 * (self.frame.min[k] + self.frame.max[k])));
        let at = (mm - frame_middle) / self.factor + self.middle;
        let point = self.axes.right * at.x + self.axes.up * at.y;
        point - self.axes.forward * (plane.height(point) / plane.normal.dot(self.axes.forward))
    }

    /// Half of what is shown across the view, in metres; in a perspective, at a distance of a metre.
    fn half_size(&self) -> DVec2 {
        let [width, height] = self.frame.size();
        DVec2::new(0.5 * width + OVERLAP_MM, 0.5 * height + OVERLAP_MM) / self.factor
    }

    /// What the view shows of a scene in a box.
    pub(crate) fn volume(&self, [low, high]: [DVec3; 2]) -> ViewVolume {
        let (right, up, forward) = (self.axes.right, self.axes.up, self.axes.forward);
        let eye = self.axes.position;
        let from = eye.unwrap_or(DVec3::ZERO);
        let depth = (0.5 * (low + high) - from).dot(forward);
        let reach = (0.5 * (high - low)).dot(forward.abs());
        let half = self.half_size();
        let mut corners = Vec::with_capacity(8);
        for end in [depth - reach, depth + reach] {
            let (end, size) = if eye.is_some() { (end.max(NEAR_M), end.max(NEAR_M)) } else { (end, 1.0) };
            for [x, y] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                let across = right * (self.middle.x + x * half.x) + up * (self.middle.y + y * half.y);
                corners.push(from + forward * end + across * size);
            }
        }
        ViewVolume { planes: self.planes(), corners }
    }

    /// The planes of the view, normals inwards; what is outside is not drawn.
    pub(crate) fn planes(&self) -> Vec<FacePlane> {
        let half = self.half_size();
        let (right, up, forward) = (self.axes.right, self.axes.up, self.axes.forward);
        match self.axes.position {
            None => [(right, half.x, self.middle.x), (up, half.y, self.middle.y)]
                .into_iter()
                .flat_map(|(axis, half, middle)| {
                    [
                        FacePlane { normal: axis, offset: middle - half },
                        FacePlane { normal: -axis, offset: -middle - half },
                    ]
                })
                .collect(),
            Some(eye) => {
                let near = FacePlane { normal: forward, offset: forward.dot(eye) + NEAR_M };
                let inwards = [
                    right + forward * half.x,
                    -right + forward * half.x,
                    up + forward * half.y,
                    -up + forward * half.y,
                ];
                let sides = inwards.map(|normal| {
                    let normal = normal.normalize_or(forward);
                    FacePlane { normal, offset: normal.dot(eye) }
                });
                std::iter::once(near).chain(sides).collect()
            }
        }
    }
}

/// The smallest round denominator that is at least `fitting`.
fn round_scale(fitting: f64) -> f64 {
    let power = 10f64.powf(fitting.max(1.0).log10().floor());
    let rounded = SCALES.map(|scale| scale * power).into_iter().find(|scale| *scale >= fitting);
    rounded.unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: PaperRect = PaperRect { min: [10.0, 10.0], max: [110.0, 60.0] };
    const TO_NORTH: DrawView = DrawView::Perspective(ExportCamera {
        position: [0.0; 3],
        target: [0.0, 9.0, 0.0],
        up: [0.0, 0.0, 1.0],
        fov_y_deg: 90.0,
    });

    #[test]
    fn plans_are_to_scale_and_perspectives_fill_the_frame() {
        let axes = ViewAxes::new(&DrawView::Plan, [0.0; 3]).unwrap();
        let points = [DVec3::ZERO, DVec3::new(80.0, 30.0, 9.0)];
        let plan = Projection::new(axes, FRAME, None, points.into_iter());
        assert_eq!((plan.scale, plan.fitting_scale), (Some(1000.0), None));
        let at = |scale| Projection::new(axes, FRAME, Some(scale), points.into_iter()).fitting_scale;
        assert_eq!([500.0, 799.0, 800.0, 5000.0].map(at), [Some(1000.0), Some(1000.0), None, None]);
        assert_eq!(plan.project(points[0]), DVec2::new(20.0, 20.0));
        assert_eq!(plan.project(points[1]), DVec2::new(100.0, 50.0));
        let metres = plan.metres([84_000.0, 446_000.0, 3.0]).unwrap();
        assert_eq!(
            [[20.0, 20.0], [100.0, 50.0]].map(|mm| metres.place(mm)),
            [[84_000.0, 446_000.0], [84_080.0, 446_030.0]]
        );
        let axes = ViewAxes::new(&TO_NORTH, [0.0; 3]).unwrap();
        let perspective = Projection::new(axes, FRAME, None, std::iter::empty());
        assert!((perspective.project(DVec3::new(0.0, 7.0, 7.0)) - DVec2::new(60.0, 60.0)).length() < 1e-9);
        assert_eq!(perspective.metres([0.0; 3]), None);
        let planes = perspective.planes();
        assert!(planes.iter().all(|plane| plane.height(DVec3::new(0.0, 7.0, 0.0)) > 0.0));
        assert!(planes.iter().any(|plane| plane.height(DVec3::new(0.0, 7.0, 8.0)) < 0.0));
    }

    #[test]
    fn volumes_are_between_the_planes_and_around_the_scene() {
        let points = [DVec3::new(-3.0, 20.0, 1.0), DVec3::new(80.0, 50.0, 9.0)];
        for view in [DrawView::Plan, DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 35.0 }, TO_NORTH] {
            let axes = ViewAxes::new(&view, [0.0; 3]).unwrap();
            let projection = Projection::new(axes, FRAME, Some(1000.0), points.into_iter());
            let volume = projection.volume(points);
            let middle = volume.corners.iter().sum::<DVec3>() / volume.corners.len() as f64;
            // Each corner is on two borders; those of a perspective have another one near to the eye.
            for corner in &volume.corners {
                let heights: Vec<f64> = volume.planes.iter().map(|plane| plane.height(*corner)).collect();
                assert!(heights.iter().filter(|height| height.abs() < 1e-6).count() >= 2, "{view:?}: {heights:?}");
                assert!(heights.iter().all(|height| *height > -1e-6));
            }
            let at = |offset| FacePlane { normal: axes.forward, offset };
            let deepest = volume.corners.iter().map(|corner| corner.dot(axes.forward)).fold(f64::MIN, f64::max);
            assert!(points.iter().all(|point| point.dot(axes.forward) <= deepest + 1e-9), "{view:?}");
            assert_eq!(volume.sides(&at(middle.dot(axes.forward))), [true, true]);
            assert_eq!(volume.sides(&at(deepest + 1.0)), [false, true]);
            assert!(volume.meets([middle - 1.0, middle + 1.0]));
            let aside = middle + axes.right * 1000.0;
            assert!(!volume.meets([aside - 1.0, aside + 1.0]));
        }
        let all = ViewVolume::default();
        assert!(all.meets([DVec3::ZERO; 2]) && all.sides(&FacePlane { normal: DVec3::X, offset: 1e9 }) == [true, true]);
    }

    #[test]
    fn an_axonometric_view_from_above_is_a_plan() {
        let view = DrawView::Axonometric { azimuth_deg: 0.0, elevation_deg: 90.0 };
        let (from_above, plan) =
            (ViewAxes::new(&view, [0.0; 3]).unwrap(), ViewAxes::new(&DrawView::Plan, [0.0; 3]).unwrap());
        assert!((from_above.up - plan.up).length() < 1e-12 && (from_above.forward - plan.forward).length() < 1e-12);
        let corner = |axes| {
            let points = [DVec3::ZERO, DVec3::new(80.0, 30.0, 9.0)].into_iter();
            Projection::new(axes, FRAME, None, points).metres([84_000.0, 446_000.0, 0.0]).unwrap().at_zero
        };
        let from_side = DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 35.0 };
        let from_side = corner(ViewAxes::new(&from_side, [0.0; 3]).unwrap());
        assert!((0..2).all(|k| (corner(from_above)[k] - corner(plan)[k]).abs() < 1e-3));
        assert!(from_side.iter().all(|v| v.abs() < 200.0), "from the city's origin: {from_side:?}");
        assert!([200.0, 1_001.0].map(round_scale) == [200.0, 1250.0]);
    }

    #[test]
    fn grids_have_at_most_thirty_bits() {
        for size in [[420.0, 297.0], [1189.0, 841.0], [10.0, 10.0]] {
            let grid = PaperGrid::new(size);
            let corner = grid.point(DVec2::from(size));
            assert!(corner.x <= 1 << 29 && corner.x > 1 << 27, "{corner:?}");
            let back = grid.mm(corner);
            assert!((back[0] - size[0]).abs() < 1e-5 && (back[1] - size[1]).abs() < 1e-5);
        }
    }
}
