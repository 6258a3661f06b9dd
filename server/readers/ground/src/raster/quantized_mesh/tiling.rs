//! Which part of the world a tile has.

use std::f64::consts::PI;

/// The finest level: 2^31 columns.
pub(super) const MAX_LEVEL: u8 = 30;
/// Coordinate of EPSG:3857 at 180 degrees east, in metres.
const MERCATOR_LIMIT_M: f64 = 6_378_137.0 * PI;

/// A tile of the pyramid. Sorted by level, then by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct TileId {
    /// 0 is the coarsest.
    pub(super) level: u8,
    /// From the north.
    pub(super) row: u32,
    /// From the west.
    pub(super) column: u32,
}

/// How the world is cut into tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Projection {
    /// EPSG:4326: two square tiles at level 0.
    Geographic,
    /// EPSG:3857: one tile at level 0.
    WebMercator,
}

/// Places of a tile's pixels within that tile or a coarser one, from 0 at an edge to 1 at the opposite edge.
pub(super) struct PixelPlaces {
    /// From the west, ascending.
    pub(super) columns: Vec<f64>,
    /// From the south, descending: the first row is the northern one.
    pub(super) rows: Vec<f64>,
}

impl TileId {
    /// The tile some levels up that contains this one; `None` above level 0.
    pub(super) fn ancestor(self, levels: u8) -> Option<Self> {
        let level = self.level.checked_sub(levels)?;
        Some(Self { level, row: self.row >> levels, column: self.column >> levels })
    }

    /// The four tiles of the next level that make up this one, if that level is possible.
    pub(super) fn children(self) -> impl Iterator<Item = Self> {
        let level = self.level + 1;
        let is_possible = level <= MAX_LEVEL;
        let child =
            move |index: u32| Self { level, row: self.row << 1 | index >> 1, column: self.column << 1 | index & 1 };
        (0..4).filter(move |_| is_possible).map(child)
    }
}

impl Projection {
    /// Its name.
    pub(super) fn crs(self) -> &'static str {
        match self {
            Self::Geographic => "EPSG:4326",
            Self::WebMercator => "EPSG:3857",
        }
    }

    /// Number of columns of a level, which is at most [`MAX_LEVEL`].
    pub(super) fn columns(self, level: u8) -> u32 {
        match self {
            Self::Geographic => 2 << level,
            Self::WebMercator => 1 << level,
        }
    }

    pub(super) fn rows(self, level: u8) -> u32 {
        1 << level
    }

    /// The north-western corner of a tile and its side, in degrees or metres.
    pub(super) fn corner(self, tile: TileId) -> ([f64; 2], f64) {
        let [west, north, height] = match self {
            Self::Geographic => [-180.0, 90.0, 180.0],
            Self::WebMercator => [-MERCATOR_LIMIT_M, MERCATOR_LIMIT_M, 2.0 * MERCATOR_LIMIT_M],
        };
        let side = height / f64::from(self.rows(tile.level));
        ([west + f64::from(tile.column) * side, north - f64::from(tile.row) * side], side)
    }

    /// Places of the centres of `side` x `side` pixels of a tile within its ancestor some levels up.
    ///
    /// Vertices lie between a tile's edges by longitude and latitude in every projection, so that the rows of
    /// EPSG:3857, whose steps are equal in metres, have unequal steps.
    pub(super) fn places(self, tile: TileId, levels: u8, side: u32) -> PixelPlaces {
        let scale = f64::from(1_u32 << levels.min(MAX_LEVEL));
        // The part of a number below the ancestor's.
        let within = |number: u32| f64::from(number & ((1 << levels.min(MAX_LEVEL)) - 1));
        let along = |number: u32, pixel: u32| (within(number) + (f64::from(pixel) + 0.5) / f64::from(side)) / scale;
        let columns = (0..side).map(|pixel| along(tile.column, pixel)).collect();
        let from_north = (0..side).map(|pixel| along(tile.row, pixel));
        let rows = match self {
            Self::Geographic => from_north.map(|place| 1.0 - place).collect(),
            Self::WebMercator => {
                let (row, rows) =
                    (f64::from(tile.row >> levels.min(MAX_LEVEL)), f64::from(self.rows(tile.level)) / scale);
                let latitude = |place: f64| mercator_latitude((row + place) / rows);
                let (north, south) = (latitude(0.0), latitude(1.0));
                from_north.map(|place| (latitude(place) - south) / (north - south)).collect()
            }
        };
        PixelPlaces { columns, rows }
    }
}

/// Latitude in radians by the place between the northern edge of the map of EPSG:3857, 0, and the southern one, 1.
fn mercator_latitude(from_north: f64) -> f64 {
    libm::atan(libm::sinh(PI * (1.0 - 2.0 * from_north)))
}
