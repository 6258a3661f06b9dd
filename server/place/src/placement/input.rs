//! What the coordinates of a source mean.

use super::earth::Geodetic;
use crate::crs::{Axes, Crs, CrsError, Horizontal, LocalOrigin, System, Vertical};
use insula_source::object::AxisOrder;
use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;
use std::sync::Arc;

/// Definition of longitude and latitude of WGS84.
pub(super) const WGS84: &str = "+proj=longlat +ellps=WGS84 +towgs84=0,0,0";
/// Habits of publishers that go by the size of coordinates, because files do not tell them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Habit {
    None,
    /// Zones of UTM in ETRS89: eastings may have the zone in front, as in 32 500 000. This is what is subtracted from
    /// eastings beyond a third of it.
    ZonePrefix {
        metres: f64,
    },
    /// South African Lo systems: coordinates count west and south in the registry, east and north in other files.
    /// Places are south of the equator, where the second coordinate is 0.
    SouthAfrican,
    /// Krovak's projection: coordinates count south and west, or east and north. All places are south and west of the
    /// origin, and farther to the south than to the west.
    Krovak,
}

impl Habit {
    fn of(horizontal: &Horizontal) -> Self {
        match (horizontal.code, &horizontal.system) {
            (Some(code @ 25_828..=25_838), _) => Self::ZonePrefix { metres: f64::from(code - 25_800) * 1e6 },
            (Some(2046..=2055 | 22_275..=22_293), _) => Self::SouthAfrican,
            (_, System::Projected(definition)) if definition.is_krovak() => Self::Krovak,
            _ => Self::None,
        }
    }

    #[inline]
    fn apply(self, [x, y]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::ZonePrefix { metres } if x > metres / 3.0 => [x - metres, y],
            Self::SouthAfrican if y > 0.0 => [-x, -y],
            Self::Krovak if x * y > 0.0 => [-x.abs().min(y.abs()), -x.abs().max(y.abs())],
            _ => [x, y],
        }
    }
}

/// How the coordinates of a source are read.
#[derive(Debug, Clone)]
pub(super) struct SourceInput {
    pub(super) horizontal: Horizontal,
    /// Order of the coordinates.
    pub(super) axes: Axes,
    /// Metres or radians in a unit of the coordinates.
    pub(super) unit: f64,
    /// Metres in a unit of heights; negative for depths.
    pub(super) height_unit_m: f64,
    pub(super) is_ellipsoidal: bool,
    pub(super) habit: Habit,
    /// Projection from the source's system to WGS84; `None` for positions in space.
    pub(super) plane: Option<Plane>,
}

/// Projections between a source and longitude and latitude of WGS84.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    pub(super) source: Arc<Proj>,
    pub(super) wgs84: Arc<Proj>,
}

impl SourceInput {
    /// Fails if the projection is not supported.
    pub(super) fn new(crs: &Crs, order: AxisOrder) -> Result<Self, CrsError> {
        let horizontal = crs.horizontal.clone();
        let (unit, plane) = match &horizontal.system {
            System::Geographic { definition, unit_deg } => (unit_deg.to_radians(), Some(definition)),
            System::Projected(definition) => (definition.unit_m, Some(definition)),
            System::Geocentric(definition) => (definition.unit_m, None),
            System::Local(_) => (1.0, None),
        };
        let proj = |text: &str| {
            let proj = Proj::from_proj_string(text).map_err(|error| CrsError::Unsupported(error.to_string()));
            proj.map(Arc::new)
        };
        let plane = match plane {
            Some(definition) => Some(Plane { source: proj(&definition.text())?, wgs84: proj(WGS84)? }),
            None => None,
        };
        let habit = Habit::of(&horizontal);
        let axes = match order {
            AxisOrder::Authority => horizontal.axes,
            AxisOrder::EastFirst | AxisOrder::MostlyEastFirst if habit == Habit::None => horizontal.axes.east_first(),
            AxisOrder::EastFirst | AxisOrder::MostlyEastFirst => Axes::EAST_NORTH,
        };
        let height_unit_m = match &crs.vertical {
            Vertical::Ellipsoidal { unit_m } => *unit_m,
            Vertical::Orthometric(datum) => datum.unit_m,
            // Heights without a system are in the unit of the map.
            Vertical::Unknown if matches!(horizontal.system, System::Projected(_)) => unit,
            Vertical::Unknown => 1.0,
        };
        Ok(Self {
            horizontal,
            axes,
            unit,
            height_unit_m,
            is_ellipsoidal: matches!(crs.vertical, Vertical::Ellipsoidal { .. }),
            habit,
            plane,
        })
    }

    /// Whether the coordinates on the map are lengths in feet.
    pub(super) fn is_in_feet(&self) -> bool {
        matches!(self.horizontal.system, System::Projected(_)) && (0.3..0.31).contains(&self.unit)
    }

    /// Coordinates towards east and north in metres or radians.
    #[inline]
    pub(super) fn plane_position(&self, p: [f64; 3]) -> [f64; 2] {
        self.plane_position_with(self.axes, p)
    }

    #[inline]
    fn plane_position_with(&self, axes: Axes, p: [f64; 3]) -> [f64; 2] {
        let [x, y] = axes.east_north([p[0], p[1]]);
        let [x, y] = if self.unit == 1.0 { [x, y] } else { [x * self.unit, y * self.unit] };
        self.habit.apply([x, y])
    }

    /// Longitude and latitude of WGS84 of a position on the map.
    pub(super) fn plane_to_wgs84(&self, [x, y]: [f64; 2]) -> Option<Geodetic> {
        let plane = self.plane.as_ref()?;
        let is_geographic = matches!(self.horizontal.system, System::Geographic { .. });
        if is_geographic && !is_on_earth([x, y]) {
            return None;
        }
        let (longitude_rad, latitude_rad) = transform_vertex_2d(&plane.source, &plane.wgs84, (x, y)).ok()?;
        is_on_earth([longitude_rad, latitude_rad]).then_some(Geodetic { longitude_rad, latitude_rad, height_m: 0.0 })
    }

    /// Longitude and latitude in degrees; `None` if the position is not on Earth.
    pub(super) fn degrees(&self, p: [f64; 3]) -> Option<[f64; 2]> {
        self.degrees_with(self.axes, p)
    }

    /// As [`Self::degrees`], of coordinates in another order.
    pub(super) fn degrees_with(&self, axes: Axes, p: [f64; 3]) -> Option<[f64; 2]> {
        let position = match &self.horizontal.system {
            System::Local(origin) => origin_without_geoid(*origin),
            System::Geocentric(_) => Geodetic::from_centre(p.map(|coordinate| coordinate * self.unit))?,
            System::Geographic { .. } | System::Projected(_) => {
                self.plane_to_wgs84(self.plane_position_with(axes, p))?
            }
        };
        Some([position.longitude_rad.to_degrees(), position.latitude_rad.to_degrees()])
    }
}

/// The origin of a local system, as if the geoid were the ellipsoid.
pub(super) fn origin_without_geoid(origin: LocalOrigin) -> Geodetic {
    Geodetic {
        longitude_rad: origin.longitude_deg.to_radians(),
        latitude_rad: origin.latitude_deg.to_radians(),
        height_m: origin.height_m,
    }
}

/// Whether radians are a longitude (up to one turn) and a latitude.
#[inline]
pub(super) fn is_on_earth([longitude_rad, latitude_rad]: [f64; 2]) -> bool {
    longitude_rad.abs() <= std::f64::consts::TAU && latitude_rad.abs() <= std::f64::consts::FRAC_PI_2 + 1e-12
}
